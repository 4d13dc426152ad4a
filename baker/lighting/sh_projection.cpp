// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/sh_projection.h"

#include "baker/core/parallel.h"
#include "baker/math/quadrature.h"
#include "baker/math/simd.h"
#include "envbake/runtime/cube.h"
#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <complex>
#include <cstddef>
#include <cstring>
#include <numbers>
#include <type_traits>

namespace envbake {
namespace {

using std::numbers::pi;

constexpr int kMaxCoeffs = sh::coeff_count(sh::kMaxBundleBands);

std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}
int padded(int count) {
    return (count + kDoubleLanes - 1) / kDoubleLanes * kDoubleLanes;
}

/// Adds `coeffs`, projected in a frame whose axes are the columns of `axes` (orthonormal, of either
/// handedness), to `world`. Per band c_m = sum_m' R_mm' c'_m', R_mm' = integral of
/// Y_lm(axes w) Y_lm'(w) dw; the quadrature is exact for these polynomials of degree 2 bands - 2.
void add_from_frame(int bands, const DMat3& axes, const std::vector<DVec3>& coeffs,
                    std::vector<DVec3>& world) {
    const Quadrature polar = gauss_legendre(bands);
    const int azimuths = 2 * bands;
    std::array<double, kMaxCoeffs> y_world, y_frame;
    for (int i = 0; i < polar.count(); ++i) {
        const double z = polar.nodes[index(i)];
        const double r = std::sqrt((1 - z) * (1 + z));
        for (int j = 0; j < azimuths; ++j) {
            const double phi = 2 * pi * j / azimuths;
            const DVec3 w{r * std::cos(phi), r * std::sin(phi), z};
            const DVec3 v = axes * w;
            sh::evaluate(bands, w.x, w.y, w.z, y_frame.data());
            sh::evaluate(bands, v.x, v.y, v.z, y_world.data());
            const double weight = polar.weights[index(i)] * 2 * pi / azimuths;
            for (int l = 0; l < bands; ++l) {
                DVec3 value{0};  // of band l at this direction
                for (int m = -l; m <= l; ++m) {
                    const std::size_t k = index(sh::index(l, m));
                    value += y_frame[k] * coeffs[k];
                }
                for (int m = -l; m <= l; ++m) {
                    const std::size_t k = index(sh::index(l, m));
                    world[k] += weight * y_world[k] * value;
                }
            }
        }
    }
}

// ---- latitude-longitude ------------------------------------------------------------------------

/// Rows are summed onto the nodes of their block before azimuth is looked at, so that the work a
/// texel is `nodes` multiply-adds and 1 / kRowsPerBlock of a Fourier transform of `nodes` rows.
constexpr int kRowsPerBlock = 32;
constexpr int kColumnsPerChunk = 64;  ///< whose sums stay in the first cache

/// Nodes that a polynomial in theta through the basis needs within a block of `height` radians, for
/// an error below 1e-12 of l_00 whatever the map.
///
/// Along a meridian any Y of band l and norm 1, turned as it may be, is a trigonometric polynomial
/// of degree l, and |Y| <= sqrt((2 l + 1) / 4 pi), for that is the norm of a band's values at a
/// point. So its k-th derivative is at most l^k times as much (Bernstein), and between k Chebyshev
/// nodes
///
///     error <= 2 (height / 4)^k / k! l^k sqrt((2 l + 1) / 4 pi)
///
/// which times the integral of L, that is l_00 sqrt(4 pi), is what the loop counts.
int node_count(int bands, double height) {
    const int l = bands - 1;
    double bound = 2 * std::sqrt(2.0 * l + 1);
    int k = 0;
    do bound *= l * height / 4 / ++k;
    while (bound > 1e-12);
    return k;
}

/// Chebyshev's nodes between theta0 and theta1, and Lagrange's polynomials through them.
class PolarNodes {
  public:
    PolarNodes(int count, double theta0, double theta1)
        : theta_(index(count)), sign_(index(count)) {
        for (int k = 0; k < count; ++k) {
            const double angle = (k + 0.5) * pi / count;
            theta_[index(k)] = (theta0 + theta1) / 2 - (theta1 - theta0) / 2 * std::cos(angle);
            sign_[index(k)] = (k % 2 == 0 ? 1 : -1) * std::sin(angle);
        }
    }
    int count() const { return static_cast<int>(theta_.size()); }
    double theta(int k) const { return theta_[index(k)]; }

    /// Adds weight * polynomial k at `theta` to out[k]. Barycentric, [Berrut04] 4.2 and 5.4.
    void add(double theta, double weight, double* out) const {
        double total = 0;
        for (std::size_t k = 0; k < theta_.size(); ++k) {
            if (theta == theta_[k]) {
                out[k] += weight;
                return;
            }
            total += sign_[k] / (theta - theta_[k]);
        }
        for (std::size_t k = 0; k < theta_.size(); ++k) {
            out[k] += weight * sign_[k] / (theta - theta_[k]) / total;
        }
    }

  private:
    std::vector<double> theta_, sign_;
};

/// 2 where the right half of the columns is the left one turned by pi, else 1.
int equal_parts(const LatLongGrid& grid) {
    const int half = grid.width / 2;
    if (grid.width % 2 != 0) return 1;
    for (int c = 0; c <= half; ++c) {
        const double turn = grid.phi_edges[index(c + half)] - grid.phi_edges[index(c)];
        if (std::abs(turn - pi) > 1e-14) return 1;
    }
    return 2;
}

/// Integrals of cos m phi and sin m phi over every column: [m][column], padded with zeros. Half a
/// turn on they are the same for even m and the opposite for odd m, so that the sum of both halves
/// of a row has its even m, and their difference its odd m, in half the columns.
struct ColumnIntegrals {
    int parts = 0;
    int width = 0;  ///< of one part
    int stride = 0;
    std::vector<double> cosine, sine;

    ColumnIntegrals(const LatLongGrid& grid, int bands)
        : parts(equal_parts(grid)),
          width(grid.width / parts),
          stride(padded(width)),
          cosine(index(stride * bands)),
          sine(index(stride * bands)) {
        for (int c = 0; c < width; ++c) {
            const double half = (grid.phi_edges[index(c + 1)] - grid.phi_edges[index(c)]) / 2;
            const double middle = grid.phi_edges[index(c)] + half;
            const std::complex<double> step = std::polar(1.0, middle),
                                       half_step = std::polar(1.0, half);
            std::complex<double> turned = 1, half_turned = 1;  // step^m: 10 of them lose no digit
            for (int m = 0; m < bands; ++m) {
                const double extent = m == 0 ? 2 * half : 2 * half_turned.imag() / m;
                cosine[index(m * stride + c)] = extent * turned.real();
                sine[index(m * stride + c)] = extent * turned.imag();
                turned *= step;
                half_turned *= half_step;
            }
        }
    }
};

/// Eight texels, channel by channel.
template <int kChannels>
std::array<Double8, kChannels> planes_of(const std::array<Double8, kChannels>& texels) {
    if constexpr (kChannels == 1) {
        return texels;
    } else {
        const auto& [a, b, c] = texels;
        const Double8 r = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 0, 0);
        const Double8 g = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 0, 0, 0);
        const Double8 u = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 0, 0, 0);
        return {__builtin_shufflevector(r, c, 0, 1, 2, 3, 4, 5, 10, 13),
                __builtin_shufflevector(g, c, 0, 1, 2, 3, 4, 8, 11, 14),
                __builtin_shufflevector(u, c, 0, 1, 2, 3, 4, 9, 12, 15)};
    }
}

/// Sums rows onto kNodes nodes: sums[node][channel][column] = sum over r of weights[r][node] *
/// rows[r][column][channel].
template <int kChannels, int kNodes>
void sum_rows(const float* rows, int row_count, int columns, const double* weights,
              int weight_stride, double* sums) {
    constexpr int kRowStride = kChannels * kColumnsPerChunk;
    for (int c = 0; c < columns; c += kDoubleLanes) {
        std::array<std::array<Double8, kChannels>, kNodes> total{};
        for (int r = 0; r < row_count; ++r) {
            std::array<Double8, kChannels> texels;
            for (int v = 0; v < kChannels; ++v) {
                using Float8 = float __attribute__((vector_size(32)));
                texels[index(v)] = __builtin_convertvector(
                    load<Float8>(rows + r * kRowStride + kChannels * c + kDoubleLanes * v),
                    Double8);
            }
            for (int k = 0; k < kNodes; ++k) {
                for (int v = 0; v < kChannels; ++v) {
                    total[index(k)][index(v)] += texels[index(v)] * weights[r * weight_stride + k];
                }
            }
        }
        for (int k = 0; k < kNodes; ++k) {
            const auto planes = planes_of<kChannels>(total[index(k)]);
            for (int p = 0; p < kChannels; ++p) {
                store(planes[index(p)], sums + (k * kChannels + p) * kColumnsPerChunk + c);
            }
        }
    }
}

/// The Fourier coefficient m of kPlanes rows, over some columns.
template <int kPlanes>
void add_spectrum(const double* planes, const double* cosine, const double* sine, int columns,
                  Double8* out_cosine, Double8* out_sine) {
    std::array<Double8, kPlanes> c{}, s{};
    for (int i = 0; i < columns; i += kDoubleLanes) {
        const auto cos_m = load<Double8>(cosine + i);
        const auto sin_m = load<Double8>(sine + i);
        for (int p = 0; p < kPlanes; ++p) {
            const auto value = load<Double8>(planes + p * kColumnsPerChunk + i);
            c[index(p)] += value * cos_m;
            s[index(p)] += value * sin_m;
        }
    }
    for (int p = 0; p < kPlanes; ++p) {
        out_cosine[p] += c[index(p)];
        out_sine[p] += s[index(p)];
    }
}

/// Some rows' texels of some columns, padded with zeros to whole vectors: the channels of a texel
/// side by side, or red alone.
template <int kChannels>
void pack(const Vec3* row, int columns, float* out) {
    if constexpr (kChannels == 3) {
        std::memcpy(out, row, index(columns) * sizeof(Vec3));
    } else {
        for (int c = 0; c < columns; ++c) out[c] = row[c].r;
    }
    std::fill(out + kChannels * columns, out + kChannels * padded(columns), 0.0f);
}

/// Projects rows `first` .. `last` - 1 into out[coefficient][channel].
template <int kChannels>
void project_rows(int bands, const LatLongGrid& grid, const ColumnIntegrals& columns,
                  const Vec3* radiance, int first, int last, DVec3* out) {
    const double theta0 = grid.theta_edges[index(first)], theta1 = grid.theta_edges[index(last)];
    const PolarNodes nodes(node_count(bands, theta1 - theta0), theta0, theta1);

    // The integral of every Lagrange polynomial, times sin theta, over every row.
    constexpr int kGroup = 4;
    const int rows = last - first;
    const int stride = (nodes.count() + kGroup - 1) / kGroup * kGroup;
    std::vector<double> weights(index(rows * stride));
    double tallest = 0;
    for (int r = first; r < last; ++r) {
        tallest = std::max(tallest, grid.theta_edges[index(r + 1)] - grid.theta_edges[index(r)]);
    }
    // Half the degree of the polynomial, and what sin theta needs.
    const Quadrature rule =
        gauss_legendre(nodes.count() / 2 + gauss_count_for_frequency(1, tallest));
    for (int r = 0; r < rows; ++r) {
        const double top = grid.theta_edges[index(first + r)];
        const double half = (grid.theta_edges[index(first + r + 1)] - top) / 2;
        for (int i = 0; i < rule.count(); ++i) {
            const double theta = top + half * (1 + rule.nodes[index(i)]);
            nodes.add(theta, half * rule.weights[index(i)] * std::sin(theta),
                      weights.data() + r * stride);
        }
    }

    const int planes = nodes.count() * kChannels;
    std::vector<float> packed(index(rows * kChannels * kColumnsPerChunk));
    const std::size_t part_size = index(stride * kChannels * kColumnsPerChunk);
    std::vector<double> sums(index(columns.parts) * part_size);
    std::vector<Double8> cosine(index(bands * planes), Double8{}), sine(cosine);
    for (int c = 0; c < columns.width; c += kColumnsPerChunk) {
        const int count = std::min(kColumnsPerChunk, columns.width - c);
        for (int part = 0; part < columns.parts; ++part) {
            for (int r = 0; r < rows; ++r) {
                const Vec3* row =
                    radiance + index(first + r) * index(grid.width) + part * columns.width + c;
                pack<kChannels>(row, count, packed.data() + r * kChannels * kColumnsPerChunk);
                // The next chunk comes from memory while this one is summed.
                const int ahead = std::min(2 * kColumnsPerChunk, columns.width - c);
                constexpr int kTexelsPerLine = 5;
                for (int i = kColumnsPerChunk; i < ahead; i += kTexelsPerLine) {
                    __builtin_prefetch(row + i, 0, 2);
                }
            }
            double* part_sums = sums.data() + index(part) * part_size;
            int k = 0;
            const auto sum_onto = [&](auto group) {
                sum_rows<kChannels, group()>(packed.data(), rows, padded(count), weights.data() + k,
                                             stride, part_sums + k * kChannels * kColumnsPerChunk);
                k += group();
            };
            while (k + 2 * kGroup <= stride) sum_onto(std::integral_constant<int, 2 * kGroup>{});
            if (k < stride) sum_onto(std::integral_constant<int, kGroup>{});
        }
        if (columns.parts == 2) {
            for (std::size_t i = 0; i < part_size; ++i) {
                const double left = sums[i], right = sums[part_size + i];
                sums[i] = left + right;
                sums[part_size + i] = left - right;
            }
        }
        for (int m = 0; m < bands; ++m) {
            const double* in = sums.data() + index(m % columns.parts) * part_size;
            int p = 0;
            const auto add = [&](auto group) {
                add_spectrum<group()>(in + p * kColumnsPerChunk,
                                      columns.cosine.data() + m * columns.stride + c,
                                      columns.sine.data() + m * columns.stride + c, padded(count),
                                      cosine.data() + m * planes + p, sine.data() + m * planes + p);
                p += group();
            };
            while (p + 6 <= planes) add(std::integral_constant<int, 6>{});
            while (p < planes) add(std::integral_constant<int, 1>{});
        }
    }

    std::array<double, kMaxCoeffs> y;
    for (int k = 0; k < nodes.count(); ++k) {
        // With phi = 0 the basis is its own polar factor.
        sh::evaluate(bands, std::sin(nodes.theta(k)), 0.0, std::cos(nodes.theta(k)), y.data());
        for (int m = 0; m < bands; ++m) {
            for (int channel = 0; channel < kChannels; ++channel) {
                const std::size_t plane = index(m * planes + k * kChannels + channel);
                const double c = sum(cosine[plane]), s = sum(sine[plane]);
                for (int l = m; l < bands; ++l) {
                    const double polar = y[index(sh::index(l, m))];
                    out[sh::index(l, m)][channel] += polar * c;
                    if (m > 0) out[sh::index(l, -m)][channel] += polar * s;
                }
            }
        }
    }
}

/// Projects in the frame (x, z, y): its pole is +Y and its azimuth is the grid's phi.
template <int kChannels>
std::vector<DVec3> project_lat_long(int bands, const LatLongGrid& grid, const Vec3* radiance) {
    const int coeffs = sh::coeff_count(bands);
    const ColumnIntegrals columns(grid, bands);
    const int blocks = (grid.height + kRowsPerBlock - 1) / kRowsPerBlock;
    std::vector<DVec3> partial(index(blocks) * index(coeffs), DVec3{0});
    parallel_for(index(blocks), [&](std::size_t block) {
        const int first = static_cast<int>(block) * kRowsPerBlock;
        project_rows<kChannels>(bands, grid, columns, radiance, first,
                                std::min(first + kRowsPerBlock, grid.height),
                                partial.data() + block * index(coeffs));
    });
    std::vector<DVec3> total(index(coeffs), DVec3{0});
    for (std::size_t i = 0; i < partial.size(); ++i) total[i % index(coeffs)] += partial[i];
    return total;
}

// ---- cube --------------------------------------------------------------------------------------

/// The integrals of the basis over the texels of one row of a face, in the frame of the face
/// (u, v, outwards): [coefficient][column], padded with zeros.
void face_row_integrals(int bands, const CubeGrid& grid, int row, const Quadrature& rule,
                        std::vector<double>& out) {
    const int stride = padded(grid.size);
    const int coeffs = sh::coeff_count(bands);
    std::array<Double8, kMaxCoeffs> y;
    const double v0 = grid.edges[index(row)];
    const double half_v = (grid.edges[index(row + 1)] - v0) / 2;
    for (int c = 0; c < stride; c += kDoubleLanes) {
        std::array<Double8, kMaxCoeffs> total{};
        for (int j = 0; j < rule.count(); ++j) {
            const double v = v0 + half_v * (1 + rule.nodes[index(j)]);
            for (int i = 0; i < rule.count(); ++i) {
                Double8 x{}, z{}, weight{};
                for (int lane = 0; lane < kDoubleLanes && c + lane < grid.size; ++lane) {
                    const double u0 = grid.edges[index(c + lane)];
                    const double half_u = (grid.edges[index(c + lane + 1)] - u0) / 2;
                    const double u = u0 + half_u * (1 + rule.nodes[index(i)]);
                    const double inverse = 1 / std::sqrt(1 + u * u + v * v);
                    x[lane] = u * inverse;
                    z[lane] = inverse;
                    weight[lane] = half_u * half_v * rule.weights[index(i)] *
                                   rule.weights[index(j)] * inverse * inverse * inverse;
                }
                const Double8 y_axis = z * v;
                sh::evaluate(bands, x, y_axis, z, y.data());
                for (int k = 0; k < coeffs; ++k) total[index(k)] += weight * y[index(k)];
            }
        }
        for (int k = 0; k < coeffs; ++k) store(total[index(k)], out.data() + k * stride + c);
    }
}

/// The columns of one row, channel by channel, in double, padded with zeros to whole vectors.
template <int kChannels>
void unpack_row(const Vec3* row, int width, int stride, double* planes) {
    for (int c = 0; c < width; ++c) {
        for (int k = 0; k < kChannels; ++k) {
            planes[k * stride + c] = static_cast<double>(row[c][k]);
        }
    }
}

/// The six faces share the integrals of the basis in their own frame, so these are found once; a
/// matrix a band then brings each face home.
template <int kChannels>
std::vector<DVec3> project_cube(int bands, const CubeGrid& grid, const Vec3* radiance) {
    constexpr int kPlanes = kChannels * cube::kFaceCount;
    const int coeffs = sh::coeff_count(bands);
    const int stride = padded(grid.size);
    double widest = 0;
    for (int i = 0; i < grid.size; ++i) {
        widest = std::max(widest, grid.edges[index(i + 1)] - grid.edges[index(i)]);
    }
    // Singular at u^2 + v^2 = -1, with a power that grows with the band.
    const Quadrature rule =
        gauss_legendre(gauss_count_for_singularity(1.0, widest / 2) + (widest > 0.1 ? bands : 1));

    const std::size_t block_size = index(cube::kFaceCount * coeffs);
    std::vector<DVec3> partial(index(grid.size) * block_size, DVec3{0});
    parallel_for(index(grid.size), [&](std::size_t row) {
        std::vector<double> planes(index(kPlanes * stride));
        std::vector<double> basis(index(coeffs * stride));
        const std::size_t n = index(grid.size);
        for (int face = 0; face < cube::kFaceCount; ++face) {
            unpack_row<kChannels>(radiance + (index(face) * n + row) * n, grid.size, stride,
                                  planes.data() + kChannels * face * stride);
        }
        face_row_integrals(bands, grid, static_cast<int>(row), rule, basis);
        for (int k = 0; k < coeffs; ++k) {
            std::array<Double8, kPlanes> total{};
            for (int c = 0; c < stride; c += kDoubleLanes) {
                const auto y = load<Double8>(basis.data() + k * stride + c);
                for (int p = 0; p < kPlanes; ++p) {
                    total[index(p)] += y * load<Double8>(planes.data() + p * stride + c);
                }
            }
            for (int face = 0; face < cube::kFaceCount; ++face) {
                DVec3& out = partial[row * block_size + index(face * coeffs + k)];
                for (int channel = 0; channel < kChannels; ++channel) {
                    out[channel] = sum(total[index(kChannels * face + channel)]);
                }
            }
        }
    });
    std::vector<DVec3> by_face(block_size, DVec3{0});
    for (std::size_t i = 0; i < partial.size(); ++i) by_face[i % block_size] += partial[i];

    std::vector<DVec3> world(index(coeffs), DVec3{0});
    for (int face = 0; face < cube::kFaceCount; ++face) {
        const auto f = static_cast<cube::Face>(face);
        const auto column = [](const std::array<double, 3>& p) { return DVec3{p[0], p[1], p[2]}; };
        const DVec3 outwards = column(cube::point(f, 0.0, 0.0));
        const DVec3 u = column(cube::point(f, 1.0, 0.0)) - outwards;
        const DVec3 v = column(cube::point(f, 0.0, 1.0)) - outwards;
        const auto first = by_face.begin() + face * coeffs;
        add_from_frame(bands, DMat3{u, v, outwards}, {first, first + coeffs}, world);
    }
    return world;
}

template <int kChannels>
std::vector<DVec3> project(int bands, const Environment& environment) {
    const Vec3* radiance = environment.radiance.data();
    if (const auto* lat_long = std::get_if<LatLongGrid>(&environment.grid)) {
        std::vector<DVec3> world(index(sh::coeff_count(bands)), DVec3{0});
        const DMat3 pole_up{DVec3{1, 0, 0}, DVec3{0, 0, 1}, DVec3{0, 1, 0}};
        add_from_frame(bands, pole_up, project_lat_long<kChannels>(bands, *lat_long, radiance),
                       world);
        return world;
    }
    return project_cube<kChannels>(bands, std::get<CubeGrid>(environment.grid), radiance);
}

}  // namespace

ShLighting project_sh(const ShLightingJob& job, const Environment& environment) {
    assert(job.bands >= 1 && job.bands <= sh::kMaxBundleBands);
    assert(job.channels == 1 || job.channels == 3);
    if (job.channels == 3) return {job.bands, project<3>(job.bands, environment)};
    ShLighting grey{job.bands, project<1>(job.bands, environment)};
    for (DVec3& c : grey.coeffs) c = DVec3{c.r};
    return grey;
}

}  // namespace envbake
