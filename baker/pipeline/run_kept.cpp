// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/pipeline/run.h"
#include "baker/pipeline/stage_key.h"

#include "envbake/runtime/lobe.h"

#include <algorithm>
#include <map>
#include <utility>

namespace envbake {

std::vector<bool> stages_to_keep(const BakeRequest& request, const BakeInputs& inputs,
                                 const BakePlan& plan) {
    std::vector<bool> kept(plan.stages.size(), false);
    if (const auto older = OlderBundle::open(request.output)) {
        const auto arrays = older->arrays_to_keep(plan, stage_keys(request, inputs, plan));
        for (std::size_t i = 0; i < kept.size(); ++i) kept[i] = arrays[i].has_value();
    }
    return kept;
}

Expected<void> Run::take_over(const OlderBundle& older) try {
    older_ = &older;
    std::vector<std::string> keys;
    for (const BakeReport::Stage& stage : report_.stages) keys.push_back(stage.key);
    auto arrays = older.arrays_to_keep(plan_, keys);
    for (std::size_t i = 0; i < kept_.size(); ++i) {
        kept_[i] = arrays[i].has_value();
        if (arrays[i]) report_.stages[i].arrays = std::move(*arrays[i]);
    }
    const auto errors = older.metadata().at("arrays").get<std::map<std::string, Json>>();
    for (std::size_t i = 0; i < kept_.size(); ++i) {
        const PlannedStage& stage = plan_.stages[i];
        if (!kept_[i]) continue;
        for (const std::string& name : report_.stages[i].arrays)
            if (const auto error = errors.find(name); error != errors.end())
                report_.array_errors[name] = {error->second.at("error").get<double>(),
                                              error->second.at("norm").get<std::string>()};
        ENVBAKE_TRY_VOID(
            std::visit([&](const auto& job) { return read_back(stage.output, job); }, *stage.job));
    }
    return {};
} catch (const Json::exception& e) {
    return Error{Errc::InvalidBundle, e.what()};
}

Expected<void> Run::copy_arrays(std::span<const std::string> names) {
    for (const std::string& name : names)
        ENVBAKE_TRY_VOID(checked(writer_.copy(older_->reader(), *older_->reader().find(name))));
    return {};
}

const Json& Run::older_mesh(std::size_t mesh) const {
    return older_->metadata().at("meshes").at(mesh);
}

Expected<void> Run::read_back(const std::string& output, const PlannedMips& mips) {
    report_.mip_count = stored_.mip_count = mips.level_count;
    for (std::size_t i = 0; i < mips.job.levels.size(); ++i) {
        const std::string name = concat(output, "/", mips.job.levels[i]);
        const Mip mip = empty_mip(mips.job, i);
        StoredArrays::Mip stored{mip.level, mip.faces, mip.width, mip.height, mip.channels, {}};
        ENVBAKE_TRY(
            stored.texels,
            older_->floats(name, mip.texel_count() * static_cast<std::uint64_t>(mip.channels)));
        lobe_of(report_, mips.job.distribution)
            .mip_levels.push_back(
                {mip.level, mip.faces, mip.width, mip.height, mip.perceptual_roughness});
        lobe_of(stored_, mips.job.distribution).mips.push_back(std::move(stored));
    }
    return {};
}

Expected<void> Run::read_back(const std::string& output, const PlannedTable& planned) {
    const auto size = static_cast<std::uint64_t>(planned.job.size);
    StoredArrays::Lobe& stored = lobe_of(stored_, planned.job.distribution);
    stored.table_size = planned.job.size;
    stored_.table_axes = planned.job.axes;
    ENVBAKE_TRY(stored.table, older_->floats(output, 2 * size * size));
    read_table(older_->metadata().at("brdf").at(output.substr(output.find('/') + 1)),
               lobe_of(report_, planned.job.distribution).table.emplace());
    return {};
}

Expected<void> Run::read_back(const std::string& output, const PlannedLobe& planned) {
    const LobeExpansionJob& job = planned.job;
    const auto info = older_->reader().find(output + "/unoccluded");
    constexpr std::uint64_t kMostRows = 33;
    if (!info || info->shape[0] < 1 || info->shape[0] > kMostRows) return unexpected(output);
    const std::uint64_t rows = info->shape[0];
    LobeExpansion lobe{static_cast<int>(rows), {}, {}};
    const auto floats = [&](const char* part, int bands) {
        return older_->floats(output + part, rows * 2 * runtime::lobe_size(job.exit_bands, bands));
    };
    ENVBAKE_TRY(lobe.unoccluded, floats("/unoccluded", job.light_bands));
    ENVBAKE_TRY(lobe.kernel, floats("/kernel", runtime::kLobeBands));
    note(job, lobe);
    return {};
}

Expected<void> Run::read_back(const std::string& output, const PlannedGlossy& glossy) {
    const std::uint64_t vertices = vertex_count(glossy.mesh);
    report_.glossy[glossy.mesh] = read_glossy(older_mesh(glossy.mesh).at("glossy"), glossy.errors);
    const auto row_size = static_cast<std::size_t>(glossy.job.row_bands * glossy.job.row_bands);
    ENVBAKE_TRY(const OlderRows rows, OlderRows::open(*older_, output, vertices, row_size));
    ENVBAKE_TRY(const std::vector<float> normals,
                older_->floats(concat("mesh/", glossy.mesh, "/normal"), 3 * vertices));
    for (StoredArrays::GlossyVertex& asked : stored_.glossy_vertices)
        if (asked.mesh == glossy.mesh) asked.visibility = rows.row(asked.vertex);
    keep_self_test_normals(glossy.mesh, normals);
    return {};
}

Expected<void> Run::read_back(const std::string& output, const PlannedDiffuse& diffuse) {
    if (!diffuse.job.shadowed) return {};
    const std::uint64_t vertices = vertex_count(diffuse.mesh);
    report_.diffuse[diffuse.mesh] = read_diffuse(older_mesh(diffuse.mesh).at("diffuse"));
    const auto row_size =
        static_cast<std::size_t>(diffuse.job.bands * diffuse.job.bands * bounce_channels_);
    ENVBAKE_TRY(const OlderRows rows, OlderRows::open(*older_, output, vertices, row_size));
    const std::string emitted_name = concat("mesh/", diffuse.mesh, "/emitted");
    std::vector<float> emitted;
    if (diffuse.bounces && older_->reader().find(emitted_name)) {
        ENVBAKE_TRY(emitted, older_->floats(emitted_name, 3 * vertices));
    }
    const auto keep = [&](const auto& asked) {
        if (asked.mesh != diffuse.mesh) return;
        const std::span<const float> all(emitted);
        keep_self_test_rows(diffuse.mesh, asked.vertex, rows.row(asked.vertex), row_size,
                            all.empty() ? all : all.subspan(3 * std::size_t{asked.vertex}, 3));
    };
    std::for_each(stored_.vertices.begin(), stored_.vertices.end(), keep);
    std::for_each(stored_.glossy_vertices.begin(), stored_.glossy_vertices.end(), keep);
    return {};
}

Expected<void> Run::read_back(const std::string&, const PlannedBounces&) {
    report_.bounces = read_bounces(older_->metadata().at("bounces"));
    for (StoredArrays::GlossyVertex& asked : stored_.glossy_vertices) {
        const BakeReport::Glossy& glossy = *report_.glossy[asked.mesh];
        const std::string name = concat("mesh/", asked.mesh, "/reflected");
        if (!glossy.reflected || !older_->reader().find(name)) continue;
        const auto coeffs = [](int bands) { return static_cast<std::size_t>(bands * bands); };
        if (glossy.reflected->bands < 2 || glossy.reflected->bands > runtime::kMaxReflectedBands)
            return unexpected(name);
        const std::size_t row_size = (coeffs(glossy.reflected->bands) - 1) *
                                     coeffs(glossy.light_bands) *
                                     static_cast<std::size_t>(bounce_channels_);
        ENVBAKE_TRY(const OlderRows rows,
                    OlderRows::open(*older_, name, vertex_count(asked.mesh), row_size));
        asked.reflected = rows.row(asked.vertex);
    }
    return {};
}

Expected<void> Run::read_back(const std::string&, const PlannedEncoding&) {
    report_.encodings.resize(inputs_.facts.meshes.size());
    for (std::size_t mesh = 0; mesh < report_.encodings.size(); ++mesh)
        if (report_.diffuse[mesh])
            report_.encodings[mesh] = read_encoding(older_mesh(mesh).at("diffuse").at("encoding"));
    return {};
}

Expected<void> Run::read_back(const std::string&, const PlannedWavelet& planned) {
    const std::uint64_t vertices = vertex_count(planned.mesh);
    wavelet(planned.job).add_mesh(planned.mesh, vertices);
    report_.wavelet->step = wavelet_->step();
    report_.wavelet->meshes.emplace_back(planned.mesh,
                                         read_wavelet_mesh(older_mesh(planned.mesh).at("wavelet")));
    return {};
}

Expected<void> Run::read_back(const std::string& output, const PlannedWaveletWeights& planned) {
    wavelet(planned.job);
    ENVBAKE_TRY(wavelet_weights_,
                older_->floats(output, wavelet::coeff_count(planned.job.face_size)));
    return {};
}

/// With the self-test's questions: they are about this light and the transport that it was chosen
/// for, and nothing else.
Expected<void> Run::read_back(const std::string&, const PlannedWaveletLight&) {
    report_.wavelet->light = read_wavelet_light(older_->metadata().at("wavelet").at("light"));
    const auto info = older_->reader().find("selftest/wavelet/vertex");
    if (!info) return {};
    const auto vertices = older_->reader().view<std::uint32_t>(info->name);
    if (!vertices || !older_->reader().verify(*info)) return unexpected(info->name);
    const std::string values_name = "selftest/wavelet/value";
    ENVBAKE_TRY(const std::vector<float> values,
                older_->floats(values_name, vertices->size() / 2 * 3));
    if (!older_->reader().verify(*older_->reader().find(values_name)))
        return unexpected(values_name);
    for (std::size_t k = 0; k < vertices->size() / 2; ++k)
        stored_.wavelet_vertices.push_back({(*vertices)[2 * k],
                                            (*vertices)[2 * k + 1],
                                            {values[3 * k], values[3 * k + 1], values[3 * k + 2]}});
    return {};
}

}  // namespace envbake
