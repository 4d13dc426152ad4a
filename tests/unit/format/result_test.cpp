// SPDX-License-Identifier: Apache-2.0
#include "envbake/format/result.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

namespace envbake {
namespace {

Result<std::unique_ptr<int>, std::string> half_of(int value) {
    if (value % 2 != 0) return std::to_string(value) + " is odd";
    return std::make_unique<int>(value / 2);
}

Result<int, std::string> quarter_of(int value) {
    ENVBAKE_TRY(const auto half, half_of(value));
    ENVBAKE_TRY(const auto quarter, half_of(*half));
    return *quarter;
}

Result<void, std::string> require_even(int value) {
    ENVBAKE_TRY_VOID(value % 2 == 0 ? Result<void, std::string>() : std::string("odd"));
    return {};
}

TEST(Result, HoldsMoveOnlyValues) {
    EXPECT_EQ(**half_of(84), 42);
}

TEST(Result, TryReturnsTheFirstError) {
    EXPECT_EQ(*quarter_of(84), 21);
    EXPECT_EQ(quarter_of(7).error(), "7 is odd");
    EXPECT_EQ(quarter_of(6).error(), "3 is odd");
}

TEST(Result, VoidResultCarriesOnlyTheError) {
    EXPECT_TRUE(require_even(2));
    EXPECT_EQ(require_even(3).error(), "odd");
}

}  // namespace
}  // namespace envbake
