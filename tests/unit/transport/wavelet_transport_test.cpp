// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/wavelet_transport.h"

#include "baker/core/parallel.h"
#include "baker/transport/wavelet_block.h"
#include "envbake/runtime/shade.h"
#include "envbake/runtime/wavelet.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <random>

namespace envbake {
namespace {

using std::numbers::pi;

struct Looked {
    std::vector<float> texels;
    int rays = 0;
    RayOrigin origin;
};

Looked look_from(const Scene& scene, std::uint32_t vertex, const CubeTexels& cube,
                 Look look = Look::AtOutlines) {
    const auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    const SurfacePoints points(scene.meshes[0]);
    Looked looked;
    looked.texels.assign(wavelet::coeff_count(cube.face_size), NAN);
    looked.origin = points.origin(points.representative(vertex), tracer->space());
    looked.rays = texel_transport(cube, *tracer, looked.origin, looked.texels, look);
    return looked;
}

/// Under a light of radiance f(w), by a texel's centre: the light, and not the transport, is
/// approximate.
template <class Light>
double exit_radiance(const std::vector<float>& texels, int n, Light f) {
    double sum = 0;
    for (std::size_t t = 0; t < texels.size(); ++t) {
        const int i = static_cast<int>(t);
        const int face = i / (n * n), row = i / n % n, column = i % n;
        const auto w = cube::texel_direction<double>(static_cast<cube::Face>(face), row, column, n);
        sum += cube::texel_solid_angle(row, column, n) * static_cast<double>(texels[t]) *
               f(DVec3(w[0], w[1], w[2]));
    }
    return sum;
}

const auto kConstant = [](const DVec3&) { return 1.0; };

TEST(CubeTexels, MeanDirectionsAddUpToNothingAndHalfOfThemToADisc) {
    const CubeTexels cube(16);
    const std::size_t count = wavelet::coeff_count(16);
    DVec3 sum(0);
    double up = 0;
    for (std::size_t t = 0; t < count; ++t) {
        const int i = static_cast<int>(t);
        const double d_omega = cube::texel_solid_angle(i / 16 % 16, i % 16, 16);
        const DVec3 mean(cube.mean_x[t], cube.mean_x[count + t], cube.mean_x[2 * count + t]);
        sum += mean * d_omega;
        up += std::max(0.0, mean.y) * d_omega;  // the horizon runs along texels
    }
    EXPECT_NEAR(glm::length(sum), 0, 1e-6);
    EXPECT_NEAR(up, pi, 1e-6);  // integral of max(0, y) over the sphere
}

TEST(TexelTransport, OpenPlaneUnderAConstantLightIsOne) {
    const DVec3 tilted = glm::normalize(DVec3(0.3, 0.8, -0.5));
    for (const DVec3& n : {DVec3(0, 1, 0), tilted}) {
        const Vec3 u(glm::normalize(glm::cross(n, DVec3(1, 0, 0))));
        const Scene scene = test::scene_of({test::quad(Vec3(0), u, glm::cross(Vec3(n), u))});
        for (const int size : {16, 64}) {
            const CubeTexels cube(size);
            // What counting n.w as evenly spread at the horizon costs.
            const double tolerance = 0.2 / (size * size);
            Looked looked = look_from(scene, 0, cube);
            EXPECT_NEAR(exit_radiance(looked.texels, size, kConstant), 1, tolerance);
            open_texel_transport(cube, n, looked.texels);
            EXPECT_NEAR(exit_radiance(looked.texels, size, kConstant), 1, tolerance);
        }
    }
}

/// E2: at the foot of a wall half of the sky is left, and of its first moment, 1/pi times the
/// integral of V cos x = 0.325735007935 / sqrt(3 / 4 pi) / pi.
TEST(TexelTransport, FootOfAWallIsTheClosedForm) {
    const Scene scene = test::scene_of({test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}),
                                        test::quad({0, -1e4f, -1}, {0, 2e4f, 0}, {0, 0, 1e4f})});
    const CubeTexels cube(64);
    const Looked looked = look_from(scene, 0, cube);
    EXPECT_NEAR(exit_radiance(looked.texels, 64, kConstant), 0.5, 1e-3);
    const double moment = exit_radiance(looked.texels, 64, [](const DVec3& w) { return w.x; });
    EXPECT_NEAR(moment, 0.325735007935 / std::sqrt(3 / (4 * pi)) / pi, 1e-3);
    EXPECT_LT(looked.rays, look_from(scene, 0, cube, Look::Everywhere).rays / 3);
}

/// E5: a sphere of half-angle 20 degrees at zenith angle 50 blocks pi sin^2 a cos t = 0.236222.
/// Its outline among texels is a matter of luck, 1 % of it either way: the mean of 12 tells more.
TEST(TexelTransport, SphereBlocksTheClosedForm) {
    const double t = 50 * pi / 180, a = 20 * pi / 180;
    const CubeTexels cube(64);
    double mean = 0;
    for (int k = 0; k < 12; ++k) {
        const double phi = 2 * pi * (k + 0.3) / 12;
        const DVec3 towards(std::sin(t) * std::cos(phi), std::sin(t) * std::sin(phi), std::cos(t));
        const Scene scene =
            test::scene_of({test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}),
                            test::sphere(Vec3(towards * 3.0), 3 * float(std::sin(a)), 5)});
        const Looked looked = look_from(scene, 0, cube);
        const double blocked = pi * (1 - exit_radiance(looked.texels, 64, kConstant));
        EXPECT_NEAR(blocked / 0.23622221569, 1, 1e-2) << k;
        mean += blocked / 12;
    }
    EXPECT_NEAR(mean / 0.23622221569, 1, 2e-3);
}

/// What is overlooked are the tips that an outline puts into a block between its points: here, 32
/// texels of some 500 that outlines cross.
TEST(TexelTransport, LookingAtOutlinesIsLookingEverywhere) {
    const Scene scene =
        test::scene_of({test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}),
                        test::sphere({0.5f, 0.3f, 1}, 0.4f, 3), test::sphere({-2, 1, 1}, 0.9f, 3)});
    const CubeTexels cube(32);
    const Looked fast = look_from(scene, 0, cube),
                 slow = look_from(scene, 0, cube, Look::Everywhere);
    EXPECT_LT(fast.rays, slow.rays / 2);
    std::size_t different = 0;
    for (std::size_t i = 0; i < fast.texels.size(); ++i)
        different += fast.texels[i] != slow.texels[i];
    EXPECT_LE(different, 48u);
    EXPECT_NEAR(exit_radiance(fast.texels, 32, kConstant),
                exit_radiance(slow.texels, 32, kConstant), 1e-3);
    EXPECT_GT(std::count(fast.texels.begin(), fast.texels.end(), 0.0f), 3000);
}

runtime::WaveletTransportView view_of(const std::vector<std::uint32_t>& words,
                                      const std::vector<std::uint32_t>& offsets,
                                      std::uint64_t vertices) {
    return {.vertex_count = vertices,
            .face_size = 16,
            .step = 0.5f,
            .offsets = offsets,
            .words = words};
}

std::vector<std::uint32_t> words_of(const std::vector<std::byte>& bytes) {
    std::vector<std::uint32_t> words(bytes.size() / 4);
    std::memcpy(words.data(), bytes.data(), bytes.size());
    return words;
}

/// Whatever is stored comes back, number for number: noise, every size of number, gaps, both ends.
TEST(WaveletBlock, ShadingReadsWhatWasStored) {
    std::mt19937 random(1);
    std::vector<std::vector<WaveletEntry>> rows(256);
    for (auto& row : rows)
        for (std::uint32_t index = 0; index < 6 * 256; ++index) {
            const int size = static_cast<int>(random() % 16);
            const int units =
                size == 0 ? 0 : static_cast<int>(random() % (1u << size)) - (1 << size) / 2;
            if (units != 0 && random() % 4 != 0)
                row.push_back({index, static_cast<std::int16_t>(units)});
        }
    rows[0] = {{0, 32639}, {1535, -32639}};
    rows[7].clear();
    const std::vector<std::uint32_t> words = words_of(encode_wavelet_block(rows));
    const std::vector<std::uint32_t> offsets{0, static_cast<std::uint32_t>(words.size())};
    const runtime::WaveletTransportView view = view_of(words, offsets, 256);
    for (const std::uint32_t index : {0u, 1u, 700u, 1535u}) {
        const wavelet::Term term{index, {2, -4, 0}};
        std::vector<runtime::Rgb> out(256, {NAN, NAN, NAN});
        runtime::diffuse_exit(view, {&term, 1}, 0, out);
        for (std::size_t v = 0; v < 256; ++v) {
            float expected = 0;
            for (const WaveletEntry& e : rows[v])
                if (e.index == index) expected = e.units;
            EXPECT_EQ(out[v], (runtime::Rgb{expected, -2 * expected, 0})) << index << ' ' << v;
        }
    }
}

TEST(WaveletBlock, RangesOfVerticesAndTermsAddUp) {
    std::vector<std::uint32_t> words, offsets{0};
    for (int block = 0; block < 3; ++block) {
        std::vector<std::vector<WaveletEntry>> rows(block < 2 ? 256 : 10);
        for (std::size_t v = 0; v < rows.size(); ++v)
            rows[v] = {{3, static_cast<std::int16_t>(256 * block + static_cast<int>(v) + 1)},
                       {9, 2}};
        const auto more = words_of(encode_wavelet_block(rows));
        words.insert(words.end(), more.begin(), more.end());
        offsets.push_back(static_cast<std::uint32_t>(words.size()));
    }
    const runtime::WaveletTransportView view = view_of(words, offsets, 522);
    const std::vector<wavelet::Term> terms{{3, {2, 0, 0}}, {4, {9, 9, 9}}, {9, {0, 1, 0}}};
    std::vector<runtime::Rgb> out(300, {NAN, NAN, NAN});
    runtime::diffuse_exit(view, terms, 250, out);
    for (std::size_t i = 0; i < out.size(); ++i) {
        const auto vertex = static_cast<float>(250 + i);
        const runtime::Rgb expected = i < 272 ? runtime::Rgb{vertex + 1, 1, 0} : runtime::Rgb{};
        EXPECT_EQ(out[i], expected) << i;
    }
}

/// Every word of a block is damaged: nothing is read beyond it (sanitizers see to that), and what
/// is shaded is finite.
TEST(WaveletBlock, DamagedBlocksAreNotReadBeyond) {
    const std::vector<std::vector<WaveletEntry>> rows{{{0, 300}, {5, -1}}, {{5, 77}}};
    const std::vector<std::uint32_t> good = words_of(encode_wavelet_block(rows));
    const std::vector<wavelet::Term> terms{{0, {1, 1, 1}}, {5, {1, 1, 1}}};
    for (std::size_t size = 0; size <= good.size(); ++size)
        for (std::size_t at = 0; at < good.size(); ++at)
            for (const std::uint32_t value : {0u, 1u, 3u, 0x7fffffffu, 0xffffffffu}) {
                std::vector<std::uint32_t> words(good.begin(),
                                                 good.begin() + static_cast<std::ptrdiff_t>(size));
                words.shrink_to_fit();
                if (at < size) words[at] = value;
                const std::vector<std::uint32_t> offsets{0, static_cast<std::uint32_t>(size)};
                std::vector<runtime::Rgb> out(2);
                runtime::diffuse_exit(view_of(words, offsets, 2), terms, 0, out);
                for (const auto& rgb : out) EXPECT_TRUE(std::isfinite(rgb[0]));
            }
}

struct Baked {
    std::vector<std::byte> bytes;
    std::vector<std::uint32_t> offsets;
    std::vector<std::uint64_t> square_sums;
    WaveletReport report;
};

Baked bake(const Scene& scene, const WaveletJob& job, int threads = 0) {
    const ThreadLimit limit(threads);
    const auto tracer = Tracer::build(scene);
    EXPECT_TRUE(tracer) << tracer.error();
    Baked baked;
    baked.square_sums.assign(wavelet::coeff_count(job.face_size), 0);
    Progress progress;
    const auto sink = [&](std::span<const std::byte> bytes) -> Expected<void> {
        baked.bytes.insert(baked.bytes.end(), bytes.begin(), bytes.end());
        return {};
    };
    const auto report = bake_wavelet(job, CubeTexels(job.face_size), scene, 0, *tracer, sink,
                                     baked.offsets, baked.square_sums, progress);
    EXPECT_TRUE(report) << report.error();
    if (report) baked.report = *report;
    return baked;
}

Scene floor_under_a_sphere(int n) {
    return test::scene_of(
        {test::grid({-2, -2, 0}, {4, 0, 0}, {0, 4, 0}, n), test::sphere({0, 0, 1}, 0.7f, 3)});
}

TEST(BakeWavelet, SameBytesForAnyThreadsAndMemory) {
    const Scene scene = floor_under_a_sphere(24);  // 625 vertices: three blocks
    const Baked one = bake(scene, {.face_size = 16}, 1);
    EXPECT_EQ(one.offsets.size(), 4u);
    EXPECT_EQ(one.report.vertex_count, 625u);
    EXPECT_EQ(one.report.traced_count, 625u);
    for (const std::size_t memory : {std::size_t{1}, std::size_t{1} << 30}) {
        const Baked two = bake(scene, {.face_size = 16, .memory_bytes = memory}, 2);
        EXPECT_EQ(one.bytes, two.bytes);
        EXPECT_EQ(one.offsets, two.offsets);
        EXPECT_EQ(one.square_sums, two.square_sums);
    }
}

/// A light of one texel is what quantisation hurts most: every vertex, all coefficients.
TEST(BakeWavelet, RoundingAModestShareOfALoneTexel) {
    const Scene scene = floor_under_a_sphere(12);
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();
    for (const double tolerance : {1e-2, 1e-3}) {
        const WaveletJob job{.face_size = 32, .tolerance = tolerance};
        const Baked baked = bake(scene, job);
        const std::vector<std::uint32_t> words = words_of(baked.bytes);
        const runtime::WaveletTransportView view{169, 32, wavelet_step(job), baked.offsets, words};
        const CubeTexels cube(32);
        const SurfacePoints points(scene.meshes[0]);
        std::vector<std::vector<float>> texels(169, std::vector<float>(cube.mean_x.size() / 3));
        for (std::uint32_t v = 0; v < 169; ++v)
            texel_transport(cube, *tracer, points.origin(v, tracer->space()), texels[v]);
        double square = 0;
        int count = 0;
        for (std::size_t t = 4 * 32 * 32; t < 5 * 32 * 32; t += 37) {  // the face +Z, overhead
            std::vector<runtime::Rgb> map(cube.mean_x.size() / 3);
            const int i = static_cast<int>(t);
            map[t][0] = static_cast<float>(1 / cube::texel_solid_angle(i / 32 % 32, i % 32, 32));
            std::vector<runtime::Rgb> coeffs(map.size());
            std::vector<double> scratch(wavelet::light_scratch_size(32));
            wavelet::light_coefficients(32, map, 32, coeffs, scratch);
            std::vector<wavelet::Term> terms;
            for (std::uint32_t k = 0; k < coeffs.size(); ++k)
                if (coeffs[k] != runtime::Rgb{}) terms.push_back({k, coeffs[k]});
            EXPECT_EQ(terms.size(), 16u);
            std::vector<runtime::Rgb> out(169);
            runtime::diffuse_exit(view, terms, 0, out);
            for (std::size_t v = 0; v < out.size(); ++v) {
                const double error = static_cast<double>(out[v][0] - texels[v][t]) * pi;
                square += error * error;
                ++count;
            }
        }
        EXPECT_LT(std::sqrt(square / count), tolerance);
        EXPECT_GT(std::sqrt(square / count), tolerance / 5) << "larger steps would do";
    }
}

}  // namespace
}  // namespace envbake
