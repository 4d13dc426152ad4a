// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_environment.h"
#include "baker/input/read_scene.h"
#include "examples/sample_scene/rgbe.h"
#include "examples/sample_scene/scene.h"
#include "examples/sample_scene/sky.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

namespace envbake::sample {
namespace {

constexpr double kPi = std::numbers::pi;

/// Integral of the green channel, and of green times direction, over the sphere.
struct Moments {
    double total = 0;
    Vec3 centre{};
};

Moments moments(const SkyImage& image) {
    Moments m;
    for (int row = 0; row < image.height; ++row) {
        const double theta0 = kPi * row / image.height, theta1 = kPi * (row + 1) / image.height;
        const double d_omega = 2 * kPi / image.width * (std::cos(theta0) - std::cos(theta1));
        for (int column = 0; column < image.width; ++column) {
            const auto i = static_cast<std::size_t>(row * image.width + column);
            const double green = static_cast<double>(image.radiance[i][1]);
            const double theta = (theta0 + theta1) / 2;
            const double phi = 2 * kPi * ((column + 0.5) / image.width - 0.5);
            m.total += green * d_omega;
            m.centre = m.centre + green * d_omega *
                                      Vec3{std::sin(theta) * std::cos(phi), std::cos(theta),
                                           std::sin(theta) * std::sin(phi)};
        }
    }
    return m;
}

SkyOptions sized(int width, int height) {
    SkyOptions options;
    options.width = width;
    options.height = height;
    return options;
}

Moments sun_alone(const SkyOptions& options) {
    const auto texels =
        static_cast<std::size_t>(options.width) * static_cast<std::size_t>(options.height);
    SkyImage black{options.width, options.height,
                   std::vector<std::array<float, 3>>(texels, {0, 0, 0})};
    add_sun(options, black);
    return moments(black);
}

TEST(SampleSky, TheSunsEnergyDoesNotDependOnTheResolution) {
    const double half = kSunHalfAngleDeg * kPi / 180;
    const double expected = sun_radiance({}).y * 2 * kPi * (1 - std::cos(half));
    for (const auto& [width, height] : {std::pair{1, 1},
                                        {3, 2},
                                        {64, 32},
                                        {200, 100},
                                        {512, 256},
                                        {1024, 512},
                                        {1000, 250},
                                        {4096, 2048}}) {
        EXPECT_NEAR(sun_alone(sized(width, height)).total / expected, 1, 1e-4)
            << width << " x " << height;
    }
}

TEST(SampleSky, TheSunStandsWhereItIsSaidToStand) {
    for (const double elevation : {5.0, 36.0, 70.0, 89.9, 90.0}) {
        for (const double azimuth : {-180.0, 0.1, 140.0, 359.9}) {
            SkyOptions options = sized(1440, 720);
            options.sun_elevation_deg = elevation;
            options.sun_azimuth_deg = azimuth;
            const Moments sun = sun_alone(options);
            const Vec3 towards = normalize(sun.centre);
            // Texels are a quarter of a degree wide: their centres tell to a fraction of that.
            EXPECT_GT(dot(towards, sun_direction(options)), std::cos(0.15 * kPi / 180))
                << elevation << " " << azimuth;
        }
    }
    const Vec3 east = sun_direction([] {
        SkyOptions options;
        options.sun_elevation_deg = 30;
        options.sun_azimuth_deg = 90;
        return options;
    }());
    EXPECT_NEAR(east.y, 0.5, 1e-12);
    EXPECT_NEAR(east.z, std::sqrt(3) / 2, 1e-12);
}

TEST(SampleSky, ValuesArePlausible) {
    const SkyImage clear = make_sky(sized(256, 128));
    double largest = 0;
    for (const auto& texel : clear.radiance) {
        for (const float c : texel) {
            ASSERT_TRUE(std::isfinite(c));
            ASSERT_GE(c, 0);
        }
        largest = std::max(largest, static_cast<double>(texel[1]));
    }
    EXPECT_GT(largest, 5e3);  // at this size the sun is smeared over a texel or two
    EXPECT_GT(sun_radiance({}).y, 1e5);
    EXPECT_GT(sun_radiance({}).x, sun_radiance({}).z);  // reddened
    const Sky sky({});
    const Vec3 zenith = sky.radiance({0, 1, 0});
    EXPECT_GT(zenith.z, zenith.x);  // blue
    EXPECT_GT(zenith.y, 0.1);
    EXPECT_LT(zenith.y, 3);
}

// The CIE overcast sky: (1 + 2 sin elevation) / 3 of the zenith, the same in all azimuths.
TEST(SampleSky, Overcast) {
    SkyOptions options;
    options.overcast = true;
    const Sky sky(options);
    const double zenith = sky.radiance({0, 1, 0}).y;
    EXPECT_NEAR(sky.radiance({std::sqrt(0.75), 0.5, 0}).y / zenith, 2.0 / 3, 1e-12);
    EXPECT_NEAR(sky.radiance({0, 0.5, -std::sqrt(0.75)}).y / zenith, 2.0 / 3, 1e-12);
    EXPECT_NEAR(sky.radiance({1, 1e-9, 0}).y / zenith, 1.0 / 3, 1e-6);
    // Horizontal illuminance 0.3 + 21 sin e klx is pi 7 / 9 of the zenith's luminance.
    const double expected = (0.3 + 21 * std::sin(36 * kPi / 180)) * 9 / (7 * kPi) / 5;
    const Vec3 rgb = sky.radiance({0, 1, 0});
    EXPECT_NEAR(0.2126 * rgb.x + 0.7152 * rgb.y + 0.0722 * rgb.z, expected, 1e-3 * expected);
}

TEST(SampleHdr, RgbeRoundsToTheNearest) {
    using Rgbe = std::array<std::uint8_t, 4>;
    EXPECT_EQ(to_rgbe({0, 0, 0}), (Rgbe{0, 0, 0, 0}));
    EXPECT_EQ(to_rgbe({1, 0.5f, 0.25f}), (Rgbe{128, 64, 32, 129}));
    // 255.4 / 256 stays, 255.6 / 256 carries into the exponent.
    EXPECT_EQ(to_rgbe({255.4f / 256, 0, 0}), (Rgbe{255, 0, 0, 128}));
    EXPECT_EQ(to_rgbe({255.6f / 256, 0, 0}), (Rgbe{128, 0, 0, 129}));
    for (float v = 1e-6f; v < 1e7f; v *= 1.0137f) {
        const Rgbe e = to_rgbe({v, v * 0.3f, 0});
        const double decoded = std::ldexp(e[0], e[3] - 136);
        ASSERT_NEAR(decoded / static_cast<double>(v), 1, 1.0 / 256) << v;
        ASSERT_NEAR(std::ldexp(e[1], e[3] - 136), static_cast<double>(v) * 0.3,
                    static_cast<double>(v) / 256 * 1.0001);
    }
}

/// Reads what encode_hdr writes, by the description of the format alone.
std::vector<std::array<std::uint8_t, 4>> decode_hdr(const std::string& file, int width,
                                                    int height) {
    const std::string resolution = "-Y " + std::to_string(height) + " +X " + std::to_string(width);
    const std::size_t start = file.find("\n\n" + resolution + "\n");
    EXPECT_EQ(file.rfind("#?RADIANCE\n", 0), 0u);
    EXPECT_NE(file.find("FORMAT=32-bit_rle_rgbe\n"), std::string::npos);
    EXPECT_NE(start, std::string::npos);
    std::size_t at = start + resolution.size() + 3;
    const auto byte = [&]() -> std::size_t {
        if (at >= file.size()) {
            ADD_FAILURE() << "the file ends early";
            return 0;
        }
        return static_cast<unsigned char>(file[at++]);
    };
    std::vector<std::array<std::uint8_t, 4>> texels;
    const auto columns = static_cast<std::size_t>(width);
    for (int row = 0; row < height; ++row) {
        std::vector<std::array<std::uint8_t, 4>> line(columns);
        if (width >= 8) {
            EXPECT_EQ(byte(), 2u);
            EXPECT_EQ(byte(), 2u);
            const std::size_t high = byte();
            EXPECT_EQ(high * 256 + byte(), columns);
            for (std::size_t channel = 0; channel < 4; ++channel) {
                std::size_t column = 0;
                while (column < columns && !testing::Test::HasFailure()) {
                    const std::size_t count = byte();
                    const bool run = count > 128;
                    const std::size_t length = run ? count - 128 : count;
                    std::size_t value = run ? byte() : 0;
                    for (std::size_t i = 0; i < length; ++i) {
                        if (!run) value = byte();
                        if (column < columns)
                            line[column][channel] = static_cast<std::uint8_t>(value);
                        ++column;
                    }
                }
                EXPECT_EQ(column, columns);
            }
        } else {
            for (auto& texel : line)
                for (auto& channel : texel) channel = static_cast<std::uint8_t>(byte());
        }
        texels.insert(texels.end(), line.begin(), line.end());
    }
    EXPECT_EQ(at, file.size());
    return texels;
}

TEST(SampleHdr, FileHoldsTheImage) {
    for (const auto& [width, height] : {std::pair{300, 20}, {8, 4}, {7, 3}, {1, 1}}) {
        const SkyImage image = make_sky(sized(width, height));
        const auto texels = decode_hdr(encode_hdr(image), width, height);
        ASSERT_EQ(texels.size(), image.radiance.size());
        for (std::size_t i = 0; i < texels.size(); ++i)
            ASSERT_EQ(texels[i], to_rgbe(image.radiance[i])) << i;
    }
}

Vec3 to_double(const std::array<float, 3>& v) {
    return {v[0], v[1], v[2]};
}

TEST(SampleTerrace, NormalsAreUnitAndAgreeWithTheWinding) {
    const Scene scene = make_terrace();
    std::size_t vertex_count = 0;
    for (const Node& node : scene.nodes)
        vertex_count += scene.meshes[static_cast<std::size_t>(node.mesh)].mesh.positions.size();
    EXPECT_GT(vertex_count, 30'000u);
    EXPECT_LT(vertex_count, 65'000u);
    for (const NamedMesh& named : scene.meshes) {
        const Mesh& mesh = named.mesh;
        ASSERT_EQ(mesh.positions.size(), mesh.normals.size());
        for (const auto& n : mesh.normals) ASSERT_NEAR(length(to_double(n)), 1, 1e-6) << named.name;
        double worst = 1;
        for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
            const std::uint32_t* t = &mesh.triangles[i];
            const Vec3 a = to_double(mesh.positions[t[0]]);
            const Vec3 area =
                cross(to_double(mesh.positions[t[1]]) - a, to_double(mesh.positions[t[2]]) - a);
            ASSERT_GT(length(area), 0) << named.name;
            for (int k = 0; k < 3; ++k)
                worst = std::min(worst, dot(normalize(area), to_double(mesh.normals[t[k]])));
        }
        EXPECT_GT(worst, 0.8) << named.name;  // no normal leans more than 37 degrees off its face
    }
}

// A closed surface seen from outside has positive volume, and the volume tells its winding.
TEST(SampleTerrace, SolidsFaceOutwards) {
    const auto volume = [](const Mesh& mesh) {
        double sum = 0;
        for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
            sum += dot(to_double(mesh.positions[mesh.triangles[i]]),
                       cross(to_double(mesh.positions[mesh.triangles[i + 1]]),
                             to_double(mesh.positions[mesh.triangles[i + 2]]))) /
                   6;
        }
        return sum;
    };
    EXPECT_NEAR(volume(make_sphere(2, 96)), 4.0 / 3 * kPi * 8, 0.1);
    EXPECT_NEAR(volume(make_torus(2, 0.5, 128, 64)), 2 * kPi * kPi * 2 * 0.25, 0.05);
    EXPECT_NEAR(volume(make_rounded_box({2, 3, 4}, 0.05, 4, 6)), 24, 0.1);
    // The tube of a knot: its cross-section times its length, which is at least that of its winds.
    EXPECT_GT(volume(make_torus_knot(2, 3, 0.44, 0.21, 0.1, 256, 24)),
              kPi * 0.01 * 2 * 2 * kPi * 0.44 * 0.95);
    for (const NamedMesh& named : make_terrace().meshes) {
        const bool solid = named.name == "column" || named.name == "vase" ||
                           named.name == "entablature" || named.name == "ground";
        if (solid) {
            EXPECT_GT(volume(named.mesh), 0) << named.name;
        }
    }
}

/// A file of the test that goes with the object.
struct TemporaryFile {
    std::filesystem::path path;
    TemporaryFile(const char* name, const std::string& bytes)
        : path(std::filesystem::path(testing::TempDir()) / name) {
        std::ofstream(path, std::ios::binary) << bytes;
    }
    ~TemporaryFile() { std::filesystem::remove(path); }
};

TEST(SampleFiles, TheSceneReadsBack) {
    const Scene scene = make_terrace();
    const TemporaryFile file("envbake_sample_scene.glb", encode_glb(scene));
    const auto read = read_scene(file.path);
    ASSERT_TRUE(read) << read.error();
    EXPECT_TRUE(read->notes.empty()) << read->notes.front();
    ASSERT_EQ(read->meshes.size(), scene.nodes.size());
    for (std::size_t i = 0; i < scene.nodes.size(); ++i) {
        const Node& node = scene.nodes[i];
        const NamedMesh& source = scene.meshes[static_cast<std::size_t>(node.mesh)];
        const envbake::Mesh& mesh = read->meshes[i];
        EXPECT_EQ(mesh.node_name, node.name);
        EXPECT_EQ(mesh.mesh_name, source.name);
        EXPECT_EQ(read->materials[static_cast<std::size_t>(mesh.material)].name,
                  scene.materials[static_cast<std::size_t>(source.material)].name);
        ASSERT_EQ(mesh.vertex_count(), source.mesh.positions.size());
        ASSERT_EQ(mesh.triangles, source.mesh.triangles);
        EXPECT_FALSE(mesh.normals_computed);
        // A turn about +Y takes +X towards -Z.
        const double yaw = node.yaw_deg * kPi / 180;
        for (std::size_t v = 0; v < mesh.vertex_count(); v += 7) {
            const Vec3 p = to_double(source.mesh.positions[v]);
            ASSERT_NEAR(mesh.positions[v].x,
                        std::cos(yaw) * p.x + std::sin(yaw) * p.z + node.translation.x, 1e-5);
            ASSERT_NEAR(mesh.positions[v].y, p.y + node.translation.y, 1e-5);
            ASSERT_NEAR(mesh.positions[v].z,
                        std::cos(yaw) * p.z - std::sin(yaw) * p.x + node.translation.z, 1e-5);
        }
    }
}

TEST(SampleFiles, TheSkyReadsBack) {
    const SkyOptions options = sized(256, 128);
    const SkyImage image = make_sky(options);
    const TemporaryFile file("envbake_sample_sky.hdr", encode_hdr(image));
    const auto read = read_environment(file.path);
    ASSERT_TRUE(read) << read.error();
    EXPECT_EQ(read->repairs.total(), 0u);
    ASSERT_EQ(read->radiance.size(), image.radiance.size());
    for (std::size_t i = 0; i < image.radiance.size(); ++i) {
        const auto largest =
            std::max({image.radiance[i][0], image.radiance[i][1], image.radiance[i][2]});
        for (int c = 0; c < 3; ++c) {
            ASSERT_NEAR(read->radiance[i][c], image.radiance[i][static_cast<std::size_t>(c)],
                        largest / 255);
        }
    }
    // The sun is where the environment's own convention has its direction.
    const Vec3 sun = sun_direction(options);
    EXPECT_GT(radiance_towards(*read, {sun.x, sun.y, sun.z}).y, 1000);
}

}  // namespace
}  // namespace envbake::sample
