// SPDX-License-Identifier: Apache-2.0
#include "baker/plan/plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace envbake {
namespace {

/// A photograph with a sun: colours, contrast, energy in every band.
EnvironmentFacts sky() {
    return {.mean = 1,
            .peak = 80000,
            .contrast = 1e6,
            .lights = {.count = 1, .share = 0.3, .strongest_share = 0.3},
            .band_energy = std::vector<double>(5, 1.0)};
}

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
    facts.environment = sky();
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

TEST(Plan, MarkedMeshes) {
    BakeFacts facts = facts_of({dielectric(0.5f), dielectric(0.5f), dielectric(0.5f)});
    facts.meshes[0].receives = false;
    facts.meshes[1].casts = false;
    BakeRequest request;
    request.unshadowed = true;
    const BakePlan plan = plan_of(facts, request);
    EXPECT_FALSE(stage(plan, "mesh/0/diffuse").job);
    EXPECT_FALSE(stage(plan, "mesh/0/unshadowed").job);
    EXPECT_EQ(stage(plan, "mesh/0/diffuse").reason, "marked as receiving nothing");
    EXPECT_TRUE(stage(plan, "mesh/1/diffuse").job);
    EXPECT_NE(stage(plan, "mesh/1/diffuse").reason.find("marked as casting nothing"),
              std::string::npos);
    EXPECT_TRUE(stage(plan, "mesh/2/diffuse").job);
    EXPECT_EQ(stage(plan, "mesh/2/diffuse").reason.find("marked"), std::string::npos);
}

TEST(Plan, GlossyTransportWhereSHShowsTheLobe) {
    BakeFacts facts = facts_of(
        {dielectric(0.5f), metal(0.5f), metal(0.2f), metal(0.5f), dielectric(0.5f), metal(0.5f)});
    facts.materials[3].min_roughness = 0.1f;
    facts.materials[4].max_r0 = 0;
    facts.meshes[5].receives = false;
    BakeRequest request;
    const auto glossy = [](const BakePlan& plan, int mesh) -> const PlannedStage& {
        return stage(plan, "mesh/" + std::to_string(mesh) + "/glossy");
    };
    const auto job = [&](const BakePlan& plan, int mesh) {
        return std::get<PlannedGlossy>(*glossy(plan, mesh).job);
    };
    for (int mesh = 0; mesh < 6; ++mesh) {
        EXPECT_FALSE(glossy(plan_of(facts, request), mesh).job);
        EXPECT_EQ(glossy(plan_of(facts, request), mesh).reason, "not asked for");
    }
    EXPECT_FALSE(stage(plan_of(facts, request), "brdf/ggx_lobe").job);

    request.glossy = GlossyChoice::WhereItShows;
    BakePlan plan = plan_of(facts, request);
    EXPECT_TRUE(job(plan, 0).with_diffuse);
    EXPECT_EQ(job(plan, 0).job.row_bands, 11);
    EXPECT_EQ(job(plan, 0).light_bands, 5);
    EXPECT_TRUE(std::get<PlannedDiffuse>(*stage(plan, "mesh/0/diffuse").job).from_glossy);
    EXPECT_FALSE(job(plan, 1).with_diffuse);
    EXPECT_FALSE(stage(plan, "mesh/1/diffuse").job);
    EXPECT_FALSE(glossy(plan, 2).job);
    EXPECT_NE(glossy(plan, 2).reason.find("roughness 0.2 at most"), std::string::npos);
    EXPECT_TRUE(glossy(plan, 3).job);
    EXPECT_NE(glossy(plan, 3).reason.find("sharper parts, down to 0.1"), std::string::npos);
    EXPECT_NE(glossy(plan, 4).reason.find("no specular lobe"), std::string::npos);
    EXPECT_EQ(glossy(plan, 5).reason, "marked as receiving nothing");
    const LobeExpansionJob lobe = std::get<PlannedLobe>(*stage(plan, "brdf/ggx_lobe").job).job;
    EXPECT_EQ(lobe.roughness[0], kLeastGlossyRoughness);
    EXPECT_EQ(lobe.roughness[1], 0.5);
    EXPECT_FALSE(stage(plan, "brdf/beckmann_lobe").job);
    EXPECT_GT(plan.ray_count, 4 * 900u);  // of meshes 0, 1, 3 and 4

    request.glossy = GlossyChoice::All;
    request.bands = 3;
    request.glossy_bands = 4;
    plan = plan_of(facts, request);
    EXPECT_TRUE(glossy(plan, 2).job);
    EXPECT_EQ(job(plan, 2).job.row_bands, 9);
    EXPECT_FLOAT_EQ(static_cast<float>(
                        std::get<PlannedLobe>(*stage(plan, "brdf/ggx_lobe").job).job.roughness[0]),
                    0.1f);

    // A lobe of 4 % reflects less than a tenth, but not less than a thousandth.
    request.glossy = GlossyChoice::WhereItShows;
    request.tolerance = 0.1;
    EXPECT_FALSE(glossy(plan_of(facts, request), 0).job);
    EXPECT_NE(glossy(plan_of(facts, request), 0).reason.find("less than the tolerance"),
              std::string::npos);
    EXPECT_TRUE(glossy(plan_of(facts, request), 1).job);

    request.glossy_bands = 6;
    EXPECT_FALSE(make_plan(request, facts));
}

/// The rays are for the worse of diffuse and glossy, and for what bounces leave of the tolerance.
TEST(Plan, GlossyTransportGetsTheRaysThatItNeeds) {
    BakeRequest request;
    request.glossy = GlossyChoice::WhereItShows;
    const auto job = [&](const MaterialFacts& material) {
        const BakePlan plan = plan_of(facts_of({material}), request);
        return std::get<PlannedGlossy>(*stage(plan, "mesh/0/glossy").job).job;
    };
    DiffuseJob diffuse = job(dielectric(0.5f));
    EXPECT_EQ(diffuse.tolerance, request.tolerance);
    EXPECT_FALSE(diffuse.row_use.alone);
    diffuse.row_use = {};
    EXPECT_EQ(expected_rays_per_vertex(job(dielectric(0.5f))), expected_rays_per_vertex(diffuse));
    EXPECT_GT(expected_rays_per_vertex(job(metal(0.5f))), expected_rays_per_vertex(diffuse));
    EXPECT_TRUE(job(metal(0.5f)).row_use.alone);
    request.bounces = 1;
    EXPECT_LT(job(dielectric(0.5f)).tolerance, request.tolerance);
}

TEST(Plan, BouncesWhereTheyAreAskedForAndCanBeSeen) {
    BakeFacts facts = facts_of({dielectric(0.5f), metal(0.5f)});
    BakeRequest request;
    EXPECT_EQ(stage(plan_of(facts, request), "bounces").reason, "not asked for");
    const auto diffuse = [](const BakePlan& plan) {
        return std::get<PlannedDiffuse>(*stage(plan, "mesh/0/diffuse").job);
    };
    EXPECT_FALSE(diffuse(plan_of(facts, request)).bounces);

    request.bounces = 3;
    BakePlan plan = plan_of(facts, request);
    BounceJob job = std::get<PlannedBounces>(*stage(plan, "bounces").job).job;
    EXPECT_EQ(job.bounces, 3);
    EXPECT_EQ(job.channels, 1);
    EXPECT_FALSE(job.emission);
    EXPECT_TRUE(diffuse(plan).bounces);
    EXPECT_LT(diffuse(plan).job.tolerance, request.tolerance);
    const std::uint64_t grey_bytes = plan.output_bytes;

    facts.materials[1].grey_albedo = false;  // a metal, which has no transport
    EXPECT_EQ(plan_of(facts, request).output_bytes, grey_bytes);
    facts.materials[0].grey_albedo = false;
    facts.materials[1].max_emission = 2;
    plan = plan_of(facts, request);
    job = std::get<PlannedBounces>(*stage(plan, "bounces").job).job;
    EXPECT_EQ(job.channels, 3);
    EXPECT_TRUE(job.emission);
    EXPECT_TRUE(stage(plan, "mesh/0/emitted").job);
    EXPECT_EQ(plan.output_bytes, grey_bytes + 1000 * 4 * (2 * 25 + 3));

    facts.materials[1].max_emission = 0;
    facts.materials[0].max_diffuse_albedo = 1e-4f;
    plan = plan_of(facts, request);
    EXPECT_FALSE(stage(plan, "bounces").job);
    EXPECT_NE(stage(plan, "bounces").reason.find("no albedo x form factor"), std::string::npos);
    EXPECT_FALSE(diffuse(plan).bounces);
    facts.materials[0].max_diffuse_albedo = 0.9f;
    facts.meshes[0].free_vertex_count = facts.meshes[0].vertex_count;
    EXPECT_EQ(stage(plan_of(facts, request), "bounces").reason, "no vertex sees a surface");
    facts.meshes[0].receives = false;
    EXPECT_EQ(stage(plan_of(facts, request), "bounces").reason, "no mesh has transport");
}

/// One lobe a material, of the meshes that have glossy transport.
TEST(Plan, BouncesKnowTheLobesThatTheyReach) {
    BakeFacts facts = facts_of({dielectric(0.5f), metal(0.6f), metal(0.2f)});
    facts.meshes.push_back(facts.meshes[1]);
    BakeRequest request;
    request.bounces = kAllBounces;
    const auto job = [&] {
        return std::get<PlannedBounces>(*stage(plan_of(facts, request), "bounces").job).job.lobes;
    };
    EXPECT_TRUE(job().errors.empty());
    EXPECT_TRUE(job().lobe_of_mesh.empty());

    request.glossy = GlossyChoice::WhereItShows;
    const LobeLightJob lobes = job();
    ASSERT_EQ(lobes.errors.size(), 2u);
    EXPECT_EQ(lobes.lobe_of_mesh,
              (std::vector<std::size_t>{0, 1, LobeLightJob::kNoLobe, 1}));  // 0.2: too sharp for SH
    EXPECT_EQ(lobes.light_bands, 5);
    std::vector<double> x(49, 0);
    x[0] = 1;
    EXPECT_GT(lobes.errors[1][0](x), 5 * lobes.errors[0][0](x));  // R0 = 0.9 and 0.04

    request.distributions = {runtime::Distribution::Ggx, runtime::Distribution::Beckmann};
    facts.materials[1].min_roughness = 0.5f;
    EXPECT_EQ(job().errors[1].size(), 6u);  // least, middle and largest roughness of both
}

/// Metals have transport for the light that comes to their lobes; among themselves they send none.
TEST(Plan, MetalsAloneHaveNoTransportForBounces) {
    BakeFacts facts = facts_of({metal(0.5f), dielectric(0.5f)});
    BakeRequest request;
    request.glossy = GlossyChoice::WhereItShows;
    request.bounces = kAllBounces;
    const auto glossy = [](const BakePlan& plan) {
        return std::get<PlannedGlossy>(*stage(plan, "mesh/0/glossy").job);
    };
    BakePlan plan = plan_of(facts, request);
    EXPECT_TRUE(stage(plan, "mesh/0/diffuse").job);
    EXPECT_TRUE(glossy(plan).with_diffuse);
    facts.materials[1].max_diffuse_albedo = 0;
    facts.materials[1].max_r0 = 0;
    plan = plan_of(facts, request);
    EXPECT_FALSE(stage(plan, "bounces").job);
    EXPECT_FALSE(stage(plan, "mesh/0/diffuse").job);
    EXPECT_FALSE(glossy(plan).with_diffuse);
}

TEST(Plan, NoSceneMeansAllLightingAndNoTransport) {
    BakeFacts facts;
    facts.environment = sky();
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

TEST(Plan, AnEnvironmentThatIsConstantToHalfTheToleranceIsOneTexelALevel) {
    BakeFacts facts = facts_of({dielectric(0.6f)});
    const auto mips = [&] {
        return std::get<PlannedMips>(*stage(plan_of(facts), "environment/mips").job);
    };
    EXPECT_EQ(mips().job.face_size, 256);
    EXPECT_EQ(mips().contrast, 0);
    for (const double contrast : {0.0, 4.9e-3}) {
        facts.environment->contrast = contrast;
        EXPECT_EQ(mips().job.face_size, 1);
        EXPECT_EQ(mips().contrast, contrast) << "is part of the error";
    }
    facts.environment->contrast = 5.1e-3;
    EXPECT_EQ(mips().job.face_size, 256);
}

TEST(Plan, AGreyEnvironmentHasOneChannel) {
    BakeFacts facts = facts_of({dielectric(0.6f)});
    for (const bool grey : {true, false}) {
        facts.environment->grey = grey;
        const BakePlan plan = plan_of(facts);
        const int channels = grey ? 1 : 3;
        EXPECT_EQ(std::get<PlannedSh>(*stage(plan, "environment/sh").job).channels, channels);
        EXPECT_EQ(std::get<PlannedMips>(*stage(plan, "environment/mips").job).job.channels,
                  channels);
        EXPECT_EQ(stage(plan, "environment/sh").reason.find("grey") != std::string::npos, grey);
    }
}

TEST(Plan, BandsUnderTheToleranceAreNotStored) {
    BakeFacts facts = facts_of({dielectric(0.6f)});
    const auto bands = [&](double fourth, double fifth) {
        facts.environment->band_energy = {1, 0.1, 0.1, fourth, fifth};
        const BakePlan plan = plan_of(facts);
        const PlannedStage& sh = stage(plan, "environment/sh");
        EXPECT_EQ(sh.reason.find(" of 5 bands") != std::string::npos,
                  std::get<PlannedSh>(*sh.job).bands < 5);
        return std::get<PlannedSh>(*sh.job).bands;
    };
    EXPECT_EQ(bands(0.1, 0.1), 5);
    EXPECT_EQ(bands(0.1, 1e-9), 4);
    EXPECT_EQ(bands(1e-9, 1e-9), 3);
    EXPECT_EQ(bands(1e-9, 0.1), 5) << "bands below one that is needed stay";
    facts.environment->band_energy = {1, 0, 0, 0, 0};
    EXPECT_EQ(std::get<PlannedSh>(*stage(plan_of(facts), "environment/sh").job).bands, 1);
}

TEST(Plan, TransportKeepsTheBandsAskedForUnderAnyLight) {
    BakeFacts facts = facts_of({dielectric(0.6f)});
    facts.environment->band_energy = {1, 0, 0, 0, 0};
    EXPECT_EQ(std::get<PlannedDiffuse>(*stage(plan_of(facts), "mesh/0/diffuse").job).job.bands, 5);
}

TEST(Plan, LightsAreBakedWhereThereAreAny) {
    BakeFacts facts = facts_of({dielectric(0.6f)});
    EXPECT_EQ(std::get<PlannedLights>(*stage(plan_of(facts), "environment/lights").job).count, 1u);
    EXPECT_EQ(stage(plan_of(facts), "environment/lights").reason, "1 light has 30 % of the energy");
    BakeRequest request;
    request.extract_lights = true;
    EXPECT_EQ(stage(plan_of(facts, request), "environment/lights").reason,
              "1 light has 30 % of the energy, left out of every other array");
    facts.environment->lights = {.count = 0, .share = 0, .strongest_share = 0.004};
    EXPECT_FALSE(stage(plan_of(facts), "environment/lights").job);
    EXPECT_EQ(stage(plan_of(facts), "environment/lights").reason,
              "no small light dominates: the strongest has 0.4 % of the energy");
    facts.environment->lights = {};
    EXPECT_EQ(stage(plan_of(facts), "environment/lights").reason,
              "no light is small and stands out");
}

TEST(Plan, IrradianceIsBakedOnRequestOnly) {
    const BakeFacts facts = facts_of({dielectric(0.6f)});
    EXPECT_EQ(stage(plan_of(facts), "environment/irradiance").reason, "not asked for");
    BakeRequest request;
    request.irradiance = true;
    request.window = true;
    const BakePlan plan = plan_of(facts, request);
    const auto& irradiance = std::get<PlannedSh>(*stage(plan, "environment/irradiance").job);
    EXPECT_TRUE(irradiance.irradiance);
    EXPECT_TRUE(irradiance.window);
    EXPECT_FALSE(std::get<PlannedSh>(*stage(plan, "environment/sh").job).irradiance);
}

TEST(Plan, TheDistributionsAskedForAreBakedAndShareTheirMirror) {
    using enum runtime::Distribution;
    const BakeFacts facts = facts_of({dielectric(0.1f)});
    const auto levels = [](const BakePlan& plan, const char* output) {
        const PlannedStage& s = stage(plan, output);
        return s.job ? std::get<PlannedMips>(*s.job).job.levels : std::vector<int>{};
    };
    BakeRequest request;
    EXPECT_EQ(stage(plan_of(facts, request), "environment/mips_beckmann").reason, "not asked for");
    EXPECT_EQ(stage(plan_of(facts, request), "brdf/beckmann").reason, "not asked for");
    request.distributions = {Beckmann};
    BakePlan plan = plan_of(facts, request);
    EXPECT_EQ(stage(plan, "environment/mips").reason, "not asked for");
    EXPECT_EQ(levels(plan, "environment/mips_beckmann"), (std::vector<int>{0, 1}));
    EXPECT_EQ(std::get<PlannedTable>(*stage(plan, "brdf/beckmann").job).job.distribution, Beckmann);
    request.distributions = {Ggx, Beckmann};
    plan = plan_of(facts, request);
    EXPECT_EQ(levels(plan, "environment/mips"), (std::vector<int>{0, 1}));
    EXPECT_EQ(levels(plan, "environment/mips_beckmann"), (std::vector<int>{1}));
    plan = plan_of(facts_of({dielectric(0)}), request);
    EXPECT_EQ(levels(plan, "environment/mips_beckmann"), (std::vector<int>{0}))
        << "a chain of the mirror alone is whole";
}

TEST(Plan, ARoughnessRangeOverridesTheScene) {
    const BakeFacts facts = facts_of({dielectric(0.5f)});
    BakeRequest request;
    request.roughness_range = RoughnessRange{0.3, 0.5};
    const BakePlan plan = plan_of(facts, request);
    const PlannedStage& mips = stage(plan, "environment/mips");
    EXPECT_EQ(std::get<PlannedMips>(*mips.job).job.levels, (std::vector<int>{1, 2}));
    EXPECT_EQ(mips.reason, "roughness 0.3 to 0.5 was asked for");
    request.mip_layout = runtime::MipLayout::LatLong;
    EXPECT_EQ(
        std::get<PlannedMips>(*stage(plan_of(facts, request), "environment/mips").job).job.layout,
        runtime::MipLayout::LatLong);
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
    for (const RoughnessRange range :
         {RoughnessRange{-0.1, 1}, {0, 1.1}, {0.5, 0.4}, {NAN, 1}, {0, NAN}}) {
        EXPECT_NE(
            refusal([&](BakeRequest& r) { r.roughness_range = range; }).find("--roughness-range"),
            std::string::npos);
    }
    EXPECT_NE(refusal([](BakeRequest& r) { r.table_size = 1; }).find("--table-size"),
              std::string::npos);
    EXPECT_NE(refusal([](BakeRequest& r) { r.rays_per_vertex = -1; }).find("--rays"),
              std::string::npos);
}

TEST(Plan, BytesAreThoseOfTheArrays) {
    BakeFacts facts = facts_of({dielectric(0.5f)});
    // A light of 9, SH 25 x 3, mip 2 of 64 x 64, table 64 x 64 x 2 with 64 averages, 1000 vertices
    // of 25, all f32.
    constexpr std::uint64_t kOthers = 9 + 75 + 64 * 64 * 2 + 64 + 1000 * 25;
    EXPECT_EQ(plan_of(facts).output_bytes, 4 * (kOthers + 6 * 64 * 64 * 3));
    BakeRequest request;
    request.mip_layout = runtime::MipLayout::LatLong;
    EXPECT_EQ(plan_of(facts, request).output_bytes, 4 * (kOthers + 256 * 128 * 3));
    request.mip_layout = runtime::MipLayout::CubeFaces;
    request.half_tables = true;
    EXPECT_EQ(plan_of(facts, request).output_bytes,
              4 * (kOthers + 6 * 64 * 64 * 3) - 2 * 64 * 64 * 2);
}

TEST(Plan, WaveletsWhereShLoseMoreThanTheTolerance) {
    BakeFacts facts = facts_of({dielectric(0.5f), metal(0.5f)});
    facts.environment->sh_shadow_loss = 0.164;
    BakeRequest request;
    BakePlan plan = plan_of(facts, request);
    EXPECT_FALSE(stage(plan, "environment/wavelet").job);
    EXPECT_EQ(stage(plan, "environment/wavelet").reason,
              "not asked for; 5 bands of SH lose 16.4 % rms beside a hard shadow");

    request.wavelet = WaveletUse::WhereNeeded;
    plan = plan_of(facts, request);
    ASSERT_TRUE(stage(plan, "environment/wavelet").job);
    ASSERT_TRUE(stage(plan, "wavelet/weight").job);
    ASSERT_TRUE(stage(plan, "mesh/0/wavelet").job);
    EXPECT_EQ(std::get<PlannedWavelet>(*stage(plan, "mesh/0/wavelet").job).job.face_size, 64);
    EXPECT_FALSE(stage(plan, "mesh/1/wavelet").job) << "a metal reflects nothing diffusely";
    // Light is chosen by the transport, so it comes last.
    EXPECT_EQ(plan.stages.back().output, "environment/wavelet");
    EXPECT_GT(plan.ray_count, plan_of(facts).ray_count);
    EXPECT_GT(plan.output_bytes, plan_of(facts).output_bytes);

    facts.environment->sh_shadow_loss = 0.009;
    plan = plan_of(facts, request);
    EXPECT_FALSE(stage(plan, "environment/wavelet").job);
    EXPECT_EQ(stage(plan, "environment/wavelet").reason,
              "not needed: 5 bands of SH lose 0.9 % rms beside a hard shadow");
    EXPECT_EQ(plan_of(facts).ray_count, plan.ray_count);

    request.wavelet = WaveletUse::Always;
    request.wavelet_size = 32;
    plan = plan_of(facts, request);
    ASSERT_TRUE(stage(plan, "mesh/0/wavelet").job);
    EXPECT_EQ(std::get<PlannedWavelet>(*stage(plan, "mesh/0/wavelet").job).job.face_size, 32);

    facts.environment.reset();
    request.wavelet = WaveletUse::WhereNeeded;
    plan = plan_of(facts, request);
    EXPECT_TRUE(stage(plan, "mesh/0/wavelet").job) << "nothing says that SH would do";
    EXPECT_EQ(stage(plan, "environment/wavelet").reason, "no environment");

    request.wavelet_size = 48;
    EXPECT_FALSE(make_plan(request, facts));
}

}  // namespace
}  // namespace envbake
