// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace envbake {

/// An 8-bit image as decoded: rows from the top, 4 channels. Colour textures are sRGB-encoded,
/// data textures (metallic-roughness) are linear; who samples knows which.
struct Image {
    std::string name;
    int width = 0;
    int height = 0;
    std::vector<std::uint8_t> rgba;  ///< 4 * width * height; empty when the image was not needed
};

enum class Wrap { Repeat, MirroredRepeat, ClampToEdge };

/// A texture as a material uses it. The transform is that of KHR_texture_transform:
/// uv' = uv_matrix * (uv, 1).
struct Texture {
    int image = 0;   ///< index into Scene::images
    int uv_set = 0;  ///< 0 or 1
    Wrap wrap_u = Wrap::Repeat;
    Wrap wrap_v = Wrap::Repeat;
    std::array<float, 6> uv_matrix{1, 0, 0, 0, 1, 0};  ///< two rows of three
};

enum class AlphaMode { Opaque, Mask, Blend };

/// The glTF 2.0 metallic-roughness material, factors and textures apart.
struct Material {
    std::string name;
    Vec3 base_color{1, 1, 1};  ///< linear Rec. 709
    float alpha = 1;
    float metallic = 1;              ///< 0 .. 1
    float perceptual_roughness = 1;  ///< 0 .. 1
    Vec3 dielectric_r0{0.04f};       ///< reflectance at normal incidence where metallic = 0
    Vec3 emission{0, 0, 0};          ///< W sr^-1 m^-2, linear; may exceed 1
    AlphaMode alpha_mode = AlphaMode::Opaque;
    float alpha_cutoff = 0.5f;
    bool double_sided = false;
    std::optional<Texture> base_color_texture;          ///< sRGB, alpha linear
    std::optional<Texture> metallic_roughness_texture;  ///< G roughness, B metallic
    std::optional<Texture> emission_texture;            ///< sRGB
};

/// One (node, primitive) pair of the default scene: "mesh/I" of the bundle, in world space.
/// Vertices stand in the file's order: row v of a bundle array is vertex v of the primitive's
/// accessors. Triangles are counter-clockwise seen from outside, mirrored nodes included.
struct Mesh {
    int node = 0;       ///< index into the file's nodes
    int mesh = 0;       ///< index into the file's meshes
    int primitive = 0;  ///< index within the mesh
    std::string node_name;
    std::string mesh_name;
    int material = 0;  ///< index into Scene::materials

    std::vector<Vec3> positions;           ///< world space, metres, finite
    std::vector<Vec3> normals;             ///< unit; (0, 0, 0) where none can be told
    std::vector<Vec2> uv0;                 ///< empty or one a vertex
    std::vector<Vec2> uv1;                 ///< empty or one a vertex
    std::vector<Vec4> colors;              ///< linear; empty or one a vertex
    std::vector<std::uint32_t> triangles;  ///< 3 indices each; empty for points and lines
    bool normals_computed = false;         ///< the file had none
    bool receives = true;                  ///< false: marked as needing no transport
    bool casts = true;                     ///< false: marked as blocking no light

    std::size_t vertex_count() const { return positions.size(); }
    std::size_t triangle_count() const { return triangles.size() / 3; }
};

/// Instances cost a file nothing and a bake everything, so the expanded scene has limits: 64 Mi
/// vertices (1.6 GB of positions and normals) and as many triangles.
inline constexpr std::uint64_t kMaxVertices = std::uint64_t{1} << 26;

/// A glTF file as the stages want it: flat, in world space, checked.
struct Scene {
    std::string file_name;  ///< without folder
    std::vector<std::filesystem::path>
        files_read;                   ///< the scene itself first, then buffers and images
    std::vector<Mesh> meshes;         ///< depth first, in file order
    std::vector<Material> materials;  ///< the file's, then the default one if it is used
    std::vector<Image> images;
    std::vector<std::string> notes;  ///< what was passed over or repaired, one line each
};

}  // namespace envbake
