// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/diffuse.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/transport/crossing_error.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/visible_transport.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <unordered_map>
#include <vector>

namespace envbake {

namespace {

using std::numbers::pi;

constexpr int kMaxRays = 1 << 18;
constexpr std::size_t kBlock = 64;          ///< vertices of one call of a parallel loop
constexpr std::size_t kHandOver = 1 << 15;  ///< vertices whose rows are in memory together

/// A pilot makes the rays that follow it less of a neighbourhood, which costs 5 to 7 % of their
/// time, and saves three quarters of the rays of a solved vertex: below this share of solved
/// vertices it does not pay.
constexpr double kSolvedShareThatPays = 0.14;
/// With fewer rays a pilot overlooks too much: 32 missed a quarter of the error, unseen by any
/// estimate of it.
constexpr int kFewestPilotRays = 48;

/// Random streams: turns of the result, turns of the second bake that it is held against, choice of
/// the vertices that are baked twice.
enum Stage : std::uint64_t { kResultTurns = 0x646966, kSecondTurns, kSampleChoice };

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

/// How the ray count must change for the mean square error to be multiplied by `factor`.
double rays_for_variance(double factor) {
    return std::pow(factor, -1 / kVarianceExponent);
}

class DiffuseBake {
  public:
    DiffuseBake(const DiffuseJob& job, const Scene& scene, std::size_t mesh, const Tracer& tracer)
        : job_(job),
          tracer_(tracer),
          mesh_(scene.meshes[mesh]),
          coeffs_(static_cast<std::size_t>(sh::coeff_count(job.bands))),
          points_(scene.meshes[mesh]) {}

    Expected<DiffuseReport> run(const std::function<Expected<void>(std::span<const float>)>& sink,
                                Progress& progress);

  private:
    void classify();
    void choose_rays();
    std::vector<std::uint32_t> choose_sample() const;
    std::vector<BakedTwice> bake_twice(const RaySet& set, std::span<const std::uint32_t> sample);
    double mean_square(const CrossingError& error, std::span<const std::uint32_t> sample,
                       std::span<const BakedTwice> baked) const;
    Traced bake_row(std::uint32_t vertex, std::span<float> row) const;
    double random(std::uint32_t vertex, Stage stage) const;

    DiffuseJob job_;
    const Tracer& tracer_;
    const Mesh& mesh_;
    std::size_t coeffs_;
    SurfacePoints points_;
    std::vector<Kind> kinds_;
    std::vector<std::uint32_t> copies_;  ///< of each representative, itself included
    RaySet set_;
    CrossingError error_;
    DiffuseReport report_;
};

/// Uniform in [0, 1), from where the vertex is and how it faces: not from its number, so that a
/// vertex has the same result wherever it stands in the file.
double DiffuseBake::random(std::uint32_t vertex, Stage stage) const {
    const Vec3 place = tracer_.space().to_local(mesh_.positions[vertex]);
    std::uint64_t key = 0;
    for (const Vec3& v : {place, mesh_.normals[vertex]})
        for (int axis = 0; axis < 3; ++axis)  // -0 + 0 is 0
            key =
                RandomStream(key, stage, std::bit_cast<std::uint32_t>(v[axis] + 0.0f)).next_bits();
    return RandomStream(job_.seed, stage, key).next();
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
    copies_.assign(count, 0);
    for (std::size_t v = 0; v < count; ++v) {
        report_.unreferenced_count += kinds_[v] == Kind::Unreferenced;
        report_.merged_count += kinds_[v] == Kind::Merged;
        report_.free_count += kinds_[v] == Kind::Free;
        report_.traced_count += kinds_[v] == Kind::Traced;
        if (kinds_[v] != Kind::Unreferenced) ++copies_[points_.representative(v)];
    }
}

/// Traced places at random, in an order that does not depend on that of the vertices.
std::vector<std::uint32_t> DiffuseBake::choose_sample() const {
    // Each of the sample costs as much as two vertices, and what a sample of S leaves unknown of
    // the mean square, 0.85 / sqrt(S), costs rays as well: for most meshes this is near the least.
    const std::size_t count = std::clamp<std::size_t>(
        report_.traced_count / 96, std::min<std::size_t>(report_.traced_count / 12 + 2, 64), 512);
    std::vector<std::pair<double, std::uint32_t>> places;
    for (std::uint32_t v = 0; v < points_.size(); ++v)
        if (kinds_[v] == Kind::Traced) places.emplace_back(random(v, kSampleChoice), v);
    const std::size_t taken = std::min(count, places.size());
    std::partial_sort(places.begin(), places.begin() + static_cast<std::ptrdiff_t>(taken),
                      places.end());
    std::vector<std::uint32_t> sample;
    for (std::size_t i = 0; i < taken; ++i) sample.push_back(places[i].second);
    return sample;
}

/// The sample as the result will be, and each again with a turn of its own, never stopped: the
/// second bake tells what stopping overlooked, too.
std::vector<BakedTwice> DiffuseBake::bake_twice(const RaySet& set,
                                                std::span<const std::uint32_t> sample) {
    std::vector<BakedTwice> baked(sample.size());
    std::vector<int> rays(sample.size());
    const double norm = unoccluded_norm(job_.bands);
    parallel_for(sample.size(), [&](std::size_t i) {
        const RayOrigin origin = points_.origin(sample[i], tracer_.space());
        std::vector<float> row(coeffs_), other(coeffs_);
        const Traced first =
            visible_transport(set, tracer_, origin, 2 * pi * random(sample[i], kResultTurns), row);
        const Traced second = visible_transport(
            set, tracer_, origin, 2 * pi * random(sample[i], kSecondTurns), other, Stop::Never);
        double square = 0;
        for (std::size_t c = 0; c < coeffs_; ++c) {
            const double difference = double{row[c]} - double{other[c]};
            square += difference * difference;
        }
        const bool alike = first.crossings > 0;  // else the second one's own error hardly counts
        baked[i] = {first.crossings, square / (norm * norm) / (alike ? 2 : 1)};
        rays[i] = first.rays + second.rays;
    });
    for (const int count : rays) report_.check_ray_count += static_cast<std::uint64_t>(count);
    return baked;
}

/// Expected mean square error of the whole mesh, by the crossings of the sample.
double DiffuseBake::mean_square(const CrossingError& error, std::span<const std::uint32_t> sample,
                                std::span<const BakedTwice> baked) const {
    double sum = 0, weights = 0, traced_with_copies = 0;
    for (std::size_t i = 0; i < sample.size(); ++i) {
        const double weight = copies_[sample[i]];
        const int crossings = baked[i].crossings;
        sum += weight * (crossings == 0 ? error.solved : error.per_crossing * crossings);
        weights += weight;
    }
    for (std::size_t v = 0; v < copies_.size(); ++v)
        if (kinds_[v] == Kind::Traced) traced_with_copies += copies_[v];
    return sum / weights * traced_with_copies / static_cast<double>(report_.vertex_count);
}

/// Fixes the ray set and what one crossing of its rays says of the error.
void DiffuseBake::choose_rays() {
    const std::vector<std::uint32_t> sample = choose_sample();
    const int first_guess = expected_rays_per_vertex(job_);
    if (job_.rays_per_vertex > 0) {
        set_ = make_ray_set(first_guess, job_.bands);
        error_ = fit_error(CrossingError::expected(set_.ray_count, false, job_.bands),
                           bake_twice(set_, sample));
        return;
    }

    // The aim is a little below the tolerance, for what the sample does not know of the mesh.
    constexpr double kAim = 0.98;
    const auto rays_needed = [&](const RaySet& set, const CrossingError& error,
                                 std::span<const std::uint32_t> places,
                                 std::span<const BakedTwice> baked, double samples) {
        const double stated =
            mean_square(error, places, baked) *
            standard_error_factor(samples, static_cast<double>(report_.traced_count));
        const double aim = kAim * job_.tolerance;
        return scaled_rays(set.ray_count, rays_for_variance(aim * aim / stated));
    };

    // Few vertices tell about how many rays the mesh needs, and whether many are solved by a pilot.
    const auto few = std::span(sample).first(std::min<std::size_t>(sample.size(), 64));
    RaySet set = make_ray_set(first_guess, job_.bands, true);
    std::vector<BakedTwice> baked = bake_twice(set, few);
    const auto solved = std::count_if(baked.begin(), baked.end(),
                                      [](const BakedTwice& b) { return b.crossings == 0; });
    const bool many_solved =
        static_cast<double>(solved) > kSolvedShareThatPays * static_cast<double>(few.size());
    const CrossingError rough =
        fit_error(CrossingError::expected(set.ray_count, true, job_.bands), baked);
    int rays = rays_needed(set, rough, few, baked,
                           rough.samples + static_cast<double>(sample.size() - few.size()));

    // The whole sample, at a count so near to the final one that the law bridges the difference.
    bool with_pilot = false;
    for (int round = 0; round < 3; ++round) {
        with_pilot = many_solved && rays >= 4 * kFewestPilotRays;
        set = make_ray_set(rays, job_.bands, with_pilot);
        baked = bake_twice(set, sample);
        error_ = fit_error(CrossingError::expected(set.ray_count, with_pilot, job_.bands), baked);
        rays = rays_needed(set, error_, sample, baked, error_.samples);
        if (std::abs(std::log(static_cast<double>(rays) / set.ray_count)) < std::log(1.3)) break;
    }
    set_ = make_ray_set(rays, job_.bands, with_pilot);
    error_ = error_.scaled(set.ray_count, set_.ray_count);
}

Traced DiffuseBake::bake_row(std::uint32_t vertex, std::span<float> row) const {
    const RayOrigin origin = points_.origin(vertex, tracer_.space());
    if (kinds_[vertex] == Kind::Traced)
        return visible_transport(set_, tracer_, origin, 2 * pi * random(vertex, kResultTurns), row);
    std::array<double, sh::coeff_count(sh::kMaxBundleBands)> exact;
    unoccluded_transport(job_.bands, origin.normal, exact);
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<float>(exact[i]);
    return {};
}

Expected<DiffuseReport> DiffuseBake::run(
    const std::function<Expected<void>(std::span<const float>)>& sink, Progress& progress) {
    classify();
    if (report_.traced_count > 0) choose_rays();
    report_.rays_per_vertex = set_.ray_count;
    std::vector<std::uint64_t> histogram(static_cast<std::size_t>(set_.ray_count) + 1, 0);

    const std::size_t count = points_.size();
    std::vector<std::uint32_t> last_copy(count, 0);  // of each representative
    for (std::uint32_t v = 0; v < count; ++v)
        if (kinds_[v] == Kind::Merged) last_copy[points_.representative(v)] = v;

    std::vector<float> rows(std::min(kHandOver, count) * coeffs_);
    std::vector<Traced> traced(std::min(kHandOver, count));
    std::unordered_map<std::uint32_t, std::vector<float>> kept;  // rows from before that are copied
    for (std::size_t begin = 0; begin < count; begin += kHandOver) {
        const std::size_t size = std::min(kHandOver, count - begin);
        const auto row = [&](std::size_t v) {
            return std::span(rows).subspan((v - begin) * coeffs_, coeffs_);
        };
        parallel_for((size + kBlock - 1) / kBlock, [&](std::size_t block) {
            const std::size_t first = begin + block * kBlock;
            const std::size_t end = std::min(first + kBlock, begin + size);
            for (std::size_t v = first; v < end; ++v) {
                if (kinds_[v] == Kind::Unreferenced)
                    std::fill(row(v).begin(), row(v).end(), 0.0f);
                else if (kinds_[v] != Kind::Merged)
                    traced[v - begin] = bake_row(static_cast<std::uint32_t>(v), row(v));
            }
            progress.add(end - first);
        });
        for (std::size_t v = begin; v < begin + size; ++v) {
            if (kinds_[v] == Kind::Traced) {
                const Traced& t = traced[v - begin];
                histogram[static_cast<std::size_t>(t.crossings)] += copies_[v];
                report_.ray_count += static_cast<std::uint64_t>(t.rays);
                report_.solved_count += t.solved;
            }
            if (kinds_[v] == Kind::Merged) {
                const std::uint32_t place = points_.representative(v);
                const std::span<const float> source =
                    place >= begin ? row(place) : std::span<float>(kept.at(place));
                std::copy(source.begin(), source.end(), row(v).begin());
                if (place < begin && last_copy[place] == v) kept.erase(place);
            } else if (last_copy[v] >= begin + size) {
                kept.emplace(static_cast<std::uint32_t>(v),
                             std::vector<float>(row(v).begin(), row(v).end()));
            }
        }
        ENVBAKE_TRY_VOID(sink(std::span(rows).first(size * coeffs_)));
    }
    const ErrorEstimate estimate = estimate_error(error_, histogram, count);
    report_.error_rms = estimate.rms;
    report_.error_p999 = estimate.p999;
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
    constexpr double kRays = 400, kTolerance = 1e-2, kBands = 5;
    const double error = job.tolerance / kTolerance * kBands / job.bands;
    return scaled_rays(kRays, rays_for_variance(error * error));
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
