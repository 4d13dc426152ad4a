// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/cluster_tree.h"
#include "baker/lighting/error_bound.h"
#include "baker/lighting/prefilter.h"
#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_estimate.h"
#include "baker/lighting/source_patch.h"
#include "baker/lighting/source_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

namespace envbake::lighting {

inline constexpr double kLargestPatch = 0.35;  ///< radians: larger ones are no parallelograms
inline constexpr double kLargestBend = 0.35;   ///< radians, likewise
inline constexpr int kDeepestSplit = 28;

/// Accepted sources, by the formula that each needs.
template <class S>
struct Sources {
    std::vector<const ClusterMoments<float>*> clusters, horizon_clusters;
    std::vector<PatchMoments<S>> patches, horizon_patches;

    void clear() {
        clusters.clear();
        horizon_clusters.clear();
        patches.clear();
        horizon_patches.clear();
    }
};

template <class S>
PatchMoments<S> moments_of(const SourcePatch& p, const DVec3& radiance, const DVec3& origin) {
    PatchMoments<S> m;
    for (int i = 0; i < 3; ++i) {
        m.centre[i] = static_cast<S>(p.centre[i] - origin[i]);
        m.flux[i] = static_cast<S>(p.omega * radiance[i]);
        m.half_a[i] = static_cast<S>(p.half_a[i]);
        m.half_b[i] = static_cast<S>(p.half_b[i]);
    }
    m.slope_a = static_cast<S>(glm::dot(p.centre, p.half_a));
    m.slope_b = static_cast<S>(glm::dot(p.centre, p.half_b));
    m.variance = static_cast<S>(p.variance);
    const double a2 = glm::dot(p.half_a, p.half_a), b2 = glm::dot(p.half_b, p.half_b);
    m.bulge_a = static_cast<S>(-2 * a2 / 15);
    m.bulge_b = static_cast<S>(-2 * b2 / 15);
    m.radial = static_cast<S>((a2 * a2 + b2 * b2) / 45);
    return m;
}

/// Walks of the tree for one tile after another: which blocks and which texels stand for the
/// environment there.
///
/// First the coarse front, whose sum tells what the tile receives; then refine() opens the front
/// until the estimated error of every source is below the tolerance, relative to that. Sources are
/// handed over some thousands at a time, emit(places, sources).
///
/// Base blocks that were opened are kept for the next tile, up to kOpenedNodes.
template <template <class> class Lobe, class S, class View>
class SourceWalk {
  public:
    /// `channels` of the environment matter, 1 or 3.
    SourceWalk(const ClusterTree& tree, const Lobe<S>& weight, int channels,
               const PrefilterAccuracy& accuracy)
        : tree_(tree),
          weight_(weight),
          inverse_axis_(1 / weight_.nearby(S(0)).envelope),
          inverse_core2_(weight_.nearby(S(0)).inverse_length2),
          most_core_(static_cast<S>(std::pow(largest_extent2(weight, accuracy), 3))),
          channels_(channels),
          accuracy_(accuracy) {}

    /// A tile around `middle`, all of it within the chord `radius`; patches are counted from the
    /// middle. `half_width` is that of the square to interpolate in.
    void begin(const DVec3& middle, double radius, double half_width, const View& view) {
        view_ = &view;
        origin_ = middle;
        for (int i = 0; i < 3; ++i) middle_[i] = static_cast<S>(middle[i]);
        radius_ = static_cast<S>(radius);
        half_width_ = static_cast<S>(half_width);
        estimates_.assign(view.groups(), {});
        accepted_.resize(view.groups());
        bounds_.resize(view.groups());
        for (Sources<S>& sources : accepted_for_) sources.clear();
        const std::size_t lanes = sizeof(Real) / sizeof(S);
        relate_to(std::vector<DVec3>(view.groups() * lanes, tree_.mean()));
    }

    /// The coarse front: sources no larger than their distance, or than the lobe. All are for the
    /// texels.
    template <class Emit>
    void front(const Emit& emit) {
        coarse_ = true;
        interpolate_ = false;
        front_.clear();
        for (const std::uint32_t i : tree_.roots()) stack_.push_back({nullptr, i});
        while (!stack_.empty()) {
            const Visit v = stack_.back();
            stack_.pop_back();
            const ClusterNode& n = clusters_of(v).nodes[v.node];
            if (n.flux[0] + n.flux[1] + n.flux[2] <= 0) continue;
            const S along = cosine(n.centre);
            if (along < -(radius_ + S(n.radius))) continue;
            if (negligible(n.centre, n.flux, S(n.radius))) continue;
            const bool whole = fits_the_front(n);
            if (!v.in && (whole || is_base(n))) front_.push_back(v.node);
            if (whole) {
                const bool horizon = std::abs(along) < radius_ + S(n.radius);
                const ClusterMoments<float>& m = clusters_of(v).moments[v.node];
                Sources<S>& to = sources_for(Places::Texels);
                (horizon ? to.horizon_clusters : to.clusters).push_back(&m);
                hand_over_many(emit);
            } else {
                open(v, emit);
            }
        }
        hand_over(emit);
    }

    /// Opens the front until every source is good enough. `received` is what arrives at the points
    /// of the view, or at the darkest of the disc, times the tree's scale(): floor and norm
    /// included.
    template <class Emit>
    void refine(const std::vector<DVec3>& received, bool interpolate, const Emit& emit) {
        relate_to(received);
        coarse_ = false;
        interpolate_ = interpolate;
        // How much more than flat blocks uneven ones err. From the edge of a disc sources are taken
        // for closer than they are to most of it; from a point, for no more than they are.
        const bool wide = kDisc && inverse_core2_ < S(1.5);
        uneven_ = interpolate || wide ? 1 : kDisc ? 4 : 16;
        for (const std::uint32_t i : front_) stack_.push_back({nullptr, i});
        while (!stack_.empty()) {
            const Visit v = stack_.back();
            stack_.pop_back();
            const ClusterNode& n = clusters_of(v).nodes[v.node];
            if (n.flux[0] + n.flux[1] + n.flux[2] <= 0) continue;
            const S along = cosine(n.centre);
            if (along < -(radius_ + S(n.radius))) continue;
            if (negligible(n.centre, n.flux, S(n.radius))) continue;
            const bool horizon = std::abs(along) < radius_ + S(n.radius);
            const Shape shape{.centre = {S(n.centre[0]), S(n.centre[1]), S(n.centre[2])},
                              .flux = {S(n.flux[0]), S(n.flux[1]), S(n.flux[2])},
                              .variance = S(n.variance),
                              .extent = S(n.extent),
                              .reach = S(n.radius),
                              .unevenness = S(n.unevenness),
                              .part = 1,
                              .deviation = S(n.deviation),
                              .offset = S(n.offset),
                              .irregular = -1,
                              .cut = horizon ? S(0.15) * std::sqrt(3 * S(n.variance)) : S(0),
                              .horizon = horizon};
            Places places = Places::Texels;
            if (accept(shape, places)) {
                Sources<S>& to = sources_for(places);
                (horizon ? to.horizon_clusters : to.clusters)
                    .push_back(&clusters_of(v).moments[v.node]);
                hand_over_many(emit);
            } else {
                open(v, emit);
            }
        }
        hand_over(emit);
    }

    /// Of the worst direction. `received` as for refine(), now that it is known.
    double error_estimate(const std::vector<DVec3>& received) const {
        const DVec3 mean = tree_.mean();
        double worst = 0;
        for (std::size_t p = 0; p < received.size(); ++p) {
            double excess = 0;  // of what estimates are relative to over what they should be
            for (int k = 0; k < channels_; ++k) {
                const double inverse = static_cast<double>(lane(inverse_[k], p));
                const double due = received[p][k] + 1e-3 * mean[k];
                if (inverse > 0 && due > 0) {
                    excess = std::max(excess,
                                      static_cast<double>(weight_.inverse_norm) / (inverse * due));
                }
            }
            worst = std::max(worst, excess * error_at(p));
        }
        return worst;
    }

    /// Of the worst direction, dropped sources included. `received` likewise.
    double error_bound(const std::vector<DVec3>& received) const {
        const DVec3 mean = tree_.mean();
        double worst = 0;
        for (std::size_t p = 0; p < received.size(); ++p) {
            const auto& sums = estimates_[p / kLanes<S>];
            for (int k = 0; k < channels_; ++k) {
                const double bound =
                    static_cast<double>(sums.bound[k][p % kLanes<S>] + sums.dropped[p % kLanes<S>]);
                const double inverse = static_cast<double>(lane(inverse_[k], p));
                if (inverse <= 0) continue;
                const double off = bound * static_cast<double>(weight_.inverse_norm) / inverse;
                const double least = std::max(received[p][k] - off, floor()[k]) + 1e-3 * mean[k];
                if (off > 0) worst = std::max(worst, off / least);
            }
        }
        return worst;
    }

  private:
    using Real = typename View::Real;
    static constexpr bool kDisc = std::is_same_v<Real, S>;
    static constexpr std::size_t kBatch = 4096;       ///< sources handed over at a time
    static constexpr std::size_t kOpenedNodes = 400;  ///< 0.2 MB
    static constexpr S kFrontCore =
        S(Lobe<S>::kFrontExtent2 * Lobe<S>::kFrontExtent2 * Lobe<S>::kFrontExtent2);

    /// Under the tail of GGX a tile's blocks err alike, the largest ones of wide lobes most. Down
    /// to this size they are halved for the energy of the mip, to 1e-5 of it at a tolerance of
    /// 1e-3.
    static double largest_extent2(const Lobe<S>& weight, const PrefilterAccuracy& accuracy) {
        if (!kDisc || Lobe<S>::kTailEnds) return accuracy.extent2;
        const double enough = weight.core() > 0.3 ? 0.06 : 0.1;
        return std::min(accuracy.extent2, enough * std::max(1.0, 5.5 * accuracy.extent2));
    }

    struct Visit {
        OpenedBlock* in;  ///< null: a node of the tree
        std::uint32_t node;
    };
    const Clusters& clusters_of(const Visit& v) const {
        return v.in ? v.in->clusters : tree_.clusters();
    }
    Sources<S>& sources_for(Places places) {
        return accepted_for_[static_cast<std::size_t>(places)];
    }
    void push(OpenedBlock* in, std::uint32_t node) {
        if (in)
            tree_.finish(*in, node);
        else
            __builtin_prefetch(&tree_.clusters().nodes[node]);
        stack_.push_back({in, node});
    }

    /// What an estimate looks at.
    struct Shape {
        S centre[3];
        S flux[3];
        S variance, extent, reach, unevenness;
        S part;               ///< of the flux that is its own
        S deviation, offset;  ///< ClusterSpread; of a cluster
        S irregular;          ///< taper + bend, of a part of a texel; of a cluster negative
        S cut;                ///< what the horizon's kink across it costs, over share and density
        bool horizon;
    };

    DVec3 floor() const { return tree_.floor() * tree_.scale(); }

    static bool is_base(const ClusterNode& n) { return n.child_count[0] + n.child_count[1] == 0; }

    template <class Emit>
    [[gnu::always_inline]] void hand_over_many(const Emit& emit) {
        if (++pending_ >= kBatch) hand_over(emit);
    }
    template <class Emit>
    [[gnu::noinline]] void hand_over(const Emit& emit) {
        pending_ = 0;
        for (const Places places : kAllPlaces) {
            emit(places, std::as_const(sources_for(places)));
            sources_for(places).clear();
        }
    }

    template <class Emit>
    void open(const Visit& v, const Emit& emit) {
        const ClusterNode& n = clusters_of(v).nodes[v.node];
        for (int run = 0; run < 2; ++run) {
            for (std::uint32_t j = 0; j < n.child_count[run]; ++j) {
                push(v.in, n.first_child[run] + j);
            }
        }
        if (!is_base(n)) return;
        const TexelBlock& block = clusters_of(v).blocks[v.node];
        if (!v.in && (block.row1 - block.row0) * (block.column1 - block.column0) > kFewTexels) {
            OpenedBlock& inside = opened(v.node, emit);
            const ClusterNode root = inside.clusters.nodes[0];
            for (std::uint32_t j = 0; j < root.child_count[0]; ++j) {
                push(&inside, root.first_child[0] + j);
            }
            return;
        }
        for (int r = block.row0; r < block.row1; ++r) {
            for (int c = block.column0; c < block.column1; ++c) {
                const DVec3 radiance = tree_.excess(block, r, c);
                if (radiance == DVec3{0}) continue;
                add_part(tree_.texel(block, r, c), radiance, 0);
                hand_over_many(emit);
            }
        }
    }

    /// The inside of a base block. When it is too much, what was opened before goes; nothing points
    /// there, for the stack is done with a block before it comes to the next.
    template <class Emit>
    OpenedBlock& opened(std::uint32_t node, const Emit& emit) {
        const auto found = opened_.find(node);
        if (found != opened_.end()) return found->second;
        if (opened_nodes_ > kOpenedNodes) {
            hand_over(emit);
            opened_.clear();
            opened_nodes_ = 0;
        }
        OpenedBlock& inside =
            opened_.emplace(node, tree_.open(tree_.clusters().blocks[node])).first->second;
        opened_nodes_ += inside.raw.size();
        return inside;
    }

    void relate_to(const std::vector<DVec3>& received) {
        const DVec3 mean = tree_.mean();
        std::vector<double> inverse(received.size());
        for (int k = 0; k < 3; ++k) {
            for (std::size_t p = 0; p < received.size(); ++p) {
                const double against = 0.8 * received[p][k] + 1e-3 * mean[k];
                inverse[p] = k < channels_ && against > 0
                                 ? static_cast<double>(weight_.inverse_norm) / against
                                 : 0.0;
            }
            if constexpr (kDisc) {
                inverse_[k] = {static_cast<S>(inverse[0])};
            } else {
                inverse_[k] = in_groups<S>(inverse);
            }
        }
    }

    static S lane(const std::vector<Real>& groups, std::size_t point) {
        if constexpr (kDisc) {
            return groups[0];
        } else {
            return groups[point / kLanes<S>][point % kLanes<S>];
        }
    }
    double error_at(std::size_t point) const {
        if constexpr (kDisc) {
            return static_cast<double>(estimates_[0].template error<Lobe<S>>(0.15f));
        } else {
            const Real errors = estimates_[point / kLanes<S>].template error<Lobe<S>>(0.65f);
            return static_cast<double>(errors[point % kLanes<S>]);
        }
    }

    template <class T>
    S cosine(const T* c) const {
        return middle_[0] * S(c[0]) + middle_[1] * S(c[1]) + middle_[2] * S(c[2]);
    }
    /// A source's flux over what arrives in all.
    template <class T>
    Real share_of(const T* flux, std::size_t group) const {
        return larger<Real>(
            larger<Real>(inverse_[0][group] * S(flux[0]), inverse_[1][group] * S(flux[1])),
            inverse_[2][group] * S(flux[2]));
    }

    /// The square of the distance to a source's nearest point.
    static Real closest2(const Real& distance2, S reach) {
        const Real closest = larger<Real>(Real{}, square_root(distance2) - reach);
        return closest * closest;
    }

    /// Of a lobe whose tail ends: sources too far to be seen are left out, whole blocks at once.
    template <class T>
    bool negligible(const T* centre, const T* flux, S reach) {
        if constexpr (Lobe<S>::kTailEnds) {
            const auto most = [&](std::size_t g) {
                return share_of(flux, g) *
                       weight_.nearby(closest2(view_->distance2(g, centre), reach)).density;
            };
            for (std::size_t g = 0; g < estimates_.size(); ++g) {
                if (any(most(g) > S(accuracy_.negligible))) return false;
            }
            for (std::size_t g = 0; g < estimates_.size(); ++g) estimates_[g].dropped += most(g);
            return true;
        }
        return false;
    }

    /// How much of the lobe a source of this extent gets wrong: (extent / l)^6, the order of the
    /// series' remainder. Where a lobe's tail ends, less is asked of the tail: by the density
    /// there, at the source's nearest point, over that on the axis, and 1 + (distance / l)^2, for
    /// there are that many more of its like.
    Real core_part(const WeightNearby<Real>& nearby, const Real& distance2, S extent,
                   S reach) const {
        const Real x2 = nearby.inverse_length2 * (extent * extent), x6 = x2 * x2 * x2;
        if constexpr (!Lobe<S>::kTailEnds) return x6;
        const Real envelope = weight_.nearby(closest2(distance2, reach)).envelope;
        return x6 * envelope * (distance2 * inverse_core2_ + S(1)) *
               (S(Lobe<S>::kCore) * inverse_axis_);
    }
    bool fits_the_front(const ClusterNode& n) const {
        for (std::size_t g = 0; g < view_->groups(); ++g) {
            const Real distance2 = view_->distance2(g, n.centre);
            const WeightNearby<Real> nearby = weight_.nearby(distance2);
            if (any(core_part(nearby, distance2, S(n.extent), S(n.radius)) > kFrontCore)) {
                return false;
            }
        }
        return true;
    }

    /// What one source's Taylor series leaves out, relative to the darkest point of the tile, with
    /// l the lobe's scale at the nearest point: third order where the source is uneven, and some of
    /// the fourth; at the horizon the kink of max(0, mu). The factors are calibrated against brute
    /// force, not proved.
    [[gnu::always_inline]] SourceEstimate<Real> estimate(const Shape& source,
                                                         std::size_t group) const {
        const Real distance2 = view_->distance2(group, source.centre);
        const WeightNearby<Real> nearby = weight_.nearby(distance2);
        const Real share = share_of(source.flux, group);
        const Real w = nearby.envelope * share;
        const Real& inverse_l2 = nearby.inverse_length2;
        const Real inverse_l = square_root(inverse_l2);
        const Real extent2 = inverse_l2 * (source.extent * source.extent);  // (extent / l)^2
        const Real core = core_part(nearby, distance2, source.extent, source.reach);
        const Real curvature =
            w * inverse_l2 * (S(Lobe<S>::kCurvature) * source.variance) *
            ((inverse_l + S(0.5)) *
                 (S(0.5) * (S(0.1) + uneven_ * source.unevenness) * source.extent) +
             extent2 * S(0.5));
        const Real w_horizon = share * weight_.density_at_horizon();
        const Real kink = w_horizon * source.cut;
        SourceEstimate<Real> e{.core = w * extent2 * extent2 * extent2 * S(Lobe<S>::kCore),
                               .curvature = curvature,
                               .kink = kink,
                               .interpolation = Real{},
                               .accepted = false,
                               .places = Places::Texels};
        // The sources of the lobe's core are many and err alike: no share of theirs is small
        // enough, so their extent has a limit of its own.
        e.accepted = coarse_ ? !any(core > kFrontCore)
                             : !any(kink > S(accuracy_.horizon)) && !any(core > most_core_) &&
                                   !any(curvature > S(accuracy_.cluster));
        if constexpr (kDisc) {
            if (e.accepted && interpolate_) {
                // A kink is interpolated to half_width / (2 n) between n points.
                const S kinked = source.horizon ? 5 * w_horizon * half_width_ : S(0);
                const Missed<S> missed = weight_.missed(nearby, half_width_);
                const S coarse = std::max(kinked / 4, share * missed.coarse);
                const S fine = std::max(kinked / 8, share * missed.fine);
                const S most = S(accuracy_.interpolation);
                // The far sources, which are the most: 0.04 of what is allowed one that is near.
                if (coarse <= S(0.04) * most) {
                    e.places = Places::CoarseNodes;
                    e.interpolation = coarse;
                } else if (fine <= most) {
                    e.places = Places::FineNodes;
                    e.interpolation = fine;
                }
            }
        }
        return e;
    }

    /// Whether a source is good enough from everywhere; if so its estimates are added up.
    [[gnu::always_inline]] bool accept(const Shape& source, Places& places, bool last = false) {
        if constexpr (!kDisc) {
            if (accuracy_.proved > 0 && !coarse_) return accept_by_bound(source, last);
        }
        if constexpr (kDisc) {
            const SourceEstimate<Real> e = estimate(source, 0);
            places = e.places;
            if (e.accepted && !coarse_) estimates_[0].add(e, source.part);
            return e.accepted;
        }
        for (std::size_t g = 0; g < estimates_.size(); ++g) {
            accepted_[g] = estimate(source, g);
            if (!accepted_[g].accepted) return false;
        }
        if (coarse_) return true;
        for (std::size_t g = 0; g < estimates_.size(); ++g)
            estimates_[g].add(accepted_[g], source.part);
        return true;
    }

    /// Whether a source's bound is no larger a part of what it gives than the bound of all may be
    /// of what arrives; or so small that the sum of thousands is no more than a half of that.
    bool accept_by_bound(const Shape& source, bool last) {
        const S proved = S(accuracy_.proved);
        for (std::size_t g = 0; g < estimates_.size(); ++g) {
            const Real distance2 = view_->distance2(g, source.centre);
            const Real mu = S(1) - (distance2 * S(0.5) + source.variance);
            const Real bound =
                source.irregular < 0
                    ? cluster_error_bound<Lobe<S>, Real, S>(
                          weight_, {source.variance, source.reach, source.deviation, source.offset},
                          distance2, mu)
                    : part_error_bound<Lobe<S>, Real, S>(weight_, source.extent, source.irregular,
                                                         source.reach, distance2, mu);
            const Real given = weight_.nearby(distance2).density * larger<Real>(Real{}, mu);
            const Real share = share_of(source.flux, g) * source.part;
            const Real most = (share * given + S(2e-5)) * (S(0.9) * proved);
            if (!last && any(share * bound > most)) return false;
            bounds_[g] = bound * source.part;
        }
        for (std::size_t g = 0; g < estimates_.size(); ++g) {
            for (std::size_t k = 0; k < 3; ++k) {
                estimates_[g].bound[k] += bounds_[g] * inverse_[k][g] * source.flux[k];
            }
        }
        return true;
    }

    void add_part(const TexelPart& part, const DVec3& radiance, int depth) {
        const SourcePatch patch = part.patch();
        const double reach = 1.05 * (glm::length(patch.half_a) + glm::length(patch.half_b)) +
                             patch.extent * patch.extent;
        const DVec3& c = patch.centre;
        const S along = cosine(&c.x);
        if (along < -(radius_ + S(reach))) return;
        const bool horizon = std::abs(along) < radius_ + S(reach);
        // Slivers come in numbers, all erring alike: each answers for a square of them.
        const DVec3 flux = patch.omega * patch.aspect * radiance;
        if (negligible(&c.x, &flux.x, S(reach))) return;
        const Shape shape{.centre = {S(c.x), S(c.y), S(c.z)},
                          .flux = {S(flux.x), S(flux.y), S(flux.z)},
                          .variance = S(patch.variance),
                          .extent = S(patch.extent),
                          .reach = S(reach),
                          .unevenness = S(std::min(1.0, patch.taper)),
                          .part = S(1 / patch.aspect),
                          .deviation = 0,
                          .offset = 0,
                          .irregular = S(patch.taper + patch.bend),
                          .cut = horizon ? S(0.1 * patch.extent * patch.extent) : S(0),
                          .horizon = horizon};
        const bool straight = patch.bend <= kLargestBend;
        const bool flat = straight && patch.extent <= kLargestPatch;
        Places places = Places::Texels;
        const bool last = depth >= kDeepestSplit;
        const bool accepted = (flat || last) && accept(shape, places, last);
        if (accepted || last) {
            Sources<S>& to = sources_for(places);
            (horizon ? to.horizon_patches : to.patches)
                .push_back(moments_of<S>(patch, radiance, origin_));
            return;
        }
        // Halve the longer side, both where they are alike, and what is bent.
        const DVec2 sides = part.sides();
        const bool split_a = sides.x > 0.6 * sides.y && (flat || patch.extent > kLargestPatch);
        const bool split_b = sides.y > 0.6 * sides.x || !straight;
        const auto add_rows = [&](const TexelPart& rows) {
            if (!split_b) return add_part(rows, radiance, depth + 1);
            for (const TexelPart& half : rows.halves_along_b()) add_part(half, radiance, depth + 1);
        };
        if (!split_a) return add_rows(part);
        for (const TexelPart& half : part.halves_along_a()) add_rows(half);
    }

    const ClusterTree& tree_;
    const Lobe<S>& weight_;
    const S inverse_axis_, inverse_core2_, most_core_;
    const int channels_;
    const PrefilterAccuracy& accuracy_;
    const View* view_ = nullptr;
    DVec3 origin_{0};
    S middle_[3] = {};
    S radius_ = 0, half_width_ = 0;
    std::vector<Real> inverse_[3];  ///< by channel and group
    bool interpolate_ = false, coarse_ = false;
    S uneven_ = 1;
    std::vector<EstimateSums<Real>> estimates_;
    std::vector<SourceEstimate<Real>> accepted_;
    std::vector<Real> bounds_;
    std::vector<Visit> stack_;
    std::vector<std::uint32_t> front_;
    std::unordered_map<std::uint32_t, OpenedBlock> opened_;
    std::size_t opened_nodes_ = 0;
    std::size_t pending_ = 0;  ///< sources not handed over yet, about
    std::array<Sources<S>, kAllPlaces.size()> accepted_for_;
};

}  // namespace envbake::lighting
