// SPDX-License-Identifier: Apache-2.0
// Any bytes as a bundle: opened, verified, decoded, shaded with, written again. Half of the inputs
// get their checksums made right, so that what lies behind them is reached.
#include "tests/fuzz/require.h"

#include "envbake/format/writer.h"
#include "envbake/runtime/bundle.h"
#include "envbake/runtime/glossy.h"
#include "envbake/runtime/shade.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <new>
#include <span>
#include <string>
#include <vector>

#include <unistd.h>

namespace {

namespace format = envbake::format;
namespace runtime = envbake::runtime;
using envbake::fuzz::require;

void shade(const runtime::Bundle& bundle) {
    float sum = runtime::irradiance(bundle.lighting(), {0, 0, 1})[0];
    for (const float r : {0.0f, 0.3f, 1.0f}) {
        for (const auto d : {runtime::Distribution::Ggx, runtime::Distribution::Beckmann})
            sum +=
                runtime::specular(bundle, d, {0, 1, 0}, {0.6f, 0.8f, 0}, r, {0.5f, 0.5f, 0.5f})[1];
        sum += runtime::lookup_average_albedo(bundle.brdf(), r);
    }
    std::vector<runtime::Rgb> out(6);
    std::vector<float> projected(runtime::projected_size(bundle.cluster_basis()));
    runtime::project_light(bundle.cluster_basis(), bundle.lighting(), projected);
    static const runtime::GlossyMatrices matrices;
    const runtime::LobeView& lobe = bundle.glossy_lobe();
    const runtime::GlossyLight glossy_light(bundle.lighting(), lobe.light_bands);
    std::vector<float> matrix(static_cast<std::size_t>(lobe.exit_bands * lobe.exit_bands *
                                                       lobe.light_bands * lobe.light_bands * 2));
    for (const runtime::Mesh& mesh : bundle.meshes()) {
        runtime::diffuse_exit(mesh.diffuse, bundle.lighting(), 0, out);
        sum += out[0][0] + out[5][2];
        runtime::diffuse_exit(mesh.diffuse, projected, 1, out);
        sum += out[0][0] + out[5][2];
        if (matrices.expand(lobe, mesh, 0, 0.6f, 2, matrix)) sum += matrix.back();
        sum += runtime::reflect(lobe, glossy_light.transfer(mesh, 1), 0.6f, {0.5f, 0.5f, 0.5f})
                   .radiance({0, 0.6f, 0.8f})[1];
        runtime::diffuse_exit(mesh.wavelet, bundle.wavelet_lighting().terms, 0, out);
        sum += out[0][0] + out[5][2];
    }
    volatile float sink = sum;
    static_cast<void>(sink);
}

/// A bundle without a fault in its arrays, written again, has the same arrays.
void write_again(const format::Reader& reader) {
    const std::string path = "/tmp/envbake_fuzz_" + std::to_string(::getpid()) + ".envb";
    auto writer = format::Writer::create(path);
    if (!writer) return;
    for (std::size_t i = 0; i < reader.array_count(); ++i) {
        const format::ArrayInfo info = reader.array(i);
        if (info.codec != format::Codec::None || !reader.verify(info)) return;
        const std::vector<std::uint64_t> shape(info.shape.begin(), info.shape.begin() + info.rank);
        require(
            static_cast<bool>(writer->add({std::string(info.name), info.type, shape, info.codec},
                                          reader.stored_bytes(info))),
            "the writer refuses an array that the reader accepts");
    }
    require(static_cast<bool>(writer->finish()), "the writer does not finish");
    const auto again = format::Reader::open(path.c_str());
    ::unlink(path.c_str());
    require(static_cast<bool>(again), "the reader refuses what was written");
    require(again->array_count() == reader.array_count(), "another number of arrays");
    for (std::size_t i = 0; i < reader.array_count(); ++i) {
        const auto a = reader.stored_bytes(reader.array(i)),
                   b = again->stored_bytes(again->array(i));
        require(std::equal(a.begin(), a.end(), b.begin(), b.end()), "an array changed");
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    std::byte* memory = new (std::align_val_t(64)) std::byte[size];  // exactly: ASan sees one more
    if (size > 0) std::memcpy(memory, data, size);
    const std::span<const std::byte> bytes(memory, size);
    if (const auto reader = format::Reader::open(bytes)) {
        std::uint64_t decoded = 0;
        for (std::size_t i = 0; i < reader->array_count(); ++i) {
            const format::ArrayInfo info = reader->array(i);
            static_cast<void>(reader->verify(info));
            if (info.codec == format::Codec::None) continue;
            decoded += info.size;
            std::vector<std::byte> out(info.size);
            static_cast<void>(reader->read(info, out));
        }
        require(decoded <= std::max<std::uint64_t>(8u << 20, 16 * size), "too much to decode");
        write_again(*reader);
    }
    if (const auto bundle = runtime::Bundle::open(bytes)) shade(*bundle);
    ::operator delete[](memory, std::align_val_t(64));
    return 0;
}
