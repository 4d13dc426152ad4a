// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/cluster_tree.h"

#include "baker/core/parallel.h"
#include "baker/math/simd.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <bit>
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

/// Where block i of `count` begins among `total` texels; runs nest when count doubles.
int block_begin(int i, int count, int total) {
    return static_cast<int>(static_cast<std::int64_t>(i) * total / count);
}

int nearest_power_of_two(double x) {
    return 1 << std::max(0, static_cast<int>(std::lround(std::log2(x))));
}

int floor_power_of_two(int x) {
    return static_cast<int>(std::bit_floor(static_cast<unsigned>(x)));
}

}  // namespace

/// One level of blocks, in rows of `count` blocks each.
struct ClusterTree::Level {
    struct Row {
        std::size_t first;
        int count;
        int face, row0, row1;
        int child_row[2];  ///< in the finer level; -1: none
    };
    std::vector<Row> rows;
    std::vector<RawMoments> raw;
    std::vector<TexelBlock> blocks;
};

ClusterTree::ClusterTree(const Environment& environment, double base_extent_rad)
    : environment_(&environment) {
    const auto* lat_long = std::get_if<LatLongGrid>(&environment.grid);
    const auto* cube = std::get_if<CubeGrid>(&environment.grid);
    width_ = lat_long ? lat_long->width : cube->size;
    height_ = lat_long ? lat_long->height : cube->size;

    Vec3 low = environment.radiance[0], high = low;
    for (const Vec3& L : environment.radiance) {
        low = glm::min(low, L);
        high = glm::max(high, L);
    }
    floor_ = DVec3(low);
    ceiling_ = DVec3(high);
    for (int k = 0; k < 3; ++k) {
        const double peak = ceiling_[k] - floor_[k];
        scale_[k] = peak > 0 ? std::ldexp(1.0, -(std::ilogb(peak) + 1)) : 1.0;
    }

    // Blocks of about the asked extent, but no more than 170 rows of them: 30 MB, what it takes to
    // build them included. What needs finer is opened into texels.
    const double texel_extent = (lat_long ? pi : pi / 2) / height_;
    const int limit = lat_long ? 170 : 85;
    const int least = (height_ + limit - 1) / limit;
    const int asked = static_cast<int>(std::min(base_extent_rad / texel_extent + 0.5, 1e6));
    const int texels_per_block = std::clamp(std::max(asked, least), 1, height_);

    if (lat_long) prepare(*lat_long);
    std::vector<Level> levels;
    levels.push_back(lat_long ? lat_long_base(*lat_long, texels_per_block)
                              : cube_base(*cube, texels_per_block));
    const std::size_t few = lat_long ? 4 : 2 * cube::kFaceCount;
    while (levels.back().rows.size() > few) levels.push_back(coarser(levels.back()));

    DVec3 flux{0};
    DVec3 weight{0};
    for (const RawMoments& raw : levels.back().raw) {
        flux += DVec3{raw.of[0][0], raw.of[1][0], raw.of[2][0]};
    }
    for (int k = 0; k < 3; ++k) weight[k] = flux[k] > 0 ? 1 / flux[k] : 0;
    mean_excess_ = flux / (4 * pi);
    centre_weight_ = weight;

    std::uint32_t first = 0, finer_first = 0;
    for (std::size_t i = 0; i < levels.size(); ++i) {
        finer_first = first;
        first = static_cast<std::uint32_t>(clusters_.nodes.size());
        append(levels[i], i > 0 ? &levels[i - 1] : nullptr, finer_first);
    }
    for (std::uint32_t i = first; i < clusters_.nodes.size(); ++i) roots_.push_back(i);
}

/// Everything separates into factors of the row and of the column.
void ClusterTree::prepare(const LatLongGrid& grid) {
    for (int r = 0; r < height_; ++r) {
        const double t0 = grid.theta_edges[index(r)], t1 = grid.theta_edges[index(r + 1)];
        theta_terms_.push_back(theta_terms(t0, t1));
        const ThetaTerms& t = theta_terms_.back();
        const double sin_two_half = 2 * t.sin_half * t.cos_half;
        const double c0 = std::cos(t0), c1 = std::cos(t1), s0 = std::sin(t0), s1 = std::sin(t1);
        // Integrals of sin, sin^2, sin cos, sin^3, sin^2 cos.
        const double s = t.integral;
        const double ss = t.sine * t.sine * sin_two_half + (t.half - sin_two_half / 2);
        const double sc = t.sine * t.cosine * sin_two_half;
        // (cos^3 / 3 - cos) and sin^3 / 3 between the edges, their difference as a factor.
        const double sss = s * (1 - (c0 * c0 + c0 * c1 + c1 * c1) / 3);
        const double ssc = (s1 - s0) * (s0 * s0 + s0 * s1 + s1 * s1) / 3;
        row_factors_.push_back({s, ss, sc, ss, sss, s - sss, sss, ssc, sss, ssc});
    }
    for (int c = 0; c < width_; ++c) {
        phi_terms_.push_back(phi_terms(grid.phi_edges[index(c)], grid.phi_edges[index(c + 1)]));
        const PhiTerms& p = phi_terms_.back();
        const double sin_two_half = 2 * p.sin_half * p.cos_half;
        const double cos_two = p.cosine * p.cosine - p.sine * p.sine;
        // Integrals of 1, cos, sin, cos^2, sin^2, sin cos.
        const double one = 2 * p.half, c1 = 2 * p.sin_half * p.cosine, s1 = 2 * p.sin_half * p.sine;
        const double cc = p.half + sin_two_half * cos_two / 2;
        const double ss = p.half - sin_two_half * cos_two / 2;
        const double sc = sin_two_half * p.sine * p.cosine;
        column_factors_.push_back({one, c1, one, s1, cc, one, ss, c1, sc, s1});
    }
}

ClusterTree::Level ClusterTree::lat_long_base(const LatLongGrid& grid, int rows_per_block) const {
    Level level;
    const int most = floor_power_of_two(width_);
    for (int row0 = 0; row0 < height_; row0 += rows_per_block) {
        const int row1 = std::min(row0 + rows_per_block, height_);
        const double theta0 = grid.theta_edges[index(row0)], theta1 = grid.theta_edges[index(row1)];
        const double around = 2 * pi * std::sin((theta0 + theta1) / 2) / (theta1 - theta0);
        const int count = std::min(std::max(4, nearest_power_of_two(std::max(around, 1.0))), most);
        level.rows.push_back({level.blocks.size(), count, -1, row0, row1, {-1, -1}});
        for (int i = 0; i < count; ++i) {
            level.blocks.push_back(
                {-1, row0, row1, block_begin(i, count, width_), block_begin(i + 1, count, width_)});
        }
    }
    level.raw.resize(level.blocks.size());

    parallel_for(level.rows.size(), [&](std::size_t at) {
        const Level::Row& run = level.rows[at];
        constexpr int kSums = 5;
        const int stride = (width_ + kDoubleLanes - 1) / kDoubleLanes * kDoubleLanes;
        std::vector<double> sums(index(3 * kSums * stride), 0.0), row(index(stride), 0.0);
        double uniform[3] = {};  // of 1, sin, cos over the rows
        for (int r = run.row0; r < run.row1; ++r) {
            const Factors& of = row_factors_[index(r)];
            const double weights[kSums] = {of[0], of[1], of[2], of[4], of[7]};
            for (int j = 0; j < 3; ++j) uniform[j] += weights[j];
            const Vec3* texels = environment_->radiance.data() + index(r) * index(width_);
            for (int k = 0; k < 3; ++k) {
                for (int i = 0; i < width_; ++i) {
                    row[index(i)] = (static_cast<double>(texels[i][k]) - floor_[k]) * scale_[k];
                }
                double* out = sums.data() + k * kSums * stride;
                for (int i = 0; i < stride; i += kDoubleLanes) {
                    const auto L = load<Double8>(row.data() + i);
                    for (int j = 0; j < kSums; ++j) {
                        double* at_sum = out + j * stride + i;
                        store(load<Double8>(at_sum) + weights[j] * L, at_sum);
                    }
                }
            }
        }
        for (int b = 0; b < run.count; ++b) {
            const std::size_t slot = run.first + index(b);
            const TexelBlock& block = level.blocks[slot];
            RawMoments& raw = level.raw[slot];
            for (int i = block.column0; i < block.column1; ++i) {
                const Factors& p = column_factors_[index(i)];
                for (std::size_t j = 0; j < 4; ++j)
                    raw.uniform[j] += uniform[j == 3 ? 1 : j] * p[j];
                for (int k = 0; k < 3; ++k) {
                    const double* in = sums.data() + k * kSums * stride + i;
                    const double s = in[0], ss = in[stride], sc = in[2 * stride],
                                 sss = in[3 * stride], ssc = in[4 * stride];
                    const Factors t{s, ss, sc, ss, sss, s - sss, sss, ssc, sss, ssc};
                    for (std::size_t j = 0; j < t.size(); ++j) raw.of[k][j] += t[j] * p[j];
                }
            }
        }
    });
    return level;
}

ClusterTree::Level ClusterTree::cube_base(const CubeGrid& grid, int texels_per_block) const {
    Level level;
    const int count =
        std::clamp(nearest_power_of_two(static_cast<double>(grid.size) / texels_per_block), 1,
                   floor_power_of_two(grid.size));
    for (int face = 0; face < cube::kFaceCount; ++face) {
        for (int j = 0; j < count; ++j) {
            const int row0 = block_begin(j, count, grid.size);
            const int row1 = block_begin(j + 1, count, grid.size);
            level.rows.push_back({level.blocks.size(), count, face, row0, row1, {-1, -1}});
            for (int i = 0; i < count; ++i) {
                level.blocks.push_back({face, row0, row1, block_begin(i, count, grid.size),
                                        block_begin(i + 1, count, grid.size)});
            }
        }
    }
    level.raw.resize(level.blocks.size());

    parallel_for(level.rows.size(), [&](std::size_t at) {
        const Level::Row& run = level.rows[at];
        for (int b = 0; b < run.count; ++b) {
            const TexelBlock& block = level.blocks[run.first + index(b)];
            add_texels(block, level.raw[run.first + index(b)]);
        }
    });
    return level;
}

ClusterTree::Level ClusterTree::coarser(const Level& fine) const {
    Level level;
    const auto* lat_long = std::get_if<LatLongGrid>(&environment_->grid);
    for (std::size_t r = 0; r < fine.rows.size();) {
        const Level::Row& upper = fine.rows[r];
        const bool paired = r + 1 < fine.rows.size() && fine.rows[r + 1].face == upper.face;
        const Level::Row& lower = fine.rows[paired ? r + 1 : r];
        int count = std::min(upper.count, lower.count);
        if (lat_long) {
            const double theta0 = lat_long->theta_edges[index(upper.row0)];
            const double theta1 = lat_long->theta_edges[index(lower.row1)];
            const double around = 2 * pi * std::sin((theta0 + theta1) / 2) / (theta1 - theta0);
            count = std::min(count, std::max(4, nearest_power_of_two(std::max(around, 1.0))));
        } else if (paired) {
            count = std::max(1, count / 2);
        }
        Level::Row row{
            level.blocks.size(), count,
            upper.face,          upper.row0,
            lower.row1,          {static_cast<int>(r), paired ? static_cast<int>(r + 1) : -1}};
        for (int i = 0; i < count; ++i) {
            RawMoments sum;
            for (const int child_row : row.child_row) {
                if (child_row < 0) continue;
                const Level::Row& child = fine.rows[index(child_row)];
                const int each = child.count / count;
                for (int j = 0; j < each; ++j) {
                    sum.add(fine.raw[child.first + index(i * each + j)]);
                }
            }
            level.raw.push_back(sum);
            level.blocks.push_back({upper.face, upper.row0, lower.row1,
                                    block_begin(i, count, width_),
                                    block_begin(i + 1, count, width_)});
        }
        level.rows.push_back(row);
        r += paired ? 2 : 1;
    }
    return level;
}

void ClusterTree::append(const Level& level, const Level* finer, std::uint32_t finer_first) {
    const std::size_t first = clusters_.nodes.size();
    clusters_.nodes.resize(first + level.raw.size());
    clusters_.moments.resize(clusters_.nodes.size());
    clusters_.blocks.insert(clusters_.blocks.end(), level.blocks.begin(), level.blocks.end());
    parallel_for(level.rows.size(), [&](std::size_t at) {
        const Level::Row& row = level.rows[at];
        for (int i = 0; i < row.count; ++i) {
            const std::size_t slot = row.first + index(i);
            ClusterNode node = make_node(level.raw[slot], rect_of(level.blocks[slot]),
                                         clusters_.moments[first + slot]);
            for (int k = 0; k < 2; ++k) {
                node.first_child[k] = 0;
                node.child_count[k] = 0;
                if (!finer || row.child_row[k] < 0) continue;
                const Level::Row& child = finer->rows[index(row.child_row[k])];
                const int each = child.count / row.count;
                node.child_count[k] = static_cast<std::uint16_t>(each);
                node.first_child[k] =
                    finer_first + static_cast<std::uint32_t>(child.first + index(i * each));
            }
            clusters_.nodes[first + slot] = node;
        }
    });
}

OpenedBlock ClusterTree::open(const TexelBlock& block) const {
    OpenedBlock opened;
    const std::size_t texels =
        index(block.row1 - block.row0) * index(block.column1 - block.column0);
    const std::size_t most = texels / 2 + 1;  // no part has fewer than 4 texels
    opened.clusters.blocks.reserve(most);
    opened.clusters.nodes.reserve(most);
    opened.raw.reserve(most);
    opened.clusters.blocks = {block};
    opened.clusters.nodes.resize(1);
    opened.raw.resize(1);
    fill(opened, 0);
    opened.clusters.moments.resize(opened.raw.size());
    opened.finished.resize(opened.raw.size());
    return opened;
}

/// The moments about the origin of node `slot`, and of all below it.
void ClusterTree::fill(OpenedBlock& opened, std::size_t slot) const {
    std::vector<TexelBlock>& blocks = opened.clusters.blocks;
    const TexelBlock block = blocks[slot];
    const int rows = block.row1 - block.row0, columns = block.column1 - block.column0;
    if (rows * columns <= kFewTexels) return add_texels(block, opened.raw[slot]);

    const DVec2 sides = rect_of(block).sides();
    const bool split_rows = rows > 1 && (sides.x > 0.6 * sides.y || columns == 1);
    const bool split_columns = columns > 1 && (sides.y > 0.6 * sides.x || rows == 1);
    const std::size_t first = blocks.size();
    for (int i = 0; i < (split_rows ? 2 : 1); ++i) {
        for (int j = 0; j < (split_columns ? 2 : 1); ++j) {
            TexelBlock part = block;
            if (split_rows) (i == 0 ? part.row1 : part.row0) = block.row0 + rows / 2;
            if (split_columns) (j == 0 ? part.column1 : part.column0) = block.column0 + columns / 2;
            blocks.push_back(part);
        }
    }
    const std::size_t end = blocks.size();
    opened.clusters.nodes.resize(end);
    opened.raw.resize(end);
    opened.clusters.nodes[slot].first_child[0] = static_cast<std::uint32_t>(first);
    opened.clusters.nodes[slot].child_count[0] = static_cast<std::uint16_t>(end - first);
    for (std::size_t i = first; i < end; ++i) {
        fill(opened, i);
        opened.raw[slot].add(opened.raw[i]);
    }
}

void ClusterTree::finish(OpenedBlock& opened, std::uint32_t i) const {
    if (opened.finished[i]) return;
    opened.finished[i] = true;
    ClusterNode& node = opened.clusters.nodes[i];
    const ClusterNode made =
        make_node(opened.raw[i], rect_of(opened.clusters.blocks[i]), opened.clusters.moments[i]);
    const ClusterNode links = node;
    node = made;
    node.first_child[0] = links.first_child[0];
    node.child_count[0] = links.child_count[0];
}

void ClusterTree::add_texels(const TexelBlock& block, RawMoments& sum) const {
    for (int r = block.row0; r < block.row1; ++r) {
        for (int c = block.column0; c < block.column1; ++c) {
            Factors of;
            if (block.face < 0) {
                const Factors &t = row_factors_[index(r)], &p = column_factors_[index(c)];
                for (std::size_t j = 0; j < of.size(); ++j) of[j] = t[j] * p[j];
            } else {
                // E[w w^T] of the parallelogram, about its exact centre.
                const SourcePatch patch = make_patch(rect_of({block.face, r, r + 1, c, c + 1}));
                const DVec3 &m = patch.centre, &a = patch.half_a, &b = patch.half_b;
                const auto product = [&](int i, int j) {
                    return m[i] * m[j] + (a[i] * a[j] + b[i] * b[j]) / 3;
                };
                of = {1,
                      m.x,
                      m.y,
                      m.z,
                      product(0, 0),
                      product(1, 1),
                      product(2, 2),
                      product(0, 1),
                      product(0, 2),
                      product(1, 2)};
                for (double& moment : of) moment *= patch.omega;
            }
            const DVec3 L = excess(block, r, c);
            for (int k = 0; k < 3; ++k) {
                for (std::size_t j = 0; j < of.size(); ++j) sum.of[k][j] += L[k] * of[j];
            }
            for (std::size_t j = 0; j < 4; ++j) sum.uniform[j] += of[j];
        }
    }
}

/// Central moments from moments about the origin; in double, for the difference loses digits.
ClusterNode ClusterTree::make_node(const RawMoments& raw, const SourceRect& rect,
                                   ClusterMoments<float>& out) const {
    ClusterNode node{};
    const auto first_of = [](const double* moments) {
        return DVec3{moments[1], moments[2], moments[3]};
    };
    const DVec3 uniform = first_of(raw.uniform) / raw.uniform[0];
    DVec3 weighted{0};
    double total = 0;
    for (int k = 0; k < 3; ++k) {
        weighted += centre_weight_[k] * first_of(raw.of[k]);
        total += centre_weight_[k] * raw.of[k][0];
    }
    const DVec3 centre = total > 0 ? weighted / total : uniform;
    const double variance = std::max(0.0, (1 - glm::dot(centre, centre)) / 2);
    const double uniform_variance = (1 - glm::dot(uniform, uniform)) / 2;
    const DVec2 sides = rect.sides();
    const double extent = std::max(sides.x, sides.y);

    // Small blocks are nearly flat: no corner is further than half the diagonal from the
    // middle.
    double radius = 0.53 * glm::length(sides) + glm::length(centre - uniform);
    if (extent > 0.2) {
        constexpr double kSteps[] = {0, 0.25, 0.5, 0.75, 1};
        radius = 0;
        for (const double s : kSteps) {
            for (const double t : kSteps) {
                radius = std::max(radius, 1.02 * glm::length(rect.towards(s, t) - centre));
            }
        }
    }
    double skew = 0, deviation2 = 0, offset = 0;
    for (int k = 0; k < 3; ++k) {
        const double flux = raw.of[k][0];
        const DVec3 first = first_of(raw.of[k]) - flux * centre;
        // Sum of L (w - c)(w - c)^T = Q - c M^T - M c^T + F c c^T, M = first + F c.
        const auto second = [&](int slot, int i, int j) {
            return raw.of[k][4 + slot] - centre[i] * first[j] - first[i] * centre[j] -
                   flux * centre[i] * centre[j];
        };
        const double central[6] = {second(0, 0, 0), second(1, 1, 1), second(2, 2, 2),
                                   second(3, 0, 1), second(4, 0, 2), second(5, 1, 2)};
        out.flux[k] = node.flux[k] = static_cast<float>(flux);
        for (int i = 0; i < 3; ++i) out.first[k][i] = static_cast<float>(first[i]);
        for (int i = 0; i < 6; ++i) out.second[k][i] = static_cast<float>(central[i]);
        if (flux > 0) {
            // The root of the sum of squares is above the largest eigenvalue.
            double squares = 0;
            for (int i = 0; i < 6; ++i) squares += (i < 3 ? 1 : 2) * central[i] * central[i];
            deviation2 = std::max(deviation2, std::sqrt(squares) / flux);
            offset = std::max(offset, glm::length(first) / flux);
        }
        if (flux > 0) skew = std::max(skew, glm::length(first) / (flux * extent));
    }
    for (int i = 0; i < 3; ++i) out.centre[i] = node.centre[i] = static_cast<float>(centre[i]);
    out.variance = node.variance = std::max(static_cast<float>(variance), 1e-12f);
    node.extent = static_cast<float>(extent);
    node.radius = static_cast<float>(radius + 1e-7);
    node.deviation = static_cast<float>(1.0001 * std::sqrt(deviation2));
    node.offset = static_cast<float>(1.0001 * offset);
    const double unevenness = 2 * glm::length(centre - uniform) / extent + skew +
                              0.3 * std::abs(variance / uniform_variance - 1);
    node.unevenness = static_cast<float>(std::min(1.0, unevenness));
    return node;
}

SourceRect ClusterTree::rect_of(const TexelBlock& b) const {
    if (const auto* grid = std::get_if<LatLongGrid>(&environment_->grid)) {
        return block_rect(*grid, b.row0, b.row1, b.column0, b.column1);
    }
    return block_rect(std::get<CubeGrid>(environment_->grid), b.face, b.row0, b.row1, b.column0,
                      b.column1);
}

TexelPart ClusterTree::texel(const TexelBlock& block, int row, int column) const {
    if (block.face < 0) return {theta_terms_[index(row)], phi_terms_[index(column)]};
    return TexelPart(rect_of({block.face, row, row + 1, column, column + 1}));
}

DVec3 ClusterTree::excess(const TexelBlock& block, int row, int column) const {
    const std::size_t face = index(std::max(0, block.face));
    const std::size_t texel = (face * index(height_) + index(row)) * index(width_) + index(column);
    return (DVec3(environment_->radiance[texel]) - floor_) * scale_;
}

}  // namespace envbake::lighting
