// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_scene.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/visible_transport.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace envbake {
namespace {

/// A dense scan with holes, baked to 3 %: what the report says against 4,096 rays a vertex.
TEST(Scan, TheReportedErrorIsTheTrueOne) {
    ENVBAKE_REQUIRE_DATA("meshes/stanford_bunny.glb");
    const auto scene = read_scene(test::data("meshes/stanford_bunny.glb"));
    ASSERT_TRUE(scene) << scene.error();
    const auto tracer = Tracer::build(*scene);
    ASSERT_TRUE(tracer) << tracer.error();
    constexpr double kTolerance = 3e-2;
    std::vector<float> rows;
    Progress progress;
    const auto report = bake_diffuse(
        {.tolerance = kTolerance}, *scene, 0, *tracer,
        [&](std::span<const float> some) -> Expected<void> {
            rows.insert(rows.end(), some.begin(), some.end());
            return {};
        },
        progress);
    ASSERT_TRUE(report) << report.error();
    EXPECT_EQ(count_free_vertices(*scene)[0], report->free_count);
    EXPECT_GT(report->free_count, 500u);
    EXPECT_LT(report->rays_per_vertex, 150);
    EXPECT_LT(double(report->check_ray_count), 0.05 * double(report->ray_count));

    const SurfacePoints points(scene->meshes[0]);
    const RaySet set = make_ray_set(4096, 5);
    std::vector<float> truth(25);
    std::vector<double> unoccluded(25);
    double sum = 0;
    int count = 0;
    for (std::uint32_t v = 0; v < points.size(); v += 50, ++count) {
        const RayOrigin origin = points.origin(points.representative(v), tracer->space());
        visible_transport(set, *tracer, origin, v, truth);
        unoccluded_transport(5, origin.normal, unoccluded);
        double difference = 0, norm = 0;
        for (std::size_t c = 0; c < 25; ++c) {
            difference += std::pow(double{rows[v * 25 + c]} - double{truth[c]}, 2);
            norm += unoccluded[c] * unoccluded[c];
        }
        sum += difference / norm;
    }
    const double rms = std::sqrt(sum / count);
    EXPECT_LT(rms, kTolerance);
    EXPECT_GT(report->error_rms, rms / 1.1);
    EXPECT_LT(report->error_rms, 1.25 * rms);
}

}  // namespace
}  // namespace envbake
