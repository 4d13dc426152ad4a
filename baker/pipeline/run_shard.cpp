// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/pipeline/shard.h"
#include "baker/pipeline/stage_source.h"

#include "envbake/format/writer.h"

#include <algorithm>
#include <new>
#include <type_traits>
#include <utility>

namespace envbake {

namespace {

/// Runs a shard's share of a plan, and writes down what the stages give.
class ShardRun {
  public:
    ShardRun(const BakeRequest& request, const BakeInputs& inputs, const BakePlan& plan,
             format::Writer& writer, Progress& progress)
        : request_(request),
          inputs_(inputs),
          plan_(plan),
          writer_(writer),
          progress_(progress),
          share_(plan, inputs.facts, *request.shard),
          stages_(inputs, request.isa, progress) {}

    Expected<void> execute();

  private:
    template <class T>
    Expected<void> add(const std::string& name, std::vector<std::uint64_t> shape,
                       std::span<const T> elements, format::Codec codec = format::Codec::None) {
        if (auto done = writer_.add<T>(name, std::move(shape), elements, codec); !done)
            return Error{Errc::Failed,
                         concat(request_.output.string(), ": ", format::to_string(done.error()))};
        return {};
    }

    void announce();

    Expected<void> bake(const std::string& output, const PlannedMips& planned);
    Expected<void> bake(const std::string& output, const PlannedTable& planned);
    Expected<void> bake(const std::string& output, const PlannedLobe& planned);
    Expected<void> bake(const std::string& output, const PlannedDiffuse& planned);
    Expected<void> bake(const std::string& output, const PlannedGlossy& planned);
    Expected<void> rows(const std::string& output, DiffuseJob job, std::size_t mesh,
                        bool for_bounces);
    Expected<void> bake(const std::string& output, const PlannedWavelet& planned);
    Expected<void> bake(const std::string& output, const PlannedWaveletLight& planned);
    // What is made of all the parts.
    static Expected<void> bake(const std::string&, const PlannedLights&) { return {}; }
    static Expected<void> bake(const std::string&, const PlannedSh&) { return {}; }
    static Expected<void> bake(const std::string&, const PlannedBounces&) { return {}; }
    static Expected<void> bake(const std::string&, const PlannedEmitted&) { return {}; }
    static Expected<void> bake(const std::string&, const PlannedEncoding&) { return {}; }
    Expected<void> bake(const std::string&, const PlannedWaveletWeights& planned) {
        wavelet_job_ = planned.job;
        return {};
    }

    const BakeRequest& request_;
    const BakeInputs& inputs_;
    const BakePlan& plan_;
    format::Writer& writer_;
    Progress& progress_;
    ShareOfWork share_;
    BakedStages stages_;
    std::vector<WaveletMesh> wavelet_meshes_;
    WaveletJob wavelet_job_;
    Json results_ = Json::object();
};

void ShardRun::announce() {
    std::uint64_t total = 0;
    for (const PlannedStage& stage : plan_.stages) {
        if (!stage.job) continue;
        if (const auto mesh = mesh_of_rows(*stage.job)) {
            const auto [begin, end] = share_.vertices(*mesh);
            total += end - begin;
        }
    }
    progress_.begin("diffuse transport", "vertices", total);
}

Expected<void> ShardRun::execute() {
    bool announced = false;
    for (const PlannedStage& stage : plan_.stages) {
        if (!stage.job) continue;
        const bool traces = std::holds_alternative<PlannedDiffuse>(*stage.job) ||
                            std::holds_alternative<PlannedGlossy>(*stage.job);
        if (traces && !std::exchange(announced, true)) announce();
        ENVBAKE_TRY_VOID(
            std::visit([&](const auto& job) { return bake(stage.output, job); }, *stage.job));
    }
    const std::uint32_t part[2] = {static_cast<std::uint32_t>(request_.shard->index),
                                   static_cast<std::uint32_t>(request_.shard->count)};
    ENVBAKE_TRY_VOID(add<std::uint32_t>(std::string(format::kShardName), {2}, part));
    Json json = shared_json(request_, inputs_, describe_bake(request_, inputs_, plan_));
    json["shard"] = shard_json(request_.shard);
    json["results"] = std::move(results_);
    const std::string text = to_text(json, 1);
    return add<std::uint8_t>(std::string(format::kMetadataName), {text.size()},
                             {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

Expected<void> ShardRun::bake(const std::string& output, const PlannedMips& planned) {
    if (!share_.takes_next()) return {};
    ENVBAKE_TRY(const std::vector<Mip> mips, stages_.mips(output, planned.job));
    Json errors = Json::array();
    for (const Mip& mip : mips) {
        errors.push_back(mip.error_estimate);
        ENVBAKE_TRY_VOID(add<float>(concat(shard_name(output), "/", mip.level), {mip.texels.size()},
                                    mip.texels));
    }
    results_[output] = std::move(errors);
    return {};
}

Expected<void> ShardRun::bake(const std::string& output, const PlannedTable& planned) {
    if (!share_.takes_next()) return {};
    ENVBAKE_TRY(const BrdfTable table, stages_.table(output, planned.job));
    std::vector<float> texels;
    for (const Vec2& texel : table.texels) texels.insert(texels.end(), {texel.x, texel.y});
    results_[output] = report_json(table);
    ENVBAKE_TRY_VOID(add<float>(shard_name(output) + "/texels", {texels.size()}, texels));
    return add<float>(shard_name(output) + "/average_albedo", {table.average_albedo.size()},
                      table.average_albedo);
}

Expected<void> ShardRun::bake(const std::string& output, const PlannedLobe& planned) {
    if (!share_.takes_next()) return {};
    ENVBAKE_TRY(const LobeExpansion lobe, stages_.lobe(output, planned.job));
    results_[output] = {{"rows", lobe.rows}};
    ENVBAKE_TRY_VOID(
        add<float>(shard_name(output) + "/unoccluded", {lobe.unoccluded.size()}, lobe.unoccluded));
    return add<float>(shard_name(output) + "/kernel", {lobe.kernel.size()}, lobe.kernel);
}

Expected<void> ShardRun::rows(const std::string& output, DiffuseJob job, std::size_t mesh,
                              bool for_bounces) {
    const auto [begin, end] = share_.vertices(mesh);
    if (begin == end) return {};
    job.first_vertex = begin;
    job.end_vertex = end;
    const auto bands = static_cast<std::uint64_t>(std::max(job.bands, job.row_bands));
    const std::uint64_t row_size = bands * bands;
    std::uint64_t pieces = 0;
    const auto sink = [&](std::span<const float> some) {
        return add<float>(concat(shard_name(output), "/", pieces++),
                          {some.size() / row_size, row_size}, some);
    };
    ENVBAKE_TRY(const DiffuseReport report, stages_.rows(output, job, mesh, for_bounces, sink));
    results_[output] = {
        {"begin", begin}, {"end", end}, {"pieces", pieces}, {"report", report_json(report)}};
    if (!for_bounces) return {};
    const BlockedRays blocked = stages_.take_blocked(mesh);
    const std::uint64_t packets = blocked.set.directions.size();
    results_[output]["packets"] = packets;
    results_[output]["pilot"] = blocked.set.pilot_packets > 0;
    if (packets == 0) return {};
    return add<std::uint16_t>(
        shard_name(output) + "/blocked", {end - begin, packets},
        std::span(blocked.masks).subspan(begin * packets, (end - begin) * packets),
        format::Codec::Zstd);
}

Expected<void> ShardRun::bake(const std::string& output, const PlannedDiffuse& planned) {
    if (planned.from_glossy) return {};
    return rows(output, planned.job, planned.mesh, planned.bounces);
}

Expected<void> ShardRun::bake(const std::string& output, const PlannedGlossy& planned) {
    ENVBAKE_TRY_VOID(rows(output, planned.job, planned.mesh, planned.bounces));
    const auto [begin, end] = share_.vertices(planned.mesh);
    if (begin == end) return {};
    ENVBAKE_TRY(const std::vector<float> normals, stages_.normals(planned.mesh));
    return add<float>(shard_name(concat("mesh/", planned.mesh, "/normal")), {end - begin, 3},
                      std::span(normals).subspan(3 * begin, 3 * (end - begin)));
}

Expected<void> ShardRun::bake(const std::string& output, const PlannedWavelet& planned) {
    wavelet_meshes_.push_back({planned.mesh, inputs_.facts.meshes[planned.mesh].vertex_count});
    const auto [begin, end] = share_.vertices(planned.mesh);
    if (begin == end) return {};
    WaveletJob job = planned.job;
    job.first_vertex = begin;
    job.end_vertex = end;
    constexpr std::size_t kPieceBytes = std::size_t{16} << 20;
    std::vector<std::byte> piece;
    std::uint64_t pieces = 0;
    const auto flush = [&]() -> Expected<void> {
        ENVBAKE_TRY_VOID(
            add<std::uint8_t>(concat(shard_name(output), "/", pieces++), {piece.size()},
                              {reinterpret_cast<const std::uint8_t*>(piece.data()), piece.size()}));
        piece.clear();
        return {};
    };
    const auto sink = [&](std::span<const std::byte> block) -> Expected<void> {
        piece.insert(piece.end(), block.begin(), block.end());
        if (piece.size() < kPieceBytes) return {};
        return flush();
    };
    progress_.begin("wavelet transport", "vertices", end - begin);
    std::vector<std::uint32_t> offsets;
    std::vector<std::uint64_t> sums(wavelet::coeff_count(job.face_size), 0);
    ENVBAKE_TRY(const WaveletReport report,
                stages_.wavelet(output, job, planned.mesh, sink, offsets, sums));
    if (!piece.empty()) ENVBAKE_TRY_VOID(flush());
    std::vector<std::uint32_t> words;
    for (const std::uint64_t sum : sums) {
        words.push_back(static_cast<std::uint32_t>(sum));
        words.push_back(static_cast<std::uint32_t>(sum >> 32));
    }
    results_[output] = {
        {"begin", begin}, {"end", end}, {"pieces", pieces}, {"report", report_json(report)}};
    ENVBAKE_TRY_VOID(
        add<std::uint32_t>(shard_name(output) + "/offsets", {offsets.size()}, offsets));
    return add<std::uint32_t>(shard_name(output) + "/square_sums", {sums.size(), 2}, words);
}

Expected<void> ShardRun::bake(const std::string& output, const PlannedWaveletLight& planned) {
    if (!share_.takes_next()) return {};
    ENVBAKE_TRY(const WaveletLight light,
                stages_.wavelet_light(output, wavelet_job_, planned.channels, wavelet_meshes_));
    const std::uint64_t coeffs = light.coeffs.size();
    std::vector<float> values;
    for (const wavelet::Rgb& coeff : light.coeffs)
        values.insert(values.end(), coeff.begin(), coeff.end());
    results_[output] = {{"sample", light.sample.size()}};
    ENVBAKE_TRY_VOID(add<float>(shard_name(output) + "/coeffs", {coeffs, 3}, values));
    for (std::size_t i = 0; i < light.sample.size(); ++i) {
        const WaveletLight::Vertex& vertex = light.sample[i];
        const std::string name = concat(shard_name(output), "/", i);
        const std::uint32_t which[2] = {vertex.mesh, vertex.vertex};
        ENVBAKE_TRY_VOID(add<std::uint32_t>(name + "/vertex", {2}, which));
        ENVBAKE_TRY_VOID(
            add<float>(name + "/stored", {coeffs}, vertex.stored, format::Codec::Zstd));
        ENVBAKE_TRY_VOID(
            add<float>(name + "/looked", {coeffs}, vertex.looked, format::Codec::Zstd));
    }
    return {};
}

}  // namespace

Expected<void> run_shard(const BakeRequest& request, const BakeInputs& inputs, const BakePlan& plan,
                         Progress& progress) try {
    auto writer = format::Writer::create(request.output.string());
    const auto failed = [&](const format::Error& error) {
        return Error{Errc::Failed, concat(request.output.string(), ": ", format::to_string(error))};
    };
    if (!writer) return failed(writer.error());
    ENVBAKE_TRY_VOID(ShardRun(request, inputs, plan, *writer, progress).execute());
    if (auto finished = writer->finish(); !finished) return failed(finished.error());
    return {};
} catch (const std::bad_alloc&) {
    return Error{Errc::Failed, "out of memory: bake a smaller scene, or fewer meshes at once"};
}

}  // namespace envbake
