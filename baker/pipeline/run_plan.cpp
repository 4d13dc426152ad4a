// SPDX-License-Identifier: Apache-2.0
#include "baker/core/row_store.h"
#include "baker/core/text.h"
#include "baker/pipeline/bake.h"
#include "baker/pipeline/encode_mip.h"
#include "baker/pipeline/encode_transport.h"
#include "baker/pipeline/metadata.h"
#include "baker/pipeline/self_test.h"
#include "baker/pipeline/wavelet_stage.h"

#include "envbake/format/writer.h"
#include "envbake/runtime/half.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <iterator>
#include <new>
#include <numbers>
#include <utility>

namespace envbake {

namespace {

/// The half of a pair of lobes that a distribution has, in a report and among the stored arrays.
template <class Lobes>
auto& lobe_of(Lobes& lobes, runtime::Distribution distribution) {
    return distribution == runtime::Distribution::Ggx ? lobes.ggx : lobes.beckmann;
}

/// Runs one plan; holds what its stages share.
class Run {
  public:
    Run(const BakeRequest& request, const BakeInputs& inputs, format::Writer& writer,
        Progress& progress)
        : request_(request), inputs_(inputs), writer_(writer), progress_(progress) {
        if (!inputs.scene) return;
        const std::size_t meshes = inputs.scene->meshes.size();
        report_.diffuse.resize(meshes);
        report_.glossy.resize(meshes);
        transport_.resize(meshes);
        blocked_.resize(meshes);
    }

    /// Returns what fell short of the tolerance.
    Expected<std::vector<std::string>> execute(const BakePlan& plan) {
        choose_self_test_vertices(plan);
        for (const PlannedStage& stage : plan.stages)
            if (stage.job) {
                if (const auto* bounces = std::get_if<PlannedBounces>(&*stage.job))
                    bounce_channels_ = bounces->job.channels;
                encoded_ = encoded_ || std::holds_alternative<PlannedEncoding>(*stage.job);
            }
        bool transport_announced = false;
        for (const PlannedStage& stage : plan.stages) {
            if (!stage.job) continue;
            const bool traces = std::holds_alternative<PlannedDiffuse>(*stage.job) ||
                                std::holds_alternative<PlannedGlossy>(*stage.job);
            if (traces && !std::exchange(transport_announced, true)) announce_transport(plan);
            ENVBAKE_TRY_VOID(
                std::visit([&](const auto& job) { return bake(stage.output, job); }, *stage.job));
        }
        ENVBAKE_TRY_VOID(write_self_test());
        const std::string metadata = to_text(metadata_json(request_, inputs_, plan, report_), 1);
        ENVBAKE_TRY_VOID(add<std::uint8_t>(
            std::string(format::kMetadataName), {metadata.size()},
            {reinterpret_cast<const std::uint8_t*>(metadata.data()), metadata.size()},
            format::Codec::None));
        return shortfalls();
    }

  private:
    /// Arrays whose error in a relative norm is above the tolerance that was asked for. The table
    /// is not among them: its size is an option of its own. The transport of a scene counts as a
    /// whole: its error is an rms, and that of a small mesh is as often above as below.
    std::vector<std::string> shortfalls() const {
        std::vector<std::string> lines;
        const auto judge = [&](std::string_view name, double error) {
            if (error > request_.tolerance)
                lines.push_back(concat(name, ": error ", format_number(error), ", ",
                                       format_number(request_.tolerance), " was asked for"));
        };
        for (const auto& [name, error] : report_.array_errors)
            if (name.rfind("brdf/", 0) != 0 && name.rfind("mesh/", 0) != 0)
                judge(name, error.value);
        if (report_.bounces) judge("mesh/*/emitted", report_.bounces->emitted_error_rms);
        const auto judge_scene = [&](std::string_view name, const auto& of_meshes) {
            double square_sum = 0, vertex_count = 0;
            for (std::size_t m = 0; m < of_meshes.size(); ++m) {
                if (!of_meshes[m]) continue;
                const auto count = static_cast<double>(inputs_.scene->meshes[m].vertex_count());
                square_sum += of_meshes[m]->error_rms * of_meshes[m]->error_rms * count;
                vertex_count += count;
            }
            if (vertex_count > 0) judge(name, std::sqrt(square_sum / vertex_count));
        };
        judge_scene("mesh/*/diffuse", report_.diffuse);
        judge_scene("mesh/*/glossy", report_.glossy);
        return lines;
    }

    Expected<void> require_finite(std::span<const float> values) const {
        for (const float value : values)
            if (!std::isfinite(value))
                return Error{Errc::InvalidInput,
                             concat(inputs_.environment->file_name,
                                    ": too bright: its lighting leaves the range of 32-bit floats; "
                                    "scale the image down")};
        return {};
    }

    Error output_error(const format::Error& e) const {
        return {Errc::Failed, concat(request_.output.string(), ": ", format::to_string(e))};
    }

    format::Codec codec() const {
        return request_.compress ? format::Codec::Zstd : format::Codec::None;
    }

    template <class T>
    Expected<void> add(std::string name, std::vector<std::uint64_t> shape,
                       std::span<const T> elements, format::Codec array_codec) {
        if (auto done = writer_.add<T>(std::move(name), std::move(shape), elements, array_codec);
            !done)
            return output_error(done.error());
        return {};
    }

    Expected<void> bake(const std::string& output, const PlannedLights&) {
        std::vector<float> rows;
        for (const DominantLight& light : inputs_.lights.lights) {
            for (int c = 0; c < 3; ++c) rows.push_back(static_cast<float>(light.direction[c]));
            for (int c = 0; c < 3; ++c) rows.push_back(static_cast<float>(light.irradiance[c]));
            for (const double x : {light.angular_radius, light.solid_angle, light.share})
                rows.push_back(static_cast<float>(x));
        }
        ENVBAKE_TRY_VOID(require_finite(rows));
        return add<float>(output, {rows.size() / 9, 9}, rows, format::Codec::None);
    }

    /// The lighting to be stored, cut to the planned bands and damped.
    ShLighting planned_lighting(const PlannedSh& sh) {
        ShLighting lighting = first_bands(*inputs_.sh, sh.bands);
        if (!sh.window) return lighting;
        if (!report_.window) report_.window = nonnegative_window(lighting);
        return windowed(lighting, *report_.window);
    }

    Expected<void> bake(const std::string& output, const PlannedSh& sh) {
        ShLighting lighting = planned_lighting(sh);
        if (sh.irradiance) lighting = to_irradiance(lighting);
        std::vector<float> values;
        for (const DVec3& coeff : lighting.coeffs)
            for (int c = 0; c < sh.channels; ++c) values.push_back(static_cast<float>(coeff[c]));
        ENVBAKE_TRY_VOID(require_finite(values));
        if (!sh.irradiance) {
            stored_.bands = lighting.bands;
            for (std::size_t i = 0; i < 3 * lighting.coeffs.size(); ++i)
                stored_.sh.push_back(values[sh.channels == 1 ? i / 3 : i]);
        }
        report_.array_errors[output] = {0x1p-24, "rounding to f32, relative to each coefficient"};
        return add<float>(output, {lighting.coeffs.size(), static_cast<std::uint64_t>(sh.channels)},
                          values, format::Codec::None);
    }

    Expected<void> bake(const std::string& output, const PlannedMips& mips) {
        report_.mip_count = stored_.mip_count = mips.level_count;
        for (Mip& mip : bake_mips(mips.job, *inputs_.environment, progress_)) {
            mip.error_estimate += mips.contrast;
            lobe_of(report_, mips.job.distribution)
                .mip_levels.push_back(
                    {mip.level, mip.faces, mip.width, mip.height, mip.perceptual_roughness});
            ENVBAKE_TRY_VOID(store(concat(output, "/", mip.level), mip,
                                   lobe_of(stored_, mips.job.distribution).mips));
        }
        return {};
    }

    Expected<void> store(const std::string& name, const Mip& mip,
                         std::vector<StoredArrays::Mip>& stored_mips) {
        std::vector<std::uint64_t> shape;
        if (mip.faces == 6) shape.push_back(6);
        for (const int extent : {mip.height, mip.width, mip.channels})
            shape.push_back(static_cast<std::uint64_t>(extent));
        StoredArrays::Mip stored{mip.level, mip.faces, mip.width, mip.height, mip.channels, {}};
        double error = mip.error_estimate;
        // A tenth of the tolerance is what half floats may add.
        if (const auto half =
                encode_half(mip, inputs_.facts.environment->mean, request_.tolerance / 10)) {
            error += half->error;
            for (const format::Half& h : half->texels)
                stored.texels.push_back(runtime::half_to_float(h.bits));
            ENVBAKE_TRY_VOID(add<format::Half>(name, shape, half->texels, codec()));
        } else {
            stored.texels = mip.texels;
            ENVBAKE_TRY_VOID(add<float>(name, shape, stored.texels, codec()));
        }
        report_.array_errors[name] = {
            error, request_.certify
                       ? "proved: no |v - r| / (r + 1e-3 mean) of any texel and channel is larger"
                       : "worst |v - r| / (r + 1e-3 mean) over texels and channels"};
        stored_mips.push_back(std::move(stored));
        return {};
    }

    Expected<void> bake(const std::string& output, const PlannedTable& planned) {
        BrdfTable table = bake_brdf_table(planned.job);
        StoredArrays::Lobe& stored = lobe_of(stored_, planned.job.distribution);
        stored.table_size = planned.job.size;
        stored_.table_axes = planned.job.axes;
        const auto size = static_cast<std::uint64_t>(planned.job.size);
        report_.array_errors[output] = {
            table.lookup_error,
            concat("worst |bilinear look-up - true|, roughness from ", kSharpestRoughness)};
        if (planned.half) {
            std::vector<format::Half> halves;
            for (const std::uint16_t bits : half_texels(table)) {
                halves.push_back({bits});
                stored.table.push_back(runtime::half_to_float(bits));
            }
            report_.array_errors[output].value += 0x1p-11;
            ENVBAKE_TRY_VOID(
                add<format::Half>(output, {size, size, 2}, halves, format::Codec::None));
        } else {
            for (const Vec2& texel : table.texels)
                stored.table.insert(stored.table.end(), {texel.x, texel.y});
            ENVBAKE_TRY_VOID(
                add<float>(output, {size, size, 2}, stored.table, format::Codec::None));
        }
        ENVBAKE_TRY_VOID(add<float>(output + "_average_albedo", {size}, table.average_albedo,
                                    format::Codec::None));
        lobe_of(report_, planned.job.distribution).table = std::move(table);
        return {};
    }

    Expected<void> bake(const std::string& output, const PlannedLobe& planned) {
        const LobeExpansionJob& job = planned.job;
        const LobeExpansion lobe = expand_lobe(job);
        const auto rows = static_cast<std::uint64_t>(lobe.rows);
        const auto store = [&](const char* part, std::span<const float> values) {
            return add<float>(concat(output, part), {rows, 2, values.size() / (2 * rows)}, values,
                              format::Codec::None);
        };
        const bool ggx = job.distribution == runtime::Distribution::Ggx;
        (ggx ? report_.ggx_lobe : report_.beckmann_lobe) = {job, lobe.rows};
        StoredArrays::Lobe& stored = lobe_of(stored_, job.distribution);
        stored.lobe_rows = lobe.rows;
        stored.unoccluded = lobe.unoccluded;
        stored.kernel = lobe.kernel;
        stored_.exit_bands = job.exit_bands;
        stored_.light_bands = job.light_bands;
        std::copy(std::begin(job.roughness), std::end(job.roughness), stored_.lobe_roughness);
        ENVBAKE_TRY_VOID(store("/unoccluded", lobe.unoccluded));
        return store("/kernel", lobe.kernel);
    }

    Expected<void> bake(const std::string& output, const PlannedGlossy& glossy) {
        const Mesh& mesh = inputs_.scene->meshes[glossy.mesh];
        const auto row_size =
            static_cast<std::uint64_t>(glossy.job.row_bands * glossy.job.row_bands);
        const auto diffuse_size = static_cast<std::size_t>(glossy.job.bands * glossy.job.bands);
        ENVBAKE_TRY_VOID(build_tracer());
        // Any encoding of diffuse transport makes halves of these numbers: in 8 bits they would err
        // more than the tolerance.
        const bool half = request_.encoding != Encoding::F32;
        const auto type = half ? format::ElementType::F16 : format::ElementType::F32;
        if (auto begun = writer_.begin({output, type, {mesh.vertex_count(), row_size}, codec()});
            !begun)
            return output_error(begun.error());
        std::vector<float>& kept = transport_[glossy.mesh].rows;
        if (glossy.with_diffuse) kept.reserve(mesh.vertex_count() * diffuse_size);
        choose_glossy_vertices(glossy.mesh);
        double blocked_sum = 0, rounding_squares = 0;
        std::uint64_t first_vertex = 0;
        std::vector<format::Half> halves;
        std::vector<float> as_read;
        const auto sink = [&](std::span<const float> rows) -> Expected<void> {
            for (std::size_t at = 0; at < rows.size(); at += row_size) {
                blocked_sum += 1 - static_cast<double>(rows[at]) * std::sqrt(4 * std::numbers::pi);
                if (glossy.with_diffuse)
                    kept.insert(kept.end(), rows.begin() + static_cast<std::ptrdiff_t>(at),
                                rows.begin() + static_cast<std::ptrdiff_t>(at + diffuse_size));
            }
            std::span<const std::byte> stored = std::as_bytes(rows);
            if (half) {
                halves.clear();
                as_read.clear();
                for (const float value : rows) {
                    halves.push_back({runtime::float_to_half(value)});
                    as_read.push_back(runtime::half_to_float(halves.back().bits));
                    const double rounding = static_cast<double>(as_read.back() - value);
                    rounding_squares += rounding * rounding;
                }
                stored = std::as_bytes(std::span(halves));
                rows = as_read;
            }
            for (auto& asked : stored_.glossy_vertices) {
                if (asked.mesh != glossy.mesh || asked.vertex < first_vertex) continue;
                const std::uint64_t at = (asked.vertex - first_vertex) * row_size;
                if (at < rows.size())
                    asked.visibility.assign(
                        rows.begin() + static_cast<std::ptrdiff_t>(at),
                        rows.begin() + static_cast<std::ptrdiff_t>(at + row_size));
            }
            first_vertex += rows.size() / row_size;
            if (auto appended = writer_.append(stored); !appended)
                return output_error(appended.error());
            return {};
        };
        ENVBAKE_TRY(const DiffuseReport rays,
                    trace(glossy.job, glossy.mesh, sink,
                          glossy.bounces ? &blocked_[glossy.mesh] : nullptr));
        if (auto ended = writer_.end(); !ended) return output_error(ended.error());

        const LobeErrors& lobe = glossy.errors;
        const double blocked = std::max(
            0.0, blocked_sum / static_cast<double>(std::max<std::size_t>(1, mesh.vertex_count())));
        const double expansion = lobe.fit * std::sqrt(blocked);
        const double rounding =
            lobe.per_rounding_error *
            std::sqrt(rounding_squares / static_cast<double>(std::max<std::uint64_t>(
                                             1, row_size * mesh.vertex_count())));
        report_.glossy[glossy.mesh] = {
            rays, glossy.light_bands, lobe,
            std::hypot(lobe.per_transport_error * rays.error_rms, expansion, rounding),
            std::hypot(lobe.per_transport_error * rays.error_p999, lobe.fit)};
        report_.array_errors[output] = {
            report_.glossy[glossy.mesh]->error_rms,
            "rms over vertices of |t - t_true|_F / |a + b of an open vertex|_F"};
        if (glossy.with_diffuse) report_.diffuse[glossy.mesh] = rays;

        std::vector<float> normals;
        const SurfacePoints points(mesh);
        for (std::uint32_t v = 0; v < mesh.vertex_count(); ++v) {
            const std::uint32_t place = points.representative(v);
            const DVec3 normal = place == SurfacePoints::kNone
                                     ? DVec3(0)
                                     : glm::normalize(DVec3(mesh.normals[place]));
            for (int c = 0; c < 3; ++c) normals.push_back(static_cast<float>(normal[c]));
        }
        for (auto& vertex : stored_.glossy_vertices)
            if (vertex.mesh == glossy.mesh)
                for (std::size_t c = 0; c < 3; ++c)
                    vertex.normal[static_cast<int>(c)] =
                        normals[3 * std::size_t{vertex.vertex} + c];
        return add<float>(concat("mesh/", glossy.mesh, "/normal"), {mesh.vertex_count(), 3},
                          normals, codec());
    }

    /// Transport that came with the glossy one.
    Expected<void> store_kept(const std::string& output, const PlannedDiffuse& diffuse) {
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
        report_.array_errors[output] = {report_.diffuse[diffuse.mesh]->error_rms,
                                        "rms over vertices of |T - T_true|_2 / |T_unoccluded|_2"};
        if (encoded_) return {};
        keep_self_test_rows(diffuse.mesh, 0, rows, coeffs);
        ENVBAKE_TRY_VOID(add<float>(output, {rows.size() / coeffs, coeffs}, rows, codec()));
        std::vector<float>().swap(rows);
        return {};
    }

    Expected<void> bake(const std::string& output, const PlannedDiffuse& diffuse) {
        const Mesh& mesh = inputs_.scene->meshes[diffuse.mesh];
        const auto coeffs = static_cast<std::uint64_t>(diffuse.job.bands * diffuse.job.bands);
        ENVBAKE_TRY_VOID(build_tracer());
        if (diffuse.from_glossy) return store_kept(output, diffuse);
        if (diffuse.bounces) return keep(diffuse);
        if (encoded_ && diffuse.job.shadowed) return keep_on_disk(output, diffuse);
        if (auto begun = writer_.begin(
                {output, format::ElementType::F32, {mesh.vertex_count(), coeffs}, codec()});
            !begun)
            return output_error(begun.error());
        std::uint64_t first_vertex = 0;
        const auto sink = [&](std::span<const float> rows) -> Expected<void> {
            if (diffuse.job.shadowed) keep_self_test_rows(diffuse.mesh, first_vertex, rows, coeffs);
            first_vertex += rows.size() / coeffs;
            if (auto appended = writer_.append(std::as_bytes(rows)); !appended)
                return output_error(appended.error());
            return {};
        };
        ENVBAKE_TRY(DiffuseReport report, trace(diffuse.job, diffuse.mesh, sink));
        if (auto ended = writer_.end(); !ended) return output_error(ended.error());
        report_.array_errors[output] = {report.error_rms,
                                        "rms over vertices of |T - T_true|_2 / |T_unoccluded|_2"};
        if (diffuse.job.shadowed) report_.diffuse[diffuse.mesh] = report;
        return {};
    }

    /// Bakes transport into memory, the same in every channel, for the bounces.
    Expected<void> keep(const PlannedDiffuse& diffuse) {
        std::vector<float>& kept = transport_[diffuse.mesh].rows;
        const std::size_t vertices = inputs_.scene->meshes[diffuse.mesh].vertex_count();
        kept.reserve(vertices * static_cast<std::size_t>(diffuse.job.bands * diffuse.job.bands *
                                                         bounce_channels_));
        const auto sink = [&](std::span<const float> rows) -> Expected<void> {
            for (const float value : rows)
                for (int c = 0; c < bounce_channels_; ++c) kept.push_back(value);
            return {};
        };
        ENVBAKE_TRY(report_.diffuse[diffuse.mesh],
                    trace(diffuse.job, diffuse.mesh, sink, &blocked_[diffuse.mesh]));
        return {};
    }

    /// Bakes transport into the store, for its encoding.
    Expected<void> keep_on_disk(const std::string& output, const PlannedDiffuse& diffuse) {
        if (!store_) {
            ENVBAKE_TRY(RowStore store, RowStore::create(request_.output.parent_path()));
            store_.emplace(std::move(store));
        }
        const std::size_t begin = store_->size();
        const auto sink = [&](std::span<const float> rows) { return store_->append(rows); };
        ENVBAKE_TRY(DiffuseReport report, trace(diffuse.job, diffuse.mesh, sink));
        report_.array_errors[output] = {report.error_rms,
                                        "rms over vertices of |T - T_true|_2 / |T_unoccluded|_2"};
        report_.diffuse[diffuse.mesh] = report;
        on_disk_.push_back({diffuse.mesh, begin, store_->size() - begin});
        return {};
    }

    /// All the transport that waited.
    Expected<std::vector<TransportPart>> waiting_parts() {
        std::vector<TransportPart> parts;
        if (store_) {
            ENVBAKE_TRY(const std::span<const float> all, store_->map());
            for (const OnDisk& part : on_disk_)
                parts.push_back({part.mesh, all.subspan(part.begin, part.size)});
        }
        for (std::size_t m = 0; m < transport_.size(); ++m)
            if (!transport_[m].rows.empty()) parts.push_back({m, transport_[m].rows});
        return parts;
    }

    /// Writes what waited, in its encoding.
    Expected<void> bake(const std::string&, const PlannedEncoding& planned) {
        ENVBAKE_TRY(const std::vector<TransportPart> parts, waiting_parts());
        const auto channels = static_cast<std::size_t>(bounce_channels_);
        const auto coeffs = static_cast<std::size_t>(planned.bands * planned.bands);
        // Of rows: |T_unoccluded|_2 of every channel, so that errors are their rms over channels.
        const double norm =
            unoccluded_norm(planned.bands) * std::sqrt(static_cast<double>(channels));
        const EncodedTransport encoded =
            encode_transport(planned.encoding, parts, coeffs * channels, planned.tolerance * norm,
                             planned.tolerance, request_.seed);
        if (!encoded.clusters.clusters.empty())
            ENVBAKE_TRY_VOID(write_basis(encoded.clusters, coeffs));
        report_.encodings.resize(inputs_.scene->meshes.size());
        for (std::size_t i = 0; i < parts.size(); ++i) {
            const EncodedPart& part = encoded.parts[i];
            ENVBAKE_TRY_VOID(write(parts[i], part, encoded.clusters, coeffs));
            const double rms = part.error.rms / norm, worst = part.error.worst / norm;
            DiffuseReport& of_mesh = *report_.diffuse[parts[i].mesh];
            of_mesh.error_rms = std::hypot(of_mesh.error_rms, rms);
            of_mesh.error_p999 = std::hypot(of_mesh.error_p999, worst);
            report_.encodings[parts[i].mesh] = {encoding_name(part.encoding), rms, worst};
            const std::string output = concat("mesh/", parts[i].mesh, "/diffuse");
            BakeReport::ArrayError error = report_.array_errors[output];
            report_.array_errors.erase(output);
            error.value = of_mesh.error_rms;
            report_.array_errors[part.clustered() ? output + "_weights" : output] = error;
        }
        return {};
    }

    std::vector<std::uint64_t> coefficient_axes(std::size_t coeffs) const {
        std::vector<std::uint64_t> axes{coeffs};
        if (bounce_channels_ > 1) axes.push_back(static_cast<std::uint64_t>(bounce_channels_));
        return axes;
    }

    Expected<void> write_basis(const ClusteredRows& clusters, std::size_t coeffs) {
        std::vector<std::uint64_t> shape{
            clusters.cluster_count(coeffs * static_cast<std::size_t>(bounce_channels_)),
            clusters.weight_count + 1};
        for (const std::uint64_t axis : coefficient_axes(coeffs)) shape.push_back(axis);
        if (!clusters.half_basis)
            return add<float>("mesh/diffuse_basis", shape, clusters.basis, format::Codec::None);
        std::vector<format::Half> halves;
        for (const float value : clusters.basis) halves.push_back({runtime::float_to_half(value)});
        return add<format::Half>("mesh/diffuse_basis", shape, halves, format::Codec::None);
    }

    Expected<void> write(const TransportPart& part, const EncodedPart& encoded,
                         const ClusteredRows& clusters, std::size_t coeffs) {
        const std::size_t row_size = coeffs * static_cast<std::size_t>(bounce_channels_);
        const std::uint64_t vertices = part.rows.size() / row_size;
        const std::string output = concat("mesh/", part.mesh, "/diffuse");
        const std::span<const float> emitted =
            part.mesh < transport_.size() ? std::span<const float>(transport_[part.mesh].emitted)
                                          : std::span<const float>();
        std::vector<float> as_read(row_size);
        const auto keep = [&](const auto& asked) {
            if (asked.mesh != part.mesh) return;
            if (encoded.clustered())
                clusters.decode(encoded.first_row + asked.vertex, as_read);
            else
                round_trip(encoded.code, part.rows.subspan(asked.vertex * row_size, row_size),
                           as_read);
            keep_self_test_rows(part.mesh, asked.vertex, as_read, row_size,
                                emitted.empty() ? emitted : emitted.subspan(3 * asked.vertex, 3));
        };
        std::for_each(stored_.vertices.begin(), stored_.vertices.end(), keep);
        std::for_each(stored_.glossy_vertices.begin(), stored_.glossy_vertices.end(), keep);
        if (encoded.clustered()) {
            const std::size_t n = clusters.weight_count;
            ENVBAKE_TRY_VOID(add<std::uint8_t>(
                output + "_weights", {vertices, n},
                std::span(clusters.weights).subspan(encoded.first_row * n, vertices * n), codec()));
            const auto numbers = std::span(clusters.clusters).subspan(encoded.first_row, vertices);
            if (clusters.cluster_count(row_size) > 256)
                return add<std::uint16_t>(output + "_cluster", {vertices}, numbers, codec());
            const std::vector<std::uint8_t> bytes(numbers.begin(), numbers.end());
            return add<std::uint8_t>(output + "_cluster", {vertices}, bytes, codec());
        }
        std::vector<std::uint64_t> shape = coefficient_axes(coeffs);
        if (!encoded.code.range.empty()) {
            shape.push_back(2);
            ENVBAKE_TRY_VOID(
                add<float>(output + "_range", shape, encoded.code.range, format::Codec::None));
            shape.pop_back();
        }
        shape.insert(shape.begin(), vertices);
        if (auto begun = writer_.begin({output, element_type(encoded.encoding), shape, codec()});
            !begun)
            return output_error(begun.error());
        constexpr std::size_t kRowsAtOnce = 4096;
        for (std::size_t at = 0; at < part.rows.size(); at += kRowsAtOnce * row_size) {
            const auto rows =
                part.rows.subspan(at, std::min(kRowsAtOnce * row_size, part.rows.size() - at));
            if (auto done = writer_.append(encode_rows(encoded.code, rows)); !done)
                return output_error(done.error());
        }
        if (auto ended = writer_.end(); !ended) return output_error(ended.error());
        return {};
    }

    static format::ElementType element_type(Encoding encoding) {
        switch (encoding) {
            case Encoding::F16:
                return format::ElementType::F16;
            case Encoding::Unorm16:
                return format::ElementType::U16;
            case Encoding::Unorm8:
                return format::ElementType::U8;
            default:
                return format::ElementType::F32;
        }
    }

    /// Adds the bounces to all that waited, and writes it, unless it waits for its encoding.
    Expected<void> bake(const std::string&, const PlannedBounces& bounces) {
        if (bounces.job.emission)
            for (std::size_t m = 0; m < transport_.size(); ++m)
                if (!transport_[m].rows.empty())
                    transport_[m].emitted.resize(3 * inputs_.scene->meshes[m].vertex_count(), 0);
        const BounceReport report =
            add_bounces(bounces.job, *inputs_.scene, *tracer_, blocked_, transport_);
        std::vector<BlockedRays>().swap(blocked_);
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
            const std::string output = concat("mesh/", m, "/diffuse");
            report_.array_errors[output] = {
                of_mesh.error_rms, "rms over vertices of |T - T_true|_2 / |T_unoccluded|_2"};
            if (encoded_) continue;
            keep_self_test_rows(m, 0, rows, coeffs * channels, transport_[m].emitted);
            std::vector<std::uint64_t> shape{rows.size() / (coeffs * channels), coeffs};
            if (channels > 1) shape.push_back(channels);
            ENVBAKE_TRY_VOID(add<float>(output, std::move(shape), rows, codec()));
            std::vector<float>().swap(rows);
        }
        return {};
    }

    Expected<void> bake(const std::string& output, const PlannedEmitted& planned) {
        const std::vector<float>& emitted = transport_[planned.mesh].emitted;
        report_.array_errors[output] = {report_.bounces->emitted_error_rms,
                                        "rms over the scene's vertices, relative to their rms"};
        return add<float>(output, {emitted.size() / 3, 3}, emitted, codec());
    }

    WaveletStage& wavelet(const WaveletJob& job) {
        if (!wavelet_) {
            wavelet_.emplace(job);
            report_.wavelet.emplace().face_size = job.face_size;
        }
        return *wavelet_;
    }

    Expected<void> bake(const std::string& output, const PlannedWavelet& planned) {
        ENVBAKE_TRY_VOID(build_tracer());
        WaveletStage& stage = wavelet(planned.job);
        const std::uint64_t vertex_count = inputs_.scene->meshes[planned.mesh].vertex_count();
        // Never compressed: a reader takes a few runs out of each block.
        if (auto begun = writer_.begin(
                {output + "/blocks", format::ElementType::U32, {format::kOpenEnded}, {}});
            !begun)
            return output_error(begun.error());
        const auto sink = [&](std::span<const std::byte> bytes) -> Expected<void> {
            if (auto appended = writer_.append(bytes); !appended)
                return output_error(appended.error());
            return {};
        };
        progress_.begin("wavelet transport", "vertices", vertex_count);
        std::vector<std::uint32_t> offsets;
        ENVBAKE_TRY(const WaveletReport report,
                    bake_wavelet(planned.job, stage.cube(), *inputs_.scene, planned.mesh, *tracer_,
                                 sink, offsets, stage.square_sums(), progress_));
        if (auto ended = writer_.end(); !ended) return output_error(ended.error());
        stage.add_mesh(planned.mesh, vertex_count);
        report_.wavelet->step = stage.step();
        report_.wavelet->meshes.emplace_back(planned.mesh, report);
        return add<std::uint32_t>(output + "/offsets", {offsets.size()}, offsets,
                                  format::Codec::None);
    }

    Expected<void> bake(const std::string& output, const PlannedWaveletWeights& planned) {
        wavelet_weights_ = wavelet(planned.job).weights();
        return add<float>(output, {wavelet_weights_.size()}, wavelet_weights_, format::Codec::None);
    }

    Expected<void> bake(const std::string& output, const PlannedWaveletLight& planned) {
        const WaveletStage::Lighting lighting = wavelet_->choose_lighting(
            *inputs_.environment, planned.channels, wavelet_weights_,
            inputs_.scene ? &*inputs_.scene : nullptr, tracer_ ? &*tracer_ : nullptr);
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
        for (const WaveletStage::Vertex& vertex : wavelet_->sample()) {
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

    Expected<void> build_tracer() {
        if (tracer_) return {};
        ENVBAKE_TRY(tracer_, Tracer::build(*inputs_.scene));
        return {};
    }

    /// The job with the mesh's part of the time that is left: by its share of the vertices that are
    /// still to be traced.
    DiffuseJob in_time(DiffuseJob job, std::size_t mesh) {
        if (request_.time_budget <= 0 || !job.shadowed) return job;
        constexpr double kForTheRest = 0.05;  // self-test, compression, the way to the disk
        const std::chrono::duration<double> elapsed =
            std::chrono::steady_clock::now() - inputs_.begun;
        const double left = (1 - kForTheRest) * request_.time_budget - elapsed.count();
        const auto vertices = static_cast<double>(inputs_.scene->meshes[mesh].vertex_count());
        job.seconds = std::max(left * vertices / vertices_to_trace_, 1e-9);
        vertices_to_trace_ -= vertices;
        return job;
    }

    /// Rows of one mesh, whatever waits for them, within the time that is left.
    Expected<DiffuseReport> trace(const DiffuseJob& job, std::size_t mesh,
                                  const std::function<Expected<void>(std::span<const float>)>& sink,
                                  BlockedRays* blocked = nullptr) {
        return bake_diffuse(in_time(job, mesh), *inputs_.scene, mesh, *tracer_, sink, progress_,
                            blocked);
    }

    /// One bar for the transport of all meshes, once the first of them begins.
    void announce_transport(const BakePlan& plan) {
        std::uint64_t total = 0;
        for (const PlannedStage& stage : plan.stages)
            if (stage.job) {
                const auto* diffuse = std::get_if<PlannedDiffuse>(&*stage.job);
                const auto* glossy = std::get_if<PlannedGlossy>(&*stage.job);
                std::uint64_t vertices = 0;
                if (diffuse != nullptr && !diffuse->from_glossy)
                    vertices = inputs_.scene->meshes[diffuse->mesh].vertex_count();
                if (glossy != nullptr)
                    vertices = inputs_.scene->meshes[glossy->mesh].vertex_count();
                total += vertices;
                if (glossy != nullptr || (diffuse != nullptr && diffuse->job.shadowed))
                    vertices_to_trace_ += static_cast<double>(vertices);
            }
        progress_.begin("diffuse transport", "vertices", total);
    }

    /// A few vertices spread evenly over all the baked meshes, two thirds of the way into each
    /// stretch.
    void choose_self_test_vertices(const BakePlan& plan) {
        constexpr std::uint64_t kCount = 32;
        std::uint64_t total = 0;
        std::vector<std::pair<std::size_t, std::uint64_t>> baked;  // mesh, vertices
        for (const PlannedStage& stage : plan.stages) {
            const auto* diffuse = stage.job ? std::get_if<PlannedDiffuse>(&*stage.job) : nullptr;
            if (diffuse == nullptr || !diffuse->job.shadowed) continue;
            baked.emplace_back(diffuse->mesh, inputs_.scene->meshes[diffuse->mesh].vertex_count());
            total += baked.back().second;
        }
        if (total == 0) return;
        const std::uint64_t count = std::min(kCount, total);
        std::uint64_t before = 0;
        std::size_t at = 0;
        for (std::uint64_t k = 0; k < count; ++k) {
            const std::uint64_t wanted = (3 * k + 2) * total / (3 * count);
            while (wanted - before >= baked[at].second) before += baked[at++].second;
            stored_.vertices.push_back({static_cast<std::uint32_t>(baked[at].first),
                                        static_cast<std::uint32_t>(wanted - before),
                                        {}});
        }
    }

    /// A few vertices of the first meshes.
    void choose_glossy_vertices(std::size_t mesh) {
        constexpr std::uint64_t kEach = 6, kMost = 12;
        const std::uint64_t count = inputs_.scene->meshes[mesh].vertex_count();
        for (std::uint64_t k = 0; k < std::min(kEach, count); ++k)
            if (stored_.glossy_vertices.size() < kMost)
                stored_.glossy_vertices.push_back({.mesh = static_cast<std::uint32_t>(mesh),
                                                   .vertex = static_cast<std::uint32_t>(
                                                       (3 * k + 2) * count / (3 * kEach) % count),
                                                   .visibility = {},
                                                   .transport = {}});
    }

    void keep_self_test_rows(std::size_t mesh, std::uint64_t first_vertex,
                             std::span<const float> rows, std::uint64_t row_size,
                             std::span<const float> emitted = {}) {
        const auto keep = [&](auto& vertex) {
            if (vertex.mesh != mesh || vertex.vertex < first_vertex) return;
            const std::uint64_t row = vertex.vertex - first_vertex;
            if (row >= rows.size() / row_size) return;
            const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(row * row_size);
            vertex.transport.assign(begin, begin + static_cast<std::ptrdiff_t>(row_size));
            vertex.channels = bounce_channels_;
            for (std::size_t c = 0; c < 3 && !emitted.empty(); ++c)
                vertex.emitted[static_cast<int>(c)] = static_cast<double>(emitted[3 * row + c]);
        };
        std::for_each(stored_.vertices.begin(), stored_.vertices.end(), keep);
        std::for_each(stored_.glossy_vertices.begin(), stored_.glossy_vertices.end(), keep);
    }

    Expected<void> write_self_test() {
        const SelfTest test = make_self_test(stored_);
        for (const auto* values :
             {&test.irradiance_value, &test.diffuse_value, &test.wavelet_value, &test.ggx.value,
              &test.beckmann.value, &test.ggx_glossy.value, &test.beckmann_glossy.value})
            ENVBAKE_TRY_VOID(require_finite(*values));
        report_.self_test_tolerance = SelfTest::kTolerance;
        const auto add_rows = [&](const char* name, std::uint64_t columns,
                                  const auto& values) -> Expected<void> {
            using T = typename std::decay_t<decltype(values)>::value_type;
            if (values.empty()) return {};
            return add<T>(name, {values.size() / columns, columns}, values, format::Codec::None);
        };
        ENVBAKE_TRY_VOID(add_rows("selftest/irradiance/normal", 3, test.irradiance_normal));
        ENVBAKE_TRY_VOID(add_rows("selftest/irradiance/value", 3, test.irradiance_value));
        ENVBAKE_TRY_VOID(add_rows("selftest/diffuse/vertex", 2, test.diffuse_vertex));
        ENVBAKE_TRY_VOID(add_rows("selftest/diffuse/value", 3, test.diffuse_value));
        ENVBAKE_TRY_VOID(add_rows("selftest/wavelet/vertex", 2, test.wavelet_vertex));
        ENVBAKE_TRY_VOID(add_rows("selftest/wavelet/value", 3, test.wavelet_value));
        ENVBAKE_TRY_VOID(add_rows("selftest/specular/input", 8, test.ggx.input));
        ENVBAKE_TRY_VOID(add_rows("selftest/specular/value", 3, test.ggx.value));
        ENVBAKE_TRY_VOID(add_rows("selftest/specular_beckmann/input", 8, test.beckmann.input));
        ENVBAKE_TRY_VOID(add_rows("selftest/specular_beckmann/value", 3, test.beckmann.value));
        const auto add_glossy = [&](const std::string& group,
                                    const SelfTest::Glossy& glossy) -> Expected<void> {
            ENVBAKE_TRY_VOID(add_rows((group + "vertex").c_str(), 2, glossy.vertex));
            ENVBAKE_TRY_VOID(add_rows((group + "input").c_str(), 5, glossy.input));
            return add_rows((group + "value").c_str(), 3, glossy.value);
        };
        ENVBAKE_TRY_VOID(add_glossy("selftest/glossy/", test.ggx_glossy));
        return add_glossy("selftest/glossy_beckmann/", test.beckmann_glossy);
    }

    const BakeRequest& request_;
    const BakeInputs& inputs_;
    format::Writer& writer_;
    Progress& progress_;
    std::optional<Tracer> tracer_;
    /// Rows of a mesh in the store.
    struct OnDisk {
        std::size_t mesh, begin, size;
    };
    bool encoded_ = false;           ///< transport waits for PlannedEncoding
    std::optional<RowStore> store_;  ///< what does so and does not wait for bounces
    std::vector<OnDisk> on_disk_;
    std::vector<MeshTransport> transport_;  ///< what waits for its bounces or its turn
    std::vector<BlockedRays> blocked_;      ///< the rays of that
    int bounce_channels_ = 1;
    std::optional<WaveletStage> wavelet_;
    std::vector<float> wavelet_weights_;
    double vertices_to_trace_ = 0;
    BakeReport report_;
    StoredArrays stored_;
};

}  // namespace

Expected<std::vector<std::string>> run_plan(const BakeRequest& request, const BakeInputs& inputs,
                                            const BakePlan& plan, Progress& progress) try {
    auto writer = format::Writer::create(request.output.string());
    if (!writer)
        return Error{Errc::Failed,
                     concat(request.output.string(), ": ", format::to_string(writer.error()))};
    ENVBAKE_TRY(auto shortfalls, Run(request, inputs, *writer, progress).execute(plan));
    if (auto finished = writer->finish(); !finished)
        return Error{Errc::Failed,
                     concat(request.output.string(), ": ", format::to_string(finished.error()))};
    return shortfalls;
} catch (const std::bad_alloc&) {
    return Error{Errc::Failed, "out of memory: bake a smaller scene, or fewer meshes at once"};
}

}  // namespace envbake
