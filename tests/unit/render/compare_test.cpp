// SPDX-License-Identifier: Apache-2.0
#include "baker/render/compare.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace envbake {
namespace {

Picture row_of(std::vector<Vec3> radiance) {
    Picture picture{static_cast<int>(radiance.size()), 1, std::move(radiance), {}};
    picture.surface.assign(picture.radiance.size(), 1.0f);
    return picture;
}

TEST(Compare, EqualPicturesDifferByNothing) {
    const Picture a = row_of({Vec3(1, 2, 3), Vec3(0.5f)});
    const Comparison c = compare(a, a);
    EXPECT_EQ(c.relative_rmse, 0);
    EXPECT_EQ(c.relative_mean_difference, 0);
    EXPECT_EQ(c.pixel_count, 2u);
}

// |a - b|^2 = 1 + 4, |b|^2 = 9 + 16; sum(a - b) = 1 - 2, sum b = 7.
TEST(Compare, KnownNumbers) {
    const Picture a = row_of({Vec3(4, 0, 0), Vec3(0, 0, 2)});
    const Picture b = row_of({Vec3(3, 0, 0), Vec3(0, 0, 4)});
    const Comparison c = compare(a, b);
    EXPECT_NEAR(c.relative_rmse, std::sqrt(5.0 / 25), 1e-12);
    EXPECT_NEAR(c.relative_mean_difference, -1.0 / 7, 1e-12);
}

TEST(Compare, BackgroundDoesNotCount) {
    Picture a = row_of({Vec3(1), Vec3(1e6f)});
    const Picture b = row_of({Vec3(1), Vec3(0)});
    a.surface[1] = 0.5f;
    const Comparison c = compare(a, b);
    EXPECT_EQ(c.relative_rmse, 0);
    EXPECT_EQ(c.pixel_count, 1u);
}

TEST(Compare, BlackTruth) {
    const Picture black = row_of({Vec3(0)});
    EXPECT_EQ(compare(black, black).relative_rmse, 0);
    EXPECT_TRUE(std::isinf(compare(row_of({Vec3(1)}), black).relative_rmse));
}

TEST(DifferencePicture, RedWhereBrighterBlueWhereDarker) {
    Picture a = row_of({Vec3(1), Vec3(2), Vec3(0), Vec3(1.25f), Vec3(7)});
    Picture b = row_of({Vec3(1), Vec3(1), Vec3(1), Vec3(1), Vec3(1)});
    b.surface[4] = 0;
    const DisplayPicture d = difference_picture(a, b, 0.5);
    const std::vector<std::uint8_t> expected = {255, 255, 255, 255, 0,  0,  0, 0,
                                                255, 255, 128, 128, 96, 96, 96};
    EXPECT_EQ(d.rgb, expected);
}

}  // namespace
}  // namespace envbake
