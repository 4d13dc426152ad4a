// SPDX-License-Identifier: Apache-2.0
#include "baker/render/tone_map.h"

#include "baker/render/environment_sampler.h"

#include <algorithm>
#include <cmath>

namespace envbake {

double filmic_curve(double x) {
    if (!(x > 0)) return 0;
    if (x > 1e6) return 1;  // and infinity, which the quotient would turn into NaN
    return std::min(1.0, x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14));
}

// IEC 61966-2-1.
double srgb_from_linear(double linear) {
    if (!(linear > 0)) return 0;
    if (linear >= 1) return 1;
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

double auto_exposure(const Picture& picture, double key) {
    std::size_t surface_count = 0;
    for (std::size_t pixel = 0; pixel < picture.radiance.size(); ++pixel)
        surface_count += picture.is_surface(pixel) ? 1 : 0;
    const auto counts = [&](std::size_t pixel) {
        return surface_count == 0 || picture.is_surface(pixel);
    };
    const double count =
        static_cast<double>(surface_count == 0 ? picture.radiance.size() : surface_count);
    double mean = 0;
    for (std::size_t pixel = 0; pixel < picture.radiance.size(); ++pixel) {
        if (counts(pixel)) mean += std::max(0.0, luminance(DVec3(picture.radiance[pixel]))) / count;
    }
    if (!(mean > 0) || !std::isfinite(mean)) return 1;
    double log_sum = 0;
    for (std::size_t pixel = 0; pixel < picture.radiance.size(); ++pixel) {
        if (!counts(pixel)) continue;
        log_sum += std::log(std::max(1e-3 * mean, luminance(DVec3(picture.radiance[pixel]))));
    }
    return 0.18 * key / std::exp(log_sum / count);
}

DisplayPicture tone_map(const Picture& picture, double exposure) {
    DisplayPicture display{picture.width, picture.height, {}};
    display.rgb.reserve(3 * picture.radiance.size());
    for (const Vec3& radiance : picture.radiance) {
        for (int c = 0; c < 3; ++c) {
            const double exposed = exposure * static_cast<double>(radiance[c]);
            display.rgb.push_back(static_cast<std::uint8_t>(
                std::lround(255 * srgb_from_linear(filmic_curve(exposed)))));
        }
    }
    return display;
}

}  // namespace envbake
