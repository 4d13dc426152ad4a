// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/glossy.h"

#include "envbake/runtime/sh.h"
#include "envbake/runtime/sh_rotation.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

namespace envbake::runtime {
namespace {

using std::numbers::pi;

constexpr int kMostVisibilityBands = kMaxGlossyBands + kExtraVisibilityBands;
constexpr std::size_t kMaxLight = kMaxGlossyBands * kMaxGlossyBands;
constexpr std::size_t kMaxKernel = kLobeBands * kLobeBands;
constexpr std::size_t kMaxVisibility = kMostVisibilityBands * kMostVisibilityBands;

std::size_t square(int bands) {
    return static_cast<std::size_t>(sh::coeff_count(bands));
}
std::size_t slot(int l, int m) {
    return static_cast<std::size_t>(sh::index(l, m));
}

/// The frame about a unit normal. Source: [Duff17], listing 3.
std::array<Vec3, 3> frame_about(const Vec3& n) {
    const float sign = std::copysign(1.0f, n[2]);
    const float a = -1 / (sign + n[2]), b = n[0] * n[1] * a;
    return {{{1 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]},
             {b, sign + n[1] * n[1] * a, -n[1]},
             n}};
}

Vec3 to_local(const std::array<Vec3, 3>& frame, const Vec3& v) {
    Vec3 local;
    for (std::size_t i = 0; i < 3; ++i)
        local[i] = frame[i][0] * v[0] + frame[i][1] * v[1] + frame[i][2] * v[2];
    return local;
}

/// Turns coefficients from world space to the frame. Empty: the normal was none.
std::optional<sh::Rotation> rotation_to(const std::array<Vec3, 3>& frame) {
    sh::Matrix3 matrix;
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t k = 0; k < 3; ++k) matrix[i][k] = static_cast<double>(frame[i][k]);
    return sh::Rotation::from_matrix(matrix, kLobeBands);
}

/// A product of three basis functions is of degree 20 at most: 11 rows by Gauss and Legendre and 21
/// columns integrate it exactly.
class SphereRule {
  public:
    static constexpr int kRows = 11, kColumns = 21;
    static_assert(kMaxGlossyBands + kLobeBands + kMostVisibilityBands - 3 < 2 * kRows);

    SphereRule() {
        for (int i = 0; i < kRows; ++i) {
            double z = std::cos(pi * (i + 0.75) / (kRows + 0.5)), slope = 1;
            for (int step = 0; step < 6; ++step) {
                double before = 0, p = 1;
                for (int l = 1; l <= kRows; ++l) {
                    const double next = ((2 * l - 1) * z * p - (l - 1) * before) / l;
                    before = p;
                    p = next;
                }
                slope = kRows * (before - z * p) / (1 - z * z);
                z -= p / slope;
            }
            z_[static_cast<std::size_t>(i)] = z;
            weight_[static_cast<std::size_t>(i)] =
                2 / ((1 - z * z) * slope * slope) * 2 * pi / kColumns;
        }
    }

    /// visit(basis of kMostVisibilityBands bands, weight)
    template <class Visit>
    void for_each_node(const Visit& visit) const {
        std::array<double, kMaxVisibility> basis;
        for (std::size_t i = 0; i < kRows; ++i) {
            const double radius = std::sqrt(1 - z_[i] * z_[i]);
            for (int k = 0; k < kColumns; ++k) {
                const double phi = 2 * pi * k / kColumns;
                sh::evaluate(kMostVisibilityBands, radius * std::cos(phi), radius * std::sin(phi),
                             z_[i], basis.data());
                visit(basis, weight_[i]);
            }
        }
    }

  private:
    std::array<double, kRows> z_, weight_;
};

/// V of a place that sees everything, less V. False: there is no such vertex, or it has no normal.
bool blocked_part(const GlossyView& transport, std::uint64_t vertex, Vec3& normal,
                  std::array<float, kMaxVisibility>& blocked) {
    if (transport.light_bands == 0 || vertex >= transport.vertex_count) return false;
    for (std::size_t i = 0; i < 3; ++i) normal[i] = transport.normals[3 * vertex + i];
    if (normal == Vec3{0, 0, 0}) return false;
    const int bands = transport.light_bands + kExtraVisibilityBands;
    sh::evaluate(bands, normal[0], normal[1], normal[2], blocked.data());
    const std::uint64_t first = vertex * square(bands);
    for (int l = 0; l < bands; ++l) {
        const auto open = static_cast<float>(sh::clamped_cosine(l) / pi);
        for (int m = -l; m <= l; ++m)
            blocked[slot(l, m)] =
                open * blocked[slot(l, m)] - transport.visibility[first + slot(l, m)];
    }
    return true;
}

/// The two rows of the lobe's table around a roughness, of one of its arrays; a and b.
struct Row {
    std::array<float, 2 * lobe_size(kMaxGlossyBands, kLobeBands)> values;
    std::size_t size;  ///< of a, and of b

    float a(std::size_t i) const { return values[i]; }
    float b(std::size_t i) const { return values[size + i]; }
    double part(std::size_t p, std::size_t i) const {
        return static_cast<double>(values[p * size + i]);
    }
};

Row interpolated(const LobeView& lobe, const FloatView& table, int bands,
                 float perceptual_roughness) {
    const float range = lobe.max_roughness - lobe.min_roughness;
    const auto last = static_cast<float>(lobe.rows - 1);
    float at = range > 0 ? (perceptual_roughness - lobe.min_roughness) / range * last : 0;
    at = at > 0 ? std::min(at, last) : 0;  // a NaN is the first row
    const auto row =
        static_cast<std::uint64_t>(std::max(0, std::min(static_cast<int>(at), lobe.rows - 2)));
    const float part = at - static_cast<float>(row);
    Row result;
    result.size = lobe_size(lobe.exit_bands, bands);
    const std::uint64_t first = row * 2 * result.size;
    for (std::size_t i = 0; i < 2 * result.size; ++i) {
        result.values[i] = table[first + i];
        if (part > 0)
            result.values[i] += part * (table[first + 2 * result.size + i] - result.values[i]);
    }
    return result;
}

bool fits(const LobeView& lobe, int light_bands) {
    return lobe.rows > 0 && light_bands > 0 && lobe.light_bands == light_bands;
}

}  // namespace

GlossyLight::GlossyLight(const ShLightingView& lighting, int light_bands) noexcept
    : bands_(std::clamp(light_bands, 0, kMaxGlossyBands)) {
    const std::size_t shared = std::min(square(bands_), lighting.coeffs.size() / 3);
    for (std::size_t i = 0; i < shared; ++i)
        for (std::size_t c = 0; c < 3; ++c) lighting_[i][c] = lighting.coeffs[3 * i + c];
    const std::size_t rows = square(bands_ + kExtraVisibilityBands);
    SphereRule().for_each_node([&](std::span<const double> basis, double weight) {
        for (std::size_t c = 0; c < 3; ++c) {
            double light = 0;
            for (std::size_t i = 0; i < shared; ++i)
                light += basis[i] * static_cast<double>(lighting_[i][c]);
            for (std::size_t m = 0; m < rows; ++m) {
                const auto scale = static_cast<float>(weight * light * basis[m]);
                for (std::size_t k = 0; k < kMaxKernel; ++k)
                    product_[c][m][k] += scale * static_cast<float>(basis[k]);
            }
        }
    });
}

TransferredLight GlossyLight::transfer(const GlossyView& transport,
                                       std::uint64_t vertex) const noexcept {
    TransferredLight light;
    Vec3 normal;
    std::array<float, kMaxVisibility> blocked;
    if (transport.light_bands != bands_ || !blocked_part(transport, vertex, normal, blocked))
        return light;
    light.frame = frame_about(normal);
    const std::optional<sh::Rotation> rotation = rotation_to(light.frame);
    if (!rotation) return light;
    light.bands = bands_;

    const std::size_t rows = square(bands_ + kExtraVisibilityBands);
    for (std::size_t c = 0; c < 3; ++c) {
        alignas(64) std::array<float, kColumns> sum{};
        for (std::size_t m = 0; m < rows; ++m)
            for (std::size_t k = 0; k < kColumns; ++k) sum[k] += blocked[m] * product_[c][m][k];
        for (std::size_t k = 0; k < kMaxKernel; ++k) light.blocked[k][c] = sum[k];
    }
    const auto turn = [&](std::span<Rgb> coeffs, std::span<const Rgb> from) {
        return rotation->apply(std::span(from.data()->data(), 3 * from.size()),
                               std::span(coeffs.data()->data(), 3 * coeffs.size()), 3);
    };
    const std::size_t count = square(bands_);
    if (!turn(light.blocked, light.blocked) ||
        !turn(std::span(light.lighting).first(count), std::span(lighting_).first(count)))
        light.bands = 0;
    return light;
}

Rgb GlossyExit::radiance(const Vec3& v) const noexcept {
    Vec3 o = to_local(frame, v);
    if (o[2] < 0) {
        const float length = std::sqrt(o[0] * o[0] + o[1] * o[1]);
        o = length > 0 ? Vec3{o[0] / length, o[1] / length, 0} : Vec3{1, 0, 0};
    }
    std::array<float, kMaxLight> basis;
    sh::evaluate(bands, o[0], o[1], o[2], basis.data());
    Rgb sum{};
    for (std::size_t j = 0; j < square(bands); ++j)
        for (std::size_t c = 0; c < 3; ++c) sum[c] += coeffs[j][c] * basis[j];
    return sum;
}

GlossyExit reflect(const LobeView& lobe, const TransferredLight& light, float perceptual_roughness,
                   const Rgb& r0) noexcept {
    GlossyExit exit;
    if (!fits(lobe, light.bands)) return exit;
    exit.bands = lobe.exit_bands;
    exit.frame = light.frame;
    const auto add = [&](const FloatView& table, int bands, std::span<const Rgb> from, float sign) {
        const Row row = interpolated(lobe, table, bands, perceptual_roughness);
        for (int m = 0; m < std::min(exit.bands, bands); ++m) {
            for (int j = m; j < exit.bands; ++j) {
                for (int k = m; k < bands; ++k) {
                    const std::size_t at = lobe_slot(exit.bands, bands, m, j, k);
                    for (std::size_t c = 0; c < 3; ++c) {
                        const float t = sign * (r0[c] * row.a(at) + row.b(at));
                        exit.coeffs[slot(j, m)][c] += t * from[slot(k, m)][c];
                        if (m > 0) exit.coeffs[slot(j, -m)][c] += t * from[slot(k, -m)][c];
                    }
                }
            }
        }
    };
    add(lobe.unoccluded, lobe.light_bands, light.lighting, 1);
    add(lobe.kernel, kLobeBands, light.blocked, -1);
    return exit;
}

bool glossy_matrices(const LobeView& lobe, const GlossyView& transport, std::uint64_t vertex,
                     float perceptual_roughness, std::span<float> out) noexcept {
    if (!fits(lobe, transport.light_bands)) return false;
    const std::size_t light_count = square(lobe.light_bands), exit_count = square(lobe.exit_bands);
    if (out.size() != exit_count * light_count * 2) return false;
    Vec3 normal;
    std::array<float, kMaxVisibility> blocked;
    if (!blocked_part(transport, vertex, normal, blocked)) return false;
    const std::array<Vec3, 3> frame = frame_about(normal);
    const std::optional<sh::Rotation> to_frame = rotation_to(frame);
    if (!to_frame) return false;

    // sum_m G_ikm B_m, [i][k], of world space.
    std::array<std::array<double, kMaxKernel>, kMaxLight> transferred{};
    const std::size_t rows = square(lobe.light_bands + kExtraVisibilityBands);
    SphereRule().for_each_node([&](std::span<const double> basis, double weight) {
        double b = 0;
        for (std::size_t m = 0; m < rows; ++m) b += basis[m] * static_cast<double>(blocked[m]);
        for (std::size_t i = 0; i < light_count; ++i)
            for (std::size_t k = 0; k < kMaxKernel; ++k)
                transferred[i][k] += weight * b * basis[i] * basis[k];
    });

    const Row unoccluded =
        interpolated(lobe, lobe.unoccluded, lobe.light_bands, perceptual_roughness);
    const Row kernel = interpolated(lobe, lobe.kernel, kLobeBands, perceptual_roughness);
    for (std::size_t i = 0; i < light_count; ++i) {
        // One column of lighting: Y_i in the frame, and what is blocked of it.
        std::array<double, kMaxLight> lit{};
        lit[i] = 1;
        if (!to_frame->apply(std::span<const double>(lit).first(light_count),
                             std::span(lit).first(light_count)) ||
            !to_frame->apply(std::span<const double>(transferred[i]), transferred[i]))
            return false;
        for (std::size_t p = 0; p < 2; ++p) {
            std::array<double, kMaxLight> exit{};
            for (int j = 0; j < lobe.exit_bands; ++j) {
                for (int m = -j; m <= j; ++m) {
                    double sum = 0;
                    const int order = std::abs(m);
                    for (int k = order; k < lobe.light_bands; ++k)
                        sum += unoccluded.part(
                                   p, lobe_slot(lobe.exit_bands, lobe.light_bands, order, j, k)) *
                               lit[slot(k, m)];
                    for (int k = order; k < kLobeBands; ++k)
                        sum -= kernel.part(p, lobe_slot(lobe.exit_bands, kLobeBands, order, j, k)) *
                               transferred[i][slot(k, m)];
                    exit[slot(j, m)] = sum;
                }
            }
            // The turn back to world space is the transpose.
            for (int j = 0; j < lobe.exit_bands; ++j) {
                for (int m = -j; m <= j; ++m) {
                    double sum = 0;
                    for (int k = -j; k <= j; ++k)
                        sum += to_frame->element(j, k, m) * exit[slot(j, k)];
                    out[(slot(j, m) * light_count + i) * 2 + p] = static_cast<float>(sum);
                }
            }
        }
    }
    return true;
}

}  // namespace envbake::runtime
