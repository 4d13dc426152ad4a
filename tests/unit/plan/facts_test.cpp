// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/facts.h"

#include <gtest/gtest.h>

#include <cmath>

namespace envbake {
namespace {

Environment grey(int width, int height, float value) {
    Environment environment;
    environment.grid = make_lat_long_grid(width, height);
    environment.radiance.assign(static_cast<std::size_t>(width * height), Vec3(value));
    return environment;
}

TEST(EnvironmentFacts, MeanWeighsTexelsBySolidAngle) {
    // Two rows of equal solid angle: the upper hemisphere at 3, the lower at 1.
    Environment environment = grey(4, 2, 1);
    for (std::size_t i = 0; i < 4; ++i) environment.radiance[i] = Vec3(3);
    EXPECT_NEAR(collect_facts(environment).mean, 2, 1e-12);
    // Four rows: the polar rows have 1 - cos 45 deg of the height each.
    environment = grey(4, 4, 0);
    for (std::size_t i = 0; i < 4; ++i) environment.radiance[i] = Vec3(1);
    EXPECT_NEAR(collect_facts(environment).mean, (1 - std::sqrt(0.5)) / 2, 1e-12);
}

TEST(EnvironmentFacts, CubeTexelsToo) {
    Environment environment;
    environment.grid = make_cube_grid(4);
    environment.radiance.assign(6 * 16, Vec3(0));
    for (std::size_t i = 0; i < 16; ++i) environment.radiance[i] = Vec3(6, 6, 6);
    EXPECT_NEAR(collect_facts(environment).mean, 1, 1e-12);
}

TEST(EnvironmentFacts, ContrastIsThatOfEveryTexelAndChannel) {
    Environment environment = grey(8, 4, 2);
    EXPECT_EQ(collect_facts(environment).contrast, 0);
    EXPECT_EQ(collect_facts(grey(8, 4, 0)).contrast, 0) << "black is constant";
    environment.radiance[17].y = 2.002f;
    EXPECT_NEAR(collect_facts(environment).contrast, 0.002 / 2.002, 1e-7);
    EXPECT_NEAR(collect_facts(environment).peak, 2.002, 1e-6);
    // One lit texel on black: 1 / (1e-3 mean).
    environment = grey(4, 2, 0);
    environment.radiance[3].z = 5;
    EXPECT_NEAR(collect_facts(environment).contrast, 5 / (1e-3 * 5 / 8), 1e-3);
}

TEST(EnvironmentFacts, GreyMeansEveryTexelExactly) {
    Environment cube;
    cube.grid = make_cube_grid(2);
    cube.radiance.assign(24, Vec3(0.3f));
    for (Environment environment : {grey(8, 4, 0.3f), cube}) {
        EXPECT_TRUE(collect_facts(environment).grey);
        environment.radiance[5] = Vec3(100);
        EXPECT_TRUE(collect_facts(environment).grey);
        environment.radiance.back().z = std::nextafter(0.3f, 1.0f);
        EXPECT_FALSE(collect_facts(environment).grey);
    }
}

Scene scene_with(Material material) {
    Scene scene;
    scene.materials.push_back(std::move(material));
    return scene;
}

TEST(MaterialFacts, FactorsAlone) {
    Material material;
    material.base_color = {0.5f, 0.25f, 0};
    material.metallic = 0;
    material.perceptual_roughness = 0.7f;
    MaterialFacts facts = collect_material_facts(scene_with(material))[0];
    EXPECT_FLOAT_EQ(facts.min_roughness, 0.7f);
    EXPECT_FLOAT_EQ(facts.max_roughness, 0.7f);
    EXPECT_FLOAT_EQ(facts.max_r0, 0.04f);
    EXPECT_FLOAT_EQ(facts.max_diffuse_albedo, 0.5f);

    material.metallic = 1;
    facts = collect_material_facts(scene_with(material))[0];
    EXPECT_FLOAT_EQ(facts.max_r0, 0.5f);
    EXPECT_EQ(facts.max_diffuse_albedo, 0);
}

TEST(MaterialFacts, GreyIsOfEveryFactor) {
    Material material;
    material.base_color = Vec3(0.5f);
    material.metallic = 0;
    material.base_color_texture = Texture{};
    Scene scene = scene_with(material);
    scene.images.push_back({"grey", 2, 1, {7, 7, 7, 1, 200, 200, 200, 255}});
    scene.meshes.resize(1);
    scene.meshes[0].colors = {Vec4(0.3f, 0.3f, 0.3f, 1)};
    EXPECT_TRUE(collect_material_facts(scene)[0].grey_albedo);
    scene.images[0].rgba[5] = 201;
    EXPECT_FALSE(collect_material_facts(scene)[0].grey_albedo);
    scene.images[0].rgba[5] = 200;
    scene.meshes[0].colors[0].z = 0.31f;
    EXPECT_FALSE(collect_material_facts(scene)[0].grey_albedo);
    scene.meshes[0].colors.clear();
    scene.images[0].rgba.clear();
    EXPECT_FALSE(collect_material_facts(scene)[0].grey_albedo) << "not decoded: nobody knows";
    scene.materials[0].base_color_texture.reset();
    EXPECT_TRUE(collect_material_facts(scene)[0].grey_albedo);
    scene.materials[0].base_color.y = 0.6f;
    EXPECT_FALSE(collect_material_facts(scene)[0].grey_albedo);
    scene.materials[0].metallic = 1;
    EXPECT_TRUE(collect_material_facts(scene)[0].grey_albedo) << "a metal has none";
}

TEST(MaterialFacts, TexturesWidenTheRange) {
    Material material;
    material.metallic_roughness_texture = Texture{};
    Scene scene = scene_with(material);
    scene.images.push_back({"mr", 2, 1, {0, 51, 0, 255, 0, 204, 255, 255}});
    MaterialFacts facts = collect_material_facts(scene)[0];
    EXPECT_FLOAT_EQ(facts.min_roughness, 0.2f);
    EXPECT_FLOAT_EQ(facts.max_roughness, 0.8f);
    EXPECT_FLOAT_EQ(facts.max_diffuse_albedo, 1) << "somewhere it is no metal";
    EXPECT_FLOAT_EQ(facts.max_r0, 1) << "somewhere it is";
    // An image that was not decoded says nothing: the whole range is possible.
    scene.images[0].rgba.clear();
    facts = collect_material_facts(scene)[0];
    EXPECT_EQ(facts.min_roughness, 0);
    EXPECT_EQ(facts.max_roughness, 1);
}

}  // namespace
}  // namespace envbake
