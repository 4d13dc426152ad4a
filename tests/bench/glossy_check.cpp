// SPDX-License-Identifier: Apache-2.0
// Holds the error that glossy transport states of its rays against the true one, as CSV:
//
//     scene,roughness,r0,vertices,rays,cpu_us,row_error,transport_rms,true_rms,stated_rms
//
// rays, cpu_us    a vertex of the mesh; CPU time of all threads
// row_error       true error of matrices over true error of diffuse transport
// transport_rms   true, of the diffuse transport
// true_rms        |t - t_true|_F / |a + b of an open vertex|_F, rms over 2,000 random vertices;
//                 t_true: by the same formula from 2^16 rays each
// stated_rms      what the bake says of it
//
//     glossy_check SCENE [TOLERANCE]
//
// The largest mesh of a scene, GGX, 5 bands. Lobes of R0 = 1 stand for metals: no rays for the
// diffuse transport. Directions, basis and sums of the truth are its own; matrices are made by the
// runtime, as users have them.
#include "baker/brdf/lobe_expansion.h"
#include "baker/core/parallel.h"
#include "baker/input/read_scene.h"
#include "baker/transport/diffuse.h"
#include "envbake/runtime/glossy.h"
#include "tests/bench/baked_scene.h"
#include "tests/bench/or_exit.h"
#include "tests/bench/transport_truth.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <string>
#include <vector>

namespace envbake::bench {
namespace {

constexpr int kBands = 5, kRowBands = kBands + runtime::kExtraVisibilityBands;
constexpr std::size_t kRow = sh::coeff_count(kRowBands), kMatrix = 2 * 625;

/// Rows of the places, as the runtime sees them in a bundle.
struct Rows {
    std::vector<float> visibility, normals;

    std::vector<float> matrix(const runtime::GlossyMatrices& matrices,
                              const runtime::LobeView& lobe, std::size_t place,
                              float roughness) const {
        const runtime::GlossyView view{normals.size() / 3,
                                       kBands,
                                       {visibility.data(), visibility.size()},
                                       {normals.data(), normals.size()}};
        std::vector<float> t(kMatrix);
        if (!matrices.expand(lobe, view, place, roughness, t)) std::fill(t.begin(), t.end(), 0.0f);
        return t;
    }
};

std::size_t largest_mesh(const Scene& scene) {
    std::size_t largest = 0;
    for (std::size_t m = 1; m < scene.meshes.size(); ++m)
        if (scene.meshes[m].vertex_count() > scene.meshes[largest].vertex_count()) largest = m;
    return largest;
}

/// |a + b of an open vertex|_F^2
double white_squared(const runtime::GlossyMatrices& matrices, const runtime::LobeView& lobe,
                     float roughness) {
    std::vector<double> row(kRow);
    unoccluded_transport(kRowBands, {0, 0, 1}, row);
    const Rows open{{row.begin(), row.end()}, {0, 0, 1}};
    const std::vector<float> t = open.matrix(matrices, lobe, 0, roughness);
    double sum = 0;
    for (std::size_t i = 0; i < kMatrix; i += 2)
        sum += std::pow(double{t[i]} + double{t[i + 1]}, 2);
    return sum;
}

void check(const std::string& name, const Scene& scene, const Tracer& tracer, double tolerance) {
    const std::size_t largest = largest_mesh(scene);
    const Mesh& mesh = scene.meshes[largest];
    const SurfacePoints points(mesh);
    std::vector<Place> places;
    for (const Place& place : random_places(scene, 20000))
        if (place.mesh == largest && places.size() < 2000) places.push_back(place);
    Rows truth;
    for (const std::vector<double>& row : find_truth(kRowBands, scene, tracer, places, 16))
        truth.visibility.insert(truth.visibility.end(), row.begin(), row.end());
    for (const Place& place : places) {
        const std::uint32_t vertex = points.representative(place.vertex);
        const DVec3 normal = vertex == SurfacePoints::kNone
                                 ? DVec3(0)
                                 : points.origin(vertex, tracer.space()).normal;
        for (int c = 0; c < 3; ++c) truth.normals.push_back(static_cast<float>(normal[c]));
    }
    static const runtime::GlossyMatrices matrices;

    std::puts(
        "scene,roughness,r0,vertices,rays,cpu_us,row_error,transport_rms,true_rms,stated_rms");
    for (const double r0 : {1.0, 0.04}) {
        for (const double roughness : {0.5, 0.8}) {
            const LobeExpansionJob expansion{.roughness = {roughness, roughness}};
            const LobeErrors errors = lobe_errors(expansion, roughness, r0);
            const LobeExpansion lobe = expand_lobe(expansion);
            const auto r = static_cast<float>(roughness);
            const runtime::LobeView view{lobe.rows,
                                         kBands,
                                         kBands,
                                         r,
                                         r,
                                         {lobe.unoccluded.data(), lobe.unoccluded.size()},
                                         {lobe.kernel.data(), lobe.kernel.size()}};
            const DiffuseJob job{.bands = kBands,
                                 .row_bands = kRowBands,
                                 .tolerance = tolerance,
                                 .row_use = {{errors.of_row}, errors.per_transport_error, r0 == 1}};
            std::vector<float> rows;
            Progress progress;
            const std::clock_t begin = std::clock();
            const DiffuseReport report = or_exit(bake_diffuse(
                job, scene, largest, tracer,
                [&](std::span<const float> more) -> Expected<void> {
                    rows.insert(rows.end(), more.begin(), more.end());
                    return {};
                },
                progress));
            const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
            Rows baked{{}, truth.normals};
            for (const Place& place : places) {
                const auto row = rows.begin() + static_cast<std::ptrdiff_t>(place.vertex * kRow);
                baked.visibility.insert(baked.visibility.end(), row,
                                        row + static_cast<std::ptrdiff_t>(kRow));
            }
            const double white = white_squared(matrices, view, r), norm = unoccluded_norm(kBands);
            std::vector<double> of_matrices(places.size()), of_transport(places.size());
            parallel_for(places.size(), [&](std::size_t p) {
                const std::vector<float> t = baked.matrix(matrices, view, p, r),
                                         exact = truth.matrix(matrices, view, p, r);
                double sum = 0;
                for (std::size_t i = 0; i < kMatrix; i += 2)
                    sum += std::pow(r0 * (double{t[i]} - double{exact[i]}) +
                                        (double{t[i + 1]} - double{exact[i + 1]}),
                                    2);
                of_matrices[p] = std::sqrt(sum / white);
                sum = 0;
                for (std::size_t c = 0; c < sh::coeff_count(kBands); ++c)
                    sum += std::pow(double{baked.visibility[p * kRow + c]} -
                                        double{truth.visibility[p * kRow + c]},
                                    2);
                of_transport[p] = std::sqrt(sum) / norm;
            });
            const auto count = static_cast<double>(mesh.vertex_count());
            std::printf("%s,%g,%g,%zu,%.1f,%.2f,%.3f,%.3e,%.3e,%.3e\n", name.c_str(), roughness, r0,
                        mesh.vertex_count(),
                        static_cast<double>(report.ray_count + report.check_ray_count) / count,
                        1e6 * seconds / count, rms(of_matrices) / rms(of_transport),
                        rms(of_transport), rms(of_matrices), report.row_error * report.error_rms);
            std::fflush(stdout);
        }
    }
}

}  // namespace
}  // namespace envbake::bench

int main(int argc, char** argv) {
    using namespace envbake;
    if (argc < 2 || argc > 3) {
        std::fprintf(stderr, "glossy_check SCENE [TOLERANCE]\n");
        return 2;
    }
    const std::filesystem::path file = argv[1];
    const Scene scene = bench::or_exit(read_scene(file, {.textures = false}));
    const Tracer tracer = bench::or_exit(Tracer::build(scene));
    bench::check(file.stem().string(), scene, tracer, argc == 3 ? std::atof(argv[2]) : 1e-2);
}
