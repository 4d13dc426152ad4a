// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/shade.h"

#include "envbake/runtime/cube.h"
#include "envbake/runtime/sh.h"
#include "tests/unit/runtime/bundle_builder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

namespace envbake::runtime {
namespace {

using std::numbers::pi;
using DVec3 = std::array<double, 3>;

/// Reproducible numbers in [0, 1).
class Random {
  public:
    double next() {
        state_ = state_ * 6364136223846793005u + 1442695040888963407u;
        return static_cast<double>(state_ >> 11) * 0x1p-53;
    }
    DVec3 direction() {
        const double z = 2 * next() - 1, phi = 2 * pi * next(), s = std::sqrt(1 - z * z);
        return {s * std::cos(phi), s * std::sin(phi), z};
    }

  private:
    std::uint64_t state_ = 42;
};

double dot(const DVec3& a, const DVec3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Vec3 narrow(const DVec3& d) {
    return {static_cast<float>(d[0]), static_cast<float>(d[1]), static_cast<float>(d[2])};
}
DVec3 normalized(const DVec3& d) {
    const double length = std::sqrt(dot(d, d));
    return {d[0] / length, d[1] / length, d[2] / length};
}

// ---- Diffuse

/// Y_lm from the standard library's Legendre functions, which carry no Condon-Shortley phase.
double basis(int l, int m, const DVec3& w) {
    const unsigned ul = static_cast<unsigned>(l), um = static_cast<unsigned>(std::abs(m));
    double ratio = 1;  // (l - m)! / (l + m)!
    for (int k = l - std::abs(m) + 1; k <= l + std::abs(m); ++k) ratio /= k;
    const double scale = std::sqrt((2 * l + 1) / (4 * pi) * ratio);
    const double legendre = std::assoc_legendre(ul, um, w[2]);
    const double phi = std::atan2(w[1], w[0]);
    if (m == 0) return scale * legendre;
    return std::sqrt(2.0) * scale * legendre * (m > 0 ? std::cos(m * phi) : std::sin(-m * phi));
}

/// Integral of max(0, cos theta) P_l(cos theta) over the sphere, by Simpson's rule.
double cosine_coefficient(int l) {
    constexpr int kSteps = 2000;
    double sum = 0;
    for (int i = 0; i <= kSteps; ++i) {
        const double t = static_cast<double>(i) / kSteps;
        const double weight = i == 0 || i == kSteps ? 1 : (i % 2 == 1 ? 4 : 2);
        sum += weight * t * std::legendre(static_cast<unsigned>(l), t);
    }
    return 2 * pi * sum / (3 * kSteps);
}

ShLightingView view(const std::vector<float>& coeffs, int bands) {
    return {bands, std::span<const float>(coeffs)};
}

TEST(Irradiance, OfConstantRadianceIsPi) {
    for (int bands = 1; bands <= 10; ++bands) {
        std::vector<float> coeffs(static_cast<std::size_t>(3 * bands * bands));
        for (std::size_t c = 0; c < 3; ++c) {
            coeffs[c] = static_cast<float>(2 * std::sqrt(pi) * static_cast<double>(c + 1));
        }
        const Rgb e = irradiance(view(coeffs, bands), {0.6f, 0, -0.8f});
        for (std::size_t c = 0; c < 3; ++c) {
            EXPECT_NEAR(e[c], pi * static_cast<double>(c + 1), 2e-6);
        }
    }
}

TEST(Irradiance, OfEveryHarmonicAlone) {
    Random random;
    for (int l = 0; l < 10; ++l) {
        for (int m = -l; m <= l; ++m) {
            std::vector<float> coeffs(300);
            coeffs[static_cast<std::size_t>(3 * (l * l + l + m) + 1)] = 2;
            const DVec3 n = random.direction();
            const Rgb e = irradiance(view(coeffs, 10), narrow(n));
            EXPECT_EQ(e[0], 0);
            EXPECT_NEAR(e[1], 2 * cosine_coefficient(l) * basis(l, m, n), 2e-6) << l << ' ' << m;
        }
    }
}

TEST(DiffuseExit, UnoccludedWhiteUnderConstantLightIsOne) {
    // T_00 = 1/pi * pi * Y_00; the other bands meet no light.
    std::vector<float> row(25, 0.3f), coeffs(75);
    row[0] = static_cast<float>(0.5 / std::sqrt(pi));
    for (std::size_t c = 0; c < 3; ++c) coeffs[c] = static_cast<float>(2 * std::sqrt(pi));
    const Rgb exit = diffuse_exit(row, view(coeffs, 5));
    for (const float value : exit) EXPECT_NEAR(value, 1, 1e-6);
}

TEST(DiffuseExit, IsTheSumForEveryLayout) {
    Random random;
    for (const int channels : {1, 3}) {
        for (const bool is_half : {false, true}) {
            for (const int bands : {1, 3, 5}) {
                const auto coeff_count = static_cast<std::size_t>(bands * bands);
                constexpr std::size_t kVertices = 5;
                const std::size_t row = coeff_count * static_cast<std::size_t>(channels);
                std::vector<float> values(kVertices * row);
                std::vector<std::uint16_t> halves(values.size());
                for (std::size_t i = 0; i < values.size(); ++i) {
                    halves[i] = float_to_half(static_cast<float>(random.next() - 0.5));
                    values[i] = half_to_float(halves[i]);
                }
                TransportView transport;
                transport.vertex_count = kVertices;
                transport.bands = bands;
                transport.channels = channels;
                transport.values.data = is_half ? static_cast<const void*>(halves.data())
                                                : static_cast<const void*>(values.data());
                transport.values.count = values.size();
                transport.values.is_half = is_half;

                // Lighting of 4 bands: more than some of the transport, fewer than the rest.
                std::vector<float> coeffs(48);
                for (float& c : coeffs) c = static_cast<float>(random.next() * 3 - 1);
                std::vector<Rgb> out(4, Rgb{9, 9, 9});
                diffuse_exit(transport, view(coeffs, 4), 2, out);
                for (std::size_t k = 0; k < 3; ++k) {
                    for (std::size_t c = 0; c < 3; ++c) {
                        double sum = 0;
                        for (std::size_t i = 0; i < std::min<std::size_t>(coeff_count, 16); ++i) {
                            const std::size_t slot = channels == 3 ? 3 * i + c : i;
                            sum += static_cast<double>(values[(2 + k) * row + slot]) *
                                   static_cast<double>(coeffs[3 * i + c]);
                        }
                        EXPECT_NEAR(out[k][c], sum, 3e-6);
                    }
                }
                EXPECT_EQ(out[3], (Rgb{}));  // past the last vertex
                std::vector<float> emitted(3 * kVertices);
                for (std::size_t i = 0; i < emitted.size(); ++i) emitted[i] = 1 + float(i);
                const std::vector<Rgb> reflected = out;
                transport.emitted = {emitted.data(), emitted.size(), false};
                diffuse_exit(transport, view(coeffs, 4), 2, out);
                for (std::size_t k = 0; k < 3; ++k)
                    for (std::size_t c = 0; c < 3; ++c)
                        EXPECT_NEAR(out[k][c], reflected[k][c] + emitted[3 * (2 + k) + c], 1e-5);
                EXPECT_EQ(out[3], (Rgb{}));
                transport.emitted = {};
                diffuse_exit(transport, view(coeffs, 4),
                             std::numeric_limits<std::uint64_t>::max() - 1, out);
                EXPECT_EQ(out[0], (Rgb{}));
                EXPECT_EQ(out[3], (Rgb{}));
            }
        }
    }
}

// ---- Mips

/// One level in the test's own hands.
struct Faces {
    explicit Faces(int face_size)
        : size(face_size), texels(static_cast<std::size_t>(18 * size * size)) {}

    std::size_t index(int face, int row, int column) const {
        return static_cast<std::size_t>(3 * ((face * size + row) * size + column));
    }
    template <class F>
    void fill(F value) {
        for (int face = 0; face < 6; ++face) {
            for (int row = 0; row < size; ++row) {
                for (int column = 0; column < size; ++column) {
                    for (std::size_t c = 0; c < 3; ++c) {
                        texels[index(face, row, column) + c] =
                            static_cast<float>(value(centre(face, row, column), c));
                    }
                }
            }
        }
    }
    DVec3 point(int face, double row, double column) const {
        const double u = (2 * column + 1) / size - 1, v = (2 * row + 1) / size - 1;
        switch (face) {
            case 0:
                return {1, -v, -u};
            case 1:
                return {-1, -v, u};
            case 2:
                return {u, 1, v};
            case 3:
                return {u, -1, -v};
            case 4:
                return {u, -v, 1};
            default:
                return {-u, -v, -1};
        }
    }
    DVec3 centre(int face, int row, int column) const {
        return normalized(point(face, row, column));
    }

    MipsView view() const {
        MipsView mips;
        mips.level_count = 1;
        mips.levels[0] = {size, size, 3, {texels.data(), texels.size(), false}};
        return mips;
    }

    int size;
    std::vector<float> texels;
};

/// Seamless bilinear filtering as the header describes it, in double and by search: the texel
/// beyond an edge is the one of another face that is nearest to the place where it would be; at a
/// corner the three texels nearest to the corner are averaged.
double reference_sample(const Faces& faces, const DVec3& d, std::size_t channel) {
    int face = 0;
    double x = 0, y = 0;
    const DVec3 normals[6] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    for (int k = 0; k < 6; ++k) {
        if (dot(d, normals[k]) > dot(d, normals[face])) face = k;
    }
    {  // (column, row) by solving point(face, row, column) ~ d along the two axes of the face
        const DVec3 origin = faces.point(face, 0, 0), right = faces.point(face, 0, 1),
                    down = faces.point(face, 1, 0);
        const double depth = dot(d, normals[face]);
        double cross = 0, square = 0, cross_down = 0, square_down = 0;
        for (std::size_t a = 0; a < 3; ++a) {
            cross += (d[a] / depth - origin[a]) * (right[a] - origin[a]);
            square += (right[a] - origin[a]) * (right[a] - origin[a]);
            cross_down += (d[a] / depth - origin[a]) * (down[a] - origin[a]);
            square_down += (down[a] - origin[a]) * (down[a] - origin[a]);
        }
        x = cross / square;
        y = cross_down / square_down;
    }
    const int size = faces.size;
    const auto nearest_first = [&](const DVec3& place, int except) {
        std::vector<std::pair<double, std::size_t>> order;
        for (int f = 0; f < 6; ++f) {
            if (f == except) continue;
            for (int row = 0; row < size; ++row) {
                for (int column = 0; column < size; ++column) {
                    order.emplace_back(-dot(normalized(place), faces.centre(f, row, column)),
                                       faces.index(f, row, column));
                }
            }
        }
        std::sort(order.begin(), order.end());
        return order;
    };
    const auto texel = [&](int row, int column) -> double {
        const bool row_inside = row >= 0 && row < size,
                   column_inside = column >= 0 && column < size;
        if (row_inside && column_inside) {
            return static_cast<double>(faces.texels[faces.index(face, row, column) + channel]);
        }
        if (row_inside || column_inside) {
            const auto order = nearest_first(faces.point(face, row, column), face);
            return static_cast<double>(faces.texels[order[0].second + channel]);
        }
        const auto order = nearest_first(
            faces.point(face, row < 0 ? -0.5 : size - 0.5, column < 0 ? -0.5 : size - 0.5), -1);
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            sum += static_cast<double>(faces.texels[order[k].second + channel]);
        }
        return sum / 3;
    };
    const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
    const double fx = x - column, fy = y - row;
    return (1 - fy) * ((1 - fx) * texel(row, column) + fx * texel(row, column + 1)) +
           fy * ((1 - fx) * texel(row + 1, column) + fx * texel(row + 1, column + 1));
}

TEST(SampleMips, MatchesSeamlessFilteringBySearch) {
    Random random;
    for (const int size : {1, 2, 3, 8}) {
        Faces faces(size);
        faces.fill([&](const DVec3&, std::size_t) { return random.next(); });
        for (int i = 0; i < 600; ++i) {
            DVec3 d = random.direction();
            // Two thirds close to an edge, or to a corner.
            const double limit = std::max({std::abs(d[0]), std::abs(d[1]), std::abs(d[2])});
            const std::size_t axes = static_cast<std::size_t>(i % 3);
            for (std::size_t a = 0; a < axes; ++a) {
                d[a] = std::copysign(limit * (1 - 0.2 * random.next()), d[a]);
            }
            const Rgb found = sample_mips(faces.view(), narrow(d), 0);
            for (std::size_t c = 0; c < 3; ++c) {
                // The direction in float is off by 6e-8, and so is x, times half the size.
                ASSERT_NEAR(found[c], reference_sample(faces, d, c), 2e-6 * size)
                    << size << ": " << d[0] << ' ' << d[1] << ' ' << d[2];
            }
        }
    }
}

TEST(SampleMips, ContinuousOverAllEdgesAndCorners) {
    Random random;
    for (const int size : {1, 2, 5, 16}) {
        Faces faces(size);
        // Noise: a texel taken from the wrong place is a jump of the order of 1.
        faces.fill([&](const DVec3&, std::size_t) { return random.next(); });
        constexpr double kStep = 1e-4;
        const double steepest = 2.0 * size * kStep;  // a texel's step of 1 over 2 / size of u
        int places = 0;
        for (int a = 0; a < 3; ++a) {
            for (int signs = 0; signs < 4; ++signs) {
                for (double t = -1; t <= 1.001; t += 0.05) {
                    const auto i = static_cast<std::size_t>(a), j = (i + 1) % 3, k = (i + 2) % 3;
                    DVec3 edge{};
                    edge[i] = t;  // the ends of the edge are corners
                    edge[j] = (signs & 1) != 0 ? 1 : -1;
                    edge[k] = (signs & 2) != 0 ? 1 : -1;
                    double low[3] = {9, 9, 9}, high[3] = {-9, -9, -9};
                    for (int around = 0; around < 8; ++around) {
                        DVec3 d = edge;
                        for (std::size_t axis = 0; axis < 3; ++axis) {
                            d[axis] += (around >> axis & 1) != 0 ? kStep : -kStep;
                        }
                        const Rgb value = sample_mips(faces.view(), narrow(d), 0);
                        for (std::size_t c = 0; c < 3; ++c) {
                            low[c] = std::min(low[c], static_cast<double>(value[c]));
                            high[c] = std::max(high[c], static_cast<double>(value[c]));
                        }
                    }
                    for (std::size_t c = 0; c < 3; ++c) {
                        ASSERT_LT(high[c] - low[c], 4 * steepest) << size << ' ' << a << ' ' << t;
                    }
                    ++places;
                }
            }
        }
        EXPECT_EQ(places, 12 * 41);
    }
}

TEST(SampleMips, FollowsASmoothFunctionOfDirection) {
    Faces faces(64);
    const DVec3 gradient{0.3, -0.5, 0.2};
    faces.fill([&](const DVec3& d, std::size_t c) {
        return 1 + static_cast<double>(c + 1) * dot(d, gradient);
    });
    Random random;
    double worst = 0;
    for (int i = 0; i < 3000; ++i) {
        const DVec3 d = random.direction();
        const Rgb value = sample_mips(faces.view(), narrow(d), 0);
        for (std::size_t c = 0; c < 3; ++c) {
            const double expected = 1 + static_cast<double>(c + 1) * dot(d, gradient);
            worst = std::max(worst, std::abs(static_cast<double>(value[c]) - expected));
        }
    }
    // Inside a face: curvature h^2 / 8 of two directions. Across an edge the spacing bends: h^2
    // too.
    EXPECT_LT(worst, 5e-3);
}

TEST(SampleMips, ConstantStaysConstantAtAnySize) {
    for (const int size : {1, 2, 7}) {
        Faces faces(size);
        faces.fill([](const DVec3&, std::size_t c) { return 0.1 + static_cast<double>(c); });
        Random random;
        for (int i = 0; i < 500; ++i) {
            const Rgb value = sample_mips(faces.view(), narrow(random.direction()), 0.7f);
            for (std::size_t c = 0; c < 3; ++c) {
                EXPECT_EQ(value[c], static_cast<float>(0.1 + static_cast<double>(c)));
            }
        }
    }
}

TEST(SampleMips, LinearBetweenLevelsAndClampedToThosePresent) {
    // Five levels, of which 1 to 3 are there; level k is the constant 10 k.
    std::vector<Faces> faces;
    for (int k = 0; k < 5; ++k) {
        faces.emplace_back(std::max(1, 4 >> k));
        faces.back().fill([&](const DVec3&, std::size_t) { return 10.0 * k; });
    }
    MipsView mips;
    mips.level_count = 5;
    mips.first = 1;
    mips.last = 3;
    for (std::size_t k = 1; k <= 3; ++k) mips.levels[k] = faces[k].view().levels[0];
    const auto at = [&](double r) {
        return static_cast<double>(
            sample_mips(mips, {0.1f, 0.2f, -0.9f}, static_cast<float>(r))[2]);
    };
    EXPECT_NEAR(at(0.25), 10, 1e-5);
    EXPECT_NEAR(at(0.4), 16, 1e-5);
    EXPECT_NEAR(at(0.75), 30, 1e-5);
    EXPECT_NEAR(at(0), 10, 1e-5);
    EXPECT_NEAR(at(1), 30, 1e-5);
    EXPECT_NEAR(at(-3), 10, 1e-5);
    EXPECT_NEAR(at(1e9), 30, 1e-5);
    EXPECT_NEAR(at(std::nan("")), 10, 1e-5);
}

TEST(SampleMips, OneChannelIsThreeEqualOnes) {
    Random random;
    Faces faces(5);
    faces.fill([&](const DVec3& d, std::size_t) { return 2 + d[0] + 0.3 * d[1]; });
    std::vector<float> grey;
    for (std::size_t i = 0; i < faces.texels.size(); i += 3) grey.push_back(faces.texels[i]);
    MipsView mips = faces.view();
    mips.levels[0].channels = 1;
    mips.levels[0].texels = {grey.data(), grey.size(), false};
    for (int i = 0; i < 200; ++i) {
        const Vec3 d = narrow(random.direction());
        EXPECT_EQ(sample_mips(mips, d, 0), sample_mips(faces.view(), d, 0));
    }
}

/// A lat-long image of 4 s x 2 s texels of one channel.
struct LatLongImage {
    template <class F>
    LatLongImage(int s, F value) : width(4 * s), height(2 * s) {
        for (int row = 0; row < height; ++row) {
            for (int column = 0; column < width; ++column) {
                const double theta = kPi * (row + 0.5) / height;
                const double phi = 2 * kPi * ((column + 0.5) / width - 0.5);
                texels.push_back(
                    static_cast<float>(value(DVec3{std::sin(theta) * std::cos(phi), std::cos(theta),
                                                   std::sin(theta) * std::sin(phi)})));
            }
        }
    }
    MipsView view() const {
        MipsView mips;
        mips.level_count = 1;
        mips.layout = MipLayout::LatLong;
        mips.levels[0] = {width, height, 1, {texels.data(), texels.size(), false}};
        return mips;
    }
    static constexpr double kPi = 3.14159265358979323846;
    int width, height;
    std::vector<float> texels;
};

TEST(SampleMips, LatLongFollowsASmoothFunctionOverSeamAndPoles) {
    const DVec3 gradient{0.3, -0.5, 0.2};
    const LatLongImage image(64, [&](const DVec3& d) { return 1 + dot(d, gradient); });
    Random random;
    double worst = 0;
    for (int i = 0; i < 6000; ++i) {
        DVec3 d = random.direction();
        if (i % 3 == 1) d = normalized({-1, d[1], 1e-3 * d[2]});           // the seam
        if (i % 3 == 2) d = normalized({0.01 * d[0], d[1], 0.01 * d[2]});  // the poles
        const Rgb value = sample_mips(image.view(), narrow(d), 0);
        EXPECT_EQ(value[0], value[2]);
        worst = std::max(worst, std::abs(static_cast<double>(value[1]) - 1 - dot(d, gradient)));
    }
    EXPECT_LT(worst, 2e-4);  // curvature h^2 / 8, h = pi / 128
}

TEST(SampleMips, LatLongTexelCentresAreExact) {
    Random random;
    const LatLongImage image(3, [&](const DVec3&) { return random.next(); });
    for (int row = 0; row < image.height; ++row) {
        for (int column = 0; column < image.width; ++column) {
            const double theta = LatLongImage::kPi * (row + 0.5) / image.height;
            const double phi = 2 * LatLongImage::kPi * ((column + 0.5) / image.width - 0.5);
            const DVec3 d{std::sin(theta) * std::cos(phi), std::cos(theta),
                          std::sin(theta) * std::sin(phi)};
            EXPECT_NEAR(sample_mips(image.view(), narrow(d), 0)[0],
                        image.texels[static_cast<std::size_t>(row * image.width + column)], 1e-5);
        }
    }
}

TEST(SampleMips, SurvivesAnyDirection) {
    Random random;
    Faces faces(3);
    faces.fill([&](const DVec3&, std::size_t) { return random.next(); });
    const LatLongImage image(1, [&](const DVec3&) { return random.next(); });
    constexpr float kInf = std::numeric_limits<float>::infinity();
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    for (const float x : {0.0f, 1.0f, -1.0f, kInf, kNan, 1e-45f, 3e38f}) {
        for (const float y : {0.0f, 1.0f, -kInf, kNan}) {
            for (const float z : {0.0f, -1.0f, kInf, kNan}) {
                for (const MipsView& mips : {faces.view(), image.view()}) {
                    for (const float value : sample_mips(mips, {x, y, z}, 0.5f)) {
                        EXPECT_GE(value, 0);
                        EXPECT_LE(value, 1);
                    }
                }
            }
        }
    }
}

// ---- The table

TEST(LookUpBrdf, BilinearOverItsAxes) {
    Random random;
    for (const TableAxes axes : {TableAxes::RootsEndPoints, TableAxes::LinearCentres}) {
        constexpr int kRows = 5, kColumns = 7;
        std::vector<float> texels(2 * kRows * kColumns);
        for (float& t : texels) t = static_cast<float>(random.next());
        BrdfTableView table;
        table.rows = kRows;
        table.columns = kColumns;
        table.axes = axes;
        table.texels = {texels.data(), texels.size(), false};
        const bool roots = axes == TableAxes::RootsEndPoints;
        for (int i = 0; i < 1000; ++i) {
            const double mu = random.next(), r = i == 0 ? 0 : (i == 1 ? 1 : random.next());
            // Tent weights over all texels, the outermost reaching to the border.
            double expected[2] = {0, 0};
            for (int row = 0; row < kRows; ++row) {
                for (int column = 0; column < kColumns; ++column) {
                    const auto tent = [&](double value, double power, int k, int size) {
                        double p = roots ? std::pow(value, power) * (size - 1) : value * size - 0.5;
                        p = std::min(std::max(p, 0.0), size - 1.0);
                        return std::max(0.0, 1 - std::abs(p - k));
                    };
                    for (std::size_t c = 0; c < 2; ++c) {
                        const std::size_t slot =
                            static_cast<std::size_t>(2 * (row * kColumns + column)) + c;
                        expected[c] += tent(mu, 0.25, column, kColumns) * tent(r, 0.5, row, kRows) *
                                       static_cast<double>(texels[slot]);
                    }
                }
            }
            const SpecularAlbedo found =
                lookup_brdf(table, static_cast<float>(mu), static_cast<float>(r));
            EXPECT_NEAR(found.a, expected[0], 3e-6);
            EXPECT_NEAR(found.b, expected[1], 3e-6);
        }
        const SpecularAlbedo corner = lookup_brdf(table, -5, 7);
        EXPECT_FLOAT_EQ(corner.a, texels[2 * (kRows - 1) * kColumns]);
        EXPECT_GE(lookup_brdf(table, std::nanf(""), std::nanf("")).a, 0);
    }
}

// ---- A dominant light

constexpr DominantLight kOverhead{.direction = {0, 1, 0},
                                  .irradiance = {3, 2, 1},
                                  .angular_radius = 0,
                                  .solid_angle = 1e-4f,
                                  .share = 0.5f};

TEST(ReflectLight, DiffuseIsLambertsLaw) {
    const Surface paper{.normal = {0.6f, 0.8f, 0}, .albedo = {1, 0.5f, 0}};
    const Rgb L = reflect_light(kOverhead, paper, {0.6f, 0.8f, 0});
    EXPECT_NEAR(L[0], 3 * 0.8 / pi, 1e-6);
    EXPECT_NEAR(L[1], 2 * 0.8 * 0.5 / pi, 1e-6);
    EXPECT_EQ(L[2], 0);
    const Surface turned_away{.normal = {0, -1, 0}, .albedo = {1, 1, 1}, .r0 = {1, 1, 1}};
    EXPECT_EQ(reflect_light(kOverhead, turned_away, {0, -1, 0}), (Rgb{}));
}

// n = v = l: D = 1 / (pi alpha^2) for both lobes, V = 1 / 4, F = R0.
TEST(ReflectLight, HighlightAtNormalIncidence) {
    for (const Distribution d : {Distribution::Ggx, Distribution::Beckmann}) {
        Surface metal{.normal = {0, 1, 0}, .r0 = {1, 0.5f, 0}, .perceptual_roughness = 0.5f};
        metal.distribution = d;
        const Rgb L = reflect_light(kOverhead, metal, {0, 1, 0});
        EXPECT_NEAR(L[0], 3 / (4 * pi * 0.0625), 1e-5);
        EXPECT_NEAR(L[1], 2 * 0.5 / (4 * pi * 0.0625), 1e-5);
        EXPECT_EQ(L[2], 0);
        // A light of radius 1/2 widens the lobe of a mirror to alpha = 1/4, the same again.
        DominantLight wide = kOverhead;
        wide.angular_radius = 0.5f;
        metal.perceptual_roughness = 0;
        EXPECT_NEAR(reflect_light(wide, metal, {0, 1, 0})[0], 3 / (4 * pi * 0.0625), 1e-5);
    }
}

TEST(ReflectLight, IsFiniteForAnyView) {
    const Surface mirror{.normal = {0, 1, 0}, .r0 = {1, 1, 1}, .perceptual_roughness = 0};
    for (const Vec3& v : {Vec3{0, 1, 0}, Vec3{0, -1, 0}, Vec3{1, 0, 0}, Vec3{0, 0, 0}}) {
        for (const float L : reflect_light(kOverhead, mirror, v)) {
            EXPECT_TRUE(std::isfinite(L));
            EXPECT_GE(L, 0);
        }
    }
}

// ---- Together

TEST(Specular, MirrorsTheViewAndWeighsByTheTable) {
    // The mips are the direction itself, the table is constant: the reflected direction can be read
    // from the result.
    constexpr int kSize = 64;
    Faces faces(kSize);
    faces.fill([](const DVec3& d, std::size_t c) { return 2 + d[c]; });
    test::BundleBuilder builder;
    std::vector<float> table;
    for (int i = 0; i < 4; ++i) table.insert(table.end(), {0.5f, 0.25f});
    builder.add("environment/mips/0", {6, kSize, kSize, 3}, faces.texels)
        .add("brdf/ggx", {2, 2, 2}, table)
        .metadata(R"({"environment": {"mips": {"count": 1,
                      "levels": [{"level": 0, "roughness": 0}]}},
                      "brdf": {"ggx": {"axes":"roots"}}})");
    const auto bundle = Bundle::open(builder.finish().c_str());
    ASSERT_TRUE(bundle) << to_string(bundle.error());

    Random random;
    const Rgb r0{0.04f, 0.5f, 1};
    for (int i = 0; i < 200; ++i) {
        const DVec3 n = random.direction();
        DVec3 v = random.direction();
        if (dot(n, v) < 0) v = {-v[0], -v[1], -v[2]};
        const Rgb found = specular(*bundle, narrow(n), narrow(v), 0.3f, r0);
        for (std::size_t c = 0; c < 3; ++c) {
            const double reflected = 2 * dot(n, v) * n[c] - v[c];
            const double expected = (2 + reflected) * (static_cast<double>(r0[c]) * 0.5 + 0.25);
            EXPECT_NEAR(found[c], expected, 1e-3);
        }
    }
}

}  // namespace
}  // namespace envbake::runtime
