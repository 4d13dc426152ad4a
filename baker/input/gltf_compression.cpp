// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_compression.h"

#include "baker/input/gltf_uri.h"
#include "baker/input/image_worker.h"
#include "baker/input/image_worker/protocol.h"

#include <meshoptimizer.h>

#include <cstring>
#include <utility>

namespace envbake::gltf {

namespace {

Error refuse(std::string message) {
    return {Errc::InvalidInput, std::move(message)};
}

/// Copies one value after another out of bytes.
class Cursor {
  public:
    explicit Cursor(std::span<const std::byte> bytes) : left_(bytes) {}

    std::uint64_t left() const { return left_.size(); }
    /// The next bytes; there are so many.
    std::span<const std::byte> take(std::uint64_t size) {
        const auto taken = left_.first(size);
        left_ = left_.subspan(size);
        return taken;
    }
    template <class T>
    T take() {
        T value;
        std::memcpy(&value, take(sizeof value).data(), sizeof value);
        return value;
    }

  private:
    std::span<const std::byte> left_;
};

}  // namespace

Expected<std::vector<std::byte>> decode_meshopt(std::span<const std::byte> encoded,
                                                const MeshoptLayout& layout) {
    // The densest stream: the vertex codec spends one control byte on 64 bytes that do not change,
    // the index codec one on a triangle of 12 bytes. More is a claim, not data.
    const std::size_t decoded_bytes = layout.count * layout.stride;
    if (decoded_bytes / 64 > encoded.size() + 64)
        return refuse(concat(encoded.size(), " bytes cannot decode to ", decoded_bytes));
    std::vector<std::byte> decoded(decoded_bytes);
    const auto* source = reinterpret_cast<const unsigned char*>(encoded.data());
    const int status = layout.mode == "ATTRIBUTES"
                           ? meshopt_decodeVertexBuffer(decoded.data(), layout.count, layout.stride,
                                                        source, encoded.size())
                       : layout.mode == "TRIANGLES"
                           ? meshopt_decodeIndexBuffer(decoded.data(), layout.count, layout.stride,
                                                       source, encoded.size())
                           : meshopt_decodeIndexSequence(decoded.data(), layout.count,
                                                         layout.stride, source, encoded.size());
    if (status != 0) return refuse(concat("the meshopt stream is damaged (code ", status, ")"));

    if (layout.filter == "OCTAHEDRAL")
        meshopt_decodeFilterOct(decoded.data(), layout.count, layout.stride);
    if (layout.filter == "QUATERNION")
        meshopt_decodeFilterQuat(decoded.data(), layout.count, layout.stride);
    if (layout.filter == "EXPONENTIAL")
        meshopt_decodeFilterExp(decoded.data(), layout.count, layout.stride);
    return decoded;
}

Expected<DracoMesh> read_draco_mesh(std::span<const std::byte> decoded,
                                    const std::map<std::string, int>& ids) {
    const Error nonsense = refuse("the decoder of the Draco stream answers nonsense");
    Cursor rest(decoded);
    if (rest.left() < sizeof(worker::DracoHeader)) return nonsense;
    const auto header = rest.take<worker::DracoHeader>();
    if (header.attribute_count > rest.left() / sizeof(worker::DracoAttribute)) return nonsense;
    std::vector<worker::DracoAttribute> described(header.attribute_count);
    for (worker::DracoAttribute& a : described) a = rest.take<worker::DracoAttribute>();

    if (header.index_count > rest.left() / sizeof(std::uint32_t)) return nonsense;
    DracoMesh out;
    out.vertex_count = header.vertex_count;
    out.indices.resize(header.index_count);
    if (!out.indices.empty())
        std::memcpy(out.indices.data(), rest.take(4 * header.index_count).data(),
                    4 * header.index_count);

    // The first of an id is the one that is meant, as in Draco itself.
    std::map<std::uint32_t, std::pair<worker::DracoAttribute, std::span<const std::byte>>> values;
    for (const worker::DracoAttribute& a : described) {
        const std::uint64_t size = std::uint64_t{header.vertex_count} * worker::bytes_of(a);
        if (size > rest.left()) return nonsense;
        values.try_emplace(a.id, a, rest.take(size));
    }
    if (rest.left() != 0) return nonsense;

    for (const auto& [semantic, id] : ids) {
        const auto found = values.find(static_cast<std::uint32_t>(id));
        if (found == values.end())
            return refuse(
                concat("the Draco stream has no attribute ", id, " for ", shown(semantic)));
        const auto& [a, bytes] = found->second;
        if (worker::bytes_of(a) == 0)
            return refuse(concat("the Draco attribute ", id, " has a type that glTF lacks"));
        out.attributes[semantic] = {
            a.component_type, a.component_count, {bytes.begin(), bytes.end()}};
    }
    return out;
}

Expected<DracoMesh> decode_draco(std::span<const std::byte> encoded,
                                 const std::map<std::string, int>& ids) {
    ENVBAKE_TRY(const SharedPixels decoded, decode_draco_stream(encoded));
    return read_draco_mesh(decoded.bytes(), ids);
}

}  // namespace envbake::gltf
