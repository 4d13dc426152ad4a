// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/glossy.h"

#include "envbake/runtime/sh.h"
#include "envbake/runtime/sh_rotation.h"
#include "envbake/runtime/shade.h"
#include "float8.h"

#include <algorithm>
#include <cmath>
#include <cstring>
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

/// The frame about a unit normal whose bitangent lies in the plane z = 0: world space turned by phi
/// about +Z, then by theta about its new +Y.
std::array<Vec3, 3> frame_about(const Vec3& n) {
    const float sin_theta = std::sqrt(n[0] * n[0] + n[1] * n[1]);
    const float cos_phi = sin_theta > 0 ? n[0] / sin_theta : 1;
    const float sin_phi = sin_theta > 0 ? n[1] / sin_theta : 0;
    return {{{n[2] * cos_phi, n[2] * sin_phi, -sin_theta}, {-sin_phi, cos_phi, 0}, n}};
}

Vec3 to_local(const std::array<Vec3, 3>& frame, const Vec3& v) {
    Vec3 local;
    for (std::size_t i = 0; i < 3; ++i)
        local[i] = frame[i][0] * v[0] + frame[i][1] * v[1] + frame[i][2] * v[2];
    return local;
}

Float4 padded(const Rgb& rgb) {
    return Float4{rgb[0], rgb[1], rgb[2], 0};
}
Rgb first_three(const Float4& v) {
    return {v[0], v[1], v[2]};
}

/// Four kinds of coefficients turned together, by an angle about +Z.
void turn_about_z(int bands, float cos_angle, float sin_angle, Float4* coeffs) {
    float c = 1, s = 0;  // of m angles
    for (int m = 1; m < bands; ++m) {
        const float next = c * cos_angle - s * sin_angle;
        s = s * cos_angle + c * sin_angle;
        c = next;
        for (int l = m; l < bands; ++l) {
            const Float4 even = coeffs[slot(l, m)], odd = coeffs[slot(l, -m)];
            coeffs[slot(l, m)] = c * even - s * odd;
            coeffs[slot(l, -m)] = s * even + c * odd;
        }
    }
}

/// Coefficients times the matrices of the quarter turn, or their transpose: its inverse.
template <bool kInverse>
void quarter_turn(int bands, const float* matrix, Float4* coeffs) {
    for (int l = 0; l < bands; ++l) {
        const auto size = static_cast<std::size_t>(2 * l + 1);
        Float4* band = coeffs + slot(l, -l);
        std::array<Float4, 2 * kLobeBands - 1> sum{};
        for (std::size_t row = 0; row < size; ++row)
            for (std::size_t column = 0; column < size; ++column)
                sum[row] +=
                    matrix[kInverse ? column * size + row : row * size + column] * band[column];
        std::copy_n(sum.begin(), size, band);
        matrix += size * size;
    }
}

/// Between world space and the frame of frame_about(): by phi about +Z, and by theta about +Y,
/// which is a turn about +Z between a quarter turn about +X and its inverse.
struct FrameTurn {
    const ShQuarterTurn& quarter;
    const std::array<Vec3, 3>& frame;

    float cos_phi() const { return frame[1][1]; }
    float minus_sin_phi() const { return frame[1][0]; }
    float cos_theta() const { return frame[2][2]; }
    float minus_sin_theta() const { return frame[0][2]; }

    void to_frame(int bands, Float4* coeffs) const {
        turn_about_z(bands, cos_phi(), minus_sin_phi(), coeffs);
        quarter_turn<false>(bands, quarter.elements.data(), coeffs);
        turn_about_z(bands, cos_theta(), minus_sin_theta(), coeffs);
        quarter_turn<true>(bands, quarter.elements.data(), coeffs);
    }
    void to_world(int bands, Float4* coeffs) const {
        quarter_turn<false>(bands, quarter.elements.data(), coeffs);
        turn_about_z(bands, cos_theta(), -minus_sin_theta(), coeffs);
        quarter_turn<true>(bands, quarter.elements.data(), coeffs);
        turn_about_z(bands, cos_phi(), -minus_sin_phi(), coeffs);
    }
};

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

/// factors * matrix, whose rows are whole vectors: `count` of them, and so many factors.
template <std::size_t kColumns, std::size_t kRows>
std::array<float, kColumns> product_of(const std::array<float, kRows>& factors,
                                       const std::array<std::array<float, kColumns>, kRows>& matrix,
                                       std::size_t count) {
    std::array<float, kColumns> result;
    // So few columns at once that their sums stay in registers.
    constexpr std::size_t kAtOnce = 4;
    const auto sum_columns = [&]<std::size_t kVectors>(std::size_t first) {
        Float8 sum[kVectors]{};
        for (std::size_t row = 0; row < count; ++row) {
            const Float8 factor = all_lanes(factors[row]);
            for (std::size_t k = 0; k < kVectors; ++k)
                multiply_add(factor, load8(&matrix[row][first + kLanes * k]), sum[k]);
        }
        std::memcpy(&result[first], sum, sizeof sum);
    };
    constexpr std::size_t kWhole = kColumns / (kAtOnce * kLanes) * kAtOnce * kLanes;
    for (std::size_t first = 0; first < kWhole; first += kAtOnce * kLanes)
        sum_columns.template operator()<kAtOnce>(first);
    if constexpr (kWhole < kColumns)
        sum_columns.template operator()<(kColumns - kWhole) / kLanes>(kWhole);
    return result;
}

/// Radiance that surfaces send to a vertex, the mean over the directions that they block, weighted
/// by the cosine: what diffuse transport has beyond the sky's, by the blocked share.
Rgb mean_of_blocked(const Mesh& mesh, std::uint64_t vertex, float blocked_0,
                    std::span<const Rgb> lighting) {
    const float blocked_share = blocked_0 * std::sqrt(4 * std::numbers::pi_v<float>);
    const TransportView& diffuse = mesh.diffuse;
    if (diffuse.bands == 0 || !(blocked_share > 1e-3f)) return {};
    const std::size_t count = square(std::min(diffuse.bands, mesh.glossy.light_bands));
    const ShLightingView light{mesh.glossy.light_bands,
                               std::span(lighting[0].data(), 3 * lighting.size())};
    Rgb sum;
    diffuse_exit(diffuse, light, vertex, {&sum, 1});
    const std::uint64_t direct = vertex * square(mesh.glossy.light_bands + kExtraVisibilityBands);
    for (std::size_t i = 0; i < count; ++i)
        for (std::size_t c = 0; c < 3; ++c)
            sum[c] -= lighting[i][c] * mesh.glossy.visibility[direct + i];
    for (float& channel : sum) channel /= blocked_share;
    return sum;
}

/// The two rows of the lobe's table around a roughness, of one of its arrays; a and b.
struct Row {
    std::array<float, 2 * lobe_size(kMaxGlossyBands, kLobeBands)> values;
    std::size_t size;  ///< of a, and of b

    float a(std::size_t i) const { return values[i]; }
    float b(std::size_t i) const { return values[size + i]; }
    float part(std::size_t p, std::size_t i) const { return values[p * size + i]; }
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

ShQuarterTurn::ShQuarterTurn() noexcept {
    static_assert(kLobeBands * (4 * kLobeBands * kLobeBands - 1) / 3 == 455);
    const auto turn =
        sh::Rotation::from_matrix({{{1, 0, 0}, {0, 0, -1}, {0, 1, 0}}}, kLobeBands);  // +Y to +Z
    std::size_t at = 0;
    for (int l = 0; l < kLobeBands; ++l)
        for (int m = -l; m <= l; ++m)
            for (int k = -l; k <= l; ++k)
                elements[at++] = static_cast<float>(turn->element(l, m, k));
}

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

TransferredLight GlossyLight::transfer(const Mesh& mesh, std::uint64_t vertex) const noexcept {
    const GlossyView& transport = mesh.glossy;
    TransferredLight light;
    Vec3 normal;
    std::array<float, kMaxVisibility> blocked;
    if (transport.light_bands != bands_ || !blocked_part(transport, vertex, normal, blocked))
        return light;
    light.frame = frame_about(normal);
    light.bands = bands_;

    const std::size_t rows = square(bands_ + kExtraVisibilityBands);
    std::array<std::array<float, kColumns>, 3> products;
    for (std::size_t c = 0; c < 3; ++c) products[c] = product_of(blocked, product_[c], rows);
    const Float4 from_surfaces = padded(
        mean_of_blocked(mesh, vertex, blocked[0], std::span(lighting_).first(square(bands_))));
    std::array<Float4, kMaxKernel> kernel_side;
    for (std::size_t k = 0; k < kMaxKernel; ++k)
        kernel_side[k] = padded({products[0][k], products[1][k], products[2][k]});
    for (std::size_t k = 0; k < std::min(rows, kMaxKernel); ++k)
        kernel_side[k] = kernel_side[k] - blocked[k] * from_surfaces;
    std::array<Float4, kMaxLight> lighting{};
    for (std::size_t i = 0; i < square(bands_); ++i) lighting[i] = padded(lighting_[i]);

    const FrameTurn turn{quarter_turn_, light.frame};
    turn.to_frame(kLobeBands, kernel_side.data());
    turn.to_frame(bands_, lighting.data());
    for (std::size_t k = 0; k < kMaxKernel; ++k) light.blocked[k] = first_three(kernel_side[k]);
    for (std::size_t i = 0; i < square(bands_); ++i) light.lighting[i] = first_three(lighting[i]);
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
    const Float4 reflectance = padded(r0);
    std::array<Float4, kMaxLight> coeffs{};
    const auto add = [&](const FloatView& table, int bands, std::span<const Rgb> light_coeffs) {
        const Row row = interpolated(lobe, table, bands, perceptual_roughness);
        std::array<Float4, kMaxKernel> from;
        for (std::size_t k = 0; k < square(bands); ++k) from[k] = padded(light_coeffs[k]);
        for (int m = 0; m < std::min(exit.bands, bands); ++m) {
            for (int j = m; j < exit.bands; ++j) {
                Float4 even{}, odd{};
                for (int k = m; k < bands; ++k) {
                    const std::size_t at = lobe_slot(exit.bands, bands, m, j, k);
                    const float b = row.b(at);
                    const Float4 t = row.a(at) * reflectance + Float4{b, b, b, b};
                    even += t * from[slot(k, m)];
                    odd += t * from[slot(k, -m)];
                }
                coeffs[slot(j, m)] += even;
                if (m > 0) coeffs[slot(j, -m)] += odd;
            }
        }
    };
    add(lobe.kernel, kLobeBands, light.blocked);
    for (Float4& coeff : coeffs) coeff = -1.0f * coeff;
    add(lobe.unoccluded, lobe.light_bands, light.lighting);
    for (std::size_t j = 0; j < square(exit.bands); ++j) exit.coeffs[j] = first_three(coeffs[j]);
    return exit;
}

GlossyMatrices::GlossyMatrices() noexcept {
    // Basis functions at the nodes, so that a term is one sum.
    std::array<std::array<float, kMaxVisibility>, SphereRule::kRows * SphereRule::kColumns> basis;
    std::array<double, SphereRule::kRows * SphereRule::kColumns> weights;
    std::size_t node = 0;
    SphereRule().for_each_node([&](std::span<const double> values, double weight) {
        for (std::size_t i = 0; i < kMaxVisibility; ++i)
            basis[node][i] = static_cast<float>(values[i]);
        weights[node++] = weight;
    });
    for (int a = 0; a < kMaxGlossyBands; ++a)
        for (int i = -a; i <= a; ++i)
            for (int b = 0; b < kLobeBands; ++b)
                for (int k = -b; k <= b; ++k)
                    // The product has degrees |a - b|, |a - b| + 2, ..., a + b.
                    for (int c = std::abs(a - b); c <= a + b; c += 2)
                        for (int m = -c; m <= c; ++m) {
                            double sum = 0;
                            for (std::size_t q = 0; q < weights.size(); ++q)
                                sum += weights[q] * static_cast<double>(basis[q][slot(a, i)]) *
                                       static_cast<double>(basis[q][slot(b, k)]) *
                                       static_cast<double>(basis[q][slot(c, m)]);
                            if (std::abs(sum) < 1e-5 || term_count_ == terms_.size()) continue;
                            terms_[term_count_++] = {static_cast<std::uint8_t>(slot(a, i)),
                                                     static_cast<std::uint8_t>(slot(b, k)),
                                                     static_cast<std::uint8_t>(slot(c, m)),
                                                     static_cast<float>(sum)};
                        }
}

bool GlossyMatrices::expand(const LobeView& lobe, const GlossyView& transport, std::uint64_t vertex,
                            float perceptual_roughness, std::span<float> out) const noexcept {
    if (!fits(lobe, transport.light_bands)) return false;
    const std::size_t light_count = square(lobe.light_bands), exit_count = square(lobe.exit_bands);
    if (out.size() != exit_count * light_count * 2) return false;
    Vec3 normal;
    std::array<float, kMaxVisibility> blocked;
    if (!blocked_part(transport, vertex, normal, blocked)) return false;
    const std::array<Vec3, 3> frame = frame_about(normal);
    const FrameTurn turn{quarter_turn_, frame};
    const Row unoccluded =
        interpolated(lobe, lobe.unoccluded, lobe.light_bands, perceptual_roughness);
    const Row kernel = interpolated(lobe, lobe.kernel, kLobeBands, perceptual_roughness);

    // Float4 of the lighting's functions at once: each of them, and what is blocked of it.
    const Term* term = terms_.data();
    const Term* const end = term + term_count_;
    for (std::size_t first = 0; first < light_count; first += 4) {
        std::array<Float4, kMaxLight> lit{};
        std::array<Float4, kMaxKernel> transferred{};
        for (std::size_t lane = 0; lane < 4 && first + lane < light_count; ++lane)
            lit[first + lane][lane] = 1;
        for (; term != end && term->light < first + 4; ++term)
            transferred[term->kernel][term->light - first] +=
                term->integral * blocked[term->visibility];
        turn.to_frame(lobe.light_bands, lit.data());
        turn.to_frame(kLobeBands, transferred.data());
        for (std::size_t part = 0; part < 2; ++part) {
            std::array<Float4, kMaxLight> exit{};
            const auto add = [&](const Row& row, int bands, const Float4* from, float sign) {
                for (int m = 0; m < std::min(lobe.exit_bands, bands); ++m) {
                    for (int j = m; j < lobe.exit_bands; ++j) {
                        for (int k = m; k < bands; ++k) {
                            const float t =
                                sign * row.part(part, lobe_slot(lobe.exit_bands, bands, m, j, k));
                            exit[slot(j, m)] += t * from[slot(k, m)];
                            if (m > 0) exit[slot(j, -m)] += t * from[slot(k, -m)];
                        }
                    }
                }
            };
            add(unoccluded, lobe.light_bands, lit.data(), 1);
            add(kernel, kLobeBands, transferred.data(), -1);
            turn.to_world(lobe.exit_bands, exit.data());
            for (std::size_t j = 0; j < exit_count; ++j)
                for (std::size_t lane = 0; lane < 4 && first + lane < light_count; ++lane)
                    out[(j * light_count + first + lane) * 2 + part] = exit[j][lane];
        }
    }
    return true;
}

}  // namespace envbake::runtime
