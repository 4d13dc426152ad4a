// SPDX-License-Identifier: Apache-2.0
#include "baker/render/preview.h"

#include "baker/render/compare.h"
#include "baker/render/reference.h"
#include "envbake/format/writer.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/render/test_scenes.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <span>
#include <string>
#include <vector>

namespace envbake {
namespace {

constexpr double kPi = std::numbers::pi;

/// What a test puts into a bundle; empty: left out.
struct Contents {
    int bands = 2;
    std::vector<float> lighting;                ///< [bands^2, 3]
    std::vector<std::vector<float>> transport;  ///< a mesh each, [vertices, bands^2]
    std::vector<float> mip;                     ///< one level, [6, 1, 1, 3]
    std::vector<float> table;                   ///< [2, 2, 2]
    std::vector<float> light;                   ///< one row of nine, extracted
};

/// Writes a bundle for `scene` and opens it; the file goes with the object.
class TestBundle {
  public:
    TestBundle(const Scene& scene, const Contents& contents)
        : path_(testing::TempDir() + "envbake_preview_" +
                testing::UnitTest::GetInstance()->current_test_info()->name() + "_" +
                std::to_string(counter_++) + ".envb") {
        write(scene, contents);
        auto opened = runtime::Bundle::open(path_.c_str());
        if (opened)
            bundle_.emplace(std::move(*opened));
        else
            ADD_FAILURE() << path_ << " cannot be opened";
    }
    ~TestBundle() {
        bundle_.reset();
        std::remove(path_.c_str());
    }
    const runtime::Bundle& get() const { return *bundle_; }

  private:
    void write(const Scene& scene, const Contents& contents) {
        auto writer = format::Writer::create(path_);
        ASSERT_TRUE(writer);
        const auto add = [&](const std::string& name, std::vector<std::uint64_t> shape,
                             const std::vector<float>& values) {
            if (values.empty()) return;
            ASSERT_TRUE(writer->add(name, std::move(shape), std::span<const float>(values)));
        };
        const auto coeffs = static_cast<std::uint64_t>(sh::coeff_count(contents.bands));
        add("environment/sh", {coeffs, 3}, contents.lighting);
        add("environment/lights", {1, 9}, contents.light);
        add("environment/mips/0", {6, 1, 1, 3}, contents.mip);
        add("brdf/ggx", {2, 2, 2}, contents.table);
        std::string meshes;
        for (std::size_t i = 0; i < scene.meshes.size(); ++i) {
            const std::uint64_t vertices = scene.meshes[i].vertex_count();
            if (i < contents.transport.size()) {
                add("mesh/" + std::to_string(i) + "/diffuse", {vertices, coeffs},
                    contents.transport[i]);
            }
            meshes += i == 0 ? "" : ",";
            meshes += R"({"node":0,"node_name":"n","mesh":0,"mesh_name":"m","primitive":0,)";
            meshes += "\"vertex_count\":" + std::to_string(vertices) + "}";
        }
        std::string metadata = "{\"meshes\":[" + meshes + "]";
        if (!contents.mip.empty()) {
            metadata +=
                R"(,"environment":{"mips":{"count":1,"levels":[{"level":0,"face_size":1,"roughness":0}]}})";
        }
        if (!contents.light.empty()) metadata += R"(,"environment":{"lights":{"extracted":true}})";
        if (!contents.table.empty()) metadata += R"(,"brdf":{"ggx":{"axes":"roots"}})";
        metadata += "}";
        ASSERT_TRUE(writer->add(
            "metadata", {metadata.size()},
            std::span<const std::uint8_t>(reinterpret_cast<const std::uint8_t*>(metadata.data()),
                                          metadata.size())));
        ASSERT_TRUE(writer->finish());
    }

    static inline int counter_ = 0;
    std::string path_;
    std::optional<runtime::Bundle> bundle_;
};

/// Unoccluded transport of a direction: A_l Y_i(n) / pi.
void append_unoccluded(int bands, const Vec3& n, std::vector<float>& row) {
    std::vector<double> basis(static_cast<std::size_t>(sh::coeff_count(bands)));
    sh::evaluate(bands, static_cast<double>(n.x), static_cast<double>(n.y),
                 static_cast<double>(n.z), basis.data());
    for (int l = 0; l < bands; ++l)
        for (int m = -l; m <= l; ++m)
            row.push_back(static_cast<float>(sh::clamped_cosine(l) / kPi *
                                             basis[static_cast<std::size_t>(sh::index(l, m))]));
}

Contents unoccluded(const Scene& scene, int bands) {
    Contents contents;
    contents.bands = bands;
    for (const Mesh& mesh : scene.meshes) {
        contents.transport.emplace_back();
        for (const Vec3& n : mesh.normals) append_unoccluded(bands, n, contents.transport.back());
    }
    return contents;
}

/// Light of radiance (r, g, b) from everywhere.
std::vector<float> constant_light(int bands, Vec3 radiance) {
    std::vector<float> coeffs(3 * static_cast<std::size_t>(sh::coeff_count(bands)));
    for (int c = 0; c < 3; ++c)
        coeffs[static_cast<std::size_t>(c)] = static_cast<float>(2 * std::sqrt(kPi)) * radiance[c];
    return coeffs;
}

Expected<Picture> preview(const Scene& scene, const runtime::Bundle& bundle, const Camera& camera,
                          const PreviewOptions& options = {}) {
    ENVBAKE_TRY(const Tracer tracer, Tracer::build(scene));
    Progress progress;
    return render_preview(scene, tracer, bundle, camera, options, progress);
}

const Camera kFromAbove{{0, 3, 1}, {0, 0, 0}, 10, 8, 6};

TEST(Preview, ConstantLightOnAFloorIsItsAlbedo) {
    Scene scene = test::scene_of(test::diffuse_material(0.5f));
    test::add_floor(scene, 10);
    Contents contents = unoccluded(scene, 3);
    contents.lighting = constant_light(3, Vec3(1, 2, 3));
    const TestBundle bundle(scene, contents);
    const auto picture = preview(scene, bundle.get(), kFromAbove);
    ASSERT_TRUE(picture) << picture.error();
    for (std::size_t i = 0; i < picture->radiance.size(); ++i) {
        EXPECT_NEAR(picture->radiance[i].x, 0.5, 1e-5);
        EXPECT_NEAR(picture->radiance[i].z, 1.5, 1e-5);
        EXPECT_TRUE(picture->is_surface(i));
    }
    // White paper instead: albedo 1.
    const auto white = preview(scene, bundle.get(), kFromAbove, {.white_lambert = true});
    ASSERT_TRUE(white);
    EXPECT_NEAR(white->radiance[0].y, 2, 1e-5);
}

// Without transport the irradiance stands in, and there is no shadow: the same answer here.
TEST(Preview, AMeshWithoutTransportIsLitByItsNormals) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_floor(scene, 10);
    Contents contents;
    contents.lighting = constant_light(2, Vec3(1));
    contents.lighting[3 * static_cast<std::size_t>(sh::index(1, -1))] = 1;
    const TestBundle bundle(scene, contents);
    const auto picture = preview(scene, bundle.get(), kFromAbove);
    ASSERT_TRUE(picture) << picture.error();
    EXPECT_NEAR(picture->radiance[0].x, 1 + 2.0 / 3 * std::sqrt(3 / (4 * kPi)), 1e-5);
    EXPECT_NEAR(picture->radiance[0].y, 1, 1e-5);
    EXPECT_TRUE(picture->is_surface(0));
    const auto white = preview(scene, bundle.get(), kFromAbove, {.white_lambert = true});
    ASSERT_TRUE(white);
    EXPECT_FALSE(white->is_surface(0));
}

// Exit radiance linear in x at the vertices is linear in x in between.
TEST(Preview, InterpolatesBetweenVertices) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_floor(scene, 2);
    Contents contents;
    contents.bands = 1;
    contents.lighting = {1, 1, 1};
    contents.transport.emplace_back();
    for (const Vec3& p : scene.meshes[0].positions) contents.transport[0].push_back(5 + p.x);
    const TestBundle bundle(scene, contents);
    for (const double x : {-1.5, -0.2, 0.7, 1.3}) {
        const Camera camera{{x, 3, 0.4}, {x, 0, 0.4}, 0.01, 2, 2};
        const auto picture = preview(scene, bundle.get(), camera);
        ASSERT_TRUE(picture) << picture.error();
        EXPECT_NEAR(picture->radiance[0].y, 5 + x, 1e-3);
    }
}

// A light straight above a floor, half of which is under a roof; the light is in no other array.
TEST(Preview, ExtractedLightsAreAddedWithTheirShadows) {
    Scene scene = test::scene_of(test::diffuse_material(0.5f));
    test::add_floor(scene, 10);
    test::add_quad(scene, Vec3(-5, 1, 0), Vec3(0, 0, 5), Vec3(5, 0, 0));
    Contents contents = unoccluded(scene, 2);
    contents.lighting = constant_light(2, Vec3(1));
    contents.light = {0, 1, 0, 6, 4, 2, 0.01f, 3.1e-4f, 0.5f};
    const TestBundle bundle(scene, contents);
    const auto towards = [&](const DVec3& from, const DVec3& at) {
        const auto picture = preview(scene, bundle.get(), {from, at, 0.01, 1, 1});
        EXPECT_TRUE(picture);
        return picture->radiance[0];
    };
    const Vec3 lit = towards({3, 3, 0.1}, {3, 0, 0}), shadow = towards({3, 0.5, 0.1}, {-3, 0, 0});
    EXPECT_NEAR(lit.x, 0.5 * (1 + 6 / kPi), 1e-5);
    EXPECT_NEAR(lit.z, 0.5 * (1 + 2 / kPi), 1e-5);
    EXPECT_NEAR(shadow.x, 0.5, 1e-5);
    const Vec3 sky = towards({3, 3, 0}, {3, 4, 0.02}), disc = towards({3, 3, 0}, {3, 4, 0});
    EXPECT_NEAR(sky.x, 1, 1e-5);
    EXPECT_NEAR(disc.x / (1 + 6 / 3.1e-4), 1, 1e-5);
}

TEST(Preview, SpecularIsTheSplitSum) {
    Material material = test::diffuse_material(0.5f);
    material.dielectric_r0 = Vec3(0.2f);
    material.emission = Vec3(0, 0, 7);
    Scene scene = test::scene_of(material);
    test::add_floor(scene, 10);
    Contents contents = unoccluded(scene, 2);
    contents.lighting = constant_light(2, Vec3(1));
    contents.mip.assign(18, 2.0f);
    contents.table = {0.5f, 0.1f, 0.5f, 0.1f, 0.5f, 0.1f, 0.5f, 0.1f};
    const TestBundle bundle(scene, contents);
    const auto picture = preview(scene, bundle.get(), kFromAbove);
    ASSERT_TRUE(picture) << picture.error();
    const double expected = 0.5 + 2 * (0.2 * 0.5 + 0.1);
    EXPECT_NEAR(picture->radiance[5].x, expected, 1e-5);
    EXPECT_NEAR(picture->radiance[5].z, expected + 7, 1e-5);
}

TEST(Preview, NegativeLightIsCutExceptOnWhitePaper) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_floor(scene, 10);
    Contents contents = unoccluded(scene, 1);
    contents.lighting = {-1, -1, -1};
    const TestBundle bundle(scene, contents);
    const auto cut = preview(scene, bundle.get(), kFromAbove);
    const auto kept = preview(scene, bundle.get(), kFromAbove, {.white_lambert = true});
    ASSERT_TRUE(cut && kept);
    EXPECT_EQ(cut->radiance[0].x, 0);
    EXPECT_NEAR(kept->radiance[0].x, -1 / (2 * std::sqrt(kPi)), 1e-6);
}

TEST(Preview, BackgroundIsTheMipElseTheSh) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_quad(scene, Vec3(0, 0, 100), Vec3(1, 0, 0), Vec3(0, 1, 0));  // behind the camera
    const Camera camera{{0, 0, 0}, {0, 0, -1}, 30, 4, 4};
    Contents contents = unoccluded(scene, 2);
    contents.lighting = constant_light(2, Vec3(0.25f));
    {
        const TestBundle bundle(scene, contents);
        const auto picture = preview(scene, bundle.get(), camera);
        ASSERT_TRUE(picture) << picture.error();
        EXPECT_NEAR(picture->radiance[3].y, 0.25, 1e-6);
        EXPECT_EQ(picture->surface[3], 0);
    }
    contents.mip.assign(18, 3.0f);
    const TestBundle bundle(scene, contents);
    const auto picture = preview(scene, bundle.get(), camera);
    ASSERT_TRUE(picture) << picture.error();
    EXPECT_NEAR(picture->radiance[3].y, 3, 1e-6);
}

// What is round about +Y looks the same from a camera that turns with the light: SH, mips, lights
// and background must all turn, and the same way.
TEST(Preview, TurnedLightIsSeenByATurnedCamera) {
    Material material = test::diffuse_material(0.5f);
    material.dielectric_r0 = Vec3(0.3f);
    Scene scene = test::scene_of(material);
    test::add_sphere(scene, Vec3(0), 1, 64);
    Contents contents = unoccluded(scene, 3);
    for (int i = 0; i < 27; ++i)
        contents.lighting.push_back(i < 3 ? 9.0f : static_cast<float>(i * 7 % 5) - 2);
    Contents with_mips = contents, with_light = contents;
    for (int i = 0; i < 18; ++i) with_mips.mip.push_back(static_cast<float>(i * 5 % 7));
    with_mips.table = {0.5f, 0.1f, 0.5f, 0.1f, 0.5f, 0.1f, 0.5f, 0.1f};
    with_light.light = {0.6f, 0.48f, 0.64f, 6, 4, 2, 0.3f, 0.28f, 0.5f};

    const LightTurn quarter(kPi / 2);
    const Camera camera{{1, 2, 6}, {0, 0.2, 0}, 35, 16, 12};
    Camera turned = camera;
    turned.position = quarter.turned(camera.position);
    EXPECT_NEAR(turned.position.x, 6, 1e-12);
    EXPECT_NEAR(turned.position.z, -1, 1e-12);
    for (const Contents& each : {with_mips, with_light}) {
        const TestBundle bundle(scene, each);
        const auto before = preview(scene, bundle.get(), camera);
        const auto after = preview(scene, bundle.get(), turned, {.light_turn = quarter});
        const auto unturned = preview(scene, bundle.get(), turned);
        ASSERT_TRUE(before && after && unturned);
        double other = 0;
        for (std::size_t i = 0; i < before->radiance.size(); ++i) {
            for (int c = 0; c < 3; ++c) {
                EXPECT_NEAR(after->radiance[i][c], before->radiance[i][c], 2e-3f) << i;
                other += std::abs(static_cast<double>(unturned->radiance[i][c]) -
                                  static_cast<double>(before->radiance[i][c]));
            }
        }
        EXPECT_GT(other, 10);
    }
}

TEST(Preview, RefusesTheBundleOfAnotherScene) {
    Scene scene = test::scene_of(test::diffuse_material(1));
    test::add_floor(scene, 10);
    Contents contents = unoccluded(scene, 2);
    contents.lighting = constant_light(2, Vec3(1));
    const TestBundle bundle(scene, contents);

    Scene more = scene;
    test::add_floor(more, 1);
    const auto meshes = preview(more, bundle.get(), kFromAbove);
    ASSERT_FALSE(meshes);
    EXPECT_EQ(meshes.error().code, Errc::InvalidBundle);

    Scene denser = scene;
    denser.meshes[0].positions.push_back(Vec3(0));
    denser.meshes[0].normals.push_back(Vec3(0, 1, 0));
    const auto vertices = preview(denser, bundle.get(), kFromAbove);
    ASSERT_FALSE(vertices);
    EXPECT_NE(vertices.error().message.find("5 vertices"), std::string::npos)
        << vertices.error().message;

    contents.lighting.clear();
    const TestBundle dark(scene, contents);
    const auto no_light = preview(scene, dark.get(), kFromAbove);
    ASSERT_FALSE(no_light);
    EXPECT_EQ(no_light.error().code, Errc::InvalidBundle);
}

// A lone sphere has no shadows, so its transport is known. Preview and reference then see the same
// light through code that shares only the lines of sight; what is left is interpolation.
TEST(Preview, AgreesWithTheReferenceOnASphere) {
    Scene scene = test::scene_of(test::diffuse_material(0.3f));
    test::add_sphere(scene, Vec3(0.4f, 0, 0), 1, 128);
    Contents contents = unoccluded(scene, 3);
    std::vector<Vec3> light;
    for (int i = 0; i < 9; ++i)
        light.push_back(Vec3(DVec3(3.0 / (i + 1), i % 3 - 0.8, 1.0 + (i * 7 % 5) / 4.0)));
    for (const Vec3& c : light) contents.lighting.insert(contents.lighting.end(), {c.x, c.y, c.z});
    const TestBundle bundle(scene, contents);
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer);
    const Camera camera = frame_scene(scene, *tracer, 24, 24);
    const auto picture = preview(scene, bundle.get(), camera, {.white_lambert = true});
    ASSERT_TRUE(picture) << picture.error();
    Progress progress;
    const Reference reference = render_reference(
        scene, *tracer, test::constant_environment(1), camera,
        {.samples_per_pixel = 4096, .white_lambert = true, .truncated_light = light}, progress);
    ASSERT_TRUE(reference.truncated.has_value());
    const Comparison comparison = compare(*picture, *reference.truncated);
    EXPECT_GT(comparison.pixel_count, 200u);
    // The facets of a real sphere block a little of what grazes it; measured 0.4 %.
    EXPECT_LT(comparison.relative_rmse, 0.01);
    EXPECT_LT(reference.truncated_noise_rms, 0.01);
}

}  // namespace
}  // namespace envbake
