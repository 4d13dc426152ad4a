// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/pipeline/run.h"

#include <cmath>
#include <new>
#include <utility>

namespace envbake {

Run::Run(const BakeRequest& request, const BakeInputs& inputs, const Json& described,
         const BakePlan& plan, StageSource& stages, format::Writer& writer, Progress& progress)
    : request_(request),
      inputs_(inputs),
      described_(described),
      plan_(plan),
      stages_(stages),
      writer_(writer),
      progress_(progress),
      kept_(plan.stages.size(), false) {
    for (const Json& stage : described.at("plan"))
        report_.stages.push_back({stage.value("key", std::string()), {}});
    choose_self_test_vertices();
    for (const PlannedStage& stage : plan.stages) {
        if (!stage.job) continue;
        if (const auto* glossy = std::get_if<PlannedGlossy>(&*stage.job))
            choose_glossy_vertices(glossy->mesh);
        if (const auto* bounces = std::get_if<PlannedBounces>(&*stage.job))
            bounce_channels_ = bounces->job.channels;
        encoded_ = encoded_ || std::holds_alternative<PlannedEncoding>(*stage.job);
    }
    const std::size_t meshes = inputs.facts.meshes.size();
    report_.diffuse.resize(meshes);
    report_.glossy.resize(meshes);
    transport_.resize(meshes);
}

Expected<BakeOutcome> Run::execute() {
    bool transport_announced = false;
    for (std::size_t i = 0; i < plan_.stages.size(); ++i) {
        const PlannedStage& stage = plan_.stages[i];
        if (!stage.job) continue;
        if (kept_[i]) {
            ENVBAKE_TRY_VOID(copy_arrays(report_.stages[i].arrays));
            continue;
        }
        const bool traces = std::holds_alternative<PlannedDiffuse>(*stage.job) ||
                            std::holds_alternative<PlannedGlossy>(*stage.job);
        if (traces && !std::exchange(transport_announced, true)) announce_transport();
        written_.clear();
        ENVBAKE_TRY_VOID(
            std::visit([&](const auto& job) { return bake(stage.output, job); }, *stage.job));
        report_.stages[i].arrays = written_;
    }
    ENVBAKE_TRY_VOID(write_self_test());
    const std::string metadata = to_text(metadata_json(described_, request_, report_), 1);
    ENVBAKE_TRY_VOID(
        add<std::uint8_t>(std::string(format::kMetadataName), {metadata.size()},
                          {reinterpret_cast<const std::uint8_t*>(metadata.data()), metadata.size()},
                          format::Codec::None));
    return BakeOutcome{shortfalls(), kept_};
}

std::vector<std::string> Run::shortfalls() const {
    std::vector<std::string> lines;
    const auto judge = [&](std::string_view name, double error) {
        if (error > request_.tolerance)
            lines.push_back(concat(name, ": error ", format_number(error), ", ",
                                   format_number(request_.tolerance), " was asked for"));
    };
    for (const auto& [name, error] : report_.array_errors)
        if (name.rfind("brdf/", 0) != 0 && name.rfind("mesh/", 0) != 0)
            judge(name, rounded(error.value));
    if (report_.bounces) judge("mesh/*/emitted", rounded(report_.bounces->emitted_error_rms));
    const auto judge_scene = [&](std::string_view name, const auto& of_meshes) {
        double square_sum = 0, vertices = 0;
        for (std::size_t m = 0; m < of_meshes.size(); ++m) {
            if (!of_meshes[m]) continue;
            const auto count = static_cast<double>(vertex_count(m));
            const double rms = rounded(of_meshes[m]->error_rms);
            square_sum += rms * rms * count;
            vertices += count;
        }
        if (vertices > 0) judge(name, std::sqrt(square_sum / vertices));
    };
    judge_scene("mesh/*/diffuse", report_.diffuse);
    judge_scene("mesh/*/glossy", report_.glossy);
    return lines;
}

Expected<void> Run::require_finite(std::span<const float> values) const {
    for (const float value : values)
        if (!std::isfinite(value))
            return Error{Errc::InvalidInput,
                         concat(printable(environment_name(inputs_)),
                                ": too bright: its lighting leaves the range of 32-bit floats; "
                                "scale the image down")};
    return {};
}

Expected<void> Run::begin(const format::ArraySpec& spec) {
    written_.push_back(spec.name);
    return checked(writer_.begin(spec));
}

Expected<void> Run::append(std::span<const std::byte> bytes) {
    return checked(writer_.append(bytes));
}

Expected<void> Run::end() {
    return checked(writer_.end());
}

Expected<void> Run::checked(const format::Expected<void>& done) const {
    if (done) return {};
    return Error{Errc::Failed,
                 concat(request_.output.string(), ": ", format::to_string(done.error()))};
}

Expected<BakeOutcome> write_bundle(const BakeRequest& request, const BakeInputs& inputs,
                                   const Json& described, const BakePlan& plan, StageSource& stages,
                                   Older older, Progress& progress) try {
    auto writer = format::Writer::create(request.output.string());
    if (!writer)
        return Error{Errc::Failed,
                     concat(request.output.string(), ": ", format::to_string(writer.error()))};
    std::optional<OlderBundle> bundle;
    if (older == Older::Keep) bundle = OlderBundle::open(request.output);
    std::optional<Run> run;
    const auto begin = [&] {
        run.emplace(request, inputs, described, plan, stages, *writer, progress);
    };
    begin();
    // Nothing is written yet: what turns out not to be what it says is baked over.
    if (bundle && !run->take_over(*bundle)) begin();
    ENVBAKE_TRY(auto outcome, run->execute());
    if (auto finished = writer->finish(); !finished)
        return Error{Errc::Failed,
                     concat(request.output.string(), ": ", format::to_string(finished.error()))};
    return outcome;
} catch (const std::bad_alloc&) {
    return Error{Errc::Failed, "out of memory: bake a smaller scene, or fewer meshes at once"};
}

Expected<BakeOutcome> run_plan(const BakeRequest& request, const BakeInputs& inputs,
                               const BakePlan& plan, Older older, Progress& progress) {
    BakedStages stages(inputs, request.isa, progress);
    ENVBAKE_TRY(BakeOutcome outcome,
                write_bundle(request, inputs, describe_bake(request, inputs, plan), plan, stages,
                             older, progress));
    outcome.traced = stages.traced();
    return outcome;
}

}  // namespace envbake
