// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace envbake {

/// What a sample says of all vertices; relative errors, never flattering.
struct ErrorEstimate {
    double rms_sample = 0;  ///< of the sample itself: the likeliest value for rms_traced
    double rms_traced = 0;  ///< over the vertices that need rays
    double rms_all = 0;     ///< over all: the others have no error
    double p999_all = 0;    ///< 99.9th percentile over all
};

/// Estimates from the errors of a random sample of the `traced` of `all` vertices.
///
/// The mean square gets one standard error of the sample added (none where the sample is complete).
/// The percentile is the larger of the sample's own and that of an exponential tail fitted to the
/// sample's upper tenth (or upper 16), its scale one standard error up: a few hundred samples do
/// not hold a 99.9th percentile.
ErrorEstimate estimate_error(std::span<const double> sample, std::uint64_t traced,
                             std::uint64_t all);

}  // namespace envbake
