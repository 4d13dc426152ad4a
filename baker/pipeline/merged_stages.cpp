// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/merged_stages.h"

#include "baker/core/text.h"
#include "baker/pipeline/array_values.h"

#include "envbake/runtime/lobe.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

namespace envbake {

namespace {

Error damaged(const std::filesystem::path& path, const std::string& name) {
    return {Errc::InvalidBundle,
            concat(path.string(), ": array ", name, " is damaged or lacks; bake this shard again")};
}

template <class T>
bool all_finite(std::span<const T> values) {
    if constexpr (std::is_floating_point_v<T>)
        return std::all_of(values.begin(), values.end(), [](T v) { return std::isfinite(v); });
    return true;
}

/// Decodes an array of so many elements, its checksum compared.
template <class T>
Expected<std::vector<T>> read(const ShardFile& shard, const std::string& name,
                              std::uint64_t count) {
    ENVBAKE_TRY(const format::Reader reader, open_bundle(shard.path));
    const auto info = reader.find(name);
    if (!info || info->type != format::kElementTypeOf<T> || info->element_count() != count ||
        !reader.verify(*info) || !reader.size_is_plausible(*info))
        return damaged(shard.path, name);
    std::vector<T> values(static_cast<std::size_t>(count));
    if (!reader.read(*info, std::as_writable_bytes(std::span(values))) || !all_finite<T>(values))
        return damaged(shard.path, name);
    return values;
}

/// Hands an array of some rows on where it lies.
///   most  rows
template <class T>
Expected<std::uint64_t> pass_on(const ShardFile& shard, const std::string& name,
                                std::uint64_t row_size, std::uint64_t most, const Sink<T>& sink) {
    using Element = std::conditional_t<std::is_same_v<T, std::byte>, std::uint8_t, T>;
    ENVBAKE_TRY(const format::Reader reader, open_bundle(shard.path));
    const auto info = reader.find(name);
    if (!info || info->type != format::kElementTypeOf<Element> ||
        info->codec != format::Codec::None || info->element_count() % row_size != 0 ||
        info->element_count() / row_size > most || !reader.verify(*info))
        return damaged(shard.path, name);
    const std::span<const std::byte> bytes = reader.stored_bytes(*info);
    const std::span rows(reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T));
    if (!all_finite(rows)) return damaged(shard.path, name);
    ENVBAKE_TRY_VOID(sink(rows));
    return info->element_count() / row_size;
}

Error unexpected(const ShardFile& shard, const std::string& output) {
    return {Errc::InvalidBundle, concat(shard.path.string(), ": says nothing usable of ", output,
                                        "; bake this shard again")};
}

}  // namespace

Expected<const ShardFile*> MergedStages::owner(const std::string& output) const {
    for (const ShardFile& shard : shards_)
        if (shard.results.contains(output)) return &shard;
    return unexpected(shards_.front(), output);
}

Expected<std::vector<MergedStages::Part>> MergedStages::parts(const std::string& output,
                                                              std::size_t mesh) const {
    std::vector<Part> parts;
    std::uint64_t next = 0;
    for (const ShardFile& shard : shards_) {
        if (!shard.results.contains(output)) continue;
        const Json& json = shard.results.at(output);
        parts.push_back({&shard, read_count(json.at("begin")), read_count(json.at("end")),
                         read_count(json.at("pieces")), json});
        if (parts.back().begin != next || parts.back().end <= next)
            return unexpected(shard, output);
        next = parts.back().end;
    }
    if (next != inputs_.facts.meshes[mesh].vertex_count)
        return unexpected(parts.empty() ? shards_.front() : *parts.back().shard, output);
    return parts;
}

Expected<std::vector<Mip>> MergedStages::mips(const std::string& output, const MipsJob& job) {
    ENVBAKE_TRY(const ShardFile* shard, owner(output));
    std::vector<Mip> mips;
    for (std::size_t i = 0; i < job.levels.size(); ++i) {
        Mip& mip = mips.emplace_back(empty_mip(job, i));
        shard->results.at(output).at(i).get_to(mip.error_estimate);
        ENVBAKE_TRY(mip.texels,
                    read<float>(*shard, concat(shard_name(output), "/", mip.level),
                                mip.texel_count() * static_cast<std::uint64_t>(mip.channels)));
    }
    return mips;
}

Expected<BrdfTable> MergedStages::table(const std::string& output, const BrdfTableJob& job) {
    ENVBAKE_TRY(const ShardFile* shard, owner(output));
    BrdfTable table;
    read_report(shard->results.at(output), table);
    if (table.size != job.size) return unexpected(*shard, output);
    const auto size = static_cast<std::uint64_t>(job.size);
    ENVBAKE_TRY(const std::vector<float> texels,
                read<float>(*shard, shard_name(output) + "/texels", 2 * size * size));
    for (std::size_t i = 0; i < texels.size(); i += 2)
        table.texels.emplace_back(texels[i], texels[i + 1]);
    ENVBAKE_TRY(table.average_albedo,
                read<float>(*shard, shard_name(output) + "/average_albedo", size));
    return table;
}

Expected<LobeExpansion> MergedStages::lobe(const std::string& output, const LobeExpansionJob& job) {
    ENVBAKE_TRY(const ShardFile* shard, owner(output));
    LobeExpansion lobe;
    shard->results.at(output).at("rows").get_to(lobe.rows);
    const auto floats = [&](const char* part, int bands) {
        return read<float>(
            *shard, shard_name(output) + part,
            static_cast<std::uint64_t>(lobe.rows) * 2 * runtime::lobe_size(job.exit_bands, bands));
    };
    ENVBAKE_TRY(lobe.unoccluded, floats("/unoccluded", job.light_bands));
    ENVBAKE_TRY(lobe.kernel, floats("/kernel", runtime::kLobeBands));
    return lobe;
}

Expected<DiffuseReport> MergedStages::rows(const std::string& output, const DiffuseJob& job,
                                           std::size_t mesh, bool for_bounces,
                                           const Sink<float>& sink) {
    ENVBAKE_TRY(const std::vector<Part> all, parts(output, mesh));
    const auto bands = static_cast<std::uint64_t>(std::max(job.bands, job.row_bands));
    DiffuseReport whole;
    for (const Part& part : all) {
        DiffuseReport report;
        read_report(part.result.at("report"), report);
        if (part.begin == 0) {
            whole = report;
        } else {
            // The choice of rays is made again for each part, and comes out the same.
            if (!(report.crossing_error == whole.crossing_error) ||
                report.row_error != whole.row_error ||
                report.check_ray_count != whole.check_ray_count ||
                report.rays_per_vertex != whole.rays_per_vertex)
                return Error{Errc::InvalidBundle,
                             concat(part.shard->path.string(), ": ", output,
                                    " was traced otherwise than in the shards before it: by "
                                    "another binary, or another instruction set (--isa)")};
            append(whole, report);
        }
        std::uint64_t vertices = 0;
        for (std::uint64_t piece = 0; piece < part.pieces; ++piece) {
            ENVBAKE_TRY(const std::uint64_t some,
                        pass_on(*part.shard, concat(shard_name(output), "/", piece), bands * bands,
                                part.end - part.begin - vertices, sink));
            vertices += some;
            progress_.add(some);
        }
        if (vertices != part.end - part.begin) return unexpected(*part.shard, output);
    }
    if (for_bounces) ENVBAKE_TRY_VOID(read_blocked(output, job, mesh, all));
    return whole;
}

Expected<std::vector<float>> MergedStages::normals(std::size_t mesh) {
    ENVBAKE_TRY(const std::vector<Part> all, parts(concat("mesh/", mesh, "/glossy"), mesh));
    std::vector<float> normals;
    for (const Part& part : all) {
        ENVBAKE_TRY(const std::vector<float> some,
                    read<float>(*part.shard, shard_name(concat("mesh/", mesh, "/normal")),
                                3 * (part.end - part.begin)));
        normals.insert(normals.end(), some.begin(), some.end());
    }
    return normals;
}

Expected<void> MergedStages::read_blocked(const std::string& output, const DiffuseJob& job,
                                          std::size_t mesh, std::span<const Part> parts) {
    const Json& first = parts.front().result;
    DiffuseReport report;
    read_report(first.at("report"), report);
    const auto packets = read_count(first.at("packets"));
    if (packets == 0) return {};
    if (packets * 16 != static_cast<std::uint64_t>(report.rays_per_vertex) ||
        report.rays_per_vertex > kMaxRays)
        return unexpected(*parts.front().shard, output);
    BlockedRays& blocked = blocked_[mesh];
    blocked.seed = job.seed;
    blocked.set = make_ray_set(report.rays_per_vertex, job.bands, first.at("pilot") == true);
    for (const Part& part : parts) {
        if (packets != blocked.set.directions.size() || part.result.at("packets") != packets ||
            part.result.at("pilot") != first.at("pilot"))
            return unexpected(*part.shard, output);
        ENVBAKE_TRY(const std::vector<std::uint16_t> masks,
                    read<std::uint16_t>(*part.shard, shard_name(output) + "/blocked",
                                        (part.end - part.begin) * packets));
        blocked.masks.insert(blocked.masks.end(), masks.begin(), masks.end());
    }
    return {};
}

/// The only stage that is not cut: a place reflects what all the others get.
Expected<BounceReport> MergedStages::bounces(const BounceJob& job,
                                             std::span<MeshTransport> transport) {
    ENVBAKE_TRY(const Tracer tracer, Tracer::build(*inputs_.scene, isa_));
    return add_bounces(job, *inputs_.scene, tracer, blocked_, transport, progress_);
}

Expected<WaveletReport> MergedStages::wavelet(const std::string& output, const WaveletJob&,
                                              std::size_t mesh, const Sink<std::byte>& sink,
                                              std::vector<std::uint32_t>& offsets,
                                              std::span<std::uint64_t> square_sums) {
    ENVBAKE_TRY(const std::vector<Part> all, parts(output, mesh));
    WaveletReport whole;
    offsets.assign(1, 0);
    for (const Part& part : all) {
        WaveletReport report;
        read_report(part.result.at("report"), report);
        append(whole, report);
        const std::uint64_t blocks = (part.end - part.begin + kWaveletBlock - 1) / kWaveletBlock;
        ENVBAKE_TRY(const std::vector<std::uint32_t> ends,
                    read<std::uint32_t>(*part.shard, shard_name(output) + "/offsets", blocks + 1));
        if (ends.front() != 0 || !std::is_sorted(ends.begin(), ends.end()))
            return unexpected(*part.shard, output);
        const std::uint64_t before = offsets.back();
        if (before + ends.back() > std::numeric_limits<std::uint32_t>::max())
            return wavelets_too_large(mesh);
        for (std::size_t b = 1; b < ends.size(); ++b)
            offsets.push_back(static_cast<std::uint32_t>(before + ends[b]));
        ENVBAKE_TRY(const std::vector<std::uint32_t> words,
                    read<std::uint32_t>(*part.shard, shard_name(output) + "/square_sums",
                                        2 * square_sums.size()));
        for (std::size_t i = 0; i < square_sums.size(); ++i)
            square_sums[i] += words[2 * i] + (std::uint64_t{words[2 * i + 1]} << 32);
        std::uint64_t bytes = 0;
        for (std::uint64_t piece = 0; piece < part.pieces; ++piece) {
            ENVBAKE_TRY(const std::uint64_t some,
                        pass_on(*part.shard, concat(shard_name(output), "/", piece), 1,
                                4 * std::uint64_t{ends.back()} - bytes, sink));
            bytes += some;
        }
        if (bytes != 4 * std::uint64_t{ends.back()}) return unexpected(*part.shard, output);
        progress_.add(part.end - part.begin);
    }
    return whole;
}

Expected<WaveletLight> MergedStages::wavelet_light(const std::string& output, const WaveletJob& job,
                                                   int, std::span<const WaveletMesh>) {
    ENVBAKE_TRY(const ShardFile* shard, owner(output));
    const std::uint64_t count = wavelet::coeff_count(job.face_size);
    WaveletLight light;
    ENVBAKE_TRY(const std::vector<float> coeffs,
                read<float>(*shard, shard_name(output) + "/coeffs", 3 * count));
    for (std::size_t i = 0; i < coeffs.size(); i += 3)
        light.coeffs.push_back({coeffs[i], coeffs[i + 1], coeffs[i + 2]});
    const auto sample = read_count(shard->results.at(output).at("sample"));
    for (std::uint64_t i = 0; i < sample; ++i) {
        const std::string name = concat(shard_name(output), "/", i);
        ENVBAKE_TRY(const std::vector<std::uint32_t> which,
                    read<std::uint32_t>(*shard, name + "/vertex", 2));
        WaveletLight::Vertex& vertex = light.sample.emplace_back();
        vertex.mesh = which[0];
        vertex.vertex = which[1];
        ENVBAKE_TRY(vertex.stored, read<float>(*shard, name + "/stored", count));
        ENVBAKE_TRY(vertex.looked, read<float>(*shard, name + "/looked", count));
    }
    return light;
}

}  // namespace envbake
