// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/diffuse.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/sample_error.h"
#include "baker/transport/visible_transport.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>
#include <vector>

namespace envbake {

namespace {

using std::numbers::pi;

constexpr int kMaxRays = 1 << 18;
constexpr std::size_t kBlock = 64;          ///< vertices of one call of a parallel loop
constexpr std::size_t kHandOver = 1 << 15;  ///< vertices whose rows are in memory together, at most
constexpr std::size_t kKeptOverhead = 64;   ///< bytes of a kept row beside its floats

/// Error falls as the ray count to the power of -1 / kRayExponent. Measured on scans and indoors.
constexpr double kRayExponent = 1.27;

/// Streams of the turns: those of the result and those of the reference it is checked against.
enum Stage : std::uint64_t { kResultTurns = 0x646966, kReferenceTurns, kSampleChoice };

enum class Kind : std::uint8_t { Unreferenced, Merged, Free, Traced };

double unoccluded_norm(int bands) {
    double sum = 0;
    for (int l = 0; l < bands; ++l) {
        const double a = sh::clamped_cosine(l) / pi;
        sum += a * a * (2 * l + 1) / (4 * pi);
    }
    return std::sqrt(sum);
}

int scaled_rays(double ray_count, double factor) {
    return static_cast<int>(std::clamp(ray_count * factor, 16.0, 1.0 * kMaxRays));
}

class DiffuseBake {
  public:
    DiffuseBake(const DiffuseJob& job, const Scene& scene, std::size_t mesh, const Tracer& tracer)
        : job_(job),
          tracer_(tracer),
          mesh_(mesh),
          coeffs_(static_cast<std::size_t>(sh::coeff_count(job.bands))),
          points_(scene.meshes[mesh]) {}

    Expected<DiffuseReport> run(const std::function<Expected<void>(std::span<const float>)>& sink,
                                Progress& progress);

  private:
    void classify();
    void choose_rays();
    ErrorEstimate measure(const RaySet& set, std::span<const std::uint32_t> sample);
    std::vector<std::uint32_t> choose_sample(std::size_t count) const;
    void bake_row(std::uint32_t vertex, std::span<float> row) const;
    double turn_rad(std::uint32_t vertex, Stage stage) const;

    DiffuseJob job_;
    const Tracer& tracer_;
    std::size_t mesh_;
    std::size_t coeffs_;
    SurfacePoints points_;
    std::vector<Kind> kinds_;
    std::uint64_t traced_with_copies_ = 0;
    RaySet set_;
    DiffuseReport report_;
};

double DiffuseBake::turn_rad(std::uint32_t vertex, Stage stage) const {
    return 2 * pi * RandomStream(job_.seed, stage, points_.stream(vertex, tracer_.space())).next();
}

/// Sorts every vertex into its kind and counts.
void DiffuseBake::classify() {
    const std::size_t count = points_.size();
    kinds_.resize(count);
    parallel_for((count + kBlock - 1) / kBlock, [&](std::size_t block) {
        const std::size_t end = std::min((block + 1) * kBlock, count);
        for (std::size_t v = block * kBlock; v < end; ++v) {
            const std::uint32_t place = points_.representative(v);
            if (place == SurfacePoints::kNone)
                kinds_[v] = Kind::Unreferenced;
            else if (place != v)
                kinds_[v] = Kind::Merged;
            else if (!job_.shadowed ||
                     is_free(points_.origin(place, tracer_.space()), tracer_.half_spaces()))
                kinds_[v] = Kind::Free;
            else
                kinds_[v] = Kind::Traced;
        }
    });
    report_.vertex_count = count;
    for (std::size_t v = 0; v < count; ++v) {
        report_.unreferenced_count += kinds_[v] == Kind::Unreferenced;
        report_.merged_count += kinds_[v] == Kind::Merged;
        report_.free_count += kinds_[v] == Kind::Free;
        report_.traced_count += kinds_[v] == Kind::Traced;
        if (kinds_[v] != Kind::Unreferenced)
            traced_with_copies_ += kinds_[points_.representative(v)] == Kind::Traced;
    }
}

/// One vertex at random from each of `count` equal stretches of those that need rays, copies
/// included; each stands for the place it is a copy of.
std::vector<std::uint32_t> DiffuseBake::choose_sample(std::size_t count) const {
    std::vector<std::uint32_t> traced;
    for (std::size_t v = 0; v < points_.size(); ++v)
        if (kinds_[v] != Kind::Unreferenced && kinds_[points_.representative(v)] == Kind::Traced)
            traced.push_back(points_.representative(v));
    if (count >= traced.size()) return traced;
    RandomStream random(job_.seed, kSampleChoice, mesh_);
    std::vector<std::uint32_t> sample;
    const double stretch = static_cast<double>(traced.size()) / static_cast<double>(count);
    for (std::size_t i = 0; i < count; ++i) {
        const auto at =
            static_cast<std::size_t>((static_cast<double>(i) + random.next()) * stretch);
        sample.push_back(traced[std::min(at, traced.size() - 1)]);
    }
    return sample;
}

/// Bakes the sample with `set` as the result will be, and again with four times the rays.
ErrorEstimate DiffuseBake::measure(const RaySet& set, std::span<const std::uint32_t> sample) {
    const RaySet reference_set = make_ray_set(4 * set.ray_count, job_.bands);
    std::vector<double> errors(sample.size());
    const double norm = unoccluded_norm(job_.bands);
    parallel_for(sample.size(), [&](std::size_t i) {
        const std::uint32_t vertex = sample[i];
        const RayOrigin origin = points_.origin(vertex, tracer_.space());
        std::vector<float> row(coeffs_), reference(coeffs_);
        visible_transport(set, tracer_, origin, turn_rad(vertex, kResultTurns), row);
        visible_transport(reference_set, tracer_, origin, turn_rad(vertex, kReferenceTurns),
                          reference);
        double square = 0;
        for (std::size_t c = 0; c < coeffs_; ++c) {
            const double difference = double{row[c]} - double{reference[c]};
            square += difference * difference;
        }
        // Two bakes that agree may still both have missed something: by the rule of succession,
        // one more ray would have differed with probability 1 / (rays + 2), and that ray's share
        // of the transfer is of the order of the whole. Agreement is not counted as less.
        const double unseen = 1.0 / (set.ray_count + reference_set.ray_count + 2);
        errors[i] = std::max(std::sqrt(square) / norm, unseen);
    });
    report_.check_ray_count +=
        sample.size() * static_cast<std::uint64_t>(set.ray_count + reference_set.ray_count);
    return estimate_error(errors, traced_with_copies_, report_.vertex_count);
}

/// Fixes the ray set, and with it the error that the report states.
void DiffuseBake::choose_rays() {
    // At five times the rays each, a sixty-fourth of the places costs 8 %; few places need more.
    const std::size_t places = report_.traced_count;
    const std::size_t sample_size =
        std::clamp(places / 64, std::min<std::size_t>(32, places / 32 + 2), std::size_t{512});
    const std::vector<std::uint32_t> sample = choose_sample(sample_size);
    const int expected = expected_rays_per_vertex(job_);
    const bool fixed = job_.rays_per_vertex > 0;
    // What the count must be multiplied by to get an error to just below the tolerance.
    const auto correction = [&](const ErrorEstimate& error, double aim) {
        return std::pow(error.rms_sample / (aim * job_.tolerance), kRayExponent);
    };

    set_ = make_ray_set(expected, job_.bands);
    constexpr std::size_t kPilotPart = 4;
    if (!fixed && sample.size() >= 64) {
        std::vector<std::uint32_t> pilot;
        for (std::size_t i = 0; i < sample.size(); i += kPilotPart) pilot.push_back(sample[i]);
        const double factor = std::clamp(correction(measure(set_, pilot), 0.9), 0.25, 8.0);
        set_ = make_ray_set(scaled_rays(set_.ray_count, factor), job_.bands);
    }
    ErrorEstimate error = measure(set_, sample);
    for (int round = 0; round < 2 && !fixed; ++round) {
        if (error.rms_traced <= job_.tolerance || set_.ray_count >= kMaxRays) break;
        const double factor = std::clamp(correction(error, 0.9), 1.1, 8.0);
        set_ = make_ray_set(scaled_rays(set_.ray_count, factor), job_.bands);
        error = measure(set_, sample);
    }
    report_.rays_per_vertex = set_.ray_count;
    report_.error_rms = error.rms_all;
    report_.error_p999 = error.p999_all;
}

void DiffuseBake::bake_row(std::uint32_t vertex, std::span<float> row) const {
    const RayOrigin origin = points_.origin(vertex, tracer_.space());
    if (kinds_[vertex] == Kind::Traced) {
        visible_transport(set_, tracer_, origin, turn_rad(vertex, kResultTurns), row);
        return;
    }
    std::array<double, sh::coeff_count(sh::kMaxBundleBands)> exact;
    unoccluded_transport(job_.bands, origin.normal, exact);
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<float>(exact[i]);
}

Expected<DiffuseReport> DiffuseBake::run(
    const std::function<Expected<void>(std::span<const float>)>& sink, Progress& progress) {
    classify();
    if (report_.traced_count > 0) choose_rays();
    report_.ray_count = report_.traced_count * static_cast<std::uint64_t>(report_.rays_per_vertex);

    const std::size_t count = points_.size();
    std::vector<std::uint32_t> last_copy(count, 0);  // of each representative
    for (std::uint32_t v = 0; v < count; ++v)
        if (kinds_[v] == Kind::Merged) last_copy[points_.representative(v)] = v;

    // Half of the budget for the rows of one hand-over, the rest for rows that copies wait for.
    const std::size_t row_bytes = coeffs_ * sizeof(float);
    const std::size_t hand_over = std::clamp(job_.memory_bytes / 2 / row_bytes, kBlock, kHandOver);
    const std::size_t in_hand = std::min(hand_over, count) * row_bytes;
    const std::size_t max_kept =
        (job_.memory_bytes - std::min(job_.memory_bytes, in_hand)) / (row_bytes + kKeptOverhead);
    std::vector<float> rows(std::min(hand_over, count) * coeffs_);
    std::unordered_map<std::uint32_t, std::vector<float>> kept;  // rows from before that are copied
    for (std::size_t begin = 0; begin < count; begin += hand_over) {
        const std::size_t size = std::min(hand_over, count - begin);
        // A copy of what is no longer in memory is baked again: the same bits, for more rays.
        const auto is_repeated = [&](std::size_t v) {
            const std::uint32_t place = points_.representative(v);
            return kinds_[v] == Kind::Merged && place < begin && !kept.contains(place);
        };
        const auto row = [&](std::size_t v) {
            return std::span(rows).subspan((v - begin) * coeffs_, coeffs_);
        };
        parallel_for((size + kBlock - 1) / kBlock, [&](std::size_t block) {
            const std::size_t first = begin + block * kBlock;
            const std::size_t end = std::min(first + kBlock, begin + size);
            for (std::size_t v = first; v < end; ++v) {
                if (kinds_[v] == Kind::Unreferenced)
                    std::fill(row(v).begin(), row(v).end(), 0.0f);
                else if (kinds_[v] != Kind::Merged || is_repeated(v))
                    bake_row(points_.representative(v), row(v));
            }
            progress.add(end - first);
        });
        for (std::size_t v = begin; v < begin + size; ++v) {
            if (is_repeated(v)) {
                if (kinds_[points_.representative(v)] == Kind::Traced)
                    report_.repeated_ray_count +=
                        static_cast<std::uint64_t>(report_.rays_per_vertex);
            } else if (kinds_[v] == Kind::Merged) {
                const std::uint32_t place = points_.representative(v);
                const std::span<const float> source =
                    place >= begin ? row(place) : std::span<float>(kept.at(place));
                std::copy(source.begin(), source.end(), row(v).begin());
                if (place < begin && last_copy[place] == v) kept.erase(place);
            } else if (kinds_[v] == Kind::Traced && last_copy[v] >= begin + size &&
                       kept.size() < max_kept) {
                kept.emplace(static_cast<std::uint32_t>(v),
                             std::vector<float>(row(v).begin(), row(v).end()));
            }
        }
        ENVBAKE_TRY_VOID(sink(std::span(rows).first(size * coeffs_)));
    }
    return report_;
}

Expected<void> check(const DiffuseJob& job) {
    if (job.bands < 1 || job.bands > sh::kMaxBundleBands)
        return Error{Errc::Usage, concat("diffuse transport: ", job.bands, " bands; 1 to ",
                                         sh::kMaxBundleBands, " are possible")};
    if (!(job.tolerance > 0))
        return Error{Errc::Usage, concat("diffuse transport: a tolerance of ", job.tolerance,
                                         "; it must be above 0")};
    if (job.rays_per_vertex < 0)
        return Error{Errc::Usage, concat("diffuse transport: ", job.rays_per_vertex,
                                         " rays a vertex; 0 chooses from the tolerance")};
    return {};
}

}  // namespace

int expected_rays_per_vertex(const DiffuseJob& job) {
    if (job.rays_per_vertex > 0) return job.rays_per_vertex;
    // The Stanford bunny at 5 bands. More bands are more coefficients that carry the same error.
    constexpr double kRays = 450, kTolerance = 1e-2, kBands = 5;
    return scaled_rays(kRays,
                       std::pow(kTolerance / job.tolerance * job.bands / kBands, kRayExponent));
}

void unoccluded_transport(int bands, const DVec3& n, std::span<double> out) {
    sh::evaluate(bands, n.x, n.y, n.z, out.data());
    for (int l = 0; l < bands; ++l)
        for (int m = -l; m <= l; ++m)
            out[static_cast<std::size_t>(sh::index(l, m))] *= sh::clamped_cosine(l) / pi;
}

Expected<DiffuseReport> bake_diffuse(
    const DiffuseJob& job, const Scene& scene, std::size_t mesh, const Tracer& tracer,
    const std::function<Expected<void>(std::span<const float>)>& sink, Progress& progress) {
    ENVBAKE_TRY_VOID(check(job));
    return DiffuseBake(job, scene, mesh, tracer).run(sink, progress);
}

}  // namespace envbake
