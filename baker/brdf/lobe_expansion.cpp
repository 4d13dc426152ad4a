// SPDX-License-Identifier: Apache-2.0
#include "baker/brdf/lobe_expansion.h"

#include "baker/core/parallel.h"
#include "baker/math/quadrature.h"
#include "baker/math/vector.h"
#include "envbake/runtime/lobe.h"
#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

namespace envbake {
namespace {

using runtime::Distribution;
using runtime::kLobeBands;
using runtime::lobe_slot;
using std::numbers::pi;

/// d of the header, and its like for the kernel's light side, where only rounding asks for it.
constexpr double kHorizonWeight = 1e-2, kLightHorizonWeight = 1e-6;

/// Against twice as many in each direction: 1e-5 of the matrices' norm at any roughness.
constexpr int kExitNodes = 20, kThetaNodes = 24, kPhiNodes = 24;

constexpr std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}

/// The part of d in the weight of Y_lm, of both half-spheres where they are alike.
double horizon_weight(int l, int m) {
    return (l + m) % 2 == 0 ? 2 * kHorizonWeight : 0;
}

/// Degrees and orders m >= 0 below kLobeBands, [m][l].
using ByOrder = std::array<std::array<double, kLobeBands>, kLobeBands>;

/// What one direction, in the plane phi = 0, has to do with all the others; at another phi it is
/// that times cos(m phi). The lobe has no preferred side, so the direction is one of exit or one of
/// light. [part]
struct Response {
    std::array<ByOrder, 2> of_light{};  ///< integral of f_p(w) w.z Y_lm(w) dw
    /// Integral of f_p(w) times the header's weight, below the horizon mirrored: what exit
    /// coefficients of light from here are made of.
    std::array<ByOrder, 2> moments{};
    std::array<double, 3> f_squared{};  ///< integral of f_a^2 w.z dw; of f_a f_b; of f_b^2
};

/// Integral over h in place of w, dw = 4 (o.h) dh, h = (theta, psi) about the normal; theta =
/// atan(alpha sinh z) takes the sharpness out of D and the length out of its tail,
///
///     D(h) h.z dh = sinh z / (pi cosh^3 z) dz dpsi                          GGX
///                   sinh z cosh z exp(-sinh^2 z) / pi dz dpsi               Beckmann
///
/// For each psi theta ends where w reaches the horizon.
Response respond(Distribution distribution, double alpha, double exit_z) {
    static const Quadrature theta_rule = gauss_legendre(kThetaNodes);
    const bool ggx = distribution == Distribution::Ggx;
    const double longest = ggx ? 12 : 2.6;  // in z: what is beyond is below 1e-10
    const double exit_x = std::sqrt(1 - exit_z * exit_z);
    Response response;
    for (int i = 0; i < kPhiNodes; ++i) {  // half of the circle, twice
        const double psi = pi * (i + 0.5) / kPhiNodes;
        const double steepest = (pi / 2 + std::atan2(exit_x * std::cos(psi), exit_z)) / 2;
        const double z_end =
            alpha > 0 ? std::min(longest, std::asinh(std::tan(steepest) / alpha)) : longest;
        for (std::size_t k = 0; k < theta_rule.nodes.size(); ++k) {
            const double z = z_end * (1 + theta_rule.nodes[k]) / 2;
            const double t = std::sinh(z), cosh_z = std::cosh(z);
            const double density =
                ggx ? t / (cosh_z * cosh_z * cosh_z) : t * cosh_z * std::exp(-t * t);
            const double tangent = alpha * t, n_dot_h = 1 / std::sqrt(1 + tangent * tangent);
            const DVec3 h(tangent * n_dot_h * std::cos(psi), tangent * n_dot_h * std::sin(psi),
                          n_dot_h);
            const double o_dot_h = exit_x * h.x + exit_z * h.z;
            const DVec3 w = 2 * o_dot_h * h - DVec3(exit_x, 0, exit_z);
            if (w.z <= 0 || o_dot_h <= 0) continue;
            const double visibility = ggx ? runtime::ggx_visibility(w.z, exit_z, alpha)
                                          : runtime::beckmann_visibility(w.z, exit_z, alpha);
            const double weight = theta_rule.weights[k] * z_end / 2 * 2 / kPhiNodes * density * 4 *
                                  w.z * visibility * o_dot_h / n_dot_h;
            const double schlick = runtime::schlick_weight(std::min(o_dot_h, 1.0));
            const std::array<double, 2> part{1 - schlick, schlick};
            std::array<double, sh::coeff_count(kLobeBands)> basis;
            sh::evaluate(kLobeBands, w.x, w.y, w.z, basis.data());
            for (int m = 0; m < kLobeBands; ++m) {
                for (int l = m; l < kLobeBands; ++l) {
                    const auto order = static_cast<std::size_t>(m),
                               degree = static_cast<std::size_t>(l);
                    const double y = basis[static_cast<std::size_t>(sh::index(l, m))];
                    for (std::size_t p = 0; p < 2; ++p) {
                        response.of_light[p][order][degree] += weight * part[p] * y;
                        response.moments[p][order][degree] +=
                            weight * part[p] * y * (1 + horizon_weight(l, m) / w.z);
                    }
                }
            }
            if (alpha == 0) continue;
            const double f = visibility * (ggx ? runtime::ggx_d(n_dot_h, alpha)
                                               : runtime::beckmann_d(n_dot_h, alpha));
            response.f_squared[0] += weight * f * part[0] * part[0];
            response.f_squared[1] += weight * f * part[0] * part[1];
            response.f_squared[2] += weight * f * part[1] * part[1];
        }
    }
    return response;
}

/// Symmetric positive definite, at most 6 x 6: x of matrix x = b by Cholesky's factor.
class Solver {
  public:
    Solver(std::vector<double> matrix, int size) : l_(std::move(matrix)), size_(size) {
        for (int j = 0; j < size_; ++j) {
            for (int i = j; i < size_; ++i) {
                double sum = at(i, j);
                for (int k = 0; k < j; ++k) sum -= at(i, k) * at(j, k);
                at(i, j) = i == j ? std::sqrt(sum) : sum / at(j, j);
            }
        }
    }
    std::vector<double> operator()(std::vector<double> x) const {
        for (int i = 0; i < size_; ++i) {
            for (int k = 0; k < i; ++k) x[index(i)] -= at(i, k) * x[index(k)];
            x[index(i)] /= at(i, i);
        }
        for (int i = size_; i-- > 0;) {
            for (int k = i + 1; k < size_; ++k) x[index(i)] -= at(k, i) * x[index(k)];
            x[index(i)] /= at(i, i);
        }
        return x;
    }

  private:
    double& at(int row, int column) { return l_[index(row * size_ + column)]; }
    double at(int row, int column) const { return l_[index(row * size_ + column)]; }
    std::vector<double> l_;
    int size_;
};

/// The directions of exit, z = x^2 towards the horizon, and Y_lm there at phi = 0.
struct ExitRule {
    std::vector<double> z, weight;
    std::vector<ByOrder> basis;

    ExitRule() {
        const Quadrature rule = gauss_legendre(kExitNodes);
        for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
            const double x = (1 + rule.nodes[i]) / 2;
            z.push_back(x * x);
            weight.push_back(rule.weights[i] * x);
            std::array<double, sh::coeff_count(kLobeBands)> values;
            sh::evaluate(kLobeBands, std::sqrt(1 - x * x * x * x), 0.0, x * x, values.data());
            ByOrder by_order{};
            for (int m = 0; m < kLobeBands; ++m)
                for (int l = m; l < kLobeBands; ++l)
                    by_order[static_cast<std::size_t>(m)][static_cast<std::size_t>(l)] =
                        values[static_cast<std::size_t>(sh::index(l, m))];
            basis.push_back(by_order);
        }
    }
};

/// Integral of cos^2(m phi) dphi.
double circle(int m) {
    return m == 0 ? 2 * pi : pi;
}

/// max(0, z) Y_l Y_k over the upper hemisphere, for the degrees from m on; row-major.
std::vector<double> cosine_gram(const ExitRule& rule, int m, int bands) {
    std::vector<double> gram;
    for (int j = m; j < bands; ++j) {
        for (int k = m; k < bands; ++k) {
            double sum = 0;
            for (std::size_t q = 0; q < rule.z.size(); ++q) {
                const auto& y = rule.basis[q][static_cast<std::size_t>(m)];
                sum += rule.weight[q] * rule.z[q] * y[static_cast<std::size_t>(j)] *
                       y[static_cast<std::size_t>(k)];
            }
            gram.push_back(circle(m) * sum);
        }
    }
    return gram;
}

/// The same with `d` Y_l Y_k over the whole sphere added.
Solver weighted_solver(std::vector<double> gram, int size, double d) {
    for (int i = 0; i < size; ++i) gram[static_cast<std::size_t>(i * (size + 1))] += d;
    return Solver(std::move(gram), size);
}

double quadratic_form(const std::vector<double>& matrix, const std::vector<double>& x,
                      const std::vector<double>& y) {
    double sum = 0;
    for (std::size_t i = 0; i < x.size(); ++i)
        for (std::size_t k = 0; k < y.size(); ++k) sum += x[i] * matrix[i * x.size() + k] * y[k];
    return sum;
}

/// A quadratic form of the two parts: aa, ab, bb.
using OfParts = std::array<double, 3>;
constexpr std::array<std::array<std::size_t, 2>, 3> kPairs{{{0, 0}, {0, 1}, {1, 1}}};

/// Of R0 a + b.
double of_lobe(const OfParts& parts, double r0) {
    return r0 * r0 * parts[0] + 2 * r0 * parts[1] + parts[2];
}

/// Everything of one roughness. The squares are in t's own norm, over +m and -m.
struct Expanded {
    std::array<std::vector<double>, 2> unoccluded, kernel;  ///< [part]
    OfParts unoccluded_squared{};
    OfParts kernel_elements_squared{};
    OfParts kernel_squared{};  ///< mean over directions of light, weighted by their cosine
    OfParts fit_squared{};
    OfParts f_squared{}, lost_squared{};  ///< weighted by both cosines
};

Expanded expand(const LobeExpansionJob& job, double roughness) {
    static const ExitRule rule;
    std::vector<Response> responses(rule.z.size());
    for (std::size_t q = 0; q < rule.z.size(); ++q)
        responses[q] = respond(job.distribution, roughness * roughness, rule.z[q]);

    const int exit = job.exit_bands, light = job.light_bands;
    Expanded expanded;
    for (std::size_t p = 0; p < 2; ++p) {
        expanded.unoccluded[p].resize(runtime::lobe_size(exit, light));
        expanded.kernel[p].resize(runtime::lobe_size(exit, kLobeBands));
    }
    for (std::size_t q = 0; q < rule.z.size(); ++q)
        for (std::size_t pair = 0; pair < kPairs.size(); ++pair)
            expanded.f_squared[pair] +=
                2 * pi * rule.weight[q] * rule.z[q] * responses[q].f_squared[pair];
    expanded.lost_squared = expanded.f_squared;

    for (int m = 0; m < exit; ++m) {
        const std::vector<double> exit_gram = cosine_gram(rule, m, exit);
        const std::vector<double> light_gram = cosine_gram(rule, m, kLobeBands);
        const Solver solve_exit = weighted_solver(exit_gram, exit - m, kHorizonWeight);
        const Solver solve_light = weighted_solver(light_gram, kLobeBands - m, kLightHorizonWeight);
        const double sides = m == 0 ? 1 : 2;  // +m and -m

        std::array<std::vector<std::vector<double>>, 2> unoccluded, kernel;  // [part][exit][light]
        for (std::size_t p = 0; p < 2; ++p) {
            unoccluded[p].resize(index(exit - m));
            for (int k = m; k < kLobeBands; ++k) {
                std::vector<double> moments;
                for (int j = m; j < exit; ++j) {
                    double sum = 0;
                    for (std::size_t q = 0; q < rule.z.size(); ++q)
                        sum += rule.weight[q] * (rule.z[q] + horizon_weight(j, m)) *
                               rule.basis[q][index(m)][index(j)] *
                               responses[q].of_light[p][index(m)][index(k)];
                    moments.push_back(circle(m) * sum);
                }
                const std::vector<double> best = solve_exit(std::move(moments));
                for (std::size_t j = 0; j < best.size(); ++j) unoccluded[p][j].push_back(best[j]);
            }
            for (int j = m; j < exit; ++j) {
                kernel[p].push_back(solve_light(unoccluded[p][index(j - m)]));
                for (double& element : kernel[p].back()) element *= pi;
                unoccluded[p][index(j - m)].resize(index(std::max(0, light - m)));
                for (int k = m; k < kLobeBands; ++k) {
                    expanded.kernel[p][lobe_slot(exit, kLobeBands, m, j, k)] =
                        kernel[p].back()[index(k - m)];
                    if (k < light)
                        expanded.unoccluded[p][lobe_slot(exit, light, m, j, k)] =
                            unoccluded[p][index(j - m)][index(k - m)];
                }
            }
        }
        for (std::size_t pair = 0; pair < kPairs.size(); ++pair) {
            const auto [first, second] = kPairs[pair];
            for (std::size_t j = 0; j < kernel[0].size(); ++j) {
                for (std::size_t k = 0; k < kernel[first][j].size(); ++k)
                    expanded.kernel_elements_squared[pair] +=
                        sides * kernel[first][j][k] * kernel[second][j][k];
                expanded.kernel_squared[pair] +=
                    sides * quadratic_form(light_gram, kernel[first][j], kernel[second][j]) / pi;
                for (std::size_t k = 0; k < unoccluded[0][j].size(); ++k)
                    expanded.unoccluded_squared[pair] +=
                        sides * unoccluded[first][j][k] * unoccluded[second][j][k];
            }
        }
        // Direction by direction of light: its true exit coefficients, those of the kernel, and
        // what any coefficients miss. An integral over phi has cos^2 of +m and sin^2 of -m: 2 pi.
        for (std::size_t q = 0; q < rule.z.size(); ++q) {
            std::array<std::vector<double>, 2> exact, missed, projected;
            for (std::size_t p = 0; p < 2; ++p) {
                const auto& moments = responses[q].moments[p][index(m)];
                const auto& of_light = responses[q].of_light[p][index(m)];
                exact[p] = solve_exit({moments.begin() + m, moments.begin() + exit});
                projected[p].assign(of_light.begin() + m, of_light.begin() + exit);
                missed[p] = exact[p];
                for (std::size_t j = 0; j < kernel[p].size(); ++j)
                    for (std::size_t k = 0; k < kernel[p][j].size(); ++k)
                        missed[p][j] -=
                            kernel[p][j][k] / pi * rule.basis[q][index(m)][index(m) + k];
            }
            const double weight = 2 * pi * rule.weight[q] * rule.z[q];
            for (std::size_t pair = 0; pair < kPairs.size(); ++pair) {
                const auto [first, second] = kPairs[pair];
                for (std::size_t j = 0; j < missed[0].size(); ++j) {
                    expanded.fit_squared[pair] +=
                        weight * rule.z[q] * missed[first][j] * missed[second][j];
                    expanded.lost_squared[pair] -=
                        weight * (exact[first][j] * projected[second][j] +
                                  exact[second][j] * projected[first][j]);
                }
                expanded.lost_squared[pair] +=
                    weight * quadratic_form(exit_gram, exact[first], exact[second]);
            }
        }
    }
    return expanded;
}

/// Integral over a turn of three factors, each cos(m phi), or sin(-m phi) where m < 0; third >= 0.
double around(int first, int second, int third) {
    if ((first < 0) != (second < 0)) return 0;
    const int a = std::abs(first), b = std::abs(second);
    const int sums = (a + b == third) + (a + b + third == 0);
    const int differences = (a - b == third) + (b - a == third);
    return pi / 2 * (first < 0 ? differences - sums : differences + sums);
}

/// LobeErrors::of_row: with K_j = sum_k k_jk Y_k the kernel as a function of the direction of
/// light, sum_km k_jk G_ikm x_m is the integral of K_j Y_i times the row's own function.
AxialForm error_of_row(const LobeExpansionJob& job, const Expanded& expanded, double r0) {
    constexpr int kNodes = 11;  // exact: degrees 4 + 6 + 10
    static const Quadrature rule = gauss_legendre(kNodes);
    const int exit = job.exit_bands, light = job.light_bands,
              bands = light + runtime::kExtraVisibilityBands;
    constexpr int kMaxBands = runtime::kMaxGlossyBands + runtime::kExtraVisibilityBands;
    constexpr std::size_t kMaxCoeffs = sh::coeff_count(kMaxBands);

    // Y_lm and K_jm in the plane phi = 0.
    std::array<std::array<double, kMaxCoeffs>, kNodes> basis{}, kernel{};
    for (std::size_t q = 0; q < kNodes; ++q) {
        const double z = rule.nodes[q];
        sh::evaluate(bands, std::sqrt(1 - z * z), 0.0, z, basis[q].data());
        for (int m = 0; m < exit; ++m)
            for (int j = m; j < exit; ++j)
                for (int k = m; k < kLobeBands; ++k) {
                    const std::size_t at = lobe_slot(exit, kLobeBands, m, j, k);
                    kernel[q][index(sh::index(j, m))] +=
                        (r0 * expanded.kernel[0][at] + expanded.kernel[1][at]) *
                        basis[q][index(sh::index(k, m))];
                }
    }
    AxialForm form{bands, {}};
    for (int m = 0; m < bands; ++m) {
        const int size = bands - m;
        std::vector<double> block(index(size * size), 0), values(index(size));
        for (int of_exit = 1 - exit; of_exit < exit; ++of_exit) {
            for (int of_light = 1 - light; of_light < light; ++of_light) {
                const double turn = around(of_exit, of_light, m);
                if (turn == 0) continue;
                for (int j = std::abs(of_exit); j < exit; ++j) {
                    for (int i = std::abs(of_light); i < light; ++i) {
                        for (int l = m; l < bands; ++l) {
                            double sum = 0;
                            for (std::size_t q = 0; q < kNodes; ++q)
                                sum += rule.weights[q] *
                                       kernel[q][index(sh::index(j, std::abs(of_exit)))] *
                                       basis[q][index(sh::index(i, std::abs(of_light)))] *
                                       basis[q][index(sh::index(l, m))];
                            values[index(l - m)] = turn * sum;
                        }
                        for (std::size_t r = 0; r < values.size(); ++r)
                            for (std::size_t c = 0; c < values.size(); ++c)
                                block[r * values.size() + c] += values[r] * values[c];
                    }
                }
            }
        }
        form.elements.insert(form.elements.end(), block.begin(), block.end());
    }
    const double white_squared = of_lobe(expanded.unoccluded_squared, 1);
    for (double& element : form.elements) element /= white_squared;
    return form;
}

/// LobeErrors::of_reflected.
AxialForm error_of_reflected(int exit, const Expanded& expanded, double r0) {
    AxialForm form{kLobeBands, {}};
    const double white_squared = of_lobe(expanded.unoccluded_squared, 1);
    for (int m = 0; m < kLobeBands; ++m) {
        for (int l = m; l < kLobeBands; ++l) {
            for (int k = m; k < kLobeBands; ++k) {
                double sum = 0;
                for (int j = m; j < exit; ++j) {
                    const std::size_t at_l = lobe_slot(exit, kLobeBands, m, j, l),
                                      at_k = lobe_slot(exit, kLobeBands, m, j, k);
                    sum += (r0 * expanded.kernel[0][at_l] + expanded.kernel[1][at_l]) *
                           (r0 * expanded.kernel[0][at_k] + expanded.kernel[1][at_k]);
                }
                form.elements.push_back(sum / white_squared);
            }
        }
    }
    return form;
}

}  // namespace

LobeExpansion expand_lobe(const LobeExpansionJob& job) {
    const double least = job.roughness[0], largest = job.roughness[1];
    LobeExpansion lobe;
    lobe.rows = least == largest ? 1 : static_cast<int>(std::ceil(32 * (largest - least))) + 1;
    std::vector<Expanded> rows(static_cast<std::size_t>(lobe.rows));
    parallel_for(rows.size(), [&](std::size_t i) {
        const double at = rows.size() == 1 ? 0 : static_cast<double>(i) / (lobe.rows - 1);
        rows[i] = expand(job, least + (largest - least) * at);
    });
    for (const Expanded& row : rows) {
        for (std::size_t p = 0; p < 2; ++p) {
            for (const double x : row.unoccluded[p])
                lobe.unoccluded.push_back(static_cast<float>(x));
            for (const double x : row.kernel[p]) lobe.kernel.push_back(static_cast<float>(x));
        }
    }
    return lobe;
}

LobeErrors lobe_errors(const LobeExpansionJob& job, double perceptual_roughness, double r0) {
    const Expanded expanded = expand(job, perceptual_roughness);
    double diffuse_squared = 0;  // |T_unoccluded|^2
    for (int l = 0; l < job.light_bands; ++l) {
        const double a = sh::clamped_cosine(l) / pi;
        diffuse_squared += a * a * (2 * l + 1) / (4 * pi);
    }
    const double white_squared = of_lobe(expanded.unoccluded_squared, 1);
    const auto root = [](double x) { return std::sqrt(std::max(x, 0.0)); };
    return {
        .of_row = error_of_row(job, expanded, r0),
        .of_reflected = error_of_reflected(job.exit_bands, expanded, r0),
        .per_transport_error =
            root(of_lobe(expanded.kernel_squared, r0) * diffuse_squared / white_squared),
        .per_rounding_error = root(of_lobe(expanded.kernel_elements_squared, r0) * job.light_bands *
                                   job.light_bands / (4 * pi) / white_squared),
        .fit = root(of_lobe(expanded.fit_squared, r0) / white_squared),
        .lost = root(of_lobe(expanded.lost_squared, r0) / of_lobe(expanded.f_squared, r0))};
}

}  // namespace envbake
