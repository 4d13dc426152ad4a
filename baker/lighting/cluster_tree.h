// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/lighting/prefilter_kernel.h"
#include "baker/lighting/source_patch.h"
#include "baker/math/vector.h"

#include <array>
#include <cstdint>
#include <vector>

namespace envbake::lighting {

/// What the traversal looks at; the moments lie apart.
struct ClusterNode {
    float centre[3];
    float variance;
    float flux[3];
    float extent;      ///< longest side of the block, radians
    float radius;      ///< every direction of the block is within this of the centre (chord)
    float unevenness;  ///< 0: as smooth as a uniform block; 1: nothing is known of the distribution
    std::uint32_t first_child[2];  ///< two runs of children, one a row of blocks
    std::uint16_t child_count[2];  ///< both 0: a base block, to be opened into texels
    std::uint32_t block;           ///< index into blocks(), for base blocks
};

/// A block of texels.
struct TexelBlock {
    std::int32_t face;  ///< -1: lat-long
    std::int32_t row0, row1, column0, column1;
};

/// The environment as a hierarchy of nearly square blocks of texels, each with the exact moments of
/// its radiance. What every direction sees, the least radiance of each channel, is taken out first
/// and kept apart: a constant map has nothing left to integrate.
///
/// Lat-long: rows of blocks hold a power of two of them that keeps them square towards the poles. A
/// parent owns runs of blocks in two rows. Cube: a quadtree a face.
///
/// Cost: O(texels), parallel over rows of blocks. Moments are summed in double, in a fixed order.
class ClusterTree {
  public:
    /// `base_extent_rad` is the size of block that the finest kernel asks for; blocks are whole
    /// texels, and not more than 170 rows of them (85 on a cube face) cover the map, however large
    /// it is: 37,000 base blocks, 30 MB with what it takes to build them.
    ClusterTree(const Environment& environment, double base_extent_rad);

    const std::vector<std::uint32_t>& roots() const { return roots_; }
    const ClusterNode& node(std::uint32_t i) const { return nodes_[i]; }
    const ClusterMoments<float>& moments(std::uint32_t i) const { return moments_[i]; }
    const TexelBlock& block(std::uint32_t i) const { return blocks_[i]; }

    SourceRect texel_rect(const TexelBlock& block, int row, int column) const;
    SourcePatch texel_patch(const TexelBlock& block, int row, int column) const;
    /// Radiance over the floor, times scale().
    DVec3 excess(const TexelBlock& block, int row, int column) const;

    /// Radiance = floor + excess / scale, by channel. scale is a power of two, excess at most 1.
    const DVec3& floor() const { return floor_; }
    const DVec3& ceiling() const { return ceiling_; }
    const DVec3& scale() const { return scale_; }
    /// Average over the sphere of excess and of radiance, both times scale().
    const DVec3& mean_excess() const { return mean_excess_; }
    DVec3 mean() const { return mean_excess_ + floor_ * scale_; }

  private:
    struct Raw;
    struct Level;
    Level lat_long_base(const LatLongGrid& grid, int rows_per_block);
    Level cube_base(const CubeGrid& grid, int texels_per_block);
    Level coarser(const Level& fine) const;
    void append(const Level& level, const Level* finer, std::uint32_t finer_first);
    ClusterNode finish(const Raw& raw, const SourceRect& rect, ClusterMoments<float>& out) const;
    SourceRect rect_of(const TexelBlock& block) const;

    const Environment* environment_;
    int width_ = 0, height_ = 0;
    DVec3 floor_{0}, ceiling_{0}, mean_excess_{0}, centre_weight_{0};
    DVec3 scale_{1};
    std::vector<ThetaTerms> theta_terms_;  ///< of the rows and columns of a lat-long grid
    std::vector<PhiTerms> phi_terms_;
    std::vector<ClusterNode> nodes_;
    std::vector<ClusterMoments<float>> moments_;
    std::vector<TexelBlock> blocks_;
    std::vector<std::uint32_t> roots_;
};

}  // namespace envbake::lighting
