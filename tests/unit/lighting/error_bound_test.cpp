// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/error_bound.h"

#include "baker/core/random.h"
#include "baker/lighting/mips.h"
#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_patch.h"
#include "baker/math/quadrature.h"
#include "tests/support/baked_mip.h"
#include "tests/support/environments.h"
#include "tests/support/prefilter_reference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake {
namespace {

using namespace lighting;
using std::numbers::pi;
using test::slot;

/// D of [Walter07] at n.h = cos(theta / 2), over its peak, times max(0, mu): not the baker's
/// formula.
double weight_of(bool beckmann, double alpha, const DVec3& w, const DVec3& d) {
    const DVec3 apart = w - d;
    const double u = glm::dot(apart, apart) / 2, a2 = alpha * alpha;
    if (u >= 1) return 0;
    const double sin2 = u / 2, cos2 = 1 - sin2;
    if (beckmann) return std::exp(-sin2 / cos2 / a2) / (cos2 * cos2) * (1 - u);
    const double q = cos2 + sin2 / a2;
    return 1 / (q * q) * (1 - u);
}

DVec3 direction_at(const DVec3& from, double angle, double around) {
    const DVec3 other = std::abs(from.x) < 0.9 ? DVec3{1, 0, 0} : DVec3{0, 1, 0};
    const DVec3 e1 = glm::normalize(glm::cross(from, other)), e2 = glm::cross(from, e1);
    return std::cos(angle) * from +
           std::sin(angle) * (std::cos(around) * e1 + std::sin(around) * e2);
}

/// Random parts of texels, as the walk makes them, wherever they lie and whatever looks at them.
template <template <class> class Lobe>
void expect_parts_within_bounds(bool beckmann, std::uint64_t count) {
    const Quadrature rule = gauss_legendre(20);
    double nearest = 0;  // of the bound: it is no use if it is never approached
    for (std::uint64_t i = 0; i < count; ++i) {
        RandomStream random(1, beckmann ? 2 : 1, i);
        const double alpha = std::pow(std::exp(std::log(0.02) * random.next()), 2);
        const auto lobe = Lobe<double>::of(alpha);
        const double h = std::min(0.35, lobe.core() * std::exp(std::log(0.03) * random.next()));
        const double middle = std::acos(1 - 2 * random.next());
        const bool at_pole = random.next() < 0.05;
        const double t0 = at_pole ? 0 : std::max(0.0, middle - h / 2);
        const double t1 = std::min(pi, t0 + h);
        const double width =
            h * std::exp(random.next() - 0.5) / std::max(std::sin((t0 + t1) / 2), h / 2);
        const double p0 = 6 * random.next();
        if (width > 2 * pi) continue;
        const SourceRect rect{-1, t0, t1, p0, p0 + width};
        const SourcePatch patch = make_patch(rect);
        if (patch.bend > 0.35 || patch.extent > 0.35) continue;
        const double reach = 1.05 * (glm::length(patch.half_a) + glm::length(patch.half_b)) +
                             patch.extent * patch.extent;
        const bool near_horizon = random.next() < 0.2;
        const double angle = near_horizon ? pi / 2 + (2 * random.next() - 1) * reach
                                          : 1.5 * std::exp(std::log(1e-4) * random.next());
        const DVec3 d = direction_at(glm::normalize(patch.centre), angle, 2 * pi * random.next());
        const DVec3 apart = d - patch.centre;
        const double distance2 = glm::dot(apart, apart);
        if (patch.extent * patch.extent * lobe.nearby(distance2).inverse_length2 > 0.6) continue;

        PatchMoments<double> m{};
        const double a2 = glm::dot(patch.half_a, patch.half_a);
        const double b2 = glm::dot(patch.half_b, patch.half_b);
        for (int k = 0; k < 3; ++k) {
            m.centre[k] = patch.centre[k];
            m.flux[k] = 1;
            m.half_a[k] = patch.half_a[k];
            m.half_b[k] = patch.half_b[k];
        }
        m.variance = patch.variance;
        m.slope_a = glm::dot(patch.centre, patch.half_a);
        m.slope_b = glm::dot(patch.centre, patch.half_b);
        m.bulge_a = -2 * a2 / 15;
        m.bulge_b = -2 * b2 / 15;
        m.radial = (a2 * a2 + b2 * b2) / 45;
        double value = 0;
        const double mu = glm::dot(d, patch.centre);
        if (mu > reach) {
            add_patch<false, 1>(lobe, m, d.x, d.y, d.z, &value);
        } else {
            add_patch<true, 1>(lobe, m, d.x, d.y, d.z, &value);
        }
        // The kink within a part costs Gauss points some digits: cut it into strips.
        const int strips = near_horizon ? 6 : 1;
        double exact = 0;
        for (int s = 0; s < strips * strips; ++s) {
            for (std::size_t j = 0; j < rule.nodes.size(); ++j) {
                for (std::size_t k = 0; k < rule.nodes.size(); ++k) {
                    const double x = (s / strips + (1 + rule.nodes[j]) / 2) / strips;
                    const double y = (s % strips + (1 + rule.nodes[k]) / 2) / strips;
                    exact += rule.weights[j] * rule.weights[k] / 4 / strips / strips *
                             std::sin(t0 + x * (t1 - t0)) *
                             weight_of(beckmann, alpha, rect.towards(x, y), d);
                }
            }
        }
        exact *= (t1 - t0) * width / patch.omega;
        const double bound =
            part_error_bound(lobe, patch.extent, patch.taper + patch.bend, reach, distance2, mu);
        const double error = std::abs(value - exact);
        const double rounding = 1e-12 + 1e-9 * exact;
        ASSERT_LE(error, bound + rounding)
            << "part " << i << ": alpha " << alpha << ", extent " << patch.extent << ", taper "
            << patch.taper << ", bend " << patch.bend << ", angle " << angle;
        if (bound > 100 * rounding) nearest = std::max(nearest, error / bound);
    }
    EXPECT_GT(nearest, 0.05);
}

TEST(ErrorBound, PartsOfTexelsGgx) {
    expect_parts_within_bounds<GgxWeight>(false, 4000);
}
TEST(ErrorBound, PartsOfTexelsBeckmann) {
    expect_parts_within_bounds<BeckmannWeight>(true, 4000);
}

/// Clusters of a few lights, the worst that a block of texels can hold: all at its corners, most in
/// one of them, spread or in a row.
template <template <class> class Lobe>
void expect_clusters_within_bounds(bool beckmann) {
    double nearest = 0;
    for (std::uint64_t i = 0; i < (beckmann ? 4000 : 20000); ++i) {
        RandomStream random(2, beckmann ? 2 : 1, i);
        const double alpha = std::pow(std::exp(std::log(0.05) * random.next()), 2);
        const auto lobe = Lobe<double>::of(alpha);
        const double radius = std::min(0.3, lobe.core()) * std::exp(std::log(0.02) * random.next());
        const DVec3 middle = direction_at({0, 1, 0}, pi * random.next(), 2 * pi * random.next());
        std::vector<DVec3> lights;
        std::vector<double> flux;
        const int count = 2 + static_cast<int>(5 * random.next());
        const bool skew = random.next() < 0.5;
        double total = 0;
        for (int k = 0; k < count; ++k) {
            const double at = random.next() < 0.5 ? radius : radius * std::sqrt(random.next());
            lights.push_back(direction_at(middle, at, 2 * pi * random.next()));
            flux.push_back(skew && k > 0 ? 0.05 * random.next() : random.next());
            total += flux.back();
        }
        DVec3 centre{0};
        for (int k = 0; k < count; ++k) centre += flux[slot(k)] / total * lights[slot(k)];
        // The centre is that of all channels: another one's lights shift it, and are of the block.
        double reach = 0;
        if (random.next() < 0.5) {
            const DVec3 other = direction_at(middle, radius, 2 * pi * random.next());
            centre += 0.5 * random.next() * (other - centre);
            reach = glm::length(other - centre);
        }
        ClusterMoments<double> m{};
        for (int k = 0; k < 3; ++k) m.centre[k] = centre[k];
        m.variance = (1 - glm::dot(centre, centre)) / 2;
        m.flux[0] = 1;
        ClusterSpread<double> spread{m.variance, reach, 0, 0};
        for (int k = 0; k < count; ++k) {
            const DVec3 off = lights[slot(k)] - centre;
            const double part = flux[slot(k)] / total;
            const int pairs[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
            for (int j = 0; j < 3; ++j) m.first[0][j] += part * off[j];
            for (int j = 0; j < 6; ++j) {
                m.second[0][j] += part * off[pairs[j][0]] * off[pairs[j][1]];
            }
            spread.reach = std::max(spread.reach, glm::length(off));
        }
        double squares = 0;
        for (int j = 0; j < 6; ++j) squares += (j < 3 ? 1 : 2) * m.second[0][j] * m.second[0][j];
        spread.deviation = std::sqrt(std::sqrt(squares));
        spread.offset = std::hypot(m.first[0][0], m.first[0][1], m.first[0][2]);

        const bool near_horizon = random.next() < 0.3;
        const double angle = near_horizon ? pi / 2 + 2 * (2 * random.next() - 1) * radius
                                          : 1.5 * std::exp(std::log(1e-3) * random.next());
        const DVec3 d = direction_at(glm::normalize(centre), angle, 2 * pi * random.next());
        const double mu = glm::dot(d, centre);
        double value = 0, exact = 0;
        if (mu > spread.reach) {
            add_cluster<false, 1>(lobe, m, d.x, d.y, d.z, &value);
        } else {
            add_cluster<true, 1>(lobe, m, d.x, d.y, d.z, &value);
        }
        for (int k = 0; k < count; ++k) {
            exact += flux[slot(k)] / total * weight_of(beckmann, alpha, lights[slot(k)], d);
        }
        const DVec3 apart = d - centre;
        const double bound = cluster_error_bound(lobe, spread, glm::dot(apart, apart), mu);
        ASSERT_LE(std::abs(value - exact), bound + 1e-12)
            << "cluster " << i << ": alpha " << alpha << ", radius " << radius << ", angle "
            << angle << ", mu " << mu;
        if (bound > 1e-9) nearest = std::max(nearest, std::abs(value - exact) / bound);
    }
    EXPECT_GT(nearest, 0.05);
}

TEST(ErrorBound, ClustersGgx) {
    expect_clusters_within_bounds<GgxWeight>(false);
}
TEST(ErrorBound, ClustersBeckmann) {
    expect_clusters_within_bounds<BeckmannWeight>(true);
}

TEST(ErrorBound, CertifiedMipsAreWithinTheirCertificate) {
    const auto few = [](auto&, std::size_t i) { return DVec3(i % 4 == 1 ? 1000.0 : 1.0); };
    const auto noise = [](auto&, std::size_t i) {
        RandomStream random(4, 4, i);
        return DVec3{random.next(), std::pow(random.next(), 20), random.next() < 1e-3 ? 1e5 : 1.0};
    };
    const Environment maps[] = {test::environment(test::lat_long_grid(5, 3), few),
                                test::environment(test::lat_long_grid(96, 48), noise),
                                test::environment(test::cube_grid(12), noise),
                                test::sun_and_sky(test::lat_long_grid(64, 32))};
    for (const Environment& map : maps) {
        const test::PrefilterReference reference(map);
        for (const auto& [r, tolerance] :
             {std::pair{0.1f, 1e-3}, {0.25f, 1e-2}, {0.5f, 1e-3}, {1.0f, 1e-3}}) {
            MipsJob job;
            job.face_size = 6;
            job.tolerance = tolerance;
            job.certify = true;
            const Mip mip = test::bake_one(map, r, job);
            EXPECT_LE(mip.error_estimate, tolerance) << r;
            EXPECT_LE(test::worst_error(mip, reference, 12), mip.error_estimate) << r;
        }
    }
}

}  // namespace
}  // namespace envbake
