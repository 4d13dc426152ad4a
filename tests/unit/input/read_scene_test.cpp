// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_scene.h"

#include "tests/unit/input/gltf_text.h"

#include <cmath>
#include <limits>
#include <numbers>

namespace envbake {
namespace {

using nlohmann::json;
using test::GltfText;
using test::kByte, test::kFloat, test::kShort, test::kUByte, test::kUInt, test::kUShort;
using test::TempFolder;

Expected<Scene> read(const std::string& content, const ReadSceneOptions& options = {}) {
    const TempFolder folder;
    const bool glb = content.substr(0, 4) == "glTF";
    return read_scene(folder.write(glb ? "scene.glb" : "scene.gltf", content), options);
}

std::string refusal(const std::string& content) {
    const auto scene = read(content);
    if (scene) return "was read";
    EXPECT_EQ(scene.error().code, Errc::InvalidInput) << scene.error();
    EXPECT_EQ(scene.error().message.find('\n'), std::string::npos);
    return scene.error().message;
}

bool contains(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

bool has_note(const Scene& scene, const std::string& part) {
    for (const std::string& note : scene.notes)
        if (contains(note, part)) return true;
    return false;
}

void expect_near(const Vec3& seen, const Vec3& wanted, float tolerance = 1e-6f) {
    EXPECT_NEAR(seen.x, wanted.x, tolerance);
    EXPECT_NEAR(seen.y, wanted.y, tolerance);
    EXPECT_NEAR(seen.z, wanted.z, tolerance);
}

Vec3 face_normal(const Mesh& mesh, std::size_t triangle) {
    const auto p = [&](std::size_t k) { return mesh.positions[mesh.triangles[3 * triangle + k]]; };
    return glm::normalize(glm::cross(p(1) - p(0), p(2) - p(0)));
}

const std::vector<float> kTriangle{0, 0, 0, 1, 0, 0, 0, 1, 0};  // faces +Z
const std::vector<float> kTowardsZ{0, 0, 1, 0, 0, 1, 0, 0, 1};

/// One triangle facing +Z, with normals, under one node.
GltfText one_triangle(json node = json::object()) {
    GltfText g;
    node["mesh"] =
        g.mesh({{"attributes", {{"POSITION", g.vec3(kTriangle)}, {"NORMAL", g.vec3(kTowardsZ)}}}});
    g.push("nodes", node);
    return g;
}

TEST(ReadScene, PlainTriangle) {
    const auto scene = read(one_triangle({{"name", "here"}}).text());
    ASSERT_TRUE(scene) << scene.error();
    ASSERT_EQ(scene->meshes.size(), 1u);
    const Mesh& mesh = scene->meshes[0];
    EXPECT_EQ(mesh.triangles, (std::vector<std::uint32_t>{0, 1, 2}));
    EXPECT_EQ(mesh.node_name, "here");
    EXPECT_FALSE(mesh.normals_computed);
    ASSERT_EQ(scene->materials.size(), 1u) << "the default material";
    EXPECT_EQ(scene->materials[0].metallic, 1.0f);
    EXPECT_EQ(scene->materials[0].dielectric_r0, Vec3(0.04f));
    EXPECT_EQ(scene->file_name, "scene.gltf");
    EXPECT_TRUE(scene->notes.empty());
}

TEST(ReadScene, MirroredNodeKeepsTheOutsideOutside) {
    for (const json& scale : {json{-1, 1, 1}, json{1, -2, 1}, json{-1, -1, -3}, json{-1, -1, 2}}) {
        const auto scene =
            read(one_triangle({{"scale", scale}, {"translation", {5, 6, 7}}}).text());
        ASSERT_TRUE(scene) << scene.error();
        const Mesh& mesh = scene->meshes[0];
        const float side = scale[2].get<float>() < 0 ? -1.0f : 1.0f;  // the outside was +Z
        expect_near(face_normal(mesh, 0), {0, 0, side});
        expect_near(mesh.normals[0], {0, 0, side});
        expect_near(mesh.positions[1], {5 + scale[0].get<float>(), 6, 7});
    }
}

TEST(ReadScene, NormalsUnderNonUniformScale) {
    GltfText g = one_triangle({{"scale", {2, 1, 4}}});
    g.document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] =
        g.vec3({1, 1, 0, 0, 3, 4, 0, 0, 2});
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    // The plane x + y = c becomes x/2 + y = c; 3y + 4z becomes 3y + z.
    expect_near(scene->meshes[0].normals[0], glm::normalize(Vec3(0.5f, 1, 0)));
    expect_near(scene->meshes[0].normals[1], glm::normalize(Vec3(0, 3, 1)));
    expect_near(scene->meshes[0].normals[2], {0, 0, 1});
}

TEST(ReadScene, FlatteningNodeStillHasNormals) {
    const auto scene = read(one_triangle({{"scale", {1, 1, 0}}}).text());
    ASSERT_TRUE(scene) << scene.error();
    expect_near(scene->meshes[0].normals[0], {0, 0, 1});

    // Flattened edge-on: neither the normal nor the triangle is left.
    const auto edge = read(one_triangle({{"scale", {1, 0, 1}}}).text());
    ASSERT_TRUE(edge) << edge.error();
    EXPECT_EQ(edge->meshes[0].normals[0], Vec3(0));
    EXPECT_TRUE(has_note(*edge, "1 of 1 triangles have no area"));
}

TEST(ReadScene, HierarchyAndFileOrder) {
    GltfText g = one_triangle();
    const float s = std::numbers::sqrt2_v<float> / 2;
    g.document["nodes"] =
        json::parse(R"([{"children": [3, 1], "mesh": 0}, {"mesh": 0, "scale": [2, 2, 2]},
        {"mesh": 0, "name": "unused"}, {"mesh": 0, "translation": [1, 0, 0]}])");
    g.document["nodes"][0]["rotation"] = {0, s, 0, s};  // 90 degrees about +Y: x -> -z
    g.document["nodes"][0]["translation"] = {10, 0, 0};
    g.document["scenes"] = json::parse(R"([{"nodes": [2]}, {"nodes": [0]}])");
    g.document["scene"] = 1;
    auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    ASSERT_EQ(scene->meshes.size(), 3u);
    EXPECT_EQ(scene->meshes[0].node, 0);
    EXPECT_EQ(scene->meshes[1].node, 3);
    EXPECT_EQ(scene->meshes[2].node, 1);
    expect_near(scene->meshes[0].positions[1], {10, 0, -1});
    expect_near(scene->meshes[1].positions[1], {10, 0, -2});
    expect_near(scene->meshes[2].positions[1], {10, 0, -2});
    expect_near(scene->meshes[1].normals[0], {1, 0, 0});

    g.document.erase("scene");  // then the first scene
    scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].node_name, "unused");
    g.document.erase("scenes");  // then every root
    scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes.size(), 4u);
}

TEST(ReadScene, MatrixIsColumnMajor) {
    const auto scene =
        read(one_triangle({{"matrix", {0, 2, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1}}}).text());
    ASSERT_TRUE(scene) << scene.error();
    expect_near(scene->meshes[0].positions[1], {7, 10, 9});
    expect_near(scene->meshes[0].positions[2], {6, 8, 9});
    EXPECT_TRUE(contains(
        refusal(
            one_triangle({{"matrix", {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}}).text()),
        "nodes[0].matrix: is not affine"));
}

TEST(ReadScene, AHundredThousandNestedNodes) {
    GltfText g = one_triangle();
    json nodes = json::array();
    constexpr int kDepth = 100000;
    for (int i = 0; i < kDepth; ++i) nodes.push_back({{"children", {i + 1}}});
    nodes.push_back({{"mesh", 0}});
    g.document["nodes"] = nodes;
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].node, kDepth);
}

TEST(ReadScene, StripsFansPointsAndLines) {
    const auto with_mode = [](int mode) {
        GltfText g = one_triangle();
        g.mesh(
            {{"attributes", {{"POSITION", g.vec3({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0})}}},
             {"mode", mode}});
        g.push("nodes", {{"mesh", 1}});
        return read(g.text());
    };
    const std::vector<std::vector<std::uint32_t>> wanted{
        {}, {}, {}, {}, {0, 1, 2}, {0, 1, 2, 1, 3, 2, 2, 3, 4}, {1, 2, 0, 2, 3, 0, 3, 4, 0}};
    for (int mode = 0; mode < 7; ++mode) {
        const auto scene = with_mode(mode);
        ASSERT_TRUE(scene) << scene.error();
        EXPECT_EQ(scene->meshes[1].triangles, wanted[static_cast<std::size_t>(mode)])
            << "mode " << mode;
        EXPECT_EQ(scene->meshes[1].vertex_count(), 5u);
        EXPECT_EQ(has_note(*scene, "2 indices at the end"), mode == 4);
    }
    EXPECT_FALSE(with_mode(7));
}

TEST(ReadScene, IndexTypesAgree) {
    const auto triangles = [](auto values, int type) {
        GltfText g = one_triangle();
        g.document["meshes"][0]["primitives"][0]["indices"] =
            g.accessor("SCALAR", type, values, values.size());
        const auto scene = read(g.text());
        EXPECT_TRUE(scene) << scene.error();
        return scene ? scene->meshes[0].triangles : std::vector<std::uint32_t>();
    };
    const std::vector<std::uint32_t> wanted{2, 0, 1};
    EXPECT_EQ(triangles(std::vector<std::uint8_t>{2, 0, 1}, kUByte), wanted);
    EXPECT_EQ(triangles(std::vector<std::uint16_t>{2, 0, 1}, kUShort), wanted);
    EXPECT_EQ(triangles(std::vector<std::uint32_t>{2, 0, 1}, kUInt), wanted);
}

TEST(ReadScene, BadIndicesAreNamed) {
    const auto with = [](auto values, int type) {
        GltfText g = one_triangle();
        g.document["meshes"][0]["primitives"][0]["indices"] =
            g.accessor("SCALAR", type, values, values.size());
        return refusal(g.text());
    };
    EXPECT_TRUE(
        contains(with(std::vector<std::uint16_t>{0, 1, 3}, kUShort),
                 "meshes[0].primitives[0].indices: index 2 is 3, the primitive has 3 vertices"));
    EXPECT_TRUE(contains(with(std::vector<std::uint8_t>{0, 255, 1}, kUByte),
                         "index 1 is 255, the primitive restart"));
    EXPECT_TRUE(contains(with(std::vector<std::uint32_t>{0xffffffff, 1, 2}, kUInt), "restart"));
}

TEST(ReadScene, SparseWithAndWithoutBase) {
    for (const bool base : {true, false}) {
        GltfText g = one_triangle();
        const std::vector<std::uint8_t> at{1, 2};
        const std::vector<float> values{9, 8, 7, 0, 6, 5};
        json& accessor = g.document["accessors"][0];
        accessor["sparse"] = {
            {"count", 2},
            {"indices", {{"bufferView", g.view(at.data(), 2)}, {"componentType", kUByte}}},
            {"values", {{"bufferView", g.view(values.data(), 24)}}}};
        if (!base) accessor.erase("bufferView");
        auto scene = read(g.text());
        ASSERT_TRUE(scene) << scene.error();
        EXPECT_EQ(scene->meshes[0].positions[0], Vec3(0));
        EXPECT_EQ(scene->meshes[0].positions[1], Vec3(9, 8, 7));
        EXPECT_EQ(scene->meshes[0].positions[2], Vec3(0, 6, 5));
        for (const std::vector<std::uint8_t>& bad : {std::vector<std::uint8_t>{2, 1}, {1, 3}}) {
            accessor["sparse"]["indices"]["bufferView"] = g.view(bad.data(), 2);
            EXPECT_TRUE(contains(refusal(g.text()), "accessors[0]: sparse.indices[1] is"));
        }
    }
}

TEST(ReadScene, InterleavedAndOffset) {
    GltfText g = one_triangle();
    // 4 bytes of nothing, then position and normal a vertex, 28 bytes apart.
    std::vector<float> rows{-1};
    for (int v = 0; v < 3; ++v)
        for (const float x :
             {kTriangle[static_cast<std::size_t>(3 * v)],
              kTriangle[static_cast<std::size_t>(3 * v + 1)], 5.0f, 0.0f, 3.0f, 0.0f, -1.0f})
            rows.push_back(x);
    rows.pop_back();  // the last row may end with its last element
    const int view = g.view(rows.data(), rows.size() * sizeof(float), 28);
    for (const int a : {0, 1}) {
        g.document["accessors"][static_cast<std::size_t>(a)]["bufferView"] = view;
        g.document["accessors"][static_cast<std::size_t>(a)]["byteOffset"] = 4 + 12 * a;
    }
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].positions[2], Vec3(0, 1, 5));
    EXPECT_EQ(scene->meshes[0].normals[2], Vec3(0, 1, 0));
    g.document["accessors"][1]["byteOffset"] = 20;
    EXPECT_TRUE(contains(refusal(g.text()), "accessors[1]: 3 elements end at byte"));
}

TEST(ReadScene, QuantizedAttributes) {
    GltfText g = one_triangle();
    g.document["extensionsUsed"] = {"KHR_mesh_quantization"};
    json& attributes = g.document["meshes"][0]["primitives"][0]["attributes"];
    const std::vector<std::int16_t> p{0, 0, 0,      0,      32767, 0,
                                      0, 0, -32768, -16384, 0,     0};  // rows of 8 bytes
    const int view = g.view(p.data(), 24, 8);
    attributes["POSITION"] = g.push("accessors", {{"bufferView", view},
                                                  {"type", "VEC3"},
                                                  {"componentType", kShort},
                                                  {"count", 3},
                                                  {"normalized", true}});
    const std::vector<std::int8_t> n{0, 0, 127, 0, 0, 0, -128, 0, 127, 0, 0, 0};
    const int normals = g.view(n.data(), 12, 4);
    attributes["NORMAL"] = g.push("accessors", {{"bufferView", normals},
                                                {"type", "VEC3"},
                                                {"componentType", kByte},
                                                {"count", 3},
                                                {"normalized", true}});
    attributes["TEXCOORD_0"] =
        g.accessor("VEC2", kUShort, std::vector<std::uint16_t>{0, 3, 4096, 65535, 1, 2}, 3);
    attributes["TEXCOORD_1"] =
        g.accessor("VEC2", kUByte, std::vector<std::uint8_t>{0, 51, 255, 1, 2, 3}, 3, true);
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    const Mesh& mesh = scene->meshes[0];
    EXPECT_EQ(mesh.positions[1], Vec3(1, 0, 0));
    EXPECT_EQ(mesh.positions[2], Vec3(-1, -16384.0f / 32767.0f, 0));  // max(c / 32767, -1)
    EXPECT_EQ(mesh.normals[1], Vec3(0, 0, -1));
    EXPECT_EQ(mesh.uv0[1], Vec2(4096, 65535));
    EXPECT_EQ(mesh.uv1[0], Vec2(0, 0.2f));

    g.document.erase("extensionsUsed");  // then it is not glTF
    EXPECT_TRUE(contains(refusal(g.text()), "is VEC3 of component type 51"));
}

TEST(ReadScene, VertexColors) {
    GltfText g = one_triangle();
    json& attributes = g.document["meshes"][0]["primitives"][0]["attributes"];
    attributes["COLOR_0"] = g.accessor(
        "VEC4", kUByte, std::vector<std::uint8_t>{0, 51, 102, 255, 0, 0, 0, 0, 255, 255, 255, 51},
        3, true);
    auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].colors[0], Vec4(0, 0.2f, 0.4f, 1));
    EXPECT_EQ(scene->meshes[0].colors[2], Vec4(1, 1, 1, 0.2f));

    attributes["COLOR_0"] = g.vec3({0.25f, 2, 0, 1, 1, -1, std::nanf(""), 0, 0});
    scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].colors[0], Vec4(0.25f, 1, 0, 1));
    EXPECT_EQ(scene->meshes[0].colors[1], Vec4(1, 1, 0, 1));
    EXPECT_EQ(scene->meshes[0].colors[2], Vec4(0, 0, 0, 1));
    EXPECT_TRUE(has_note(*scene, "3 vertex colour components"));
}

// At the origin meet a triangle in z = 0 (angle 90 degrees, area 1/2) and one in y = 0 (angle 45
// degrees, area 8, facing -Y).
TEST(ReadScene, MissingNormalsAreWeightedAsAsked) {
    GltfText g;
    const int positions = g.vec3({0, 0, 0, 1, 0, 0, 0, 1, 0, 4, 0, 0, 4, 0, 4, 9, 9, 9});
    g.mesh({{"attributes", {{"POSITION", positions}}}, {"indices", g.indices({0, 1, 2, 0, 3, 4})}});
    g.push("nodes", {{"mesh", 0}});
    const float pi = std::numbers::pi_v<float>;
    auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_TRUE(scene->meshes[0].normals_computed);
    EXPECT_TRUE(has_note(*scene, "1 meshes have no normals"));
    expect_near(scene->meshes[0].normals[0], glm::normalize(Vec3(0, -pi / 4, pi / 2)));
    expect_near(scene->meshes[0].normals[1], {0, 0, 1});
    EXPECT_EQ(scene->meshes[0].normals[5], Vec3(0)) << "no triangle tells";
    scene = read(g.text(), {.computed_normals = NormalWeighting::Area});
    ASSERT_TRUE(scene) << scene.error();
    expect_near(scene->meshes[0].normals[0], glm::normalize(Vec3(0, -8, 0.5f)));
}

TEST(ReadScene, BadNormalsAreComputed) {
    GltfText g = one_triangle();
    g.document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] =
        g.vec3({0, 0, 0, std::nanf(""), 0, 1, 0, 1e-30f, 0});
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].normals[0], Vec3(0, 0, 1));
    EXPECT_EQ(scene->meshes[0].normals[1], Vec3(0, 0, 1));
    EXPECT_EQ(scene->meshes[0].normals[2], Vec3(0, 1, 0)) << "short, but it points somewhere";
    EXPECT_TRUE(has_note(*scene, "2 normals are zero or not finite"));
}

TEST(ReadScene, PositionsMustBeFinite) {
    for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
        GltfText g = one_triangle();
        g.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] =
            g.vec3({0, 0, 0, 1, 0, 0, 0, bad, 0});
        EXPECT_TRUE(contains(refusal(g.text()),
                             "meshes[0].primitives[0].attributes.POSITION: vertex 2 is (0, "));
    }
    EXPECT_TRUE(contains(refusal(one_triangle({{"scale", {1e300, 1, 1}}}).text()),
                         "nodes[0], meshes[0].primitives[0]: the transform puts vertex 1"));
}

TEST(ReadScene, MorphTargetsAtTheirDefaultWeights) {
    GltfText g = one_triangle();
    json& primitive = g.document["meshes"][0]["primitives"][0];
    primitive["targets"] = {{{"POSITION", g.vec3({0, 0, 2, 0, 0, 2, 0, 0, 2})}},
                            {{"POSITION", g.vec3({8, 0, 0, 8, 0, 0, 8, 0, 0})}}};
    auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].positions[0], Vec3(0, 0, 0));
    g.document["meshes"][0]["weights"] = {0.5, 0};
    scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].positions[0], Vec3(0, 0, 1));
    g.document["nodes"][0]["weights"] = {0.5, 0.25};
    scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->meshes[0].positions[0], Vec3(2, 0, 1));
}

// Joint 1 is moved by (0, 4, 0) and bound at (1, 0, 0): it maps x to x - (1, 0, 0) + (0, 4, 0).
TEST(ReadScene, SkinsTakeThePoseOfTheNodes) {
    GltfText g = one_triangle({{"skin", 0}, {"translation", {100, 100, 100}}});
    json& attributes = g.document["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = g.accessor(
        "VEC4", kUByte, std::vector<std::uint8_t>{0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 9, 9}, 3);
    attributes["WEIGHTS_0"] =
        g.accessor("VEC4", kFloat, std::vector<float>{1, 0, 0, 0, 0, 1, 0, 0, 2, 2, 0, 0}, 3);
    const std::vector<float> bind{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0,  0, 0, 1,
                                  1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -1, 0, 0, 1};
    g.push("nodes", {{"children", {2}}});
    g.push("nodes", {{"translation", {0, 4, 0}}});
    g.push("skins",
           {{"joints", {1, 2}}, {"inverseBindMatrices", g.accessor("MAT4", kFloat, bind, 2)}});
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    expect_near(scene->meshes[0].positions[0], {0, 0, 0});
    expect_near(scene->meshes[0].positions[1], {0, 4, 0});
    expect_near(scene->meshes[0].positions[2], {-0.5f, 3, 0});  // half of each
    expect_near(scene->meshes[0].normals[2], {0, 0, 1});
    EXPECT_TRUE(has_note(*scene, "1 nodes are skinned"));

    attributes["JOINTS_0"] = g.accessor(
        "VEC4", kUByte, std::vector<std::uint8_t>{0, 1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0}, 3);
    EXPECT_TRUE(contains(refusal(g.text()), "vertex 1 refers to joint 2, skins[0] has 2"));
}

Expected<Scene> read_with_material(const json& material, const char* extension) {
    GltfText g = one_triangle();
    g.document["materials"] = json::array({material});
    g.document["extensionsUsed"] = json::array({extension});
    g.document["meshes"][0]["primitives"][0]["material"] = 0;
    return read(g.text());
}

TEST(ReadScene, InstancesOfAMeshStandEachInItsOwnPlace) {
    GltfText g = one_triangle({{"name", "first"}, {"translation", {1, 2, 3}}});
    g.push("nodes", {{"name", "second"}, {"mesh", 0}, {"scale", {2, 2, -2}}});
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    ASSERT_EQ(scene->meshes.size(), 2u);
    expect_near(scene->meshes[0].positions[1], {2, 2, 3});
    expect_near(scene->meshes[1].positions[1], {2, 0, 0});
    expect_near(scene->meshes[0].normals[0], {0, 0, 1});
    expect_near(scene->meshes[1].normals[0], {0, 0, -1});
    expect_near(face_normal(scene->meshes[1], 0), {0, 0, -1});  // mirrored: still the outside
    for (const Mesh& mesh : scene->meshes) EXPECT_EQ(mesh.mesh, 0);
}

/// The mesh says it for all that show it, a node for its own.
TEST(ReadScene, MarksInExtras) {
    GltfText g = one_triangle();
    const auto node = [&](const json& marks) {
        g.push("nodes", {{"mesh", 0}, {"extras", {{"envbake", marks}, {"other", 1}}}});
    };
    g.document["meshes"][0]["extras"] = {{"envbake", {{"receives", false}}}};
    node({{"casts", false}});
    node({{"receives", true}, {"casts", true}});
    node({{"recieves", true}});
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    const auto marks = [&](std::size_t i) {
        return std::pair(scene->meshes[i].receives, scene->meshes[i].casts);
    };
    EXPECT_EQ(marks(0), std::pair(false, true));
    EXPECT_EQ(marks(1), std::pair(false, false));
    EXPECT_EQ(marks(2), std::pair(true, true));
    EXPECT_EQ(marks(3), std::pair(false, true));
    EXPECT_TRUE(has_note(*scene, "nodes[3].extras.envbake.\"recieves\" is not known"));

    for (const json& bad : {json(1), json({{"casts", 0}}), json({{"receives", "no"}})}) {
        g = one_triangle({{"extras", {{"envbake", bad}}}});
        EXPECT_TRUE(contains(refusal(g.text()), "nodes[0].extras.envbake")) << bad;
    }
    for (const json& other : {json(1), json("envbake"), json::array({1}), json({{"x", 1}})}) {
        const auto plain = read(one_triangle({{"extras", other}}).text());
        ASSERT_TRUE(plain) << plain.error();
        EXPECT_TRUE(plain->meshes[0].receives && plain->meshes[0].casts);
    }
}

TEST(ReadScene, ReflectanceFromIorAndSpecular) {
    const auto r0 = [](const char* extension, const json& values) {
        const auto scene = read_with_material({{"extensions", {{extension, values}}}}, extension);
        EXPECT_TRUE(scene) << scene.error();
        return scene ? scene->materials[0].dielectric_r0 : Vec3(-1);
    };
    expect_near(r0("KHR_materials_ior", {{"ior", 1.33}}), Vec3(0.1089f / 5.4289f),
                1e-8f);  // (0.33 / 2.33)^2
    expect_near(r0("KHR_materials_ior", {{"ior", 1}}), Vec3(0), 0);
    expect_near(r0("KHR_materials_ior", {{"ior", 0}}), Vec3(1), 0);
    expect_near(r0("KHR_materials_ior", json::object()), Vec3(0.04f), 0);
    expect_near(r0("KHR_materials_specular",
                   {{"specularFactor", 0.5}, {"specularColorFactor", {1, 0, 100}}}),
                {0.02f, 0, 0.5f});
    EXPECT_FALSE(read_with_material({{"extensions", {{"KHR_materials_ior", {{"ior", 0.5}}}}}},
                                    "KHR_materials_ior"));
}

TEST(ReadScene, MaterialFactors) {
    const auto scene = read_with_material(
        json::parse(
            R"({"name": "m", "emissiveFactor": [1, 0.5, 0], "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.75},
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10}}})"),
        "KHR_materials_emissive_strength");
    ASSERT_TRUE(scene) << scene.error();
    ASSERT_EQ(scene->materials.size(), 1u);
    const Material& m = scene->materials[0];
    EXPECT_EQ(m.name, "m");
    EXPECT_EQ(m.base_color, Vec3(0.1f, 0.2f, 0.3f));
    EXPECT_EQ(m.alpha, 0.4f);
    EXPECT_EQ(m.metallic, 0.5f);
    EXPECT_EQ(m.perceptual_roughness, 0.75f);
    EXPECT_EQ(m.emission, Vec3(10, 5, 0));
    EXPECT_EQ(m.alpha_mode, AlphaMode::Mask);
    EXPECT_EQ(m.alpha_cutoff, 0.25f);
    EXPECT_TRUE(m.double_sided);
    for (const char* bad : {R"({"pbrMetallicRoughness": {"metallicFactor": 2}})",
                            R"({"alphaMode": "GLASS"})", R"({"emissiveFactor": [1, 1]})",
                            R"({"pbrMetallicRoughness": {"roughnessFactor": "rough"}})"})
        EXPECT_FALSE(read_with_material(json::parse(bad), "X")) << bad;
}

TEST(ReadScene, TexturesSamplersAndTransforms) {
    GltfText g = one_triangle();
    g.document["extensionsUsed"] = {"KHR_texture_transform"};
    g.document["images"] =
        json::parse(R"([{"uri": "absent.png"}, {"uri": "absent too.png", "name": "second"}])");
    g.document["samplers"] = json::parse(R"([{"wrapS": 33071, "wrapT": 33648}])");
    g.document["textures"] = json::parse(R"([{"source": 1, "sampler": 0}, {"source": 0}])");
    g.document["materials"] = json::parse(
        R"([{"emissiveTexture": {"index": 1, "texCoord": 3}, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 0,
        "extensions": {"KHR_texture_transform": {"texCoord": 1, "offset": [5, 7], "scale": [2, 3], "rotation": 1.5707963267948966}}}}}])");
    g.document["meshes"][0]["primitives"][0]["material"] = 0;
    const auto scene = read(g.text(), {.textures = false});
    ASSERT_TRUE(scene) << scene.error();
    ASSERT_TRUE(scene->materials[0].base_color_texture);
    const Texture& t = *scene->materials[0].base_color_texture;
    EXPECT_EQ(t.image, 1);
    EXPECT_EQ(t.uv_set, 1);
    EXPECT_EQ(t.wrap_u, Wrap::ClampToEdge);
    EXPECT_EQ(t.wrap_v, Wrap::MirroredRepeat);
    // A quarter turn counter-clockwise in the image, v down: (u, v) -> (v, -u), after the scale.
    const std::array<float, 6> wanted{0, 3, 5, -2, 0, 7};
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(t.uv_matrix[i], wanted[i], 1e-6f);
    EXPECT_FALSE(scene->materials[0].emission_texture);
    EXPECT_TRUE(has_note(*scene, "materials[0].emissiveTexture: uses TEXCOORD_3"));
    EXPECT_TRUE(has_note(*scene, "uses TEXCOORD_1, which it lacks"));
    ASSERT_EQ(scene->images.size(), 2u);
    EXPECT_EQ(scene->images[1].name, "second");
    EXPECT_TRUE(scene->images[1].rgba.empty());

    EXPECT_TRUE(contains(refusal(g.text()), "images[1].uri: there is no file \"absent too.png\""));
}

TEST(ReadScene, DecodesOnlyTheImagesThatDecide) {
    // A PNG of one texel, red 255, green 0, blue 0, in 8-bit RGB.
    const std::string png =
        "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4z8AAAAMBAQDJ/"
        "pLvAAAAAElFTkSuQmCC";
    GltfText g = one_triangle();
    g.document["images"] = {{{"uri", "data:image/png;base64," + png}}, {{"uri", "absent.png"}}};
    g.document["textures"] = json::parse(R"([{"source": 0}, {"source": 1}])");
    g.document["materials"] = json::parse(
        R"([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1}},
        {"emissiveTexture": {"index": 1}}])");
    g.document["meshes"][0]["primitives"][0]["material"] = 0;
    g.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] =
        g.vec2({0, 0, 1, 0, 0, 1});
    auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_EQ(scene->images[0].width, 1);
    EXPECT_EQ(scene->images[0].rgba, (std::vector<std::uint8_t>{255, 0, 0, 255}));
    EXPECT_TRUE(scene->images[1].rgba.empty());

    g.document["images"][0]["uri"] = "data:image/png;base64,AAAA";
    EXPECT_TRUE(contains(refusal(g.text()), "images[0]"));
}

TEST(ReadScene, Uris) {
    GltfText g = one_triangle();
    const std::string bin(g.bytes.begin(), g.bytes.end());
    const auto with_uri = [&](const TempFolder& folder, const std::string& uri) {
        json document = g.document;
        document["buffers"] = {{{"byteLength", bin.size()}, {"uri", uri}}};
        return read_scene(folder.write("sub/scene.gltf", document.dump()));
    };
    const TempFolder folder;
    folder.write("sub/a b.bin", bin);
    folder.write("sub/\xc3\xa9\xe2\x99\xa5.bin", bin);
    folder.write("sub/100%25.bin", bin);
    folder.write("beside.bin", bin);
    for (const char* uri : {"a b.bin", "a%20b.bin", "\xc3\xa9\xe2\x99\xa5.bin",
                            "%C3%A9%E2%99%A5.bin", "100%25.bin", "./a%20b.bin", "../beside.bin"}) {
        const auto scene = with_uri(folder, uri);
        ASSERT_TRUE(scene) << scene.error();
        ASSERT_EQ(scene->files_read.size(), 2u) << uri;
        EXPECT_EQ(scene->files_read[0].filename(), "scene.gltf");
        EXPECT_TRUE(std::filesystem::exists(scene->files_read[1]));
    }
    const std::vector<std::pair<std::string, std::string>> refused{
        {"absent.bin", "buffers[0].uri: there is no file \"absent.bin\""},
        {(folder.path() / "beside.bin").string(), "is absolute"},
        {"file:beside.bin", "has a scheme"},
        {"https://example.org/a.bin", "has a scheme"},
        {"", "the URI is empty"},
        {"a%00b", "contains a NUL"},
        {"..", "there is no file"},
        {"line\nbreak", "there is no file \"line\\nbreak\""},
        {"data:application/octet-stream;base64,A", "middle of a byte"},
        {"data:application/octet-stream;base64,A?==", "character 1 of the data is not base64"},
        {"data:application/octet-stream,abc", "not base64"},
        {"data:application/octet-stream;base64,AAAA", "there are only 3 bytes"}};
    for (const auto& [uri, reason] : refused) {
        const auto scene = with_uri(folder, uri);
        ASSERT_FALSE(scene) << uri;
        EXPECT_EQ(scene.error().code, Errc::InvalidInput);
        EXPECT_TRUE(contains(scene.error().message, reason)) << scene.error();
        EXPECT_EQ(scene.error().message.find('\n'), std::string::npos);
    }
    const auto absent = read_scene(folder.path() / "absent.glb");
    ASSERT_FALSE(absent);
    EXPECT_EQ(absent.error().code, Errc::Failed);
    EXPECT_TRUE(contains(absent.error().message, "absent.glb: there is no such file"));
}

TEST(ReadScene, TruncatedGlbsAreRefused) {
    const std::string glb = one_triangle().glb();
    const TempFolder folder;
    const auto whole = read_scene(folder.write("whole.glb", glb));
    ASSERT_TRUE(whole) << whole.error();
    for (std::size_t size = 0; size < glb.size(); size += size < 40 ? 1 : 7) {
        const auto scene = read_scene(folder.write("cut.glb", glb.substr(0, size)));
        ASSERT_FALSE(scene) << size;
        EXPECT_EQ(scene.error().code, Errc::InvalidInput);
    }
}

// Bytes of a GLB set to characters that mean something to a parser, or to a count: whatever
// happens, it is a scene with indices in range, or an error of one line.
TEST(ReadScene, AnyChangedByteIsReadOrRefused) {
    GltfText g = one_triangle({{"scale", {1, 2, 3}}});
    g.document["meshes"][0]["primitives"][0]["indices"] = g.indices({0, 1, 2});
    const std::string glb = g.glb();
    const TempFolder folder;
    int refused = 0, read_anyway = 0;
    for (std::size_t i = 0; i < glb.size(); ++i) {
        std::string changed = glb;
        changed[i] = "9-\"\xff"[i % 4];
        const auto scene = read_scene(folder.write("changed.glb", changed));
        if (!scene) {
            ++refused;
            EXPECT_EQ(scene.error().message.find('\n'), std::string::npos);
            continue;
        }
        ++read_anyway;
        for (const Mesh& mesh : scene->meshes)
            for (const std::uint32_t v : mesh.triangles) ASSERT_LT(v, mesh.vertex_count());
    }
    EXPECT_GT(refused, 100);
    EXPECT_GT(read_anyway, 100);
}

TEST(ReadScene, ClaimsThatCostTheFileNothing) {
    // An accessor without data is all zeros, as many as it likes.
    GltfText zeros = one_triangle();
    zeros.document["accessors"][0].erase("bufferView");
    zeros.document["accessors"][0]["count"] = 2000000000;
    zeros.document["meshes"][0]["primitives"][0]["attributes"].erase("NORMAL");
    EXPECT_TRUE(
        contains(refusal(zeros.text()), "nodes[0]: with it the scene has 2000000000 vertices"));
    zeros.document["accessors"][0]["count"] = 20000000;
    EXPECT_TRUE(
        contains(refusal(zeros.text()), "accessors[0]: has 20000000 elements and no bufferView"));

    // One mesh of a million vertices, shown a hundred times.
    GltfText instances;
    instances.mesh(
        {{"attributes", {{"POSITION", instances.vec3(std::vector<float>(3000000, 0.0f))}}}});
    for (int i = 0; i < 100; ++i) instances.push("nodes", {{"mesh", 0}});
    EXPECT_TRUE(
        contains(refusal(instances.text()), "nodes[67]: with it the scene has 68000000 vertices"));

    // A meshopt stream of four bytes that claims a gigabyte.
    GltfText meshopt = one_triangle();
    meshopt.document["extensionsUsed"] = {"EXT_meshopt_compression"};
    meshopt.push("buffers", {{"byteLength", 1 << 30}});
    json& view = meshopt.document["bufferViews"][0];
    view["byteLength"] = 1 << 30;
    view["buffer"] = 1;
    view["extensions"]["EXT_meshopt_compression"] = {{"buffer", 0},
                                                     {"byteLength", 4},
                                                     {"byteStride", 256},
                                                     {"count", 1 << 22},
                                                     {"mode", "ATTRIBUTES"}};
    json document = meshopt.document;
    document["buffers"] = {
        {{"byteLength", 72},
         {"uri", "data:application/octet-stream;base64," + GltfText::base64(meshopt.bytes)}},
        {{"byteLength", 1 << 30}}};
    EXPECT_TRUE(contains(refusal(document.dump()), "4 bytes cannot decode to 1073741824"));

    EXPECT_TRUE(contains(refusal(R"({"asset": {"version": "2.0"}, "extras": )" +
                                 std::string(100000, '[') + std::string(100000, ']') + "}"),
                         "nests deeper than 256"));
}

TEST(ReadScene, VersionsAndExtensions) {
    GltfText g = one_triangle();
    g.document["asset"]["version"] = "2.7";
    EXPECT_TRUE(read(g.text()));
    g.document["asset"]["minVersion"] = "2.0";
    EXPECT_TRUE(read(g.text()));
    g.document["asset"]["minVersion"] = "2.1";
    EXPECT_TRUE(contains(refusal(g.text()), "asset.minVersion"));
    g = one_triangle();
    g.document["extensionsUsed"] = {"EXT_mesh_gpu_instancing", "KHR_materials_ior"};
    const auto scene = read(g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_TRUE(has_note(*scene, "extensions passed over: \"EXT_mesh_gpu_instancing\""));
    EXPECT_FALSE(has_note(*scene, "KHR_materials_ior"));
    g.document["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
    EXPECT_TRUE(
        contains(refusal(g.text()),
                 "the extension \"EXT_mesh_gpu_instancing\" is required and not supported"));
}

TEST(ReadScene, NothingToBake) {
    EXPECT_TRUE(contains(refusal(R"({"asset": {"version": "2.0"}})"),
                         "nothing to bake: the file has no nodes"));
    GltfText g = one_triangle();
    g.document["meshes"][0]["primitives"][0]["mode"] = 0;
    EXPECT_TRUE(contains(refusal(g.text()), "nothing to bake: the default scene has no triangles"));
}

TEST(ReadScene, HarmlessFaultsAreNoted) {
    GltfText g = one_triangle();
    g.document["animations"] = json::array();
    g.document["extensions"]["EXT_undeclared"] = json::object();
    const auto scene = read("\xef\xbb\xbf" + g.text());
    ASSERT_TRUE(scene) << scene.error();
    EXPECT_TRUE(has_note(*scene, "harmless: the JSON begins with a byte order mark"));
    EXPECT_TRUE(has_note(*scene, "harmless: animations: is an empty array"));
    EXPECT_TRUE(has_note(*scene, "\"EXT_undeclared\" is not in extensionsUsed"));
}

}  // namespace
}  // namespace envbake
