// SPDX-License-Identifier: Apache-2.0
// Glossy transport with light between surfaces, as the runtime shades it from a bundle: white
// metals among plain dielectrics (with_material.py), seen from random directions above random
// vertices, against path tracing under the bundle's own SH, so what is missing of a map is in
// neither; and their matrices, against those of rays that take the diffuse transport of what they
// meet from the bundle.
//
//   glossy_bounces SCENE.glb BUNDLE.envb [PLACES]
//
// Prints one line of CSV. Of pictures: rms over places, views and channels of what differs from the
// truth, in percent of the truth's rms, with bounces as baked, with their mean alone, without them
// on both sides (error of the lobe and of the rays alone), and of shading without them what is true
// with them (what they are worth); the noise of the truth. Of matrices: |t - t_true|_F / |a + b of
// an open vertex|_F, rms over places and channels, as baked and with the mean alone, and what the
// bundle states. Bytes a vertex of what is stored beyond the mean. Of the surfaces that views of
// a place meet: the share of those nearer than their longest edge; the direct light that they
// have by the bundle, linear between vertices, over that found from where they are met, of the near
// ones and of the far. Places.
//
// Of the baker the truth uses the places that rays start from and the tracer.
#include "baker/input/read_scene.h"
#include "baker/math/quadrature.h"
#include "baker/render/ggx_sampling.h"
#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"
#include "envbake/runtime/glossy.h"
#include "envbake/runtime/lobe.h"
#include "envbake/runtime/sh.h"
#include "tests/bench/hammersley.h"
#include "tests/bench/transport_truth.h"

#include <nlohmann/json.hpp>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace envbake::bench {
namespace {

constexpr int kViews = 4;
constexpr int kPaths = 16384;
constexpr int kMaxBounces = 200;

using Random = std::mt19937_64;

double uniform(Random& random) {
    return std::uniform_real_distribution<double>(0, 1)(random);
}

DMat3 frame_about(const DVec3& n) {
    const DVec3 t = glm::normalize(std::abs(n.x) > 0.7 ? DVec3(-n.z, 0, n.x) : DVec3(0, n.z, -n.y));
    return {t, glm::cross(n, t), n};
}

/// What the diffuse scene sends along a ray, its light and the light between its surfaces.
class PathTracer {
  public:
    PathTracer(const Scene& scene, const Tracer& tracer, const runtime::Bundle& bundle)
        : scene_(scene), tracer_(tracer), bundle_(bundle), lighting_(bundle.lighting()) {}

    struct Radiance {
        DVec3 direct{0}, all{0};  ///< of the lighting alone, and with all bounces
        /// Of the first surface, where it reflects: how far it is, in lengths of its longest edge;
        /// what the lighting sends it directly, by this path and by the bundle, sums of RGB.
        double edges_away = 0, found = 0, told = 0;
    };

    Radiance along(DVec3 origin, DVec3 direction, Random& random) const {
        Radiance radiance;
        DVec3 throughput(1);
        for (int bounce = 0; bounce < kMaxBounces; ++bounce) {
            const auto hit = tracer_.closest(origin, direction);
            if (!hit) {
                radiance.all = throughput * sky(direction);
                if (bounce == 0) radiance.direct = radiance.all;
                if (bounce == 1) radiance.found = sum(radiance.all);
                return radiance;
            }
            const Material& material =
                scene_.materials[static_cast<std::size_t>(scene_.meshes[hit->mesh].material)];
            DVec3 normal(hit->geometric_normal);
            if (glm::dot(normal, direction) > 0) {
                if (!material.double_sided) return radiance;  // black behind
                normal = -normal;
            }
            throughput *= DVec3(material.base_color) * double{1 - material.metallic};
            if (bounce == 0 && material.metallic < 1) meet(*hit, throughput, radiance);
            const DVec3 point = origin + direction * double{hit->distance};
            // Off the triangle by more than the rounding of a float.
            const double reach = glm::length(point) + double{hit->distance};
            origin = point + normal * (2e-6 * reach);
            direction = frame_about(normal) * sample_cosine(uniform(random), uniform(random));
        }
        return radiance;
    }

  private:
    static double sum(const DVec3& v) { return v.x + v.y + v.z; }

    void meet(const Hit& hit, const DVec3& albedo, Radiance& radiance) const {
        const Mesh& mesh = scene_.meshes[hit.mesh];
        const runtime::GlossyView& glossy = bundle_.meshes()[hit.mesh].glossy;
        const DVec3 bary(1 - hit.u - hit.v, hit.u, hit.v);
        DVec3 corners[3];
        double edge = 0;
        for (int k = 0; k < 3; ++k) {
            const std::uint32_t v = mesh.triangles[3 * hit.triangle + static_cast<std::size_t>(k)];
            corners[k] = DVec3(mesh.positions[v]);
            for (int other = 0; other < k; ++other)
                edge = std::max(edge, glm::length(corners[k] - corners[other]));
            for (std::size_t i = 0; i < 25; ++i)
                for (int c = 0; c < 3; ++c)
                    radiance.told += bary[k] * albedo[c] *
                                     double{lighting_.coeffs[3 * i + static_cast<std::size_t>(c)]} *
                                     double{glossy.visibility[std::uint64_t{v} * 121 + i]};
        }
        radiance.edges_away = double{hit.distance} / edge;
    }

    DVec3 sky(const DVec3& w) const {
        std::vector<double> basis(lighting_.coeffs.size() / 3);
        sh::evaluate(lighting_.bands, w.x, w.y, w.z, basis.data());
        DVec3 L(0);
        for (std::size_t i = 0; i < basis.size(); ++i)
            for (int c = 0; c < 3; ++c)
                L[c] += basis[i] * double{lighting_.coeffs[3 * i + static_cast<std::size_t>(c)]};
        return L;
    }

    const Scene& scene_;
    const Tracer& tracer_;
    const runtime::Bundle& bundle_;
    const runtime::ShLightingView& lighting_;
};

struct Sums {
    double truth = 0, with = 0, mean = 0, without = 0, dark = 0, noise = 0;
    double matrix = 0, matrix_of_mean = 0, stated = 0, white = 0;
    struct Met {
        double count = 0, found = 0, told = 0;
    } near, far;  ///< surfaces, within the length of their edge and beyond it
};

/// What a place has blocked of each coefficient of the lighting, less what it is sent from there,
/// by coefficients of the kernel about the normal: X of the format's page. [49, 25, 3]
std::vector<double> blocked_light(const Scene& scene, const Tracer& tracer,
                                  const runtime::Bundle& bundle, const DVec3& position,
                                  const DMat3& frame) {
    constexpr int kRays = 1 << 15;
    std::vector<double> sums(49 * 25 * 3, 0);
    std::vector<double> kernel(49), basis(25);
    for (int ray = 0; ray < kRays; ++ray) {
        const DVec2 u = hammersley(ray, kRays);
        const DVec3 local = sample_cosine(u.x, u.y), w = frame * local;
        const auto hit = tracer.closest(position, w);
        if (!hit) continue;
        sh::evaluate(7, local.x, local.y, local.z, kernel.data());
        sh::evaluate(5, w.x, w.y, w.z, basis.data());
        const Mesh& seen = scene.meshes[hit->mesh];
        const Material& material = scene.materials[static_cast<std::size_t>(seen.material)];
        DVec3 albedo = DVec3(material.base_color) * double{1 - material.metallic};
        if (glm::dot(DVec3(hit->geometric_normal), w) > 0 && !material.double_sided)
            albedo = DVec3(0);
        const runtime::TransportView& diffuse = bundle.meshes()[hit->mesh].diffuse;
        const DVec3 bary(1 - hit->u - hit->v, hit->u, hit->v);
        for (std::size_t i = 0; i < 25; ++i) {
            for (std::size_t c = 0; c < 3; ++c) {
                double light = basis[i];
                for (int k = 0; k < 3 && diffuse.bands == 5; ++k) {
                    const std::uint64_t v =
                        seen.triangles[3 * hit->triangle + static_cast<std::size_t>(k)];
                    const auto channels = static_cast<std::size_t>(diffuse.channels);
                    light -= bary[k] * albedo[static_cast<int>(c)] *
                             double{diffuse.values[(v * 25 + i) * channels + c % channels]};
                }
                for (std::size_t k = 0; k < 49; ++k)
                    sums[(k * 25 + i) * 3 + c] += kernel[k] * light / kRays;
            }
        }
    }
    return sums;
}

/// The matrices of one place, R0 = 1, as radiance in directions that integrate squares exactly.
class MatrixCheck {
  public:
    explicit MatrixCheck(const runtime::LobeView& lobe) : lobe_(lobe) {
        const Quadrature rule = gauss_legendre(5);
        for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
            for (int k = 0; k < 10; ++k) {
                const double z = rule.nodes[i], radius = std::sqrt(1 - z * z);
                const double phi = 2 * std::numbers::pi * k / 10;
                directions_.push_back({radius * std::cos(phi), radius * std::sin(phi), z});
                weights_.push_back(rule.weights[i] * 2 * std::numbers::pi / 10);
            }
        }
    }

    /// Squared difference of what is blocked, mean over channels; and the square of an open place.
    double difference(const runtime::Mesh& mesh, std::uint64_t vertex, const DMat3& frame,
                      const std::vector<double>& blocked, double& white) const {
        const float r = lobe_.min_roughness;
        const std::size_t half = lobe_.kernel.count / 2;
        std::vector<float> open(1250), found(1250), visibility(121);
        const float* n = static_cast<const float*>(mesh.glossy.normals.data) + 3 * vertex;
        sh::evaluate(11, n[0], n[1], n[2], visibility.data());
        for (int l = 0; l < 11; ++l)
            for (int m = -l; m <= l; ++m)
                visibility[static_cast<std::size_t>(sh::index(l, m))] *=
                    static_cast<float>(sh::clamped_cosine(l) / std::numbers::pi);
        const runtime::GlossyView sky{1, 5, {visibility.data(), 121}, {n, 3}};
        if (!matrices_.expand(lobe_, sky, 0, r, open)) return 0;
        double sum = 0;
        white = 0;
        for (std::size_t e = 0; e < open.size(); e += 2)
            white += std::pow(double{open[e]} + double{open[e + 1]}, 2);
        for (int c = 0; c < 3; ++c) {
            if (!matrices_.expand(lobe_, mesh, vertex, r, c, found)) return 0;
            for (std::size_t d = 0; d < directions_.size(); ++d) {
                double local[25], world[25];
                const DVec3 w = frame * directions_[d];
                sh::evaluate(5, directions_[d].x, directions_[d].y, directions_[d].z, local);
                sh::evaluate(5, w.x, w.y, w.z, world);
                for (std::size_t i = 0; i < 25; ++i) {
                    double value = 0;
                    for (std::size_t j = 0; j < 25; ++j) {
                        const std::size_t at = (j * 25 + i) * 2;
                        value += world[j] * (double{open[at]} - double{found[at]} +
                                             double{open[at + 1]} - double{found[at + 1]});
                    }
                    for (int m = -4; m <= 4; ++m)
                        for (int j = std::abs(m); j < 5; ++j)
                            for (int k = std::abs(m); k < 7; ++k) {
                                const std::size_t at = runtime::lobe_slot(5, 7, std::abs(m), j, k);
                                value -=
                                    local[sh::index(j, m)] *
                                    (double{lobe_.kernel[at]} + double{lobe_.kernel[half + at]}) *
                                    blocked[(static_cast<std::size_t>(sh::index(k, m)) * 25 + i) *
                                                3 +
                                            static_cast<std::size_t>(c)];
                            }
                    sum += weights_[d] * value * value / 3;
                }
            }
        }
        return sum;
    }

  private:
    const runtime::LobeView& lobe_;
    runtime::GlossyMatrices matrices_;
    std::vector<DVec3> directions_;
    std::vector<double> weights_;
};

DVec3 exit(const runtime::Bundle& bundle, const runtime::Mesh& mesh, std::uint64_t vertex,
           float roughness, const DVec3& v) {
    const runtime::GlossyLight light(bundle.lighting(), mesh.glossy.light_bands);
    const auto L =
        runtime::reflect(bundle.glossy_lobe(), light.transfer(mesh, vertex), roughness, {1, 1, 1})
            .radiance({static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)});
    return {L[0], L[1], L[2]};
}

double square(const DVec3& v) {
    return glm::dot(v, v);
}

int run(const std::string& scene_file, const std::string& bundle_file, std::size_t count) {
    const auto scene = read_scene(scene_file);
    const auto bundle = runtime::Bundle::open(bundle_file.c_str());
    if (!scene || !bundle || bundle->glossy_lobe().rows != 1) {
        std::fprintf(stderr, "glossy_bounces: no scene, or no bundle of one roughness\n");
        return 2;
    }
    const auto metadata = nlohmann::json::parse(bundle->reader().metadata());
    const auto tracer = Tracer::build(*scene);
    if (!tracer) return 1;
    const PathTracer paths(*scene, *tracer, *bundle);
    const float roughness = bundle->glossy_lobe().min_roughness;
    const double alpha = double{roughness} * double{roughness};
    Random random(1);
    Sums sums;
    std::size_t places = 0;
    int bytes = 0;
    const MatrixCheck check(bundle->glossy_lobe());
    for (const Place& place : random_places(*scene, count)) {
        const Mesh& mesh = scene->meshes[place.mesh];
        const runtime::Mesh& baked = bundle->meshes()[place.mesh];
        const SurfacePoints points(mesh);
        const std::uint32_t representative = points.representative(place.vertex);
        const Material& material = scene->materials[static_cast<std::size_t>(mesh.material)];
        if (representative == SurfacePoints::kNone || baked.glossy.light_bands == 0 ||
            material.metallic < 1)
            continue;
        const RayOrigin origin = points.origin(representative, tracer->space());
        const DMat3 frame = frame_about(origin.normal);
        runtime::Mesh no_bounces = baked;
        no_bounces.diffuse = {};
        runtime::Mesh mean = baked;
        mean.glossy.reflected_bands = 1;
        ++places;
        const std::vector<double> blocked =
            blocked_light(*scene, *tracer, *bundle, origin.position, frame);
        double white = 0;
        sums.matrix += check.difference(baked, place.vertex, frame, blocked, white);
        sums.matrix_of_mean += check.difference(mean, place.vertex, frame, blocked, white);
        sums.white += white;
        const auto& glossy = metadata.at("meshes").at(place.mesh).at("glossy");
        sums.stated += std::pow(glossy.at("error_rms").get<double>(), 2);
        bytes = 2 * (baked.glossy.reflected_bands * baked.glossy.reflected_bands - 1) * 25 *
                baked.glossy.reflected_channels;
        for (int view = 0; view < kViews; ++view) {
            const DVec3 v = sample_cosine(uniform(random), uniform(random));
            DVec3 direct(0), all(0), all_squares(0);
            for (int k = 0; k < kPaths; ++k) {
                const DVec3 h = sample_visible_normal(v, alpha, uniform(random), uniform(random));
                const DVec3 l = glm::reflect(-v, h);
                PathTracer::Radiance L;
                if (l.z > 0) {
                    L = paths.along(origin.position, frame * l, random);
                    if (L.edges_away > 0) {
                        Sums::Met& met = L.edges_away < 1 ? sums.near : sums.far;
                        met.count += 1;
                        met.found += L.found;
                        met.told += L.told;
                    }
                    // f n.l / density = G2 / G1, F = 1
                    const double a = runtime::ggx_lambda(v.z, alpha),
                                 b = runtime::ggx_lambda(l.z, alpha);
                    const double weight = (1 + a) / (1 + a + b);
                    L.direct *= weight;
                    L.all *= weight;
                }
                direct += L.direct;
                all += L.all;
                all_squares += L.all * L.all;
            }
            const double n = kPaths;
            direct /= n;
            all /= n;
            const DVec3 world = frame * v;
            sums.truth += square(all);
            sums.with += square(exit(*bundle, baked, place.vertex, roughness, world) - all);
            sums.mean += square(exit(*bundle, mean, place.vertex, roughness, world) - all);
            const DVec3 dark = exit(*bundle, no_bounces, place.vertex, roughness, world);
            sums.without += square(dark - direct);
            sums.dark += square(dark - all);
            const DVec3 variance = (all_squares / n - all * all) / (n - 1);
            sums.noise += variance.x + variance.y + variance.z;
        }
    }
    const auto percent = [&](double sum) { return 100 * std::sqrt(sum / sums.truth); };
    std::printf(
        "scene,roughness,with_bounces,with_their_mean,without_on_both_sides,left_out,noise,"
        "true_rms,true_rms_of_mean,stated_rms,bytes,near_share,near_told,far_told,places\n");
    std::printf("%s,%.2f,%.2f,%.2f,%.2f,%.2f,%.2f,%.3e,%.3e,%.3e,%d,%.3f,%.3f,%.3f,%zu\n",
                scene->file_name.c_str(), double{roughness}, percent(sums.with), percent(sums.mean),
                percent(sums.without), percent(sums.dark), percent(sums.noise),
                std::sqrt(sums.matrix / sums.white), std::sqrt(sums.matrix_of_mean / sums.white),
                std::sqrt(sums.stated / static_cast<double>(places)), bytes,
                sums.near.count / (sums.near.count + sums.far.count),
                sums.near.told / sums.near.found, sums.far.told / sums.far.found, places);
    return 0;
}

}  // namespace
}  // namespace envbake::bench

int main(int argc, char** argv) {
    if (argc < 3) {
        std::fprintf(stderr, "glossy_bounces SCENE.glb BUNDLE.envb [PLACES]\n");
        return 2;
    }
    return envbake::bench::run(argv[1], argv[2],
                               argc > 3 ? std::strtoul(argv[3], nullptr, 10) : 300);
}
