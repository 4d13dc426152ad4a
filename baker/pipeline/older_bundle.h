// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/metadata.h"
#include "baker/plan/plan.h"
#include "baker/transport/cluster_rows.h"
#include "baker/transport/row_encoding.h"

#include "envbake/format/reader.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace envbake {

/// Of an array that has the right key and is something else.
Error unexpected(std::string_view array);

/// What stands at the output's path before a bake: whatever it holds is taken for granted only
/// where it is checked here. It stays readable while it is replaced.
class OlderBundle {
  public:
    /// Nothing where no bundle of this version is there, or its metadata is damaged.
    static std::optional<OlderBundle> open(const std::filesystem::path& file);

    const format::Reader& reader() const { return reader_; }
    const Json& metadata() const { return metadata_; }

    /// Of each stage of a plan the arrays that it need not bake again, in their order; nothing
    /// where it must: it is not there with this key, or an array of a stage with the same key is
    /// missing or damaged. Stages of one key are kept together or not at all.
    ///   keys  stage_keys()
    std::vector<std::optional<std::vector<std::string>>> arrays_to_keep(
        const BakePlan& plan, std::span<const std::string> keys) const;

    /// Elements in the file or, where they are compressed, in memory.
    struct Elements {
        format::ArrayInfo info;
        std::vector<std::byte> decoded;
        std::span<const std::byte> bytes;
    };
    /// Errors:  InvalidBundle  there is no such array, or it does not decode
    Expected<Elements> elements(const std::string& name) const;
    /// Those of an f32 or f16 array.
    ///
    /// Errors:  InvalidBundle  also: it has another type, or not `count` elements
    Expected<std::vector<float>> floats(const std::string& name, std::uint64_t count) const;

  private:
    OlderBundle(format::Reader reader, Json metadata);
    std::optional<std::vector<std::string>> arrays_of(const std::string& output,
                                                      const std::string& key) const;

    format::Reader reader_;
    Json metadata_;
    std::map<std::string, std::size_t> stages_;  ///< outputs, by where they stand in the plan
};

/// Rows of transport as a reader gets them, whatever their encoding.
class OlderRows {
  public:
    /// `name` is "mesh/I/diffuse" or "mesh/I/glossy".
    ///
    /// Errors:  InvalidBundle  the arrays are not of so many rows of so many numbers
    static Expected<OlderRows> open(const OlderBundle& older, const std::string& name,
                                    std::uint64_t vertex_count, std::size_t row_size);
    std::vector<float> row(std::uint64_t vertex) const;

  private:
    Expected<void> read_clusters(const OlderBundle& older, const std::string& name,
                                 std::uint64_t vertex_count);

    RowCode code_;
    OlderBundle::Elements rows_;
    std::optional<ClusteredRows> clusters_;  ///< in place of both
};

}  // namespace envbake
