// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace envbake {

/// Numbers of transport as one element each.
enum class RowEncoding { F32, F16, Unorm16, Unorm8 };

constexpr std::size_t element_bytes(RowEncoding encoding) {
    return encoding == RowEncoding::F32 ? 4 : encoding == RowEncoding::Unorm8 ? 1 : 2;
}

/// How rows will be stored: the unorms as T_i = low_i + step_i q_i, exact at both ends of what
/// coefficient i takes over all the rows.
struct RowCode {
    RowEncoding encoding = RowEncoding::F32;
    std::size_t row_size = 0;
    std::vector<float> range;  ///< [row_size, 2]: low and step; empty for f32 and f16
};

RowCode make_row_code(RowEncoding encoding, std::span<const float> rows, std::size_t row_size);

/// The elements of some rows as they are stored.
std::vector<std::byte> encode_rows(const RowCode& code, std::span<const float> rows);

/// The other way round: what a reader makes of stored elements.
void decode_rows(const RowCode& code, std::span<const std::byte> bytes, std::span<float> rows);

/// What a reader gets of `row`.
void round_trip(const RowCode& code, std::span<const float> row, std::span<float> out);

/// Of |T - T'|_2, over rows.
struct RowError {
    double rms = 0, worst = 0;
};
RowError encoding_error(const RowCode& code, std::span<const float> rows);

}  // namespace envbake
