// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

namespace envbake {
namespace {

constexpr EnvironmentFacts kSky{.constant = false, .mean = 1, .peak = 80000};

MaterialFacts dielectric(float roughness) {
    return {.name = "clay",
            .min_roughness = roughness,
            .max_roughness = roughness,
            .max_r0 = 0.04f,
            .max_diffuse_albedo = 0.8f};
}

MaterialFacts metal(float roughness) {
    return {.name = "gold",
            .min_roughness = roughness,
            .max_roughness = roughness,
            .max_r0 = 0.9f,
            .max_diffuse_albedo = 0};
}

BakeFacts facts_of(std::vector<MaterialFacts> materials) {
    BakeFacts facts;
    facts.environment = kSky;
    facts.has_scene = true;
    for (std::size_t i = 0; i < materials.size(); ++i)
        facts.meshes.push_back(
            {.vertex_count = 1000, .triangle_count = 500, .free_vertex_count = 100, .material = i});
    facts.materials = std::move(materials);
    return facts;
}

const PlannedStage& stage(const BakePlan& plan, const std::string& output) {
    const auto found = std::find_if(plan.stages.begin(), plan.stages.end(),
                                    [&](const PlannedStage& s) { return s.output == output; });
    EXPECT_NE(found, plan.stages.end()) << output;
    return *found;
}

BakePlan plan_of(const BakeFacts& facts, const BakeRequest& request = {}) {
    auto plan = make_plan(request, facts);
    EXPECT_TRUE(plan) << plan.error();
    return std::move(*plan);
}

TEST(Plan, NoEnvironmentMeansNoLighting) {
    BakeFacts facts = facts_of({dielectric(0.5f)});
    facts.environment.reset();
    const BakePlan plan = plan_of(facts);
    for (const char* output : {"environment/sh", "environment/mips", "brdf/ggx"}) {
        EXPECT_FALSE(stage(plan, output).job) << output;
        EXPECT_EQ(stage(plan, output).reason, "no environment");
    }
    EXPECT_TRUE(stage(plan, "mesh/0/diffuse").job);
}

TEST(Plan, NoSceneMeansAllLightingAndNoTransport) {
    BakeFacts facts;
    facts.environment = kSky;
    const BakePlan plan = plan_of(facts);
    EXPECT_TRUE(stage(plan, "environment/sh").job);
    EXPECT_TRUE(stage(plan, "brdf/ggx").job);
    const auto& mips = std::get<PlannedMips>(*stage(plan, "environment/mips").job);
    EXPECT_EQ(mips.job.levels, (std::vector<int>{0, 1, 2, 3, 4}));
    EXPECT_EQ(stage(plan, "mesh").reason, "no scene");
    EXPECT_EQ(plan.ray_count, 0u);
}

TEST(Plan, NothingToBakeIsAnError) {
    const auto plan = make_plan({}, {});
    ASSERT_FALSE(plan);
    EXPECT_EQ(plan.error().code, Errc::Usage);
}

TEST(Plan, OnlyMetalsNeedNoDiffuseTransport) {
    const BakePlan plan = plan_of(facts_of({metal(0.25f)}));
    EXPECT_FALSE(stage(plan, "mesh/0/diffuse").job);
    EXPECT_EQ(stage(plan, "mesh/0/diffuse").reason, "material \"gold\" reflects nothing diffusely");
    EXPECT_TRUE(stage(plan, "environment/mips").job);
}

TEST(Plan, OneDiffuseMeshAmongMetalsKeepsItsTransport) {
    const BakePlan plan = plan_of(facts_of({metal(0.25f), dielectric(1)}));
    EXPECT_FALSE(stage(plan, "mesh/0/diffuse").job);
    EXPECT_TRUE(stage(plan, "mesh/1/diffuse").job);
}

TEST(Plan, WithoutASpecularLobeThereAreNeitherMipsNorTable) {
    MaterialFacts matte = dielectric(0.5f);
    matte.max_r0 = 0;
    const BakePlan plan = plan_of(facts_of({matte}));
    EXPECT_FALSE(stage(plan, "environment/mips").job);
    EXPECT_FALSE(stage(plan, "brdf/ggx").job);
    EXPECT_TRUE(stage(plan, "environment/sh").job);
}

TEST(Plan, MipsCoverTheRoughnessInUseAndNoMore) {
    const auto levels = [](std::vector<MaterialFacts> materials) {
        const BakePlan plan = plan_of(facts_of(std::move(materials)));
        return std::get<PlannedMips>(*stage(plan, "environment/mips").job).job.levels;
    };
    EXPECT_EQ(levels({dielectric(0.5f)}), (std::vector<int>{2}));
    EXPECT_EQ(levels({dielectric(0.6f)}), (std::vector<int>{2, 3}));
    EXPECT_EQ(levels({dielectric(0.1f), metal(0.9f)}), (std::vector<int>{0, 1, 2, 3, 4}));
    EXPECT_EQ(levels({dielectric(1.0f)}), (std::vector<int>{4}));
    EXPECT_EQ(levels({dielectric(0.0f)}), (std::vector<int>{0}));
}

TEST(Plan, AMaterialThatNoMeshUsesAsksForNothing) {
    BakeFacts facts = facts_of({dielectric(1)});
    facts.materials.push_back(metal(0));
    const BakePlan plan = plan_of(facts);
    EXPECT_EQ(std::get<PlannedMips>(*stage(plan, "environment/mips").job).job.levels,
              (std::vector<int>{4}));
}

TEST(Plan, AConstantEnvironmentIsOneTexelALevel) {
    BakeFacts facts = facts_of({dielectric(0.6f)});
    EXPECT_EQ(std::get<PlannedMips>(*stage(plan_of(facts), "environment/mips").job).job.face_size,
              256);
    facts.environment->constant = true;
    EXPECT_EQ(std::get<PlannedMips>(*stage(plan_of(facts), "environment/mips").job).job.face_size,
              1);
}

TEST(Plan, UnshadowedTransportIsBakedOnRequestOnly) {
    const BakeFacts facts = facts_of({dielectric(1)});
    EXPECT_FALSE(stage(plan_of(facts), "mesh/0/unshadowed").job);
    BakeRequest request;
    request.unshadowed = true;
    const BakePlan plan = plan_of(facts, request);
    EXPECT_FALSE(std::get<PlannedDiffuse>(*stage(plan, "mesh/0/unshadowed").job).job.shadowed);
}

TEST(Plan, FreeVerticesCostNoRays) {
    BakeFacts facts = facts_of({dielectric(1)});
    const std::uint64_t some = plan_of(facts).ray_count;
    EXPECT_GT(some, 0u);
    facts.meshes[0].free_vertex_count = 550;
    EXPECT_EQ(plan_of(facts).ray_count, some / 2);
    facts.meshes[0].free_vertex_count = 1000;
    const BakePlan plan = plan_of(facts);
    EXPECT_EQ(plan.ray_count, 0u);
    EXPECT_EQ(stage(plan, "mesh/0/diffuse").reason,
              "analytic, no rays: nothing stands above any vertex");
}

TEST(Plan, PointsAndLinesAreNumberedAndSkipped) {
    BakeFacts facts = facts_of({dielectric(1)});
    facts.meshes[0].triangle_count = 0;
    EXPECT_EQ(stage(plan_of(facts), "mesh/0/diffuse").reason, "no triangles");
}

TEST(Plan, OptionsOutOfRangeNameTheOption) {
    const auto refusal = [](auto change) {
        BakeRequest request;
        change(request);
        const auto plan = make_plan(request, facts_of({dielectric(1)}));
        EXPECT_FALSE(plan);
        return plan ? std::string() : plan.error().message;
    };
    EXPECT_EQ(refusal([](BakeRequest& r) { r.bands = 11; }), "--bands 11: 1 to 10 are possible");
    EXPECT_EQ(refusal([](BakeRequest& r) { r.bands = 0; }), "--bands 0: 1 to 10 are possible");
    EXPECT_NE(refusal([](BakeRequest& r) { r.tolerance = 0; }).find("--tolerance"),
              std::string::npos);
    EXPECT_NE(refusal([](BakeRequest& r) { r.tolerance = NAN; }).find("--tolerance"),
              std::string::npos);
    EXPECT_NE(refusal([](BakeRequest& r) { r.mip_size = 0; }).find("--mip-size"),
              std::string::npos);
    EXPECT_NE(refusal([](BakeRequest& r) { r.mip_count = 17; }).find("--mip-count"),
              std::string::npos);
    EXPECT_NE(refusal([](BakeRequest& r) { r.table_size = 1; }).find("--table-size"),
              std::string::npos);
    EXPECT_NE(refusal([](BakeRequest& r) { r.rays_per_vertex = -1; }).find("--rays"),
              std::string::npos);
}

TEST(Plan, BytesAreThoseOfTheArrays) {
    BakeFacts facts = facts_of({dielectric(0.5f)});
    // SH 25 x 3, mip 2 of 64 x 64, table 64 x 64 x 2, 1000 vertices of 25, all f32.
    EXPECT_EQ(plan_of(facts).output_bytes, 4u * (75 + 6 * 64 * 64 * 3 + 64 * 64 * 2 + 1000 * 25));
}

}  // namespace
}  // namespace envbake
