// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/wavelet_lighting.h"

#include "baker/lighting/box_average.h"
#include "envbake/runtime/sh.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace envbake {

namespace {

/// Number k of a spiral over the sphere.
DVec3 fibonacci_direction(int k, int count) {
    const double z = 1 - (2 * k + 1) / static_cast<double>(count);
    const double phi = std::numbers::pi * (3 - std::sqrt(5.0)) * k;
    const double r = std::sqrt(1 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
}

std::vector<wavelet::Rgb> texels_of(const Environment& environment, int face_size, int channels) {
    const std::vector<float> averages =
        lighting::box_average(environment, MipLayout::CubeFaces, face_size, channels);
    std::vector<wavelet::Rgb> texels(wavelet::coeff_count(face_size));
    const auto c = static_cast<std::size_t>(channels);
    for (std::size_t i = 0; i < texels.size(); ++i)
        for (std::size_t k = 0; k < 3; ++k) texels[i][k] = averages[c * i + (c == 3 ? k : 0)];
    return texels;
}

double sum_of_squares(const DVec3& v) {
    return glm::dot(v, v);
}

}  // namespace

std::vector<wavelet::Rgb> project_wavelet(const Environment& environment, int face_size,
                                          int channels) {
    std::vector<wavelet::Rgb> coeffs(wavelet::coeff_count(face_size));
    std::vector<double> scratch(wavelet::light_scratch_size(face_size));
    wavelet::light_coefficients(face_size, texels_of(environment, face_size, channels), face_size,
                                coeffs, scratch);
    return coeffs;
}

ChosenTerms choose_terms(std::span<const wavelet::Rgb> coeffs, std::span<const float> weights,
                         std::span<const std::vector<float>> rows, double tolerance) {
    std::vector<wavelet::Term> order;
    for (std::uint32_t i = 0; i < coeffs.size(); ++i)
        if (coeffs[i] != wavelet::Rgb{}) order.push_back({i, coeffs[i]});
    // The order by importance: select_terms() of one more and one more would give the same.
    std::sort(order.begin(), order.end(), [&](const wavelet::Term& a, const wavelet::Term& b) {
        const double x = wavelet::importance(a, weights), y = wavelet::importance(b, weights);
        return x != y ? x > y : a.index < b.index;
    });

    // From the last term to the first: what is missing without it and those behind it.
    const auto product = [](const wavelet::Term& term, float transport) {
        return DVec3(term.value[0], term.value[1], term.value[2]) * static_cast<double>(transport);
    };
    double all = 0;
    for (const std::vector<float>& row : rows) {
        DVec3 sum(0);
        for (const wavelet::Term& term : order) sum += product(term, row[term.index]);
        all += sum_of_squares(sum);
    }
    ChosenTerms chosen;
    std::vector<DVec3> missing(rows.size(), DVec3(0));
    std::size_t count = order.size();
    for (; count > 0; --count) {
        const wavelet::Term& term = order[count - 1];
        double square = 0;
        for (std::size_t r = 0; r < rows.size(); ++r) {
            missing[r] += product(term, rows[r][term.index]);
            square += sum_of_squares(missing[r]);
        }
        if (square > tolerance * tolerance * all) break;
        chosen.error = all > 0 ? std::sqrt(square / all) : 0;
    }
    chosen.terms.assign(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count));
    std::sort(chosen.terms.begin(), chosen.terms.end(),
              [](const wavelet::Term& a, const wavelet::Term& b) { return a.index < b.index; });
    return chosen;
}

double sh_shadow_loss(const Environment& environment, int bands) {
    constexpr int n = 16, kSurfaces = 48;
    const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
    const std::vector<wavelet::Rgb> L = texels_of(environment, n, 3);
    std::vector<DVec3> w(L.size()), flux(L.size()), light(coeffs, DVec3(0));
    std::vector<double> d_omega(L.size()), basis(L.size() * coeffs);
    for (std::size_t t = 0; t < L.size(); ++t) {
        const int i = static_cast<int>(t), row = i / n % n, column = i % n;
        const auto towards =
            cube::texel_direction<double>(static_cast<cube::Face>(i / (n * n)), row, column, n);
        w[t] = {towards[0], towards[1], towards[2]};
        d_omega[t] = cube::texel_solid_angle(row, column, n);
        flux[t] = d_omega[t] * DVec3(L[t][0], L[t][1], L[t][2]);
        double* y = &basis[t * coeffs];
        sh::evaluate(bands, w[t].x, w[t].y, w[t].z, y);
        for (std::size_t c = 0; c < coeffs; ++c) light[c] += flux[t] * y[c];
    }
    double wrong = 0, all = 0;
    for (int k = 0; k < kSurfaces; ++k) {
        const DVec3 normal = fibonacci_direction(k, kSurfaces);
        const DVec3 edge = fibonacci_direction(k * 29 % kSurfaces, kSurfaces);  // another for each
        std::vector<double> transport(coeffs, 0);
        DVec3 exact(0), by_sh(0);
        for (std::size_t t = 0; t < L.size(); ++t) {
            const double cosine = glm::dot(normal, w[t]);
            if (cosine <= 0 || glm::dot(edge, w[t]) <= 0) continue;
            exact += cosine * flux[t];
            for (std::size_t c = 0; c < coeffs; ++c)
                transport[c] += cosine * d_omega[t] * basis[t * coeffs + c];
        }
        for (std::size_t c = 0; c < coeffs; ++c) by_sh += light[c] * transport[c];
        wrong += sum_of_squares(by_sh - exact);
        all += sum_of_squares(exact);
    }
    return all > 0 ? std::sqrt(wrong / all) : 0;
}

}  // namespace envbake
