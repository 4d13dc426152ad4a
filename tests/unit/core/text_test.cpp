// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"

#include <gtest/gtest.h>

namespace envbake {
namespace {

TEST(Text, NumbersHaveThreeDigits) {
    EXPECT_EQ(format_number(0), "0");
    EXPECT_EQ(format_number(0.25), "0.25");
    EXPECT_EQ(format_number(1.6134), "1.61");
    EXPECT_EQ(format_number(83456), "83456");
    EXPECT_EQ(format_number(3.21e-9), "3.21e-09");
    EXPECT_EQ(format_number(1e30), "1e+30");
}

TEST(Text, CountsAreApartByThousands) {
    EXPECT_EQ(format_count(0), "0");
    EXPECT_EQ(format_count(999), "999");
    EXPECT_EQ(format_count(1000), "1,000");
    EXPECT_EQ(format_count(41980), "41,980");
    EXPECT_EQ(format_count(1234567), "1,234,567");
}

TEST(Text, BytesStepByThousands) {
    EXPECT_EQ(format_bytes(300), "300 B");
    EXPECT_EQ(format_bytes(1600), "1.6 kB");
    EXPECT_EQ(format_bytes(4300000), "4.3 MB");
    EXPECT_EQ(format_bytes(999999), "1.0 MB");
    EXPECT_EQ(format_bytes(250000000), "250 MB");
}

TEST(Text, QuotesHideNothing) {
    EXPECT_EQ(quoted("a\"b\\c\n\x1b[2J"), "\"a\\\"b\\\\c\\x0a\\x1b[2J\"");
    EXPECT_EQ(printable("two\nlines\x7f"), "two\\x0alines\\x7f");
    EXPECT_EQ(quoted("géométrie ♥"), "\"géométrie ♥\"");
}

}  // namespace
}  // namespace envbake
