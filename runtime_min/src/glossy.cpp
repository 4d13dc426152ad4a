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
constexpr std::size_t kMaxReflected = kMaxReflectedBands * kMaxReflectedBands;

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
            sh::evaluate(kMostVisibilityBands, std::sqrt(1 - z * z), 0.0, z,
                         meridian_[static_cast<std::size_t>(i)].data());
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

    /// Slots sh::index; the orders' part in closed form.
    double integral(const std::array<int, 3>& l, const std::array<int, 3>& m) const {
        const double of_orders = around(m);
        if (of_orders == 0) return 0;
        double sum = 0;
        for (std::size_t i = 0; i < kRows; ++i) {
            double product = weight_[i] * kColumns / (2 * pi);
            for (std::size_t k = 0; k < 3; ++k) product *= meridian_[i][slot(l[k], std::abs(m[k]))];
            sum += product;
        }
        return sum * of_orders;
    }

  private:
    /// Integral over a turn of three factors, each cos(m phi), or sin(-m phi) where m < 0.
    static double around(std::array<int, 3> m) {
        std::sort(m.begin(), m.end());  // sines first
        const auto cosines = [](int a, int b) { return pi * ((a == b) + (a == -b)); };
        const int a = m[0], b = m[1], c = m[2];
        if (a >= 0) return (cosines(a + b, c) + cosines(a - b, c)) / 2;
        if (b < 0 && c >= 0) return (cosines(a - b, c) - cosines(a + b, c)) / 2;
        return 0;
    }

    std::array<double, kRows> z_, weight_;
    std::array<std::array<double, kMaxVisibility>, kRows> meridian_;  ///< the basis at phi = 0
};

/// Those whose first function is one of begin .. end - 1; as many as there is room for.
std::size_t list_products(int first_band, int end_band, std::span<TripleProduct> out) {
    const SphereRule rule;
    std::size_t count = 0;
    for (int a = first_band; a < end_band; ++a)
        for (int i = -a; i <= a; ++i)
            for (int b = 0; b < kLobeBands; ++b)
                for (int k = -b; k <= b; ++k)
                    // The product has degrees |a - b|, |a - b| + 2, ..., a + b.
                    for (int c = std::abs(a - b); c <= a + b; c += 2)
                        for (int m = -c; m <= c; ++m) {
                            const double integral = rule.integral({a, b, c}, {i, k, m});
                            if (std::abs(integral) < 1e-5 || count == out.size()) continue;
                            out[count++] = {static_cast<std::uint8_t>(slot(a, i)),
                                            static_cast<std::uint8_t>(slot(b, k)),
                                            static_cast<std::uint8_t>(slot(c, m)),
                                            static_cast<float>(integral)};
                        }
    return count;
}

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

/// Radiance that surfaces send to a vertex under some lighting, in SH: the mean over the directions
/// that they block, weighted by the cosine, which diffuse transport has beyond the sky's; and what
/// "mesh/I/reflected" says of single directions.
struct SurfaceLight {
    int bands = 0;  ///< 0: none
    std::array<Rgb, kMaxReflected> coeffs{};
};

SurfaceLight light_of_surfaces(const Mesh& mesh, std::uint64_t vertex,
                               const std::array<float, kMaxVisibility>& blocked,
                               std::span<const Rgb> lighting) {
    static constexpr float kRoot4Pi = 3.544907702f;  // 1 / Y_0
    const GlossyView& glossy = mesh.glossy;
    const TransportView& diffuse = mesh.diffuse;
    const float blocked_share = blocked[0] * kRoot4Pi;
    if (diffuse.bands == 0 || !(blocked_share > 1e-3f)) return {};
    const std::size_t count = square(std::min(diffuse.bands, glossy.light_bands));
    const ShLightingView shading{glossy.light_bands,
                                 std::span(lighting[0].data(), 3 * lighting.size())};
    Rgb mean;
    diffuse_exit(diffuse, shading, vertex, {&mean, 1});
    const std::uint64_t direct = vertex * square(glossy.light_bands + kExtraVisibilityBands);
    for (std::size_t i = 0; i < count; ++i)
        for (std::size_t c = 0; c < 3; ++c)
            mean[c] -= lighting[i][c] * glossy.visibility[direct + i];

    SurfaceLight light{glossy.reflected_bands, {}};
    for (std::size_t c = 0; c < 3; ++c) light.coeffs[0][c] = mean[c] / blocked_share * kRoot4Pi;
    // Rows of r are like rows of transport, so many a vertex.
    const std::size_t functions = square(glossy.reflected_bands);
    TransportView variation;
    variation.vertex_count = (functions - 1) * glossy.vertex_count;
    variation.bands = glossy.light_bands;
    variation.channels = glossy.reflected_channels;
    variation.values = glossy.reflected;
    diffuse_exit(variation, shading, (functions - 1) * vertex,
                 std::span(light.coeffs).subspan(1, functions - 1));
    for (std::size_t q = 1; q < functions; ++q) {
        const float mean_of_basis = blocked[q] / blocked_share;
        for (std::size_t c = 0; c < 3; ++c)
            light.coeffs[0][c] -= light.coeffs[q][c] * mean_of_basis * kRoot4Pi;
    }
    return light;
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
    reflected_count_ = list_products(1, kMaxReflectedBands, reflected_products_);
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
    std::array<Float4, kMaxKernel> kernel_side;
    for (std::size_t k = 0; k < kMaxKernel; ++k)
        kernel_side[k] = padded({products[0][k], products[1][k], products[2][k]});
    const SurfaceLight sent =
        light_of_surfaces(mesh, vertex, blocked, std::span(lighting_).first(square(bands_)));
    if (sent.bands > 0) {
        std::array<Float4, kMaxReflected> coeffs;
        for (std::size_t q = 0; q < kMaxReflected; ++q) coeffs[q] = padded(sent.coeffs[q]);
        constexpr float kY0 = 0.282094792f;
        for (std::size_t k = 0; k < std::min(rows, kMaxKernel); ++k)
            kernel_side[k] = kernel_side[k] - kY0 * blocked[k] * coeffs[0];
        const std::size_t functions = square(sent.bands);
        for (std::size_t p = 0; p < reflected_count_ && reflected_products_[p].first < functions;
             ++p) {
            const TripleProduct& product = reflected_products_[p];
            const float of_blocked = product.integral * blocked[product.visibility];
            kernel_side[product.kernel] =
                kernel_side[product.kernel] - of_blocked * coeffs[product.first];
        }
    }
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

GlossyMatrices::GlossyMatrices() noexcept
    : product_count_(list_products(0, kMaxGlossyBands, products_)) {}

/// Of a vertex, beside the lobe.
struct GlossyMatrices::Blocked {
    int light_bands = 0;
    Vec3 normal{};
    std::array<float, kMaxVisibility> missing{};  ///< V of a place that sees everything, less V
    /// [coefficient of the lighting]: what surfaces send where it is 1.
    std::array<std::array<float, kMaxReflected>, kMaxLight> sent{};
    std::size_t sent_functions = 0;
};

bool GlossyMatrices::expand(const LobeView& lobe, const GlossyView& transport, std::uint64_t vertex,
                            float perceptual_roughness, std::span<float> out) const noexcept {
    Blocked blocked;
    blocked.light_bands = transport.light_bands;
    return blocked_part(transport, vertex, blocked.normal, blocked.missing) &&
           expand(lobe, blocked, perceptual_roughness, out);
}

bool GlossyMatrices::expand(const LobeView& lobe, const Mesh& mesh, std::uint64_t vertex,
                            float perceptual_roughness, int channel,
                            std::span<float> out) const noexcept {
    Blocked blocked;
    blocked.light_bands = mesh.glossy.light_bands;
    if (channel < 0 || channel > 2 ||
        !blocked_part(mesh.glossy, vertex, blocked.normal, blocked.missing))
        return false;
    Mesh without_emission = mesh;
    without_emission.diffuse.emitted = {};
    const auto c = static_cast<std::size_t>(channel);
    for (std::size_t i = 0; i < square(blocked.light_bands); ++i) {
        std::array<Rgb, kMaxLight> lighting{};
        lighting[i][c] = 1;
        const SurfaceLight sent =
            light_of_surfaces(without_emission, vertex, blocked.missing,
                              std::span(lighting).first(square(blocked.light_bands)));
        blocked.sent_functions = square(sent.bands);
        for (std::size_t q = 0; q < blocked.sent_functions; ++q)
            blocked.sent[i][q] = sent.coeffs[q][c];
    }
    return expand(lobe, blocked, perceptual_roughness, out);
}

bool GlossyMatrices::expand(const LobeView& lobe, const Blocked& blocked,
                            float perceptual_roughness, std::span<float> out) const noexcept {
    if (!fits(lobe, blocked.light_bands)) return false;
    const std::size_t light_count = square(lobe.light_bands), exit_count = square(lobe.exit_bands);
    if (out.size() != exit_count * light_count * 2) return false;
    const std::array<Vec3, 3> frame = frame_about(blocked.normal);
    const FrameTurn turn{quarter_turn_, frame};
    const Row unoccluded =
        interpolated(lobe, lobe.unoccluded, lobe.light_bands, perceptual_roughness);
    const Row kernel = interpolated(lobe, lobe.kernel, kLobeBands, perceptual_roughness);

    // What is blocked of each function, towards the kernel: of the lighting's, and of the few that
    // surfaces send light in.
    std::array<std::array<float, kMaxKernel>, kMaxLight> blocked_of{};
    for (std::size_t p = 0; p < product_count_ && products_[p].first < light_count; ++p) {
        const TripleProduct& product = products_[p];
        blocked_of[product.first][product.kernel] +=
            product.integral * blocked.missing[product.visibility];
    }

    // Float4 of the lighting's functions at once: each of them, and what is blocked of it.
    for (std::size_t first = 0; first < light_count; first += 4) {
        std::array<Float4, kMaxLight> lit{};
        std::array<Float4, kMaxKernel> transferred{};
        for (std::size_t lane = 0; lane < 4 && first + lane < light_count; ++lane) {
            const std::size_t i = first + lane;
            lit[i][lane] = 1;
            for (std::size_t k = 0; k < kMaxKernel; ++k) {
                float sum = blocked_of[i][k];
                for (std::size_t q = 0; q < blocked.sent_functions; ++q)
                    sum -= blocked.sent[i][q] * blocked_of[q][k];
                transferred[k][lane] = sum;
            }
        }
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
