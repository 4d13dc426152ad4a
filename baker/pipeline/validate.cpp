// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/validate.h"

#include "baker/core/text.h"
#include "baker/pipeline/array_values.h"
#include "baker/pipeline/check_self_test.h"
#include "baker/pipeline/format_rules.h"
#include "baker/pipeline/json_text.h"
#include "baker/pipeline/self_test.h"
#include "baker/pipeline/validate_wavelet.h"
#include "envbake/runtime/lobe.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>

namespace envbake {

namespace {

/// The arrays and the members of the metadata of one distribution of normals.
struct LobeNames {
    std::string_view mips;  ///< environment/MIPS/K, environment.MIPS
    std::string_view brdf;  ///< brdf/BRDF, brdf.BRDF
};
constexpr LobeNames kGgx{"mips", "ggx"};
constexpr LobeNames kBeckmann{"mips_beckmann", "beckmann"};

/// What docs/format.md says of a name; Unknown where it says nothing.
struct KnownName {
    enum class Kind {
        Unknown,
        Metadata,
        Shard,
        Lights,
        Sh,
        Mip,
        Table,
        AverageAlbedo,
        Diffuse,
        Range,
        Weights,
        Cluster,
        Basis,
        Unshadowed,
        Emitted,
        Glossy,
        Normal,
        Reflected,
        Lobe,
        Wavelet,
        Question,
        Answer
    };
    Kind kind = Kind::Unknown;
    std::uint64_t number = 0;                                ///< K of a mip, I of a mesh
    const LobeNames* lobe = nullptr;                         ///< of what is baked for each lobe
    std::uint64_t columns = 0;                               ///< of a self-test's array
    format::ElementType element = format::ElementType::F32;  ///< of a self-test's array
};

struct QuestionGroup {
    const char* question;
    const char* answer;
    std::uint64_t columns;  ///< of the questions; answers have 3
    format::ElementType element;
};
constexpr QuestionGroup kIrradiance{"selftest/irradiance/normal", "selftest/irradiance/value", 3,
                                    format::ElementType::F32};
constexpr QuestionGroup kDiffuse{"selftest/diffuse/vertex", "selftest/diffuse/value", 2,
                                 format::ElementType::U32};
constexpr QuestionGroup kWavelet{"selftest/wavelet/vertex", "selftest/wavelet/value", 2,
                                 format::ElementType::U32};
constexpr QuestionGroup kSpecular{"selftest/specular/input", "selftest/specular/value", 8,
                                  format::ElementType::F32};
constexpr QuestionGroup kSpecularBeckmann{"selftest/specular_beckmann/input",
                                          "selftest/specular_beckmann/value", 8,
                                          format::ElementType::F32};

constexpr QuestionGroup kGlossyVertex{"selftest/glossy/vertex", "selftest/glossy/value", 2,
                                      format::ElementType::U32};
constexpr QuestionGroup kGlossyInput{"selftest/glossy/input", "selftest/glossy/value", 5,
                                     format::ElementType::F32};
constexpr QuestionGroup kGlossyVertexBeckmann{"selftest/glossy_beckmann/vertex",
                                              "selftest/glossy_beckmann/value", 2,
                                              format::ElementType::U32};
constexpr QuestionGroup kGlossyInputBeckmann{"selftest/glossy_beckmann/input",
                                             "selftest/glossy_beckmann/value", 5,
                                             format::ElementType::F32};

/// Takes a decimal number without leading zeros off the front; one that does not fit saturates.
std::optional<std::uint64_t> take_number(std::string_view& text) {
    const std::size_t size = std::min(text.find_first_not_of("0123456789"), text.size());
    if (size == 0 || (size > 1 && text[0] == '0')) return std::nullopt;
    std::uint64_t number = 0;
    if (std::from_chars(text.data(), text.data() + size, number).ec != std::errc())
        number = std::numeric_limits<std::uint64_t>::max();
    text.remove_prefix(size);
    return number;
}

KnownName known_name(std::string_view name) {
    using Kind = KnownName::Kind;
    if (name == format::kMetadataName) return {Kind::Metadata};
    if (name == format::kShardName) return {Kind::Shard};
    if (name == "environment/lights") return {Kind::Lights};
    if (name == "environment/sh" || name == "environment/irradiance") return {Kind::Sh};
    for (const QuestionGroup& group :
         {kIrradiance, kDiffuse, kWavelet, kSpecular, kSpecularBeckmann, kGlossyVertex,
          kGlossyInput, kGlossyVertexBeckmann, kGlossyInputBeckmann}) {
        if (name == group.question)
            return {Kind::Question, 0, nullptr, group.columns, group.element};
        if (name == group.answer) return {Kind::Answer, 0, nullptr, 3, format::ElementType::F32};
    }
    if (is_wavelet_name(name)) return {Kind::Wavelet, mesh_of_wavelet(name).value_or(0)};
    const auto take = [&](std::string_view prefix) {
        const bool starts = name.substr(0, prefix.size()) == prefix;
        if (starts) name.remove_prefix(prefix.size());
        return starts;
    };
    const auto take_lobe = [&](std::string_view LobeNames::*part) -> const LobeNames* {
        // The longer of two names that begin alike comes first.
        for (const LobeNames* lobe : {&kBeckmann, &kGgx})
            if (take(lobe->*part)) return lobe;
        return nullptr;
    };
    if (take("brdf/")) {
        const LobeNames* lobe = take_lobe(&LobeNames::brdf);
        if (lobe && name.empty()) return {Kind::Table, 0, lobe};
        if (lobe && name == "_average_albedo") return {Kind::AverageAlbedo, 0, lobe};
        if (lobe && (name == "_lobe/unoccluded" || name == "_lobe/kernel"))
            return {Kind::Lobe, 0, lobe};
    } else if (take("environment/")) {
        const LobeNames* lobe = take_lobe(&LobeNames::mips);
        if (lobe && take("/")) {
            const auto level = take_number(name);
            if (level && name.empty()) return {Kind::Mip, *level, lobe};
        }
    } else if (name == "mesh/diffuse_basis") {
        return {Kind::Basis};
    } else if (take("mesh/")) {
        const auto mesh = take_number(name);
        if (mesh && name == "/diffuse") return {Kind::Diffuse, *mesh};
        if (mesh && name == "/diffuse_range") return {Kind::Range, *mesh};
        if (mesh && name == "/diffuse_weights") return {Kind::Weights, *mesh};
        if (mesh && name == "/diffuse_cluster") return {Kind::Cluster, *mesh};
        if (mesh && name == "/emitted") return {Kind::Emitted, *mesh};
        if (mesh && name == "/unshadowed") return {Kind::Unshadowed, *mesh};
        if (mesh && name == "/glossy") return {Kind::Glossy, *mesh};
        if (mesh && name == "/normal") return {Kind::Normal, *mesh};
        if (mesh && name == "/reflected") return {Kind::Reflected, *mesh};
    }
    return {};
}

bool is_integer(const Json& json, std::uint64_t least, std::uint64_t most) {
    if (!json.is_number_unsigned()) return false;
    const auto value = json.get<std::uint64_t>();
    return value >= least && value <= most;
}

/// The member of an object; null where there is none.
Json member(const Json& json, const char* key) {
    return json.is_object() && json.contains(key) ? json.at(key) : Json();
}

bool is_channels(std::uint64_t count) {
    return count == 3 || count == 1;
}

/// [6, s, s, channels] or [2 s, 4 s, channels].
struct MipShape {
    bool cube;
    std::uint64_t size;  ///< s
    std::uint64_t channels;

    static std::optional<MipShape> of(const format::ArrayInfo& info) {
        const auto& s = info.shape;
        if (info.rank == 4 && s[0] == 6 && s[1] > 0 && s[1] == s[2] && is_channels(s[3]))
            return MipShape{true, s[1], s[3]};
        if (info.rank == 3 && s[0] > 0 && s[0] % 2 == 0 && s[1] == 2 * s[0] && is_channels(s[2]))
            return MipShape{false, s[0] / 2, s[2]};
        return std::nullopt;
    }
};

class Validation {
  public:
    explicit Validation(const format::Reader& reader) : reader_(reader) {}

    std::vector<Finding> run() {
        check_layout();
        check_name_places();
        for (std::size_t i = 0; i < reader_.array_count(); ++i) check_stored(reader_.array(i));
        check_metadata_syntax();
        if (findings_.empty()) check_meaning();
        if (findings_.empty() && !reader_.find(format::kShardName))
            for (std::string& message : check_self_test(reader_, tolerance_))
                add(rule::kSelfTest, std::move(message));
        return std::move(findings_);
    }

  private:
    void add(const FormatRule& broken, std::string message) {
        findings_.push_back({broken.code, std::string(broken.name), std::move(message)});
    }
    void add(const format::Error& e) { add(FormatRule(e.code), format::to_string(e)); }

    /// Arrays share no bytes; what lies between them is 0.
    void check_layout() {
        std::vector<format::ArrayInfo> arrays;
        for (std::size_t i = 0; i < reader_.array_count(); ++i) arrays.push_back(reader_.array(i));
        std::sort(arrays.begin(), arrays.end(),
                  [](const auto& a, const auto& b) { return a.offset < b.offset; });
        std::uint64_t end = format::kHeaderSize;
        const auto check_gap = [&](std::uint64_t until) {
            const auto gap = reader_.file().subspan(end, until - end);
            const auto stray =
                std::find_if(gap.begin(), gap.end(), [](std::byte b) { return b != std::byte{0}; });
            if (stray != gap.end())
                add(format::Error::at(format::Errc::PaddingBytes,
                                      end + static_cast<std::uint64_t>(stray - gap.begin())));
        };
        for (const format::ArrayInfo& array : arrays) {
            if (array.stored_size == 0) continue;
            if (array.offset < end)
                add(format::Error::at(format::Errc::ArraysOverlap, array.offset, array.name));
            else
                check_gap(array.offset);
            end = std::max(end, array.offset + array.stored_size);
        }
        check_gap(reader_.table_offset());
    }

    /// Names fill the table behind its entries, in their order.
    void check_name_places() {
        const std::byte* end = reader_.file().data() + reader_.table_offset() +
                               reader_.array_count() * format::kEntrySize;
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const std::string_view name = reader_.array(i).name;
            if (reinterpret_cast<const std::byte*>(name.data()) != end) {
                add(rule::kNamesPlaced,
                    concat("array ", name, ": its name does not begin where the one before ends"));
                return;
            }
            end += name.size();
        }
        if (end != reader_.file().data() + reader_.file().size())
            add(rule::kNamesPlaced, "the last name does not end with the table");
    }

    void check_stored(const format::ArrayInfo& info) {
        if (const auto intact = reader_.verify(info); !intact) {
            add(intact.error());
            return;
        }
        if (info.codec == format::Codec::None) return;
        const auto bytes = read_bytes(reader_, info);
        if (!bytes) add(format::Error::at(format::Errc::ArrayDecode, info.offset, info.name));
    }

    void check_metadata_syntax() {
        const auto info = reader_.find(format::kMetadataName);
        if (!info) {
            add(format::Error::at(format::Errc::MissingMetadata));
            return;
        }
        if (info->type != format::ElementType::U8 || info->rank != 1 ||
            info->codec != format::Codec::None) {
            add(rule::kMetadataStored, "array metadata: not u8 of one axis, stored uncompressed");
            return;
        }
        metadata_ = parse_metadata(reader_.metadata());
        if (metadata_.is_discarded())
            add(rule::kMetadataSyntax, "array metadata: not JSON in UTF-8, nested at most 64 deep");
        else if (!metadata_.is_object())
            add(rule::kMetadataObject, "array metadata: not a JSON object");
    }

    void check_meaning() {
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            const KnownName known = known_name(info.name);
            if (known.kind == KnownName::Kind::Unknown) continue;
            check_type_and_shape(info, known);
            const auto measured = statistics(reader_, info);
            if (!measured) continue;  // check_stored has said so
            const ArrayStatistics& s = *measured;
            if (s.non_finite_count > 0)
                add(rule::kNonFinite, concat("array ", info.name, ": ", s.non_finite_count,
                                             " elements are NaN or infinite"));
            if (known.kind == KnownName::Kind::Mip && s.min < 0)
                add(rule::kNegative, concat("array ", info.name, ": radiance down to ", s.min));
        }
        for (const LobeNames* lobe : {&kGgx, &kBeckmann})
            if (findings_.empty()) check_mip_sizes(*lobe);
        if (findings_.empty()) check_metadata_agrees();
    }

    void require_type(const format::ArrayInfo& info, const FormatRule& broken,
                      std::initializer_list<format::ElementType> types) {
        if (std::find(types.begin(), types.end(), info.type) == types.end())
            add(broken, concat("array ", info.name, ": is ", format::to_string(info.type), ", ",
                               format::to_string(*types.begin()), " is accepted"));
    }
    void require_shape(const format::ArrayInfo& info, const FormatRule& broken, bool good,
                       const std::string& accepted) {
        if (!good) add(broken, concat("array ", info.name, ": its shape is not ", accepted));
    }

    static bool is_square(std::uint64_t n) {
        const auto root =
            static_cast<std::uint64_t>(std::lround(std::sqrt(static_cast<double>(n))));
        return n > 0 && root <= 10 && root * root == n;
    }

    void check_type_and_shape(const format::ArrayInfo& info, const KnownName& known) {
        using format::ElementType;
        using Kind = KnownName::Kind;
        const auto& s = info.shape;
        switch (known.kind) {
            case Kind::Unknown:
                break;
            case Kind::Metadata:  // check_metadata_syntax has said so
                break;
            case Kind::Wavelet:  // validate_wavelet.cpp
                break;
            case Kind::Shard: {
                const auto part = reader_.view<std::uint32_t>(info.name);
                if (!part || info.rank != 1 || s[0] != 2 || (*part)[0] < 1 ||
                    (*part)[0] > (*part)[1])
                    add(rule::kShardPart, "array shard: is no u32 [2] of I and N, 1 <= I <= N");
                break;
            }
            case Kind::Lights:
                require_type(info, rule::kLightsType, {ElementType::F32});
                require_shape(info, rule::kLightsShape, info.rank == 2 && s[1] == 9, "[k, 9]");
                break;
            case Kind::Sh: {
                require_type(info, rule::kShType, {ElementType::F32});
                const bool coefficients = info.rank == 2 && is_square(s[0]);
                require_shape(info, rule::kShCoefficients, coefficients,
                              "[n*n, c] for n of 1 to 10");
                require_shape(info, rule::kShChannels, !coefficients || is_channels(s[1]),
                              "[n*n, 3] or [n*n, 1]");
                break;
            }
            case Kind::Mip:
                require_type(info, rule::kMipType, {ElementType::F32, ElementType::F16});
                require_shape(info, rule::kMipShape, MipShape::of(info).has_value(),
                              "[6, s, s, c] or [2 s, 4 s, c] for c of 1 or 3");
                break;
            case Kind::Table:
                require_type(info, rule::kTableType, {ElementType::F32, ElementType::F16});
                require_shape(info, rule::kTableShape,
                              info.rank == 3 && s[0] > 1 && s[0] == s[1] && s[2] == 2,
                              "[n, n, 2] for n from 2");
                break;
            case Kind::AverageAlbedo:
                require_type(info, rule::kAlbedoType, {ElementType::F32});
                require_shape(info, rule::kAlbedoShape, info.rank == 1, "[n]");
                break;
            case Kind::Diffuse:
                require_type(
                    info, rule::kTransportType,
                    {ElementType::F32, ElementType::F16, ElementType::U16, ElementType::U8});
                require_shape(info, rule::kTransportShape,
                              is_square(s[1]) && (info.rank == 2 || (info.rank == 3 && s[2] == 3)),
                              "[vertices, n*n] or [vertices, n*n, 3] for n of 1 to 10");
                break;
            case Kind::Range:
                require_type(info, rule::kRangeType, {ElementType::F32});
                require_shape(info, rule::kRangeShape,
                              is_square(s[0]) && ((info.rank == 2 && s[1] == 2) ||
                                                  (info.rank == 3 && s[1] == 3 && s[2] == 2)),
                              "[n*n, 2] or [n*n, 3, 2] for n of 1 to 10");
                break;
            case Kind::Weights:
                require_type(info, rule::kClusterType, {ElementType::U8});
                require_shape(info, rule::kClusterShape, info.rank == 2, "[vertices, k]");
                break;
            case Kind::Cluster:
                require_type(info, rule::kClusterType, {ElementType::U8, ElementType::U16});
                require_shape(info, rule::kClusterShape, info.rank == 1, "[vertices]");
                break;
            case Kind::Basis:
                require_type(info, rule::kClusterType, {ElementType::F16, ElementType::F32});
                require_shape(info, rule::kClusterShape,
                              (info.rank == 3 || (info.rank == 4 && s[3] == 3)) && s[0] >= 1 &&
                                  s[0] <= 65536 && s[1] >= 2 && s[1] <= 33 && is_square(s[2]),
                              "[clusters, 1 + k, n*n] or [clusters, 1 + k, n*n, 3] for up to "
                              "65536 clusters, k of 1 to 32 and n of 1 to 10");
                break;
            case Kind::Emitted:
                require_type(info, rule::kEmittedType, {ElementType::F32});
                require_shape(info, rule::kEmittedShape, info.rank == 2 && s[1] == 3,
                              "[vertices, 3]");
                break;
            case Kind::Glossy:
                require_type(info, rule::kGlossyType, {ElementType::F32, ElementType::F16});
                require_shape(info, rule::kGlossyShape, info.rank == 2 && light_bands_of(s[1]) > 0,
                              "[vertices, (n + 6)^2] for n of 1 to 5");
                break;
            case Kind::Normal:
                require_type(info, rule::kNormalType, {ElementType::F32});
                require_shape(info, rule::kNormalShape, info.rank == 2 && s[1] == 3,
                              "[vertices, 3]");
                break;
            case Kind::Reflected:
                require_type(info, rule::kReflectedType, {ElementType::F16});
                require_shape(info, rule::kReflectedShape,
                              (info.rank == 3 || (info.rank == 4 && s[3] == 3)) &&
                                  is_reflected(s[1] + 1, s[2]),
                              "[vertices, d^2 - 1, n*n] or [vertices, d^2 - 1, n*n, 3] for n of 1 "
                              "to 5 and d of 2 to 4, at most n");
                break;
            case Kind::Lobe:  // its columns follow from the metadata
                require_type(info, rule::kLobeType, {ElementType::F32});
                require_shape(info, rule::kLobeShape, info.rank == 3 && s[0] > 0 && s[1] == 2,
                              "[rows, 2, blocks]");
                break;
            case Kind::Unshadowed:
                require_type(info, rule::kTransportType, {ElementType::F32});
                require_shape(info, rule::kTransportShape, info.rank == 2 && is_square(s[1]),
                              "[vertices, n*n] for n of 1 to 10");
                break;
            case Kind::Question:
            case Kind::Answer: {
                const bool asks = known.kind == Kind::Question;
                require_type(info, asks ? rule::kQuestionType : rule::kAnswerType, {known.element});
                const bool table = info.rank == 2 && s[1] == known.columns;
                require_shape(info, asks ? rule::kQuestionShape : rule::kAnswerShape, table,
                              concat("[k, ", known.columns, "]"));
                require_shape(info, rule::kSelfTestEmpty, !table || s[0] > 0, "of one row or more");
                if (info.codec != format::Codec::None)
                    add(rule::kSelfTestStored, concat("array ", info.name, ": is compressed"));
                break;
            }
        }
    }

    static bool is_reflected(std::uint64_t functions, std::uint64_t light_coeffs) {
        for (std::uint64_t n = 1; n <= runtime::kMaxGlossyBands; ++n)
            for (std::uint64_t d = 2; d <= runtime::kMaxReflectedBands && d <= n; ++d)
                if (light_coeffs == n * n && functions == d * d) return true;
        return false;
    }

    /// n where columns = (n + 6)^2 for n of 1 to 5, otherwise 0.
    static std::uint64_t light_bands_of(std::uint64_t columns) {
        for (std::uint64_t n = 1; n <= runtime::kMaxGlossyBands; ++n)
            if (columns ==
                (n + runtime::kExtraVisibilityBands) * (n + runtime::kExtraVisibilityBands))
                return n;
        return 0;
    }

    struct StoredMip {
        std::string name;
        std::uint64_t level;
        MipShape shape;
    };
    /// By level: the table has 10 before 2.
    std::vector<StoredMip> stored_mips(const LobeNames& lobe) const {
        std::vector<StoredMip> mips;
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            const KnownName known = known_name(info.name);
            if (known.kind == KnownName::Kind::Mip && known.lobe == &lobe)
                mips.push_back({std::string(info.name), known.number, *MipShape::of(info)});
        }
        std::sort(mips.begin(), mips.end(),
                  [](const StoredMip& a, const StoredMip& b) { return a.level < b.level; });
        return mips;
    }

    /// Every mip of a chain has the layout and channels of the first, and the size that follows.
    void check_mip_sizes(const LobeNames& lobe) {
        const std::vector<StoredMip> mips = stored_mips(lobe);
        for (const StoredMip& mip : mips) {
            const MipShape& first = mips[0].shape;
            const std::uint64_t below = std::min<std::uint64_t>(mip.level - mips[0].level, 63);
            const std::uint64_t expected = std::max<std::uint64_t>(1, first.size >> below);
            if (mip.shape.cube != first.cube || mip.shape.channels != first.channels)
                add(rule::kMipLayout,
                    concat("array ", mip.name, ": its layout or channels are not those of ",
                           mips[0].name));
            else if (mip.shape.size != expected)
                add(rule::kMipChain, concat("array ", mip.name, ": its size is ", mip.shape.size,
                                            ", ", expected, " follows from ", mips[0].name));
        }
    }

    void check_metadata_agrees() {
        check_meshes_member();
        check_encodings();
        check_self_test_member();
        const Json lights = member(member(metadata_, "environment"), "lights");
        if (reader_.find("environment/lights") && !member(lights, "extracted").is_boolean())
            add(rule::kLightsExtracted, "environment.lights.extracted is neither true nor false");
        for (const LobeNames* lobe : {&kGgx, &kBeckmann}) {
            check_mips_member(*lobe);
            check_table(*lobe);
            check_lobe(*lobe);
        }
        check_glossy();
        if (findings_.empty())
            check_wavelets(reader_, metadata_,
                           [this](const FormatRule& broken, std::string message) {
                               add(broken, std::move(message));
                           });
    }

    void check_table(const LobeNames& lobe) {
        const auto table = reader_.find(concat("brdf/", lobe.brdf));
        const auto average = reader_.find(concat("brdf/", lobe.brdf, "_average_albedo"));
        if (average && (!table || average->shape[0] != table->shape[0]))
            add(rule::kAlbedoRows, concat("array ", average->name,
                                          ": not one value for each row of brdf/", lobe.brdf));
        if (!table) return;
        const Json axes =
            member(member(member(metadata_, "brdf"), std::string(lobe.brdf).c_str()), "axes");
        if (axes != "roots" && axes != "linear")
            add(rule::kTableAxes,
                concat("brdf.", lobe.brdf, ".axes is neither \"roots\" nor \"linear\""));
    }

    /// The lobe in SH: both arrays, of the shapes that follow from brdf.X_lobe.
    void check_lobe(const LobeNames& lobe) {
        const std::string name = concat("brdf/", lobe.brdf, "_lobe");
        const auto unoccluded = reader_.find(name + "/unoccluded");
        const auto kernel = reader_.find(name + "/kernel");
        if (!unoccluded && !kernel) return;
        if (!unoccluded || !kernel) {
            add(rule::kLobePair, concat("array ", name, unoccluded ? "/kernel" : "/unoccluded",
                                        " is missing, but the other of the two is not"));
            return;
        }
        const Json facts = member(member(metadata_, "brdf"), concat(lobe.brdf, "_lobe").c_str());
        const Json exit = member(facts, "exit_bands"), light = member(facts, "light_bands"),
                   range = member(facts, "roughness");
        const auto is_roughness = [](const Json& r) {
            return r.is_number() && r.get<double>() >= 0 && r.get<double>() <= 1;
        };
        if (!is_integer(exit, 1, runtime::kMaxGlossyBands) ||
            !is_integer(light, 1, runtime::kMaxGlossyBands) || !range.is_array() ||
            range.size() != 2 || !is_roughness(range[0]) || !is_roughness(range[1]) ||
            range[0].get<double>() > range[1].get<double>()) {
            add(rule::kLobeFacts, concat("brdf.", lobe.brdf,
                                         "_lobe has no exit_bands and light_bands of 1 to 5 and "
                                         "roughness of two rising numbers of 0 to 1"));
            return;
        }
        const bool one_row = range[0].get<double>() == range[1].get<double>();
        const auto require = [&](const format::ArrayInfo& info, int columns) {
            const std::uint64_t blocks = runtime::lobe_size(exit.get<int>(), columns);
            if (info.shape[2] != blocks || info.shape[0] != unoccluded->shape[0] ||
                (info.shape[0] == 1) != one_row)
                add(rule::kLobeShape,
                    concat("array ", info.name, ": its shape is not [", one_row ? "1" : "rows > 1",
                           ", 2, ", blocks, "], as brdf.", lobe.brdf, "_lobe has it"));
        };
        require(*unoccluded, light.get<int>());
        require(*kernel, runtime::kLobeBands);
    }

    /// Normals, one for each row, and lobes of the same lighting bands.
    void check_glossy() {
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            const KnownName known = known_name(info.name);
            if (known.kind == KnownName::Kind::Normal) check_normals(info);
            if (known.kind == KnownName::Kind::Reflected) check_reflected(info, known.number);
            if (known.kind != KnownName::Kind::Glossy) continue;
            if (!reader_.find(concat("mesh/", known.number, "/normal")))
                add(rule::kNormalMissing, concat("array mesh/", known.number,
                                                 "/normal is missing, but ", info.name, " is not"));
            for (const LobeNames* lobe : {&kGgx, &kBeckmann}) {
                const Json bands =
                    member(member(member(metadata_, "brdf"), concat(lobe->brdf, "_lobe").c_str()),
                           "light_bands");
                if (!bands.is_null() && bands != light_bands_of(info.shape[1]))
                    add(rule::kGlossyBands,
                        concat("array ", info.name, " is of ", light_bands_of(info.shape[1]),
                               " lighting bands, brdf.", lobe->brdf, "_lobe of others"));
            }
        }
    }

    /// It changes what glossy transport takes from diffuse transport.
    void check_reflected(const format::ArrayInfo& info, std::uint64_t mesh) {
        const auto glossy = reader_.find(concat("mesh/", mesh, "/glossy"));
        const bool diffuse = reader_.find(concat("mesh/", mesh, "/diffuse")) ||
                             reader_.find(concat("mesh/", mesh, "/diffuse_weights"));
        const std::uint64_t n = glossy ? light_bands_of(glossy->shape[1]) : 0;
        if (!diffuse || n * n != info.shape[2])
            add(rule::kReflectedAlone, concat("array ", info.name,
                                              " is without diffuse transport, or without glossy "
                                              "transport of its lighting bands"));
    }

    void check_normals(const format::ArrayInfo& info) {
        const auto normals = read_values(reader_, info);
        if (!normals) return;  // check_stored has said so
        for (std::size_t v = 0; 3 * v + 2 < normals->size(); ++v) {
            const double *n = &(*normals)[3 * v], x = n[0], y = n[1], z = n[2];
            const double length = std::sqrt(x * x + y * y + z * z);
            if (length == 0 || std::abs(length - 1) <= 1e-4) continue;
            add(rule::kNormalLength,
                concat("array ", info.name, ": row ", v, " has length ", format_number(length)));
            return;
        }
    }

    void check_mips_member(const LobeNames& lobe) {
        const std::vector<StoredMip> stored = stored_mips(lobe);
        const std::string name = concat("environment.", lobe.mips);
        const Json mips = member(member(metadata_, "environment"), std::string(lobe.mips).c_str());
        if (stored.empty() && mips.is_null()) return;
        const Json count = member(mips, "count"), levels = member(mips, "levels");
        if (!is_integer(count, 1, 16)) {
            add(rule::kMipsCount, concat(name, ".count is no integer of 1 to 16"));
            return;
        }
        if (!levels.is_array() || levels.size() != stored.size()) {
            add(rule::kMipsLevels,
                concat(name, ".levels does not list the arrays environment/", lobe.mips, "/K"));
            return;
        }
        const auto steps = static_cast<double>(count.get<std::uint64_t>() - 1);
        for (std::size_t i = 0; i < stored.size(); ++i) {
            const std::uint64_t level = stored[i].level;
            const Json roughness = member(levels[i], "roughness");
            if (level != stored[0].level + i)
                add(rule::kMipsGap, concat("mip ", stored[0].level + i, " is not stored, but ",
                                           stored[i].name, " is"));
            else if (level >= count.get<std::uint64_t>())
                add(rule::kMipsBeyondCount, concat(name, ".count is not above ", stored[i].name));
            else if (!is_integer(member(levels[i], "level"), level, level))
                add(rule::kMipsLevel,
                    concat(name, ".levels[", i, "].level is not that of ", stored[i].name));
            else if (!has_size(levels[i], stored[i].shape))
                add(rule::kMipsSize,
                    concat(name, ".levels[", i, "] has not the size of ", stored[i].name));
            else if (const double expected = steps > 0 ? static_cast<double>(level) / steps : 0;
                     !roughness.is_number() ||
                     !(std::abs(roughness.get<double>() - expected) <= 1e-6))
                add(rule::kMipsRoughness,
                    concat(name, ".levels[", i, "].roughness is not ", expected));
        }
    }

    static bool has_size(const Json& level, const MipShape& shape) {
        const auto is = [&](const char* key, std::uint64_t value) {
            return is_integer(member(level, key), value, value);
        };
        return shape.cube ? is("face_size", shape.size)
                          : is("width", 4 * shape.size) && is("height", 2 * shape.size);
    }

    void check_meshes_member() {
        const Json meshes = member(metadata_, "meshes");
        if (!meshes.is_null() && !meshes.is_array()) {
            add(rule::kMeshesList, "meshes is no array");
            return;
        }
        for (std::size_t i = 0; i < meshes.size(); ++i)
            for (const char* key : {"node", "mesh", "primitive", "vertex_count"})
                if (!is_integer(member(meshes[i], key), 0,
                                std::numeric_limits<std::uint32_t>::max()))
                    add(rule::kMeshNumbers,
                        concat("meshes[", i, "].", key, " is no integer of 0 to 2^32 - 1"));
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            const KnownName known = known_name(info.name);
            if (mesh_of_wavelet(info.name) && known.number >= meshes.size())
                add(rule::kMeshAbsent,
                    concat("meshes[", known.number, "] is missing, but ", info.name, " is not"));
            using Kind = KnownName::Kind;
            const auto of_a_mesh = {Kind::Diffuse, Kind::Emitted, Kind::Unshadowed,
                                    Kind::Glossy,  Kind::Normal,  Kind::Reflected,
                                    Kind::Weights, Kind::Cluster};
            if (std::find(of_a_mesh.begin(), of_a_mesh.end(), known.kind) == of_a_mesh.end())
                continue;
            if (known.number >= meshes.size())
                add(rule::kMeshAbsent,
                    concat("meshes[", known.number, "] is missing, but ", info.name, " is not"));
            else if (member(meshes[static_cast<std::size_t>(known.number)], "vertex_count") !=
                     info.shape[0])
                add(rule::kVertexCount,
                    concat("meshes[", known.number, "].vertex_count is not the row count of array ",
                           info.name));
        }
    }

    /// Transport that is not made of floats has all that it is decoded with.
    void check_encodings() {
        using Kind = KnownName::Kind;
        const auto basis = reader_.find("mesh/diffuse_basis");
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            const KnownName known = known_name(info.name);
            const auto beside = [&](const char* what) {
                return reader_.find(concat("mesh/", known.number, "/diffuse", what));
            };
            if (known.kind == Kind::Diffuse && is_code(info)) {
                const auto range = beside("_range");
                if (!range)
                    add(rule::kRangePair, concat("array ", info.name, ": has no ", info.name,
                                                 "_range to be decoded with"));
                else if (range->rank != info.rank || range->shape[0] != info.shape[1])
                    add(rule::kRangeShape,
                        concat("array ", range->name, ": its shape is not that of a row of ",
                               info.name));
            }
            if (known.kind == Kind::Range) {
                const auto diffuse = beside("");
                if (!diffuse || !is_code(*diffuse))
                    add(rule::kRangePair,
                        concat("array ", info.name, ": belongs to no transport of u8 or u16"));
            }
            if (known.kind == Kind::Cluster && !beside("_weights"))
                add(rule::kClustersWhole, concat("array ", info.name, ": has no weights beside"));
            if (known.kind != Kind::Weights) continue;
            const auto cluster = beside("_cluster");
            if (!cluster || !basis || beside(""))
                add(rule::kClustersWhole,
                    concat("array ", info.name,
                           beside("") ? ": stands beside the same transport of another encoding"
                                      : ": has no clusters beside, or no mesh/diffuse_basis"));
            else if (info.shape[1] + 1 != basis->shape[1])
                add(rule::kClusterShape, concat("array ", info.name,
                                                ": not one weight for each row of a cluster but "
                                                "the first"));
            else if (const auto numbers = statistics(reader_, *cluster);
                     numbers && numbers->max >= static_cast<double>(basis->shape[0]))
                add(rule::kClusterNumber, concat("array ", cluster->name, ": names cluster ",
                                                 numbers->max, " of ", basis->shape[0]));
        }
    }
    static bool is_code(const format::ArrayInfo& info) {
        return info.type == format::ElementType::U8 || info.type == format::ElementType::U16;
    }

    /// A bundle with lighting must say how to check a reader of it, and mean it.
    void check_self_test_member() {
        const bool has_lighting = reader_.find("environment/sh").has_value();
        bool has_diffuse = false;
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            const KnownName::Kind kind = known_name(info.name).kind;
            if (kind == KnownName::Kind::Diffuse || kind == KnownName::Kind::Weights)
                has_diffuse = has_diffuse || info.shape[0] > 0;
        }
        bool asked = has_lighting;
        const auto check_group = [&](const QuestionGroup& group, const FormatRule* required) {
            const auto question = reader_.find(group.question);
            const auto answer = reader_.find(group.answer);
            asked = asked || question || answer;
            if (!question && !answer && required)
                add(*required, concat("array ", group.question, " is missing"));
            if (!question && answer)
                add(rule::kQuestionsMissing, concat("array ", group.question, " is missing"));
            if (question && !answer)
                add(rule::kAnswersMissing, concat("array ", group.answer, " is missing"));
            if (question && answer && question->shape[0] != answer->shape[0])
                add(rule::kAnswerCount,
                    concat("array ", group.answer, ": not one answer for each question"));
        };
        check_group(kIrradiance, has_lighting ? &rule::kIrradianceUnasked : nullptr);
        check_group(kDiffuse, has_lighting && has_diffuse ? &rule::kDiffuseUnasked : nullptr);
        check_group(kWavelet, nullptr);
        check_group(kSpecular, nullptr);
        for (const QuestionGroup& group : {kSpecularBeckmann, kGlossyVertex, kGlossyInput,
                                           kGlossyVertexBeckmann, kGlossyInputBeckmann})
            check_group(group, nullptr);
        check_vertices_asked_for(kDiffuse.question, "/diffuse");
        check_vertices_asked_for(kGlossyVertex.question, "/glossy");
        check_vertices_asked_for(kGlossyVertexBeckmann.question, "/glossy");

        const Json self_test = member(metadata_, "self_test");
        if (!asked && self_test.is_null()) return;
        const Json tolerance = member(self_test, "tolerance");
        if (!tolerance.is_number()) {
            add(rule::kToleranceMissing, "self_test.tolerance is no number");
            return;
        }
        tolerance_ = tolerance.get<double>();
        if (!(tolerance_ > 0 && tolerance_ <= SelfTest::kLargestTolerance))
            add(rule::kToleranceRange, concat("self_test.tolerance is no number in (0, ",
                                              SelfTest::kLargestTolerance, "]"));
    }

    /// A question about a vertex has one that is stored.
    void check_vertices_asked_for(const char* question, const char* rows_name) {
        const auto vertices = reader_.view<std::uint32_t>(question);
        if (!vertices) return;
        for (std::size_t i = 0; i + 1 < vertices->size(); i += 2) {
            const std::uint32_t mesh = (*vertices)[i], vertex = (*vertices)[i + 1];
            auto rows = reader_.find(concat("mesh/", mesh, rows_name));
            if (!rows && rows_name == std::string_view("/diffuse"))
                rows = reader_.find(concat("mesh/", mesh, "/diffuse_weights"));
            if (rows && vertex < rows->shape[0]) continue;
            add(rule::kVertexAbsent,
                concat("array ", question, ": row ", i / 2, " asks for vertex ", vertex,
                       " of mesh/", mesh, rows_name, ", which is not stored"));
            return;
        }
    }

    const format::Reader& reader_;
    Json metadata_ = Json::object();
    double tolerance_ = SelfTest::kTolerance;
    std::vector<Finding> findings_;
};

}  // namespace

std::vector<Finding> validate_bundle(const format::Reader& reader) {
    return Validation(reader).run();
}

Expected<std::vector<Finding>> validate_bundle(const std::filesystem::path& file) {
    const auto reader = format::Reader::open(file.c_str());
    if (reader) return validate_bundle(*reader);
    const format::Error& e = reader.error();
    if (e.code == format::Errc::CannotOpen || e.code == format::Errc::CannotRead)
        return Error{Errc::Failed, concat(file.string(), ": ", format::to_string(e))};
    return std::vector<Finding>{
        {static_cast<int>(e.code), std::string(format::to_string(e.code)), format::to_string(e)}};
}

}  // namespace envbake
