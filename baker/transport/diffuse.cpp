// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/diffuse.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/transport/free_vertices.h"
#include "baker/transport/ray_origin.h"
#include "baker/transport/ray_set.h"
#include "baker/transport/visible_transport.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <unordered_map>
#include <vector>

namespace envbake {

namespace {

using std::numbers::pi;

using Clock = std::chrono::steady_clock;

constexpr std::size_t kBlock = 64;          ///< vertices of one call of a parallel loop
constexpr std::size_t kHandOver = 1 << 15;  ///< vertices whose rows are in memory together, at most
constexpr std::size_t kKeptOverhead = 64;   ///< bytes of a kept row beside its floats

/// A pilot makes the rays that follow it less of a neighbourhood, which costs 5 to 7 % of their
/// time, and saves three quarters of the rays of a solved vertex: below this share of solved
/// vertices it does not pay.
constexpr double kSolvedShareThatPays = 0.14;
/// With fewer rays a pilot overlooks too much: 32 missed a quarter of the error, unseen by any
/// estimate of it.
constexpr int kFewestPilotRays = 48;
/// Where time is short the first look is cheap, whatever the tolerance.
constexpr int kFirstLookOfBudget = 256;

/// Random streams: turns of the result, turns of the second bake that it is held against, choice of
/// the vertices that are baked twice.
enum Stage : std::uint64_t { kResultTurns = 0x646966, kSecondTurns, kSampleChoice };

int scaled_rays(double ray_count, double factor) {
    return static_cast<int>(std::clamp(ray_count * factor, 16.0, 1.0 * kMaxRays));
}

/// How the ray count must change for the mean square error to be multiplied by `factor`.
double rays_for_variance(double factor) {
    return std::pow(factor, -1 / kVarianceExponent);
}

void tell_error(DiffuseReport& report) {
    const ErrorEstimate estimate =
        estimate_error(report.crossing_error, report.crossings, report.vertex_count);
    report.error_rms = estimate.rms;
    report.error_p999 = estimate.p999;
}

/// What is expected of one vertex.
double square_error(const CrossingError& error, const Traced& traced) {
    if (traced.rays == 0) return 0;
    return traced.crossings == 0 ? error.solved : traced.crossings * error.per_crossing;
}

/// The error that counts, over that of T.
double worse_of(const RowUse& use, double row_error) {
    return use.alone ? row_error : std::max(1.0, row_error);
}

/// One of the two that a place is baked by.
struct Look {
    double turn_rad;
    Traced traced;
    std::vector<std::uint16_t> masks;
};

class DiffuseBake {
  public:
    DiffuseBake(const DiffuseJob& job, const Scene& scene, std::size_t mesh, const Tracer& tracer,
                BlockedRays* blocked)
        : job_(job),
          tracer_(tracer),
          blocked_(blocked),
          mesh_(scene.meshes[mesh]),
          row_bands_(std::max(job.bands, job.row_bands)),
          coeffs_(static_cast<std::size_t>(sh::coeff_count(row_bands_))),
          points_(scene.meshes[mesh]) {}

    Expected<DiffuseReport> run(const std::function<Expected<void>(std::span<const float>)>& sink,
                                Progress& progress);

  private:
    void count_copies();
    void choose_rays();
    bool choose_sample();
    int affordable_rays() const;
    std::vector<BakedTwice> bake_twice(const RaySet& set, std::span<const std::uint32_t> sample);
    double row_square(const RaySet& set, const Look& first, const Look& second) const;
    double mean_square(const CrossingError& error, std::span<const BakedTwice> baked) const;
    bool is_open(const RayOrigin& origin) const;
    Traced bake_row(std::uint32_t vertex, std::span<float> row,
                    std::span<std::uint16_t> masks) const;
    std::span<std::uint16_t> masks_of(std::uint32_t vertex) const;
    double random(std::uint32_t vertex, Stage stage) const;

    DiffuseJob job_;
    const Tracer& tracer_;
    BlockedRays* blocked_;
    const Mesh& mesh_;
    int row_bands_;
    std::size_t coeffs_;  ///< of a row
    SurfacePoints points_;
    std::vector<std::uint32_t> copies_;  ///< of each representative, itself included
    std::vector<std::uint32_t> sample_;  ///< some of those that need rays
    double traced_share_ = 0;            ///< of all vertices, by the sample
    RaySet set_;
    CrossingError error_;
    DiffuseReport report_;
    Clock::time_point begun_ = Clock::now();
    double sample_seconds_ = 0;  ///< that the check rays took
};

/// Uniform in [0, 1).
double DiffuseBake::random(std::uint32_t vertex, Stage stage) const {
    return RandomStream(job_.seed, stage, points_.stream(vertex, tracer_.space())).next();
}

void DiffuseBake::count_copies() {
    const std::size_t count = points_.size();
    report_.vertex_count = count;
    copies_.assign(count, 0);
    for (std::size_t v = 0; v < count; ++v) {
        const std::uint32_t place = points_.representative(v);
        report_.unreferenced_count += place == SurfacePoints::kNone;
        if (place == SurfacePoints::kNone) continue;
        report_.merged_count += place != v;
        ++copies_[place];
    }
}

bool DiffuseBake::is_open(const RayOrigin& origin) const {
    return !job_.shadowed || is_free(origin, tracer_.half_spaces());
}

/// Places at random, in an order that does not depend on that of the vertices. False where every
/// place was looked at and none needs rays.
bool DiffuseBake::choose_sample() {
    std::vector<std::pair<double, std::uint32_t>> places;
    for (std::uint32_t v = 0; v < points_.size(); ++v)
        if (copies_[v] > 0) places.emplace_back(random(v, kSampleChoice), v);
    // Each of the sample costs as much as two vertices, and what a sample of S leaves unknown of
    // the mean square, 0.85 / sqrt(S), costs rays as well: for most meshes this is near the least.
    const std::size_t wanted = std::clamp<std::size_t>(
        places.size() / 96, std::min<std::size_t>(places.size() / 12 + 2, 64), 512);
    const std::size_t looked_at = std::min(8 * wanted, places.size());  // most may be free
    std::partial_sort(places.begin(), places.begin() + static_cast<std::ptrdiff_t>(looked_at),
                      places.end());
    double traced = 0, seen = 0;
    for (std::size_t i = 0; i < looked_at && sample_.size() < wanted; ++i) {
        const std::uint32_t vertex = places[i].second;
        seen += copies_[vertex];
        if (is_open(points_.origin(vertex, tracer_.space()))) continue;
        traced += copies_[vertex];
        sample_.push_back(vertex);
    }
    if (traced > 0)
        traced_share_ = traced / seen *
                        (1 - static_cast<double>(report_.unreferenced_count) /
                                 static_cast<double>(points_.size()));
    return !sample_.empty() || looked_at < places.size();
}

/// The sample as the result will be, and each again with a turn of its own, never stopped: the
/// second bake tells what stopping overlooked, too.
std::vector<BakedTwice> DiffuseBake::bake_twice(const RaySet& set,
                                                std::span<const std::uint32_t> sample) {
    std::vector<BakedTwice> baked(sample.size());
    std::vector<int> rays(sample.size());
    const double norm = unoccluded_norm(job_.bands);
    const auto coeffs = static_cast<std::size_t>(sh::coeff_count(job_.bands));
    const auto begun = Clock::now();
    parallel_for(sample.size(), [&](std::size_t i) {
        const RayOrigin origin = points_.origin(sample[i], tracer_.space());
        std::vector<float> row(coeffs), other(coeffs);
        const auto look = [&](Stage turns, Stop stop, std::vector<float>& into) {
            Look result{2 * pi * random(sample[i], turns), {}, {}};
            result.masks.resize(job_.row_use.errors.empty() ? 0 : set.directions.size());
            result.traced =
                visible_transport(set, tracer_, origin, result.turn_rad, into, stop, result.masks);
            return result;
        };
        const Look first = look(kResultTurns, Stop::WhereSolved, row);
        const Look second = look(kSecondTurns, Stop::Never, other);
        double square = 0;
        for (std::size_t c = 0; c < coeffs; ++c) {
            const double difference = double{row[c]} - double{other[c]};
            square += difference * difference;
        }
        const int crossings = first.traced.crossings;
        const double erring = crossings > 0 ? 2 : 1;  // else the second's own error hardly counts
        baked[i] = {crossings, square / (norm * norm) / erring,
                    row_square(set, first, second) / erring};
        rays[i] = first.traced.rays + second.traced.rays;
    });
    sample_seconds_ += std::chrono::duration<double>(Clock::now() - begun).count();
    for (const int count : rays) report_.check_ray_count += static_cast<std::uint64_t>(count);
    return baked;
}

/// The squared distance of two rows, by the worst of what they are for.
double DiffuseBake::row_square(const RaySet& set, const Look& first, const Look& second) const {
    if (job_.row_use.errors.empty()) return 0;
    const auto blocked = [&](const Look& look) {
        std::vector<std::uint16_t> masks = look.masks;
        if (look.traced.solved && look.traced.blocked > 0)  // so are those that were not traced
            std::fill(masks.begin(), masks.end(), std::uint16_t{0xffff});
        std::vector<double> row(coeffs_);
        blocked_about_normal(set, look.turn_rad, masks, row);
        return row;
    };
    std::vector<double> difference = blocked(first);
    const std::vector<double> other = blocked(second);
    for (std::size_t c = 0; c < coeffs_; ++c) difference[c] -= other[c];
    double worst = 0;
    for (const AxialForm& error : job_.row_use.errors) worst = std::max(worst, error(difference));
    return worst;
}

/// Rays a vertex that the time which is left has room for, at the speed of the sample.
int DiffuseBake::affordable_rays() const {
    if (job_.seconds <= 0) return kMaxRays;
    const double left = job_.seconds - std::chrono::duration<double>(Clock::now() - begun_).count();
    const double rays_per_second = static_cast<double>(report_.check_ray_count) / sample_seconds_;
    const double places = static_cast<double>(report_.vertex_count - report_.unreferenced_count -
                                              report_.merged_count);
    return scaled_rays(rays_per_second, left / (places * traced_share_));
}

/// Expected mean square error of the whole mesh, by the crossings of the first of the sample.
double DiffuseBake::mean_square(const CrossingError& error,
                                std::span<const BakedTwice> baked) const {
    double sum = 0, weights = 0;
    for (std::size_t i = 0; i < baked.size(); ++i) {
        const double weight = copies_[sample_[i]];
        const int crossings = baked[i].crossings;
        sum += weight * (crossings == 0 ? error.solved : error.per_crossing * crossings);
        weights += weight;
    }
    return sum / weights * traced_share_;
}

/// Fixes the ray set and what one crossing of its rays says of the error.
void DiffuseBake::choose_rays() {
    int first_guess = expected_rays_per_vertex(job_);
    if (job_.rays_per_vertex > 0 || sample_.empty()) {
        set_ = make_ray_set(first_guess, job_.bands);
        const std::vector<BakedTwice> baked = bake_twice(set_, sample_);
        error_ = fit_error(CrossingError::expected(set_.ray_count, false, job_.bands), baked);
        report_.row_error = fit_row_error(job_.row_use.expected, baked);
        return;
    }

    if (job_.seconds > 0) first_guess = std::min(first_guess, kFirstLookOfBudget);

    // The aim is a little below the tolerance, for what the sample does not know of the mesh.
    constexpr double kAim = 0.97;
    const auto rays_needed = [&](const RaySet& set, const CrossingError& error,
                                 std::span<const BakedTwice> baked, double samples) {
        const double worse = worse_of(job_.row_use, fit_row_error(job_.row_use.expected, baked));
        const double stated =
            worse * worse * mean_square(error, baked) *
            standard_error_factor(samples, traced_share_ * static_cast<double>(points_.size()));
        const double aim = kAim * job_.tolerance;
        return std::min(scaled_rays(set.ray_count, rays_for_variance(aim * aim / stated)),
                        affordable_rays());
    };

    // Few vertices tell about how many rays the mesh needs, and whether many are solved by a pilot.
    const auto few = std::span(sample_).first(
        std::min(sample_.size(), std::clamp<std::size_t>(sample_.size() / 4, 12, 64)));
    RaySet set = make_ray_set(first_guess, job_.bands, true);
    std::vector<BakedTwice> baked = bake_twice(set, few);
    const auto solved = std::count_if(baked.begin(), baked.end(),
                                      [](const BakedTwice& b) { return b.crossings == 0; });
    const bool many_solved =
        static_cast<double>(solved) > kSolvedShareThatPays * static_cast<double>(few.size());
    const CrossingError rough =
        fit_error(CrossingError::expected(set.ray_count, true, job_.bands), baked);
    int rays = rays_needed(set, rough, baked,
                           rough.samples + static_cast<double>(sample_.size() - few.size()));

    // The whole sample, at a count so near to the final one that the law bridges the difference.
    bool with_pilot = false;
    for (int round = 0; round < 3; ++round) {
        with_pilot = many_solved && rays >= 4 * kFewestPilotRays;
        set = make_ray_set(rays, job_.bands, with_pilot);
        baked = bake_twice(set, sample_);
        error_ = fit_error(CrossingError::expected(set.ray_count, with_pilot, job_.bands), baked);
        rays = rays_needed(set, error_, baked, error_.samples);
        if (std::abs(std::log(static_cast<double>(rays) / set.ray_count)) < std::log(1.3)) break;
    }
    set_ = make_ray_set(rays, job_.bands, with_pilot);
    error_ = error_.scaled(set.ray_count, set_.ray_count);
    report_.row_error = fit_row_error(job_.row_use.expected, baked);
}

std::span<std::uint16_t> DiffuseBake::masks_of(std::uint32_t vertex) const {
    if (blocked_ == nullptr) return {};
    const std::size_t packets = set_.directions.size();
    return std::span(blocked_->masks).subspan(vertex * packets, packets);
}

Traced DiffuseBake::bake_row(std::uint32_t vertex, std::span<float> row,
                             std::span<std::uint16_t> masks) const {
    const RayOrigin origin = points_.origin(vertex, tracer_.space());
    if (!is_open(origin))
        return visible_transport(set_, tracer_, origin, 2 * pi * random(vertex, kResultTurns), row,
                                 Stop::WhereSolved, masks);
    std::array<double, sh::coeff_count(kMaxRowBands)> exact;
    unoccluded_transport(row_bands_, origin.normal, exact);
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<float>(exact[i]);
    return {};
}

Expected<DiffuseReport> DiffuseBake::run(
    const std::function<Expected<void>(std::span<const float>)>& sink, Progress& progress) {
    count_copies();
    if (job_.shadowed && choose_sample()) choose_rays();
    report_.rays_per_vertex = set_.ray_count;
    if (blocked_ != nullptr)
        *blocked_ = {job_.seed, set_,
                     std::vector<std::uint16_t>(points_.size() * set_.directions.size(), 0)};
    std::vector<std::uint64_t>& histogram = report_.crossings;
    histogram.assign(static_cast<std::size_t>(set_.ray_count) + 1, 0);

    const std::size_t count = points_.size();
    const std::size_t range_end = std::min(job_.end_vertex, count);
    const std::size_t range = range_end - std::min(job_.first_vertex, range_end);
    const auto is_copy = [&](std::size_t v) {
        const std::uint32_t place = points_.representative(v);
        return place != SurfacePoints::kNone && place != v;
    };
    std::vector<std::uint32_t> last_copy(count, 0);  // of each representative
    for (std::uint32_t v = 0; v < count; ++v)
        if (is_copy(v)) last_copy[points_.representative(v)] = v;

    // Half of the budget for the rows of one hand-over, the rest for rows that copies wait for.
    const std::size_t row_bytes = coeffs_ * sizeof(float);
    const std::size_t in_hand_bytes = row_bytes + sizeof(Traced);
    const std::size_t hand_over =
        std::clamp(job_.memory_bytes / 2 / in_hand_bytes, kBlock, kHandOver);
    const std::size_t in_hand = std::min(hand_over, range) * in_hand_bytes;
    const std::size_t max_kept =
        (job_.memory_bytes - std::min(job_.memory_bytes, in_hand)) / (row_bytes + kKeptOverhead);
    std::vector<float> rows(std::min(hand_over, range) * coeffs_);
    std::vector<Traced> traced(std::min(hand_over, range));
    std::unordered_map<std::uint32_t, std::vector<float>> kept;  // rows from before that are copied
    for (std::size_t begin = job_.first_vertex; begin < range_end; begin += hand_over) {
        const std::size_t size = std::min(hand_over, range_end - begin);
        // A copy of what is no longer in memory is baked again: the same bits, for more rays.
        const auto is_repeated = [&](std::size_t v) {
            const std::uint32_t place = points_.representative(v);
            return is_copy(v) && place < begin && !kept.contains(place);
        };
        const auto row = [&](std::size_t v) {
            return std::span(rows).subspan((v - begin) * coeffs_, coeffs_);
        };
        parallel_for((size + kBlock - 1) / kBlock, [&](std::size_t block) {
            const std::size_t first = begin + block * kBlock;
            const std::size_t end = std::min(first + kBlock, begin + size);
            std::uint64_t rays = 0;
            double squares = 0;
            for (std::size_t v = first; v < end; ++v) {
                if (points_.representative(v) == SurfacePoints::kNone) {
                    std::fill(row(v).begin(), row(v).end(), 0.0f);
                } else if (!is_copy(v) || is_repeated(v)) {
                    const auto masks = is_copy(v) ? std::span<std::uint16_t>()
                                                  : masks_of(static_cast<std::uint32_t>(v));
                    traced[v - begin] = bake_row(points_.representative(v), row(v), masks);
                    rays += static_cast<std::uint64_t>(traced[v - begin].rays);
                    squares += copies_[v] * square_error(error_, traced[v - begin]);
                }
            }
            progress.add(end - first, rays);
            if (job_.shadowed) progress.add_error(squares, end - first);
        });
        for (std::size_t v = begin; v < begin + size; ++v) {
            const Traced& t = traced[v - begin];
            if (copies_[v] > 0) ++(t.rays > 0 ? report_.traced_count : report_.free_count);
            if (copies_[v] > 0 && t.rays > 0) {
                histogram[static_cast<std::size_t>(t.crossings)] += copies_[v];
                report_.ray_count += static_cast<std::uint64_t>(t.rays);
                report_.solved_count += t.solved;
            }
            if (is_repeated(v)) {
                report_.repeated_ray_count += static_cast<std::uint64_t>(t.rays);
            } else if (is_copy(v)) {
                const std::uint32_t place = points_.representative(v);
                const std::span<const float> source =
                    place >= begin ? row(place) : std::span<float>(kept.at(place));
                std::copy(source.begin(), source.end(), row(v).begin());
                if (place < begin && last_copy[place] == v) kept.erase(place);
            } else if (t.rays > 0 && last_copy[v] >= begin + size && kept.size() < max_kept) {
                kept.emplace(static_cast<std::uint32_t>(v),
                             std::vector<float>(row(v).begin(), row(v).end()));
            }
        }
        ENVBAKE_TRY_VOID(sink(std::span(rows).first(size * coeffs_)));
    }
    report_.crossing_error = error_;
    tell_error(report_);
    return report_;
}

Expected<void> check(const DiffuseJob& job) {
    if (job.bands < 1 || job.bands > sh::kMaxBundleBands)
        return Error{Errc::Usage, concat("diffuse transport: ", job.bands, " bands; 1 to ",
                                         sh::kMaxBundleBands, " are possible")};
    if (job.row_bands != 0 && (job.row_bands < job.bands || job.row_bands > kMaxRowBands))
        return Error{Errc::Usage, concat("diffuse transport: rows of ", job.row_bands, " bands; ",
                                         job.bands, " to ", kMaxRowBands, " are possible")};
    if (!(job.tolerance > 0))
        return Error{Errc::Usage, concat("diffuse transport: a tolerance of ", job.tolerance,
                                         "; it must be above 0")};
    if (job.rays_per_vertex < 0)
        return Error{Errc::Usage, concat("diffuse transport: ", job.rays_per_vertex,
                                         " rays a vertex; 0 chooses from the tolerance")};
    return {};
}

}  // namespace

double BlockedRays::turn_rad(const SurfacePoints& points, std::uint32_t vertex,
                             const TraceSpace& space) const {
    return 2 * pi * RandomStream(seed, kResultTurns, points.stream(vertex, space)).next();
}

void append(DiffuseReport& report, const DiffuseReport& part) {
    report.free_count += part.free_count;
    report.traced_count += part.traced_count;
    report.solved_count += part.solved_count;
    report.ray_count += part.ray_count;
    report.repeated_ray_count += part.repeated_ray_count;
    report.crossings.resize(std::max(report.crossings.size(), part.crossings.size()), 0);
    for (std::size_t c = 0; c < part.crossings.size(); ++c)
        report.crossings[c] += part.crossings[c];
    tell_error(report);
}

int expected_rays_per_vertex(const DiffuseJob& job) {
    if (job.rays_per_vertex > 0) return job.rays_per_vertex;
    // The Stanford bunny at 5 bands. More bands are more coefficients that carry the same error.
    constexpr double kRays = 400, kTolerance = 1e-2, kBands = 5;
    const double error = job.tolerance / worse_of(job.row_use, job.row_use.expected) / kTolerance *
                         kBands / job.bands;
    return scaled_rays(kRays, rays_for_variance(error * error));
}

double unoccluded_norm(int bands) {
    double sum = 0;
    for (int l = 0; l < bands; ++l) {
        const double a = sh::clamped_cosine(l) / pi;
        sum += a * a * (2 * l + 1) / (4 * pi);
    }
    return std::sqrt(sum);
}

void unoccluded_transport(int bands, const DVec3& n, std::span<double> out) {
    sh::evaluate(bands, n.x, n.y, n.z, out.data());
    for (int l = 0; l < bands; ++l)
        for (int m = -l; m <= l; ++m)
            out[static_cast<std::size_t>(sh::index(l, m))] *= sh::clamped_cosine(l) / pi;
}

Expected<DiffuseReport> bake_diffuse(
    const DiffuseJob& job, const Scene& scene, std::size_t mesh, const Tracer& tracer,
    const std::function<Expected<void>(std::span<const float>)>& sink, Progress& progress,
    BlockedRays* blocked) {
    ENVBAKE_TRY_VOID(check(job));
    return DiffuseBake(job, scene, mesh, tracer, blocked).run(sink, progress);
}

}  // namespace envbake
