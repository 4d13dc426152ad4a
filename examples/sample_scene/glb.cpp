// SPDX-License-Identifier: Apache-2.0
#include "scene.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstddef>
#include <numbers>
#include <utility>

namespace envbake::sample {
namespace {

// glTF 2.0, sections 3.6 (accessors), 4.4 (GLB chunks).
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;
constexpr int kFloat = 5126, kUnsignedInt = 5125;
constexpr std::uint32_t kMagic = 0x46546C67, kJsonChunk = 0x4E4F534A, kBinChunk = 0x004E4942;

void append_u32(std::string& out, std::uint32_t v) {
    for (int shift = 0; shift < 32; shift += 8) out.push_back(static_cast<char>(v >> shift & 0xff));
}

void append_vectors(std::string& out, const std::vector<std::array<float, 3>>& vectors) {
    for (const auto& v : vectors)
        for (const float c : v) append_u32(out, std::bit_cast<std::uint32_t>(c));
}

/// The shortest digits that read back as the same number.
template <class Number>
std::string text(Number v) {
    char buffer[32];
    const auto end = std::to_chars(buffer, buffer + sizeof(buffer), v).ptr;
    return std::string(buffer, end);
}

template <class Vector>
std::string list(const Vector& values) {
    std::string out = "[";
    for (const auto v : values) {
        if (out.size() > 1) out += ',';
        out += text(v);
    }
    out += ']';
    return out;
}

/// The elements of one JSON array, told apart by commas.
class Elements {
  public:
    int add(const std::string& element) {
        body_ += count_ > 0 ? ",\n" : "\n";
        body_ += element;
        return count_++;
    }
    std::string str() const { return "[" + body_ + "]"; }

  private:
    std::string body_;
    int count_ = 0;
};

/// The buffer and the views and accessors into it.
struct Buffer {
    std::string bytes;
    Elements views, accessors;

    int add(const std::string& data, int target, int component_type, std::size_t count,
            const std::string& type_and_bounds) {
        const int view =
            views.add("{\"buffer\":0,\"byteOffset\":" + text(bytes.size()) +
                      ",\"byteLength\":" + text(data.size()) + ",\"target\":" + text(target) + "}");
        bytes += data;  // every element is a multiple of 4 bytes long: alignment keeps itself
        return accessors.add("{\"bufferView\":" + text(view) +
                             ",\"componentType\":" + text(component_type) +
                             ",\"count\":" + text(count) + ",\"type\":" + type_and_bounds + "}");
    }
};

std::string primitive(const NamedMesh& named, Buffer& buffer) {
    const Mesh& mesh = named.mesh;
    std::array<float, 3> low = mesh.positions.front(), high = low;
    for (const auto& p : mesh.positions) {
        for (std::size_t c = 0; c < 3; ++c) {
            low[c] = std::min(low[c], p[c]);
            high[c] = std::max(high[c], p[c]);
        }
    }
    std::string positions, normals, indices;
    append_vectors(positions, mesh.positions);
    append_vectors(normals, mesh.normals);
    for (const std::uint32_t i : mesh.triangles) append_u32(indices, i);
    const int position = buffer.add(positions, kArrayBuffer, kFloat, mesh.positions.size(),
                                    "\"VEC3\",\"min\":" + list(low) + ",\"max\":" + list(high));
    const int normal = buffer.add(normals, kArrayBuffer, kFloat, mesh.normals.size(), "\"VEC3\"");
    const int index =
        buffer.add(indices, kElementArrayBuffer, kUnsignedInt, mesh.triangles.size(), "\"SCALAR\"");
    return "{\"attributes\":{\"POSITION\":" + text(position) + ",\"NORMAL\":" + text(normal) +
           "},\"indices\":" + text(index) + ",\"material\":" + text(named.material) + "}";
}

void append_chunk(std::string& out, std::uint32_t type, std::string data, char padding) {
    data.resize((data.size() + 3) / 4 * 4, padding);
    append_u32(out, static_cast<std::uint32_t>(data.size()));
    append_u32(out, type);
    out += data;
}

}  // namespace

std::string encode_glb(const Scene& scene) {
    Elements materials, meshes, nodes;
    for (const Material& m : scene.materials) {
        const std::array<double, 4> color{m.base_color.x, m.base_color.y, m.base_color.z, 1};
        materials.add("{\"name\":\"" + m.name +
                      "\",\"pbrMetallicRoughness\":{\"baseColorFactor\":" + list(color) +
                      ",\"metallicFactor\":" + text(m.metallic) +
                      ",\"roughnessFactor\":" + text(m.perceptual_roughness) + "}}");
    }
    Buffer buffer;
    for (const NamedMesh& m : scene.meshes) {
        meshes.add("{\"name\":\"" + m.name + "\",\"primitives\":[" + primitive(m, buffer) + "]}");
    }
    std::vector<int> roots;
    for (const Node& n : scene.nodes) {
        const double half_yaw = n.yaw_deg * std::numbers::pi / 360;
        const std::array<double, 4> rotation{0, std::sin(half_yaw), 0, std::cos(half_yaw)};
        const std::array<double, 3> translation{n.translation.x, n.translation.y, n.translation.z};
        roots.push_back(nodes.add("{\"name\":\"" + n.name + "\",\"mesh\":" + text(n.mesh) +
                                  ",\"rotation\":" + list(rotation) +
                                  ",\"translation\":" + list(translation) + "}"));
    }
    std::string json =
        "{\"asset\":{\"version\":\"2.0\",\"generator\":\"envbake-sample\"},\n\"scene\":0,"
        "\n\"scenes\":[{\"name\":\"terrace\",\"nodes\":" +
        list(roots) + "}],\n\"nodes\":" + nodes.str() + ",\n\"meshes\":" + meshes.str() +
        ",\n\"materials\":" + materials.str() + ",\n\"accessors\":" + buffer.accessors.str() +
        ",\n\"bufferViews\":" + buffer.views.str() +
        ",\n\"buffers\":[{\"byteLength\":" + text(buffer.bytes.size()) + "}]}\n";

    std::string chunks;
    append_chunk(chunks, kJsonChunk, std::move(json), ' ');
    append_chunk(chunks, kBinChunk, std::move(buffer.bytes), '\0');
    std::string out;
    append_u32(out, kMagic);
    append_u32(out, 2);
    append_u32(out, static_cast<std::uint32_t>(12 + chunks.size()));
    return out + chunks;
}

}  // namespace envbake::sample
