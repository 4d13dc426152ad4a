// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/transport/diffuse.h"
#include "tests/bench/transport_truth.h"

#include <vector>

namespace envbake::bench {

struct BakedMesh {
    DiffuseReport report;
    std::vector<float> rows;  ///< [vertices, bands^2]
};

Expected<std::vector<BakedMesh>> bake_scene(const DiffuseJob& job, const Scene& scene,
                                            const Tracer& tracer);

/// |T - truth|_2 / |T_unoccluded|_2 of every place.
std::vector<double> errors_of(const std::vector<BakedMesh>& baked, const std::vector<Place>& places,
                              const std::vector<std::vector<double>>& truth);

double rms(const std::vector<double>& errors);
double p999(std::vector<double> errors);  ///< 99.9th percentile

}  // namespace envbake::bench
