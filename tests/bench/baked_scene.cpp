// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/baked_scene.h"

#include <algorithm>
#include <cmath>

namespace envbake::bench {

Expected<std::vector<BakedMesh>> bake_scene(const DiffuseJob& job, const Scene& scene,
                                            const Tracer& tracer) {
    std::vector<BakedMesh> meshes(scene.meshes.size());
    for (std::size_t m = 0; m < meshes.size(); ++m) {
        const auto sink = [&](std::span<const float> rows) -> Expected<void> {
            meshes[m].rows.insert(meshes[m].rows.end(), rows.begin(), rows.end());
            return {};
        };
        Progress progress;
        ENVBAKE_TRY(meshes[m].report, bake_diffuse(job, scene, m, tracer, sink, progress));
    }
    return meshes;
}

std::vector<double> errors_of(const std::vector<BakedMesh>& baked, const std::vector<Place>& places,
                              const std::vector<std::vector<double>>& truth) {
    std::vector<double> errors;
    if (places.empty()) return errors;
    const std::size_t coeffs = truth[0].size();
    const auto bands = static_cast<int>(std::lround(std::sqrt(static_cast<double>(coeffs))));
    const double norm = TransportTruth(bands).unoccluded_norm();
    for (std::size_t i = 0; i < places.size(); ++i) {
        const float* row = &baked[places[i].mesh].rows[places[i].vertex * coeffs];
        double square = 0;
        for (std::size_t c = 0; c < coeffs; ++c) {
            const double difference = static_cast<double>(row[c]) - truth[i][c];
            square += difference * difference;
        }
        errors.push_back(std::sqrt(square) / norm);
    }
    return errors;
}

double rms(const std::vector<double>& errors) {
    double sum = 0;
    for (const double e : errors) sum += e * e;
    return errors.empty() ? 0 : std::sqrt(sum / static_cast<double>(errors.size()));
}

double p999(std::vector<double> errors) {
    if (errors.empty()) return 0;
    std::sort(errors.begin(), errors.end());
    return errors[static_cast<std::size_t>(0.999 * static_cast<double>(errors.size()))];
}

}  // namespace envbake::bench
