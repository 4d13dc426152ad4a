// SPDX-License-Identifier: Apache-2.0
#include "baker/trace/coverage.h"

#include "baker/core/parallel.h"
#include "baker/input/sample_texture.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace envbake {
namespace {

Image blotches(int width, int height, unsigned seed) {
    // Discs of nothing in a solid image: large even areas, and edges of every direction.
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform;
    Image image{.name = "blotches", .width = width, .height = height, .rgba = {}};
    image.rgba.assign(4 * static_cast<std::size_t>(width * height), 255);
    for (int disc = 0; disc < 12; ++disc) {
        const double x = width * uniform(random), y = height * uniform(random);
        const double radius = width * (0.02 + 0.15 * uniform(random));
        for (int row = 0; row < height; ++row)
            for (int column = 0; column < width; ++column)
                if (std::hypot(column - x, row - y) < radius)
                    image.rgba[4 * static_cast<std::size_t>(row * width + column) + 3] = 0;
    }
    return image;
}

/// Loose triangles of every size on the texture, across its borders too.
Scene masked_soup(Wrap wrap_u, Wrap wrap_v, unsigned seed) {
    Mesh mesh = test::triangle_soup(600, 0.1f, seed);
    std::mt19937 random(seed + 1);
    std::uniform_real_distribution<float> uniform(-1, 1);
    for (std::size_t i = 0; i < mesh.vertex_count(); i += 3) {
        const Vec2 centre(2 * uniform(random), 2 * uniform(random));
        const float size = std::exp(4 * uniform(random) - 4);
        for (int corner = 0; corner < 3; ++corner) {
            const float u = uniform(random);
            mesh.uv0.push_back(centre + size * Vec2(u, uniform(random)));
        }
    }
    Scene scene = test::scene_of({mesh});
    Material& material = scene.materials[0];
    material.alpha_mode = AlphaMode::Mask;
    material.base_color_texture = Texture{
        .wrap_u = wrap_u, .wrap_v = wrap_v, .uv_matrix = {0.8f, -0.3f, 0.1f, 0.4f, 0.9f, 0}};
    scene.images.push_back(blotches(96, 64, seed));
    return scene;
}

/// Against thousands of look-ups on each triangle. What holds of all of them, and of all a texel
/// and a half around the triangle, must have been proved.
TEST(Coverage, IsWhatLookUpsSay) {
    std::mt19937 random(5);
    std::uniform_real_distribution<float> uniform(0, 1);
    for (const Wrap wrap : {Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge}) {
        const Scene scene = masked_soup(wrap, Wrap::Repeat, 3);
        const Mesh& mesh = scene.meshes[0];
        const MeshCoverage coverage = coverage_of(scene).front();
        int counts[3] = {};
        for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
            ++counts[static_cast<int>(coverage[i])];
            int there = 0, gone = 0, there_around = 0, gone_around = 0;
            constexpr int kLookUps = 4000;
            for (int k = 0; k < kLookUps; ++k) {
                float b1 = uniform(random), b2 = uniform(random);
                if (b1 + b2 > 1) b1 = 1 - b1, b2 = 1 - b2;
                const Vec3 weights(1 - b1 - b2, b1, b2);
                const bool solid = surface_alpha(scene, mesh, i, weights) >= 0.5f;
                ++(solid ? there : gone);
                // uv_matrix scales by 1 at most; 3 texels further in any direction.
                const Vec2 uv = mesh.uv0[3 * i] * weights.x + mesh.uv0[3 * i + 1] * weights.y +
                                mesh.uv0[3 * i + 2] * weights.z;
                const Vec2 off(6 * uniform(random) - 3, 6 * uniform(random) - 3);
                const float alpha = sample_texture(scene, *scene.materials[0].base_color_texture,
                                                   uv + off / Vec2(96, 64))
                                        .a;
                there_around += alpha == 1;
                gone_around += alpha == 0;
            }
            if (coverage[i] == Coverage::Solid) {
                EXPECT_EQ(gone, 0) << i;
            }
            if (coverage[i] == Coverage::Clear) {
                EXPECT_EQ(there, 0) << i;
            }
            if (there_around == kLookUps) {
                EXPECT_EQ(coverage[i], Coverage::Solid) << i;
            }
            if (gone_around == kLookUps) {
                EXPECT_EQ(coverage[i], Coverage::Clear) << i;
            }
        }
        for (const int count : counts) EXPECT_GT(count, 30);
    }
}

/// Cut-offs that texels meet exactly: 51 / 255 is 0.2f, and a mask at 1 keeps what is wholly there.
TEST(Coverage, AlphaAtTheCutoffIsThere) {
    Mesh mesh = test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    mesh.uv0 = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    Scene scene = test::scene_of({mesh});
    scene.materials[0].alpha_mode = AlphaMode::Mask;
    scene.materials[0].base_color_texture = Texture{};
    scene.images.push_back({.name = "", .width = 1, .height = 1, .rgba = {0, 0, 0, 0}});
    const auto decided = [&](std::uint8_t texel, float cutoff, float factor = 1) {
        scene.images[0].rgba[3] = texel;
        scene.materials[0].alpha = factor;
        scene.materials[0].alpha_cutoff = cutoff;
        return coverage_of(scene).front().all;
    };
    EXPECT_EQ(decided(51, 0.2f), Coverage::Solid);
    EXPECT_EQ(decided(50, 0.2f), Coverage::Clear);
    EXPECT_EQ(decided(255, 1), Coverage::Solid);
    EXPECT_EQ(decided(254, 1), Coverage::Clear);
    EXPECT_EQ(decided(0, 0), Coverage::Solid);
    EXPECT_EQ(decided(255, 0.5f, 0.4f), Coverage::Clear);
    EXPECT_EQ(decided(255, 2), Coverage::Clear);  // a cut-off above 1 hides everything
}

TEST(Coverage, VertexColoursCount) {
    Mesh mesh = test::grid({0, 0, 0}, {3, 0, 0}, {0, 1, 0}, 1);
    test::append(mesh, test::grid({3, 0, 0}, {3, 0, 0}, {0, 1, 0}, 1));
    test::append(mesh, test::grid({6, 0, 0}, {3, 0, 0}, {0, 1, 0}, 1));
    for (std::size_t v = 0; v < mesh.vertex_count(); ++v)
        mesh.colors.push_back(Vec4(1, 1, 1, v < 4 ? 0.75f : v < 8 ? 0.25f : 0.125f * float(v - 4)));
    Scene scene = test::scene_of({mesh});
    scene.materials[0].alpha_mode = AlphaMode::Mask;
    const MeshCoverage coverage = coverage_of(scene).front();
    EXPECT_EQ(coverage[0], Coverage::Solid);
    EXPECT_EQ(coverage[1], Coverage::Solid);
    EXPECT_EQ(coverage[2], Coverage::Clear);
    EXPECT_EQ(coverage[3], Coverage::Clear);
    EXPECT_EQ(coverage[4], Coverage::Solid);  // 1/2 at its lowest corner
    scene.materials[0].alpha = 0.8f;
    EXPECT_EQ(coverage_of(scene).front()[4], Coverage::Holed);
}

/// Whatever texture coordinates hold: an answer, and a careful one.
TEST(Coverage, StrangeCoordinates) {
    for (const float strange : {1e30f, -1e8f, std::numeric_limits<float>::infinity(),
                                std::numeric_limits<float>::quiet_NaN(), 3e3f}) {
        Scene scene = masked_soup(Wrap::Repeat, Wrap::MirroredRepeat, 7);
        for (std::size_t v = 0; v < scene.meshes[0].vertex_count(); v += 3)
            scene.meshes[0].uv0[v].y = strange;
        const MeshCoverage coverage = coverage_of(scene).front();
        for (std::size_t i = 0; i < scene.meshes[0].triangle_count(); ++i)
            EXPECT_EQ(coverage[i], Coverage::Holed) << strange;
    }
    Scene scene = masked_soup(Wrap::Repeat, Wrap::Repeat, 7);
    scene.meshes[0].uv0.clear();  // the texel at (0, 0) everywhere
    const float corner = surface_alpha(scene, scene.meshes[0], 0, Vec3(1, 0, 0));
    const MeshCoverage coverage = coverage_of(scene).front();
    ASSERT_EQ(coverage.triangles.size(), scene.meshes[0].triangle_count());
    for (const Coverage c : coverage.triangles)
        EXPECT_EQ(c, corner == 1   ? Coverage::Solid
                     : corner == 0 ? Coverage::Clear
                                   : Coverage::Holed);
    scene.images[0].rgba.clear();  // not decoded: white
    EXPECT_EQ(coverage_of(scene).front().all, Coverage::Solid);
    EXPECT_TRUE(coverage_of(scene).front().triangles.empty());
}

TEST(Coverage, OnlyMasksHaveHoles) {
    Scene scene = masked_soup(Wrap::Repeat, Wrap::Repeat, 9);
    for (const AlphaMode mode : {AlphaMode::Opaque, AlphaMode::Blend}) {
        scene.materials[0].alpha_mode = mode;
        EXPECT_EQ(coverage_of(scene).front()[0], Coverage::Solid);
    }
}

TEST(Coverage, TheSameOnAnyNumberOfThreads) {
    const Scene scene = masked_soup(Wrap::Repeat, Wrap::Repeat, 11);
    const auto run = [&](int threads) {
        const ThreadLimit limit(threads);
        return coverage_of(scene).front().triangles;
    };
    EXPECT_EQ(run(1), run(2));
}

}  // namespace
}  // namespace envbake
