// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_compression.h"

#include "baker/input/gltf_uri.h"

#include <draco/compression/decode.h>
#include <meshoptimizer.h>

#include <exception>
#include <utility>

namespace envbake::gltf {

namespace {

Error refuse(std::string message) {
    return {Errc::InvalidInput, std::move(message)};
}

/// glTF's number of a Draco type; 0 when glTF has none.
int component_type_of(draco::DataType type) {
    switch (type) {
        case draco::DT_INT8:
            return 5120;
        case draco::DT_UINT8:
            return 5121;
        case draco::DT_INT16:
            return 5122;
        case draco::DT_UINT16:
            return 5123;
        case draco::DT_UINT32:
            return 5125;
        case draco::DT_FLOAT32:
            return 5126;
        default:
            return 0;
    }
}

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

Expected<DracoMesh> decode_draco(std::span<const std::byte> encoded,
                                 const std::map<std::string, int>& ids) {
    try {
        draco::DecoderBuffer buffer;
        buffer.Init(reinterpret_cast<const char*>(encoded.data()), encoded.size());
        draco::Decoder decoder;
        auto status = decoder.DecodeMeshFromBuffer(&buffer);
        if (!status.ok())
            return refuse(
                concat("the Draco stream is damaged: ", shown(status.status().error_msg_string())));
        const std::unique_ptr<draco::Mesh> mesh = std::move(status).value();

        DracoMesh out;
        out.vertex_count = mesh->num_points();
        out.indices.reserve(std::size_t{3} * mesh->num_faces());
        for (std::uint32_t f = 0; f < mesh->num_faces(); ++f)
            for (const draco::PointIndex& corner : mesh->face(draco::FaceIndex(f)))
                out.indices.push_back(corner.value());

        for (const auto& [semantic, id] : ids) {
            const draco::PointAttribute* attribute =
                mesh->GetAttributeByUniqueId(static_cast<std::uint32_t>(id));
            if (!attribute)
                return refuse(
                    concat("the Draco stream has no attribute ", id, " for ", shown(semantic)));
            DracoAttribute& a = out.attributes[semantic];
            a.component_type = component_type_of(attribute->data_type());
            a.component_count = attribute->num_components();
            if (a.component_type == 0)
                return refuse(concat("the Draco attribute ", id, " has a type that glTF lacks"));
            const auto size =
                static_cast<std::size_t>(a.component_count) *
                static_cast<std::size_t>(draco::DataTypeLength(attribute->data_type()));
            a.bytes.resize(size * out.vertex_count);
            for (std::size_t v = 0; v < out.vertex_count; ++v) {
                const auto index =
                    attribute->mapped_index(draco::PointIndex(static_cast<std::uint32_t>(v)));
                if (index.value() >= attribute->size())
                    return refuse(
                        concat("the Draco attribute ", id, " lacks a value for vertex ", v));
                attribute->GetValue(index, a.bytes.data() + v * size);
            }
        }
        return out;
    } catch (const std::exception& e) {
        return refuse(concat("the Draco stream cannot be decoded: ", shown(e.what())));
    }
}

}  // namespace envbake::gltf
