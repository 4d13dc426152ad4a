// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/environment.h"
#include "baker/lighting/source_patch.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <cstddef>
#include <variant>
#include <vector>

namespace envbake::lighting {

/// Texels begin .. end - 1 of a line. Line i is row i of a lat-long image, or row i % size of face
/// i / size of a cube: texel c of it is number i * width + c of Environment::radiance.
struct TexelRun {
    int line = 0;
    int begin = 0, end = 0;
};

/// Where the texels of a grid lie, and which of them touch.
class TexelLines {
  public:
    /// Keeps a pointer to `grid`.
    explicit TexelLines(const std::variant<LatLongGrid, CubeGrid>& grid);

    int width() const { return width_; }
    int rows() const { return rows_; }    ///< of one face
    int faces() const { return faces_; }  ///< 1: lat-long
    int count() const { return rows_ * faces_; }

    double solid_angle(int line, int column) const;
    SourcePatch patch(int line, int column) const;

    /// Calls visit(TexelRun) with runs that cover the texels outside `run` that share an edge or a
    /// corner with one of its texels, across the seam, the poles and the edges of a cube as well:
    /// whatever touches on the sphere, whichever way the grid is cut. The texels around a pole all
    /// touch. Some texels come twice, and some of `run` itself at a pole or where it meets itself.
    template <class Visit>
    void for_neighbours(const TexelRun& run, const Visit& visit) const;

  private:
    template <class Visit>
    void visit_wrapped(int line, int begin, int end, const Visit& visit) const;
    /// What lies across an edge of a face from the points (u0, v0) .. (u1, v1), one of whose
    /// coordinates is just over 1 in size.
    template <class Visit>
    void visit_across(int face, double u0, double v0, double u1, double v1,
                      const Visit& visit) const;
    int interval(double x) const;  ///< of a face's edges, that holds x

    const LatLongGrid* lat_long_ = nullptr;
    const CubeGrid* cube_ = nullptr;
    int width_ = 0, rows_ = 0, faces_ = 1;
    std::vector<ThetaTerms> thetas_;  ///< a row
    std::vector<PhiTerms> phis_;      ///< a column
};

/// Which of `runs`, sorted by line and column, touch: a label for each, 0 .. count - 1 in the order
/// of first runs. 4 bytes a line and 8 a run; O(runs log runs).
struct ConnectedRuns {
    std::vector<int> label;
    int count = 0;
};
ConnectedRuns connect(const TexelLines& lines, const std::vector<TexelRun>& runs);

// ---- for_neighbours ----------------------------------------------------------------------------

template <class Visit>
void TexelLines::visit_wrapped(int line, int begin, int end, const Visit& visit) const {
    if (end - begin >= width_) {
        visit(TexelRun{line, 0, width_});
        return;
    }
    if (begin < 0) visit(TexelRun{line, begin + width_, width_});
    if (end > width_) visit(TexelRun{line, 0, end - width_});
    visit(TexelRun{line, std::max(begin, 0), std::min(end, width_)});
}

template <class Visit>
void TexelLines::visit_across(int face, double u0, double v0, double u1, double v1,
                              const Visit& visit) const {
    const auto f = static_cast<cube::Face>(face);
    const auto p = cube::project(cube::point(f, u0, v0));
    const auto q = cube::project(cube::point(f, u1, v1));
    const auto [row0, row1] = std::minmax({interval(p.v), interval(q.v)});
    const auto [column0, column1] = std::minmax({interval(p.u), interval(q.u)});
    for (int row = row0; row <= row1; ++row) {
        visit(TexelRun{static_cast<int>(p.face) * rows_ + row, column0, column1 + 1});
    }
}

template <class Visit>
void TexelLines::for_neighbours(const TexelRun& run, const Visit& visit) const {
    if (faces_ == 1) {
        for (const int line : {run.line - 1, run.line + 1}) {
            if (line < 0 || line >= rows_) {
                visit(TexelRun{run.line, 0, width_});  // all that meet at the pole
            } else {
                visit_wrapped(line, run.begin - 1, run.end + 1, visit);
            }
        }
        visit_wrapped(run.line, run.begin - 1, run.begin, visit);
        visit_wrapped(run.line, run.end, run.end + 1, visit);
        return;
    }
    const int face = run.line / rows_, row = run.line % rows_;
    const int first = std::max(run.begin - 1, 0), last = std::min(run.end + 1, width_);
    if (row > 0) visit(TexelRun{run.line - 1, first, last});
    if (row + 1 < rows_) visit(TexelRun{run.line + 1, first, last});
    if (run.begin > 0) visit(TexelRun{run.line, run.begin - 1, run.begin});
    if (run.end < width_) visit(TexelRun{run.line, run.end, run.end + 1});

    // Far less than a texel: it takes in a neighbour that shares no more than a corner.
    constexpr double kNudge = 1e-9;
    const auto edge = [&](int i) { return cube_->edges[static_cast<std::size_t>(i)]; };
    const double u0 = std::max(edge(run.begin) - kNudge, -1.0);
    const double u1 = std::min(edge(run.end) + kNudge, 1.0);
    const double v0 = std::max(edge(row) - kNudge, -1.0);
    const double v1 = std::min(edge(row + 1) + kNudge, 1.0);
    constexpr double kOver = 1 + kNudge;
    if (row == 0) visit_across(face, u0, -kOver, u1, -kOver, visit);
    if (row + 1 == rows_) visit_across(face, u0, kOver, u1, kOver, visit);
    if (run.begin == 0) visit_across(face, -kOver, v0, -kOver, v1, visit);
    if (run.end == width_) visit_across(face, kOver, v0, kOver, v1, visit);
}

}  // namespace envbake::lighting
