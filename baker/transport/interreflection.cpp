// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/interreflection.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/transport/diffuse.h"
#include "baker/transport/seen_surfaces.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

namespace envbake {

namespace {

constexpr std::uint64_t kSampleChoice = 0x626f756e;  // random stream

constexpr std::size_t kBlock = 64;  ///< places of one call of a parallel loop
constexpr std::size_t kLanes = kFloatLanes;
/// Shares of the tolerance. What the few rays err adds to the direct error by squares, what is left
/// out adds as it is.
constexpr double kRaysShare = 0.36, kLeftOutShare = 0.03;
/// Of what lobes are left: fewer errors of the rays change little.
constexpr double kLeastRaysShare = 0.5;
constexpr double kPilotRays = 64, kFewestRays = 8;  ///< blocked or not
/// Rays halfway between others are wrong where those are right. Measured: 0.7 to 0.85.
constexpr double kApart = 0.8;
/// The error falls with the number of rays N as N^-kRaysExponent.
constexpr double kRaysExponent = 0.7;
constexpr int kMostBounces = 1000;
constexpr double kPad = 0.5;  ///< Growth::pad over the rms of the bounce before
/// T_00 / Y_00 of an open place is 1 but for rounding.
constexpr double kLeastBlocked = 1e-6;

/// Something that light carries, of one channel: a coefficient, or emission. Or what survives of
/// any light.
struct Column {
    std::size_t coeff;  ///< kEmission, kSurvival: no coefficient
    std::size_t channel;
    static constexpr std::size_t kEmission = static_cast<std::size_t>(-1);
    static constexpr std::size_t kSurvival = static_cast<std::size_t>(-2);
};

double square(double x) {
    return x * x;
}

/// What one more bounce tells of the columns that are nowhere negative. With t the bounce before
/// and w = t + pad, A w <= s w everywhere: the pad keeps places out of s that light hardly reaches
/// or reaches late.
struct Growth {
    static constexpr std::size_t kMost = 5;  ///< columns: survival, T_00 and three of emission
    std::array<double, kMost> pad{};
    std::array<double, kMost> s{};
    std::array<double, kMost> largest{};       ///< of next = A t
    std::array<double, kMost> next_squares{};  ///< sums over places
    std::array<double, kMost> sum_squares{};   ///< of all that was added

    void add(std::size_t k, double term, double next, double sum, double reflectance) {
        largest[k] = std::max(largest[k], next);
        next_squares[k] += square(next);
        sum_squares[k] += square(sum);
        const double of_w = next + pad[k] * reflectance;
        if (of_w > 0) s[k] = std::max(s[k], of_w / (term + pad[k]));
    }
    void append(const Growth& other) {
        for (std::size_t k = 0; k < kMost; ++k) {
            s[k] = std::max(s[k], other.s[k]);
            largest[k] = std::max(largest[k], other.largest[k]);
            next_squares[k] += other.next_squares[k];
            sum_squares[k] += other.sum_squares[k];
        }
    }
};

/// Of the rms over so many vertices: single squares scatter about their mean by 0.85 of it.
double with_two_standard_errors(std::size_t count) {
    return std::sqrt(1 + 2 * 0.85 / std::sqrt(static_cast<double>(count)));
}

using Of = SeenSurfaces::Of;

class Interreflection {
  public:
    Interreflection(const BounceJob& job, const Scene& scene, const Tracer& tracer,
                    std::span<const BlockedRays> blocked, std::span<MeshTransport> transport,
                    Progress& progress)
        : job_(job),
          scene_(scene),
          tracer_(tracer),
          blocked_(blocked),
          transport_(transport),
          progress_(progress),
          coeffs_(static_cast<std::size_t>(sh::coeff_count(job.bands))),
          channels_(static_cast<std::size_t>(job.channels)),
          places_(scene, with_transport(transport)),
          lamps_(scene) {}

    BounceReport run();

  private:
    static std::vector<bool> with_transport(std::span<const MeshTransport> transport) {
        std::vector<bool> has;
        for (const MeshTransport& mesh : transport) has.push_back(!mesh.rows.empty());
        return has;
    }

    float* value_at(std::size_t number, const Column& column) {
        const auto [mesh, vertex] = places_.places[number];
        MeshTransport& of = transport_[mesh];
        return column.coeff == Column::kEmission
                   ? &of.emitted[3 * std::size_t{vertex} + column.channel]
                   : &of.rows[(vertex * coeffs_ + column.coeff) * channels_ + column.channel];
    }
    float blocked_share(std::size_t number);
    std::vector<std::uint32_t> sample_of(std::vector<std::uint32_t> places) const;
    void choose_samples();
    SeenSurfaces gather(std::span<const std::uint32_t> chosen, std::span<const double> strides,
                        double offset, SeenSurfaces::Rays rays, Progress& progress);
    std::vector<double> everywhere(double stride) const {
        return std::vector<double>(scene_.meshes.size(), stride);
    }
    double growth_of_error(const SeenSurfaces& of_sample) const;
    double error_at(double stride);
    double choose_stride();
    SeenSurfaces look_of_lobes(double stride);
    std::vector<LobeLight::Errors> errors_of_lobes(const SeenSurfaces& seen, double stride) const;
    void choose_strides_of_lobes(double stride);
    std::vector<Column> columns_of(std::size_t channel) const;
    void load(std::span<const Column> columns, std::vector<Float16>& lanes);
    void measure_reflectance(std::size_t channel);
    double tail(const Growth& growth, std::size_t k, double source) const;
    int series(std::size_t channel, std::span<const Column> columns, int bounce_count,
               std::size_t tested, const std::function<bool(const Growth&)>& ends,
               std::vector<Float16>& sum);
    void add_last_bounce(std::size_t channel, std::span<const Column> columns,
                         std::span<const Float16> sum);
    void judge(std::size_t channel, std::span<const Column> columns, std::span<const Float16> sum);
    void solve(std::size_t channel);
    const float* row_of(std::uint32_t number) const {
        const auto [mesh, vertex] = places_.places[number];
        return &transport_[mesh].rows[vertex * coeffs_ * channels_];
    }
    std::size_t lobe_of(std::uint32_t number) const {
        const std::size_t mesh = places_.places[number].mesh;
        return mesh < job_.lobes.lobe_of_mesh.size() ? job_.lobes.lobe_of_mesh[mesh]
                                                     : LobeLightJob::kNoLobe;
    }
    void add_lobes();
    void fill_copies();

    const BounceJob& job_;
    const Scene& scene_;
    const Tracer& tracer_;
    std::span<const BlockedRays> blocked_;
    std::span<MeshTransport> transport_;
    Progress& progress_;
    std::size_t coeffs_, channels_;
    ScenePlaces places_;
    Lamps lamps_;
    std::vector<std::uint32_t> sample_;           ///< places
    std::vector<std::uint32_t> sample_of_lobes_;  ///< places with glossy transport
    std::vector<double> strides_of_lobes_;
    std::map<double, SeenSurfaces> looks_;  ///< of that sample, by stride
    std::vector<double> square_errors_;     ///< of the sample, summed over columns
    double emitted_error_ = 0, emitted_signal_ = 0;
    std::optional<SeenSurfaces> seen_;   ///< by all places
    std::optional<SeenSurfaces> again_;  ///< by the sample, with other rays
    std::optional<LobeLight> lobe_light_;
    std::vector<float> reflectance_;  ///< A 1, of one channel
    double reflectance_rms_ = 0, largest_reflectance_ = 0;
    BounceReport report_;
};

float Interreflection::blocked_share(std::size_t number) {
    static const double kOpen = 1 / std::sqrt(4 * std::numbers::pi);
    const double blocked = 1 - static_cast<double>(*value_at(number, {0, 0})) / kOpen;
    return blocked > kLeastBlocked ? static_cast<float>(std::min(blocked, 1.0)) : 0.0f;
}

/// At random, but by where they are: their order in the file does not matter.
std::vector<std::uint32_t> Interreflection::sample_of(std::vector<std::uint32_t> places) const {
    std::vector<std::pair<double, std::uint32_t>> order;
    for (const std::uint32_t p : places) {
        const auto [mesh, vertex] = places_.places[p];
        order.emplace_back(RandomStream(job_.seed, kSampleChoice,
                                        places_.surfaces[mesh].stream(vertex, tracer_.space()))
                               .next(),
                           p);
    }
    const std::size_t count =
        std::min(order.size(), std::clamp<std::size_t>(order.size() / 64, 64, 512));
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count),
                      order.end());
    places.resize(count);
    for (std::size_t i = 0; i < count; ++i) places[i] = order[i].second;
    return places;
}

void Interreflection::choose_samples() {
    std::vector<std::uint32_t> all(places_.places.size()), with_lobe;
    std::iota(all.begin(), all.end(), 0u);
    std::copy_if(all.begin(), all.end(), std::back_inserter(with_lobe),
                 [&](std::uint32_t p) { return lobe_of(p) != LobeLightJob::kNoLobe; });
    sample_ = sample_of(std::move(all));
    if (with_lobe.empty()) return;
    sample_of_lobes_ = sample_of(std::move(with_lobe));
    Progress unseen;  // a sample takes no time to speak of
    lobe_light_.emplace(
        job_.lobes, static_cast<int>(channels_), [this](std::uint32_t p) { return row_of(p); },
        gather(sample_of_lobes_, everywhere(1), 0, SeenSurfaces::Rays::New, unseen));
}

SeenSurfaces Interreflection::gather(std::span<const std::uint32_t> chosen,
                                     std::span<const double> strides, double offset,
                                     SeenSurfaces::Rays rays, Progress& progress) {
    std::vector<float> shares;
    for (const std::uint32_t p : chosen) shares.push_back(blocked_share(p));
    return SeenSurfaces(scene_, tracer_, places_, lamps_, blocked_, chosen, std::move(shares),
                        strides, offset, rays, progress);
}

/// What the squares of errors are multiplied by since light errs again at each bounce: 1 and the
/// mean squared reflectance.
double Interreflection::growth_of_error(const SeenSurfaces& of_sample) const {
    double sum = 0, count = 0;
    for (std::size_t c = 0; c < channels_; ++c)
        for (std::size_t i = 0; i < of_sample.row_count(); ++i, ++count)
            sum += square(of_sample.reflectance(i, static_cast<int>(c), Of::All));
    return 1 + (job_.bounces == 1 ? 0 : sum / count);
}

/// Error of all bounces where every `stride`-th ray is followed, by the first one to the sample:
/// what those rays bring against what those bring that are halfway between them.
double Interreflection::error_at(double stride) {
    constexpr auto kRays = SeenSurfaces::Rays::OfTheDirectBake;
    Progress unseen;  // a sample takes no time to speak of
    const SeenSurfaces first = gather(sample_, everywhere(stride), 0, kRays, unseen);
    const SeenSurfaces second = gather(sample_, everywhere(stride), 0.5, kRays, unseen);
    double squares = 0;
    for (std::size_t c = 0; c < channels_; ++c) {
        const auto channel = static_cast<int>(c);
        std::vector<Float16> lanes;
        for (std::size_t begin = 0; begin < coeffs_; begin += kLanes) {
            std::vector<Column> columns;
            for (std::size_t i = begin; i < std::min(begin + kLanes, coeffs_); ++i)
                columns.push_back({i, c});
            load(columns, lanes);
            for (std::size_t i = 0; i < sample_.size(); ++i) {
                const Float16 difference = first.reflected(i, channel, lanes, Of::All) -
                                           second.reflected(i, channel, lanes, Of::All);
                for (std::size_t k = 0; k < columns.size(); ++k)
                    squares += square(static_cast<double>(difference[k])) / 2;
            }
        }
    }
    const auto count = static_cast<double>(sample_.size() * channels_);
    return kApart * std::sqrt(squares / count * growth_of_error(first)) /
           unoccluded_norm(job_.bands);
}

/// Twice, for the law of the error is a rough one.
double Interreflection::choose_stride() {
    if (job_.emission && lamps_.empty()) return 1;  // what shines may be small: every ray counts
    double rays = 0;
    for (const std::uint32_t p : sample_) rays += blocked_[places_.places[p].mesh].set.ray_count;
    rays /= static_cast<double>(sample_.size());
    double stride = rays / kPilotRays;
    for (int round = 0; round < 2; ++round) {
        stride = std::max(stride, 2.0);  // of two that follow every ray there is no difference
        stride *= std::pow(kRaysShare * job_.tolerance / error_at(stride), 1 / kRaysExponent);
        stride = std::clamp(stride, 1.0, std::max(1.0, rays / kFewestRays));
    }
    return stride;
}

/// The sample, where every stride-th ray is followed. While transport is the direct one.
SeenSurfaces Interreflection::look_of_lobes(double stride) {
    Progress unseen;
    return gather(sample_of_lobes_, everywhere(stride), 0, SeenSurfaces::Rays::OfTheDirectBake,
                  unseen);
}

std::vector<LobeLight::Errors> Interreflection::errors_of_lobes(const SeenSurfaces& seen,
                                                                double stride) const {
    std::vector<LobeLight::Errors> errors = lobe_light_->errors(seen, stride, kRaysExponent);
    const double factor =
        std::sqrt(growth_of_error(seen)) * with_two_standard_errors(sample_of_lobes_.size());
    for (LobeLight::Errors& of_lobe : errors) of_lobe *= factor;
    return errors;
}

/// One for all lobes that every stride-th ray does not do for. The light is the direct one, as in
/// error_at().
void Interreflection::choose_strides_of_lobes(double stride) {
    const double allowed = kRaysShare * job_.tolerance;
    std::vector<bool> more(job_.lobes.errors.size());
    double smaller = stride;
    for (int round = 0; round < 3; ++round) {
        const auto& [at, look] = *looks_.emplace(smaller, look_of_lobes(smaller)).first;
        const auto errors = errors_of_lobes(look, at);
        double change = 1;
        for (std::size_t lobe = 0; lobe < errors.size(); ++lobe) {
            const double least = errors[lobe].least();
            if (round == 0) more[lobe] = least > allowed;
            // As if rays were all that errs, but no more of them than take that away.
            if (least > allowed)
                change = std::min(
                    change, allowed * std::max(1 / least, kLeastRaysShare / errors[lobe].noise));
        }
        if (change == 1 || smaller == 1) break;
        smaller = std::max(1.0, smaller * std::pow(change, 1 / kRaysExponent));
    }
    for (std::size_t lobe = 0; lobe < more.size(); ++lobe)
        strides_of_lobes_.push_back(more[lobe] ? smaller : stride);
    if (!looks_.contains(smaller)) looks_.emplace(smaller, look_of_lobes(smaller));
    std::erase_if(looks_, [&](const auto& look) {
        return std::find(strides_of_lobes_.begin(), strides_of_lobes_.end(), look.first) ==
               strides_of_lobes_.end();
    });
}

/// Those that nothing makes negative come first: they tell when the series may end. Survival
/// begins as A 1, so after k bounces it is A^{k+1} 1.
std::vector<Column> Interreflection::columns_of(std::size_t channel) const {
    std::vector<Column> columns{{Column::kSurvival, channel}, {0, channel}};
    if (job_.emission) {
        for (std::size_t c = 0; c < 3; ++c)
            if (channels_ == 1 || c == channel) columns.push_back({Column::kEmission, c});
    }
    for (std::size_t i = 1; i < coeffs_; ++i) columns.push_back({i, channel});
    return columns;
}

void Interreflection::load(std::span<const Column> columns, std::vector<Float16>& lanes) {
    lanes.assign(places_.places.size(), Float16{});
    parallel_for((lanes.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
        const std::size_t end = std::min((block + 1) * kBlock, lanes.size());
        for (std::size_t p = block * kBlock; p < end; ++p)
            for (std::size_t k = 0; k < columns.size(); ++k)
                lanes[p][k] = columns[k].coeff == Column::kSurvival ? reflectance_[p]
                                                                    : *value_at(p, columns[k]);
    });
}

void Interreflection::measure_reflectance(std::size_t channel) {
    reflectance_.resize(places_.places.size());
    double squares = 0;
    largest_reflectance_ = 0;
    for (std::size_t p = 0; p < reflectance_.size(); ++p) {
        const double reflectance = seen_->reflectance(p, static_cast<int>(channel), Of::Few);
        reflectance_[p] = static_cast<float>(reflectance);
        squares += square(reflectance);
        largest_reflectance_ = std::max(largest_reflectance_, reflectance);
    }
    reflectance_rms_ = std::sqrt(squares / static_cast<double>(reflectance_.size()));
}

/// Bound on the rms over places of all bounces that come after the last one.
///   source  the column without any bounce is nowhere more than this times 1 - A 1
double Interreflection::tail(const Growth& growth, std::size_t k, double source) const {
    const auto rms = [&](std::size_t column) {
        return std::sqrt(growth.next_squares[column] / static_cast<double>(places_.places.size()));
    };
    const double s = growth.s[k], q = largest_reflectance_;
    return std::min({s < 1 ? s / (1 - s) * (rms(k) + growth.pad[k] * reflectance_rms_) : HUGE_VAL,
                     q < 1 ? q / (1 - q) * growth.largest[k] : HUGE_VAL, source * rms(0)});
}

/// All bounces but the last, by few points, in sixteen columns; returns their number with the last.
///   bounce_count  at most
///   ends          is told after each bounce how the first `tested` columns grow, and ends it
///   sum           [places], with what comes directly
int Interreflection::series(std::size_t channel, std::span<const Column> columns, int bounce_count,
                            std::size_t tested, const std::function<bool(const Growth&)>& ends,
                            std::vector<Float16>& sum) {
    std::vector<Float16> term;
    load(columns, term);
    sum = term;
    std::vector<Float16> next(term.size());
    std::vector<Growth> growths((term.size() + kBlock - 1) / kBlock);
    report_.memory_bytes =
        std::max(report_.memory_bytes, seen_->bytes() + 3 * term.size() * sizeof(Float16));
    std::array<double, Growth::kMost> pad{};
    for (int bounce = 1; bounce <= bounce_count; ++bounce) {
        parallel_for(growths.size(), [&](std::size_t block) {
            Growth growth{.pad = pad};
            const std::size_t end = std::min((block + 1) * kBlock, term.size());
            for (std::size_t p = block * kBlock; p < end; ++p) {
                if (bounce > 1) sum[p] += term[p];
                next[p] = seen_->reflected(p, static_cast<int>(channel), term, Of::Few);
                for (std::size_t k = 0; k < tested; ++k)
                    growth.add(k, static_cast<double>(term[p][k]), static_cast<double>(next[p][k]),
                               static_cast<double>(sum[p][k]),
                               static_cast<double>(reflectance_[p]));
            }
            growths[block] = growth;
        });
        std::swap(term, next);
        Growth growth{.pad = pad};
        for (const Growth& of_block : growths) growth.append(of_block);
        if (ends(growth)) return bounce;
        for (std::size_t k = 0; k < tested; ++k)
            pad[k] = kPad * std::sqrt(growth.next_squares[k] / static_cast<double>(term.size()));
    }
    return bounce_count;
}

/// Adds the errors of sixteen columns: what other rays would have brought to the sample, given the
/// same light everywhere else.
void Interreflection::judge(std::size_t channel, std::span<const Column> columns,
                            std::span<const Float16> sum) {
    for (std::size_t i = 0; i < sample_.size(); ++i) {
        const std::uint32_t p = sample_[i];
        const Float16 difference = seen_->reflected(p, static_cast<int>(channel), sum, Of::All) -
                                   again_->reflected(i, static_cast<int>(channel), sum, Of::All);
        for (std::size_t k = 0; k < columns.size(); ++k) {
            if (columns[k].coeff == Column::kSurvival) continue;
            const double d = static_cast<double>(difference[k]);
            if (columns[k].coeff != Column::kEmission) {
                square_errors_[i] += square(d) / (2 * static_cast<double>(channels_));
            } else {
                const auto c = static_cast<int>(columns[k].channel);
                const double directly = static_cast<double>(seen_->emitted(p)[c]) -
                                        static_cast<double>(again_->emitted(i)[c]);
                emitted_error_ += square(d + directly) / 2;
                emitted_signal_ += square(static_cast<double>(sum[p][k]));
            }
        }
    }
}

/// Adds the last bounce, by all points. What few points err at the bounces before is met from many
/// places at once, so hardly any of it arrives.
void Interreflection::add_last_bounce(std::size_t channel, std::span<const Column> columns,
                                      std::span<const Float16> sum) {
    parallel_for((sum.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
        const std::size_t end = std::min((block + 1) * kBlock, sum.size());
        for (std::size_t p = block * kBlock; p < end; ++p) {
            const Float16 last = seen_->reflected(p, static_cast<int>(channel), sum, Of::All);
            for (std::size_t k = 0; k < columns.size(); ++k)
                if (columns[k].coeff != Column::kSurvival) *value_at(p, columns[k]) += last[k];
        }
        progress_.add(end - block * kBlock);
    });
}

/// One channel, sixteen columns at a time. The first sixteen tell the number of bounces.
void Interreflection::solve(std::size_t channel) {
    const std::vector<Column> columns = columns_of(channel);
    const std::size_t tested = 2 + (job_.emission ? (channels_ == 1 ? 3 : 1) : 0);
    measure_reflectance(channel);
    std::array<double, Growth::kMost> source{};
    for (std::size_t p = 0; p < places_.places.size(); ++p)
        for (std::size_t k = 1; k < tested; ++k)
            if (const double light = static_cast<double>(*value_at(p, columns[k])); light > 0)
                source[k] = std::max(
                    source[k], light / std::max(1 - static_cast<double>(reflectance_[p]), 0.0));
    const auto count = static_cast<double>(places_.places.size());
    const double norm = unoccluded_norm(job_.bands);
    double left_out = 0, shrink = 0;
    const auto ends = [&](const Growth& growth) {
        left_out = job_.bands * tail(growth, 1, source[1]) / norm;
        shrink = std::min(growth.s[1], largest_reflectance_);
        bool small = left_out <= kLeftOutShare * job_.tolerance;
        for (std::size_t k = 2; k < tested; ++k)
            small = small &&
                    tail(growth, k, source[k]) <=
                        kLeftOutShare * job_.tolerance * std::sqrt(growth.sum_squares[k] / count);
        return small;
    };
    int bounces = std::min(job_.bounces, kMostBounces);
    std::vector<Float16> sum;
    for (std::size_t first = 0; first < columns.size(); first += kLanes) {
        const auto some =
            std::span(columns).subspan(first, std::min(kLanes, columns.size() - first));
        if (first == 0)
            bounces = series(channel, some, bounces, tested, ends, sum);
        else
            series(
                channel, some, bounces, 0, [](const Growth&) { return false; }, sum);
        judge(channel, some, sum);
        add_last_bounce(channel, some, sum);
    }
    report_.bounces = std::max(report_.bounces, bounces);
    report_.left_out = std::max(report_.left_out, left_out);
    report_.shrink = std::max(report_.shrink, shrink);
}

/// What T has become is what lobes meet.
void Interreflection::add_lobes() {
    for (const auto& [stride, look] : looks_) {
        const std::vector<LobeLight::Errors> errors = errors_of_lobes(look, stride);
        for (std::size_t lobe = 0; lobe < errors.size(); ++lobe) {
            if (strides_of_lobes_[lobe] != stride) continue;
            report_.lobes[lobe] = choose_bands(errors[lobe], kRaysShare * job_.tolerance);
            report_.lobes[lobe].stride = stride;
        }
    }
    const auto row_size = [&](int bands) {
        return static_cast<std::size_t>(sh::coeff_count(bands) - 1) *
               static_cast<std::size_t>(sh::coeff_count(job_.lobes.light_bands)) * channels_;
    };
    for (std::size_t m = 0; m < transport_.size(); ++m) {
        const std::size_t lobe = job_.lobes.lobe_of_mesh[m];
        if (lobe == LobeLightJob::kNoLobe || transport_[m].rows.empty()) continue;
        transport_[m].reflected.resize(scene_.meshes[m].vertex_count() *
                                       row_size(report_.lobes[lobe].bands));
    }
    parallel_for((places_.places.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
        const std::size_t end = std::min((block + 1) * kBlock, places_.places.size());
        for (std::size_t p = block * kBlock; p < end; ++p) {
            const auto [mesh, vertex] = places_.places[p];
            if (transport_[mesh].reflected.empty()) continue;
            const int bands = report_.lobes[job_.lobes.lobe_of_mesh[mesh]].bands;
            const DVec3 normal = places_.surfaces[mesh].origin(vertex, tracer_.space()).normal;
            const std::vector<std::uint16_t> row =
                lobe_light_->stored_row(*seen_, p, normal, bands);
            std::copy(row.begin(), row.end(),
                      transport_[mesh].reflected.begin() +
                          static_cast<std::ptrdiff_t>(vertex * row.size()));
        }
    });
}

void Interreflection::fill_copies() {
    for (std::size_t m = 0; m < transport_.size(); ++m) {
        MeshTransport& mesh = transport_[m];
        if (mesh.rows.empty()) continue;
        for (std::size_t v = 0; v < places_.numbers[m].size(); ++v) {
            const std::uint32_t first = places_.surfaces[m].representative(v);
            if (first == v || first == ScenePlaces::kNone) continue;
            const auto copy = [&](auto& values, std::size_t size) {
                const auto from = values.begin() + static_cast<std::ptrdiff_t>(first * size);
                std::copy_n(from, size, values.begin() + static_cast<std::ptrdiff_t>(v * size));
            };
            copy(mesh.rows, coeffs_ * channels_);
            if (job_.emission) copy(mesh.emitted, 3);
            copy(mesh.reflected, mesh.reflected.size() / places_.numbers[m].size());
        }
    }
}

BounceReport Interreflection::run() {
    const std::size_t count = places_.places.size();
    report_.lobes.resize(job_.lobes.errors.size());
    if (count == 0) return report_;
    choose_samples();
    report_.stride = job_.stride > 0 ? job_.stride : choose_stride();
    std::vector<double> strides = everywhere(report_.stride);
    if (lobe_light_) {
        choose_strides_of_lobes(report_.stride);
        for (std::size_t m = 0; m < strides.size(); ++m)
            if (const std::size_t lobe = job_.lobes.lobe_of_mesh[m]; lobe != LobeLightJob::kNoLobe)
                strides[m] = strides_of_lobes_[lobe];
    }
    progress_.begin("rays of light between surfaces", "vertices", count + sample_.size());
    std::vector<std::uint32_t> all(count);
    std::iota(all.begin(), all.end(), 0u);
    seen_.emplace(gather(all, strides, 0, SeenSurfaces::Rays::OfTheDirectBake, progress_));
    again_.emplace(gather(sample_, strides, 0, SeenSurfaces::Rays::New, progress_));
    report_.point_count = seen_->point_count();
    report_.black_back_count = seen_->black_back_count();

    if (job_.emission)
        for (std::size_t p = 0; p < count; ++p)
            for (std::size_t c = 0; c < 3; ++c)
                *value_at(p, {Column::kEmission, c}) = seen_->emitted(p)[static_cast<int>(c)];
    square_errors_.assign(sample_.size(), 0);
    progress_.begin("light between surfaces", "vertices",
                    count * channels_ * ((columns_of(0).size() + kLanes - 1) / kLanes));
    for (std::size_t c = 0; c < channels_; ++c) solve(c);
    if (lobe_light_) add_lobes();
    fill_copies();

    const double factor =
        growth_of_error(*again_) * square(with_two_standard_errors(sample_.size()));
    const double norm = unoccluded_norm(job_.bands);
    std::vector<double> errors;
    double sum = 0;
    for (const double e : square_errors_) {
        sum += e * factor;
        errors.push_back(std::sqrt(e * factor) / norm);
    }
    std::sort(errors.begin(), errors.end());
    report_.error_rms = std::sqrt(sum / static_cast<double>(sample_.size())) / norm;
    report_.error_p999 = errors[errors.size() - 1 - errors.size() / 1000];
    if (emitted_signal_ > 0)
        report_.emitted_error_rms = std::sqrt(emitted_error_ / emitted_signal_);
    return report_;
}

}  // namespace

double most_from_bounces(double max_albedo, double blocked_share, int bands) {
    if (blocked_share == 0 || max_albedo == 0) return 0;
    if (max_albedo >= 1) return HUGE_VAL;
    // |T|_2 <= bands T_00 for any light from anywhere, and T_00 <= Y_00.
    const double most = bands / std::sqrt(4 * std::numbers::pi) / unoccluded_norm(bands);
    return max_albedo / (1 - max_albedo) * most * std::sqrt(blocked_share);
}

BounceReport add_bounces(const BounceJob& job, const Scene& scene, const Tracer& tracer,
                         std::span<const BlockedRays> blocked, std::span<MeshTransport> transport,
                         Progress& progress) {
    return Interreflection(job, scene, tracer, blocked, transport, progress).run();
}

}  // namespace envbake
