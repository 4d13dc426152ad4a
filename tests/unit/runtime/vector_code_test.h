// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

namespace envbake::runtime {

/// Tests that are also built with forms of the vector code that not every processor runs.
class VectorCodeTest : public testing::Test {
#if defined(ENVBAKE_TEST_avx2)
    void SetUp() override {
        if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma"))
            GTEST_SKIP() << "this processor has no AVX2";
    }
#elif defined(ENVBAKE_TEST_avx512)
    void SetUp() override {
        if (!__builtin_cpu_supports("avx512f")) GTEST_SKIP() << "this processor has no AVX-512";
    }
#endif
};

}  // namespace envbake::runtime
