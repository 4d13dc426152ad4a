// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/albedo_integral.h"

#include "baker/core/parallel.h"
#include "baker/math/quadrature.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake {
namespace {

using runtime::Distribution;

// The integral over l becomes one over h (dl = 4 (v.h) dh), h = (theta, phi) about n, v in the
// plane phi = 0:
//
//     A + B = integral of D(h) V(l, v) (n.l) 4 (v.h) dh
//
// t = tan(theta) / alpha removes alpha from D,
//
//     D(h) (n.h) dh = t / (pi (1 + t^2)^2) dt dphi    GGX
//                     t exp(-t^2) / pi dt dphi        Beckmann
//
// and z = asinh(t) the long tail, so no alpha is too small. V is 1 / (2 (n.l s(v) + n.v s(l))),
// s = n.w (1 + 2 Lambda(w)). Two panels in theta. Inside (pi/2 - theta_v) / 2 every phi reflects v
// above the horizon, and the integrand is periodic in phi. Outside, phi ends where n.l = 0, and the
// integrand has square roots at both ends of the panel, which a smoothstep removes.

/// The four one-dimensional rules, and where the panels may stop in z: for GGX what lies beyond is
/// below 4 exp(-2 z) inside and below exp(-z) outside, for Beckmann below exp(-sinh^2 z).
struct Rules {
    Quadrature inner_theta, inner_phi, outer_theta, outer_phi;
    double inner_end, outer_end;
};

/// Gauss-Legendre on [0, 1].
Quadrature unit_gauss_legendre(int count) {
    Quadrature rule = gauss_legendre(count);
    for (double& node : rule.nodes) node = (1 + node) / 2;
    for (double& weight : rule.weights) weight /= 2;
    return rule;
}

/// `counts`: inner theta, inner phi, outer theta, outer phi.
Rules make_rules(std::array<int, 4> counts, double inner_end, double outer_end) {
    Rules rules{unit_gauss_legendre(counts[0]), {},        unit_gauss_legendre(counts[2]),
                unit_gauss_legendre(counts[3]), inner_end, outer_end};
    // Twice the half circle by the midpoint rule: exact for trigonometric polynomials. The nodes
    // are kept as cos(phi).
    for (int i = 0; i < counts[1]; ++i) {
        rules.inner_phi.nodes.push_back(std::cos(std::numbers::pi * (i + 0.5) / counts[1]));
        rules.inner_phi.weights.push_back(2 * std::numbers::pi / counts[1]);
    }
    for (std::size_t i = 0; i < rules.outer_theta.nodes.size(); ++i) {
        double& x = rules.outer_theta.nodes[i];
        rules.outer_theta.weights[i] *= 6 * x * (1 - x);
        x = x * x * (3 - 2 * x);
    }
    return rules;
}

double sinh_positive(double z) {
    return std::sinh(z);
}

double exponential(double z) {
    return std::exp(z);
}

/// e^z for z up to 87, relative error 2e-7; below -87 it stays at e^-87. Made of operations that
/// compilers turn into vector instructions; the library's own function is not.
float exponential(float z) {
    z = z > -87 ? z : -87;
    const int power = static_cast<int>(z * std::numbers::log2e_v<float> + (z < 0 ? -0.5f : 0.5f));
    const float p = static_cast<float>(power);
    const float f = (z - p * 0.693359375f) + p * 2.12194440e-4f;  // z - p ln 2, ln 2 in two parts
    // exp(f) for |f| <= ln(2) / 2 by its Taylor polynomial: the next term is below 1e-8.
    float e = 1 / 5040.0f;
    e = e * f + 1 / 720.0f;
    e = e * f + 1 / 120.0f;
    e = e * f + 1 / 24.0f;
    e = e * f + 1 / 6.0f;
    e = e * f + 0.5f;
    e = e * f + 1.0f;
    e = e * f + 1.0f;
    return e * std::bit_cast<float>((power + 127) << 23);
}

/// Relative error below 1e-6 for z in [0.1, 80], absolute below 1e-7 under that.
float sinh_positive(float z) {
    const float e = exponential(z);
    return (e - 1 / e) / 2;
}

/// exp(-a^2) / sqrt(pi) - a erfc(a), the integral of erfc from a to infinity.
double ierfc(double a) {
    return std::exp(-a * a) * std::numbers::inv_sqrtpi - a * std::erfc(a);
}

/// ierfc as lines between 4096 points, even in a / (1 + a): within 1e-8, and gathered by lanes.
class IerfcTable {
  public:
    IerfcTable() {
        for (std::size_t i = 0; i < kCount; ++i) {
            const double x = static_cast<double>(i) / kCount;
            values_[i] = static_cast<float>(ierfc(x / (1 - x)));
        }
    }
    float operator()(float a) const {
        const float x = a / (1 + a) * kCount;
        const int i = std::min(static_cast<int>(x), static_cast<int>(kCount) - 1);
        const float low = values_[static_cast<std::size_t>(i)];
        return low + (x - static_cast<float>(i)) * (values_[static_cast<std::size_t>(i) + 1] - low);
    }

  private:
    static constexpr std::size_t kCount = 4096;
    std::array<float, kCount + 1> values_{};  // the last, at infinity, is 0
};
const IerfcTable kIerfcTable;

struct Ggx {
    /// D(h) (n.h) dh over dz dphi, root = cosh z = sqrt(1 + t^2).
    template <class Real>
    static Real density(Real t, Real root) {
        return t / (std::numbers::pi_v<Real> * root * root * root);
    }
    /// s = sqrt(alpha^2 + (1 - alpha^2) c^2)
    template <class Real>
    static Real s(Real c, Real alpha, Real alpha2) {
        (void)alpha;
        return std::sqrt(alpha2 + (1 - alpha2) * c * c);
    }
};

struct Beckmann {
    template <class Real>
    static Real density(Real t, Real root) {
        return t * root * exponential(-t * t) * std::numbers::inv_pi_v<Real>;
    }
    /// s = c + alpha sin(theta) ierfc(c / (alpha sin(theta))): Lambda of runtime/brdf.h, without
    /// its division by c.
    template <class Real>
    static Real s(Real c, Real alpha, Real) {
        const Real scale = alpha * std::sqrt((1 - c) * (1 + c)) + Real(1e-30);
        return c + scale * integral_of_erfc(c / scale);
    }

  private:
    static double integral_of_erfc(double a) { return ierfc(a); }
    static float integral_of_erfc(float a) { return kIerfcTable(a); }
};

/// kLanes integrals side by side: every loop over lanes is one vector instruction after another.
template <class Lobe, class Real, std::size_t kLanes>
class Batch {
  public:
    std::array<double, kLanes> n_dot_v{}, alpha{};  ///< alpha > 0
    std::array<double, kLanes> a{}, b{};            ///< the results

    void integrate(const Rules& rules) {
        const bool needs_outer = place_panels(rules);
        integrate_inner(rules);
        if (needs_outer) integrate_outer(rules);
    }

  private:
    using Lanes = std::array<Real, kLanes>;

    bool place_panels(const Rules& rules) {
        bool needs_outer = false;
        for (std::size_t k = 0; k < kLanes; ++k) {
            const double c = n_dot_v[k], s = std::sqrt((1 - c) * (1 + c)), w = alpha[k];
            const double tan_middle = c / (1 + s);  // of (pi/2 - theta_v) / 2
            const double middle = std::asinh(tan_middle / w);
            const double end = tan_middle > 0 ? std::asinh(1 / (tan_middle * w)) : rules.outer_end;
            const double outer =
                middle < rules.inner_end ? std::min(end, rules.outer_end) - middle : 0;
            inner_width_[k] = static_cast<Real>(std::min(middle, rules.inner_end));
            outer_begin_[k] = static_cast<Real>(middle);
            outer_width_[k] = static_cast<Real>(std::max(outer, 0.0));
            needs_outer = needs_outer || outer > 0;

            cos_v_[k] = static_cast<Real>(c);
            sin_v_[k] = static_cast<Real>(s);
            width_[k] = static_cast<Real>(w);
            width2_[k] = static_cast<Real>(w * w);
            s_v_[k] = static_cast<Real>(Lobe::template s<double>(c, w, w * w));
            a[k] = b[k] = 0;
        }
        return needs_outer;
    }

    void integrate_inner(const Rules& rules) {
        for (std::size_t i = 0; i < rules.inner_theta.nodes.size(); ++i) {
            const Real node = static_cast<Real>(rules.inner_theta.nodes[i]);
            const Real weight = static_cast<Real>(rules.inner_theta.weights[i]);
            for (std::size_t k = 0; k < kLanes; ++k) {
                begin_ring(k, inner_width_[k] * node, inner_width_[k] * weight);
            }
            for (std::size_t j = 0; j < rules.inner_phi.nodes.size(); ++j) {
                const Real cos_phi = static_cast<Real>(rules.inner_phi.nodes[j]);
                const Real phi_weight = static_cast<Real>(rules.inner_phi.weights[j]);
                for (std::size_t k = 0; k < kLanes; ++k) add_point(k, cos_phi, phi_weight);
            }
            end_ring();
        }
    }

    void integrate_outer(const Rules& rules) {
        Lanes q_end;
        for (std::size_t i = 0; i < rules.outer_theta.nodes.size(); ++i) {
            const Real node = static_cast<Real>(rules.outer_theta.nodes[i]);
            const Real weight = static_cast<Real>(rules.outer_theta.weights[i]);
            for (std::size_t k = 0; k < kLanes; ++k) {
                begin_ring(k, outer_begin_[k] + outer_width_[k] * node, outer_width_[k] * weight);
            }
            // phi through q = tan(phi / 4), algebraic both ways and as smooth as phi itself.
            for (std::size_t k = 0; k < kLanes; ++k) {
                Real c = -n_l_constant_[k] / (n_l_slope_[k] + Real(1e-30));
                c = c > -1 ? (c < 1 ? c : 1) : -1;
                const Real cos_half = std::sqrt((1 + c) / 2);
                q_end[k] = std::sqrt((1 - cos_half) / (1 + cos_half));
            }
            for (std::size_t j = 0; j < rules.outer_phi.nodes.size(); ++j) {
                const Real q_node = static_cast<Real>(rules.outer_phi.nodes[j]);
                const Real q_weight = static_cast<Real>(8 * rules.outer_phi.weights[j]);
                for (std::size_t k = 0; k < kLanes; ++k) {
                    const Real q = q_end[k] * q_node;
                    const Real inverse = 1 / (1 + q * q);
                    const Real cos_half = (1 - q * q) * inverse;
                    add_point(k, 2 * cos_half * cos_half - 1, q_end[k] * q_weight * inverse);
                }
            }
            end_ring();
        }
    }

    /// A ring of constant theta: all that does not depend on phi.
    void begin_ring(std::size_t k, Real z, Real z_weight) {
        const Real t = sinh_positive(z);
        const Real tangent = width_[k] * t;
        const Real secant2 = 1 + tangent * tangent;
        const Real secant = std::sqrt(secant2);
        const Real root = std::sqrt(1 + t * t);
        ring_weight_[k] = z_weight * 2 * secant * Lobe::density(t, root);
        v_h_constant_[k] = cos_v_[k] / secant;
        v_h_slope_[k] = sin_v_[k] * tangent / secant;
        // n.l = n.v cos(2 theta) + sin(theta_v) sin(2 theta) cos(phi): small angles cancel less
        // than in 2 (v.h) (n.h) - n.v.
        n_l_constant_[k] = cos_v_[k] * (1 - tangent * tangent) / secant2;
        n_l_slope_[k] = sin_v_[k] * 2 * tangent / secant2;
        ring_a_[k] = ring_b_[k] = 0;
    }

    void add_point(std::size_t k, Real cos_phi, Real phi_weight) {
        const Real v_h = v_h_constant_[k] + v_h_slope_[k] * cos_phi;
        Real n_l = n_l_constant_[k] + n_l_slope_[k] * cos_phi;
        n_l = n_l > 0 ? n_l : 0;
        n_l = n_l < 1 ? n_l : 1;
        const Real s_l = Lobe::s(n_l, width_[k], width2_[k]);
        const Real f = ring_weight_[k] * phi_weight * n_l * v_h /
                       (n_l * s_v_[k] + cos_v_[k] * s_l + Real(1e-30));
        const Real fresnel = runtime::schlick_weight(v_h);
        ring_a_[k] += f * (1 - fresnel);
        ring_b_[k] += f * fresnel;
    }

    void end_ring() {
        for (std::size_t k = 0; k < kLanes; ++k) {
            a[k] += static_cast<double>(ring_a_[k]);
            b[k] += static_cast<double>(ring_b_[k]);
        }
    }

    alignas(64) Lanes cos_v_, sin_v_, width_, width2_, s_v_;
    alignas(64) Lanes inner_width_, outer_begin_, outer_width_;
    alignas(64) Lanes ring_weight_, v_h_constant_, v_h_slope_, n_l_constant_, n_l_slope_;
    alignas(64) Lanes ring_a_, ring_b_;
};

DVec2 mirror(double n_dot_v) {
    const double b = runtime::schlick_weight(n_dot_v);
    return {1 - b, b};
}

/// In slices of kLanes points that share nothing.
template <class Lobe, class Real, std::size_t kLanes>
std::vector<DVec2> integrate(const Rules& rules, std::span<const DVec2> points) {
    std::vector<DVec2> results(points.size());
    constexpr std::size_t kSlices = 8;  // of one task
    const std::size_t slice_count = (points.size() + kLanes - 1) / kLanes;
    parallel_for((slice_count + kSlices - 1) / kSlices, [&](std::size_t task) {
        const std::size_t last = std::min(slice_count, (task + 1) * kSlices);
        Batch<Lobe, Real, kLanes> batch;
        for (std::size_t slice = task * kSlices; slice < last; ++slice) {
            // A short last slice repeats its last point.
            const std::size_t begin = slice * kLanes;
            const auto source = [&](std::size_t k) {
                return std::min(begin + k, points.size() - 1);
            };
            for (std::size_t k = 0; k < kLanes; ++k) {
                const DVec2 p = points[source(k)];
                batch.n_dot_v[k] = p.x;
                batch.alpha[k] = p.y > 0 ? p.y * p.y : 1;
            }
            batch.integrate(rules);
            for (std::size_t k = 0; k < kLanes; ++k) {
                const DVec2 p = points[source(k)];
                results[source(k)] = p.y > 0 ? DVec2(batch.a[k], batch.b[k]) : mirror(p.x);
            }
        }
    });
    return results;
}

template <std::size_t kLanes>
std::vector<DVec2> integrate_in_double(Distribution distribution, std::span<const DVec2> points,
                                       int nodes) {
    const std::array<int, 4> counts{2 * nodes, nodes, 2 * nodes, nodes};
    return distribution == Distribution::Ggx
               ? integrate<Ggx, double, kLanes>(make_rules(counts, 13, 26), points)
               : integrate<Beckmann, double, kLanes>(make_rules(counts, 2.6, 2.6), points);
}

}  // namespace

std::vector<DVec2> albedo_integrals(Distribution distribution, std::span<const DVec2> points) {
    // Theta decides. GGX: 20 inner nodes leave 1.5e-6 at n.v = 1, 32 outer ones 1e-5 at n.v = 0.
    if (distribution == Distribution::Ggx) {
        return integrate<Ggx, float, 16>(make_rules({24, 12, 44, 13}, 9, 18), points);
    }
    return integrate<Beckmann, float, 16>(make_rules({16, 10, 28, 10}, 2.2, 2.2), points);
}

std::vector<DVec2> exact_albedo_integrals(Distribution distribution, std::span<const DVec2> points,
                                          int nodes) {
    return integrate_in_double<8>(distribution, points, nodes);
}

DVec2 albedo_integral(Distribution distribution, DVec2 point, int nodes) {
    return integrate_in_double<1>(distribution, std::span(&point, 1), nodes)[0];
}

}  // namespace envbake
