// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/table.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/math/quadrature.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake {
namespace {

using runtime::TableAxes;

// The integral over l becomes one over h (dl = 4 (v.h) dh), h = (theta, phi) about n, v in the
// plane phi = 0:
//
//     A + B = integral of D(h) V(l, v) (n.l) 4 (v.h) dh
//
// t = tan(theta) / alpha removes alpha from D, D(h) (n.h) dh = t dt dphi / (pi (1 + t^2)^2), and
// z = asinh(t) the long tail, so no alpha is too small. Two panels in theta. Inside (pi/2 -
// theta_v) / 2 every phi reflects v above the horizon, and the integrand is periodic in phi.
// Outside, phi ends where n.l = 0, and the integrand has square roots at both ends of the panel,
// which a smoothstep removes.

/// The four one-dimensional rules, and where the panels may stop in z: what lies beyond is below
/// 4 exp(-2 z) inside and below exp(-z) outside.
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

/// Relative error below 1e-6 for z in [0.1, 80], absolute below 1e-7 under that. Made of operations
/// that compilers turn into vector instructions; the library's own function is not.
float sinh_positive(float z) {
    const int power = static_cast<int>(z * std::numbers::log2e_v<float> + 0.5f);
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
    e *= std::bit_cast<float>((power + 127) << 23);
    return (e - 1 / e) / 2;
}

/// kLanes integrals side by side: every loop over lanes is one vector instruction after another.
template <class Real, std::size_t kLanes>
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
            s_v_[k] = static_cast<Real>(std::sqrt(w * w + (1 - w * w) * c * c));
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
        ring_weight_[k] =
            z_weight * 2 * t * secant / (std::numbers::pi_v<Real> * root * root * root);
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
        const Real s_l = std::sqrt(width2_[k] + (1 - width2_[k]) * n_l * n_l);
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

/// One integral in double.
DVec2 integrate(const Rules& rules, double n_dot_v, double perceptual_roughness) {
    const double alpha = perceptual_roughness * perceptual_roughness;
    if (!(alpha > 0)) return mirror(n_dot_v);
    Batch<double, 1> batch;
    batch.n_dot_v[0] = n_dot_v;
    batch.alpha[0] = alpha;
    batch.integrate(rules);
    return {batch.a[0], batch.b[0]};
}

Rules reference_rules(int nodes) {
    return make_rules({2 * nodes, nodes, 2 * nodes, nodes}, 13, 26);
}

// Errors of these counts over 128 x 128 texels of either axes: below 5e-7, most of it from float.
// Theta decides: 20 inner nodes leave 1.5e-6 at n.v = 1, 32 outer ones 1e-5 at n.v = 0.
constexpr std::array<int, 4> kTableNodes{28, 16, 48, 14};
constexpr std::size_t kLanes = 16;

/// The table's own rule at any number of points, in slices of kLanes that share nothing.
void integrate(const Rules& rules, const std::vector<DVec2>& points, std::vector<DVec2>& results) {
    results.resize(points.size());
    constexpr std::size_t kSlices = 8;  // of one task
    const std::size_t slice_count = (points.size() + kLanes - 1) / kLanes;
    parallel_for((slice_count + kSlices - 1) / kSlices, [&](std::size_t task) {
        const std::size_t last = std::min(slice_count, (task + 1) * kSlices);
        Batch<float, kLanes> batch;
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
}

/// Rounds to float and keeps A + B <= 1, which the rule's error of 1e-7 may miss.
Vec2 to_texel(DVec2 value) {
    const float a = static_cast<float>(std::clamp(value.x, 0.0, 1.0));
    const double rest = 1 - static_cast<double>(a);
    float b = static_cast<float>(std::clamp(value.y, 0.0, rest));
    if (static_cast<double>(b) > rest) b = std::nextafter(b, 0.0f);
    return {a, b};
}

DVec2 look_up(const BrdfTable& table, TableAxes axes, DVec2 point) {
    const auto locate = [&](double value) {
        const double position = runtime::table_position(axes, value, table.size);
        const int index = std::min(static_cast<int>(position), table.size - 2);
        return std::pair(static_cast<std::size_t>(index), position - index);
    };
    const auto [column, x] = locate(point.x);
    const auto [row, y] = locate(point.y);
    const std::size_t first = row * static_cast<std::size_t>(table.size) + column;
    const std::size_t second = first + static_cast<std::size_t>(table.size);
    const DVec2 low = glm::mix(DVec2(table.texels[first]), DVec2(table.texels[first + 1]), x);
    const DVec2 high = glm::mix(DVec2(table.texels[second]), DVec2(table.texels[second + 1]), x);
    return glm::mix(low, high, y);
}

double worse(DVec2 a, DVec2 b) {
    return std::max(std::abs(a.x - b.x), std::abs(a.y - b.y));
}

void measure_texels(const std::vector<DVec2>& points, BrdfTable& table) {
    // Half of the sample favours the texels that are hardest, those of small n.v and roughness.
    constexpr std::size_t kSamples = 64;
    const Rules rules = reference_rules(48);
    std::array<double, kSamples> errors{};
    parallel_for(kSamples, [&](std::size_t i) {
        RandomStream random(0, 0, i);
        const auto pick = [&](double x) {
            return std::min(static_cast<std::size_t>(x * table.size),
                            static_cast<std::size_t>(table.size - 1));
        };
        double x = random.next(), y = random.next();
        if (i % 2 == 0) {
            x = x * x * x;
            y = y * y;
        }
        const std::size_t texel = pick(y) * static_cast<std::size_t>(table.size) + pick(x);
        const DVec2 truth = integrate(rules, points[texel].x, points[texel].y);
        errors[i] = worse(truth, DVec2(table.texels[texel]));
    });
    table.texel_error = *std::max_element(errors.begin(), errors.end());
}

void measure_look_up(const Rules& rules, TableAxes axes, BrdfTable& table) {
    constexpr std::size_t kSamples = 4096;
    std::vector<DVec2> points(kSamples), truth;
    RandomStream random(0, 1, 0);
    for (std::size_t i = 0; i < kSamples; ++i) {
        points[i].x = random.next() * (i % 3 == 0 ? 0.1 : 1.0);
        points[i].y = random.next();
    }
    integrate(rules, points, truth);
    double square_sum = 0;
    for (std::size_t i = 0; i < kSamples; ++i) {
        const DVec2 e = look_up(table, axes, points[i]) - truth[i];
        table.lookup_error = std::max({table.lookup_error, std::abs(e.x), std::abs(e.y)});
        square_sum += glm::dot(e, e);
    }
    table.lookup_error_rms = std::sqrt(square_sum / (2 * kSamples));
}

}  // namespace

BrdfTable bake_brdf_table(const BrdfTableJob& job) {
    const std::size_t size = static_cast<std::size_t>(job.size);
    std::vector<DVec2> points(size * size), values;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const int column = static_cast<int>(i % size), row = static_cast<int>(i / size);
        points[i] = {runtime::table_value<double>(job.axes, column, job.size),
                     runtime::table_value<double>(job.axes, row, job.size)};
    }
    const Rules rules = make_rules(kTableNodes, 9, 18);
    integrate(rules, points, values);

    BrdfTable table;
    table.size = job.size;
    table.texels.reserve(values.size());
    for (const DVec2& value : values) table.texels.push_back(to_texel(value));
    measure_texels(points, table);
    measure_look_up(rules, job.axes, table);
    return table;
}

DVec2 brdf_integral(double n_dot_v, double perceptual_roughness, int nodes) {
    return integrate(reference_rules(nodes), n_dot_v, perceptual_roughness);
}

}  // namespace envbake
