// SPDX-License-Identifier: Apache-2.0
#include "baker/input/image_worker/codec.h"

#include <draco/compression/decode.h>

#include <memory>
#include <string>
#include <utility>

namespace envbake::worker {
namespace {

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

constexpr std::size_t kBlock = 1 << 16;  ///< bytes written at once, or a little more

DracoAttribute describe(const draco::PointAttribute& attribute) {
    DracoAttribute described;
    described.id = attribute.unique_id();
    described.component_count = attribute.num_components();
    if (described.component_count <= kMaxDracoComponents)
        described.component_type = component_type_of(attribute.data_type());
    const std::size_t size = bytes_of(described);
    if (size != 0 && static_cast<std::size_t>(attribute.byte_stride()) != size)
        throw Refusal("its attribute " + std::to_string(described.id) + " is not tightly packed");
    return described;
}

void write_values(const draco::PointAttribute& attribute, std::size_t vertex_count,
                  const WriteBytes& write) {
    const auto size = static_cast<std::size_t>(attribute.byte_stride());
    std::vector<std::byte> block;
    for (std::size_t v = 0; v < vertex_count; ++v) {
        const draco::AttributeValueIndex index =
            attribute.mapped_index(draco::PointIndex(static_cast<std::uint32_t>(v)));
        if (index.value() >= attribute.size())
            throw Refusal("its attribute " + std::to_string(attribute.unique_id()) +
                          " lacks a value for vertex " + std::to_string(v));
        block.resize(block.size() + size);
        attribute.GetValue(index, block.data() + block.size() - size);
        if (block.size() < kBlock) continue;
        write(block);
        block.clear();
    }
    write(block);
}

}  // namespace

void decode_draco(Bytes file, const WriteBytes& write) {
    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(file.data()), file.size());
    draco::Decoder decoder;
    auto status = decoder.DecodeMeshFromBuffer(&buffer);
    if (!status.ok()) throw Refusal(status.status().error_msg_string());
    const std::unique_ptr<draco::Mesh> mesh = std::move(status).value();

    const DracoHeader header{.vertex_count = mesh->num_points(),
                             .attribute_count = static_cast<std::uint32_t>(mesh->num_attributes()),
                             .index_count = std::uint64_t{3} * mesh->num_faces()};
    std::vector<DracoAttribute> attributes;
    std::uint64_t bytes = sizeof header + header.index_count * sizeof(std::uint32_t);
    for (int i = 0; i < mesh->num_attributes(); ++i) {
        attributes.push_back(describe(*mesh->attribute(i)));
        bytes += sizeof(DracoAttribute) + header.vertex_count * bytes_of(attributes.back());
    }
    if (bytes > most_draco_bytes(file.size()))
        throw Refusal("it decodes to " + std::to_string(bytes) + " bytes, of " +
                      std::to_string(file.size()));
    write(std::as_bytes(std::span(&header, 1)));
    write(std::as_bytes(std::span(attributes)));

    std::vector<std::uint32_t> block;
    for (std::uint32_t f = 0; f < mesh->num_faces(); ++f) {
        for (const draco::PointIndex& corner : mesh->face(draco::FaceIndex(f)))
            block.push_back(corner.value());
        if (block.size() * sizeof(std::uint32_t) < kBlock) continue;
        write(std::as_bytes(std::span(block)));
        block.clear();
    }
    write(std::as_bytes(std::span(block)));
    for (int i = 0; i < mesh->num_attributes(); ++i)
        if (bytes_of(attributes[static_cast<std::size_t>(i)]) != 0)
            write_values(*mesh->attribute(i), header.vertex_count, write);
}

}  // namespace envbake::worker
