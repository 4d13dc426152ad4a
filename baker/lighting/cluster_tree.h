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
    float deviation;   ///< ClusterSpread, of the worst channel
    float offset;      ///< likewise
    float unevenness;  ///< 0: as smooth as a uniform block; 1: nothing is known of the distribution
    std::uint32_t first_child[2];  ///< two runs of children, one a row of blocks
    std::uint16_t child_count[2];  ///< both 0: a base block
};

/// A block of texels.
struct TexelBlock {
    std::int32_t face;  ///< -1: lat-long
    std::int32_t row0, row1, column0, column1;
};

/// Nodes with what belongs to each, index by index.
struct Clusters {
    std::vector<ClusterNode> nodes;
    std::vector<ClusterMoments<float>> moments;
    std::vector<TexelBlock> blocks;
};

/// Moments about the origin, 1, x y z, xx yy zz xy xz yz: of the excess of each channel, and the
/// first four of radiance 1.
struct RawMoments {
    double of[3][10] = {};
    double uniform[4] = {};

    void add(const RawMoments& o) {
        for (int k = 0; k < 3; ++k) {
            for (int j = 0; j < 10; ++j) of[k][j] += o.of[k][j];
        }
        for (int j = 0; j < 4; ++j) uniform[j] += o.uniform[j];
    }
};

/// A block of no more texels than this is opened into them.
inline constexpr int kFewTexels = 16;

/// The inside of a base block, down to blocks of few texels. Node 0 is the block itself.
/// Central moments are made when they are asked for: most never are.
struct OpenedBlock {
    Clusters clusters;
    std::vector<RawMoments> raw;
    std::vector<bool> finished;
};

/// The environment as a hierarchy of nearly square blocks of texels, each with the exact moments of
/// its radiance. What every direction sees, the least radiance of each channel, is taken out first
/// and kept apart: a constant map has nothing left to integrate.
///
/// Lat-long: rows of blocks hold a power of two of them that keeps them square towards the poles. A
/// parent owns runs of blocks in two rows. Cube: a quadtree a face. Base blocks are opened when
/// they are asked for, first into blocks of a few texels: memory does not grow with the map.
///
/// Cost: O(texels), parallel over rows of blocks. Moments are summed in double, in a fixed order.
class ClusterTree {
  public:
    /// `base_extent_rad` is the size of block that the finest kernel asks for; blocks are whole
    /// texels, and not more than 170 rows of them (85 on a cube face) cover the map, however large
    /// it is: 37,000 base blocks, 30 MB with what it takes to build them.
    ClusterTree(const Environment& environment, double base_extent_rad);

    const Clusters& clusters() const { return clusters_; }
    const std::vector<std::uint32_t>& roots() const { return roots_; }
    /// O(texels of the block).
    OpenedBlock open(const TexelBlock& block) const;
    /// Makes node i of an opened block and its moments what they should be.
    void finish(OpenedBlock& opened, std::uint32_t i) const;

    TexelPart texel(const TexelBlock& block, int row, int column) const;
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
    struct Level;
    using Factors = std::array<double, 10>;
    void prepare(const LatLongGrid& grid);
    Level lat_long_base(const LatLongGrid& grid, int rows_per_block) const;
    Level cube_base(const CubeGrid& grid, int texels_per_block) const;
    Level coarser(const Level& fine) const;
    void append(const Level& level, const Level* finer, std::uint32_t finer_first);
    void fill(OpenedBlock& opened, std::size_t slot) const;
    void add_texels(const TexelBlock& block, RawMoments& sum) const;
    ClusterNode make_node(const RawMoments& raw, const SourceRect& rect,
                          ClusterMoments<float>& out) const;
    SourceRect rect_of(const TexelBlock& block) const;

    const Environment* environment_;
    int width_ = 0, height_ = 0;
    DVec3 floor_{0}, ceiling_{0}, mean_excess_{0}, centre_weight_{0};
    DVec3 scale_{1};
    std::vector<ThetaTerms> theta_terms_;  ///< of the rows and columns of a lat-long grid
    std::vector<PhiTerms> phi_terms_;
    /// The moments of a texel are the products of its row's and its column's, one by one.
    std::vector<Factors> row_factors_, column_factors_;
    Clusters clusters_;
    std::vector<std::uint32_t> roots_;
};

}  // namespace envbake::lighting
