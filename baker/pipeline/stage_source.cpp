// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/stage_source.h"

namespace envbake {

std::optional<std::size_t> mesh_of_rows(const Job& job) {
    if (const auto* glossy = std::get_if<PlannedGlossy>(&job)) return glossy->mesh;
    const auto* diffuse = std::get_if<PlannedDiffuse>(&job);
    if (diffuse != nullptr && !diffuse->from_glossy) return diffuse->mesh;
    return {};
}

Expected<void> BakedStages::build_tracer() {
    if (tracer_) return {};
    ENVBAKE_TRY(tracer_, Tracer::build(*inputs_.scene, isa_));
    return {};
}

const CubeTexels& BakedStages::cube(int face_size) {
    if (!cube_) cube_.emplace(face_size);
    return *cube_;
}

Expected<std::vector<Mip>> BakedStages::mips(const std::string&, const MipsJob& job) {
    return bake_mips(job, *inputs_.environment, progress_);
}

Expected<BrdfTable> BakedStages::table(const std::string&, const BrdfTableJob& job) {
    return bake_brdf_table(job);
}

Expected<LobeExpansion> BakedStages::lobe(const std::string&, const LobeExpansionJob& job) {
    return expand_lobe(job);
}

Expected<DiffuseReport> BakedStages::rows(const std::string&, const DiffuseJob& job,
                                          std::size_t mesh, bool for_bounces,
                                          const Sink<float>& sink) {
    ENVBAKE_TRY_VOID(build_tracer());
    blocked_.resize(inputs_.scene->meshes.size());
    return bake_diffuse(job, *inputs_.scene, mesh, *tracer_, sink, progress_,
                        for_bounces ? &blocked_[mesh] : nullptr);
}

Expected<std::vector<float>> BakedStages::normals(std::size_t mesh) {
    const Mesh& of = inputs_.scene->meshes[mesh];
    const SurfacePoints points(of);
    std::vector<float> normals;
    for (std::uint32_t v = 0; v < of.vertex_count(); ++v) {
        const std::uint32_t place = points.representative(v);
        const DVec3 normal =
            place == SurfacePoints::kNone ? DVec3(0) : glm::normalize(DVec3(of.normals[place]));
        for (int c = 0; c < 3; ++c) normals.push_back(static_cast<float>(normal[c]));
    }
    return normals;
}

Expected<BounceReport> BakedStages::bounces(const BounceJob& job,
                                            std::span<MeshTransport> transport) {
    const BounceReport report =
        add_bounces(job, *inputs_.scene, *tracer_, blocked_, transport, progress_);
    std::vector<BlockedRays>().swap(blocked_);
    return report;
}

Expected<WaveletReport> BakedStages::wavelet(const std::string&, const WaveletJob& job,
                                             std::size_t mesh, const Sink<std::byte>& sink,
                                             std::vector<std::uint32_t>& offsets,
                                             std::span<std::uint64_t> square_sums) {
    ENVBAKE_TRY_VOID(build_tracer());
    return bake_wavelet(job, cube(job.face_size), *inputs_.scene, mesh, *tracer_, sink, offsets,
                        square_sums, progress_);
}

Expected<WaveletLight> BakedStages::wavelet_light(const std::string&, const WaveletJob& job,
                                                  int channels,
                                                  std::span<const WaveletMesh> meshes) {
    if (meshes.empty())
        return look_at_wavelet_light(job, *inputs_.environment, channels, {}, nullptr, nullptr,
                                     nullptr);
    ENVBAKE_TRY_VOID(build_tracer());
    return look_at_wavelet_light(job, *inputs_.environment, channels, meshes, &cube(job.face_size),
                                 &*inputs_.scene, &*tracer_);
}

}  // namespace envbake
