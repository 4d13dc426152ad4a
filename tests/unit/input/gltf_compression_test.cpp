// SPDX-License-Identifier: Apache-2.0
// What the encoders of Draco and meshoptimizer make of a small mesh comes back; what is damaged
// ends in one line.
#include "baker/input/gltf_compression.h"

#include "baker/input/image_worker/protocol.h"

#include <draco/compression/expert_encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace envbake::gltf {
namespace {

using Bytes = std::vector<std::byte>;
using Vertex = std::array<float, 3>;

template <class T>
void put(Bytes& bytes, const T& value) {
    const auto from = std::as_bytes(std::span(&value, 1));
    bytes.insert(bytes.end(), from.begin(), from.end());
}

void expect_refused(const auto& result, const std::string& what) {
    ASSERT_FALSE(result) << what;
    EXPECT_EQ(result.error().code, Errc::InvalidInput) << what << result.error();
    EXPECT_EQ(result.error().message.find('\n'), std::string::npos) << result.error();
}

/// A sheet of 4 x 4 quads, bent; no two triangles share a place in the texture.
struct Soup {
    std::vector<std::array<Vertex, 3>> triangles;

    Soup() {
        constexpr int kEdge = 4;
        const auto at = [](int x, int y) {
            return Vertex{static_cast<float>(x), static_cast<float>(y),
                          0.125f * static_cast<float>(x * y)};
        };
        for (int y = 0; y < kEdge; ++y)
            for (int x = 0; x < kEdge; ++x) {
                triangles.push_back({at(x, y), at(x + 1, y), at(x, y + 1)});
                triangles.push_back({at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)});
            }
    }
};

struct Encoding {
    int method = draco::MESH_EDGEBREAKER_ENCODING;
    int speed = 5;
    bool textured = false;  ///< with quantised places in a texture; attribute 1
};

Bytes draco_stream(const Soup& soup, const Encoding& how) {
    using draco::GeometryAttribute;
    draco::TriangleSoupMeshBuilder builder;
    builder.Start(static_cast<int>(soup.triangles.size()));
    const int position = builder.AddAttribute(GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
    const int uv = how.textured
                       ? builder.AddAttribute(GeometryAttribute::TEX_COORD, 2, draco::DT_FLOAT32)
                       : -1;
    for (std::size_t f = 0; f < soup.triangles.size(); ++f) {
        const auto& [a, b, c] = soup.triangles[f];
        const draco::FaceIndex face(static_cast<std::uint32_t>(f));
        builder.SetAttributeValuesForFace(position, face, a.data(), b.data(), c.data());
        if (uv >= 0) builder.SetAttributeValuesForFace(uv, face, a.data(), b.data(), c.data());
    }
    const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
    draco::ExpertEncoder encoder(*mesh);
    encoder.SetEncodingMethod(how.method);
    encoder.SetSpeedOptions(how.speed, how.speed);
    if (uv >= 0) {
        encoder.SetAttributeQuantization(position, 8);
        encoder.SetAttributeQuantization(uv, 8);
    }
    draco::EncoderBuffer buffer;
    EXPECT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
    const auto bytes = std::as_bytes(std::span(buffer.data(), buffer.size()));
    return {bytes.begin(), bytes.end()};
}

// Positions are not quantised, so that the same triangles come back to the bit, in any order and
// from any of their corners.
TEST(Draco, TrianglesComeBack) {
    const Soup soup;
    const auto canonical = [](std::array<Vertex, 3> t) {
        std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
        return t;
    };
    std::multiset<std::array<Vertex, 3>> wanted;
    for (const auto& t : soup.triangles) wanted.insert(canonical(t));
    for (const int method : {draco::MESH_EDGEBREAKER_ENCODING, draco::MESH_SEQUENTIAL_ENCODING}) {
        const auto mesh = decode_draco(draco_stream(soup, {.method = method}), {{"POSITION", 0}});
        ASSERT_TRUE(mesh) << mesh.error();
        EXPECT_EQ(mesh->vertex_count, 25u);
        const DracoAttribute& position = mesh->attributes.at("POSITION");
        EXPECT_EQ(position.component_type, 5126);
        EXPECT_EQ(position.component_count, 3);
        ASSERT_EQ(position.bytes.size(), 25 * sizeof(Vertex));
        std::vector<Vertex> vertices(25);
        std::memcpy(vertices.data(), position.bytes.data(), position.bytes.size());
        std::multiset<std::array<Vertex, 3>> seen;
        for (std::size_t i = 0; i + 2 < mesh->indices.size(); i += 3)
            seen.insert(canonical({vertices.at(mesh->indices[i]), vertices.at(mesh->indices[i + 1]),
                                   vertices.at(mesh->indices[i + 2])}));
        EXPECT_EQ(seen, wanted);
    }
}

TEST(Draco, DamagedStreamsEndInOneLine) {
    const Bytes good = draco_stream(Soup(), {.speed = 7});
    ASSERT_TRUE(decode_draco(good, {{"POSITION", 0}}));
    expect_refused(decode_draco(good, {{"NORMAL", 1}}), "no such attribute");
    for (std::size_t size = 0; size < good.size(); ++size)
        if (const auto cut = decode_draco(std::span(good).first(size), {{"POSITION", 0}}); !cut)
            expect_refused(cut, concat(size, " bytes: "));
    expect_refused(decode_draco(std::span(good).first(good.size() / 2), {{"POSITION", 0}}),
                   "half: ");
    for (std::size_t at = 0; at < good.size(); ++at) {
        Bytes bad = good;
        bad[at] ^= std::byte{0xff};
        if (const auto mesh = decode_draco(bad, {{"POSITION", 0}}); !mesh)
            expect_refused(mesh, concat("byte ", at, ": "));
    }
}

// Draco 1.5 believes the count of orientations that its prediction of places in a texture begins
// with: up to 2^31 bits, and seconds to fill them.
TEST(Draco, ACountThatNothingBoundsEndsInOneLine) {
    const Bytes good = draco_stream(Soup(), {.speed = 0, .textured = true});
    const std::map<std::string, int> ids{{"POSITION", 0}, {"TEXCOORD_0", 1}};
    ASSERT_TRUE(decode_draco(good, ids));
    int refused = 0;
    for (std::size_t at = good.size() - 32; at + 4 <= good.size(); ++at) {
        Bytes bad = good;
        const std::int32_t count = 1 << 26;
        std::memcpy(bad.data() + at, &count, 4);
        const auto mesh = decode_draco(bad, ids);
        if (mesh) continue;
        ++refused;
        expect_refused(mesh, concat("byte ", at, ": "));
    }
    EXPECT_GT(refused, 0);
}

// 65 bytes that Draco 1.5 takes more than 14 GB for, if it gets them: the connectivity of a file of
// version 1.1 states its faces and its symbols in 32 bits each.
TEST(Draco, AClaimOfGigabytesEndsInOneLine) {
    Bytes stream;
    for (const char c : std::string_view("DRACO\1\1")) stream.push_back(static_cast<std::byte>(c));
    put(stream, std::array<std::uint8_t, 5>{1, 1, 0, 0, 0});    // mesh, edgebreaker, no flags
    put(stream, std::array<std::uint32_t, 3>{0, 0, 1u << 30});  // new vertices, vertices, faces
    put(stream, std::uint8_t{0});                               // attributes with their own seams
    put(stream, std::array<std::uint32_t, 2>{1u << 30, 0});     // symbols, split symbols
    stream.resize(65);
    expect_refused(decode_draco(stream, {{"POSITION", 0}}), "65 bytes");
    EXPECT_TRUE(decode_draco(draco_stream(Soup(), {}), {{"POSITION", 0}}));
}

/// What the worker leaves of two triangles: a position, and something that glTF has no type for.
Bytes worker_bytes(worker::DracoHeader header, const std::vector<worker::DracoAttribute>& described,
                   std::size_t values) {
    Bytes bytes;
    put(bytes, header);
    for (const worker::DracoAttribute& a : described) put(bytes, a);
    for (const std::uint32_t index : {0u, 1u, 2u, 2u, 1u, 3u}) put(bytes, index);
    for (std::size_t i = 0; i < values; ++i) put(bytes, static_cast<float>(i));
    return bytes;
}

TEST(Draco, WhatTheWorkerLeavesIsNotBelieved) {
    const worker::DracoHeader header{.vertex_count = 4, .attribute_count = 2, .index_count = 6};
    const worker::DracoAttribute position{.id = 7, .component_type = 5126, .component_count = 3};
    const worker::DracoAttribute other{.id = 9, .component_type = 0, .component_count = 3};
    const std::map<std::string, int> ids{{"POSITION", 7}};
    const Bytes good = worker_bytes(header, {position, other}, 12);
    const auto mesh = read_draco_mesh(good, ids);
    ASSERT_TRUE(mesh) << mesh.error();
    EXPECT_EQ(mesh->vertex_count, 4u);
    EXPECT_EQ(mesh->indices, (std::vector<std::uint32_t>{0, 1, 2, 2, 1, 3}));
    ASSERT_EQ(mesh->attributes.at("POSITION").bytes.size(), 48u);
    float last = 0;
    std::memcpy(&last, mesh->attributes.at("POSITION").bytes.data() + 44, 4);
    EXPECT_EQ(last, 11);

    expect_refused(read_draco_mesh(good, {{"POSITION", 7}, {"COLOR_0", 8}}), "no attribute 8");
    expect_refused(read_draco_mesh(good, {{"POSITION", 9}}), "a type that glTF lacks");
    for (std::size_t size = 0; size < good.size(); ++size) {
        const Bytes cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
        expect_refused(read_draco_mesh(cut, ids), concat(size, " bytes"));
    }
    Bytes longer = good;
    longer.push_back(std::byte{0});
    expect_refused(read_draco_mesh(longer, ids), "a byte more");

    constexpr std::uint32_t kMost = std::numeric_limits<std::uint32_t>::max();
    for (const std::uint32_t n :
         {0u, 1u, 3u, 5u, 1u << 28, 1u << 30, 1u << 31, kMost / 12, kMost}) {
        worker::DracoHeader h = header;
        h.vertex_count = n;
        expect_refused(read_draco_mesh(worker_bytes(h, {position, other}, 12), ids), "vertices");
        h = header;
        h.attribute_count = n;
        expect_refused(read_draco_mesh(worker_bytes(h, {position, other}, 12), ids), "attributes");
        for (const std::uint64_t high : {std::uint64_t{0}, std::uint64_t{n} << 32}) {
            h = header;
            h.index_count = n | high;
            expect_refused(read_draco_mesh(worker_bytes(h, {position, other}, 12), ids), "indices");
        }
        worker::DracoAttribute a = position;
        a.component_count = static_cast<std::int32_t>(n);
        if (n != 3)
            expect_refused(read_draco_mesh(worker_bytes(header, {a, other}, 12), ids),
                           "components");
        a = position;
        a.component_type = static_cast<std::int32_t>(n);
        expect_refused(read_draco_mesh(worker_bytes(header, {a, other}, 12), ids), "type");
    }
}

template <class T>
Bytes meshopt_vertices(const std::vector<T>& vertices) {
    std::vector<unsigned char> stream(meshopt_encodeVertexBufferBound(vertices.size(), sizeof(T)));
    stream.resize(meshopt_encodeVertexBuffer(stream.data(), stream.size(), vertices.data(),
                                             vertices.size(), sizeof(T)));
    const auto bytes = std::as_bytes(std::span(stream));
    return {bytes.begin(), bytes.end()};
}

TEST(Meshopt, WhatIsDamagedIsRefused) {
    std::vector<Vertex> vertices;
    std::vector<unsigned> indices;
    for (const auto& t : Soup().triangles)
        for (const Vertex& v : t) {
            indices.push_back(static_cast<unsigned>(vertices.size()));
            vertices.push_back(v);
        }
    std::vector<unsigned char> stream(
        meshopt_encodeIndexBufferBound(indices.size(), vertices.size()));
    stream.resize(
        meshopt_encodeIndexBuffer(stream.data(), stream.size(), indices.data(), indices.size()));
    const auto bytes = std::as_bytes(std::span(stream));
    const std::pair<MeshoptLayout, Bytes> cases[] = {
        {{.count = vertices.size(), .stride = 12, .mode = "ATTRIBUTES", .filter = "NONE"},
         meshopt_vertices(vertices)},
        {{.count = indices.size(), .stride = 4, .mode = "TRIANGLES", .filter = "NONE"},
         {bytes.begin(), bytes.end()}}};
    for (const auto& [layout, good] : cases) {
        const auto decoded = decode_meshopt(good, layout);
        ASSERT_TRUE(decoded) << decoded.error();
        if (layout.mode == "ATTRIBUTES") {
            EXPECT_EQ(std::memcmp(decoded->data(), vertices.data(), decoded->size()), 0);
        }
        for (std::size_t size = 0; size < good.size(); ++size) {
            // Exactly so many bytes: a sanitizer sees one too many.
            const Bytes cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
            expect_refused(decode_meshopt(cut, layout), concat(layout.mode, " ", size));
        }
        for (std::size_t at = 0; at < good.size(); ++at) {
            Bytes bad = good;
            bad[at] ^= std::byte{0xff};
            const auto other = decode_meshopt(bad, layout);
            EXPECT_TRUE(!other || other->size() == layout.count * layout.stride) << at;
        }
    }
}

}  // namespace
}  // namespace envbake::gltf
