// SPDX-License-Identifier: Apache-2.0
#include "baker/render/reference.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/math/frame.h"
#include "baker/render/environment_sampler.h"
#include "baker/render/ggx_sampling.h"
#include "baker/render/sight.h"
#include "envbake/runtime/brdf.h"
#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

constexpr std::uint64_t kLightStream = 0x6c696768;
constexpr double kLeastRoughness = 0.03;

/// A shifted additive recurrence in the unit square: point i is frac(shift + i (1/g, 1/g^2)), g the
/// root of x^3 = x + 1. Any stretch of it is spread evenly; each point alone is uniform, so an
/// estimate has no bias.  Source: [Roberts18].
class PlanePoints {
  public:
    explicit PlanePoints(RandomStream& random) {
        point_.x = random.next();
        point_.y = random.next();
    }
    const DVec2& next() {
        constexpr double kStep = 0.75487766624669276005;  // 1 / g
        point_ += DVec2(kStep, kStep * kStep);
        point_ -= glm::floor(point_);
        return point_;
    }

  private:
    DVec2 point_{0};
};

/// The points of one half of a pixel's samples. All lines of sight through the pixel draw from the
/// same two sequences: what they look at is alike, so the points even out across them too.
struct LightPoints {
    PlanePoints environment, bsdf;
    explicit LightPoints(RandomStream& random) : environment(random), bsdf(random) {}
};

DVec3 to_local(const Frame& frame, const DVec3& w) {
    return {glm::dot(w, frame.tangent), glm::dot(w, frame.bitangent), glm::dot(w, frame.normal)};
}

/// Diffuse and specular reflection at one point, and the density with which it picks directions.
class Bsdf {
  public:
    explicit Bsdf(const SurfacePoint& point)
        : normal_(point.normal),
          frame_(frame_about(point.specular_normal)),
          diffuse_frame_(frame_about(point.normal)),
          v_(to_local(frame_, point.to_viewer)),
          diffuse_(point.material.diffuse_albedo()),
          r0_(point.material.r0) {
        const double roughness =
            std::max(kLeastRoughness, static_cast<double>(point.material.perceptual_roughness));
        alpha_ = roughness * roughness;
        v_.z = std::max(v_.z, 1e-4);
        const bool has_specular = luminance(r0_) > 0;
        if (!has_specular) return;
        const double strength =
            luminance(r0_ + (DVec3(1) - r0_) * runtime::schlick_weight(std::min(1.0, v_.z)));
        const double other = luminance(diffuse_);
        specular_share_ = other > 0 ? std::clamp(strength / (strength + other), 0.15, 0.85) : 1.0;
    }

    /// Reflected radiance for each unit of radiance from `w`, a solid angle: f times cosine.
    DVec3 value(const DVec3& w) const {
        DVec3 sum = diffuse_ * (std::max(0.0, glm::dot(normal_, w)) / std::numbers::pi);
        if (specular_share_ > 0) {
            const DVec3 l = to_local(frame_, w);
            if (l.z > 0) {
                const DVec3 h = glm::normalize(l + v_);
                const double lobe = runtime::ggx_d(std::min(1.0, h.z), alpha_) *
                                    runtime::ggx_visibility(l.z, v_.z, alpha_) * l.z;
                const double weight = runtime::schlick_weight(std::min(1.0, glm::dot(v_, h)));
                sum += lobe * (r0_ + (DVec3(1) - r0_) * weight);
            }
        }
        return sum;
    }

    /// u.x picks the lobe, and what is left of it the direction.
    DVec3 sample(const DVec2& u) const {
        if (u.x >= specular_share_) {
            const double rest = (u.x - specular_share_) / (1 - specular_share_);
            return diffuse_frame_.to_world(sample_cosine(std::min(rest, 1 - 0x1p-53), u.y));
        }
        const DVec3 h = sample_visible_normal(v_, alpha_, u.x / specular_share_, u.y);
        return frame_.to_world(2 * glm::dot(v_, h) * h - v_);
    }

    double pdf(const DVec3& w) const {
        double density =
            (1 - specular_share_) * std::max(0.0, glm::dot(normal_, w)) / std::numbers::pi;
        if (specular_share_ > 0) {
            const DVec3 l = to_local(frame_, w);
            const DVec3 h = glm::normalize(l + v_);
            if (h.z > 0) {
                density += specular_share_ * visible_normal_pdf(v_.z, std::min(1.0, h.z), alpha_);
            }
        }
        return density;
    }

  private:
    DVec3 normal_;
    Frame frame_, diffuse_frame_;
    DVec3 v_;
    DVec3 diffuse_, r0_;
    double alpha_ = 1;
    double specular_share_ = 0;
};

/// The light sum_i l_i Y_i(w); negative where the sum is.
class TruncatedLight {
  public:
    explicit TruncatedLight(std::span<const Vec3> coeffs)
        : coeffs_(coeffs),
          bands_(static_cast<int>(std::lround(std::sqrt(static_cast<double>(coeffs.size()))))) {}
    bool given() const { return bands_ > 0; }
    DVec3 towards(const DVec3& w) const {
        std::array<double, sh::coeff_count(sh::kMaxBundleBands)> basis{};
        sh::evaluate(bands_, w.x, w.y, w.z, basis.data());
        DVec3 sum(0);
        for (std::size_t i = 0; i < coeffs_.size(); ++i) sum += basis[i] * DVec3(coeffs_[i]);
        return sum;
    }
    /// Exit radiance of a white Lambert surface that faces `n` and has nothing above it, exactly.
    DVec3 unoccluded_exit(const DVec3& n) const {
        std::array<double, sh::coeff_count(sh::kMaxBundleBands)> basis{};
        sh::evaluate(bands_, n.x, n.y, n.z, basis.data());
        DVec3 sum(0);
        for (int l = 0; l < bands_; ++l) {
            const double cosine = sh::clamped_cosine(l) / std::numbers::pi;
            for (auto i = static_cast<std::size_t>(sh::index(l, -l));
                 i <= static_cast<std::size_t>(sh::index(l, l)); ++i)
                sum += cosine * basis[i] * DVec3(coeffs_[i]);
        }
        return sum;
    }

  private:
    std::span<const Vec3> coeffs_;
    int bands_ = 0;
};

/// Adds up light whose ray is free, and truncated light whose ray is blocked; sixteen rays at a
/// time.
class Shadows {
  public:
    struct Sums {
        DVec3 light{0}, truncated{0};  ///< truncated: what is missing from the unoccluded answer
    };
    Shadows(const Tracer& tracer, const DVec3& origin) : tracer_(tracer), origin_(origin) {}

    void add(const DVec3& w, const DVec3& light, const DVec3& truncated, Sums& sums) {
        const auto slot = static_cast<std::size_t>(count_);
        packet_.x[slot] = static_cast<float>(w.x);
        packet_.y[slot] = static_cast<float>(w.y);
        packet_.z[slot] = static_cast<float>(w.z);
        light_[slot] = {light, truncated};
        sums_[slot] = &sums;
        if (++count_ == 16) flush();
    }
    void flush() {
        if (count_ == 0) return;
        const std::uint32_t active = (1u << count_) - 1;
        for (std::size_t i = static_cast<std::size_t>(count_); i < 16; ++i) {
            packet_.x[i] = packet_.x[0];
            packet_.y[i] = packet_.y[0];
            packet_.z[i] = packet_.z[0];
        }
        const std::uint32_t blocked = tracer_.occluded16(origin_, packet_, active);
        for (std::size_t i = 0; i < static_cast<std::size_t>(count_); ++i) {
            if (blocked >> i & 1)
                sums_[i]->truncated += light_[i].truncated;
            else
                sums_[i]->light += light_[i].light;
        }
        count_ = 0;
    }

  private:
    const Tracer& tracer_;
    DVec3 origin_;
    DirectionPacket packet_{};
    std::array<Sums, 16> light_;
    std::array<Sums*, 16> sums_{};
    int count_ = 0;
};

/// Everything that all pixels share.
struct View {
    const Scene& scene;
    const Tracer& tracer;
    const EnvironmentSampler& sampler;
    const TruncatedLight& truncated;
    const ReferenceOptions& options;
};

using Halves = std::array<Shadows::Sums, 2>;

/// Direct light at one point, towards its viewer: two independent estimates of `samples` each.
Halves direct_light(const View& view, const SurfacePoint& point, int samples,
                    std::array<LightPoints, 2>& points) {
    const Bsdf bsdf(point);
    const bool from_environment = view.options.sampling != LightSampling::BsdfOnly;
    const bool from_bsdf = view.options.sampling != LightSampling::EnvironmentOnly;
    Halves halves;
    Shadows shadows(view.tracer, point.light_origin);
    const auto add = [&](const EnvironmentSampler::Light& light, double bsdf_pdf,
                         Shadows::Sums& sums) {
        // The balance heuristic, one sample of each: f / (p1 + p2), whichever picked the direction.
        const double density = (from_environment ? light.pdf : 0.0) + (from_bsdf ? bsdf_pdf : 0.0);
        if (!(density > 0)) return;
        const DVec3 share = bsdf.value(light.direction) / density;
        if (share == DVec3(0)) return;
        const DVec3 truncated =
            view.truncated.given() ? share * view.truncated.towards(light.direction) : DVec3(0);
        shadows.add(light.direction, share * DVec3(light.radiance), truncated, sums);
    };
    for (std::size_t half = 0; half < 2; ++half) {
        for (int i = 0; i < samples; ++i) {
            if (from_environment) {
                const DVec2& u = points[half].environment.next();
                const auto light = view.sampler.sample(u.x, u.y);
                if (light.pdf > 0) add(light, bsdf.pdf(light.direction), halves[half]);
            }
            if (from_bsdf) {
                const DVec3 w = bsdf.sample(points[half].bsdf.next());
                add(view.sampler.towards(w), bsdf.pdf(w), halves[half]);
            }
        }
    }
    shadows.flush();
    // Of the truncated light only the blocked part is left to chance: integral of V f L is integral
    // of f L, known, less that of (1 - V) f L.
    const DVec3 unoccluded =
        view.truncated.given() ? view.truncated.unoccluded_exit(point.normal) : DVec3(0);
    for (Shadows::Sums& sums : halves) {
        sums.light /= samples;
        sums.truncated = unoccluded - sums.truncated / static_cast<double>(samples);
    }
    return halves;
}

Picture blank(const Camera& camera) {
    const auto pixels =
        static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    return {camera.width, camera.height, std::vector<Vec3>(pixels), std::vector<float>(pixels)};
}

/// rms of the error of the mean of two halves, (a - b) / 2, over the rms of the mean.
struct Noise {
    double error = 0, signal = 0;
    void add(const DVec3& a, const DVec3& b) {
        error += glm::dot(a - b, a - b) / 4;
        signal += glm::dot(a + b, a + b) / 4;
    }
    void add(const Noise& other) {
        error += other.error;
        signal += other.signal;
    }
    double relative_rms() const { return signal > 0 ? std::sqrt(error / signal) : 0; }
};

}  // namespace

Reference render_reference(const Scene& scene, const Tracer& tracer, const Environment& environment,
                           const Camera& camera, const ReferenceOptions& options,
                           Progress& progress) {
    const EnvironmentSampler sampler(environment, options.light_turn);
    assert(options.truncated_light.empty() || options.white_lambert);
    const TruncatedLight truncated(options.truncated_light);
    const View view{scene, tracer, sampler, truncated, options};
    const CameraRays rays(camera);
    const int sights = options.sights_per_axis * options.sights_per_axis;
    const int samples = std::max(1, options.samples_per_pixel / (2 * sights));

    Reference reference;
    reference.picture = blank(camera);
    if (truncated.given()) reference.truncated = blank(camera);
    struct RowNoise {
        Noise light, truncated;
    };
    std::vector<RowNoise> row_noise(static_cast<std::size_t>(camera.height));
    progress.begin("reference", "rows", static_cast<std::uint64_t>(camera.height));
    parallel_for(static_cast<std::size_t>(camera.height), [&](std::size_t row) {
        std::vector<DVec2> points;
        Sight sight;
        for (int x = 0; x < camera.width; ++x) {
            const std::size_t pixel =
                row * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(x);
            RandomStream random(options.seed, kLightStream, pixel);
            std::array<LightPoints, 2> light_points{LightPoints(random), LightPoints(random)};
            Halves halves;  // light from surfaces
            DVec3 background(0), emission(0), truncated_background(0);
            double background_share = 0;
            pixel_points(camera, x, static_cast<int>(row), options.sights_per_axis, points);
            for (const DVec2& at : points) {
                const DVec3 direction = rays.towards(at.x, at.y);
                look_along(scene, tracer, camera.position, direction, sight);
                for (Layer& layer : sight.layers) {
                    if (options.white_lambert)
                        layer.point.material = white_material(layer.point.material);
                    const double weight = static_cast<double>(layer.weight);
                    emission += weight * DVec3(layer.point.material.emission);
                    const Halves light = direct_light(view, layer.point, samples, light_points);
                    for (std::size_t k = 0; k < 2; ++k) {
                        halves[k].light += weight * light[k].light;
                        halves[k].truncated += weight * light[k].truncated;
                    }
                }
                const double share = static_cast<double>(sight.background);
                background_share += share;
                if (share <= 0) continue;
                background += share * DVec3(sampler.towards(direction).radiance);
                if (truncated.given()) truncated_background += share * truncated.towards(direction);
            }
            const auto store = [&](Picture& picture, const DVec3& first, const DVec3& second,
                                   const DVec3& behind, Noise& noise) {
                const DVec3 a = (first + emission) / static_cast<double>(sights);
                const DVec3 b = (second + emission) / static_cast<double>(sights);
                picture.radiance[pixel] =
                    Vec3((a + b) / 2.0 + behind / static_cast<double>(sights));
                picture.surface[pixel] = static_cast<float>(1 - background_share / sights);
                if (picture.is_surface(pixel)) noise.add(a, b);
            };
            store(reference.picture, halves[0].light, halves[1].light, background,
                  row_noise[row].light);
            if (reference.truncated) {
                store(*reference.truncated, halves[0].truncated, halves[1].truncated,
                      truncated_background, row_noise[row].truncated);
            }
        }
        progress.add(1);
    });
    RowNoise total;
    for (const RowNoise& row : row_noise) {
        total.light.add(row.light);
        total.truncated.add(row.truncated);
    }
    reference.noise_rms = total.light.relative_rms();
    reference.truncated_noise_rms = total.truncated.relative_rms();
    return reference;
}

}  // namespace envbake
