// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/encode_mip.h"

#include <gtest/gtest.h>

namespace envbake {
namespace {

Mip mip_of(float value) {
    Mip mip;
    mip.width = mip.height = 1;
    mip.texels.assign(18, value);
    return mip;
}

TEST(EncodeHalf, OrdinaryRadianceCostsHalfAnUlp) {
    const auto half = encode_half(mip_of(1.0004f), 1, 1e-3);
    ASSERT_TRUE(half);
    EXPECT_EQ(half->texels.size(), 18u);
    EXPECT_NEAR(half->error, 0.0004 / 1.0014, 2e-6);
    EXPECT_LE(half->error, 0x1p-11);
}

TEST(EncodeHalf, ExactValuesCostNothing) {
    const auto half = encode_half(mip_of(0.5f), 1, 0);
    ASSERT_TRUE(half);
    EXPECT_EQ(half->error, 0);
}

TEST(EncodeHalf, ASunBeyondTheRangeStaysFloat) {
    EXPECT_TRUE(encode_half(mip_of(65504), 1, 1e-3));
    EXPECT_FALSE(encode_half(mip_of(83456), 1, 1e-3));
    EXPECT_FALSE(encode_half(mip_of(1e30f), 1, 1e-3));
}

TEST(EncodeHalf, ADarkMapBelowTheNormalRangeStaysFloat) {
    EXPECT_FALSE(encode_half(mip_of(1.03e-7f), 1e-7, 1e-3));
    EXPECT_TRUE(encode_half(mip_of(1.03e-7f), 1, 1e-3)) << "beside a bright map it does not matter";
}

}  // namespace
}  // namespace envbake
