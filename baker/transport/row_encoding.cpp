// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/row_encoding.h"

#include "envbake/runtime/half.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace envbake {

namespace {

double levels(RowEncoding encoding) {
    return encoding == RowEncoding::Unorm8 ? 255 : 65535;
}

/// The nearest q; 0 where a coefficient is the same for every row.
double quantised(const RowCode& code, std::size_t i, float value) {
    const double low = code.range[2 * i], step = code.range[2 * i + 1];
    if (step == 0) return 0;
    return std::clamp(std::round((double{value} - low) / step), 0.0, levels(code.encoding));
}

/// What a reader makes of it.
float value_of(const RowCode& code, std::size_t i, double q) {
    return static_cast<float>(double{code.range[2 * i]} + double{code.range[2 * i + 1]} * q);
}

template <class T, class Encode>
std::vector<std::byte> encode_as(std::span<const float> rows, Encode&& encode) {
    std::vector<std::byte> bytes(rows.size() * sizeof(T));
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const T element = encode(i);
        std::memcpy(&bytes[i * sizeof(T)], &element, sizeof(T));
    }
    return bytes;
}

template <class T, class Decode>
void decode_as(std::span<const std::byte> bytes, std::span<float> rows, Decode&& decode) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
        T element;
        std::memcpy(&element, &bytes[i * sizeof(T)], sizeof(T));
        rows[i] = decode(i, element);
    }
}

}  // namespace

RowCode make_row_code(RowEncoding encoding, std::span<const float> rows, std::size_t row_size) {
    RowCode code{encoding, row_size, {}};
    if (encoding == RowEncoding::F32 || encoding == RowEncoding::F16) return code;
    std::vector<float> low(row_size, std::numeric_limits<float>::infinity()),
        high(row_size, -std::numeric_limits<float>::infinity());
    for (std::size_t at = 0; at < rows.size(); at += row_size)
        for (std::size_t i = 0; i < row_size; ++i) {
            low[i] = std::min(low[i], rows[at + i]);
            high[i] = std::max(high[i], rows[at + i]);
        }
    for (std::size_t i = 0; i < row_size; ++i) {
        const double width = rows.empty() ? 0 : double{high[i]} - double{low[i]};
        code.range.push_back(rows.empty() ? 0 : low[i]);
        code.range.push_back(static_cast<float>(width / levels(encoding)));
    }
    return code;
}

std::vector<std::byte> encode_rows(const RowCode& code, std::span<const float> rows) {
    const auto q = [&](std::size_t i) { return quantised(code, i % code.row_size, rows[i]); };
    switch (code.encoding) {
        case RowEncoding::F32:
            break;
        case RowEncoding::F16:
            return encode_as<std::uint16_t>(
                rows, [&](std::size_t i) { return runtime::float_to_half(rows[i]); });
        case RowEncoding::Unorm16:
            return encode_as<std::uint16_t>(
                rows, [&](std::size_t i) { return static_cast<std::uint16_t>(q(i)); });
        case RowEncoding::Unorm8:
            return encode_as<std::uint8_t>(
                rows, [&](std::size_t i) { return static_cast<std::uint8_t>(q(i)); });
    }
    return encode_as<float>(rows, [&](std::size_t i) { return rows[i]; });
}

void decode_rows(const RowCode& code, std::span<const std::byte> bytes, std::span<float> rows) {
    const auto unorm = [&](std::size_t i, double q) {
        return value_of(code, i % code.row_size, q);
    };
    switch (code.encoding) {
        case RowEncoding::F32:
            return decode_as<float>(bytes, rows, [](std::size_t, float value) { return value; });
        case RowEncoding::F16:
            return decode_as<std::uint16_t>(bytes, rows, [](std::size_t, std::uint16_t bits) {
                return runtime::half_to_float(bits);
            });
        case RowEncoding::Unorm16:
            return decode_as<std::uint16_t>(bytes, rows, unorm);
        case RowEncoding::Unorm8:
            return decode_as<std::uint8_t>(bytes, rows, unorm);
    }
}

void round_trip(const RowCode& code, std::span<const float> row, std::span<float> out) {
    for (std::size_t i = 0; i < row.size(); ++i) {
        if (code.encoding == RowEncoding::F32)
            out[i] = row[i];
        else if (code.encoding == RowEncoding::F16)
            out[i] = runtime::half_to_float(runtime::float_to_half(row[i]));
        else
            out[i] = value_of(code, i, quantised(code, i, row[i]));
    }
}

RowError encoding_error(const RowCode& code, std::span<const float> rows) {
    RowError error;
    std::vector<float> read(code.row_size);
    double sum = 0;
    for (std::size_t at = 0; at < rows.size(); at += code.row_size) {
        const auto row = rows.subspan(at, code.row_size);
        round_trip(code, row, read);
        double square = 0;
        for (std::size_t i = 0; i < row.size(); ++i) {
            const double difference = double{row[i]} - double{read[i]};
            square += difference * difference;
        }
        sum += square;
        error.worst = std::max(error.worst, std::sqrt(square));
    }
    if (!rows.empty())
        error.rms = std::sqrt(sum / static_cast<double>(rows.size() / code.row_size));
    return error;
}

}  // namespace envbake
