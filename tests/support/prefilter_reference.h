// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/support/environments.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake::test {

/// Prefiltered radiance by brute force: every texel of the source against every direction asked, in
/// double, each texel cut until it is small beside the lobe, beside its distance and at the
/// horizon. GGX as written in [Walter07] eq. 33 at n.h = cos(theta / 2), and the integral of the
/// weight by the same means: neither the formula nor the norm of the baker.
class PrefilterReference {
  public:
    explicit PrefilterReference(const Environment& environment)
        : texels_(texels_of(environment.grid)) {
        for (std::size_t i = 0; i < texels_.size(); ++i) {
            const Texel& t = texels_[i];
            const double omega = t.face < 0 ? (std::cos(t.a0) - std::cos(t.a1)) * (t.b1 - t.b0)
                                            : cube::solid_angle(t.b0, t.b1, t.a0, t.a1);
            const DVec3 radiance(environment.radiance[i]);
            mean_ += radiance * (omega / (4 * std::numbers::pi));
            if (radiance != DVec3{0}) {
                lit_.push_back({t, t.middle(), omega, size_of(t), radiance});
            }
        }
    }

    const DVec3& mean() const { return mean_; }

    DVec3 value(const DVec3& d, double perceptual_roughness) const {
        const double alpha = perceptual_roughness * perceptual_roughness;
        DVec3 sum{0};
        for (const Lit& s : lit_) {
            const double mu = glm::dot(s.middle, d);
            if (mu < -1.5 * s.size) continue;
            const double distance = glm::length(s.middle - d);
            if (s.size < 0.01 && distance > 0.5 && mu > 1.5 * s.size) {
                sum += s.radiance * (s.omega * weight(1 - mu, alpha));
            } else {
                sum += s.radiance * over(s.texel, d, alpha, 0);
            }
        }
        return sum / norm(alpha);
    }

    /// |v - r| / (r + 1e-3 mean), worst channel: the norm of MipsJob::tolerance.
    double error(const DVec3& value, const DVec3& reference) const {
        double worst = 0;
        for (int k = 0; k < 3; ++k) {
            const double against = reference[k] + 1e-3 * mean_[k];
            if (against > 0) worst = std::max(worst, std::abs(value[k] - reference[k]) / against);
        }
        return worst;
    }

    /// Of u = 1 - mu.
    static double weight(double u, double alpha) {
        if (u >= 1) return 0;
        const double sin2 = u / 2;  // 1 - (n.h)^2
        const double denominator = sin2 + alpha * alpha * (1 - sin2);
        return alpha * alpha / (std::numbers::pi * denominator * denominator) * (1 - u);
    }

    /// Integral of weight() over the hemisphere, in s = ln(alpha^2 + 1 - mu): the peak is spread
    /// out.
    static double norm(double alpha) {
        const double a2 = alpha * alpha, first = std::log(a2), last = std::log(a2 + 1);
        constexpr int kSteps = 2000;
        double sum = 0;
        for (int i = 0; i <= kSteps; ++i) {
            const double s = first + (last - first) * i / kSteps;
            const double simpson = i == 0 || i == kSteps ? 1 : (i % 2 == 1 ? 4 : 2);
            const double u = i == kSteps ? 1 : a2 * std::expm1(s - first);
            sum += simpson * weight(u, alpha) * std::exp(s);
        }
        return 2 * std::numbers::pi * sum * (last - first) / kSteps / 3;
    }

  private:
    struct Lit {
        Texel texel;
        DVec3 middle;
        double omega, size;
        DVec3 radiance;
    };

    static DVec2 sides(const Texel& t) {
        const double half_pi = std::numbers::pi / 2;
        return {t.a1 - t.a0,
                (t.b1 - t.b0) * (t.face < 0 ? std::sin(std::clamp(half_pi, t.a0, t.a1)) : 1.0)};
    }
    static double size_of(const Texel& t) { return std::max(sides(t).x, sides(t).y); }

    static double over(const Texel& t, const DVec3& d, double alpha, int depth) {
        const DVec3 middle = t.middle();
        const DVec2 side = sides(t);
        const double size = std::max(side.x, side.y);
        const double mu = glm::dot(middle, d);
        if (mu < -1.5 * size) return 0;
        const double distance = std::max(0.0, glm::length(middle - d) - size);
        const double scale = std::sqrt(4 * alpha * alpha + distance * distance);
        const bool cut = std::abs(mu) < size && size > 5e-4;
        if (depth < 30 && (size > std::min(0.1, 0.15 * scale) || cut)) {
            const bool split_a = side.x > 0.6 * side.y, split_b = side.y > 0.6 * side.x;
            double sum = 0;
            for (int i = 0; i < (split_a ? 2 : 1); ++i) {
                for (int j = 0; j < (split_b ? 2 : 1); ++j) {
                    Texel part = t;
                    if (split_a) (i == 0 ? part.a1 : part.a0) = (t.a0 + t.a1) / 2;
                    if (split_b) (j == 0 ? part.b1 : part.b0) = (t.b0 + t.b1) / 2;
                    sum += over(part, d, alpha, depth + 1);
                }
            }
            return sum;
        }
        double sum = 0;
        for (const double s : {-0.5773502691896257, 0.5773502691896257}) {
            for (const double r : {-0.5773502691896257, 0.5773502691896257}) {
                const double a = (t.a0 + t.a1) / 2 + s * (t.a1 - t.a0) / 2;
                const double b = (t.b0 + t.b1) / 2 + r * (t.b1 - t.b0) / 2;
                const DVec3 apart = t.towards(a, b) - d;
                sum += t.density(a, b) * weight(glm::dot(apart, apart) / 2, alpha);
            }
        }
        return sum * (t.a1 - t.a0) * (t.b1 - t.b0) / 4;
    }

    std::vector<Texel> texels_;
    std::vector<Lit> lit_;
    DVec3 mean_{0};
};

}  // namespace envbake::test
