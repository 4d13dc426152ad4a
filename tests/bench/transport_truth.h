// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/trace/tracer.h"
#include "baker/transport/ray_origin.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace envbake::bench {

/// What a baked vector is held against. Of the baker it uses the place that rays start from and
/// the tracer; directions, weights, basis and sums are its own.
///
/// Directions: 2^16 points of the (0, 2)-sequence of Sobol, each coordinate scrambled by a random
/// binary tree of its own [Owen95], and mapped to the hemisphere with density cos / pi.
class TransportTruth {
  public:
    static constexpr int kLogRays = 16;

    explicit TransportTruth(int bands);

    /// T of one place, [bands^2].
    ///   log_rays  2^log_rays rays, at most 2^16
    ///   seed      another one is another, independent, estimate
    std::vector<double> at(const RayOrigin& origin, const Tracer& tracer, std::uint64_t seed,
                           int log_rays = kLogRays) const;

    /// |T_unoccluded|_2, by Simpson's rule.
    double unoccluded_norm() const;

  private:
    void basis(const DVec3& w, std::span<double> y) const;

    int bands_;
    std::vector<double> zonal_;       ///< 2 * integral over [0, 1] of z P_l(z)
    std::vector<double> normalizer_;  ///< of Y_lm, by l (l + 1) / 2 + m
};

struct Place {
    std::size_t mesh;
    std::uint32_t vertex;
};

/// Different vertices of the scene, every one as likely; always the same.
std::vector<Place> random_places(const Scene& scene, std::size_t count);

/// Of every place, [places][bands^2].
std::vector<std::vector<double>> find_truth(int bands, const Scene& scene, const Tracer& tracer,
                                            const std::vector<Place>& places, int log_rays);

}  // namespace envbake::bench
