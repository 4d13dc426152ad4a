// SPDX-License-Identifier: Apache-2.0
// What wavelets cost and err, as CSV.
//
//     wavelet_check SCENE FACE_SIZE ENVIRONMENT...
//
// 1. One line for the scene, baked whole at tolerance 1e-2, CPU time of all threads:
//
//     scene,face_size,vertices,rays,every_texel_rays,us,every_texel_us,bytes,diffuse_us,diffuse_bytes
//
// rays, us, bytes    a vertex; every_texel_...: at 400 random vertices that are looked at
// everywhere diffuse_...        of mesh/I/diffuse, 5 bands
//
// 2. One line a map, relative rms exit radiance at the same vertices:
//
//     scene,face_size,map,outlines,rounding,texels,terms,whole
//
// outlines   looking at outlines, against looking everywhere
// rounding   by wavelet_step(), against not
// texels     looking everywhere, against 4 x 4 points of every texel and a light of as many
// terms      that a tolerance of 1e-2 chooses
// whole      those terms and rounded transport, against looking everywhere and all terms
//
// 3. Lines of error by what is kept of the light, against all of it; transport exact:
//
//     curve,scene,face_size,map,kept,number,light_bytes,error
//
// kept   weighted: terms by transport; size: by size alone; sh: bands
#include "baker/input/image_worker.h"
#include "baker/input/read_environment.h"
#include "baker/input/read_scene.h"
#include "baker/lighting/box_average.h"
#include "baker/lighting/wavelet_lighting.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/wavelet_block.h"
#include "baker/transport/wavelet_transport.h"
#include "envbake/runtime/sh.h"
#include "tests/bench/or_exit.h"
#include "tests/bench/transport_truth.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

namespace envbake::bench {
namespace {

using wavelet::Rgb;
using wavelet::Term;

constexpr double kTolerance = 1e-2;
constexpr int kPointsPerTexel = 4;  ///< along each axis, of the truth

double cpu_seconds() {
    return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

DVec3 to_double(const Rgb& c) {
    return {static_cast<double>(c[0]), static_cast<double>(c[1]), static_cast<double>(c[2])};
}

DVec3 product(const std::vector<Rgb>& light, const std::vector<float>& row) {
    DVec3 sum(0);
    for (std::size_t i = 0; i < row.size(); ++i)
        sum += to_double(light[i]) * static_cast<double>(row[i]);
    return sum;
}

/// Relative rms difference of two lists.
double difference(const std::vector<DVec3>& a, const std::vector<DVec3>& truth) {
    double wrong = 0, all = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        wrong += glm::dot(a[i] - truth[i], a[i] - truth[i]);
        all += glm::dot(truth[i], truth[i]);
    }
    return std::sqrt(wrong / all);
}

/// Radiance times solid angle of the texels of faces of n.
std::vector<Rgb> flux(const Environment& environment, int n) {
    const auto averages = lighting::box_average(environment, MipLayout::CubeFaces, n, 3);
    std::vector<Rgb> texels(wavelet::coeff_count(n));
    for (std::size_t t = 0; t < texels.size(); ++t) {
        const int i = static_cast<int>(t);
        const auto d_omega = static_cast<float>(cube::texel_solid_angle(i / n % n, i % n, n));
        for (std::size_t c = 0; c < 3; ++c) texels[t][c] = averages[3 * t + c] * d_omega;
    }
    return texels;
}

/// Exit radiance by a ray through the centre of every texel of faces of n, and a light of as many.
DVec3 traced(int n, const Tracer& tracer, const RayOrigin& origin, const std::vector<Rgb>& light) {
    DVec3 sum(0);
    for (int face = 0; face < cube::kFaceCount; ++face)
        for (int at = 0; at < n * n; at += 16) {  // 4 x 4 squares
            DirectionPacket packet;
            std::array<double, 16> cosine{};
            std::array<std::size_t, 16> texel{};
            std::uint32_t above = 0;
            for (std::size_t i = 0; i < 16; ++i) {
                const int square = at / 16, k = static_cast<int>(i);
                const int row = square / (n / 4) * 4 + k / 4, column = square % (n / 4) * 4 + k % 4;
                const auto w =
                    cube::texel_direction<double>(static_cast<cube::Face>(face), row, column, n);
                cosine[i] = glm::dot(DVec3(w[0], w[1], w[2]), origin.normal);
                if (cosine[i] > 0) above |= 1u << i;
                texel[i] = static_cast<std::size_t>((face * n + row) * n + column);
                packet.x[i] = static_cast<float>(w[0]);
                packet.y[i] = static_cast<float>(w[1]);
                packet.z[i] = static_cast<float>(w[2]);
            }
            if (above == 0) continue;
            const std::uint32_t open = above & ~tracer.occluded16(origin.position, packet, above);
            for (std::size_t i = 0; i < 16; ++i)
                if ((open >> i & 1) != 0) sum += cosine[i] * to_double(light[texel[i]]);
        }
    return sum * std::numbers::inv_pi;
}

/// Vertices of the scene, as their wavelets have them.
struct Sample {
    std::vector<RayOrigin> origins;
    std::vector<std::vector<float>> everywhere, outlines, rounded;
    std::vector<float> weights;
    double every_texel_rays = 0, every_texel_us = 0;
};

Sample take_sample(const Scene& scene, const Tracer& tracer, const WaveletJob& job) {
    const CubeTexels cube(job.face_size);
    const std::size_t coeffs = wavelet::coeff_count(job.face_size);
    Sample sample;
    std::vector<SurfacePoints> points;
    for (const Mesh& mesh : scene.meshes) points.emplace_back(mesh);
    for (const Place& place : random_places(scene, 400)) {
        const std::uint32_t vertex = points[place.mesh].representative(place.vertex);
        if (vertex != SurfacePoints::kNone)
            sample.origins.push_back(points[place.mesh].origin(vertex, tracer.space()));
    }
    const double begin = cpu_seconds();
    for (const RayOrigin& origin : sample.origins) {
        std::vector<float> row(coeffs);
        sample.every_texel_rays += wavelet_transport(cube, tracer, origin, row, Look::Everywhere);
        sample.everywhere.push_back(std::move(row));
    }
    const auto count = static_cast<double>(sample.origins.size());
    sample.every_texel_us = (cpu_seconds() - begin) / count * 1e6;
    sample.every_texel_rays /= count;
    std::vector<double> squares(coeffs, 0);
    for (const RayOrigin& origin : sample.origins) {
        std::vector<float> row(coeffs), back(coeffs, 0);
        wavelet_transport(cube, tracer, origin, row, Look::AtOutlines);
        for (const WaveletEntry& e : quantised(row, wavelet_step(job)))
            back[e.index] = static_cast<float>(e.units) * wavelet_step(job);
        for (std::size_t i = 0; i < coeffs; ++i)
            squares[i] += static_cast<double>(row[i]) * static_cast<double>(row[i]);
        sample.outlines.push_back(std::move(row));
        sample.rounded.push_back(std::move(back));
    }
    for (const double square : squares)
        sample.weights.push_back(static_cast<float>(std::sqrt(square / count)));
    return sample;
}

int bake_whole(const std::string& name, const Scene& scene, const Tracer& tracer,
               const WaveletJob& job, const Sample& sample) {
    const CubeTexels cube(job.face_size);
    std::vector<std::uint64_t> squares(wavelet::coeff_count(job.face_size), 0);
    double vertices = 0, rays = 0, bytes = 0;
    Progress progress;
    const double begin = cpu_seconds();
    for (std::size_t mesh = 0; mesh < scene.meshes.size(); ++mesh) {
        std::vector<std::uint32_t> offsets;
        const auto report = bake_wavelet(
            job, cube, scene, mesh, tracer,
            [](std::span<const std::byte>) -> Expected<void> { return {}; }, offsets, squares,
            progress);
        if (!report) return std::fprintf(stderr, "%s\n", report.error().message.c_str());
        vertices += static_cast<double>(report->vertex_count);
        rays += static_cast<double>(report->ray_count);
        bytes += static_cast<double>(report->byte_count);
    }
    const double wavelet_end = cpu_seconds();
    for (std::size_t mesh = 0; mesh < scene.meshes.size(); ++mesh) {
        const auto report = bake_diffuse(
            {.tolerance = kTolerance}, scene, mesh, tracer,
            [](std::span<const float>) -> Expected<void> { return {}; }, progress);
        if (!report) return std::fprintf(stderr, "%s\n", report.error().message.c_str());
    }
    const double end = cpu_seconds();
    std::printf("%s,%d,%.0f,%.0f,%.0f,%.1f,%.1f,%.0f,%.1f,%d\n", name.c_str(), job.face_size,
                vertices, rays / vertices, sample.every_texel_rays,
                (wavelet_end - begin) / vertices * 1e6, sample.every_texel_us, bytes / vertices,
                (end - wavelet_end) / vertices * 1e6, 25 * 4);
    return 0;
}

/// A light on the sample, by everything that is asked of it.
class MapCheck {
  public:
    MapCheck(std::string scene, std::string map, const Sample& sample, const WaveletJob& job,
             const Environment& environment)
        : scene_(std::move(scene)),
          map_(std::move(map)),
          sample_(sample),
          job_(job),
          environment_(environment),
          light_(project_wavelet(environment, job.face_size, 3)),
          exact_(lit(sample.everywhere)) {}

    void print_errors(const Tracer& tracer) const {
        const auto outlines = lit(sample_.outlines);
        const std::vector<Rgb> fine = flux(environment_, kPointsPerTexel * job_.face_size);
        std::vector<DVec3> truth;
        for (const RayOrigin& origin : sample_.origins)
            truth.push_back(traced(kPointsPerTexel * job_.face_size, tracer, origin, fine));
        const ChosenTerms chosen =
            choose_terms(light_, sample_.weights, sample_.everywhere, 0.75 * job_.tolerance);
        std::vector<DVec3> whole;
        for (const auto& row : sample_.rounded) whole.push_back(by_terms(chosen.terms, row));
        std::printf("%s,%d,%s,%.2g,%.2g,%.2g,%zu,%.2g\n", scene_.c_str(), job_.face_size,
                    map_.c_str(), difference(outlines, exact_),
                    difference(lit(sample_.rounded), outlines), difference(exact_, truth),
                    chosen.terms.size(), difference(whole, exact_));
    }

    void print_curves() const {
        for (const std::size_t count : {16u, 32u, 64u, 128u, 256u, 512u})
            for (const bool weighted : {true, false}) {
                std::vector<Term> terms;
                for (std::uint32_t i = 0; i < light_.size(); ++i) terms.push_back({i, light_[i]});
                terms.resize(wavelet::select_terms(
                    terms,
                    weighted ? std::span<const float>(sample_.weights) : std::span<const float>(),
                    count));
                std::vector<DVec3> sums;
                for (const auto& row : sample_.everywhere) sums.push_back(by_terms(terms, row));
                print(weighted ? "weighted" : "size", count, count * sizeof(Term), sums);
            }
        for (int bands = 2; bands <= 10; ++bands) print_sh(bands);
    }

  private:
    std::vector<DVec3> lit(const std::vector<std::vector<float>>& rows) const {
        std::vector<DVec3> sums;
        for (const auto& row : rows) sums.push_back(product(light_, row));
        return sums;
    }
    static DVec3 by_terms(const std::vector<Term>& terms, const std::vector<float>& row) {
        DVec3 sum(0);
        for (const Term& term : terms)
            sum += to_double(term.value) * static_cast<double>(row[term.index]);
        return sum;
    }
    void print(const char* kept, std::size_t number, std::size_t bytes,
               const std::vector<DVec3>& sums) const {
        std::printf("curve,%s,%d,%s,%s,%zu,%zu,%.3g\n", scene_.c_str(), job_.face_size,
                    map_.c_str(), kept, number, bytes, difference(sums, exact_));
    }

    /// Both sides projected from the same texels, so that only bands are missing.
    void print_sh(int bands) const {
        const int n = job_.face_size;
        const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
        const std::vector<Rgb> texels = flux(environment_, n);
        std::vector<double> basis(texels.size() * coeffs), d_omega(texels.size());
        std::vector<DVec3> light(coeffs, DVec3(0));
        for (std::size_t t = 0; t < texels.size(); ++t) {
            const int i = static_cast<int>(t);
            const auto w = cube::texel_direction<double>(static_cast<cube::Face>(i / (n * n)),
                                                         i / n % n, i % n, n);
            d_omega[t] = cube::texel_solid_angle(i / n % n, i % n, n);
            sh::evaluate(bands, w[0], w[1], w[2], &basis[t * coeffs]);
            for (std::size_t c = 0; c < coeffs; ++c)
                light[c] += basis[t * coeffs + c] * to_double(texels[t]);
        }
        std::vector<DVec3> sums;
        const std::size_t of_face = texels.size() / 6;
        std::vector<float> row(texels.size());
        for (const auto& transport : sample_.everywhere) {
            for (std::size_t face = 0; face < 6; ++face)
                wavelet::inverse(n, &transport[face * of_face], &row[face * of_face]);
            std::vector<double> t_sh(coeffs, 0);
            for (std::size_t t = 0; t < row.size(); ++t)
                if (row[t] != 0)
                    for (std::size_t c = 0; c < coeffs; ++c)
                        t_sh[c] += basis[t * coeffs + c] * d_omega[t] * static_cast<double>(row[t]);
            DVec3 sum(0);
            for (std::size_t c = 0; c < coeffs; ++c) sum += light[c] * t_sh[c];
            sums.push_back(sum);
        }
        print("sh", static_cast<std::size_t>(bands), coeffs * sizeof(Rgb), sums);
    }

    std::string scene_, map_;
    const Sample& sample_;
    WaveletJob job_;
    const Environment& environment_;
    std::vector<Rgb> light_;
    std::vector<DVec3> exact_;
};

int run(const std::filesystem::path& scene_file, int face_size,
        const std::vector<std::filesystem::path>& maps) {
    start_image_worker();
    const Scene scene = or_exit(read_scene(scene_file));
    const Tracer tracer = or_exit(Tracer::build(scene));
    const WaveletJob job{.face_size = face_size, .tolerance = kTolerance};
    const std::string name = scene_file.stem().string();
    const Sample sample = take_sample(scene, tracer, job);
    std::puts(
        "scene,face_size,vertices,rays,every_texel_rays,us,every_texel_us,bytes,diffuse_us,"
        "diffuse_bytes");
    if (const int status = bake_whole(name, scene, tracer, job, sample); status != 0) return status;
    std::puts("scene,face_size,map,outlines,rounding,texels,terms,whole");
    std::vector<Environment> environments;
    for (const auto& map : maps) {
        auto environment = read_environment(map);
        if (!environment) return std::fprintf(stderr, "%s\n", environment.error().message.c_str());
        environments.push_back(std::move(*environment));
    }
    std::vector<MapCheck> checks;
    for (std::size_t i = 0; i < maps.size(); ++i)
        checks.emplace_back(name, maps[i].stem().string(), sample, job, environments[i]);
    for (const MapCheck& check : checks) check.print_errors(tracer);
    std::puts("curve,scene,face_size,map,kept,number,light_bytes,error");
    for (const MapCheck& check : checks) check.print_curves();
    return 0;
}

}  // namespace
}  // namespace envbake::bench

int main(int argc, char** argv) {
    if (argc < 4) {
        std::fprintf(stderr, "wavelet_check SCENE FACE_SIZE ENVIRONMENT...\n");
        return 2;
    }
    return envbake::bench::run(argv[1], std::atoi(argv[2]), {argv + 3, argv + argc});
}
