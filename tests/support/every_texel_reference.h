// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/mips.h"
#include "baker/math/quadrature.h"
#include "tests/support/baked_mip.h"
#include "tests/support/environments.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <vector>

namespace envbake::test {

/// What a whole mip is off by.
struct MipErrors {
    double worst = 0;         ///< |v - r| / (r + 1e-3 mean), of all texels and channels
    std::size_t texel = 0;    ///< where
    double rms = 0;           ///< the root mean square over solid angle of |v - r|, over the mean
    DVec3 energy{0};          ///< sum of v over sum of r, by solid angle, minus 1
    std::size_t checked = 0;  ///< texels
};

/// Every texel of a mip against every texel of an evenly or unevenly spaced lat-long map, by brute
/// force: some 7e10 pairs for a mip of 128 and a map of 1024 x 512, half a minute to two of one
/// core.
///
/// Sixteen texels of the mip at a time, in float: u = |d - w|^2 / 2 keeps its digits, sums go to
/// double after every row. A source texel is 2 x 2 Gauss points (4 x 4 on maps of fewer than 400
/// rows), and where it is further than 60 degrees from a sharp lobe its middle; across the horizon
/// it is 4 x 4 equal parts, 32 x 32 where it is bright. Good to 3e-5 from r = 0.2 on; compared with
/// PrefilterReference, which is good at any.
class EveryTexelReference {
  public:
    EveryTexelReference(const Environment& environment, double perceptual_roughness,
                        runtime::Distribution distribution)
        : environment_(environment),
          grid_(std::get<LatLongGrid>(environment.grid)),
          beckmann_(distribution == runtime::Distribution::Beckmann),
          A_(static_cast<float>(std::pow(perceptual_roughness, 4))) {
        const double A = std::pow(perceptual_roughness, 4);
        // D of n.h = cos(theta / 2), tan^2(theta / 2) = u / (2 - u), without constant factors; the
        // norm by the same formula, Simpson's rule in s = ln(A + u).
        const auto weight = [&](double u) {
            const double tan2 = u / (2 - u), cos2 = 1 - u / 2;
            const double d = beckmann_ ? std::exp(-tan2 / A) / (cos2 * cos2)
                                       : 1 / ((cos2 * A + u / 2) * (cos2 * A + u / 2));
            return d * (1 - u);
        };
        constexpr int kSteps = 4000;
        const double first = std::log(A), last = std::log(1 + A);
        double sum = 0;
        for (int i = 0; i <= kSteps; ++i) {
            const double s = first + (last - first) * i / kSteps;
            const double u = i == kSteps ? 1 : A * std::expm1(s - first);
            sum += (i == 0 || i == kSteps ? 1 : (i % 2 == 1 ? 4 : 2)) * weight(u) * std::exp(s);
        }
        norm_ = 2 * std::numbers::pi * sum * (last - first) / kSteps / 3;

        for (std::size_t r = 0; r < slot(grid_.height); ++r) {
            heights_.push_back(std::cos(grid_.theta_edges[r]) - std::cos(grid_.theta_edges[r + 1]));
        }
        for (std::size_t c = 0; c < slot(grid_.width); ++c) {
            widths_.push_back(grid_.phi_edges[c + 1] - grid_.phi_edges[c]);
        }
        rule_ = gauss_legendre(grid_.height >= 400 ? 2 : 4);
        nearest_middle_ = perceptual_roughness < 0.4 && grid_.height >= 400 ? 0.5 : -1;
        const double whole = 4 * std::numbers::pi;
        for (std::size_t r = 0; r < slot(grid_.height); ++r) {
            for (std::size_t c = 0; c < slot(grid_.width); ++c) {
                mean_ += radiance(r, c) * (heights_[r] * widths_[c] / whole);
            }
        }
    }

    const DVec3& mean() const { return mean_; }

    /// `every` = n looks at each n-th group of 16 texels only.
    MipErrors check(const Mip& mip, std::size_t every = 1) const {
        MipErrors errors;
        DVec3 sum{0}, truth{0};
        double omega = 0;
        const std::vector<std::array<std::size_t, kLanes>> groups = groups_of(mip);
        for (std::size_t g = 0; g < groups.size(); g += every) {
            std::array<DVec3, kLanes> directions, values{};
            for (std::size_t i = 0; i < kLanes; ++i) {
                directions[i] = direction_of(mip, groups[g][i]);
            }
            evaluate(directions, values);
            for (std::size_t i = 0; i < kLanes; ++i) {
                if (i > 0 && groups[g][i] == groups[g][i - 1]) continue;
                const DVec3 v = texel_of(mip, groups[g][i]);
                const double weight = solid_angle_of(mip, groups[g][i]);
                for (int k = 0; k < mip.channels; ++k) {
                    const double against = values[i][k] + 1e-3 * mean_[k];
                    const double off = std::abs(v[k] - values[i][k]);
                    if (against > 0 && off / against > errors.worst) {
                        errors.worst = off / against;
                        errors.texel = groups[g][i];
                    }
                    if (mean_[k] > 0) errors.rms += weight * off * off / (mean_[k] * mean_[k]);
                }
                sum += v * weight;
                truth += values[i] * weight;
                omega += weight;
                ++errors.checked;
            }
        }
        errors.rms = std::sqrt(errors.rms / (omega * mip.channels));
        for (int k = 0; k < 3; ++k) errors.energy[k] = truth[k] > 0 ? sum[k] / truth[k] - 1 : 0;
        return errors;
    }

  private:
    static constexpr std::size_t kLanes = 16;
    using Lanes = float __attribute__((vector_size(64)));

    DVec3 radiance(std::size_t row, std::size_t column) const {
        return DVec3(environment_.radiance[row * slot(grid_.width) + column]);
    }

    /// Blocks of 4 x 4 texels; the last ones of a row repeat their last texel.
    static std::vector<std::array<std::size_t, kLanes>> groups_of(const Mip& mip) {
        std::vector<std::array<std::size_t, kLanes>> groups;
        for (int face = 0; face < mip.faces; ++face) {
            for (int row = 0; row < mip.height; row += 4) {
                for (int column = 0; column < mip.width; column += 4) {
                    std::array<std::size_t, kLanes> group;
                    std::size_t last = 0;
                    for (int i = 0; i < 16; ++i) {
                        const int r = row + i / 4, c = column + i % 4;
                        if (r < mip.height && c < mip.width) {
                            last = (slot(face) * slot(mip.height) + slot(r)) * slot(mip.width) +
                                   slot(c);
                        }
                        group[slot(i)] = last;
                    }
                    groups.push_back(group);
                }
            }
        }
        return groups;
    }

    /// e^x, x <= 0, as (e^(x / 256))^256: to 2e-5 where it matters.
    static Lanes power_of_e(const Lanes& x) {
        const Lanes z = x * (1.0f / 256);
        Lanes y = 1.0f + z * (1.0f + z * 0.5f * (1.0f + z * (1.0f / 3) * (1.0f + z * 0.25f)));
        for (int i = 0; i < 8; ++i) y *= y;
        return y;
    }

    /// The weight times max(0, mu).
    template <bool kBeckmann>
    Lanes weight(const Lanes& u) const {
        const Lanes cos2 = 1.0f - u * 0.5f, mu = 1.0f - u, zero{};
        Lanes d;
        if constexpr (kBeckmann) {
            const Lanes front = mu > zero ? u : zero + 1.0f;
            d = power_of_e(front / (front - 2.0f) * (1 / A_)) / (cos2 * cos2);
        } else {
            const Lanes s = cos2 * A_ + u * 0.5f;
            d = 1.0f / (s * s);
        }
        return mu > zero ? d * mu : zero;
    }

    void evaluate(const std::array<DVec3, kLanes>& directions,
                  std::array<DVec3, kLanes>& values) const {
        if (beckmann_) {
            evaluate_with<true>(directions, values);
        } else {
            evaluate_with<false>(directions, values);
        }
    }

    template <bool kBeckmann>
    void evaluate_with(const std::array<DVec3, kLanes>& directions,
                       std::array<DVec3, kLanes>& values) const {
        Lanes x, y, z;
        DVec3 middle{0};
        for (std::size_t i = 0; i < kLanes; ++i) {
            x[i] = static_cast<float>(directions[i].x);
            y[i] = static_cast<float>(directions[i].y);
            z[i] = static_cast<float>(directions[i].z);
            middle += directions[i];
        }
        middle = glm::normalize(middle);
        double radius = 0;
        for (const DVec3& d : directions) radius = std::max(radius, glm::length(d - middle));

        const auto add = [&](const DVec3& w, float omega, Lanes& total) {
            const Lanes a = x - static_cast<float>(w.x), b = y - static_cast<float>(w.y),
                        c = z - static_cast<float>(w.z);
            total += weight<kBeckmann>((a * a + b * b + c * c) * 0.5f) * omega;
        };
        const double total_flux =
            4 * std::numbers::pi * std::max({mean_.x, mean_.y, mean_.z, 1e-300});
        for (std::size_t r = 0; r < slot(grid_.height); ++r) {
            const double t0 = grid_.theta_edges[r], t1 = grid_.theta_edges[r + 1];
            const double tm = (t0 + t1) / 2, sm = std::sin(tm), cm = std::cos(tm);
            // A row's texels are wider than high only on maps that are not 2:1.
            Lanes sum[3] = {};
            for (std::size_t c = 0; c < slot(grid_.width); ++c) {
                const DVec3 L = radiance(r, c);
                if (L == DVec3{0}) continue;
                const double p0 = grid_.phi_edges[c], p1 = grid_.phi_edges[c + 1];
                const Angle& pm = phi(c);
                const DVec3 w{sm * pm.cosine, cm, sm * pm.sine};
                const double size = std::max(t1 - t0, sm * (p1 - p0));
                const double mu = glm::dot(middle, w), reach = radius + size;
                if (mu < -reach) continue;
                const double omega = heights_[r] * widths_[c];
                Lanes total{};
                if (mu < reach) {
                    const bool bright = std::max({L.x, L.y, L.z}) * omega > 1e-5 * total_flux;
                    const int n = bright ? 32 : 4;
                    for (int i = 0; i < n; ++i) {
                        const double a0 = t0 + (t1 - t0) * i / n, a1 = t0 + (t1 - t0) * (i + 1) / n;
                        const double s = std::sin((a0 + a1) / 2), h = std::cos((a0 + a1) / 2);
                        const double part = (std::cos(a0) - std::cos(a1)) * (p1 - p0) / n;
                        for (int j = 0; j < n; ++j) {
                            const double p = p0 + (p1 - p0) * (j + 0.5) / n;
                            add({s * std::cos(p), h, s * std::sin(p)}, static_cast<float>(part),
                                total);
                        }
                    }
                } else if (mu > nearest_middle_) {
                    for (std::size_t i = 0; i < rule_.nodes.size(); ++i) {
                        const double a = tm + rule_.nodes[i] * (t1 - t0) / 2;
                        const double sine = std::sin(a), cosine = std::cos(a);
                        const double part = sine * (t1 - t0) * (p1 - p0) / 4 * rule_.weights[i];
                        for (std::size_t j = 0; j < rule_.nodes.size(); ++j) {
                            const double p = (p0 + p1) / 2 + rule_.nodes[j] * (p1 - p0) / 2;
                            add({sine * std::cos(p), cosine, sine * std::sin(p)},
                                static_cast<float>(part * rule_.weights[j]), total);
                        }
                    }
                } else {
                    add(w, static_cast<float>(omega), total);
                }
                for (int k = 0; k < 3; ++k) sum[k] += total * static_cast<float>(L[k]);
            }
            for (std::size_t i = 0; i < kLanes; ++i) {
                for (int k = 0; k < 3; ++k) {
                    values[i][k] += static_cast<double>(sum[k][i]) / norm_;
                }
            }
        }
    }

    struct Angle {
        double cosine, sine;
    };
    const Angle& phi(std::size_t column) const {
        if (phi_.empty()) {
            for (std::size_t c = 0; c < slot(grid_.width); ++c) {
                const double p = (grid_.phi_edges[c] + grid_.phi_edges[c + 1]) / 2;
                phi_.push_back({std::cos(p), std::sin(p)});
            }
        }
        return phi_[column];
    }

    const Environment& environment_;
    const LatLongGrid& grid_;
    bool beckmann_;
    float A_;
    double norm_ = 1;
    double nearest_middle_ = -1;  ///< cosine below which a texel's middle stands for it
    Quadrature rule_;             ///< along either side of a texel nearby
    std::vector<double> heights_, widths_;
    mutable std::vector<Angle> phi_;
    DVec3 mean_{0};
};

}  // namespace envbake::test
