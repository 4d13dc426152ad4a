// SPDX-License-Identifier: Apache-2.0
// Any bytes as a compressed mesh of a glTF file: a Draco stream, decoded by the worker as in a
// bake; after a byte 3, what the worker leaves of one; else five bytes of a layout and a meshopt
// stream, which is decoded in this process.
#include "baker/input/gltf_compression.h"
#include "baker/input/image_worker.h"
#include "tests/fuzz/require.h"

#include <array>
#include <cstdint>
#include <string_view>

namespace {

using namespace envbake::gltf;
using envbake::fuzz::require;

void refused(const envbake::Error& error) {
    require(error.code == envbake::Errc::InvalidInput, "an input that is at fault");
    require(error.message.find('\n') == std::string::npos, "one line");
}

/// Wants one attribute more after another of what the worker leaves.
void draco(std::span<const std::byte> decoded) {
    std::map<std::string, int> ids;
    for (int id = 0; id < 4; ++id) {
        ids[std::to_string(id)] = id;
        const auto mesh = read_draco_mesh(decoded, ids);
        if (!mesh) return refused(mesh.error());
        for (const auto& [name, a] : mesh->attributes)
            require(mesh->vertex_count == 0 ? a.bytes.empty()
                                            : a.bytes.size() % mesh->vertex_count == 0,
                    "as many values as vertices");
    }
}

void meshopt(std::span<const std::byte> bytes) {
    constexpr std::array kModes{"ATTRIBUTES", "TRIANGLES", "INDICES"};
    constexpr std::array kFilters{"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};
    if (bytes.size() < 5) return;
    const auto at = [&](std::size_t i) { return std::to_integer<std::size_t>(bytes[i]); };
    MeshoptLayout layout{.count = at(3) + 256 * at(4),
                         .stride = at(2),
                         .mode = kModes[at(0) % kModes.size()],
                         .filter = kFilters[at(1) % kFilters.size()]};
    // What check_document lets through.
    const bool attributes = layout.mode == "ATTRIBUTES";
    if (layout.count == 0 || layout.stride == 0 || layout.stride % 2 != 0) return;
    if (attributes ? layout.stride % 4 != 0 : layout.stride > 4) return;
    if (layout.mode == "TRIANGLES" && layout.count % 3 != 0) return;
    if (!attributes) layout.filter = "NONE";
    if (layout.filter == "OCTAHEDRAL" && layout.stride != 4 && layout.stride != 8) return;
    if (layout.filter == "QUATERNION" && layout.stride != 8) return;
    const auto decoded = decode_meshopt(bytes.subspan(5), layout);
    if (decoded) require(decoded->size() == layout.count * layout.stride, "all elements");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::span<const std::byte> bytes(reinterpret_cast<const std::byte*>(data), size);
    const std::string_view text(reinterpret_cast<const char*>(data), size);
    if (text.starts_with("DRACO")) {
        const auto decoded = envbake::decode_draco_stream(bytes);
        decoded ? draco(decoded->bytes()) : refused(decoded.error());
    } else if (text.starts_with('\3')) {
        draco(bytes.subspan(1));
    } else {
        meshopt(bytes);
    }
    return 0;
}
