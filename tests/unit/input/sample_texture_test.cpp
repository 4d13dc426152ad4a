// SPDX-License-Identifier: Apache-2.0
#include "baker/input/sample_texture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace envbake {
namespace {

/// One row of texels with red 0, 51, 102, 255 (0, 0.2, 0.4, 1), the rest of each texel 255.
Scene ramp() {
    Scene scene;
    scene.images.push_back(
        {.name = "ramp",
         .width = 4,
         .height = 1,
         .rgba = {0, 255, 255, 255, 51, 255, 255, 255, 102, 255, 255, 255, 255, 255, 255, 255}});
    return scene;
}

float red_at(float u, Wrap wrap, std::array<float, 6> matrix = {1, 0, 0, 0, 1, 0}) {
    return sample_texture(ramp(), {.wrap_u = wrap, .uv_matrix = matrix}, {u, 0.5f}).r;
}

TEST(SampleTexture, TexelCentresAndBetween) {
    for (const Wrap wrap : {Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge}) {
        EXPECT_FLOAT_EQ(red_at(0.125f, wrap), 0.0f);
        EXPECT_FLOAT_EQ(red_at(0.375f, wrap), 0.2f);
        EXPECT_FLOAT_EQ(red_at(0.875f, wrap), 1.0f);
        EXPECT_FLOAT_EQ(red_at(0.5f, wrap), 0.3f);
        EXPECT_FLOAT_EQ(red_at(0.6875f, wrap), 0.75f * 0.4f + 0.25f * 1.0f);
    }
}

TEST(SampleTexture, Wrapping) {
    EXPECT_FLOAT_EQ(red_at(0, Wrap::Repeat), 0.5f);  // between the last texel and the first
    EXPECT_FLOAT_EQ(red_at(1, Wrap::Repeat), 0.5f);
    EXPECT_FLOAT_EQ(red_at(-0.625f, Wrap::Repeat), 0.2f);
    EXPECT_FLOAT_EQ(red_at(7.375f, Wrap::Repeat), 0.2f);

    EXPECT_FLOAT_EQ(red_at(0, Wrap::MirroredRepeat), 0.0f);
    EXPECT_FLOAT_EQ(red_at(1, Wrap::MirroredRepeat), 1.0f);
    EXPECT_FLOAT_EQ(red_at(-0.375f, Wrap::MirroredRepeat), 0.2f);
    EXPECT_FLOAT_EQ(red_at(1.375f, Wrap::MirroredRepeat), 0.4f);  // mirrored at 1: 0.625
    EXPECT_FLOAT_EQ(red_at(2.375f, Wrap::MirroredRepeat), 0.2f);

    EXPECT_FLOAT_EQ(red_at(-3, Wrap::ClampToEdge), 0.0f);
    EXPECT_FLOAT_EQ(red_at(0, Wrap::ClampToEdge), 0.0f);
    EXPECT_FLOAT_EQ(red_at(0.9375f, Wrap::ClampToEdge), 1.0f);
    EXPECT_FLOAT_EQ(red_at(5, Wrap::ClampToEdge), 1.0f);
}

TEST(SampleTexture, HugeAndInvalidCoordinates) {
    const float infinite = std::numeric_limits<float>::infinity();
    for (const Wrap wrap : {Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge})
        for (const float u : {1e30f, -1e30f, infinite, -infinite, std::nanf("")}) {
            const float red = red_at(u, wrap);
            EXPECT_TRUE(red >= 0 && red <= 1) << u;
        }
}

TEST(SampleTexture, RowsRunFromTheTopAndTheTransformApplies) {
    Scene scene;
    scene.images.push_back({.name = "2x2",
                            .width = 2,
                            .height = 2,
                            .rgba = {0, 0, 0, 0, 51, 0, 0, 0, 102, 0, 0, 0, 255, 0, 0, 0}});
    Texture t;
    EXPECT_FLOAT_EQ(sample_texture(scene, t, {0.25f, 0.25f}).r, 0.0f);
    EXPECT_FLOAT_EQ(sample_texture(scene, t, {0.75f, 0.25f}).r, 0.2f);
    EXPECT_FLOAT_EQ(sample_texture(scene, t, {0.25f, 0.75f}).r, 0.4f);
    EXPECT_FLOAT_EQ(sample_texture(scene, t, {0.5f, 0.5f}).r, (0 + 0.2f + 0.4f + 1) / 4);
    t.uv_matrix = {0, 1, 0.5f, 2, 0, 0.25f};  // (u, v) -> (v + 1/2, 2u + 1/4)
    EXPECT_FLOAT_EQ(sample_texture(scene, t, {0.25f, 0.25f}).r, 1.0f);
    scene.images[0].rgba.clear();
    EXPECT_EQ(sample_texture(scene, t, {0, 0}), Vec4(1)) << "not decoded: white";
}

/// A triangle with every input of a material.
Scene textured_triangle() {
    Scene scene = ramp();
    scene.images.push_back({.name = "mr", .width = 1, .height = 1, .rgba = {7, 102, 51, 9}});
    Material m;
    m.base_color = {0.5f, 0.5f, 1};
    m.alpha = 0.5f;
    m.metallic = 0.5f;
    m.perceptual_roughness = 0.5f;
    m.emission = {3, 2, 1};
    m.base_color_texture = Texture{.wrap_u = Wrap::ClampToEdge};
    m.metallic_roughness_texture = Texture{.image = 1, .uv_set = 1};
    m.emission_texture = Texture{.wrap_u = Wrap::ClampToEdge};
    scene.materials.push_back(m);
    Mesh mesh;
    mesh.positions.assign(3, Vec3(0));
    mesh.triangles = {0, 1, 2};
    mesh.uv0 = {{0, 0}, {1, 0}, {0, 0}};
    mesh.colors = {Vec4(1), Vec4(0.5f), Vec4(1)};
    scene.meshes.push_back(mesh);
    return scene;
}

TEST(SurfaceMaterial, MultipliesFactorsTexturesAndColors) {
    const Scene scene = textured_triangle();
    // Corner 1: u = 1, the last texel, red 1; vertex colour 1/2.
    const SurfaceMaterial s = surface_material(scene, scene.meshes[0], 0, {0, 1, 0});
    EXPECT_EQ(s.base_color, Vec3(0.25f, 0.25f, 0.5f));
    EXPECT_FLOAT_EQ(s.alpha, 0.25f);
    EXPECT_FLOAT_EQ(s.perceptual_roughness, 0.5f * 0.4f);  // green
    EXPECT_FLOAT_EQ(s.metallic, 0.5f * 0.2f);              // blue
    EXPECT_FLOAT_EQ(s.r0.r, 0.9f * 0.04f + 0.1f * 0.25f);
    EXPECT_FLOAT_EQ(s.diffuse_albedo().b, 0.9f * 0.5f);
    EXPECT_EQ(s.emission, Vec3(3, 2, 1));
}

TEST(SurfaceMaterial, ColorTexelsAreLinearBeforeTheyAreFiltered) {
    const Scene scene = textured_triangle();
    // u = 1/2: half of red 51 and half of red 102. sRGB: ((c + 0.055) / 1.055)^2.4.
    const double linear = (0.0331047666 + 0.1328683216) / 2;
    const SurfaceMaterial s = surface_material(scene, scene.meshes[0], 0, {0.5f, 0.5f, 0});
    EXPECT_NEAR(s.emission.r, 3 * linear, 1e-6);
    EXPECT_NEAR(s.base_color.r, 0.5 * 0.75 * linear, 1e-6);
}

}  // namespace
}  // namespace envbake
