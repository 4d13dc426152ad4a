// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/run.h"

#include <utility>

namespace envbake {

WaveletStage& Run::wavelet(const WaveletJob& job) {
    if (!wavelet_) {
        wavelet_.emplace(job);
        report_.wavelet.emplace().face_size = job.face_size;
    }
    return *wavelet_;
}

Expected<void> Run::bake(const std::string& output, const PlannedWavelet& planned) {
    WaveletStage& stage = wavelet(planned.job);
    const std::uint64_t vertices = vertex_count(planned.mesh);
    // Never compressed: a reader takes a few runs out of each block.
    ENVBAKE_TRY_VOID(
        begin({output + "/blocks", format::ElementType::U32, {format::kOpenEnded}, {}}));
    const auto sink = [&](std::span<const std::byte> bytes) -> Expected<void> {
        return append(bytes);
    };
    progress_.begin("wavelet transport", "vertices", vertices);
    std::vector<std::uint32_t> offsets;
    ENVBAKE_TRY(const WaveletReport report, stages_.wavelet(output, planned.job, planned.mesh, sink,
                                                            offsets, stage.square_sums()));
    ENVBAKE_TRY_VOID(end());
    stage.add_mesh(planned.mesh, vertices);
    report_.wavelet->step = stage.step();
    report_.wavelet->meshes.emplace_back(planned.mesh, report);
    return add<std::uint32_t>(output + "/offsets", {offsets.size()}, offsets, format::Codec::None);
}

Expected<void> Run::bake(const std::string& output, const PlannedWaveletWeights& planned) {
    wavelet_weights_ = wavelet(planned.job).weights();
    return add<float>(output, {wavelet_weights_.size()}, wavelet_weights_, format::Codec::None);
}

Expected<void> Run::bake(const std::string& output, const PlannedWaveletLight& planned) {
    ENVBAKE_TRY(
        const WaveletLight light,
        stages_.wavelet_light(output, wavelet_->job(), planned.channels, wavelet_->meshes()));
    const WaveletStage::Lighting lighting = wavelet_->choose_lighting(light, wavelet_weights_);
    report_.wavelet->light =
        WaveletLightSummary{lighting.terms.size(), lighting.coeff_count, lighting.truncation};
    std::vector<std::uint32_t> indices;
    std::vector<float> values;
    for (const wavelet::Term& term : lighting.terms) {
        indices.push_back(term.index);
        values.insert(values.end(), term.value.begin(), term.value.begin() + planned.channels);
    }
    ENVBAKE_TRY_VOID(require_finite(values));
    report_.array_errors[output + "/value"] = {
        lighting.error,
        "relative rms exit radiance of a sample of vertices that are traced "
        "texel by texel"};
    for (const WaveletLight::Vertex& vertex : light.sample) {
        DVec3 sum(0), magnitude(0);
        for (const wavelet::Term& term : lighting.terms) {
            const DVec3 product = DVec3(term.value[0], term.value[1], term.value[2]) *
                                  static_cast<double>(vertex.stored[term.index]);
            sum += product;
            magnitude += glm::abs(product);
        }
        // Where terms cancel, as in the shadow of a sun, a float reader cannot be held to it.
        if (glm::all(glm::greaterThan(sum, 0.03 * magnitude)))
            stored_.wavelet_vertices.push_back({vertex.mesh, vertex.vertex, sum});
    }
    ENVBAKE_TRY_VOID(
        add<std::uint32_t>(output + "/index", {indices.size()}, indices, format::Codec::None));
    return add<float>(output + "/value",
                      {indices.size(), static_cast<std::uint64_t>(planned.channels)}, values,
                      format::Codec::None);
}

}  // namespace envbake
