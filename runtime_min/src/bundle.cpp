// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/bundle.h"

#include "envbake/runtime/sh.h"
#include "json_cursor.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <limits>
#include <new>
#include <optional>
#include <utility>

namespace envbake::runtime {

using format::ArrayInfo;
using format::ElementType;
using format::Errc;
using format::Error;

namespace {

constexpr std::uint64_t kAlignment = 64;
constexpr std::uint64_t kMaxMeshes = 1u << 24;
constexpr std::uint64_t kMaxMipWidth = 1u << 15;
constexpr std::uint64_t kMaxTableSize = 1u << 12;
constexpr std::uint64_t kMaxClusters = 1u << 16;

/// "mesh/12/diffuse", on the stack.
class Name {
  public:
    Name(std::string_view head, std::uint64_t index, std::string_view tail = {}) noexcept {
        add(head);
        size_ = static_cast<std::size_t>(
            std::to_chars(text_.data() + size_, text_.data() + text_.size(), index).ptr -
            text_.data());
        add(tail);
    }
    operator std::string_view() const noexcept { return {text_.data(), size_}; }

  private:
    void add(std::string_view part) noexcept {
        size_ += part.copy(text_.data() + size_, text_.size() - size_);
    }
    std::array<char, 64> text_{};
    std::size_t size_ = 0;
};

/// n where coeff_count is n^2 for some n in 1 .. 10, otherwise 0.
int bands_of(std::uint64_t coeff_count) {
    for (int bands = 1; bands <= sh::kMaxBundleBands; ++bands) {
        if (coeff_count == static_cast<std::uint64_t>(sh::coeff_count(bands))) return bands;
    }
    return 0;
}

Error error_in(Errc code, const ArrayInfo& info) {
    return Error::at(code, info.offset, info.name);
}

/// Both lobes have the same mirror: a bundle of both stores it once, with GGX.
void share_mirror(const MipsView& ggx, MipsView& beckmann) {
    if (beckmann.first == 1 && ggx.level_count == beckmann.level_count && ggx.first == 0 &&
        ggx.layout == beckmann.layout) {
        beckmann.first = 0;
        beckmann.levels[0] = ggx.levels[0];
    }
}

}  // namespace

/// The arrays and metadata fields of one distribution.
struct Bundle::LobeNames {
    std::string_view mip, mip_count, mip_levels, table, axes, average_albedo;
    std::string_view lobe, unoccluded, kernel;
};

/// Hands out pieces of the one block. Without memory it only adds up what will be needed: the same
/// code runs twice.
class Bundle::Arena {
  public:
    explicit Arena(std::byte* memory = nullptr) noexcept : memory_(memory) {}

    bool has_memory() const noexcept { return memory_ != nullptr; }
    std::uint64_t used() const noexcept { return used_; }
    bool overflowed() const noexcept {
        return used_ > std::numeric_limits<std::uint64_t>::max() / 4;
    }

    std::byte* take(std::uint64_t bytes) noexcept {
        std::byte* piece = has_memory() ? memory_ + used_ : nullptr;
        if (overflowed() || bytes > std::numeric_limits<std::uint64_t>::max() / 4) {
            used_ = std::numeric_limits<std::uint64_t>::max();
        } else {
            used_ += (bytes + kAlignment - 1) / kAlignment * kAlignment;
        }
        return piece;
    }

  private:
    std::byte* memory_;
    std::uint64_t used_ = 0;
};

void Bundle::Free::operator()(std::byte* block) const noexcept {
    ::operator delete(block, std::align_val_t(kAlignment));
}

format::Expected<Bundle> Bundle::open(const char* path) noexcept {
    return load(format::Reader::open(path));
}

format::Expected<Bundle> Bundle::open(std::span<const std::byte> bytes) noexcept {
    return load(format::Reader::open(bytes));
}

format::Expected<Bundle> Bundle::load(format::Expected<format::Reader> reader) noexcept {
    if (!reader) return std::move(reader).error();
    if (const std::optional<ArrayInfo> part = reader->find(format::kShardName))
        return Error::at(Errc::Shard, part->offset, format::kShardName);
    Bundle bundle(*std::move(reader));

    Arena measure;
    ENVBAKE_TRY_VOID(bundle.resolve(measure));
    // Decoded arrays are bounded by the reader. What stands for meshes and wavelet terms grows with
    // the file, by 7 bytes for each of its bytes at most.
    const std::uint64_t file_size = bundle.reader().file().size();
    if (measure.used() > std::max(std::uint64_t{16u << 20}, 24 * file_size))
        return Error::at(Errc::DecodedSize);
    if (measure.used() > 0) {
        void* memory = nullptr;
        if (!measure.overflowed() && measure.used() <= std::numeric_limits<std::size_t>::max()) {
            memory = ::operator new(static_cast<std::size_t>(measure.used()),
                                    std::align_val_t(kAlignment), std::nothrow);
        }
        if (memory == nullptr) {
            Error error = Error::at(Errc::CannotRead);
            error.system_error = ENOMEM;
            return error;
        }
        bundle.block_.reset(static_cast<std::byte*>(memory));
        Arena arena(bundle.block_.get());
        ENVBAKE_TRY_VOID(bundle.resolve(arena));
    }
    return bundle;
}

format::Expected<void> Bundle::resolve(Arena& arena) noexcept {
    constexpr LobeNames kGgx{"environment/mips/",       "environment/mips/count",
                             "environment/mips/levels", "brdf/ggx",
                             "brdf/ggx/axes",           "brdf/ggx_average_albedo",
                             "brdf/ggx_lobe",           "brdf/ggx_lobe/unoccluded",
                             "brdf/ggx_lobe/kernel"};
    constexpr LobeNames kBeckmann{"environment/mips_beckmann/",
                                  "environment/mips_beckmann/count",
                                  "environment/mips_beckmann/levels",
                                  "brdf/beckmann",
                                  "brdf/beckmann/axes",
                                  "brdf/beckmann_average_albedo",
                                  "brdf/beckmann_lobe",
                                  "brdf/beckmann_lobe/unoccluded",
                                  "brdf/beckmann_lobe/kernel"};
    ENVBAKE_TRY_VOID(resolve_lighting(arena));
    ENVBAKE_TRY_VOID(resolve_lights(arena));
    ENVBAKE_TRY_VOID(resolve_mips(kGgx, ggx_.mips, arena));
    ENVBAKE_TRY_VOID(resolve_mips(kBeckmann, beckmann_.mips, arena));
    share_mirror(ggx_.mips, beckmann_.mips);
    ENVBAKE_TRY_VOID(resolve_brdf(kGgx, ggx_.brdf, arena));
    ENVBAKE_TRY_VOID(resolve_brdf(kBeckmann, beckmann_.brdf, arena));
    ENVBAKE_TRY_VOID(resolve_glossy_lobe(kGgx, ggx_.glossy, arena));
    ENVBAKE_TRY_VOID(resolve_glossy_lobe(kBeckmann, beckmann_.glossy, arena));
    ENVBAKE_TRY_VOID(resolve_wavelet_lighting(arena));
    ENVBAKE_TRY_VOID(resolve_cluster_basis(arena));
    return resolve_meshes(arena);
}

Error Bundle::metadata_error() const noexcept {
    const std::optional<ArrayInfo> info = reader_.find(format::kMetadataName);
    return Error::at(Errc::Metadata, info ? info->offset : 0, format::kMetadataName);
}

format::Expected<const void*> Bundle::place_bytes(const ArrayInfo& info,
                                                  Arena& arena) const noexcept {
    if (info.codec == format::Codec::None) {
        return static_cast<const void*>(reader_.stored_bytes(info).data());
    }
    if (!reader_.size_is_plausible(info)) return error_in(Errc::ArrayDecode, info);
    std::byte* piece = arena.take(info.size);
    if (arena.has_memory()) {
        ENVBAKE_TRY_VOID(reader_.read(info, {piece, static_cast<std::size_t>(info.size)}));
    }
    return static_cast<const void*>(piece);
}

format::Expected<FloatView> Bundle::place(const ArrayInfo& info, Arena& arena) const noexcept {
    if (info.type != ElementType::F32 && info.type != ElementType::F16) {
        return error_in(Errc::ArrayType, info);
    }
    ENVBAKE_TRY(const void* data, place_bytes(info, arena));
    return FloatView{data, info.element_count(), info.type == ElementType::F16};
}

format::Expected<void> Bundle::resolve_lighting(Arena& arena) noexcept {
    const std::optional<ArrayInfo> info = reader_.find("environment/sh");
    if (!info) return {};
    if (info->type != ElementType::F32) return error_in(Errc::ArrayType, *info);
    const std::uint64_t coeffs = info->shape[0];
    lighting_.bands = bands_of(coeffs);
    const bool grey = info->shape[1] == 1;
    if (info->rank != 2 || lighting_.bands == 0 || (info->shape[1] != 3 && !grey)) {
        return error_in(Errc::ArrayShape, *info);
    }
    ENVBAKE_TRY(const FloatView view, place(*info, arena));
    const float* values = static_cast<const float*>(view.data);
    if (grey) {
        float* rgb = reinterpret_cast<float*>(arena.take(3 * coeffs * sizeof(float)));
        for (std::uint64_t i = 0; rgb != nullptr && i < 3 * coeffs; ++i) rgb[i] = values[i / 3];
        values = rgb;
    }
    lighting_.coeffs = {values, values != nullptr ? static_cast<std::size_t>(3 * coeffs) : 0};
    return {};
}

format::Expected<void> Bundle::resolve_lights(Arena& arena) noexcept {
    const std::optional<ArrayInfo> info = reader_.find("environment/lights");
    if (!info) return {};
    if (info->type != ElementType::F32) return error_in(Errc::ArrayType, *info);
    constexpr std::uint64_t kColumns = sizeof(DominantLight) / sizeof(float);
    if (info->rank != 2 || info->shape[1] != kColumns) return error_in(Errc::ArrayShape, *info);
    ENVBAKE_TRY(const FloatView view, place(*info, arena));
    const auto* rows = static_cast<const DominantLight*>(view.data);
    lights_ = {rows, rows != nullptr ? static_cast<std::size_t>(info->shape[0]) : 0};
    const std::optional<JsonCursor> extracted =
        JsonCursor(reader_.metadata()).find("environment/lights/extracted");
    lights_extracted_ = extracted && extracted->is_true();
    return {};
}

Distribution Bundle::distribution() const noexcept {
    const auto has = [](const Lobe& lobe) {
        return lobe.mips.level_count > 0 || lobe.brdf.rows > 0 || lobe.glossy.rows > 0;
    };
    const bool has_ggx = has(ggx_), has_beckmann = has(beckmann_);
    return has_beckmann && !has_ggx ? Distribution::Beckmann : Distribution::Ggx;
}

format::Expected<void> Bundle::resolve_mips(const LobeNames& names, MipsView& mips,
                                            Arena& arena) noexcept {
    bool any = false;
    for (int k = 0; k < kMaxMipLevels; ++k) {
        const Name name(names.mip, static_cast<std::uint64_t>(k));
        const std::optional<ArrayInfo> info = reader_.find(name);
        if (!info) continue;
        const bool cube = info->rank == 4;
        const MipLayout layout = cube ? MipLayout::CubeFaces : MipLayout::LatLong;
        const std::uint64_t* size = info->shape.data() + (cube ? 1 : 0);  // height, width, channels
        const bool square = cube && info->shape[0] == 6 && size[1] == size[0];
        const bool image = info->rank == 3 && size[0] % 2 == 0 && size[1] == 2 * size[0];
        if (!(square || image) || size[0] < 1 || size[1] > kMaxMipWidth ||
            (size[2] != 3 && size[2] != 1) || (any && layout != mips.layout)) {
            return error_in(Errc::ArrayShape, *info);
        }
        if (!any) mips.first = k;
        if (any && mips.last != k - 1) {
            return Error::at(Errc::ArrayMissing, 0,
                             Name(names.mip, static_cast<std::uint64_t>(k - 1)));
        }
        any = true;
        mips.last = k;
        mips.layout = layout;
        MipLevel& level = mips.levels[static_cast<std::size_t>(k)];
        level.height = static_cast<int>(size[0]);
        level.width = static_cast<int>(size[1]);
        level.channels = static_cast<int>(size[2]);
        ENVBAKE_TRY(level.texels, place(*info, arena));
    }
    if (!any) return {};

    const JsonCursor metadata(reader_.metadata());
    const std::optional<JsonCursor> count_field = metadata.find(names.mip_count);
    const std::optional<std::uint64_t> count =
        count_field ? count_field->integer() : std::optional<std::uint64_t>{};
    if (!count || *count > kMaxMipLevels || *count <= static_cast<std::uint64_t>(mips.last)) {
        return metadata_error();
    }
    mips.level_count = static_cast<int>(*count);

    // The roughness of a level follows from its number; a bundle that says otherwise is not ours
    // to interpret.
    const std::optional<JsonCursor> levels = metadata.find(names.mip_levels);
    const bool agrees = levels && levels->for_each_element([&](const JsonCursor& entry) {
        const std::optional<JsonCursor> level_field = entry.find("level");
        const std::optional<JsonCursor> roughness_field = entry.find("roughness");
        if (!level_field || !roughness_field) return false;
        const std::optional<std::uint64_t> level = level_field->integer();
        const std::optional<double> roughness = roughness_field->number();
        if (!level || *level >= *count || !roughness) return false;
        const double expected =
            *count > 1 ? static_cast<double>(*level) / static_cast<double>(*count - 1) : 0;
        return std::abs(*roughness - expected) < 1e-4;
    });
    if (!agrees) return metadata_error();
    return {};
}

format::Expected<void> Bundle::resolve_brdf(const LobeNames& names, BrdfTableView& brdf,
                                            Arena& arena) noexcept {
    const std::optional<ArrayInfo> info = reader_.find(names.table);
    if (!info) return {};
    const bool in_range = info->shape[0] >= 2 && info->shape[0] <= kMaxTableSize &&
                          info->shape[1] >= 2 && info->shape[1] <= kMaxTableSize;
    if (info->rank != 3 || !in_range || info->shape[2] != 2) {
        return error_in(Errc::ArrayShape, *info);
    }
    const std::optional<JsonCursor> field = JsonCursor(reader_.metadata()).find(names.axes);
    const std::optional<std::string_view> axes =
        field ? field->string() : std::optional<std::string_view>{};
    if (axes == "roots") {
        brdf.axes = TableAxes::RootsEndPoints;
    } else if (axes == "linear") {
        brdf.axes = TableAxes::LinearCentres;
    } else {
        return metadata_error();
    }
    brdf.rows = static_cast<int>(info->shape[0]);
    brdf.columns = static_cast<int>(info->shape[1]);
    ENVBAKE_TRY(brdf.texels, place(*info, arena));
    if (const std::optional<ArrayInfo> average = reader_.find(names.average_albedo)) {
        if (average->rank != 1 || average->shape[0] != info->shape[0]) {
            return error_in(Errc::ArrayShape, *average);
        }
        ENVBAKE_TRY(brdf.average_albedo, place(*average, arena));
    }
    return {};
}

format::Expected<void> Bundle::resolve_glossy_lobe(const LobeNames& names, LobeView& lobe,
                                                   Arena& arena) noexcept {
    const std::optional<ArrayInfo> unoccluded = reader_.find(names.unoccluded);
    if (!unoccluded) return {};
    const std::optional<JsonCursor> facts = JsonCursor(reader_.metadata()).find(names.lobe);
    if (!facts) return metadata_error();
    const auto bands = [&](std::string_view key) {
        const std::optional<JsonCursor> field = facts->find(key);
        const std::optional<std::uint64_t> number =
            field ? field->integer() : std::optional<std::uint64_t>{};
        return number && *number <= kMaxGlossyBands ? static_cast<int>(*number) : 0;
    };
    lobe.exit_bands = bands("exit_bands");
    lobe.light_bands = bands("light_bands");
    std::array<double, 2> roughness{};
    std::size_t count = 0;
    const std::optional<JsonCursor> range = facts->find("roughness");
    const bool has_range = range && range->for_each_element([&](const JsonCursor& entry) {
        const std::optional<double> number = entry.number();
        if (!number || count == 2 || !(*number >= 0 && *number <= 1)) return false;
        roughness[count++] = *number;
        return true;
    });
    if (lobe.exit_bands == 0 || lobe.light_bands == 0 || !has_range || count != 2 ||
        roughness[0] > roughness[1]) {
        return metadata_error();
    }
    lobe.min_roughness = static_cast<float>(roughness[0]);
    lobe.max_roughness = static_cast<float>(roughness[1]);

    const std::optional<ArrayInfo> kernel = reader_.find(names.kernel);
    if (!kernel) return Error::at(Errc::ArrayMissing, 0, names.kernel);
    const auto is_of = [&](const ArrayInfo& info, int columns) {
        return info.rank == 3 && info.shape[0] == unoccluded->shape[0] && info.shape[1] == 2 &&
               info.shape[2] == lobe_size(lobe.exit_bands, columns);
    };
    const std::uint64_t rows = unoccluded->shape[0];
    if (!is_of(*unoccluded, lobe.light_bands) || rows < 1 || rows > kMaxTableSize ||
        (rows == 1) != (roughness[0] == roughness[1])) {
        return error_in(Errc::ArrayShape, *unoccluded);
    }
    if (!is_of(*kernel, kLobeBands)) return error_in(Errc::ArrayShape, *kernel);
    lobe.rows = static_cast<int>(rows);
    ENVBAKE_TRY(lobe.unoccluded, place(*unoccluded, arena));
    ENVBAKE_TRY(lobe.kernel, place(*kernel, arena));
    return {};
}

format::Expected<void> Bundle::resolve_glossy(std::uint64_t mesh, GlossyView& glossy,
                                              Arena& arena) const noexcept {
    const std::optional<ArrayInfo> visibility = reader_.find(Name("mesh/", mesh, "/glossy"));
    if (!visibility) return {};
    const Name normal_name("mesh/", mesh, "/normal");
    const std::optional<ArrayInfo> normals = reader_.find(normal_name);
    if (!normals) return Error::at(Errc::ArrayMissing, 0, normal_name);
    for (int bands = 1; bands <= kMaxGlossyBands; ++bands) {
        const int of_visibility = bands + kExtraVisibilityBands;
        if (visibility->shape[1] == static_cast<std::uint64_t>(of_visibility * of_visibility))
            glossy.light_bands = bands;
    }
    if (visibility->rank != 2 || glossy.light_bands == 0 ||
        visibility->shape[0] != glossy.vertex_count) {
        return error_in(Errc::ArrayShape, *visibility);
    }
    if (normals->rank != 2 || normals->shape[0] != glossy.vertex_count || normals->shape[1] != 3) {
        return error_in(Errc::ArrayShape, *normals);
    }
    ENVBAKE_TRY(glossy.visibility, place(*visibility, arena));
    ENVBAKE_TRY(glossy.normals, place(*normals, arena));

    const std::optional<ArrayInfo> reflected = reader_.find(Name("mesh/", mesh, "/reflected"));
    if (!reflected) return {};
    const bool coloured = reflected->rank == 4 && reflected->shape[3] == 3;
    const int bands = bands_of(reflected->shape[1] + 1);
    if (!(reflected->rank == 3 || coloured) || reflected->shape[0] != glossy.vertex_count ||
        bands < 2 || bands > std::min(kMaxReflectedBands, glossy.light_bands) ||
        bands_of(reflected->shape[2]) != glossy.light_bands) {
        return error_in(Errc::ArrayShape, *reflected);
    }
    glossy.reflected_bands = bands;
    glossy.reflected_channels = coloured ? 3 : 1;
    ENVBAKE_TRY(glossy.reflected, place(*reflected, arena));
    return {};
}

format::Expected<void> Bundle::resolve_cluster_basis(Arena& arena) noexcept {
    const std::optional<ArrayInfo> info = reader_.find("mesh/diffuse_basis");
    if (!info) return {};
    const bool coloured = info->rank == 4 && info->shape[3] == 3;
    cluster_basis_.bands = bands_of(info->shape[2]);
    if ((info->rank != 3 && !coloured) || cluster_basis_.bands == 0 || info->shape[0] < 1 ||
        info->shape[0] > kMaxClusters || info->shape[1] < 2 ||
        info->shape[1] > 1 + static_cast<std::uint64_t>(kMaxClusterWeights)) {
        return error_in(Errc::ArrayShape, *info);
    }
    cluster_basis_.channels = coloured ? 3 : 1;
    cluster_basis_.cluster_count = static_cast<std::uint32_t>(info->shape[0]);
    cluster_basis_.weight_count = static_cast<int>(info->shape[1]) - 1;
    ENVBAKE_TRY(cluster_basis_.rows, place(*info, arena));
    return {};
}

format::Expected<void> Bundle::resolve_clustered(std::uint64_t index, const ArrayInfo& weights,
                                                 TransportView& transport, Arena& arena) noexcept {
    const Name name("mesh/", index, "/diffuse_cluster");
    const std::optional<ArrayInfo> clusters = reader_.find(name);
    if (!clusters) return Error::at(Errc::ArrayMissing, 0, name);
    if (cluster_basis_.cluster_count == 0) {
        return Error::at(Errc::ArrayMissing, 0, "mesh/diffuse_basis");
    }
    if (weights.type != ElementType::U8) return error_in(Errc::ArrayType, weights);
    if (clusters->type != ElementType::U8 && clusters->type != ElementType::U16) {
        return error_in(Errc::ArrayType, *clusters);
    }
    if (weights.rank != 2 || weights.shape[0] != transport.vertex_count ||
        weights.shape[1] != static_cast<std::uint64_t>(cluster_basis_.weight_count)) {
        return error_in(Errc::ArrayShape, weights);
    }
    if (clusters->rank != 1 || clusters->shape[0] != transport.vertex_count) {
        return error_in(Errc::ArrayShape, *clusters);
    }
    transport.encoding = TransportEncoding::Clustered;
    transport.bands = cluster_basis_.bands;
    transport.channels = cluster_basis_.channels;
    transport.basis = cluster_basis_;
    transport.clusters_are_16_bit = clusters->type == ElementType::U16;
    ENVBAKE_TRY(transport.codes, place_bytes(weights, arena));
    ENVBAKE_TRY(transport.clusters, place_bytes(*clusters, arena));
    return {};
}

format::Expected<void> Bundle::resolve_transport(std::uint64_t index, TransportView& transport,
                                                 Arena& arena) noexcept {
    const std::optional<ArrayInfo> info = reader_.find(Name("mesh/", index, "/diffuse"));
    if (!info) {
        const std::optional<ArrayInfo> weights =
            reader_.find(Name("mesh/", index, "/diffuse_weights"));
        return weights ? resolve_clustered(index, *weights, transport, arena)
                       : format::Expected<void>{};
    }
    const bool coloured = info->rank == 3 && info->shape[2] == 3;
    transport.bands = bands_of(info->shape[1]);
    transport.channels = coloured ? 3 : 1;
    if ((info->rank != 2 && !coloured) || transport.bands == 0 ||
        info->shape[0] != transport.vertex_count) {
        return error_in(Errc::ArrayShape, *info);
    }
    if (info->type != ElementType::U8 && info->type != ElementType::U16) {
        ENVBAKE_TRY(transport.values, place(*info, arena));
        return {};
    }
    const Name name("mesh/", index, "/diffuse_range");
    const std::optional<ArrayInfo> range = reader_.find(name);
    if (!range) return Error::at(Errc::ArrayMissing, 0, name);
    if (range->type != ElementType::F32) return error_in(Errc::ArrayType, *range);
    if (range->rank != info->rank || range->shape[0] != info->shape[1] ||
        (coloured && range->shape[1] != 3) || range->shape[info->rank - 1u] != 2) {
        return error_in(Errc::ArrayShape, *range);
    }
    transport.encoding =
        info->type == ElementType::U8 ? TransportEncoding::Unorm8 : TransportEncoding::Unorm16;
    ENVBAKE_TRY(transport.codes, place_bytes(*info, arena));
    ENVBAKE_TRY(const FloatView low_and_step, place(*range, arena));
    transport.range = static_cast<const float*>(low_and_step.data);
    return {};
}

format::Expected<void> Bundle::resolve_meshes(Arena& arena) noexcept {
    const std::optional<JsonCursor> list = JsonCursor(reader_.metadata()).find("meshes");
    if (!list) return {};
    std::uint64_t count = 0;
    if (!list->for_each_element([&](const JsonCursor&) { return ++count <= kMaxMeshes; })) {
        return metadata_error();
    }
    std::byte* storage = arena.take(count * sizeof(Mesh));
    Mesh* meshes = reinterpret_cast<Mesh*>(storage);

    std::uint64_t i = 0;
    Error error;
    const bool whole = list->for_each_element([&](const JsonCursor& entry) {
        const auto integer = [&](std::string_view key, std::uint64_t limit, std::uint64_t& value) {
            const std::optional<JsonCursor> field = entry.find(key);
            const std::optional<std::uint64_t> number =
                field ? field->integer() : std::optional<std::uint64_t>{};
            value = number.value_or(0);
            return number && *number <= limit;
        };
        constexpr std::uint64_t kMaxIndex = std::numeric_limits<std::uint32_t>::max();
        std::uint64_t node = 0, mesh_index = 0, primitive = 0;
        Mesh mesh;
        if (!integer("node", kMaxIndex, node) || !integer("mesh", kMaxIndex, mesh_index) ||
            !integer("primitive", kMaxIndex, primitive) ||
            !integer("vertex_count", kMaxIndex, mesh.vertex_count)) {
            error = metadata_error();
            return false;
        }
        mesh.node = static_cast<std::uint32_t>(node);
        mesh.mesh = static_cast<std::uint32_t>(mesh_index);
        mesh.primitive = static_cast<std::uint32_t>(primitive);

        mesh.diffuse.vertex_count = mesh.vertex_count;
        if (const auto resolved = resolve_transport(i, mesh.diffuse, arena); !resolved) {
            error = resolved.error();
            return false;
        }
        if (mesh.diffuse.bands == 0) mesh.diffuse.vertex_count = 0;
        const std::optional<ArrayInfo> emitted = reader_.find(Name("mesh/", i, "/emitted"));
        if (emitted && mesh.diffuse.bands > 0) {
            if (emitted->rank != 2 || emitted->shape[0] != mesh.vertex_count ||
                emitted->shape[1] != 3) {
                error = error_in(Errc::ArrayShape, *emitted);
                return false;
            }
            const format::Expected<FloatView> values = place(*emitted, arena);
            if (!values) {
                error = values.error();
                return false;
            }
            mesh.diffuse.emitted = *values;
        }
        mesh.glossy.vertex_count = mesh.vertex_count;
        if (const auto resolved = resolve_glossy(i, mesh.glossy, arena); !resolved) {
            error = resolved.error();
            return false;
        }
        if (const format::Expected<void> done = resolve_wavelet(i, mesh); !done) {
            error = done.error();
            return false;
        }
        if (storage != nullptr) new (meshes + i) Mesh(mesh);
        ++i;
        return true;
    });
    if (!whole) return error.code != Errc::None ? error : metadata_error();
    if (storage != nullptr) meshes_ = {meshes, static_cast<std::size_t>(count)};
    return {};
}

format::Expected<void> Bundle::resolve_wavelet_lighting(Arena& arena) noexcept {
    const std::optional<JsonCursor> basis = JsonCursor(reader_.metadata()).find("wavelet");
    if (!basis) return {};
    const std::optional<JsonCursor> size_field = basis->find("face_size");
    const std::optional<std::uint64_t> size =
        size_field ? size_field->integer() : std::optional<std::uint64_t>{};
    if (!size || !wavelet::is_face_size(*size)) return metadata_error();
    wavelet_lighting_.face_size = static_cast<int>(*size);
    if (const std::optional<JsonCursor> step_field = basis->find("step")) {
        const std::optional<double> step = step_field->number();
        if (!step) return metadata_error();
        wavelet_step_ = static_cast<float>(*step);
        if (!(wavelet_step_ > 0 && wavelet_step_ <= 1)) return metadata_error();
    }
    const std::uint64_t coeffs = wavelet::coeff_count(wavelet_lighting_.face_size);

    if (const std::optional<ArrayInfo> info = reader_.find("wavelet/weight")) {
        if (info->rank != 1 || info->shape[0] != coeffs) return error_in(Errc::ArrayShape, *info);
        ENVBAKE_TRY(wavelet_lighting_.weights, reader_.view<float>(info->name));
    }
    const std::optional<ArrayInfo> index = reader_.find("environment/wavelet/index");
    const std::optional<ArrayInfo> value = reader_.find("environment/wavelet/value");
    if (!index || !value) return {};
    const std::uint64_t channels = value->shape[1];
    if (index->rank != 1) return error_in(Errc::ArrayShape, *index);
    if (value->rank != 2 || value->shape[0] != index->shape[0] ||
        (channels != 3 && channels != 1)) {
        return error_in(Errc::ArrayShape, *value);
    }
    ENVBAKE_TRY(const std::span<const std::uint32_t> indices,
                reader_.view<std::uint32_t>(index->name));
    ENVBAKE_TRY(const std::span<const float> values, reader_.view<float>(value->name));
    auto* terms =
        reinterpret_cast<wavelet::Term*>(arena.take(indices.size() * sizeof(wavelet::Term)));
    if (terms == nullptr) return {};
    for (std::size_t i = 0; i < indices.size(); ++i) {
        if (indices[i] >= coeffs) return error_in(Errc::ArrayShape, *index);
        wavelet::Term term{.index = indices[i]};
        for (std::size_t c = 0; c < 3; ++c) {
            term.value[c] = values[i * channels + (channels == 3 ? c : 0)];
        }
        new (terms + i) wavelet::Term(term);
    }
    wavelet_lighting_.terms = {terms, indices.size()};
    return {};
}

/// Blocks are judged when they are shaded from: looking through them here would read the whole
/// file.
format::Expected<void> Bundle::resolve_wavelet(std::uint64_t mesh_index,
                                               Mesh& mesh) const noexcept {
    const Name blocks_name("mesh/", mesh_index, "/wavelet/blocks");
    const Name offsets_name("mesh/", mesh_index, "/wavelet/offsets");
    const std::optional<ArrayInfo> blocks = reader_.find(blocks_name);
    const std::optional<ArrayInfo> offsets = reader_.find(offsets_name);
    if (!blocks || !offsets) return {};
    if (wavelet_step_ == 0) return metadata_error();
    if (blocks->rank != 1) return error_in(Errc::ArrayShape, *blocks);
    if (offsets->rank != 1 || offsets->shape[0] != (mesh.vertex_count + 255) / 256 + 1) {
        return error_in(Errc::ArrayShape, *offsets);
    }
    ENVBAKE_TRY(mesh.wavelet.words, reader_.view<std::uint32_t>(blocks_name));
    ENVBAKE_TRY(mesh.wavelet.offsets, reader_.view<std::uint32_t>(offsets_name));
    mesh.wavelet.vertex_count = mesh.vertex_count;
    mesh.wavelet.face_size = wavelet_lighting_.face_size;
    mesh.wavelet.step = wavelet_step_;
    return {};
}

format::Expected<ArrayView> Bundle::array(std::string_view name) const noexcept {
    const std::optional<ArrayInfo> info = reader_.find(name);
    if (!info) return Error::at(Errc::ArrayMissing, 0, name);
    if (info->codec != format::Codec::None) return error_in(Errc::ArrayCodec, *info);
    return ArrayView{*info, reader_.stored_bytes(*info).data()};
}

}  // namespace envbake::runtime
