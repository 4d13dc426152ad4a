// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/pipeline/run.h"
#include "envbake/runtime/half.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <utility>

namespace envbake {

namespace {

/// Rows that are encoded and read back together: what that takes stays in a core's cache.
constexpr std::size_t kRowsInCache = 256;

}  // namespace

DiffuseJob Run::in_time(DiffuseJob job, std::size_t mesh) {
    if (request_.time_budget <= 0 || !job.shadowed) return job;
    constexpr double kForTheRest = 0.05;  // self-test, compression, the way to the disk
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - inputs_.begun;
    const double left = (1 - kForTheRest) * request_.time_budget - elapsed.count();
    const auto vertices = static_cast<double>(vertex_count(mesh));
    job.seconds = std::max(left * vertices / vertices_to_trace_, 1e-9);
    vertices_to_trace_ -= vertices;
    return job;
}

void Run::announce_transport() {
    std::uint64_t total = 0;
    for (std::size_t i = 0; i < plan_.stages.size(); ++i)
        if (const PlannedStage& stage = plan_.stages[i]; stage.job && !kept_[i]) {
            const auto mesh = mesh_of_rows(*stage.job);
            if (!mesh) continue;
            total += vertex_count(*mesh);
            const auto* diffuse = std::get_if<PlannedDiffuse>(&*stage.job);
            if (diffuse == nullptr || diffuse->job.shadowed)
                vertices_to_trace_ += static_cast<double>(vertex_count(*mesh));
        }
    progress_.begin("diffuse transport", "vertices", total);
}

Expected<void> Run::bake(const std::string& output, const PlannedGlossy& glossy) {
    const std::uint64_t vertices = vertex_count(glossy.mesh);
    const auto row_size = static_cast<std::uint64_t>(glossy.job.row_bands * glossy.job.row_bands);
    const auto diffuse_size = static_cast<std::size_t>(glossy.job.bands * glossy.job.bands);
    // Any encoding of diffuse transport makes halves of these numbers: in 8 bits they would err
    // more than the tolerance.
    const RowEncoding encoding =
        request_.encoding == Encoding::F32 ? RowEncoding::F32 : RowEncoding::F16;
    const RowCode code{encoding, row_size, {}};
    ENVBAKE_TRY_VOID(begin({output, element_type(encoding), {vertices, row_size}, codec()}));
    std::vector<float>& kept = transport_[glossy.mesh].rows;
    if (glossy.with_diffuse) kept.reserve(vertices * diffuse_size);
    double blocked_sum = 0, rounding_squares = 0;
    std::uint64_t first_vertex = 0;
    std::vector<float> as_read;
    const auto store = [&](std::span<const float> rows) -> Expected<void> {
        for (std::size_t at = 0; at < rows.size(); at += row_size) {
            blocked_sum += 1 - static_cast<double>(rows[at]) * std::sqrt(4 * std::numbers::pi);
            if (glossy.with_diffuse)
                kept.insert(kept.end(), rows.begin() + static_cast<std::ptrdiff_t>(at),
                            rows.begin() + static_cast<std::ptrdiff_t>(at + diffuse_size));
        }
        const std::vector<std::byte> stored = encode_rows(code, rows);
        if (encoding != RowEncoding::F32) {
            as_read.resize(rows.size());
            decode_rows(code, stored, as_read);
            for (std::size_t i = 0; i < rows.size(); ++i) {
                const double rounding = static_cast<double>(as_read[i] - rows[i]);
                rounding_squares += rounding * rounding;
            }
            rows = as_read;
        }
        for (auto& asked : stored_.glossy_vertices) {
            if (asked.mesh != glossy.mesh || asked.vertex < first_vertex) continue;
            const std::uint64_t at = (asked.vertex - first_vertex) * row_size;
            if (at < rows.size())
                asked.visibility.assign(rows.begin() + static_cast<std::ptrdiff_t>(at),
                                        rows.begin() + static_cast<std::ptrdiff_t>(at + row_size));
        }
        first_vertex += rows.size() / row_size;
        return append(stored);
    };
    const auto sink = [&](std::span<const float> rows) -> Expected<void> {
        const std::size_t most = kRowsInCache * row_size;
        for (; !rows.empty(); rows = rows.subspan(std::min(most, rows.size())))
            ENVBAKE_TRY_VOID(store(rows.first(std::min(most, rows.size()))));
        return {};
    };
    ENVBAKE_TRY(const DiffuseReport rays, stages_.rows(output, in_time(glossy.job, glossy.mesh),
                                                       glossy.mesh, glossy.bounces, sink));
    ENVBAKE_TRY_VOID(end());

    const LobeErrors& lobe = glossy.errors;
    const double blocked =
        std::max(0.0, blocked_sum / static_cast<double>(std::max<std::uint64_t>(1, vertices)));
    const double expansion = lobe.fit * std::sqrt(blocked);
    const double rounding =
        lobe.per_rounding_error *
        std::sqrt(rounding_squares /
                  static_cast<double>(std::max<std::uint64_t>(1, row_size * vertices)));
    report_.glossy[glossy.mesh] = {rays, glossy.light_bands, lobe,
                                   std::hypot(rays.row_error * rays.error_rms, expansion, rounding),
                                   std::hypot(rays.row_error * rays.error_p999, lobe.fit)};
    report_.array_errors[output] = error_of_matrices(report_.glossy[glossy.mesh]->error_rms);
    if (glossy.with_diffuse) report_.diffuse[glossy.mesh] = rays;

    ENVBAKE_TRY(const std::vector<float> normals, stages_.normals(glossy.mesh));
    keep_self_test_normals(glossy.mesh, normals);
    return add<float>(concat("mesh/", glossy.mesh, "/normal"), {vertices, 3}, normals, codec());
}

Expected<void> Run::store_kept(const std::string& output, const PlannedDiffuse& diffuse) {
    std::vector<float>& rows = transport_[diffuse.mesh].rows;
    const auto coeffs = static_cast<std::uint64_t>(diffuse.job.bands * diffuse.job.bands);
    if (diffuse.bounces) {
        std::vector<float> coloured;
        coloured.reserve(rows.size() * static_cast<std::size_t>(bounce_channels_));
        for (const float value : rows)
            for (int c = 0; c < bounce_channels_; ++c) coloured.push_back(value);
        rows = std::move(coloured);
        return {};
    }
    report_.array_errors[output] = error_of_transport(report_.diffuse[diffuse.mesh]->error_rms);
    if (encoded_) return {};
    keep_self_test_rows(diffuse.mesh, 0, rows, coeffs);
    ENVBAKE_TRY_VOID(add<float>(output, {rows.size() / coeffs, coeffs}, rows, codec()));
    std::vector<float>().swap(rows);
    return {};
}

Expected<void> Run::bake(const std::string& output, const PlannedDiffuse& diffuse) {
    const auto coeffs = static_cast<std::uint64_t>(diffuse.job.bands * diffuse.job.bands);
    if (diffuse.from_glossy) return store_kept(output, diffuse);
    if (diffuse.bounces) return keep(output, diffuse);
    if (encoded_ && diffuse.job.shadowed) return keep_on_disk(output, diffuse);
    ENVBAKE_TRY_VOID(
        begin({output, format::ElementType::F32, {vertex_count(diffuse.mesh), coeffs}, codec()}));
    std::uint64_t first_vertex = 0;
    const auto sink = [&](std::span<const float> rows) -> Expected<void> {
        if (diffuse.job.shadowed) keep_self_test_rows(diffuse.mesh, first_vertex, rows, coeffs);
        first_vertex += rows.size() / coeffs;
        return append(std::as_bytes(rows));
    };
    ENVBAKE_TRY(DiffuseReport report, stages_.rows(output, in_time(diffuse.job, diffuse.mesh),
                                                   diffuse.mesh, false, sink));
    ENVBAKE_TRY_VOID(end());
    report_.array_errors[output] = error_of_transport(report.error_rms);
    if (diffuse.job.shadowed) report_.diffuse[diffuse.mesh] = report;
    return {};
}

Expected<void> Run::keep(const std::string& output, const PlannedDiffuse& diffuse) {
    std::vector<float>& kept = transport_[diffuse.mesh].rows;
    const std::size_t vertices = vertex_count(diffuse.mesh);
    kept.reserve(vertices * static_cast<std::size_t>(diffuse.job.bands * diffuse.job.bands *
                                                     bounce_channels_));
    const auto sink = [&](std::span<const float> rows) -> Expected<void> {
        for (const float value : rows)
            for (int c = 0; c < bounce_channels_; ++c) kept.push_back(value);
        return {};
    };
    ENVBAKE_TRY(report_.diffuse[diffuse.mesh],
                stages_.rows(output, in_time(diffuse.job, diffuse.mesh), diffuse.mesh, true, sink));
    return {};
}

Expected<void> Run::bake(const std::string&, const PlannedBounces& bounces) {
    if (bounces.job.emission)
        for (std::size_t m = 0; m < transport_.size(); ++m)
            if (!transport_[m].rows.empty()) transport_[m].emitted.resize(3 * vertex_count(m), 0);
    ENVBAKE_TRY(const BounceReport report, stages_.bounces(bounces.job, transport_));
    report_.bounces = report;
    const double left_out = bounces.job.bounces == kAllBounces ? report.left_out : 0;
    const auto coeffs = static_cast<std::uint64_t>(bounces.job.bands * bounces.job.bands);
    const auto channels = static_cast<std::uint64_t>(bounces.job.channels);
    for (std::size_t m = 0; m < transport_.size(); ++m) {
        std::vector<float>& rows = transport_[m].rows;
        if (rows.empty()) continue;
        DiffuseReport& of_mesh = *report_.diffuse[m];
        of_mesh.error_rms = std::hypot(of_mesh.error_rms, report.error_rms) + left_out;
        of_mesh.error_p999 = std::hypot(of_mesh.error_p999, report.error_p999) + left_out;
        if (report_.glossy[m])
            ENVBAKE_TRY_VOID(store_reflected(m, report.lobes[bounces.job.lobes.lobe_of_mesh[m]]));
        const std::string output = concat("mesh/", m, "/diffuse");
        report_.array_errors[output] = error_of_transport(of_mesh.error_rms);
        if (encoded_) continue;
        keep_self_test_rows(m, 0, rows, coeffs * channels, transport_[m].emitted);
        std::vector<std::uint64_t> shape{rows.size() / (coeffs * channels), coeffs};
        if (channels > 1) shape.push_back(channels);
        ENVBAKE_TRY_VOID(add<float>(output, std::move(shape), rows, codec()));
        std::vector<float>().swap(rows);
    }
    return {};
}

Expected<void> Run::store_reflected(std::size_t mesh, const LobeLightReport& light) {
    BakeReport::Glossy& glossy = *report_.glossy[mesh];
    glossy.reflected = light;
    glossy.error_rms = std::hypot(glossy.error_rms, light.error_rms);
    glossy.error_p999 = std::hypot(glossy.error_p999, light.error_p999);
    report_.array_errors[concat("mesh/", mesh, "/glossy")] = error_of_matrices(glossy.error_rms);
    std::vector<std::uint16_t>& halves = transport_[mesh].reflected;
    if (halves.empty()) return {};
    const auto vertices = static_cast<std::size_t>(vertex_count(mesh));
    const std::size_t row_size = halves.size() / vertices;
    for (StoredArrays::GlossyVertex& asked : stored_.glossy_vertices)
        for (std::size_t i = 0; asked.mesh == mesh && i < row_size; ++i)
            asked.reflected.push_back(runtime::half_to_float(halves[asked.vertex * row_size + i]));
    const std::string output = concat("mesh/", mesh, "/reflected");
    report_.array_errors[output] = error_of_matrices(light.error_rms);
    const auto coeffs = [](int bands) { return static_cast<std::uint64_t>(bands * bands); };
    std::vector<std::uint64_t> shape{vertices, coeffs(light.bands) - 1, coeffs(glossy.light_bands)};
    if (bounce_channels_ > 1) shape.push_back(static_cast<std::uint64_t>(bounce_channels_));
    ENVBAKE_TRY_VOID(begin({output, format::ElementType::F16, std::move(shape), codec()}));
    ENVBAKE_TRY_VOID(append(std::as_bytes(std::span(halves))));
    ENVBAKE_TRY_VOID(end());
    std::vector<std::uint16_t>().swap(halves);
    return {};
}

Expected<void> Run::bake(const std::string& output, const PlannedEmitted& planned) {
    const std::vector<float>& emitted = transport_[planned.mesh].emitted;
    report_.array_errors[output] = {report_.bounces->emitted_error_rms,
                                    "rms over the scene's vertices, relative to their rms"};
    return add<float>(output, {emitted.size() / 3, 3}, emitted, codec());
}

}  // namespace envbake
