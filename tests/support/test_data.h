// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <filesystem>

namespace envbake::test {

/// Real input outside the repository: absent on most machines.
inline std::filesystem::path data(const char* relative) {
    return std::filesystem::path(ENVBAKE_TEST_DATA) / relative;
}

}  // namespace envbake::test

/// Skips the running test, loudly, where a file of the test data is absent.
#define ENVBAKE_REQUIRE_DATA(relative)                                                      \
    if (!std::filesystem::exists(envbake::test::data(relative)))                            \
    GTEST_SKIP() << "SKIPPED: test data absent: " << envbake::test::data(relative).string() \
                 << " (set ENVBAKE_TEST_DATA)"
