// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/texel_runs.h"

#include <numeric>

namespace envbake::lighting {
namespace {

std::size_t slot(int i) {
    return static_cast<std::size_t>(i);
}

/// Disjoint sets, each known by its first member.
class Sets {
  public:
    explicit Sets(std::size_t count) : parent_(count) {
        std::iota(parent_.begin(), parent_.end(), 0);
    }
    int first_of(int i) {
        while (parent_[slot(i)] != i) {
            parent_[slot(i)] = parent_[slot(parent_[slot(i)])];  // halves the path
            i = parent_[slot(i)];
        }
        return i;
    }
    void join(int i, int j) {
        const auto [first, second] = std::minmax({first_of(i), first_of(j)});
        parent_[slot(second)] = first;
    }

  private:
    std::vector<int> parent_;
};

}  // namespace

TexelLines::TexelLines(const std::variant<LatLongGrid, CubeGrid>& grid)
    : lat_long_(std::get_if<LatLongGrid>(&grid)), cube_(std::get_if<CubeGrid>(&grid)) {
    if (cube_ != nullptr) {
        width_ = rows_ = cube_->size;
        faces_ = cube::kFaceCount;
        return;
    }
    width_ = lat_long_->width;
    rows_ = lat_long_->height;
    for (int r = 0; r < rows_; ++r) {
        thetas_.push_back(
            theta_terms(lat_long_->theta_edges[slot(r)], lat_long_->theta_edges[slot(r + 1)]));
    }
    for (int c = 0; c < width_; ++c) {
        phis_.push_back(
            phi_terms(lat_long_->phi_edges[slot(c)], lat_long_->phi_edges[slot(c + 1)]));
    }
}

double TexelLines::solid_angle(int line, int column) const {
    if (faces_ == 1) return thetas_[slot(line)].integral * 2 * phis_[slot(column)].half;
    const auto& edges = cube_->edges;
    const int row = line % rows_;
    return cube::solid_angle(edges[slot(column)], edges[slot(column + 1)], edges[slot(row)],
                             edges[slot(row + 1)]);
}

SourcePatch TexelLines::patch(int line, int column) const {
    if (faces_ == 1) return make_patch(thetas_[slot(line)], phis_[slot(column)]);
    const int row = line % rows_;
    return make_patch(block_rect(*cube_, line / rows_, row, row + 1, column, column + 1));
}

int TexelLines::interval(double x) const {
    const auto& edges = cube_->edges;
    const auto above = std::upper_bound(edges.begin() + 1, edges.end() - 1, x);
    return static_cast<int>(above - edges.begin()) - 1;
}

ConnectedRuns connect(const TexelLines& lines, const std::vector<TexelRun>& runs) {
    std::vector<int> first_of_line(slot(lines.count() + 1), 0);
    for (const TexelRun& run : runs) ++first_of_line[slot(run.line + 1)];
    std::partial_sum(first_of_line.begin(), first_of_line.end(), first_of_line.begin());

    Sets sets(runs.size());
    for (std::size_t i = 0; i < runs.size(); ++i) {
        lines.for_neighbours(runs[i], [&](const TexelRun& span) {
            // Of the runs of that line, those that reach into the span.
            auto other =
                std::partition_point(runs.begin() + first_of_line[slot(span.line)],
                                     runs.begin() + first_of_line[slot(span.line + 1)],
                                     [&](const TexelRun& run) { return run.end <= span.begin; });
            for (; other != runs.end() && other->line == span.line && other->begin < span.end;
                 ++other) {
                sets.join(static_cast<int>(i), static_cast<int>(other - runs.begin()));
            }
        });
    }
    ConnectedRuns connected;
    connected.label.resize(runs.size());
    for (std::size_t i = 0; i < runs.size(); ++i) {
        const auto first = slot(sets.first_of(static_cast<int>(i)));
        connected.label[i] = first == i ? connected.count++ : connected.label[first];
    }
    return connected;
}

}  // namespace envbake::lighting
