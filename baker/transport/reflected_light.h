// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/frame.h"
#include "baker/transport/seen_surfaces.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace envbake {

/// Light from surfaces by the direction that it comes from, as one place sees it. Diffuse transport
/// needs its mean over what is blocked alone; a lobe picks some of those directions. For each
/// coefficient of the lighting and each channel, with T of the points that are seen,
///
///     R(w) = albedo(x) T(x) = mean + sum of r_q (Y_q(w) - y_q),   q = 1 .. bands^2 - 1
///
/// y_q the mean of Y_q over the blocked directions, weighted by the cosine as all means here. So
/// r_q moves light from one direction to another and adds none; "mesh/I/reflected" holds them.
class ReflectedLight {
  public:
    /// What is summed over the points.
    struct Job {
        int bands = 1;            ///< of the basis
        std::size_t columns = 0;  ///< of a row of transport: the first so many, [coeff, channel]
        int channels = 1;
        std::function<const float*(std::uint32_t)> row_of;  ///< transport of a place, by number
    };
    /// By one row of `seen`.
    ///   frame  what the directions about the normal are turned by: they are +Z's
    ReflectedLight(const Job& job, const SeenSurfaces& seen, std::size_t row, const Frame& frame);

    /// r of so many bands, [bands^2 - 1, columns]: least squares over the points. Few of them say
    /// little, so each r_q is held to 0 as if one point more said so.
    std::vector<float> variation(int bands) const;

    /// 1/pi integral of (1 - V) max(0, n.w) R(w) Y_k(w) dw, [bands^2, columns]: what a lobe meets,
    /// by the points themselves.
    std::vector<double> met() const;
    /// The same by what another look at the place took R for: its mean and its variation of so many
    /// bands, over the directions of these points.
    std::vector<double> met(const ReflectedLight& other, int bands) const;

  private:
    double basis_product(std::size_t q, std::size_t k) const {
        return q >= k ? products_[q * (q + 1) / 2 + k] : products_[k * (k + 1) / 2 + q];
    }
    /// Sum of Y_q R over the points.
    double light(std::size_t q, std::size_t column) const {
        return static_cast<double>(beyond_first_[q * columns_ + column]) +
               basis_product(q, 0) / kY0 * static_cast<double>(first_[column]);
    }
    static constexpr double kY0 = 0.28209479177387814;  ///< 1 / sqrt(4 pi)

    double share_;           ///< F of SeenSurfaces
    std::size_t functions_;  ///< bands^2
    std::size_t columns_;
    double count_ = 0;              ///< of points
    std::vector<double> products_;  ///< sums of Y_q Y_k, k <= q
    /// R of the first point, and sums of Y_q (R - that), [bands^2, columns]: light that hardly
    /// varies would drown in the rounding of its own sums.
    std::vector<float> first_, beyond_first_;
};

}  // namespace envbake
