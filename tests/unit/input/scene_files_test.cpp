// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_scene.h"
#include "tests/support/test_data.h"

#include <array>
#include <cmath>
#include <map>
#include <set>

namespace envbake {
namespace {

/// Wrong in one way each: where the error points.
const std::map<std::string, std::string> kMalformed{
    {"geometry/accessor_count_too_big.glb", "accessors[0]"},
    {"geometry/index_out_of_range.glb", "meshes[0].primitives[0].indices"},
    {"geometry/nan_positions.glb", "meshes[0].primitives[0].attributes.POSITION"},
    {"geometry/truncated_bunny.glb", "GLB: the header says 1253808 bytes, the file has 70000"},
    {"gltf/BoundsChecking/integer-out-of-bounds.gltf", "bufferViews[0].byteLength"},
    {"gltf/BoundsChecking/invalid-primitive-indices.gltf", "bufferViews[0].buffer"},
    {"gltf/BoundsChecking/issue-416.gltf", "asset.version"},
    {"gltf/BoxWithInfinites/BoxWithInfinites.glb", "meshes[0].primitives[0].attributes.POSITION"},
    {"gltf/IncorrectVertexArrays/Cube.gltf", "bufferViews[2]"},
    {"gltf/IndexOutOfRange/AllIndicesOutOfRange.gltf", "meshes[0].primitives[0].indices"},
    {"gltf/IndexOutOfRange/IndexOutOfRange.gltf", "meshes[0].primitives[0].indices"},
    {"gltf/RecursiveNodes/RecursiveNodes.gltf", "nodes[0]"},
    {"gltf/validator/accessor/alignment.gltf", "accessors[2]"},
    {"gltf/validator/accessor/empty_array.gltf", "accessors"},
    {"gltf/validator/accessor/float_normalized.gltf", "accessors[0].normalized"},
    {"gltf/validator/accessor/matrix_alignment.gltf", "accessors[0]"},
    {"gltf/validator/accessor/unresolved_bufferviews.gltf", "accessors[0].bufferView"},
    {"gltf/validator/accessor_data/out_of_range_elements_float.gltf", "nothing to bake"},
    {"gltf/validator/accessor_data/out_of_range_elements_sint8.gltf", "nothing to bake"},
    {"gltf/validator/accessor_data/out_of_range_elements_uint32.gltf", "nothing to bake"},
    {"gltf/validator/asset/1_0_version.gltf", "asset.version"},
    {"gltf/validator/asset/invalid_version.gltf", "asset.version"},
    {"gltf/validator/buffer/empty_array.gltf", "buffers"},
    {"gltf/validator/buffer/invalid_object.gltf", "buffers[0]"},
    {"gltf/validator/buffer/invalid_uri_data.gltf", "buffers[0].uri"},
    {"gltf/validator/buffer/invalid_uri_data_mime.gltf", "buffers[0].uri"},
    {"gltf/validator/buffer/no_bin_chunk.glb", "buffers[0]"},
    {"gltf/validator/buffer/wrong_bytelength.glb", "buffers[0]"},
    {"gltf/validator/buffer_view/empty_array.gltf", "bufferViews"},
    {"gltf/validator/buffer_view/invalid_length.gltf", "bufferViews[0]"},
    {"gltf/validator/buffer_view/invalid_stride_too_big.gltf", "bufferViews[0].byteStride"},
    {"gltf/validator/buffer_view/unresolved_buffer.gltf", "bufferViews[0].buffer"},
    {"gltf/validator/glb/bom.glb", "the JSON begins with a byte order mark"},
    {"gltf/validator/glb/empty_file.glb", "the file is empty"},
    {"gltf/validator/glb/empty_json_object.glb", "asset"},
    {"gltf/validator/glb/invalid_magic.glb",
     "GLB: the file does not begin with the magic \"glTF\""},
    {"gltf/validator/glb/json_and_two_buffers.glb", "GLB: chunk 2: a second BIN chunk"},
    {"gltf/validator/glb/misplaced_bin_chunk.glb", "GLB: chunk 2: the BIN chunk must be chunk 1"},
    {"gltf/validator/glb/only_bin_chunk.glb", "GLB: chunk 0 is not of type JSON"},
    {"gltf/validator/glb/truncated_chunk_data.glb",
     "GLB: the header says 48 bytes, the file has 47"},
    {"gltf/validator/glb/two_bin_chunks.glb", "GLB: chunk 0 is not of type JSON"},
    {"gltf/validator/glb/two_empty_json_chunks.glb", "GLB: chunk 1: a second JSON chunk"},
    {"gltf/validator/glb/unaligned_chunk.glb", "GLB: chunk 0: 27 bytes long"},
    {"gltf/validator/glb/zero_chunk_header.glb", "GLB: chunk 0 is not of type JSON"},
    {"gltf/validator/image/buffer_view_bytestride.gltf", "images[0].bufferView"},
    {"gltf/validator/image/empty_object.gltf", "images[0]"},
    {"gltf/validator/image/invalid_data_uri_mime_type.gltf", "nothing to bake"},
    {"gltf/validator/image/invalid_object.gltf", "images[0]"},
    {"gltf/validator/image/missing_mime_type_buffer_view.gltf", "images[0].mimeType"},
    {"gltf/validator/image/png_eos.gltf", "nothing to bake"},
    {"gltf/validator/json/bom.gltf", "the JSON begins with a byte order mark"},
    {"gltf/validator/json/invalid_object.gltf", "the JSON is of type array, it must be an object"},
    {"gltf/validator/material/empty_array.gltf", "materials"},
    {"gltf/validator/material/unresolved_emissive.gltf", "materials[0].emissiveTexture.index"},
    {"gltf/validator/material/unresolved_normal.gltf", "materials[0].normalTexture.index"},
    {"gltf/validator/mesh/accessor_attribute_uint32.gltf", "meshes[0].primitives[0].attributes"},
    {"gltf/validator/mesh/accessor_unequal_count.gltf",
     "meshes[0].primitives[0].attributes.POSITION"},
    {"gltf/validator/mesh/bufferview_target_override.gltf", "meshes[0].primitives[0].attributes"},
    {"gltf/validator/mesh/empty_object.gltf", "meshes[0].primitives"},
    {"gltf/validator/mesh/indices_invalid_format.gltf", "meshes[0].primitives[0].indices"},
    {"gltf/validator/mesh/invalid_attribute_escaped_name.gltf",
     "meshes[0].primitives[0].attributes"},
    {"gltf/validator/mesh/morph_attribute_invalid_count.gltf",
     "meshes[0].primitives[0].targets[0].POSITION"},
    {"gltf/validator/mesh/morph_bufferview_target_override.gltf",
     "meshes[0].primitives[0].targets[0]"},
    {"gltf/validator/mesh/morph_unequal_targets_count.gltf", "meshes[0].primitives[1].targets"},
    {"gltf/validator/mesh/position_accessor_invalid_format.gltf",
     "meshes[0].primitives[0].attributes.POSITION"},
    {"gltf/validator/mesh/unequal_joints.gltf", "meshes[0].primitives[0].attributes.JOINTS_1"},
    {"gltf/validator/mesh/unresolved_material.gltf", "meshes[0].primitives[0].material"},
    {"gltf/validator/mesh/unresolved_positions.gltf",
     "meshes[0].primitives[0].attributes.POSITION"},
    {"gltf/validator/mesh_data/colors_non_clamped.gltf", "nothing to bake"},
    {"gltf/validator/mesh_data/index_buffer_primitive_restart.gltf", "nothing to bake"},
    {"gltf/validator/mesh_data/joints_weights_complex.gltf",
     "meshes[0].primitives[0].attributes.WEIGHTS_1"},
    {"gltf/validator/node/empty_array.gltf", "nodes"},
    {"gltf/validator/node/infinite_transform.gltf", "not valid JSON"},
    {"gltf/validator/node/matrix_trs.gltf", "nodes[0].matrix"},
    {"gltf/validator/node/node_loop_scene.gltf", "nodes[4]"},
    {"gltf/validator/node/node_skin_without_skinned_mesh.gltf", "nodes[0].skin"},
    {"gltf/validator/node/rotation_non_unit.gltf", "nodes[0].rotation"},
    {"gltf/validator/node/unresolved_camera.gltf", "nodes[0].camera"},
    {"gltf/validator/node/unresolved_mesh.gltf", "nodes[0].mesh"},
    {"gltf/validator/node/weights_with_no_mesh.gltf", "nodes[0].weights"},
    {"gltf/validator/root/empty_object.gltf", "asset"},
    {"gltf/validator/root/extensions_undeclared_wrong_pointer.gltf", "extensions"},
    {"gltf/validator/root/invalid_collection_type.gltf", "samplers"},
    {"gltf/validator/sampler/empty_array.gltf", "samplers"},
    {"gltf/validator/scene/empty_array.gltf", "scenes"},
    {"gltf/validator/scene/non_root_node.gltf", "scenes[0].nodes"},
    {"gltf/validator/scene/unresolved_default_scene.gltf", "scene"},
    {"gltf/validator/skin/buffer_view_bytestride.gltf", "skins[0].inverseBindMatrices"},
    {"gltf/validator/skin/empty_joints_array.gltf", "skins[0].joints"},
    {"gltf/validator/skin/ibm_invalid_count.gltf", "skins[2].inverseBindMatrices"},
    {"gltf/validator/skin/no_common_root.gltf", "skins[0].joints"},
    {"gltf/validator/skin/skeleton_invalid.gltf", "skins[0].skeleton"},
    {"gltf/validator/skin/unresolved_joint.gltf", "skins[0].joints[0]"},
    {"gltf/validator/texture/unresolved_sampler.gltf", "textures[0].sampler"},
};

// A fault that harms nothing is named behind "nothing to bake": those files have nothing else.
TEST(SceneFiles, EveryMalformedFileIsRefusedByName) {
    ENVBAKE_REQUIRE_DATA("malformed");
    std::size_t seen = 0;
    for (const char* folder : {"malformed/gltf", "malformed/geometry"}) {
        for (const auto& entry :
             std::filesystem::recursive_directory_iterator(test::data(folder))) {
            const std::string extension = entry.path().extension().string();
            if (extension != ".gltf" && extension != ".glb") continue;
            const std::string name =
                std::filesystem::relative(entry.path(), test::data("malformed")).generic_string();
            const auto scene = read_scene(entry.path());
            if (name == "geometry/degenerate_triangles.glb") {  // valid
                EXPECT_TRUE(scene) << scene.error();
                continue;
            }
            ASSERT_FALSE(scene) << name;
            EXPECT_EQ(scene.error().code, Errc::InvalidInput) << scene.error();
            const std::string& message = scene.error().message;
            EXPECT_EQ(message.rfind(entry.path().string() + ": ", 0), 0u) << message;
            EXPECT_EQ(message.find('\n'), std::string::npos) << message;
            ASSERT_TRUE(kMalformed.count(name)) << name << " is not in the table: " << message;
            EXPECT_NE(message.find(kMalformed.at(name)), std::string::npos) << message;
            ++seen;
        }
    }
    EXPECT_EQ(seen, kMalformed.size());
}

struct Expectation {
    std::size_t meshes, vertices, triangles, materials;
    std::array<float, 6> bounds;  ///< least x, y, z, greatest x, y, z
};

struct Facts {
    std::size_t vertices = 0, triangles = 0;
    Vec3 low{1e30f}, high{-1e30f};
};

Facts facts_of(const Scene& scene) {
    Facts f;
    for (const Mesh& mesh : scene.meshes) {
        f.vertices += mesh.vertex_count();
        f.triangles += mesh.triangle_count();
        for (const Vec3& p : mesh.positions) {
            f.low = glm::min(f.low, p);
            f.high = glm::max(f.high, p);
        }
    }
    return f;
}

// Counts and bounds as a separate reader of some thirty lines (Python, its own matrices and skins)
// finds them in the files; of the Draco box, as its accessors and its node's matrix say.
const std::map<std::string, Expectation> kScenes{
    {"cesium_milk_truck.glb",
     {5, 3564, 3624, 4, {-2.43091f, 0.00145f, -1.396f, 2.438f, 2.58437f, 1.396f}}},
    {"cornell_box.glb", {6, 74, 36, 5, {-556, 0, -559.2f, 0, 548.8f, 0.000122f}}},
    {"dungeon_hall.glb", {175, 162903, 91100, 1, {-11, -0.1f, -15, 11.1297f, 8.12747f, 15.25f}}},
    {"flight_helmet.glb",
     {6, 55392, 94722, 6, {-0.20364f, 0, -0.17155f, 0.16294f, 0.716f, 0.20003f}}},
    {"japanese_bridge_garden.glb",
     {13, 41980, 21883, 13, {-5.52718f, 0.3775f, -5.2646f, 5.83309f, 7.39025f, 6.10103f}}},
    {"lucy_33k.glb",
     {1, 16723, 33446, 1, {-0.75171f, 0.0005f, -0.86324f, 0.83811f, 3.21152f, 0.5632f}}},
    {"shader_ball.glb",
     {6, 36027, 67832, 3, {-1.3457f, 0.02056f, -1.3457f, 1.3457f, 2.67765f, 1.15542f}}},
    {"stanford_bunny.glb",
     {1, 34834, 69451, 1, {-0.09469f, 0.03299f, -0.06187f, 0.06101f, 0.18732f, 0.0588f}}},
    {"suzanne.glb",
     {1, 11808, 3936, 1, {-1.33691f, -0.97461f, -0.8008f, 1.33691f, 0.9502f, 0.82568f}}},
    {"quirks/AnimatedMorphCube.glb", {1, 24, 12, 1, {-1, -1, -1, 1, 1, 1}}},
    {"quirks/BoxInterleaved.glb", {1, 24, 12, 1, {-0.5f, -0.5f, -0.5f, 0.5f, 0.5f, 0.5f}}},
    {"quirks/BoxMetaDraco/BoxMetaDraco.gltf",
     {1, 36, 12, 1, {-0.5f, -0.5f, 1.5f, 0.5f, 0.5f, 2.5f}}},
    {"quirks/CubeImageUriSpaces/CubeImageUriSpaces.gltf",
     {1, 24, 12, 1, {-0.5f, -0.5f, -0.5f, 0.5f, 0.5f, 0.5f}}},
    {"quirks/RiggedSimple.glb", {1, 96, 188, 1, {-1, -4.57508f, -1, 1, 4.57508f, 1}}},
    {"quirks/SimpleSparseAccessor.gltf", {1, 14, 12, 1, {0, 0, 0, 6, 4, 0}}},
    {"quirks/SpheresScaledInstances/spheres_scaled_instances.gltf",
     {3, 693, 672, 2, {-3, -3, -3, 3, 3, 3}}},
    {"quirks/TextureCoordinateTest.gltf", {5, 20, 10, 5, {-1.2f, -1.2f, 0, 1.2f, 1.2f, 0.05259f}}},
    {"quirks/TwoSidedPlane/TwoSidedPlane.gltf", {1, 6, 2, 1, {-1, 0, -1, 1, 0, 1}}},
    {"quirks/unicode_names/Ünïcode ♥.gltf", {1, 642, 1280, 1, {-1, -1, -1, 1, 1, 1}}},
    {"quirks/generator/Animation_Skin/Animation_Skin_01.gltf",
     {1, 6, 4, 1, {-0.3415f, -0.5f, -0.3415f, 0.125f, 0.43301f, 0.21651f}}},
    {"quirks/generator/Buffer_Interleaved/Buffer_Interleaved_00.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Buffer_Interleaved/Buffer_Interleaved_01.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Compatibility/Compatibility_00.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Compatibility/Compatibility_01.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Material_AlphaBlend/Material_AlphaBlend_01.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Material_AlphaMask/Material_AlphaMask_01.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Material_DoubleSided/Material_DoubleSided_01.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Material_MetallicRoughness/Material_MetallicRoughness_00.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Material_MetallicRoughness/Material_MetallicRoughness_05.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_04.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_06.gltf",
     {1, 6, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_11.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_14.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Mesh_PrimitiveVertexColor/Mesh_PrimitiveVertexColor_00.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Mesh_PrimitiveVertexColor/Mesh_PrimitiveVertexColor_04.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Mesh_PrimitivesUV/Mesh_PrimitivesUV_04.gltf",
     {2, 6, 2, 2, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
    {"quirks/generator/Node_Attribute/Node_Attribute_08.gltf",
     {2, 196, 54, 2, {-11, -2.5f, -11, 7.5f, 11, 7.5f}}},
    {"quirks/generator/Node_NegativeScale/Node_NegativeScale_01.gltf",
     {2, 196, 54, 2, {-7.5f, -2.5f, -7.5f, 7.5f, 9.5f, 7.5f}}},
    {"quirks/generator/Node_NegativeScale/Node_NegativeScale_04.gltf",
     {2, 196, 54, 2, {-7.5f, -2.5f, -7.5f, 7.5f, 9.5f, 7.5f}}},
    {"quirks/generator/Node_NegativeScale/Node_NegativeScale_09.gltf",
     {2, 196, 54, 2, {-7.5f, -5.5f, -7.5f, 7.5f, 7.5f, 7.5f}}},
    {"quirks/generator/Texture_Sampler/Texture_Sampler_01.gltf",
     {1, 4, 2, 1, {-0.5f, -0.5f, 0, 0.5f, 0.5f, 0}}},
};

TEST(SceneFiles, ScenesHaveTheirCountsAndBounds) {
    ENVBAKE_REQUIRE_DATA("meshes");
    for (const auto& [name, wanted] : kScenes) {
        const auto scene = read_scene(test::data("meshes") / name, {.textures = false});
        ASSERT_TRUE(scene) << scene.error();
        const Facts seen = facts_of(*scene);
        EXPECT_EQ(scene->meshes.size(), wanted.meshes) << name;
        EXPECT_EQ(seen.vertices, wanted.vertices) << name;
        EXPECT_EQ(seen.triangles, wanted.triangles) << name;
        EXPECT_EQ(scene->materials.size(), wanted.materials) << name;
        for (int i = 0; i < 3; ++i) {
            // The table is rounded to five digits.
            EXPECT_NEAR(seen.low[i], wanted.bounds[static_cast<std::size_t>(i)], 1e-4f) << name;
            EXPECT_NEAR(seen.high[i], wanted.bounds[static_cast<std::size_t>(i) + 3], 1e-4f)
                << name;
        }
        for (const Mesh& mesh : scene->meshes)
            for (const Vec3& n : mesh.normals)
                ASSERT_TRUE(n == Vec3(0) || std::abs(glm::length(n) - 1) < 1e-6f) << name;
    }
}

TEST(SceneFiles, TexturesAreDecodedWhereTheyDecide) {
    ENVBAKE_REQUIRE_DATA("meshes");
    const auto scene = read_scene(test::data("meshes/flight_helmet.glb"));
    ASSERT_TRUE(scene) << scene.error();
    ASSERT_EQ(scene->images.size(), 15u);  // normal, metallic-roughness and base colour, five times
    std::size_t decoded = 0;
    for (const Image& image : scene->images) {
        if (image.rgba.empty()) continue;
        ++decoded;
        EXPECT_EQ(image.width, 512);
        EXPECT_EQ(image.rgba.size(), 4u * 512 * 512);
    }
    EXPECT_EQ(decoded, 10u);
    const auto spaces =
        read_scene(test::data("meshes/quirks/CubeImageUriSpaces/CubeImageUriSpaces.gltf"));
    ASSERT_TRUE(spaces) << spaces.error();
    EXPECT_EQ(spaces->images[0].rgba.size(), 16u);
    EXPECT_EQ(spaces->files_read.size(), 3u);
}

TEST(SceneFiles, RefusedThoughWellFormed) {
    ENVBAKE_REQUIRE_DATA("meshes");
    const auto extension =
        read_scene(test::data("meshes/quirks/generator/Compatibility/Compatibility_05.gltf"));
    ASSERT_FALSE(extension);
    EXPECT_NE(extension.error().message.find("\"FAKE_materials_quantumRendering\" is required"),
              std::string::npos);
    const auto points = read_scene(
        test::data("meshes/quirks/generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_00.gltf"));
    ASSERT_FALSE(points);
    EXPECT_NE(points.error().message.find("nothing to bake"), std::string::npos);
}

// Mirrored or not, what the file calls outside (its normals) is the side that triangles face.
TEST(SceneFiles, MirroredNodesFaceOutwards) {
    ENVBAKE_REQUIRE_DATA("meshes");
    const auto scene = read_scene(
        test::data("meshes/quirks/generator/Node_NegativeScale/Node_NegativeScale_09.gltf"),
        {.textures = false});
    ASSERT_TRUE(scene) << scene.error();
    for (const Mesh& mesh : scene->meshes) {
        for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
            const auto p = [&](std::size_t k) { return mesh.positions[mesh.triangles[t + k]]; };
            EXPECT_GT(
                glm::dot(glm::cross(p(1) - p(0), p(2) - p(0)), mesh.normals[mesh.triangles[t]]),
                0.0f);
        }
    }
}

/// Triangles as sums that no order of vertices or triangles changes: area, and its first moment.
std::array<double, 4> area_and_moment(const Mesh& mesh) {
    std::array<double, 4> sums{};
    for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
        const auto p = [&](std::size_t k) { return DVec3(mesh.positions[mesh.triangles[t + k]]); };
        const double area = glm::length(glm::cross(p(1) - p(0), p(2) - p(0))) / 2;
        const DVec3 centre = (p(0) + p(1) + p(2)) / 3.0;
        sums[0] += area;
        for (int i = 0; i < 3; ++i) sums[static_cast<std::size_t>(i) + 1] += area * centre[i];
    }
    return sums;
}

TEST(SceneFiles, CompressedBunniesAreTheBunny) {
    ENVBAKE_REQUIRE_DATA("meshes");
    const auto plain = read_scene(test::data("meshes/stanford_bunny.glb"));
    ASSERT_TRUE(plain) << plain.error();
    const Mesh& wanted = plain->meshes[0];
    for (const char* name : {"bunny_quantized.glb", "bunny_meshopt.glb", "bunny_draco.glb"}) {
        const auto scene = read_scene(test::data("meshes/quirks") / name);
        ASSERT_TRUE(scene) << scene.error();
        const Mesh& mesh = scene->meshes[0];
        ASSERT_EQ(mesh.vertex_count(), wanted.vertex_count());
        ASSERT_EQ(mesh.triangle_count(), wanted.triangle_count());
        const auto seen = area_and_moment(mesh), truth = area_and_moment(wanted);
        for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(seen[i], truth[i], 1e-3 * truth[0]) << name;

        // Vertices may stand in another order: look each up in a grid of the plain bunny's.
        constexpr float kCell = 1e-3f;
        const auto cell = [&](const Vec3& p) {
            return std::array<int, 3>{static_cast<int>(std::floor(p.x / kCell)),
                                      static_cast<int>(std::floor(p.y / kCell)),
                                      static_cast<int>(std::floor(p.z / kCell))};
        };
        std::map<std::array<int, 3>, std::vector<std::size_t>> grid;
        for (std::size_t v = 0; v < wanted.vertex_count(); ++v)
            grid[cell(wanted.positions[v])].push_back(v);
        float worst_distance = 0;
        double normal_agreement = 0;
        for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
            const auto home = cell(mesh.positions[v]);
            float nearest = 1;
            std::size_t nearest_vertex = 0;
            for (int i = 0; i < 27; ++i) {
                const auto found =
                    grid.find({home[0] + i % 3 - 1, home[1] + i / 3 % 3 - 1, home[2] + i / 9 - 1});
                if (found == grid.end()) continue;
                for (const std::size_t w : found->second) {
                    const float d = glm::distance(mesh.positions[v], wanted.positions[w]);
                    if (d < nearest) nearest = d, nearest_vertex = w;
                }
            }
            worst_distance = std::max(worst_distance, nearest);
            normal_agreement += double{glm::dot(mesh.normals[v], wanted.normals[nearest_vertex])};
        }
        RecordProperty(std::string(name) + "_worst_distance_m", std::to_string(worst_distance));
        // 14 bits and more over 0.156 m: half a step in each axis is under 1e-5 m.
        EXPECT_LT(worst_distance, 1e-5f) << name;
        EXPECT_GT(normal_agreement / static_cast<double>(mesh.vertex_count()), 0.999) << name;
    }
}

}  // namespace
}  // namespace envbake
