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
#include <cstddef>
#include <numbers>

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

/// The columns of one row, channel by channel, in double, padded with zeros to whole vectors.
void unpack_row(const Vec3* row, int width, int stride, double* planes) {
    for (int c = 0; c < width; ++c) {
        for (int k = 0; k < 3; ++k) {
            planes[k * stride + c] = static_cast<double>(row[c][k]);
        }
    }
}

// ---- latitude-longitude ------------------------------------------------------------------------

/// Integrals of cos m phi and sin m phi over every column: [m][column], padded with zeros.
struct ColumnIntegrals {
    int stride = 0;
    std::vector<double> cosine, sine;

    ColumnIntegrals(const LatLongGrid& grid, int bands)
        : stride(padded(grid.width)), cosine(index(stride * bands)), sine(index(stride * bands)) {
        for (int c = 0; c < grid.width; ++c) {
            const double half = (grid.phi_edges[index(c + 1)] - grid.phi_edges[index(c)]) / 2;
            const double middle = grid.phi_edges[index(c)] + half;
            for (int m = 0; m < bands; ++m) {
                const double extent = m == 0 ? 2 * half : 2 * std::sin(m * half) / m;
                cosine[index(m * stride + c)] = extent * std::cos(m * middle);
                sine[index(m * stride + c)] = extent * std::sin(m * middle);
            }
        }
    }
};

/// One row's Fourier coefficients, for each m and channel.
struct RowSpectrum {
    std::array<DVec3, sh::kMaxBundleBands> cosine, sine;
};

RowSpectrum row_spectrum(int bands, const ColumnIntegrals& columns, const double* planes) {
    RowSpectrum s;
    const int stride = columns.stride;
    for (int m = 0; m < bands; ++m) {
        const double* cosine = columns.cosine.data() + m * stride;
        const double* sine = columns.sine.data() + m * stride;
        Double8 rc{}, gc{}, bc{}, rs{}, gs{}, bs{};
        for (int c = 0; c < stride; c += kDoubleLanes) {
            const auto r = load<Double8>(planes + c);
            const auto g = load<Double8>(planes + stride + c);
            const auto b = load<Double8>(planes + 2 * stride + c);
            const auto cos_m = load<Double8>(cosine + c);
            const auto sin_m = load<Double8>(sine + c);
            rc += r * cos_m;
            gc += g * cos_m;
            bc += b * cos_m;
            rs += r * sin_m;
            gs += g * sin_m;
            bs += b * sin_m;
        }
        s.cosine[index(m)] = {sum(rc), sum(gc), sum(bc)};
        s.sine[index(m)] = {sum(rs), sum(gs), sum(bs)};
    }
    return s;
}

/// The integral over one row's polar angles of Y_lm sin theta without its azimuth factor, slot
/// index(l, m), m >= 0. With phi = 0 the basis is its own polar factor.
void row_integrals(int bands, double theta0, double theta1, const Quadrature& rule, double* out) {
    std::array<double, kMaxCoeffs> y;
    std::fill_n(out, sh::coeff_count(bands), 0.0);
    const double half = (theta1 - theta0) / 2;
    for (int i = 0; i < rule.count(); ++i) {
        const double theta = theta0 + half * (1 + rule.nodes[index(i)]);
        const double sin_theta = std::sin(theta);
        sh::evaluate(bands, sin_theta, 0.0, std::cos(theta), y.data());
        const double weight = half * rule.weights[index(i)] * sin_theta;
        for (int k = 0; k < sh::coeff_count(bands); ++k) out[k] += weight * y[index(k)];
    }
}

/// Projects in the frame (x, z, y): its pole is +Y and its azimuth is the grid's phi.
std::vector<DVec3> project_lat_long(int bands, const LatLongGrid& grid, const Vec3* radiance) {
    constexpr int kRowsPerBlock = 8;
    const int coeffs = sh::coeff_count(bands);
    const ColumnIntegrals columns(grid, bands);
    double tallest = 0;
    for (int r = 0; r < grid.height; ++r) {
        tallest = std::max(tallest, grid.theta_edges[index(r + 1)] - grid.theta_edges[index(r)]);
    }
    const Quadrature rule = gauss_legendre(gauss_count_for_frequency(bands, tallest));

    const int blocks = (grid.height + kRowsPerBlock - 1) / kRowsPerBlock;
    std::vector<DVec3> partial(index(blocks) * index(coeffs), DVec3{0});
    parallel_for(index(blocks), [&](std::size_t block) {
        std::vector<double> planes(index(3 * columns.stride));
        std::array<double, kMaxCoeffs> polar;
        DVec3* out = partial.data() + block * index(coeffs);
        const int first = static_cast<int>(block) * kRowsPerBlock;
        for (int r = first; r < std::min(first + kRowsPerBlock, grid.height); ++r) {
            unpack_row(radiance + index(r) * index(grid.width), grid.width, columns.stride,
                       planes.data());
            const RowSpectrum spectrum = row_spectrum(bands, columns, planes.data());
            row_integrals(bands, grid.theta_edges[index(r)], grid.theta_edges[index(r + 1)], rule,
                          polar.data());
            for (int l = 0; l < bands; ++l) {
                for (int m = 0; m <= l; ++m) {
                    const double p = polar[index(sh::index(l, m))];
                    out[sh::index(l, m)] += p * spectrum.cosine[index(m)];
                    if (m > 0) out[sh::index(l, -m)] += p * spectrum.sine[index(m)];
                }
            }
        }
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

/// The six faces share the integrals of the basis in their own frame, so these are found once; a
/// matrix a band then brings each face home.
std::vector<DVec3> project_cube(int bands, const CubeGrid& grid, const Vec3* radiance) {
    constexpr int kPlanes = 3 * cube::kFaceCount;
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
            unpack_row(radiance + (index(face) * n + row) * n, grid.size, stride,
                       planes.data() + 3 * face * stride);
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
                const Double8* t = total.data() + 3 * face;
                partial[row * block_size + index(face * coeffs + k)] = {sum(t[0]), sum(t[1]),
                                                                        sum(t[2])};
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

}  // namespace

ShLighting project_sh(const ShLightingJob& job, const Environment& environment) {
    assert(job.bands >= 1 && job.bands <= sh::kMaxBundleBands);
    ShLighting result{job.bands, {}};
    const Vec3* radiance = environment.radiance.data();
    if (const auto* lat_long = std::get_if<LatLongGrid>(&environment.grid)) {
        result.coeffs.assign(index(sh::coeff_count(job.bands)), DVec3{0});
        const DMat3 pole_up{DVec3{1, 0, 0}, DVec3{0, 0, 1}, DVec3{0, 1, 0}};
        add_from_frame(job.bands, pole_up, project_lat_long(job.bands, *lat_long, radiance),
                       result.coeffs);
    } else {
        result.coeffs = project_cube(job.bands, std::get<CubeGrid>(environment.grid), radiance);
    }
    return result;
}

}  // namespace envbake
