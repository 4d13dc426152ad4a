// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/validate.h"

#include "baker/pipeline/array_values.h"
#include "baker/pipeline/check_self_test.h"
#include "baker/pipeline/metadata.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace envbake {

namespace {

class Validation {
  public:
    explicit Validation(const format::Reader& reader) : reader_(reader) {}

    std::vector<Finding> run() {
        check_layout();
        for (std::size_t i = 0; i < reader_.array_count(); ++i) check_stored(reader_.array(i));
        check_metadata_syntax();
        if (findings_.empty()) check_meaning();
        if (findings_.empty())
            for (std::string& message : check_self_test(reader_, metadata_))
                add(110, "SelfTest", std::move(message));
        return std::move(findings_);
    }

  private:
    void add(int code, std::string name, std::string message) {
        findings_.push_back({code, std::move(name), std::move(message)});
    }
    void add(const format::Error& e) {
        add(static_cast<int>(e.code), std::string(format::to_string(e.code)), format::to_string(e));
    }

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
        metadata_ = parse_metadata(reader_.metadata());
        if (!metadata_.is_object()) {
            metadata_ = Json::object();
            add(100, "MetadataSyntax",
                "array metadata: not a JSON object in UTF-8, stored uncompressed");
        }
    }

    void check_meaning() {
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            check_type_and_shape(info);
            const auto measured = statistics(reader_, info);
            if (!measured) continue;  // check_stored has said so
            const ArrayStatistics& s = *measured;
            if (s.non_finite_count > 0)
                add(104, "NonFinite",
                    concat("array ", info.name, ": ", s.non_finite_count,
                           " elements are NaN or infinite"));
            if (info.name.rfind("environment/mips/", 0) == 0 && s.min < 0)
                add(105, "Negative", concat("array ", info.name, ": radiance down to ", s.min));
        }
        if (findings_.empty()) check_metadata_agrees();
    }

    void require_type(const format::ArrayInfo& info,
                      std::initializer_list<format::ElementType> types) {
        if (std::find(types.begin(), types.end(), info.type) == types.end())
            add(102, "ArrayType",
                concat("array ", info.name, ": is ", format::to_string(info.type), ", ",
                       format::to_string(*types.begin()), " is accepted"));
    }
    void require_shape(const format::ArrayInfo& info, bool good, const char* accepted) {
        if (!good)
            add(103, "ArrayShape", concat("array ", info.name, ": its shape is not ", accepted));
    }

    static bool is_square(std::uint64_t n) {
        const auto root =
            static_cast<std::uint64_t>(std::lround(std::sqrt(static_cast<double>(n))));
        return n > 0 && root <= 10 && root * root == n;
    }

    void check_type_and_shape(const format::ArrayInfo& info) {
        using format::ElementType;
        const auto& s = info.shape;
        const auto starts = [&](std::string_view prefix) {
            return info.name.rfind(prefix, 0) == 0;
        };
        const auto ends = [&](std::string_view suffix) {
            return info.name.size() >= suffix.size() &&
                   info.name.substr(info.name.size() - suffix.size()) == suffix;
        };
        if (info.name == format::kMetadataName) {
            require_type(info, {ElementType::U8});
            require_shape(info, info.rank == 1, "[bytes]");
        } else if (info.name == "environment/sh") {
            require_type(info, {ElementType::F32});
            require_shape(info, info.rank == 2 && is_square(s[0]) && s[1] == 3,
                          "[n*n, 3] for n of 1 to 10");
        } else if (starts("environment/mips/")) {
            require_type(info, {ElementType::F32, ElementType::F16});
            require_shape(info,
                          info.rank == 4 && s[0] == 6 && s[1] > 0 && s[1] == s[2] && s[3] == 3,
                          "[6, s, s, 3]");
        } else if (starts("brdf/")) {
            require_type(info, {ElementType::F32});
            require_shape(info, info.rank == 3 && s[0] > 1 && s[0] == s[1] && s[2] == 2,
                          "[n, n, 2]");
        } else if (starts("mesh/") && (ends("/diffuse") || ends("/unshadowed"))) {
            require_type(info, {ElementType::F32});
            require_shape(info, info.rank == 2 && is_square(s[1]),
                          "[vertices, n*n] for n of 1 to 10");
        }
    }

    void check_metadata_agrees() {
        const auto missing = [&](std::string message) {
            add(101, "MetadataField", std::move(message));
        };
        const auto at = [&](const char* path) {
            const Json::json_pointer pointer(path);
            return metadata_.contains(pointer) ? metadata_.at(pointer) : Json();
        };
        const Json levels = at("/environment/mips/levels"), count = at("/environment/mips/count");
        const Json meshes = at("/meshes");
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            const std::string name(info.name);
            int number = -1;
            if (std::sscanf(name.c_str(), "environment/mips/%d", &number) == 1) {
                const bool listed =
                    count.is_number_integer() && levels.is_array() &&
                    std::any_of(levels.begin(), levels.end(), [&](const Json& level) {
                        return level.is_object() && level.value("level", -1) == number &&
                               level.value("face_size", 0u) == info.shape[1];
                    });
                if (!listed)
                    missing(concat("environment.mips.levels does not list array ", name,
                                   " with its face size"));
            } else if (std::sscanf(name.c_str(), "mesh/%d/", &number) == 1) {
                const auto mesh = static_cast<std::size_t>(number);
                if (!meshes.is_array() || number < 0 || mesh >= meshes.size() ||
                    !meshes[mesh].is_object() ||
                    meshes[mesh].value("vertex_count", std::uint64_t{0}) != info.shape[0])
                    missing(concat("meshes[", number,
                                   "].vertex_count is not the row count of array ", name));
            } else if (name == "brdf/ggx") {
                const Json axes = at("/brdf/ggx/axes");
                if (axes != "sqrt" && axes != "linear")
                    missing("brdf.ggx.axes is neither \"sqrt\" nor \"linear\"");
            }
        }
    }

    const format::Reader& reader_;
    Json metadata_ = Json::object();
    std::vector<Finding> findings_;
};

}  // namespace

Expected<std::vector<Finding>> validate_bundle(const std::filesystem::path& file) try {
    const auto reader = format::Reader::open(file.c_str());
    if (reader) return Validation(*reader).run();
    const format::Error& e = reader.error();
    if (e.code == format::Errc::CannotOpen || e.code == format::Errc::CannotRead)
        return Error{Errc::Failed, concat(file.string(), ": ", format::to_string(e))};
    return std::vector<Finding>{
        {static_cast<int>(e.code), std::string(format::to_string(e.code)), format::to_string(e)}};
} catch (const Json::exception& e) {
    return std::vector<Finding>{{101, "MetadataField", e.what()}};
}

}  // namespace envbake
