// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/row_encoding.h"

#include "baker/core/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

namespace envbake {
namespace {

constexpr std::size_t kRowSize = 3;

/// Three coefficients of different ranges; the last is the same in every row.
std::vector<float> rows() {
    RandomStream random(3, 4, 5);
    std::vector<float> values;
    for (int v = 0; v < 200; ++v)
        for (const double x : {random.next() - 0.5, 1e-3 * random.next(), 0.125})
            values.push_back(static_cast<float>(x));
    return values;
}

template <class T>
std::vector<T> elements(const std::vector<std::byte>& bytes) {
    std::vector<T> values(bytes.size() / sizeof(T));
    std::memcpy(values.data(), bytes.data(), bytes.size());
    return values;
}

TEST(RowEncoding, UnormIsWithinHalfAStep) {
    const std::vector<float> values = rows();
    for (const RowEncoding encoding : {RowEncoding::Unorm8, RowEncoding::Unorm16}) {
        const RowCode code = make_row_code(encoding, values, kRowSize);
        ASSERT_EQ(code.range.size(), 2 * kRowSize);
        EXPECT_EQ(code.range[5], 0);
        const auto bytes = encode_rows(code, values);
        double square_sum = 0, worst = 0;
        for (std::size_t v = 0; v < values.size() / kRowSize; ++v) {
            std::vector<float> read(kRowSize);
            round_trip(code, std::span(values).subspan(v * kRowSize, kRowSize), read);
            double square = 0;
            for (std::size_t i = 0; i < kRowSize; ++i) {
                const std::size_t at = v * kRowSize + i;
                const double q = encoding == RowEncoding::Unorm8
                                     ? static_cast<double>(elements<std::uint8_t>(bytes)[at])
                                     : static_cast<double>(elements<std::uint16_t>(bytes)[at]);
                const double low = code.range[2 * i], step = code.range[2 * i + 1];
                EXPECT_NEAR(low + step * q, values[at], 0.5001 * step + 1e-7);
                EXPECT_NEAR(read[i], low + step * q, 1e-7);
                square += std::pow(low + step * q - double{values[at]}, 2);
            }
            square_sum += square;
            worst = std::max(worst, std::sqrt(square));
        }
        const RowError error = encoding_error(code, values);
        EXPECT_NEAR(error.rms,
                    std::sqrt(square_sum * kRowSize / static_cast<double>(values.size())), 1e-7);
        EXPECT_NEAR(error.worst, worst, 1e-7);
        // Uniform rounding of two coefficients that vary: step / sqrt(12) each.
        const double step = code.range[1];
        EXPECT_NEAR(error.rms, step / std::sqrt(12.0), 0.1 * step);
    }
}

TEST(RowEncoding, FloatsAreExactAndHalvesAre11Bits) {
    const std::vector<float> values = rows();
    const RowCode floats = make_row_code(RowEncoding::F32, values, kRowSize);
    EXPECT_EQ(elements<float>(encode_rows(floats, values)), values);
    EXPECT_EQ(encoding_error(floats, values).worst, 0);
    const RowCode halves = make_row_code(RowEncoding::F16, values, kRowSize);
    EXPECT_EQ(encode_rows(halves, values).size(), 2 * values.size());
    const RowError error = encoding_error(halves, values);
    EXPECT_GT(error.worst, 0);
    EXPECT_LT(error.worst, 0.5 * 0x1p-11);
}

TEST(RowEncoding, NoRowsAreNoError) {
    const RowCode code = make_row_code(RowEncoding::Unorm8, {}, kRowSize);
    EXPECT_EQ(code.range, std::vector<float>(2 * kRowSize));
    EXPECT_EQ(encoding_error(code, {}).rms, 0);
}

TEST(RowEncoding, StoredElementsAreReadAsTheRoundTripSays) {
    const std::vector<float> values = rows();
    for (const RowEncoding encoding :
         {RowEncoding::F32, RowEncoding::F16, RowEncoding::Unorm16, RowEncoding::Unorm8}) {
        const RowCode code = make_row_code(encoding, values, kRowSize);
        std::vector<float> read(values.size()), expected(kRowSize);
        decode_rows(code, encode_rows(code, values), read);
        for (std::size_t at = 0; at < values.size(); at += kRowSize) {
            round_trip(code, std::span(values).subspan(at, kRowSize), expected);
            for (std::size_t i = 0; i < kRowSize; ++i) EXPECT_EQ(read[at + i], expected[i]);
        }
    }
}

}  // namespace
}  // namespace envbake
