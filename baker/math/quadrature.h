// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace envbake {

/// Nodes and weights on [-1, 1], nodes rising: sum of weight * f(node) is the integral of f.
struct Quadrature {
    std::vector<double> nodes;
    std::vector<double> weights;
    int count() const { return static_cast<int>(nodes.size()); }
};

/// The Gauss-Legendre rule of `count` nodes, exact for polynomials of degree 2 count - 1. Newton's
/// method from the asymptotic node cos(pi (i + 3/4) / (n + 1/2)), [Abramowitz64] 25.4.30
/// and 22.16.6.
inline Quadrature gauss_legendre(int count) {
    Quadrature rule{std::vector<double>(static_cast<std::size_t>(count)),
                    std::vector<double>(static_cast<std::size_t>(count))};
    for (int i = 0; i < count; ++i) {
        double x = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5));
        double slope = 1;
        for (int step = 0; step < 8; ++step) {
            double before = 0, p = 1;
            for (int l = 1; l <= count; ++l) {
                const double next = ((2 * l - 1) * x * p - (l - 1) * before) / l;
                before = p;
                p = next;
            }
            slope = count * (before - x * p) / (1 - x * x);
            x -= p / slope;
        }
        const auto slot = static_cast<std::size_t>(count - 1 - i);
        rule.nodes[slot] = x;
        rule.weights[slot] = 2 / ((1 - x * x) * slope * slope);
    }
    return rule;
}

/// Nodes that Gauss-Legendre needs for functions like e^{i frequency t} on an interval of length
/// `length`, for an error below 1e-16 of the interval: the remainder term of
/// [Abramowitz64] 25.4.30.
inline int gauss_count_for_frequency(double frequency, double length) {
    const double a = frequency * length / 2;
    double bound = 2;  // n = 0
    int n = 0;
    while (bound > 1e-16 || n < 2) {
        // bound(n) = 2^(2n+1) (n!)^4 / ((2n+1) ((2n)!)^3) a^(2n)
        ++n;
        const double even = 2.0 * n, odd = 2.0 * n - 1;
        bound *= 4 * std::pow(n, 4) * odd / ((even + 1) * std::pow(even * odd, 3)) * a * a;
    }
    return n;
}

/// Nodes for a function that is analytic within `distance` of an interval of half width
/// `half_width` (both as seen across the interval): the error falls like rho^(-2n), rho = x +
/// sqrt(1 + x^2), x = distance / half_width. [Trefethen08] theorem 4.5.
inline int gauss_count_for_singularity(double distance, double half_width, double error = 1e-16) {
    const double x = distance / half_width;
    const double log_rho = std::asinh(x);
    return std::max(2, static_cast<int>(std::ceil(std::log(1 / error) / (2 * log_rho))));
}

}  // namespace envbake
