// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/wavelet.h"

#include <algorithm>
#include <cmath>

namespace envbake::wavelet {

double importance(const Term& term, std::span<const float> weights) noexcept {
    double sum = 0;
    for (const float v : term.value) sum += std::abs(static_cast<double>(v));
    return weights.empty() ? sum : sum * static_cast<double>(weights[term.index]);
}

void light_coefficients(int map_size, std::span<const Rgb> map, int face_size,
                        std::span<Rgb> coeffs, std::span<double> scratch) noexcept {
    const std::size_t m = static_cast<std::size_t>(map_size),
                      n = static_cast<std::size_t>(face_size);
    const std::size_t texels = n * n;
    constexpr std::size_t kPlanes = 3 * static_cast<std::size_t>(cube::kFaceCount);
    double* const flux = scratch.data();  // [face, channel, n, n]
    std::fill_n(flux, kPlanes * texels, 0.0);
    // In units of 1 / (m n) of an edge, texel c of the basis covers c m .. (c + 1) m, texel i of
    // the map i n .. (i + 1) n.
    const auto coordinate = [&](std::size_t units) {
        return 2 * static_cast<double>(units) / static_cast<double>(m * n) - 1;
    };
    for (std::size_t r = 0; r < n; ++r)
        for (std::size_t j = r * m / n; j * n < (r + 1) * m; ++j) {
            const double v0 = coordinate(std::max(r * m, j * n)),
                         v1 = coordinate(std::min((r + 1) * m, (j + 1) * n));
            for (std::size_t c = 0; c < n; ++c)
                for (std::size_t i = c * m / n; i * n < (c + 1) * m; ++i) {
                    const double u0 = coordinate(std::max(c * m, i * n)),
                                 u1 = coordinate(std::min((c + 1) * m, (i + 1) * n));
                    const double d_omega = cube::solid_angle(u0, u1, v0, v1);  // on every face
                    for (std::size_t p = 0; p < kPlanes; ++p)
                        flux[p * texels + r * n + c] +=
                            d_omega * static_cast<double>(map[(p / 3 * m + j) * m + i][p % 3]);
                }
        }
    double* const decomposed = flux + kPlanes * texels;
    for (std::size_t p = 0; p < kPlanes; ++p) {
        forward(face_size, flux + p * texels, decomposed);
        for (std::size_t i = 0; i < texels; ++i)
            coeffs[p / 3 * texels + i][p % 3] = static_cast<float>(decomposed[i]);
    }
}

std::size_t select_terms(std::span<Term> terms, std::span<const float> weights,
                         std::size_t count) noexcept {
    count = std::min(count, terms.size());
    const auto matters_more = [&](const Term& a, const Term& b) {
        const double x = importance(a, weights), y = importance(b, weights);
        return x != y ? x > y : a.index < b.index;
    };
    if (count < terms.size())
        std::nth_element(terms.begin(), terms.begin() + static_cast<std::ptrdiff_t>(count),
                         terms.end(), matters_more);
    std::sort(terms.begin(), terms.begin() + static_cast<std::ptrdiff_t>(count),
              [](const Term& a, const Term& b) { return a.index < b.index; });
    return count;
}

}  // namespace envbake::wavelet
