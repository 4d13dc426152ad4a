// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include "envbake/format/reader.h"

#include <cstdint>
#include <filesystem>
#include <vector>

namespace envbake {

/// Opens a bundle for a command.
///
/// Errors:  Failed         the file cannot be opened or read
///          InvalidBundle  it is no bundle that this version reads
Expected<format::Reader> open_bundle(const std::filesystem::path& file);

/// An array's elements as double, whatever their type and codec.
///
/// Errors:  InvalidBundle  the array does not decode
Expected<std::vector<double>> read_values(const format::Reader& reader,
                                          const format::ArrayInfo& info);

/// The decoded bytes of an array.
Expected<std::vector<std::byte>> read_bytes(const format::Reader& reader,
                                            const format::ArrayInfo& info);

struct ArrayStatistics {
    double min = 0, max = 0, mean = 0;  ///< over the finite elements
    std::uint64_t non_finite_count = 0;
};
/// Uncompressed arrays are read in place: no copy is made.
///
/// Errors:  InvalidBundle  the array does not decode
Expected<ArrayStatistics> statistics(const format::Reader& reader, const format::ArrayInfo& info);

/// Names as people sort them: mesh/2 before mesh/10.
bool natural_less(std::string_view a, std::string_view b);

}  // namespace envbake
