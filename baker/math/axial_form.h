// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/sh.h"

#include <cstddef>
#include <numeric>
#include <span>
#include <vector>

namespace envbake {

/// Sums of products of SH coefficients, as far as an AxialForm asks for them: of one order m, those
/// of +m and of -m together.
struct AxialMoments {
    int bands = 0;
    std::vector<double> elements;  ///< blocks of m = 0, 1, ..., each [degrees m .., degrees m ..]

    explicit AxialMoments(int of_bands) : bands(of_bands) {
        for (int m = 0; m < bands; ++m)
            elements.resize(elements.size() + static_cast<std::size_t>((bands - m) * (bands - m)));
    }

    /// x is [bands^2], slot sh::index.
    void add(std::span<const double> x) {
        const auto at = [](int l, int m) { return static_cast<std::size_t>(sh::index(l, m)); };
        double* element = elements.data();
        for (int m = 0; m < bands; ++m)
            for (int l = m; l < bands; ++l)
                for (int k = m; k < bands; ++k) {
                    *element += x[at(l, m)] * x[at(k, m)];
                    if (m > 0) *element += x[at(l, -m)] * x[at(k, -m)];
                    ++element;
                }
    }
};

/// A quadratic form of SH coefficients that no turn about +Z changes: it mixes degrees of one order
/// m, and +m and -m are alike.
struct AxialForm {
    int bands = 0;
    std::vector<double> elements;  ///< blocks of m = 0, 1, ..., each [degrees m .., degrees m ..]

    /// The sum of x^T Q x.
    double operator()(const AxialMoments& moments) const {
        return std::inner_product(elements.begin(), elements.end(), moments.elements.begin(), 0.0);
    }
    /// x^T Q x; x is [bands^2], slot sh::index.
    double operator()(std::span<const double> x) const {
        AxialMoments moments(bands);
        moments.add(x);
        return (*this)(moments);
    }
};

}  // namespace envbake
