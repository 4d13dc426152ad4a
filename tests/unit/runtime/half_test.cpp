// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/half.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>

namespace envbake::runtime {
namespace {

/// The value of a finite pattern from the definition of binary16.
double by_definition(std::uint16_t half) {
    const int exponent = half >> 10 & 0x1f, fraction = half & 0x3ff;
    const double magnitude =
        exponent == 0 ? std::ldexp(fraction, -24) : std::ldexp(1024 + fraction, exponent - 25);
    return (half & 0x8000) != 0 ? -magnitude : magnitude;
}

TEST(Half, EveryPatternIsExact) {
    for (std::uint32_t bits = 0; bits < 0x10000; ++bits) {
        const auto half = static_cast<std::uint16_t>(bits);
        const float value = half_to_float(half);
        if ((half & 0x7c00) == 0x7c00) {
            EXPECT_EQ(std::isnan(value), (half & 0x3ff) != 0) << bits;
            EXPECT_EQ(std::isinf(value), (half & 0x3ff) == 0) << bits;
        } else {
            ASSERT_EQ(static_cast<double>(value), by_definition(half)) << bits;
        }
        ASSERT_EQ(std::signbit(value), (half & 0x8000) != 0) << bits;
        if (!std::isnan(value)) {
            ASSERT_EQ(float_to_half(value), half) << bits;
        }
    }
}

// Between every two neighbours: what is below the middle goes down, above it up, the middle to the
// even one. That covers normals, subnormals, and the step from one kind to the other.
TEST(Half, RoundsToNearestEven) {
    for (std::uint16_t low = 0; low < 0x7bff; ++low) {
        const auto high = static_cast<std::uint16_t>(low + 1);
        const auto middle = static_cast<float>((by_definition(low) + by_definition(high)) / 2);
        const std::uint16_t even = (low & 1) == 0 ? low : high;
        ASSERT_EQ(float_to_half(middle), even) << low;
        ASSERT_EQ(float_to_half(-middle), even | 0x8000) << low;
        ASSERT_EQ(float_to_half(std::nextafter(middle, 0.0f)), low) << low;
        ASSERT_EQ(float_to_half(std::nextafter(middle, 1e6f)), high) << low;
    }
}

TEST(Half, Ends) {
    EXPECT_EQ(float_to_half(65504.0f), 0x7bff);
    EXPECT_EQ(float_to_half(std::nextafter(65520.0f, 0.0f)), 0x7bff);
    EXPECT_EQ(float_to_half(65520.0f), 0x7c00);
    EXPECT_EQ(float_to_half(std::numeric_limits<float>::max()), 0x7c00);
    EXPECT_EQ(float_to_half(-std::numeric_limits<float>::infinity()), 0xfc00);
    EXPECT_EQ(float_to_half(std::numeric_limits<float>::denorm_min()), 0);
    EXPECT_EQ(float_to_half(-0.0f), 0x8000);
    EXPECT_EQ(float_to_half(0x1p-25f), 0);  // a tie, to even
    EXPECT_EQ(float_to_half(std::nextafter(0x1p-25f, 1.0f)), 1);
    EXPECT_TRUE(std::isnan(half_to_float(float_to_half(std::nanf("")))));
    static_assert(half_to_float(0x3c00) == 1.0f && float_to_half(1.0f) == 0x3c00);
}

}  // namespace
}  // namespace envbake::runtime
