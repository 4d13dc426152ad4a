// SPDX-License-Identifier: Apache-2.0
// Glossy transport with light between surfaces, as the runtime shades it from a bundle, against
// path tracing: a lobe of R0 = 1 on a scene of one plain material, seen from random directions
// above random vertices. The light is the bundle's own SH, so what is missing of a map is in
// neither.
//
//   glossy_bounces SCENE.glb BUNDLE.envb [PLACES]
//
// Prints one line of CSV: rms over places, views and channels of what differs from the truth, in
// percent of the truth's rms, with bounces (as baked), without them on both sides (error of the
// lobe and of the rays alone), and of shading without them what is true with them (what they are
// worth); the noise of the truth; places. Of the baker the truth uses the places that rays start
// from and the tracer.
#include "baker/input/read_scene.h"
#include "baker/render/ggx_sampling.h"
#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"
#include "envbake/runtime/glossy.h"
#include "envbake/runtime/sh.h"
#include "tests/bench/transport_truth.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
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
    PathTracer(const Scene& scene, const Tracer& tracer, const runtime::ShLightingView& lighting)
        : scene_(scene), tracer_(tracer), lighting_(lighting) {}

    struct Radiance {
        DVec3 direct{0}, all{0};  ///< of the lighting alone, and with all bounces
    };

    Radiance along(DVec3 origin, DVec3 direction, Random& random) const {
        Radiance radiance;
        DVec3 throughput(1);
        for (int bounce = 0; bounce < kMaxBounces; ++bounce) {
            const auto hit = tracer_.closest(origin, direction);
            if (!hit) {
                radiance.all = throughput * sky(direction);
                if (bounce == 0) radiance.direct = radiance.all;
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
            const DVec3 point = origin + direction * double{hit->distance};
            // Off the triangle by more than the rounding of a float.
            const double reach = glm::length(point) + double{hit->distance};
            origin = point + normal * (2e-6 * reach);
            direction = frame_about(normal) * sample_cosine(uniform(random), uniform(random));
        }
        return radiance;
    }

  private:
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
    const runtime::ShLightingView& lighting_;
};

struct Sums {
    double truth = 0, with = 0, without = 0, dark = 0, noise = 0;
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
    if (!scene || !bundle || bundle->glossy_lobe().rows == 0) {
        std::fprintf(stderr, "glossy_bounces: no scene, or no bundle with glossy transport\n");
        return 2;
    }
    const auto tracer = Tracer::build(*scene);
    if (!tracer) return 1;
    const PathTracer paths(*scene, *tracer, bundle->lighting());
    const float roughness = bundle->glossy_lobe().min_roughness;
    const double alpha = double{roughness} * double{roughness};
    Random random(1);
    Sums sums;
    std::size_t places = 0;
    for (const Place& place : random_places(*scene, count)) {
        const Mesh& mesh = scene->meshes[place.mesh];
        const runtime::Mesh& baked = bundle->meshes()[place.mesh];
        const SurfacePoints points(mesh);
        const std::uint32_t representative = points.representative(place.vertex);
        if (representative == SurfacePoints::kNone || baked.glossy.light_bands == 0) continue;
        const RayOrigin origin = points.origin(representative, tracer->space());
        const DMat3 frame = frame_about(origin.normal);
        runtime::Mesh no_bounces = baked;
        no_bounces.diffuse = {};
        ++places;
        for (int view = 0; view < kViews; ++view) {
            const DVec3 v = sample_cosine(uniform(random), uniform(random));
            DVec3 direct(0), all(0), all_squares(0);
            for (int k = 0; k < kPaths; ++k) {
                const DVec3 h = sample_visible_normal(v, alpha, uniform(random), uniform(random));
                const DVec3 l = glm::reflect(-v, h);
                PathTracer::Radiance L;
                if (l.z > 0) {
                    L = paths.along(origin.position, frame * l, random);
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
            const DVec3 dark = exit(*bundle, no_bounces, place.vertex, roughness, world);
            sums.without += square(dark - direct);
            sums.dark += square(dark - all);
            const DVec3 variance = (all_squares / n - all * all) / (n - 1);
            sums.noise += variance.x + variance.y + variance.z;
        }
    }
    const auto percent = [&](double sum) { return 100 * std::sqrt(sum / sums.truth); };
    std::printf("scene,roughness,with_bounces,without_on_both_sides,left_out,noise,places\n");
    std::printf("%s,%.2f,%.2f,%.2f,%.2f,%.2f,%zu\n", scene->file_name.c_str(), double{roughness},
                percent(sums.with), percent(sums.without), percent(sums.dark), percent(sums.noise),
                places);
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
