// SPDX-License-Identifier: Apache-2.0
// A bake's memory is that of the geometry and its tree, and a budget: rows do not pile up.
#include "baker/transport/diffuse.h"
#include "tests/support/sanitized.h"
#include "tests/unit/trace/shapes.h"

#include <gtest/gtest.h>
#include <malloc.h>

#include <cmath>
#include <fstream>
#include <string>

namespace envbake {
namespace {

constexpr bool kSanitized = test::kAddressSanitizer || test::kThreadSanitizer;

/// Bytes from /proc/self/status: "VmHWM" is the most this process has held, "VmRSS" what it holds.
/// 0 where the system does not tell.
std::size_t memory_bytes(const std::string& field) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
        if (line.starts_with(field + ":")) return std::stoul(line.substr(field.size() + 1)) * 1024;
    return 0;
}

/// From here on VmHWM counts anew.
void forget_peak() {
    std::ofstream("/proc/self/clear_refs") << "5";
}

/// Half a million vertices, half of them copies of the other half that come much later: 50 MB of
/// rows, of which 25 would have to wait.
TEST(DiffuseMemory, StaysWithinTheBudget) {
    if (kSanitized) GTEST_SKIP() << "a sanitizer's own memory is not the bake's";
    constexpr int kSide = 499;
    Mesh mesh = test::grid({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, kSide);
    for (Vec3& p : mesh.positions) p.z = 0.05f * std::sin(40 * p.x) * std::sin(30 * p.y);
    const Mesh again = mesh;
    test::append(mesh, again);
    const Scene scene = test::scene_of({mesh});
    const std::size_t vertices = scene.meshes[0].vertex_count();
    const std::size_t triangles = scene.meshes[0].triangle_count();
    ASSERT_GT(vertices, 490'000u);
    const auto tracer = Tracer::build(scene);
    ASSERT_TRUE(tracer) << tracer.error();

    constexpr std::size_t kBudget = std::size_t{8} << 20;
    malloc_trim(0);  // what was freed would be taken again unseen
    forget_peak();
    const std::size_t before = memory_bytes("VmRSS");
    if (before == 0 || memory_bytes("VmHWM") > before + kBudget)
        GTEST_SKIP() << "the system does not tell how much memory is held";
    std::size_t row_bytes = 0;
    Progress progress;
    const auto report = bake_diffuse(
        {.rays_per_vertex = 16, .memory_bytes = kBudget}, scene, 0, *tracer,
        [&](std::span<const float> rows) -> Expected<void> {
            row_bytes += rows.size_bytes();
            return {};
        },
        progress);
    ASSERT_TRUE(report) << report.error();
    EXPECT_EQ(row_bytes, vertices * 25 * sizeof(float));
    EXPECT_GT(report->repeated_ray_count, 0u);
    // What the header says of the welding, and threads.
    const std::size_t welding = 32 * vertices + 12 * triangles + (std::size_t{4} << 20);
    const std::size_t held = memory_bytes("VmHWM") - before;
    RecordProperty("held_mb", static_cast<int>(held >> 20));
    EXPECT_LT(held, kBudget + welding);
    EXPECT_LT(kBudget + welding, row_bytes) << "the test would not notice rows that pile up";
    EXPECT_GT(held, kBudget / 2) << "nothing was measured";
}

}  // namespace
}  // namespace envbake
