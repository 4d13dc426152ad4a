// SPDX-License-Identifier: Apache-2.0
#include "baker/render/compare.h"

#include "baker/render/environment_sampler.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace envbake {
namespace {

bool counts(const Picture& a, const Picture& b, std::size_t pixel) {
    return a.is_surface(pixel) && b.is_surface(pixel);
}

double ratio(double part, double whole) {
    if (whole != 0) return part / whole;
    return part == 0 ? 0 : std::copysign(std::numeric_limits<double>::infinity(), part);
}

}  // namespace

Comparison compare(const Picture& a, const Picture& b) {
    assert(a.width == b.width && a.height == b.height);
    Comparison result;
    double squared_difference = 0, squared_truth = 0, difference = 0, truth = 0;
    for (std::size_t pixel = 0; pixel < b.radiance.size(); ++pixel) {
        if (!counts(a, b, pixel)) continue;
        ++result.pixel_count;
        const DVec3 expected(b.radiance[pixel]);
        const DVec3 d = DVec3(a.radiance[pixel]) - expected;
        squared_difference += glm::dot(d, d);
        squared_truth += glm::dot(expected, expected);
        difference += d.x + d.y + d.z;
        truth += expected.x + expected.y + expected.z;
    }
    result.relative_rmse = std::sqrt(ratio(squared_difference, squared_truth));
    result.relative_mean_difference = ratio(difference, truth);
    return result;
}

DisplayPicture difference_picture(const Picture& a, const Picture& b, double full_scale) {
    assert(a.width == b.width && a.height == b.height);
    double squares = 0;
    std::size_t count = 0;
    for (std::size_t pixel = 0; pixel < b.radiance.size(); ++pixel) {
        if (!counts(a, b, pixel)) continue;
        const double y = luminance(DVec3(b.radiance[pixel]));
        squares += y * y;
        ++count;
    }
    const double full =
        full_scale * std::sqrt(squares / static_cast<double>(std::max<std::size_t>(count, 1)));
    DisplayPicture picture{b.width, b.height, {}};
    picture.rgb.reserve(3 * b.radiance.size());
    for (std::size_t pixel = 0; pixel < b.radiance.size(); ++pixel) {
        if (!counts(a, b, pixel)) {
            picture.rgb.insert(picture.rgb.end(), {96, 96, 96});
            continue;
        }
        const double d = luminance(DVec3(a.radiance[pixel]) - DVec3(b.radiance[pixel]));
        const double share = full > 0 ? std::clamp(d / full, -1.0, 1.0) : 0;
        const auto rest = static_cast<std::uint8_t>(std::lround(255 * (1 - std::abs(share))));
        const std::uint8_t red = share > 0 ? 255 : rest, blue = share < 0 ? 255 : rest;
        picture.rgb.insert(picture.rgb.end(), {red, rest, blue});
    }
    return picture;
}

}  // namespace envbake
