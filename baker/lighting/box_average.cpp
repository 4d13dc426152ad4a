// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/box_average.h"

#include "baker/core/parallel.h"
#include "baker/lighting/grid_overlap.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

namespace envbake::lighting {
namespace {

using std::numbers::pi;

/// Edges of two grids that should agree differ by less; what they share then is nothing.
constexpr double kSameEdge = 1e-14;

std::size_t index(int i) {
    return static_cast<std::size_t>(i);
}

template <int kChannels>
using Sum = std::array<double, kChannels>;

template <int kChannels>
void add(Sum<kChannels>& sum, double weight, const Vec3& L) {
    for (int k = 0; k < kChannels; ++k) sum[index(k)] += weight * static_cast<double>(L[k]);
}

template <int kChannels>
void store(const Sum<kChannels>& sum, double weight, float* to) {
    for (std::size_t k = 0; k < kChannels; ++k) to[k] = static_cast<float>(sum[k] / weight);
}

template <int kChannels>
std::vector<float> copy_of(const Environment& environment) {
    std::vector<float> texels;
    texels.reserve(environment.radiance.size() * kChannels);
    for (const Vec3& L : environment.radiance) {
        for (int k = 0; k < kChannels; ++k) texels.push_back(L[k]);
    }
    return texels;
}

bool agree(const std::vector<double>& a, const std::vector<double>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                      [](double x, double y) { return std::abs(x - y) <= kSameEdge; });
}

/// What an interval shares with intervals of a grid: those from `first` on, wrapped.
struct Shares {
    int first = 0;
    std::vector<double> weights;
};

// --- lat-long to cube faces

/// Where the texels of a part of the sphere (grid_overlap.h) lie in the output: side texel (i
/// upwards, j along Z), polar texel (a along X, b along Z), counted from the middle of the face.
struct OutputTexels {
    std::ptrdiff_t side = 0, side_i = 0, side_j = 0;
    std::ptrdiff_t polar = 0, polar_a = 0, polar_b = 0;

    OutputTexels(const GridPart& part, int size) {
        // In units of half a texel; the middle texel of an odd size belongs to both sides.
        const double n = size;
        const auto centre = [&](int i) { return size % 2 == 0 ? 2.0 * i + 1 : 2.0 * i; };
        const auto at = [&](double x, double y, double z) {
            const auto p = cube::project(part.to_world(x, y, z));
            const auto column = std::lround((p.u * n + n - 1) / 2);
            const auto row = std::lround((p.v * n + n - 1) / 2);
            return (static_cast<std::ptrdiff_t>(p.face) * size + row) * size + column;
        };
        const double c0 = centre(0), c1 = centre(1);
        side = at(n, c0, c0);
        polar = at(c0, n, c0);
        if (size <= 2) return;  // one texel a part
        side_i = at(n, c1, c0) - side;
        side_j = at(n, c0, c1) - side;
        polar_a = at(c1, n, c0) - polar;
        polar_b = at(c0, n, c1) - polar;
    }
};

template <int kChannels>
class LatLongToCube {
  public:
    LatLongToCube(const Environment& environment, const LatLongGrid& grid, int size)
        : radiance_(environment.radiance.data()),
          width_(grid.width),
          size_(size),
          half_(size - size / 2),
          groups_(parts_of(grid)),
          texels_(index(cube::kFaceCount) * index(size) * index(size) * kChannels) {
        // Overlaps of a texel with a large map are worked out in pieces of some texels' width.
        constexpr int kPieceTexels = 32;
        const int across = std::max(grid.width / 4, grid.height / 2);
        pieces_ = std::max(1, across / (kPieceTexels * size));
        for (const GridParts& group : groups_) {
            for (const GridPart& part : group.parts) outputs_.emplace_back(part, size);
        }
    }

    std::vector<float> run() {
        const std::size_t n = index(half_);
        parallel_for(2 * n, [&](std::size_t task) {
            Worker worker;
            for (const GridParts& group : groups_) {
                worker.finders.emplace_back(group, 2.0 / (size_ * pieces_));
            }
            const int j = static_cast<int>(task % n);
            if (task < n) {
                for (int i = 0; i < half_; ++i) average(worker, false, i, j);
            } else {
                for (int b = 0; b <= j; ++b) average(worker, true, j, b);
            }
        });
        return std::move(texels_);
    }

  private:
    /// A texel of the map in an overlap, counted in the coordinates of a part.
    struct Cell {
        std::ptrdiff_t row, column;
        double solid_angle;
    };
    struct Worker {
        std::vector<OverlapFinder> finders;  ///< of each group
        Overlap overlap;
        std::vector<Cell> cells;
    };
    struct Output {
        std::ptrdiff_t texel = 0;
        double solid_angle = 0;
        Sum<kChannels> flux{};
    };
    /// The outputs of one texel in all parts. Half texels about an axis meet again in one output.
    struct Outputs {
        std::array<Output, 16> of;
        std::size_t count = 0;

        Output& at(std::ptrdiff_t texel, bool may_meet) {
            for (std::size_t i = 0; may_meet && i < count; ++i) {
                if (of[i].texel == texel) return of[i];
            }
            of[count] = {.texel = texel};
            return of[count++];
        }
    };

    /// Piece k of pieces_ of texel i, counted from the middle of the face.
    double edge(int i, int k) const {
        const double first = size_ % 2 == 0 ? 2.0 * i : std::max(0.0, 2.0 * i - 1);
        const double last = size_ % 2 == 0 ? 2.0 * i + 2 : 2.0 * i + 1;
        return (first + (last - first) * k / pieces_) / size_;
    }

    /// Side texel (i, j) or polar texel (a, b) of every part.
    void average(Worker& worker, bool polar, int i, int j) {
        Outputs outputs;
        Overlap& overlap = worker.overlap;
        const bool on_axis = size_ % 2 == 1 && (i == 0 || j == 0);
        std::size_t first_part = 0;
        for (std::size_t g = 0; g < groups_.size(); ++g) {
            const std::vector<GridPart>& parts = groups_[g].parts;
            // Where polar texels lie on the diagonal, a part has what its mirror image has.
            const auto counts = [&](const GridPart& part) {
                return !(polar && i == j && part.mirrored);
            };
            std::array<Output*, 16> to{};
            for (std::size_t p = 0; p < parts.size(); ++p) {
                const OutputTexels& o = outputs_[first_part + p];
                if (!counts(parts[p])) continue;
                to[p] = &outputs.at(polar ? o.polar + i * o.polar_a + j * o.polar_b
                                          : o.side + i * o.side_i + j * o.side_j,
                                    on_axis);
            }
            for (int k = 0; k < pieces_; ++k) {
                for (int l = 0; l < pieces_; ++l) {
                    overlap.clear();
                    const double i0 = edge(i, k), i1 = edge(i, k + 1);
                    const double j0 = edge(j, l), j1 = edge(j, l + 1);
                    if (polar) {
                        worker.finders[g].add_polar(i0, i1, j0, j1, overlap);
                    } else {
                        worker.finders[g].add_side(j0, j1, i0, i1, overlap);
                    }
                    worker.cells.clear();
                    for (const Overlap::Run& run : overlap.runs) {
                        for (int c = 0; c < run.count; ++c) {
                            worker.cells.push_back({run.row, run.column + c,
                                                    overlap.solid_angles[run.first + index(c)]});
                        }
                    }
                    for (std::size_t p = 0; p < parts.size(); ++p) {
                        if (!to[p]) continue;
                        add_cells(parts[p], worker.cells, to[p]->flux);
                        to[p]->solid_angle += overlap.total;
                    }
                }
            }
            first_part += parts.size();
        }
        for (std::size_t o = 0; o < outputs.count; ++o) {
            const Output& output = outputs.of[o];
            store<kChannels>(output.flux, output.solid_angle,
                             texels_.data() + output.texel * kChannels);
        }
    }

    void add_cells(const GridPart& part, const std::vector<Cell>& cells,
                   Sum<kChannels>& flux) const {
        const std::ptrdiff_t row_step = static_cast<std::ptrdiff_t>(part.row_step) * width_;
        const std::ptrdiff_t step = part.column_step, last = width_ - 1;
        const Vec3* const first = radiance_ + static_cast<std::ptrdiff_t>(part.first_row) * width_;
        Sum<kChannels> sum = flux;
        for (const Cell& cell : cells) {
            std::ptrdiff_t column = part.first_column + step * cell.column;
            column = column > last ? column - width_ : column < 0 ? column + width_ : column;
            add<kChannels>(sum, cell.solid_angle, first[row_step * cell.row + column]);
        }
        flux = sum;
    }

    const Vec3* radiance_;
    int width_, size_;
    int half_;  ///< texels from the middle of a face to its edge
    int pieces_ = 1;
    std::vector<GridParts> groups_;
    std::vector<OutputTexels> outputs_;  ///< of the parts of all groups
    std::vector<float> texels_;
};

// --- lat-long to lat-long

/// Rows of the source that share heights theta0 .. theta1.
Shares rows_of(const LatLongGrid& grid, double theta0, double theta1) {
    Shares shares;
    for (int r = 0; r < grid.height; ++r) {
        const double from = std::max(theta0, grid.theta_edges[index(r)]);
        const double to = std::min(theta1, grid.theta_edges[index(r + 1)]);
        if (to - from <= kSameEdge) {
            if (!shares.weights.empty()) break;
            continue;
        }
        if (shares.weights.empty()) shares.first = r;
        shares.weights.push_back(2 * std::sin((from + to) / 2) * std::sin((to - from) / 2));
    }
    return shares;
}

/// Columns of the source that share azimuths phi0 .. phi1.
Shares columns_of(const LatLongGrid& grid, double phi0, double phi1) {
    const std::vector<double>& edges = grid.phi_edges;
    const double turns = 2 * pi * std::floor((phi0 - edges.front() + kSameEdge) / (2 * pi));
    phi0 -= turns;
    phi1 -= turns;
    Shares shares;
    int column =
        static_cast<int>(std::upper_bound(edges.begin() + 1, edges.end() - 1, phi0 + kSameEdge) -
                         edges.begin()) -
        1;
    shares.first = column;
    double offset = 0;  // one turn, beyond the last column
    for (double from = phi0; phi1 - from > kSameEdge;) {
        const double to = std::min(phi1, edges[index(column + 1)] + offset);
        shares.weights.push_back(to - from);
        from = to;
        if (++column == grid.width) column = 0, offset += 2 * pi;
    }
    return shares;
}

template <int kChannels>
std::vector<float> lat_long_to_lat_long(const Environment& environment, const LatLongGrid& grid,
                                        const LatLongGrid& to) {
    if (agree(grid.theta_edges, to.theta_edges) && agree(grid.phi_edges, to.phi_edges)) {
        return copy_of<kChannels>(environment);
    }
    std::vector<Shares> columns;
    for (int c = 0; c < to.width; ++c) {
        columns.push_back(columns_of(grid, to.phi_edges[index(c)], to.phi_edges[index(c + 1)]));
    }
    std::vector<float> texels(index(to.height) * index(to.width) * kChannels);
    parallel_for(index(to.height), [&](std::size_t row) {
        const Shares rows = rows_of(grid, to.theta_edges[row], to.theta_edges[row + 1]);
        double height = 0;
        std::vector<Sum<kChannels>> sums(index(grid.width));
        for (std::size_t i = 0; i < rows.weights.size(); ++i) {
            height += rows.weights[i];
            const Vec3* const L =
                environment.radiance.data() + (index(rows.first) + i) * index(grid.width);
            for (std::size_t c = 0; c < sums.size(); ++c) {
                add<kChannels>(sums[c], rows.weights[i], L[c]);
            }
        }
        float* out = texels.data() + row * index(to.width) * kChannels;
        for (const Shares& shares : columns) {
            Sum<kChannels> flux{};
            double omega = 0;
            std::size_t c = index(shares.first);
            for (const double weight : shares.weights) {
                for (std::size_t k = 0; k < kChannels; ++k) flux[k] += weight * sums[c][k];
                omega += weight * height;
                if (++c == sums.size()) c = 0;
            }
            store<kChannels>(flux, omega, out);
            out += kChannels;
        }
    });
    return texels;
}

// --- cube faces to cube faces

/// Texels of a face's source, along either axis, that share from .. to.
Shares texels_of(const std::vector<double>& edges, double from, double to) {
    Shares shares;
    for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
        const double shared = std::min(to, edges[i + 1]) - std::max(from, edges[i]);
        if (shared <= kSameEdge) {
            if (!shares.weights.empty()) break;
            continue;
        }
        if (shares.weights.empty()) shares.first = static_cast<int>(i);
        shares.weights.push_back(shared);
    }
    return shares;
}

template <int kChannels>
std::vector<float> cube_to_cube(const Environment& environment, const CubeGrid& grid, int size) {
    const std::vector<double> edges = make_cube_grid(size).edges;
    if (agree(grid.edges, edges)) return copy_of<kChannels>(environment);
    const std::size_t n = index(size), source = index(grid.size);
    std::vector<Shares> along;
    for (std::size_t i = 0; i < n; ++i) {
        along.push_back(texels_of(grid.edges, edges[i], edges[i + 1]));
    }
    std::vector<float> texels(index(cube::kFaceCount) * n * n * kChannels);
    parallel_for(n, [&](std::size_t row) {
        for (std::size_t column = 0; column < n; ++column) {
            std::array<Sum<kChannels>, cube::kFaceCount> flux{};
            double omega = 0;
            for (std::size_t i = 0; i < along[row].weights.size(); ++i) {
                const std::size_t r = index(along[row].first) + i;
                const double top = std::max(edges[row], grid.edges[r]);
                const double bottom = std::min(edges[row + 1], grid.edges[r + 1]);
                for (std::size_t j = 0; j < along[column].weights.size(); ++j) {
                    const std::size_t c = index(along[column].first) + j;
                    const double left = std::max(edges[column], grid.edges[c]);
                    const double right = std::min(edges[column + 1], grid.edges[c + 1]);
                    const double shared = cube::solid_angle(left, right, top, bottom);
                    omega += shared;
                    for (std::size_t face = 0; face < flux.size(); ++face) {
                        add<kChannels>(flux[face], shared,
                                       environment.radiance[(face * source + r) * source + c]);
                    }
                }
            }
            for (std::size_t face = 0; face < flux.size(); ++face) {
                store<kChannels>(flux[face], omega,
                                 texels.data() + ((face * n + row) * n + column) * kChannels);
            }
        }
    });
    return texels;
}

// --- cube faces to lat-long

/// The edges of a source's texels on one side of the middle of a face, counted from there.
struct HalfEdges {
    std::vector<double> edges{0};
    int first = 0;  ///< the texel that begins there
    int step = 1;

    HalfEdges(const CubeGrid& grid, bool positive) : step(positive ? 1 : -1) {
        const int n = grid.size;
        for (int i = 0; i <= n; ++i) {
            const double edge = positive ? grid.edges[index(i)] : -grid.edges[index(n - i)];
            if (edge > kSameEdge) edges.push_back(edge);
        }
        const int texels = static_cast<int>(edges.size()) - 1;
        first = positive ? n - texels : texels - 1;
    }
};

/// A quarter of a polar face or an eighth of the band of side faces: its texels, row by row, in the
/// coordinates of a part (grid_overlap.h), and where they lie in the source.
struct SourcePatch {
    const HalfEdges *along_i = nullptr, *along_j = nullptr;  ///< Y and Z, or X and Z
    std::ptrdiff_t first = 0, step_i = 0, step_j = 0;

    SourcePatch(const CubeGrid& grid, const std::array<HalfEdges, 2>& halves, const GridPart& part,
                bool polar) {
        // One place in the patch tells which way the axes go.
        const double i = 0.25, j = 0.5;
        const auto p = cube::project(polar ? part.to_world(i, 1.0, j) : part.to_world(1.0, i, j));
        const bool i_is_u = std::abs(p.u) < std::abs(p.v);
        const HalfEdges& u = halves[p.u > 0];
        const HalfEdges& v = halves[p.v > 0];
        along_i = i_is_u ? &u : &v;
        along_j = i_is_u ? &v : &u;
        const std::ptrdiff_t n = grid.size;
        first = (static_cast<std::ptrdiff_t>(p.face) * n + v.first) * n + u.first;
        step_i = i_is_u ? u.step : v.step * n;
        step_j = i_is_u ? v.step * n : u.step;
    }
    std::size_t texel(std::size_t i, std::size_t j) const {
        return static_cast<std::size_t>(first + static_cast<std::ptrdiff_t>(i) * step_i +
                                        static_cast<std::ptrdiff_t>(j) * step_j);
    }
};

/// The output's quarters of a hemisphere do not share texels, and so can be filled in parallel. The
/// overlaps with every source texel are worked out before that, a few columns at a time.
template <int kChannels>
class CubeToLatLong {
  public:
    CubeToLatLong(const Environment& environment, const CubeGrid& grid, const LatLongGrid& to)
        : radiance_(environment.radiance.data()),
          to_(to),
          groups_(parts_of(to)),
          halves_{HalfEdges(grid, false), HalfEdges(grid, true)},
          flux_(index(to.width) * index(to.height)) {
        for (std::size_t i = 1; i < grid.edges.size(); ++i) {
            widest_ = std::max(widest_, grid.edges[i] - grid.edges[i - 1]);
        }
        const bool symmetric = agree(halves_[0].edges, halves_[1].edges);
        for (const bool polar : {false, true}) {
            std::vector<Patch> patches;
            for (const GridPart& part : groups_.front().parts) {
                // On polar faces, parts and their mirror images share a quarter.
                if (polar && part.mirrored) continue;
                patches.push_back({part, SourcePatch(grid, halves_, part, polar)});
            }
            if (symmetric) {
                add(polar, patches);
            } else {
                for (const Patch& patch : patches) add(polar, {patch});
            }
        }
    }

    std::vector<float> run() const {
        std::vector<float> texels(flux_.size() * kChannels);
        for (std::size_t row = 0; row < index(to_.height); ++row) {
            const double theta0 = to_.theta_edges[row], theta1 = to_.theta_edges[row + 1];
            const double omega = 2 * std::sin((theta0 + theta1) / 2) *
                                 std::sin((theta1 - theta0) / 2) * 2 * pi / to_.width;
            for (std::size_t i = row * index(to_.width); i < (row + 1) * index(to_.width); ++i) {
                store<kChannels>(flux_[i], omega, texels.data() + i * kChannels);
            }
        }
        return texels;
    }

  private:
    struct Patch {
        GridPart part;
        SourcePatch source;
    };
    /// The overlaps of a column of source texels: those of texel i begin at first_run[i].
    struct Column {
        Overlap overlap;
        std::vector<std::size_t> first_run;
    };

    /// Patches of the same edges.
    void add(bool polar, const std::vector<Patch>& patches) {
        const std::vector<double>& along_i = patches.front().source.along_i->edges;
        const std::vector<double>& along_j = patches.front().source.along_j->edges;
        constexpr std::size_t kColumnsAtOnce = 32;
        std::vector<Column> columns(kColumnsAtOnce);
        for (std::size_t first = 0; first + 1 < along_j.size(); first += kColumnsAtOnce) {
            const std::size_t count = std::min(kColumnsAtOnce, along_j.size() - 1 - first);
            parallel_for(count, [&](std::size_t k) {
                OverlapFinder finder(groups_.front(), widest_);
                Column& column = columns[k];
                column.overlap.clear();
                column.first_run.clear();
                const double j0 = along_j[first + k], j1 = along_j[first + k + 1];
                for (std::size_t i = 0; i + 1 < along_i.size(); ++i) {
                    column.first_run.push_back(column.overlap.runs.size());
                    if (polar) {
                        finder.add_polar(along_i[i], along_i[i + 1], j0, j1, column.overlap);
                    } else {
                        finder.add_side(j0, j1, along_i[i], along_i[i + 1], column.overlap);
                    }
                }
                column.first_run.push_back(column.overlap.runs.size());
            });
            constexpr std::size_t kQuarters = 8;
            parallel_for(kQuarters, [&](std::size_t quarter) {
                for (const Patch& patch : patches) {
                    const int turn =
                        patch.part.mirrored ? (patch.part.turn + 3) % 4 : patch.part.turn;
                    if (index(turn + (patch.part.south ? 4 : 0)) != quarter) continue;
                    for (std::size_t k = 0; k < count; ++k) {
                        for (std::size_t i = 0; i + 1 < along_i.size(); ++i) {
                            add(patch, columns[k], i, radiance_[patch.source.texel(i, first + k)]);
                        }
                    }
                }
            });
        }
    }

    void add(const Patch& patch, const Column& column, std::size_t i, const Vec3& L) {
        const GridPart& part = patch.part;
        for (std::size_t r = column.first_run[i]; r < column.first_run[i + 1]; ++r) {
            const Overlap::Run& run = column.overlap.runs[r];
            const int row = part.first_row + part.row_step * run.row;
            int c = (part.first_column + part.column_step * run.column) % to_.width;
            if (c < 0) c += to_.width;
            // A part never reaches over the seam: it lies at a multiple of 90 degrees.
            Sum<kChannels>* to = flux_.data() + index(row) * index(to_.width) + c;
            for (int k = 0; k < run.count; ++k, to += part.column_step) {
                lighting::add<kChannels>(
                    *to, column.overlap.solid_angles[run.first + static_cast<std::size_t>(k)], L);
            }
        }
    }

    const Vec3* radiance_;
    const LatLongGrid& to_;
    std::vector<GridParts> groups_;  ///< one: the output's width is a multiple of 4
    std::array<HalfEdges, 2> halves_;
    double widest_ = 0;
    std::vector<Sum<kChannels>> flux_;
};

template <int kChannels>
std::vector<float> average(const Environment& environment, MipLayout layout, int size) {
    if (const auto* grid = std::get_if<LatLongGrid>(&environment.grid)) {
        if (layout == MipLayout::CubeFaces) {
            return LatLongToCube<kChannels>(environment, *grid, size).run();
        }
        return lat_long_to_lat_long<kChannels>(environment, *grid,
                                               make_lat_long_grid(4 * size, 2 * size));
    }
    const auto& grid = std::get<CubeGrid>(environment.grid);
    if (layout == MipLayout::CubeFaces) return cube_to_cube<kChannels>(environment, grid, size);
    const LatLongGrid to = make_lat_long_grid(4 * size, 2 * size);
    return CubeToLatLong<kChannels>(environment, grid, to).run();
}

}  // namespace

std::vector<float> box_average(const Environment& environment, MipLayout layout, int face_size,
                               int channels) {
    return channels == 1 ? average<1>(environment, layout, face_size)
                         : average<3>(environment, layout, face_size);
}

}  // namespace envbake::lighting
