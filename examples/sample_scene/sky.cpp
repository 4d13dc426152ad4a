// SPDX-License-Identifier: Apache-2.0
#include "sky.h"

#include <algorithm>
#include <cstddef>
#include <numbers>

namespace envbake::sample {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kKilocandelaPerUnit = 5;

double radians(double degrees) {
    return degrees * (kPi / 180);
}

/// CIE xyY to linear Rec. 709, white at D65. Colours outside the gamut are cut at 0.
Vec3 rec709_from_xyy(double x, double y, double luminance) {
    const double X = luminance * x / y;
    const double Z = luminance * (1 - x - y) / y;
    const Vec3 rgb{3.2404542 * X - 1.5371385 * luminance - 0.4985314 * Z,
                   -0.9692660 * X + 1.8760108 * luminance + 0.0415560 * Z,
                   0.0556434 * X - 0.2040259 * luminance + 1.0572252 * Z};
    return {std::max(0.0, rgb.x), std::max(0.0, rgb.y), std::max(0.0, rgb.z)};
}

/// Exact solid angle of row `row` times the azimuth `width_rad` of one texel.
double texel_solid_angle(int row, int height, double width_rad) {
    return width_rad * (std::cos(kPi * row / height) - std::cos(kPi * (row + 1) / height));
}

}  // namespace

Vec3 sun_direction(const SkyOptions& options) {
    const double elevation = radians(options.sun_elevation_deg);
    const double azimuth = radians(options.sun_azimuth_deg);
    return {std::cos(elevation) * std::cos(azimuth), std::sin(elevation),
            std::cos(elevation) * std::sin(azimuth)};
}

// Transmittance by [Preetham99] appendix A.1 with its Rayleigh and aerosol terms, the two that
// matter to the eye, at one wavelength a channel; the relative optical mass is Kasten's.
Vec3 sun_radiance(const SkyOptions& options) {
    const double zenith_deg = 90 - options.sun_elevation_deg;
    const double mass =
        1 / (std::cos(radians(zenith_deg)) + 0.15 * std::pow(93.885 - zenith_deg, -1.253));
    const double beta = 0.04608 * options.turbidity - 0.04586;
    const auto transmittance = [&](double wavelength_um) {
        const double rayleigh = 0.008735 * std::pow(wavelength_um, -4.08);
        const double aerosol = beta * std::pow(wavelength_um, -1.3);
        return std::exp(-(rayleigh + aerosol) * mass);
    };
    // 128 klx outside the atmosphere, of the colour of a black body of 5,778 K (x, y below).
    const double solid_angle = 2 * kPi * (1 - std::cos(radians(kSunHalfAngleDeg)));
    const Vec3 outside = rec709_from_xyy(0.3265, 0.3357, 128 / solid_angle / kKilocandelaPerUnit);
    return outside * Vec3{transmittance(0.610), transmittance(0.550), transmittance(0.465)};
}

double Sky::Perez::operator()(double cos_theta, double gamma) const {
    const double cos_gamma = std::cos(gamma);
    return (1 + a * std::exp(b / std::max(cos_theta, 1e-3))) *
           (1 + c * std::exp(d * gamma) + e * cos_gamma * cos_gamma);
}

// Constants: [Preetham99] appendix A.2, linear in the turbidity; the zenith's, cubic in the sun's
// zenith angle.
Sky::Sky(const SkyOptions& options) : overcast_(options.overcast), sun_(sun_direction(options)) {
    const double T = options.turbidity;
    const double theta = radians(90 - options.sun_elevation_deg);
    if (overcast_) {
        // CIE: a horizontal illuminance of 0.3 + 21 sin e klx, spread as (1 + 2 sin elevation) / 3.
        const double illuminance = 0.3 + 21 * std::sin(radians(options.sun_elevation_deg));
        zenith_ = {9 / (7 * kPi) * illuminance, 0.3127, 0.3290};
    } else {
        luminance_ = {0.1787 * T - 1.4630, -0.3554 * T + 0.4275, -0.0227 * T + 5.3251,
                      0.1206 * T - 2.5771, -0.0670 * T + 0.3703};
        chroma_x_ = {-0.0193 * T - 0.2592, -0.0665 * T + 0.0008, -0.0004 * T + 0.2125,
                     -0.0641 * T - 0.8989, -0.0033 * T + 0.0452};
        chroma_y_ = {-0.0167 * T - 0.2608, -0.0950 * T + 0.0092, -0.0079 * T + 0.2102,
                     -0.0441 * T - 1.6537, -0.0109 * T + 0.0529};
        const auto cubic = [theta](double c3, double c2, double c1, double c0) {
            return ((c3 * theta + c2) * theta + c1) * theta + c0;
        };
        const double chi = (4.0 / 9 - T / 120) * (kPi - 2 * theta);
        const double luminance = (4.0453 * T - 4.9710) * std::tan(chi) - 0.2155 * T + 2.4192;
        const double x = T * T * cubic(0.00166, -0.00375, 0.00209, 0) +
                         T * cubic(-0.02903, 0.06377, -0.03202, 0.00394) +
                         cubic(0.11693, -0.21196, 0.06052, 0.25886);
        const double y = T * T * cubic(0.00275, -0.00610, 0.00317, 0) +
                         T * cubic(-0.04214, 0.08970, -0.04153, 0.00516) +
                         cubic(0.15346, -0.26756, 0.06670, 0.26688);
        zenith_ = {luminance / luminance_(1, theta), x / chroma_x_(1, theta),
                   y / chroma_y_(1, theta)};
    }
    // Lit by the sky and the sun, the ground shows albedo E / pi. Midpoint rule over the dome.
    Vec3 irradiance{};
    constexpr int kRings = 64, kSectors = 128;
    for (int ring = 0; ring < kRings; ++ring) {
        for (int sector = 0; sector < kSectors; ++sector) {
            const double cos_theta = (ring + 0.5) / kRings;
            const double sin_theta = std::sqrt(1 - cos_theta * cos_theta);
            const double phi = 2 * kPi * (sector + 0.5) / kSectors;
            const Vec3 w{sin_theta * std::cos(phi), cos_theta, sin_theta * std::sin(phi)};
            irradiance = irradiance + cos_theta * above_horizon(w);
        }
    }
    irradiance = (2 * kPi / (kRings * kSectors)) * irradiance;
    if (!overcast_ && options.sun_disc) {
        const double sin_half = std::sin(radians(kSunHalfAngleDeg));
        irradiance = irradiance + (kPi * sin_half * sin_half * sun_.y) * sun_radiance(options);
    }
    constexpr Vec3 kDryGround{0.24, 0.22, 0.18};
    ground_ = (1 / kPi) * (kDryGround * irradiance);
}

Vec3 Sky::above_horizon(Vec3 w) const {
    const double cos_theta = std::clamp(w.y, 0.0, 1.0);
    if (overcast_) {
        const double luminance = zenith_.x * (1 + 2 * cos_theta) / 3;
        return (1 / kKilocandelaPerUnit) * rec709_from_xyy(zenith_.y, zenith_.z, luminance);
    }
    const double gamma = std::acos(std::clamp(dot(w, sun_), -1.0, 1.0));
    return (1 / kKilocandelaPerUnit) * rec709_from_xyy(zenith_.y * chroma_x_(cos_theta, gamma),
                                                       zenith_.z * chroma_y_(cos_theta, gamma),
                                                       zenith_.x * luminance_(cos_theta, gamma));
}

Vec3 Sky::radiance(Vec3 w) const {
    return w.y > 0 ? above_horizon(w) : ground_;
}

// In the polar angle theta about +Y, the disc spans the azimuths
// within
//
//     delta(theta) = acos((cos a - cos theta cos theta_s) / (sin theta sin theta_s))
//
// of the sun's (spherical law of cosines; a is the half-angle), so a texel's share is a
// one-dimensional integral over theta of exact azimuth overlaps. The shares are then scaled so
// that together they are the disc's solid angle 2 pi (1 - cos a) to the last digit.
void add_sun(const SkyOptions& options, SkyImage& image) {
    const double half_angle = radians(kSunHalfAngleDeg);
    const double theta_sun = radians(90 - options.sun_elevation_deg);
    const double turns = options.sun_azimuth_deg / 360 + 0.5;
    const double u_sun = turns - std::floor(turns);
    const int width = image.width, height = image.height;

    struct Share {
        int row, column;
        double d_omega;
    };
    std::vector<Share> shares;
    std::vector<double> row_shares(static_cast<std::size_t>(width));
    double total = 0;
    const double theta_low = std::max(0.0, theta_sun - half_angle);
    const double theta_high = std::min(kPi, theta_sun + half_angle);
    const int first_row = std::clamp(static_cast<int>(theta_low / kPi * height), 0, height - 1);
    const int last_row = std::clamp(static_cast<int>(theta_high / kPi * height), 0, height - 1);
    for (int row = first_row; row <= last_row; ++row) {
        std::fill(row_shares.begin(), row_shares.end(), 0.0);
        const double begin = std::max(theta_low, kPi * row / height);
        const double end = std::min(theta_high, kPi * (row + 1) / height);
        constexpr int kSteps = 1024;
        const double d_theta = (end - begin) / kSteps;
        for (int step = 0; step < kSteps && d_theta > 0; ++step) {
            const double theta = begin + (step + 0.5) * d_theta;
            const double denominator = std::sin(theta) * std::sin(theta_sun);
            const double numerator = std::cos(half_angle) - std::cos(theta) * std::cos(theta_sun);
            // Within a half-angle of the pole the disc may go all the way round.
            double delta = kPi;
            if (numerator > -denominator)
                delta = numerator < denominator ? std::acos(numerator / denominator) : 0;
            const double half_width = delta / (2 * kPi) * width;
            const double left = u_sun * width - half_width, right = u_sun * width + half_width;
            for (double column = std::floor(left); column < right; ++column) {
                const double overlap = std::min(right, column + 1) - std::max(left, column);
                const int wrapped = ((static_cast<int>(column) % width) + width) % width;
                row_shares[static_cast<std::size_t>(wrapped)] +=
                    std::max(0.0, overlap) * (2 * kPi / width) * std::sin(theta) * d_theta;
            }
        }
        for (int column = 0; column < width; ++column) {
            const double d_omega = row_shares[static_cast<std::size_t>(column)];
            if (d_omega <= 0) continue;
            shares.push_back({row, column, d_omega});
            total += d_omega;
        }
    }
    const double scale = 2 * kPi * (1 - std::cos(half_angle)) / total;
    const Vec3 sun = sun_radiance(options);
    for (const Share& share : shares) {
        const double covered =
            share.d_omega * scale / texel_solid_angle(share.row, height, 2 * kPi / width);
        auto& texel =
            image.radiance[static_cast<std::size_t>(share.row) * static_cast<std::size_t>(width) +
                           static_cast<std::size_t>(share.column)];
        texel[0] += static_cast<float>(covered * sun.x);
        texel[1] += static_cast<float>(covered * sun.y);
        texel[2] += static_cast<float>(covered * sun.z);
    }
}

SkyImage make_sky(const SkyOptions& options) {
    SkyImage image{options.width, options.height, {}};
    image.radiance.reserve(static_cast<std::size_t>(options.width) *
                           static_cast<std::size_t>(options.height));
    const Sky sky(options);
    // Even, so that no sample lies on the horizon when it is the middle of a row.
    constexpr int kSamples = 4;
    for (int row = 0; row < options.height; ++row) {
        for (int column = 0; column < options.width; ++column) {
            Vec3 sum{};
            double weight = 0;
            for (int i = 0; i < kSamples; ++i) {
                const double theta = kPi * (row + (i + 0.5) / kSamples) / options.height;
                for (int j = 0; j < kSamples; ++j) {
                    const double phi =
                        2 * kPi * ((column + (j + 0.5) / kSamples) / options.width - 0.5);
                    const Vec3 w{std::sin(theta) * std::cos(phi), std::cos(theta),
                                 std::sin(theta) * std::sin(phi)};
                    sum = sum + std::sin(theta) * sky.radiance(w);
                    weight += std::sin(theta);
                }
            }
            const Vec3 mean = (1 / weight) * sum;
            image.radiance.push_back({static_cast<float>(mean.x), static_cast<float>(mean.y),
                                      static_cast<float>(mean.z)});
        }
    }
    if (!options.overcast && options.sun_disc) add_sun(options, image);
    return image;
}

}  // namespace envbake::sample
