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

std::string name_of(const std::string& output) {
    return concat("shard/", output);
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
                         read_count(json.at("pieces")), json.at("report")});
        if (parts.back().begin != next || parts.back().end <= next)
            return unexpected(shard, output);
        next = parts.back().end;
    }
    if (next != facts_.meshes[mesh].vertex_count)
        return unexpected(parts.empty() ? shards_.front() : *parts.back().shard, output);
    return parts;
}

Expected<std::vector<Mip>> MergedStages::mips(const std::string& output, const MipsJob& job) {
    ENVBAKE_TRY(const ShardFile* shard, owner(output));
    std::vector<Mip> mips;
    for (const Json& of_mip : shard->results.at(output)) {
        Mip& mip = mips.emplace_back();
        read_report(of_mip, mip);
        if (mips.size() > job.levels.size() || mip.level != job.levels[mips.size() - 1] ||
            mip.channels != job.channels || (mip.faces != 1 && mip.faces != 6) || mip.width < 1 ||
            mip.height < 1 || mip.width > 4 * job.face_size || mip.height > 2 * job.face_size)
            return unexpected(*shard, output);
        ENVBAKE_TRY(mip.texels, read<float>(*shard, concat(name_of(output), "/", mip.level),
                                            static_cast<std::uint64_t>(mip.faces) *
                                                static_cast<std::uint64_t>(mip.width) *
                                                static_cast<std::uint64_t>(mip.height) *
                                                static_cast<std::uint64_t>(mip.channels)));
    }
    if (mips.size() != job.levels.size()) return unexpected(*shard, output);
    return mips;
}

Expected<BrdfTable> MergedStages::table(const std::string& output, const BrdfTableJob& job) {
    ENVBAKE_TRY(const ShardFile* shard, owner(output));
    BrdfTable table;
    read_report(shard->results.at(output), table);
    if (table.size != job.size) return unexpected(*shard, output);
    const auto size = static_cast<std::uint64_t>(job.size);
    ENVBAKE_TRY(const std::vector<float> texels,
                read<float>(*shard, name_of(output) + "/texels", 2 * size * size));
    for (std::size_t i = 0; i < texels.size(); i += 2)
        table.texels.emplace_back(texels[i], texels[i + 1]);
    ENVBAKE_TRY(table.average_albedo,
                read<float>(*shard, name_of(output) + "/average_albedo", size));
    return table;
}

Expected<LobeExpansion> MergedStages::lobe(const std::string& output, const LobeExpansionJob& job) {
    ENVBAKE_TRY(const ShardFile* shard, owner(output));
    LobeExpansion lobe;
    shard->results.at(output).at("rows").get_to(lobe.rows);
    const auto floats = [&](const char* part, int bands) {
        return read<float>(
            *shard, name_of(output) + part,
            static_cast<std::uint64_t>(lobe.rows) * 2 * runtime::lobe_size(job.exit_bands, bands));
    };
    ENVBAKE_TRY(lobe.unoccluded, floats("/unoccluded", job.light_bands));
    ENVBAKE_TRY(lobe.kernel, floats("/kernel", runtime::kLobeBands));
    return lobe;
}

Expected<DiffuseReport> MergedStages::rows(const std::string& output, const DiffuseJob& job,
                                           std::size_t mesh, bool, const Sink<float>& sink) {
    ENVBAKE_TRY(const std::vector<Part> all, parts(output, mesh));
    const auto bands = static_cast<std::uint64_t>(std::max(job.bands, job.row_bands));
    DiffuseReport whole;
    for (const Part& part : all) {
        DiffuseReport report;
        read_report(part.report, report);
        if (part.begin == 0) {
            whole = report;
        } else {
            // The choice of rays is made again for each part, and comes out the same.
            if (!(report.crossing_error == whole.crossing_error) ||
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
                        pass_on(*part.shard, concat(name_of(output), "/", piece), bands * bands,
                                part.end - part.begin - vertices, sink));
            vertices += some;
            progress_.add(some);
        }
        if (vertices != part.end - part.begin) return unexpected(*part.shard, output);
    }
    return whole;
}

Expected<std::vector<float>> MergedStages::normals(std::size_t mesh) {
    ENVBAKE_TRY(const std::vector<Part> all, parts(concat("mesh/", mesh, "/glossy"), mesh));
    std::vector<float> normals;
    for (const Part& part : all) {
        ENVBAKE_TRY(const std::vector<float> some,
                    read<float>(*part.shard, concat("shard/mesh/", mesh, "/normal"),
                                3 * (part.end - part.begin)));
        normals.insert(normals.end(), some.begin(), some.end());
    }
    return normals;
}

Expected<BounceReport> MergedStages::bounces(const BounceJob&, std::span<MeshTransport>) {
    return unexpected(shards_.front(), "bounces");
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
        read_report(part.report, report);
        append(whole, report);
        const std::uint64_t blocks = (part.end - part.begin + kWaveletBlock - 1) / kWaveletBlock;
        ENVBAKE_TRY(const std::vector<std::uint32_t> ends,
                    read<std::uint32_t>(*part.shard, name_of(output) + "/offsets", blocks + 1));
        if (ends.front() != 0 || !std::is_sorted(ends.begin(), ends.end()))
            return unexpected(*part.shard, output);
        const std::uint64_t before = offsets.back();
        if (before + ends.back() > std::numeric_limits<std::uint32_t>::max())
            return wavelets_too_large(mesh);
        for (std::size_t b = 1; b < ends.size(); ++b)
            offsets.push_back(static_cast<std::uint32_t>(before + ends[b]));
        ENVBAKE_TRY(const std::vector<std::uint32_t> words,
                    read<std::uint32_t>(*part.shard, name_of(output) + "/square_sums",
                                        2 * square_sums.size()));
        for (std::size_t i = 0; i < square_sums.size(); ++i)
            square_sums[i] += words[2 * i] + (std::uint64_t{words[2 * i + 1]} << 32);
        std::uint64_t bytes = 0;
        for (std::uint64_t piece = 0; piece < part.pieces; ++piece) {
            ENVBAKE_TRY(const std::uint64_t some,
                        pass_on(*part.shard, concat(name_of(output), "/", piece), 1,
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
                read<float>(*shard, name_of(output) + "/coeffs", 3 * count));
    for (std::size_t i = 0; i < coeffs.size(); i += 3)
        light.coeffs.push_back({coeffs[i], coeffs[i + 1], coeffs[i + 2]});
    const auto sample = read_count(shard->results.at(output).at("sample"));
    for (std::uint64_t i = 0; i < sample; ++i) {
        const std::string name = concat(name_of(output), "/", i);
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
