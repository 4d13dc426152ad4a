// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/runtime/sh.h"

#include <cstddef>
#include <span>
#include <vector>

namespace envbake {

/// A quadratic form of SH coefficients that no turn about +Z changes: it mixes degrees of one order
/// m, and +m and -m are alike.
struct AxialForm {
    int bands = 0;
    std::vector<double> elements;  ///< blocks of m = 0, 1, ..., each [degrees m .., degrees m ..]

    /// x^T Q x; x is [bands^2], slot sh::index.
    double operator()(std::span<const double> x) const {
        double sum = 0;
        const double* element = elements.data();
        for (int m = 0; m < bands; ++m) {
            for (int l = m; l < bands; ++l) {
                for (int k = m; k < bands; ++k) {
                    sum += *element * x[at(l, m)] * x[at(k, m)];
                    if (m > 0) sum += *element * x[at(l, -m)] * x[at(k, -m)];
                    ++element;
                }
            }
        }
        return sum;
    }

  private:
    static std::size_t at(int l, int m) { return static_cast<std::size_t>(sh::index(l, m)); }
};

}  // namespace envbake
