// SPDX-License-Identifier: Apache-2.0
#include "baker/render/tone_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace envbake {
namespace {

TEST(ToneMap, CurveRisesFromZeroToOne) {
    EXPECT_EQ(filmic_curve(0), 0);
    EXPECT_EQ(filmic_curve(-1), 0);
    EXPECT_EQ(filmic_curve(std::numeric_limits<double>::infinity()), 1);
    EXPECT_EQ(filmic_curve(std::numeric_limits<double>::quiet_NaN()), 0);
    double before = 0;
    for (double x = 1e-6; x < 1e9; x *= 1.05) {
        const double y = filmic_curve(x);
        ASSERT_GE(y, before) << x;
        if (x < 5) {
            ASSERT_GT(y, before) << x;
        }
        ASSERT_LE(y, 1);
        before = y;
    }
    EXPECT_EQ(before, 1);
    // A highlight four times white still has shape.
    EXPECT_LT(filmic_curve(4), 0.98);
}

TEST(ToneMap, TransferFunction) {
    EXPECT_EQ(srgb_from_linear(0), 0);
    EXPECT_EQ(srgb_from_linear(1), 1);
    EXPECT_NEAR(srgb_from_linear(0.0031308), 0.04045, 1e-5);
    EXPECT_NEAR(srgb_from_linear(0.5), 0.735357, 1e-6);
    EXPECT_NEAR(srgb_from_linear(0.0031308 * 1.0001), 0.04045, 2e-5);  // no step between the pieces
}

TEST(ToneMap, ExposureBringsAnEvenPictureToMiddleGrey) {
    Picture picture{2, 1, {Vec3(5), Vec3(5)}, {1, 1}};
    EXPECT_NEAR(auto_exposure(picture) * 5, 0.18, 1e-9);
    EXPECT_NEAR(auto_exposure(picture, 2) * 5, 0.36, 1e-9);
    // The background's sun does not count; without a surface it is all there is.
    picture.radiance[1] = Vec3(1e5f);
    picture.surface[1] = 0;
    EXPECT_NEAR(auto_exposure(picture) * 5, 0.18, 1e-9);
    picture.surface[0] = 0;
    // Then 5 counts as a thousandth of the mean.
    EXPECT_NEAR(auto_exposure(picture) * std::sqrt(50.0025 * 1e5), 0.18, 1e-6);
    EXPECT_EQ(auto_exposure({1, 1, {Vec3(0)}, {1}}), 1);
}

TEST(ToneMap, EightBits) {
    const Picture picture{4, 1, {Vec3(0), Vec3(1e9f), Vec3(-1), Vec3(0, 0.5f, 1)}, {1, 1, 1, 1}};
    const DisplayPicture display = tone_map(picture, 1);
    ASSERT_EQ(display.rgb.size(), 12u);
    EXPECT_EQ(display.rgb[0], 0);
    EXPECT_EQ(display.rgb[3], 255);
    EXPECT_EQ(display.rgb[6], 0);
    EXPECT_EQ(display.rgb[10], std::lround(255 * srgb_from_linear(filmic_curve(0.5))));
    EXPECT_LT(display.rgb[10], display.rgb[11]);
}

}  // namespace
}  // namespace envbake
