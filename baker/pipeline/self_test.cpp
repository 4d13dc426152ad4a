// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/self_test.h"

#include "baker/core/random.h"
#include "baker/math/frame.h"
#include "baker/math/quadrature.h"
#include "envbake/runtime/lobe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

namespace envbake {

namespace {

constexpr int kSpecularCount = 48;

/// Associated Legendre polynomials by their textbook recurrence, without Condon-Shortley phase.
double legendre(int l, int m, double z) {
    double p_mm = 1;
    const double sin_theta = std::sqrt(std::max(0.0, 1 - z * z));
    for (int i = 1; i <= m; ++i) p_mm *= (2 * i - 1) * sin_theta;
    if (l == m) return p_mm;
    double before = p_mm, current = z * (2 * m + 1) * p_mm;
    for (int k = m + 2; k <= l; ++k) {
        const double next = ((2 * k - 1) * z * current - (k + m - 1) * before) / (k - m);
        before = std::exchange(current, next);
    }
    return current;
}

/// Y_lm with factorials and azimuths, as the definition has it: slow, and nothing like the
/// runtime's.
double spherical_harmonic(int l, int m, const DVec3& w) {
    const int order = std::abs(m);
    double ratio = 1;
    for (int k = l - order + 1; k <= l + order; ++k) ratio /= k;
    const double norm = std::sqrt((2 * l + 1) / (4 * std::numbers::pi) * ratio);
    const double phi = std::atan2(w.y, w.x);
    const double azimuthal = m > 0   ? std::numbers::sqrt2 * std::cos(order * phi)
                             : m < 0 ? std::numbers::sqrt2 * std::sin(order * phi)
                                     : 1.0;
    return norm * legendre(l, order, w.z) * azimuthal;
}

/// The clamped cosine's zonal coefficients, by l! and (l / 2)!^2 of [Ramamoorthi01] eq. 8.
double clamped_cosine(int l) {
    using std::numbers::pi;
    if (l == 1) return 2 * pi / 3;
    if (l % 2 == 1) return 0;
    double ratio = 1;  // l! / (2^l (l/2)!^2)
    for (int k = 1; k <= l / 2; ++k) ratio *= (2 * k - 1) / (2.0 * k);
    return 2 * pi * (l % 4 == 0 ? -1 : 1) / ((l + 2.0) * (l - 1.0)) * ratio;
}

DVec3 irradiance(const StoredArrays& arrays, const DVec3& n) {
    DVec3 E{0};
    for (int l = 0; l < arrays.bands; ++l) {
        for (int m = -l; m <= l; ++m) {
            const auto i = static_cast<std::size_t>(3 * (l * l + l + m));
            const double weight = clamped_cosine(l) * spherical_harmonic(l, m, n);
            E += weight * DVec3(arrays.sh[i], arrays.sh[i + 1], arrays.sh[i + 2]);
        }
    }
    return E;
}

DVec3 exit_radiance(const StoredArrays& arrays, const StoredArrays::Vertex& vertex) {
    // Bands that the lighting does not have count as 0.
    const auto channels = static_cast<std::size_t>(vertex.channels);
    DVec3 L = vertex.emitted;
    for (std::size_t i = 0; i < std::min(vertex.transport.size() / channels, arrays.sh.size() / 3);
         ++i)
        for (std::size_t c = 0; c < 3; ++c)
            L[static_cast<int>(c)] +=
                static_cast<double>(vertex.transport[i * channels + c % channels]) *
                static_cast<double>(arrays.sh[3 * i + c]);
    return L;
}

DVec3 texel(const StoredArrays::Mip& mip, int face, int row, int column) {
    const auto channels = static_cast<std::size_t>(mip.channels);
    const std::size_t at =
        channels * static_cast<std::size_t>((face * mip.height + row) * mip.width + column);
    if (channels == 1) return DVec3(mip.texels[at]);
    return {mip.texels[at], mip.texels[at + 1], mip.texels[at + 2]};
}

struct FaceUv {
    int face;
    double u, v;
};

/// OpenGL's table of major axes: sc, tc and ma of each face.
FaceUv face_uv(const DVec3& w) {
    const DVec3 a = glm::abs(w);
    const int axis = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
    const bool negative = w[axis] < 0;
    const double sc = axis == 0   ? (negative ? w.z : -w.z)
                      : axis == 1 ? w.x
                                  : (negative ? -w.x : w.x);
    const double tc = axis == 1 ? (negative ? -w.z : w.z) : -w.y;
    return {2 * axis + (negative ? 1 : 0), sc / a[axis], tc / a[axis]};
}

DVec3 direction_of(int face, double u, double v) {
    const int axis = face / 2;
    const double sign = face % 2 == 0 ? 1 : -1;
    if (axis == 0) return {sign, -v, -sign * u};
    if (axis == 1) return {u, sign, sign * v};
    return {sign * u, -v, sign};
}

/// A texel of the face, or of the face across the edge that it lies beyond; none beyond a corner.
std::optional<DVec3> texel_across_edges(const StoredArrays::Mip& mip, int face, int row,
                                        int column) {
    const int s = mip.width;
    const bool row_inside = row >= 0 && row < s;
    const bool column_inside = column >= 0 && column < s;
    if (row_inside && column_inside) return texel(mip, face, row, column);
    if (!row_inside && !column_inside) return std::nullopt;
    // One step over the edge, at the same place along it: the point just beyond the edge itself.
    const double beyond = 1 + 1e-6;
    const double u = column < 0 ? -beyond : column >= s ? beyond : (2 * column + 1.0) / s - 1;
    const double v = row < 0 ? -beyond : row >= s ? beyond : (2 * row + 1.0) / s - 1;
    const FaceUv across = face_uv(direction_of(face, u, v));
    const auto place = [s](double coordinate) {
        return std::clamp(static_cast<int>(std::floor((coordinate + 1) / 2 * s)), 0, s - 1);
    };
    return texel(mip, across.face, place(across.v), place(across.u));
}

/// x in texels: the index below it, and how far beyond that.
struct Position {
    int below;
    double beyond;

    explicit Position(double x)
        : below(static_cast<int>(std::floor(x))), beyond(x - std::floor(x)) {}
};

DVec3 sample_faces(const StoredArrays::Mip& mip, const DVec3& w) {
    const FaceUv at = face_uv(w);
    const int s = mip.width;
    const Position x((at.u + 1) / 2 * s - 0.5), y((at.v + 1) / 2 * s - 0.5);
    std::array<std::optional<DVec3>, 4> corners;
    DVec3 sum_of_three{0};
    for (int k = 0; k < 4; ++k) {
        const auto corner = static_cast<std::size_t>(k);
        corners[corner] = texel_across_edges(mip, at.face, y.below + k / 2, x.below + k % 2);
        if (corners[corner]) sum_of_three += *corners[corner];
    }
    const std::array<double, 4> weights{(1 - x.beyond) * (1 - y.beyond), x.beyond * (1 - y.beyond),
                                        (1 - x.beyond) * y.beyond, x.beyond * y.beyond};
    DVec3 sum{0};
    for (std::size_t k = 0; k < 4; ++k)
        sum += weights[k] * (corners[k] ? *corners[k] : sum_of_three / 3.0);
    return sum;
}

/// Columns wrap around; a row beyond a pole is the outermost one, half a turn away.
DVec3 sample_image(const StoredArrays::Mip& mip, const DVec3& w) {
    const double u = std::atan2(w.z, w.x) / (2 * std::numbers::pi) + 0.5;
    const double v = std::acos(std::clamp(w.y / glm::length(w), -1.0, 1.0)) / std::numbers::pi;
    const Position x(u * mip.width - 0.5), y(v * mip.height - 0.5);
    DVec3 sum{0};
    for (int k = 0; k < 4; ++k) {
        int row = y.below + k / 2, column = x.below + k % 2;
        if (row < 0 || row >= mip.height) {
            row = row < 0 ? 0 : mip.height - 1;
            column += mip.width / 2;
        }
        column = (column + mip.width) % mip.width;
        const double weight =
            (k % 2 != 0 ? x.beyond : 1 - x.beyond) * (k / 2 != 0 ? y.beyond : 1 - y.beyond);
        sum += weight * texel(mip, 0, row, column);
    }
    return sum;
}

DVec3 sample_level(const StoredArrays::Mip& mip, const DVec3& w) {
    return mip.faces == 6 ? sample_faces(mip, w) : sample_image(mip, w);
}

/// The specular side of a bundle as one lobe sees it.
struct LobeSamples {
    const StoredArrays& arrays;
    std::vector<const StoredArrays::Mip*> mips;
    const StoredArrays::Lobe& lobe;

    LobeSamples(const StoredArrays& all, const StoredArrays::Lobe& one) : arrays(all), lobe(one) {
        // The mirror is the same for both lobes, and stored once.
        const bool shares = &one != &all.ggx && !one.mips.empty() && one.mips[0].level == 1 &&
                            !all.ggx.mips.empty() && all.ggx.mips[0].level == 0;
        if (shares) mips.push_back(&all.ggx.mips[0]);
        for (const StoredArrays::Mip& mip : one.mips) mips.push_back(&mip);
    }

    const StoredArrays::Mip& nearest_stored(int level) const {
        const int first = mips.front()->level, last = mips.back()->level;
        return *mips[static_cast<std::size_t>(std::clamp(level, first, last) - first)];
    }

    DVec3 radiance(const DVec3& w, double roughness) const {
        const Position level(roughness * (arrays.mip_count - 1));
        return (1 - level.beyond) * sample_level(nearest_stored(level.below), w) +
               level.beyond * sample_level(nearest_stored(level.below + 1), w);
    }

    DVec2 albedo(double n_dot_v, double roughness) const {
        const int n = lobe.table_size;
        const auto coordinate = [&](double value, double power) {
            const double x = arrays.table_axes == runtime::TableAxes::RootsEndPoints
                                 ? std::pow(value, power) * (n - 1)
                                 : value * n - 0.5;
            return std::clamp(x, 0.0, n - 1.0);
        };
        const double x = coordinate(n_dot_v, 1.0 / 4), y = coordinate(roughness, 1.0 / 2);
        const int column = std::min(static_cast<int>(x), n - 2),
                  row = std::min(static_cast<int>(y), n - 2);
        const double fx = x - column, fy = y - row;
        DVec2 sum{0};
        for (int k = 0; k < 4; ++k) {
            const auto at = static_cast<std::size_t>(2 * ((row + k / 2) * n + column + k % 2));
            const double weight = (k % 2 != 0 ? fx : 1 - fx) * (k / 2 != 0 ? fy : 1 - fy);
            sum += weight * DVec2(lobe.table[at], lobe.table[at + 1]);
        }
        return sum;
    }
};

DVec3 uniform_direction(RandomStream& random) {
    const double z = 1 - 2 * random.next();
    const double phi = 2 * std::numbers::pi * random.next();
    const double r = std::sqrt(std::max(0.0, 1 - z * z));
    return {r * std::cos(phi), r * std::sin(phi), z};
}

void push(std::vector<float>& list, const DVec3& value) {
    for (int c = 0; c < 3; ++c) list.push_back(static_cast<float>(value[c]));
}

DVec3 as_stored(const DVec3& w) {
    return DVec3(Vec3(w));
}

void ask_irradiance(const StoredArrays& arrays, SelfTest& test) {
    // The 26 directions of a cube's faces, edges and corners.
    for (int code = 0; code < 27; ++code) {
        const DVec3 cell{code % 3 - 1, code / 3 % 3 - 1, code / 9 - 1};
        if (cell == DVec3(0)) continue;
        const DVec3 n = as_stored(glm::normalize(cell));
        push(test.irradiance_normal, n);
        push(test.irradiance_value, irradiance(arrays, glm::normalize(n)));
    }
}

SelfTest::Specular ask_specular(const StoredArrays& arrays, const StoredArrays::Lobe& lobe) {
    SelfTest::Specular questions;
    if (lobe.mips.empty() || lobe.table_size == 0) return questions;
    const LobeSamples samples(arrays, lobe);
    const auto roughness_of = [&](const StoredArrays::Mip& mip) {
        return static_cast<double>(mip.level) / (arrays.mip_count - 1);
    };
    const double least = arrays.mip_count > 1 ? roughness_of(*samples.mips.front()) : 0.0;
    const double most = arrays.mip_count > 1 ? roughness_of(*samples.mips.back()) : 1.0;
    RandomStream random(0, 0x73656c66, 0);
    int asked = 0;
    for (int attempt = 0; asked < kSpecularCount && attempt < 20 * kSpecularCount; ++attempt) {
        const DVec3 n = as_stored(uniform_direction(random));
        const DVec3 v = as_stored(uniform_direction(random));
        const auto roughness = static_cast<float>(least + (most - least) * random.next());
        const auto r0 = static_cast<float>(random.next());
        const double n_dot_v = glm::dot(n, v);
        if (n_dot_v < 0.05) continue;
        const DVec3 r = 2 * n_dot_v * n - v;
        const DVec3 radiance = samples.radiance(r, roughness);
        const auto moved_too_far = [&](const DVec3& by) {
            const DVec3 moved = samples.radiance(r + 1e-6 * by, roughness);
            return glm::any(glm::greaterThan(glm::abs(moved - radiance), 1e-4 * radiance));
        };
        if (moved_too_far({1, 0, 0}) || moved_too_far({0, 1, 0}) || moved_too_far({0, 0, 1}))
            continue;
        const DVec2 ab = samples.albedo(n_dot_v, roughness);
        for (const DVec3& w : {n, v}) push(questions.input, w);
        questions.input.push_back(roughness);
        questions.input.push_back(r0);
        push(questions.value, radiance * (static_cast<double>(r0) * ab.x + ab.y));
        ++asked;
    }
    return questions;
}

/// Exit radiance of glossy transport, without rotations and triple products of the basis: light,
/// and light times the blocked part, are projected onto the basis about the normal by a quadrature
/// that is exact for them.
class GlossyAnswers {
  public:
    explicit GlossyAnswers(const StoredArrays& arrays) : arrays_(arrays) {
        const Quadrature rule = gauss_legendre(kNodes);
        for (std::size_t i = 0; i < rule.nodes.size(); ++i) {
            const double z = rule.nodes[i], radius = std::sqrt(1 - z * z);
            for (int k = 0; k < 2 * kNodes; ++k) {
                const double phi = std::numbers::pi * k / kNodes;
                nodes_.push_back({radius * std::cos(phi), radius * std::sin(phi), z});
                weights_.push_back(rule.weights[i] * std::numbers::pi / kNodes);
                basis_.push_back(
                    basis(arrays.light_bands + runtime::kExtraVisibilityBands, nodes_.back()));
                DVec3 light(0);
                const int shared = std::min(arrays.bands, arrays.light_bands);
                for (std::size_t i_light = 0; i_light < static_cast<std::size_t>(shared * shared);
                     ++i_light)
                    light += basis_.back()[i_light] * DVec3(arrays.sh[3 * i_light],
                                                            arrays.sh[3 * i_light + 1],
                                                            arrays.sh[3 * i_light + 2]);
                light_.push_back(light);
            }
        }
    }

    /// [j] of exit radiance about the normal.
    std::vector<DVec3> exit(const StoredArrays::Lobe& lobe,
                            const StoredArrays::GlossyVertex& vertex, const Frame& frame,
                            double roughness, double r0) const {
        // What a place that sees everything has more.
        const int row_bands = arrays_.light_bands + runtime::kExtraVisibilityBands;
        std::vector<double> missing = basis(row_bands, frame.normal);
        for (int l = 0; l < row_bands; ++l)
            for (int m = -l; m <= l; ++m) {
                const auto at = static_cast<std::size_t>(l * l + l + m);
                missing[at] *= clamped_cosine(l) / std::numbers::pi;
                missing[at] -= static_cast<double>(vertex.visibility[at]);
            }
        std::vector<double> blocked;  // at the nodes
        for (const std::vector<double>& Y : basis_)
            blocked.push_back(std::inner_product(Y.begin(), Y.end(), missing.begin(), 0.0));
        // What is blocked sends the mean of what diffuse transport has from there, and what differs
        // from it by direction.
        DVec3 from_surfaces = vertex.emitted;
        const std::size_t shared =
            std::min(vertex.transport.size() / static_cast<std::size_t>(vertex.channels),
                     static_cast<std::size_t>(arrays_.light_bands * arrays_.light_bands));
        for (std::size_t i = 0; i < std::min(shared, arrays_.sh.size() / 3); ++i)
            for (int c = 0; c < 3; ++c) {
                const auto channel = static_cast<std::size_t>(c);
                const auto channels = static_cast<std::size_t>(vertex.channels);
                from_surfaces[c] +=
                    static_cast<double>(arrays_.sh[3 * i + channel]) *
                    (static_cast<double>(vertex.transport[i * channels + channel % channels]) -
                     static_cast<double>(vertex.visibility[i]));
            }
        const double blocked_share = missing[0] * std::sqrt(4 * std::numbers::pi);
        from_surfaces = blocked_share > 1e-3 && !vertex.transport.empty()
                            ? from_surfaces / blocked_share
                            : DVec3(0);
        std::vector<DVec3> sent(nodes_.size(), from_surfaces);
        if (blocked_share > 1e-3) add_variation(vertex, missing, sent);
        const int exit_bands = arrays_.exit_bands;
        std::vector<DVec3> coeffs(static_cast<std::size_t>(exit_bands * exit_bands), DVec3(0));
        const auto add = [&](const std::vector<float>& table, int bands, bool of_blocked) {
            for (int k = 0; k < bands; ++k) {
                for (int m = -k; m <= k; ++m) {
                    DVec3 moment(0);
                    for (std::size_t q = 0; q < nodes_.size(); ++q)
                        moment += weights_[q] *
                                  (of_blocked ? blocked[q] * (sent[q] - light_[q]) : light_[q]) *
                                  spherical_harmonic(k, m, to_local(frame, nodes_[q]));
                    for (int j = std::abs(m); j < exit_bands; ++j)
                        coeffs[static_cast<std::size_t>(j * j + j + m)] +=
                            element(table, lobe.lobe_rows, bands, std::abs(m), j, k, roughness,
                                    r0) *
                            moment;
                }
            }
        };
        add(lobe.unoccluded, arrays_.light_bands, false);
        add(lobe.kernel, runtime::kLobeBands, true);
        return coeffs;
    }

    DVec3 radiance(const std::vector<DVec3>& exit, const Frame& frame, const DVec3& v) const {
        DVec3 sum(0);
        for (int l = 0; l < arrays_.exit_bands; ++l)
            for (int m = -l; m <= l; ++m)
                sum += exit[static_cast<std::size_t>(l * l + l + m)] *
                       spherical_harmonic(l, m, to_local(frame, v));
        return sum;
    }

  private:
    static constexpr int kNodes = 11;  // the products are of degree 20

    /// sum of r_q (Y_q - y_q), at the nodes.
    void add_variation(const StoredArrays::GlossyVertex& vertex, const std::vector<double>& missing,
                       std::vector<DVec3>& sent) const {
        const auto channels = static_cast<std::size_t>(vertex.channels);
        const auto light_coeffs =
            static_cast<std::size_t>(arrays_.light_bands * arrays_.light_bands);
        const std::size_t row = light_coeffs * channels;
        for (std::size_t q = 1; q <= vertex.reflected.size() / row; ++q) {
            DVec3 of_q(0);
            for (std::size_t i = 0; i < std::min(light_coeffs, arrays_.sh.size() / 3); ++i)
                for (std::size_t c = 0; c < 3; ++c)
                    of_q[static_cast<int>(c)] +=
                        static_cast<double>(arrays_.sh[3 * i + c]) *
                        static_cast<double>(
                            vertex.reflected[(q - 1) * row + i * channels + c % channels]);
            const double mean = missing[q] / (missing[0] * std::sqrt(4 * std::numbers::pi));
            for (std::size_t node = 0; node < sent.size(); ++node)
                sent[node] += of_q * (basis_[node][q] - mean);
        }
    }

    static DVec3 to_local(const Frame& frame, const DVec3& w) {
        return {glm::dot(frame.tangent, w), glm::dot(frame.bitangent, w),
                glm::dot(frame.normal, w)};
    }

    /// R0 a + b, linear between rows.
    double element(const std::vector<float>& table, int rows, int bands, int m, int j, int k,
                   double roughness, double r0) const {
        std::size_t size = 0, at = 0;
        for (int block = 0; block < std::min(arrays_.exit_bands, bands); ++block) {
            if (block == m) at = size + static_cast<std::size_t>((j - m) * (bands - m) + k - m);
            size += static_cast<std::size_t>((arrays_.exit_bands - block) * (bands - block));
        }
        const auto value = [&](int row) {
            const std::size_t first = static_cast<std::size_t>(row) * 2 * size + at;
            return r0 * static_cast<double>(table[first]) +
                   static_cast<double>(table[first + size]);
        };
        if (rows == 1) return value(0);
        const auto [least, largest] = arrays_.lobe_roughness;
        const double position =
            std::clamp((roughness - least) / (largest - least), 0.0, 1.0) * (rows - 1);
        const int row = std::min(static_cast<int>(position), rows - 2);
        return value(row) + (position - row) * (value(row + 1) - value(row));
    }

    static std::vector<double> basis(int bands, const DVec3& w) {
        std::vector<double> values;
        for (int l = 0; l < bands; ++l)
            for (int m = -l; m <= l; ++m) values.push_back(spherical_harmonic(l, m, w));
        return values;
    }

    const StoredArrays& arrays_;
    std::vector<DVec3> nodes_, light_;
    std::vector<std::vector<double>> basis_;  ///< at the nodes
    std::vector<double> weights_;
};

SelfTest::Glossy ask_glossy(const StoredArrays& arrays, const StoredArrays::Lobe& lobe) {
    SelfTest::Glossy questions;
    if (arrays.sh.empty() || lobe.lobe_rows == 0) return questions;
    const GlossyAnswers answers(arrays);
    const auto [least, largest] = arrays.lobe_roughness;
    RandomStream random(0, 0x676c6f73, 0);
    for (const StoredArrays::GlossyVertex& vertex : arrays.glossy_vertices) {
        if (vertex.normal == Vec3(0)) continue;
        const Frame frame = frame_about(glm::normalize(DVec3(vertex.normal)));
        const auto roughness = static_cast<float>(least + (largest - least) * random.next());
        const auto r0 = static_cast<float>(random.next());
        DVec3 v = uniform_direction(random);
        v = as_stored(glm::dot(v, frame.normal) < 0 ? -v : v);
        if (glm::dot(v, frame.normal) < 0.05) continue;
        questions.vertex.insert(questions.vertex.end(), {vertex.mesh, vertex.vertex});
        push(questions.input, v);
        questions.input.push_back(roughness);
        questions.input.push_back(r0);
        push(questions.value,
             answers.radiance(answers.exit(lobe, vertex, frame, roughness, r0), frame, v));
    }
    return questions;
}

}  // namespace

SelfTest make_self_test(const StoredArrays& arrays) {
    SelfTest test;
    if (!arrays.sh.empty()) {
        ask_irradiance(arrays, test);
        for (const auto& vertex : arrays.vertices) {
            test.diffuse_vertex.push_back(vertex.mesh);
            test.diffuse_vertex.push_back(vertex.vertex);
            push(test.diffuse_value, exit_radiance(arrays, vertex));
        }
    }
    for (const auto& vertex : arrays.wavelet_vertices) {
        test.wavelet_vertex.push_back(vertex.mesh);
        test.wavelet_vertex.push_back(vertex.vertex);
        push(test.wavelet_value, vertex.exit_radiance);
    }
    test.ggx = ask_specular(arrays, arrays.ggx);
    test.beckmann = ask_specular(arrays, arrays.beckmann);
    test.ggx_glossy = ask_glossy(arrays, arrays.ggx);
    test.beckmann_glossy = ask_glossy(arrays, arrays.beckmann);
    return test;
}

}  // namespace envbake
