// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/prefilter.h"

#include "baker/core/parallel.h"
#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_patch.h"
#include "baker/math/simd.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

namespace envbake::lighting {
namespace {

using std::numbers::pi;

std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}

DVec3 vector(const std::array<double, 3>& w) {
    return {w[0], w[1], w[2]};
}

constexpr int kChebyshev = 8;          // points a side
constexpr int kInterpolatedTile = 16;  // texels a side
constexpr int kDirectTile = 8;
constexpr double kLargestPatch = 0.35;  // radians: larger ones are no parallelograms
constexpr double kLargestBend = 0.35;   // radians, likewise
constexpr int kDeepestSplit = 28;

/// Directions in groups of 16 lanes; what is left of the last group repeats the last direction.
struct Points {
    std::vector<Float16> x, y, z;
    int groups() const { return static_cast<int>(x.size()); }

    explicit Points(const std::vector<DVec3>& directions) {
        const std::size_t groups = (directions.size() + kFloatLanes - 1) / kFloatLanes;
        x.resize(groups);
        y.resize(groups);
        z.resize(groups);
        for (std::size_t i = 0; i < groups * kFloatLanes; ++i) {
            const DVec3& d = directions[std::min(i, directions.size() - 1)];
            const auto lane = static_cast<int>(i % kFloatLanes);
            x[i / kFloatLanes][lane] = static_cast<float>(d.x);
            y[i / kFloatLanes][lane] = static_cast<float>(d.y);
            z[i / kFloatLanes][lane] = static_cast<float>(d.z);
        }
    }
};

/// Sums at points: [channel][group].
struct Sums {
    std::array<std::vector<Float16>, 3> channel;

    explicit Sums(int groups) {
        for (auto& c : channel) c.assign(index(groups), Float16{});
    }
    double at(int k, int point) const {
        return static_cast<double>(
            channel[index(k)][index(point / kFloatLanes)][point % kFloatLanes]);
    }
};

template <class Add>
inline void for_each_group(const Points& points, Sums& sums, const Add& add) {
    for (int g = 0; g < points.groups(); ++g) {
        Float16 sum[3] = {sums.channel[0][index(g)], sums.channel[1][index(g)],
                          sums.channel[2][index(g)]};
        add(points.x[index(g)], points.y[index(g)], points.z[index(g)], sum);
        for (int k = 0; k < 3; ++k) sums.channel[index(k)][index(g)] = sum[k];
    }
}

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

void add_all(const ClusterTree& tree, const GgxWeight<float>& k, const Sources<float>& sources,
             const Points& points, Sums& sums) {
    for (const std::uint32_t i : sources.clusters) {
        const auto& m = tree.moments(i);
        for_each_group(points, sums, [&](const auto& x, const auto& y, const auto& z, Float16* s) {
            add_cluster<false>(k, m, x, y, z, s);
        });
    }
    for (const std::uint32_t i : sources.horizon_clusters) {
        const auto& m = tree.moments(i);
        for_each_group(points, sums, [&](const auto& x, const auto& y, const auto& z, Float16* s) {
            add_cluster<true>(k, m, x, y, z, s);
        });
    }
    for (const auto& m : sources.patches) {
        for_each_group(points, sums, [&](const auto& x, const auto& y, const auto& z, Float16* s) {
            add_patch<false>(k, m, x, y, z, s);
        });
    }
    for (const auto& m : sources.horizon_patches) {
        for_each_group(points, sums, [&](const auto& x, const auto& y, const auto& z, Float16* s) {
            add_patch<true>(k, m, x, y, z, s);
        });
    }
}

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
struct Estimate {
    double core;           ///< share times (extent / l)^6
    double curvature;      ///< of the Taylor series
    double kink;           ///< of the horizon across it
    double interpolation;  ///< within the tile, where it is interpolated
    bool accepted;
    bool direct;  ///< too sharp to be interpolated
};

/// Smooth content errs with one sign, so those are summed; the others err either way.
struct TileEstimate {
    double core = 0, curvature = 0, kink2 = 0, interpolation2 = 0;

    void add(const Estimate& e) {
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
    }
    /// Calibrated against brute force, factor by factor, on photographs, synthetic skies and noise.
    double error() const {
        return 0.06 * core + 0.15 * curvature + 0.3 * std::sqrt(kink2) +
               0.02 * std::sqrt(interpolation2);
    }
};

/// One walk of the tree for a tile (or, with radius 0, for one direction).
template <class S>
class Walk {
  public:
    Walk(const ClusterTree& tree, const GgxWeight<double>& weight,
         const PrefilterAccuracy& accuracy)
        : tree_(tree), weight_(weight), accuracy_(accuracy) {}

    void begin(const DVec3& middle, double radius, double half_width) {
        for (int i = 0; i < 3; ++i) middle_[i] = static_cast<S>(middle[i]);
        radius_ = static_cast<S>(radius);
        half_width_ = static_cast<S>(half_width);
        estimate_ = {};
        near_.clear();
        far_.clear();
    }

    /// The coarse front: blocks no larger than their distance, or than the lobe.
    const std::vector<std::uint32_t>& front() {
        front_.clear();
        stack_ = tree_.roots();
        const S lobe2 = static_cast<S>(2 * weight_.A / std::max(weight_.b, 1e-3));
        while (!stack_.empty()) {
            const std::uint32_t i = stack_.back();
            stack_.pop_back();
            const ClusterNode& n = tree_.node(i);
            if (n.flux[0] + n.flux[1] + n.flux[2] <= 0) continue;
            const S near = nearest(n.centre);
            const S along = cosine(n.centre);
            if (along < -(radius_ + S(n.radius))) continue;
            if (S(n.extent) * S(n.extent) <= lobe2 + near * near || is_base(n)) {
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
    /// the tile receives, times scale(): floor and norm included.
    void refine(const DVec3& darkest, bool interpolate) {
        const DVec3 mean = tree_.mean();
        for (int k = 0; k < 3; ++k) {
            const double against = 0.8 * darkest[k] + 1e-3 * mean[k];
            inverse_[k] = static_cast<S>(against > 0 ? weight_.inverse_norm / against : 0.0);
        }
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
            const Estimate e = estimate<true>(nearest(n.centre), n.flux, S(n.variance), S(n.extent),
                                              S(n.unevenness), horizon);
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

    const Sources<S>& near_sources() const { return near_; }
    const Sources<S>& far_sources() const { return far_; }
    TileEstimate estimated() const { return estimate_; }

  private:
    static bool is_base(const ClusterNode& n) { return n.child_count[0] + n.child_count[1] == 0; }

    void push_children(const ClusterNode& n) {
        for (int run = 0; run < 2; ++run) {
            for (std::uint32_t j = 0; j < n.child_count[run]; ++j) {
                stack_.push_back(n.first_child[run] + j);
            }
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

    /// What one source's Taylor series leaves out, relative to the darkest point of the tile, with
    /// l^2 = 2 A / b + distance^2 and y = b t = 2 / l^2 at the nearest point: third order where the
    /// source is uneven, and some of the fourth; at the horizon the kink of max(0, mu). The factors
    /// are calibrated against brute force, not proved.
    template <bool kCluster, class T>
    Estimate estimate(S near, const T* flux, S variance, S extent, S unevenness,
                      bool horizon) const {
        const S share = std::max(
            {S(flux[0]) * inverse_[0], S(flux[1]) * inverse_[1], S(flux[2]) * inverse_[2]});
        const S A = S(weight_.A), b = S(weight_.b);
        const S t = 1 / (A + b * near * near / 2);
        const S w = share * t * t;
        const S inverse_l2 = b * t / 2;
        const S inverse_l = std::sqrt(inverse_l2);
        const S extent2 = extent * extent * inverse_l2;  // (extent / l)^2
        const S curvature =
            w * variance * inverse_l2 *
            (S(0.5) * (S(0.1) + unevenness) * extent * (inverse_l + S(0.5)) + S(0.5) * extent2);
        const S t_horizon = 1 / (A + b);
        const S w_horizon = share * t_horizon * t_horizon;
        S kink = 0;
        if (horizon) {
            kink = kCluster ? S(0.15) * std::sqrt(3 * variance) * w_horizon
                            : S(0.1) * extent * extent * w_horizon;
        }
        // The sources of the lobe's core are many and err alike: no share of theirs is small
        // enough, so their extent has a limit of its own.
        const bool accepted = !(curvature > S(accuracy_.cluster)) &&
                              !(kink > S(accuracy_.horizon)) && !(extent2 > S(accuracy_.extent2));
        S missed = 0;
        if (accepted && interpolate_) {
            // A kink is interpolated to half_width / (2 n); a pole at distance l to 4 n rho^-n.
            if (horizon) missed = 5 * w_horizon * half_width_ / kChebyshev;
            const S x = inverse_l > 0 ? 1 / (inverse_l * half_width_) : S(1e3);
            const S rho = x + std::sqrt(1 + x * x);
            const S rho2 = rho * rho, rho4 = rho2 * rho2;
            missed = std::max(missed, w * 4 * kChebyshev / (rho4 * rho4));
        }
        return {.core = static_cast<double>(w * extent2 * extent2 * extent2),
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
        const Estimate e = estimate<false>(nearest(&c.x), &flux.x, S(patch.variance),
                                           S(patch.extent), S(std::min(1.0, patch.taper)), horizon);
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
    const GgxWeight<double>& weight_;
    const PrefilterAccuracy& accuracy_;
    S middle_[3] = {};
    S radius_ = 0, half_width_ = 0;
    S inverse_[3] = {};
    bool interpolate_ = false;
    TileEstimate estimate_;
    std::vector<std::uint32_t> stack_, front_;
    Sources<S> near_, far_;
};

/// Lagrange interpolation from Chebyshev points to `count` evenly spaced ones on [-1, 1]: [b][j].
struct Interpolation {
    std::array<double, kChebyshev> nodes;
    std::array<std::array<double, kInterpolatedTile>, kChebyshev> weights{};

    explicit Interpolation(int count) {
        for (int b = 0; b < kChebyshev; ++b) {
            nodes[index(b)] = -std::cos(pi * (b + 0.5) / kChebyshev);
        }
        for (int j = 0; j < count; ++j) {
            const double x = count > 1 ? -1 + 2.0 * j / (count - 1) : 0.0;
            for (int b = 0; b < kChebyshev; ++b) {
                double w = 1;
                for (int o = 0; o < kChebyshev; ++o) {
                    if (o != b) {
                        w *= (x - nodes[index(o)]) / (nodes[index(b)] - nodes[index(o)]);
                    }
                }
                weights[index(b)][index(j)] = w;
            }
        }
    }
};

struct Tile {
    cube::Face face;
    int row, column;    // first texel
    int rows, columns;  // texels
};

/// Face coordinate of the centre of texel i, which may lie between texels.
double centre_of(double i, int face_size) {
    return (2 * i + 1) / face_size - 1;
}

class Prefilter {
  public:
    Prefilter(const ClusterTree& tree, double alpha, int face_size,
              const PrefilterAccuracy& accuracy)
        : tree_(tree),
          weight_(GgxWeight<double>::of(alpha)),
          weight_f_(GgxWeight<float>::of(alpha)),
          face_size_(face_size),
          accuracy_(accuracy) {
        const double texel = pi / 2 / face_size;
        const double lobe = std::sqrt(2 * weight_.A / std::max(weight_.b, 1e-3));
        single_ = lobe < texel;
        interpolate_ = !single_ && lobe < 0.8 && face_size >= 2 * kInterpolatedTile &&
                       kInterpolatedTile * texel <= 1.6 * lobe;
        tile_ = interpolate_ ? kInterpolatedTile : kDirectTile;
        if (!interpolate_) {
            while (tile_ > 1 && (tile_ * texel > std::min(1.6 * lobe, 0.6))) tile_ /= 2;
        }
    }

    Prefiltered run(Progress& progress) {
        const int across = (face_size_ + tile_ - 1) / tile_;
        const std::size_t tiles = index(cube::kFaceCount) * index(across) * index(across);
        Prefiltered result;
        result.texels.resize(index(cube::kFaceCount) * index(face_size_) * index(face_size_));
        std::vector<TileEstimate> sums(tiles);
        parallel_for(tiles, [&](std::size_t i) {
            const int in_face = static_cast<int>(i % (index(across) * index(across)));
            Tile tile{static_cast<cube::Face>(i / (index(across) * index(across))),
                      in_face / across * tile_, in_face % across * tile_, 0, 0};
            tile.rows = std::min(tile_, face_size_ - tile.row);
            tile.columns = std::min(tile_, face_size_ - tile.column);
            sums[i] = single_ ? bake_singly(tile, result.texels) : bake(tile, result.texels);
            progress.add(index(tile.rows) * index(tile.columns));
        });
        for (const TileEstimate& s : sums) {
            result.error_estimate = std::max(result.error_estimate, s.error());
        }
        return result;
    }

  private:
    DVec3 direction(const Tile& tile, double row, double column) const {
        return vector(cube::direction(tile.face, centre_of(tile.column + column, face_size_),
                                      centre_of(tile.row + row, face_size_)));
    }

    /// A grid of rows x columns points over the centres of a tile's texels.
    std::vector<DVec3> grid(const Tile& tile, int rows, int columns) const {
        const auto at = [](int i, int count, int texels) {
            return count > 1 ? (texels - 1.0) * i / (count - 1) : (texels - 1.0) / 2;
        };
        std::vector<DVec3> points;
        for (int r = 0; r < rows; ++r) {
            for (int c = 0; c < columns; ++c) {
                points.push_back(
                    direction(tile, at(r, rows, tile.rows), at(c, columns, tile.columns)));
            }
        }
        return points;
    }

    void write(const Tile& tile, int row, int column, const DVec3& sum,
               std::vector<Vec3>& texels) const {
        const DVec3 value = glm::clamp(tree_.floor() + sum * (weight_.inverse_norm / tree_.scale()),
                                       tree_.floor(), tree_.ceiling());
        const std::size_t n = index(face_size_);
        texels[(index(static_cast<int>(tile.face)) * n + index(tile.row + row)) * n +
               index(tile.column + column)] = Vec3(value);
    }

    DVec3 received(const DVec3& sum) const {
        return tree_.floor() * tree_.scale() + glm::max(sum, DVec3{0}) * weight_.inverse_norm;
    }

    TileEstimate bake(const Tile& tile, std::vector<Vec3>& texels) const {
        const DVec3 middle =
            glm::normalize(direction(tile, (tile.rows - 1) / 2.0, (tile.columns - 1) / 2.0));
        double radius = 0;
        for (const DVec3& d : grid(tile, 2, 2)) radius = std::max(radius, glm::length(d - middle));

        Walk<float> walk(tree_, weight_, accuracy_);
        walk.begin(middle, radius, radius / std::numbers::sqrt2);
        const Points coarse_points(grid(tile, 4, 4));
        Sums coarse(1);
        for (const std::uint32_t i : walk.front()) {
            const auto& n = tree_.node(i);
            const auto& m = tree_.moments(i);
            const bool horizon = walk.straddles(n.centre, static_cast<double>(n.radius));
            for_each_group(coarse_points, coarse,
                           [&](const auto& x, const auto& y, const auto& z, Float16* s) {
                               if (horizon) {
                                   add_cluster<true>(weight_f_, m, x, y, z, s);
                               } else {
                                   add_cluster<false>(weight_f_, m, x, y, z, s);
                               }
                           });
        }
        DVec3 darkest(std::numeric_limits<double>::max());
        for (int p = 0; p < kFloatLanes; ++p) {
            darkest =
                glm::min(darkest, received({coarse.at(0, p), coarse.at(1, p), coarse.at(2, p)}));
        }
        walk.refine(darkest, interpolate_);

        const Points points(grid(tile, tile.rows, tile.columns));
        Sums sums(points.groups());
        add_all(tree_, weight_f_, walk.near_sources(), points, sums);
        if (interpolate_) {
            add_interpolated(tile, walk.far_sources(), sums);
        } else {
            add_all(tree_, weight_f_, walk.far_sources(), points, sums);
        }
        for (int r = 0; r < tile.rows; ++r) {
            for (int c = 0; c < tile.columns; ++c) {
                const int p = r * tile.columns + c;
                write(tile, r, c, {sums.at(0, p), sums.at(1, p), sums.at(2, p)}, texels);
            }
        }
        return walk.estimated();
    }

    void add_interpolated(const Tile& tile, const Sources<float>& sources, Sums& sums) const {
        const Interpolation down(tile.rows), across(tile.columns);
        std::vector<DVec3> directions;
        for (int a = 0; a < kChebyshev; ++a) {
            for (int b = 0; b < kChebyshev; ++b) {
                directions.push_back(
                    direction(tile, (1 + down.nodes[index(a)]) / 2 * (tile.rows - 1),
                              (1 + across.nodes[index(b)]) / 2 * (tile.columns - 1)));
            }
        }
        const Points points(directions);
        Sums at_points(points.groups());
        add_all(tree_, weight_f_, sources, points, at_points);
        for (int k = 0; k < 3; ++k) {
            std::array<std::array<double, kInterpolatedTile>, kChebyshev> lines{};
            for (int a = 0; a < kChebyshev; ++a) {
                for (int b = 0; b < kChebyshev; ++b) {
                    const double v = at_points.at(k, a * kChebyshev + b);
                    for (int j = 0; j < kInterpolatedTile; ++j) {
                        lines[index(a)][index(j)] += v * across.weights[index(b)][index(j)];
                    }
                }
            }
            for (int i = 0; i < tile.rows; ++i) {
                for (int j = 0; j < tile.columns; ++j) {
                    double v = 0;
                    for (int a = 0; a < kChebyshev; ++a) {
                        v += down.weights[index(a)][index(i)] * lines[index(a)][index(j)];
                    }
                    const int p = i * tile.columns + j;
                    sums.channel[index(k)][index(p / kFloatLanes)][p % kFloatLanes] +=
                        static_cast<float>(v);
                }
            }
        }
    }

    /// Lobes narrower than an output texel: neighbours share nothing, and float has too few digits.
    TileEstimate bake_singly(const Tile& tile, std::vector<Vec3>& texels) const {
        Walk<double> walk(tree_, weight_, accuracy_);
        TileEstimate worst;
        for (int r = 0; r < tile.rows; ++r) {
            for (int c = 0; c < tile.columns; ++c) {
                const DVec3 d = direction(tile, r, c);
                walk.begin(d, 0, 0);
                DVec3 coarse{0};
                for (const std::uint32_t i : walk.front()) add(i, d, &coarse.x);
                walk.refine(received(coarse), false);
                DVec3 sum{0};
                const Sources<double>& sources = walk.far_sources();
                for (const std::uint32_t i : sources.clusters) add(i, d, &sum.x);
                for (const std::uint32_t i : sources.horizon_clusters) add(i, d, &sum.x);
                for (const auto& m : sources.patches) {
                    add_patch<false>(weight_, m, d.x, d.y, d.z, &sum.x);
                }
                for (const auto& m : sources.horizon_patches) {
                    add_patch<true>(weight_, m, d.x, d.y, d.z, &sum.x);
                }
                write(tile, r, c, sum, texels);
                worst.keep_largest(walk.estimated());
            }
        }
        return worst;
    }

    void add(std::uint32_t i, const DVec3& d, double* sum) const {
        const ClusterMoments<float>& f = tree_.moments(i);
        ClusterMoments<double> m;
        for (int a = 0; a < 3; ++a) {
            m.centre[a] = static_cast<double>(f.centre[a]);
            m.flux[a] = static_cast<double>(f.flux[a]);
            for (int b = 0; b < 3; ++b) m.first[a][b] = static_cast<double>(f.first[a][b]);
            for (int b = 0; b < 6; ++b) m.second[a][b] = static_cast<double>(f.second[a][b]);
        }
        m.variance = static_cast<double>(f.variance);
        add_cluster<true>(weight_, m, d.x, d.y, d.z, sum);
    }

    const ClusterTree& tree_;
    GgxWeight<double> weight_;
    GgxWeight<float> weight_f_;
    int face_size_;
    PrefilterAccuracy accuracy_;
    bool single_ = false, interpolate_ = false;
    int tile_ = 1;
};

}  // namespace

double base_extent_for(double alpha) {
    return std::clamp(0.4 * alpha, 1e-6, 0.1);
}

Prefiltered prefilter_ggx(const ClusterTree& tree, double alpha, int face_size,
                          const PrefilterAccuracy& accuracy, Progress& progress) {
    return Prefilter(tree, alpha, face_size, accuracy).run(progress);
}

}  // namespace envbake::lighting
