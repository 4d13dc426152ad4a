// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/cluster_tree.h"
#include "baker/lighting/prefilter.h"
#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_patch.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace envbake::lighting {

inline constexpr double kLargestPatch = 0.35;  ///< radians: larger ones are no parallelograms
inline constexpr double kLargestBend = 0.35;   ///< radians, likewise
inline constexpr int kDeepestSplit = 28;

/// Accepted sources, by the formula that each needs.
template <class S>
struct Sources {
    std::vector<std::uint32_t> clusters, horizon_clusters;
    std::vector<PatchMoments<S>> patches, horizon_patches;

    void clear() {
        clusters.clear();
        horizon_clusters.clear();
        patches.clear();
        horizon_patches.clear();
    }
};

template <class S>
PatchMoments<S> moments_of(const SourcePatch& p, const DVec3& radiance) {
    PatchMoments<S> m;
    for (int i = 0; i < 3; ++i) {
        m.centre[i] = static_cast<S>(p.centre[i]);
        m.flux[i] = static_cast<S>(p.omega * radiance[i]);
        m.half_a[i] = static_cast<S>(p.half_a[i]);
        m.half_b[i] = static_cast<S>(p.half_b[i]);
    }
    m.variance = static_cast<S>(p.variance);
    return m;
}

/// What one source adds to the error of a texel, relative to the darkest of its tile.
struct SourceEstimate {
    double core;           ///< share times (extent / l)^6
    double curvature;      ///< of the Taylor series
    double kink;           ///< of the horizon across it
    double interpolation;  ///< within the tile, where it is interpolated
    bool accepted;
    bool direct;  ///< too sharp to be interpolated
};

/// Smooth content errs with one sign, so those are summed; the others err either way.
struct TileEstimate {
    double core = 0, curvature = 0, kink2 = 0, interpolation2 = 0, dropped = 0;

    void add(const SourceEstimate& e) {
        core += e.core;
        curvature += e.curvature;
        kink2 += e.kink * e.kink;
        if (!e.direct) interpolation2 += e.interpolation * e.interpolation;
    }
    void keep_largest(const TileEstimate& o) {
        core = std::max(core, o.core);
        curvature = std::max(curvature, o.curvature);
        kink2 = std::max(kink2, o.kink2);
        interpolation2 = std::max(interpolation2, o.interpolation2);
        dropped = std::max(dropped, o.dropped);
    }
    /// Calibrated against brute force, factor by factor, on photographs, synthetic skies and noise.
    double error() const {
        return 0.06 * core + 0.15 * curvature + 0.3 * std::sqrt(kink2) +
               0.02 * std::sqrt(interpolation2) + dropped;
    }
};

/// One walk of the tree for a tile (or, with radius 0, for one direction): which blocks and which
/// texels stand for the environment there.
///
/// First the coarse front, whose sum tells what the tile receives; then refine() opens the front
/// until the estimated error of every source is below the tolerance, relative to that.
template <template <class> class Lobe, class S>
class SourceWalk {
  public:
    /// `channels` of the environment matter, 1 or 3.
    SourceWalk(const ClusterTree& tree, const Lobe<S>& weight, int channels,
               const PrefilterAccuracy& accuracy)
        : tree_(tree),
          weight_(weight),
          inverse_axis_(1 / weight_.nearby(0).envelope),
          inverse_core_(weight_.nearby(0).inverse_length),
          most_core_(static_cast<S>(std::pow(accuracy.extent2, 3))),
          channels_(channels),
          accuracy_(accuracy) {}

    void begin(const DVec3& middle, double radius, double half_width) {
        for (int i = 0; i < 3; ++i) middle_[i] = static_cast<S>(middle[i]);
        radius_ = static_cast<S>(radius);
        half_width_ = static_cast<S>(half_width);
        estimate_ = {};
        near_.clear();
        far_.clear();
        relate_to(tree_.mean());
    }

    /// The coarse front: blocks no larger than their distance, or than the lobe.
    const std::vector<std::uint32_t>& front() {
        front_.clear();
        stack_ = tree_.roots();
        while (!stack_.empty()) {
            const std::uint32_t i = stack_.back();
            stack_.pop_back();
            const ClusterNode& n = tree_.node(i);
            if (n.flux[0] + n.flux[1] + n.flux[2] <= 0) continue;
            if (cosine(n.centre) < -(radius_ + S(n.radius))) continue;
            const S near = nearest(n.centre);
            if (negligible(n.flux, near, S(n.radius))) continue;
            const WeightNearby<S> nearby = weight_.nearby(near);
            if (core_part(nearby, near, S(n.extent), S(n.radius)) <= kFrontCore || is_base(n)) {
                front_.push_back(i);
            } else {
                push_children(n);
            }
        }
        return front_;
    }

    bool straddles(const float* centre, double reach) const {
        return std::abs(cosine(centre)) < radius_ + S(reach);
    }

    /// Opens the front until every source is good enough. `darkest` is what the darkest point of
    /// the tile receives, times the tree's scale(): floor and norm included.
    void refine(const DVec3& darkest, bool interpolate) {
        relate_to(darkest);
        interpolate_ = interpolate;
        std::swap(stack_, front_);
        while (!stack_.empty()) {
            const std::uint32_t i = stack_.back();
            stack_.pop_back();
            const ClusterNode& n = tree_.node(i);
            if (n.flux[0] + n.flux[1] + n.flux[2] <= 0) continue;
            const S along = cosine(n.centre);
            if (along < -(radius_ + S(n.radius))) continue;
            const bool horizon = std::abs(along) < radius_ + S(n.radius);
            const S near = nearest(n.centre);
            if (negligible(n.flux, near, S(n.radius))) continue;
            const SourceEstimate e = estimate<true>(near, n.flux, S(n.variance), S(n.extent),
                                                    S(n.radius), S(n.unevenness), horizon);
            if (!e.accepted) {
                if (is_base(n)) {
                    open_texels(n);
                } else {
                    push_children(n);
                }
                continue;
            }
            estimate_.add(e);
            Sources<S>& to = e.direct ? near_ : far_;
            (horizon ? to.horizon_clusters : to.clusters).push_back(i);
        }
    }

    const Sources<S>& near_sources() const { return near_; }  ///< too sharp to be interpolated
    const Sources<S>& far_sources() const { return far_; }
    TileEstimate estimated() const { return estimate_; }

  private:
    static constexpr S kFrontCore =
        S(Lobe<S>::kFrontExtent2 * Lobe<S>::kFrontExtent2 * Lobe<S>::kFrontExtent2);

    static bool is_base(const ClusterNode& n) { return n.child_count[0] + n.child_count[1] == 0; }

    void push_children(const ClusterNode& n) {
        for (int run = 0; run < 2; ++run) {
            for (std::uint32_t j = 0; j < n.child_count[run]; ++j) {
                stack_.push_back(n.first_child[run] + j);
            }
        }
    }

    void relate_to(const DVec3& darkest) {
        const DVec3 mean = tree_.mean();
        for (int k = 0; k < channels_; ++k) {
            const double against = 0.8 * darkest[k] + 1e-3 * mean[k];
            inverse_[k] = static_cast<S>(
                against > 0 ? static_cast<double>(weight_.inverse_norm) / against : 0.0);
        }
    }

    template <class T>
    S cosine(const T* c) const {
        return middle_[0] * S(c[0]) + middle_[1] * S(c[1]) + middle_[2] * S(c[2]);
    }
    /// Distance from the tile's edge to a centre, 0 inside.
    template <class T>
    S nearest(const T* c) const {
        const S x = middle_[0] - S(c[0]), y = middle_[1] - S(c[1]), z = middle_[2] - S(c[2]);
        return std::max(S(0), std::sqrt(x * x + y * y + z * z) - radius_);
    }
    /// A source's flux over what the darkest point receives.
    template <class T>
    S share_of(const T* flux) const {
        return std::max(
            {S(flux[0]) * inverse_[0], S(flux[1]) * inverse_[1], S(flux[2]) * inverse_[2]});
    }

    /// Of a lobe whose tail ends: sources too far to be seen are left out, whole blocks at once.
    template <class T>
    bool negligible(const T* flux, S near, S reach) {
        if constexpr (Lobe<S>::kTailEnds) {
            const S most = share_of(flux) * weight_.nearby(std::max(S(0), near - reach)).density;
            if (most < S(accuracy_.negligible)) {
                estimate_.dropped += static_cast<double>(most);
                return true;
            }
        }
        return false;
    }

    /// How much of the lobe a source of this extent gets wrong: (extent / l)^6, the order of the
    /// series' remainder. Where a lobe's tail ends, less is asked of the tail: by the density
    /// there, at the source's nearest point, over that on the axis, and 1 + (distance / l)^2, for
    /// there are that many more of its like.
    S core_part(const WeightNearby<S>& nearby, S near, S extent, S reach) const {
        const S x = extent * nearby.inverse_length, x2 = x * x, x6 = x2 * x2 * x2;
        if constexpr (!Lobe<S>::kTailEnds) return x6;
        const S far = near * inverse_core_;
        const S envelope = weight_.nearby(std::max(S(0), near - reach)).envelope;
        return S(Lobe<S>::kCore) * x6 * envelope * inverse_axis_ * (1 + far * far);
    }

    /// What one source's Taylor series leaves out, relative to the darkest point of the tile, with
    /// l the lobe's scale at the nearest point: third order where the source is uneven, and some of
    /// the fourth; at the horizon the kink of max(0, mu). The factors are calibrated against brute
    /// force, not proved.
    template <bool kCluster, class T>
    SourceEstimate estimate(S near, const T* flux, S variance, S extent, S reach, S unevenness,
                            bool horizon) const {
        const S share = share_of(flux);
        const WeightNearby<S> nearby = weight_.nearby(near);
        const S w = share * nearby.envelope;
        const S inverse_l = nearby.inverse_length, inverse_l2 = inverse_l * inverse_l;
        const S extent2 = extent * extent * inverse_l2;  // (extent / l)^2
        const S core = core_part(nearby, near, extent, reach);
        const S curvature =
            S(Lobe<S>::kCurvature) * w * variance * inverse_l2 *
            (S(0.5) * (S(0.1) + unevenness) * extent * (inverse_l + S(0.5)) + S(0.5) * extent2);
        const S w_horizon = share * weight_.density_at_horizon();
        S kink = 0;
        if (horizon) {
            kink = kCluster ? S(0.15) * std::sqrt(3 * variance) * w_horizon
                            : S(0.1) * extent * extent * w_horizon;
        }
        // The sources of the lobe's core are many and err alike: no share of theirs is small
        // enough, so their extent has a limit of its own.
        const bool accepted = !(curvature > S(accuracy_.cluster)) &&
                              !(kink > S(accuracy_.horizon)) && !(core > most_core_);
        S missed = 0;
        if (accepted && interpolate_) {
            // A kink is interpolated to half_width / (2 n), n = 8 points.
            if (horizon) missed = S(5.0 / 8) * w_horizon * half_width_;
            missed = std::max(missed, share * weight_.missed(nearby, half_width_));
        }
        return {.core = static_cast<double>(S(Lobe<S>::kCore) * w * extent2 * extent2 * extent2),
                .curvature = static_cast<double>(curvature),
                .kink = static_cast<double>(kink),
                .interpolation = static_cast<double>(missed),
                .accepted = accepted,
                .direct = missed > S(accuracy_.interpolation)};
    }

    void open_texels(const ClusterNode& n) {
        const TexelBlock& block = tree_.block(n.block);
        for (int r = block.row0; r < block.row1; ++r) {
            for (int c = block.column0; c < block.column1; ++c) {
                const DVec3 radiance = tree_.excess(block, r, c);
                if (radiance == DVec3{0}) continue;
                const SourcePatch patch = tree_.texel_patch(block, r, c);
                add_patch_or_parts(patch, tree_.texel_rect(block, r, c), radiance, 0);
            }
        }
    }

    void add_patch_or_parts(const SourcePatch& patch, const SourceRect& rect, const DVec3& radiance,
                            int depth) {
        const double reach = 1.05 * (glm::length(patch.half_a) + glm::length(patch.half_b)) +
                             patch.extent * patch.extent;
        const DVec3& c = patch.centre;
        const S along = cosine(&c.x);
        if (along < -(radius_ + S(reach))) return;
        const bool horizon = std::abs(along) < radius_ + S(reach);
        // Slivers come in numbers, all erring alike: each answers for a square of them.
        const DVec3 flux = patch.omega * patch.aspect * radiance;
        const S near = nearest(&c.x);
        if (negligible(&flux.x, near, S(reach))) return;
        const SourceEstimate e = estimate<false>(near, &flux.x, S(patch.variance), S(patch.extent),
                                                 S(reach), S(std::min(1.0, patch.taper)), horizon);
        const bool straight = patch.bend <= kLargestBend;
        if ((e.accepted && straight && patch.extent <= kLargestPatch) || depth >= kDeepestSplit) {
            estimate_.add(e);
            Sources<S>& to = e.direct ? near_ : far_;
            (horizon ? to.horizon_patches : to.patches).push_back(moments_of<S>(patch, radiance));
            return;
        }
        // Halve the longer side, both where they are alike, and what is bent.
        const DVec2 sides = rect.sides();
        const bool split_a =
            sides.x > 0.6 * sides.y && !(e.accepted && patch.extent <= kLargestPatch);
        const bool split_b = sides.y > 0.6 * sides.x || !straight;
        const double a = (rect.a0 + rect.a1) / 2, b = (rect.b0 + rect.b1) / 2;
        for (int i = 0; i < (split_a ? 2 : 1); ++i) {
            for (int j = 0; j < (split_b ? 2 : 1); ++j) {
                SourceRect part = rect;
                if (split_a) (i == 0 ? part.a1 : part.a0) = a;
                if (split_b) (j == 0 ? part.b1 : part.b0) = b;
                add_patch_or_parts(make_patch(part), part, radiance, depth + 1);
            }
        }
    }

    const ClusterTree& tree_;
    const Lobe<S>& weight_;
    const S inverse_axis_, inverse_core_, most_core_;
    const int channels_;
    const PrefilterAccuracy& accuracy_;
    S middle_[3] = {};
    S radius_ = 0, half_width_ = 0;
    S inverse_[3] = {};
    bool interpolate_ = false;
    TileEstimate estimate_;
    std::vector<std::uint32_t> stack_, front_;
    Sources<S> near_, far_;
};

}  // namespace envbake::lighting
