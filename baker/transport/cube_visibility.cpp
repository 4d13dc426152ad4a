// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/cube_visibility.h"

#include "envbake/runtime/cube.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>
#include <utility>

namespace envbake {

namespace {

using Block = CubeTexels::Block;

/// Blocks of 1/16 of a face are 3 to 6 degrees wide.
constexpr int kCoarsestPerFace = 16;

/// Texels by which points stand beside the corners, to one side and to the other in turn. At the
/// corners themselves the edges of buildings, which run along the axes as the rows of texels do,
/// would meet none or all of a row of them, and shadows be half a texel too wide. Not equal, or
/// diagonals would be met so. A quarter spreads the points of two rows evenly.
constexpr double kRight = 0.25, kDown = 0.2;

/// 1 or -1: in turn for the multiples of 4, in turn for those of 2 between them, and so on, so that
/// blocks of every size have points on both sides.
int side(int i) {
    return i > 0 && (i / (i & -i)) % 4 == 3 ? -1 : 1;
}

enum class State : std::uint8_t { Unknown, Below, Open, Blocked };

/// 1 / d_omega * integral of w dw over a texel. By Stokes' theorem the integral is half the sum,
/// over the edges of the solid angle, of the angle that an edge spans times the normal of its
/// plane.
DVec3 mean_direction(int face, int row, int column, int size) {
    std::array<DVec3, 4> corners;
    for (int k = 0; k < 4; ++k) {
        const int down = k / 2, right = k == 1 || k == 2;
        const auto w =
            cube::direction(static_cast<cube::Face>(face), 2.0 * (column + right) / size - 1,
                            2.0 * (row + down) / size - 1);
        corners[static_cast<std::size_t>(k)] = {w[0], w[1], w[2]};
    }
    DVec3 sum(0);
    for (std::size_t k = 0; k < 4; ++k) {
        const DVec3 &a = corners[k], &b = corners[(k + 1) % 4];
        const DVec3 normal = glm::cross(a, b);
        const double sine = glm::length(normal);
        sum += normal * (std::atan2(sine, glm::dot(a, b)) / sine);
    }
    if (glm::dot(sum, corners[0]) < 0) sum = -sum;
    return sum / (2 * cube::texel_solid_angle(row, column, size));
}

/// Sixteen rays at a time.
class Rays {
  public:
    Rays(const CubeTexels& cube, const Tracer& tracer, const RayOrigin& origin,
         std::vector<State>& states)
        : cube_(cube), tracer_(tracer), origin_(origin), normal_(origin.normal), states_(states) {}

    /// The point is known after trace(); until then it counts as below the horizon.
    void ask(std::uint32_t point) {
        if (states_[point] != State::Unknown) return;
        states_[point] = State::Below;
        const Vec3& w = cube_.directions[point];
        if (!(glm::dot(w, normal_) > 0)) return;
        points_[size_] = point;
        packet_.x[size_] = w.x;
        packet_.y[size_] = w.y;
        packet_.z[size_] = w.z;
        if (++size_ == 16) trace();
    }
    void trace() {
        if (size_ == 0) return;
        for (std::size_t i = size_; i < 16; ++i) {
            packet_.x[i] = packet_.x[0];
            packet_.y[i] = packet_.y[0];
            packet_.z[i] = packet_.z[0];
        }
        const std::uint32_t active = (1u << size_) - 1;
        const std::uint32_t blocked = tracer_.occluded16(origin_.position, packet_, active);
        for (std::size_t i = 0; i < size_; ++i)
            states_[points_[i]] = (blocked >> i & 1) != 0 ? State::Blocked : State::Open;
        count_ += static_cast<int>(size_);
        size_ = 0;
    }
    int count() const { return count_; }

  private:
    const CubeTexels& cube_;
    const Tracer& tracer_;
    const RayOrigin& origin_;
    Vec3 normal_;
    std::vector<State>& states_;
    DirectionPacket packet_;
    std::array<std::uint32_t, 16> points_;
    std::size_t size_ = 0;
    int count_ = 0;
};

/// One vertex' look at the cube.
class CubeLook {
  public:
    CubeLook(const CubeTexels& cube, const Tracer& tracer, const RayOrigin& origin,
             std::span<float> texels, std::vector<State>& states)
        : cube_(cube),
          n_(cube.face_size),
          texels_(texels),
          states_(states),
          rays_(cube, tracer, origin, states_) {
        states_.assign(cube.directions.size(), State::Unknown);
    }

    /// Visibility of each texel.
    int run(Look look) {
        look_around(look);
        return rays_.count();
    }

  private:
    void look_around(Look look) {
        if (look == Look::Everywhere) {
            for (std::uint32_t p = 0; p < states_.size(); ++p) rays_.ask(p);
            rays_.trace();
            for (std::size_t t = 0; t < texels_.size(); ++t) fill(block_of(t), 1);
            return;
        }
        for (const Block& b : cube_.blocks)
            for (int k = 0; k < 4; ++k)
                rays_.ask(point(b, k % 2 * cube_.coarsest, k / 2 * cube_.coarsest));
        rays_.trace();
        // Blocks by size, the coarsest first. A split may show something to a neighbour of any
        // size, so all are looked through until none is split.
        std::vector<std::vector<Block>> by_size(1, cube_.blocks);
        for (int size = cube_.coarsest; size > 1; size /= 2) by_size.emplace_back();
        for (bool found = true; found;) {
            found = false;
            for (std::size_t level = 0; level + 1 < by_size.size(); ++level) {
                const int size = cube_.coarsest >> level, half = size / 2;
                std::size_t kept = 0;
                for (const Block& b : by_size[level]) {
                    if (!differs(b, size)) {
                        by_size[level][kept++] = b;
                        continue;
                    }
                    found = true;
                    for (int r = 0; r <= 2; ++r)
                        for (int c = 0; c <= 2; ++c) rays_.ask(point(b, c * half, r * half));
                    for (int k = 0; k < 4; ++k)
                        by_size[level + 1].push_back(
                            {b.face, static_cast<std::uint16_t>(b.row + k / 2 * half),
                             static_cast<std::uint16_t>(b.column + k % 2 * half)});
                }
                rays_.trace();
                by_size[level].resize(kept);
            }
        }
        for (std::size_t level = 0; level < by_size.size(); ++level)
            for (const Block& b : by_size[level]) fill(b, cube_.coarsest >> level);
    }

    std::uint32_t point(const Block& b, int right, int down) const {
        return cube_.points[static_cast<std::size_t>((b.face * (n_ + 1) + b.row + down) * (n_ + 1) +
                                                     b.column + right)];
    }
    State state(const Block& b, int right, int down) const {
        return states_[point(b, right, down)];
    }

    /// Whether what is known of its edges, above the horizon, differs.
    bool differs(const Block& b, int size) const {
        bool open = false, blocked = false;
        const auto look = [&](int right, int down) {
            const State s = state(b, right, down);
            open |= s == State::Open;
            blocked |= s == State::Blocked;
        };
        for (int i = 0; i < size; ++i) {
            look(i, 0);
            look(size, i);
            look(size - i, size);
            look(0, size - i);
        }
        return open && blocked;
    }

    /// All of a block alike: the mean of what is known of it.
    void fill(const Block& b, int size) {
        int open = 0, known = 0;
        const int step = std::max(1, size / 2);
        for (int r = 0; r <= size; r += step)
            for (int c = 0; c <= size; c += step) {
                const State s = state(b, c, r);
                open += s == State::Open;
                known += s == State::Open || s == State::Blocked;
            }
        const float visibility =
            open > 0 ? static_cast<float>(open) / static_cast<float>(known) : 0.0f;
        for (int r = 0; r < size; ++r) std::fill_n(&texels_[texel_of(b, r, 0)], size, visibility);
    }
    std::size_t texel_of(const Block& b, int r, int c) const {
        return static_cast<std::size_t>((b.face * n_ + b.row + r) * n_ + b.column + c);
    }

    Block block_of(std::size_t texel) const {
        const auto n = static_cast<std::size_t>(n_);
        return {static_cast<std::uint16_t>(texel / (n * n)),
                static_cast<std::uint16_t>(texel / n % n), static_cast<std::uint16_t>(texel % n)};
    }

    const CubeTexels& cube_;
    int n_;
    std::span<float> texels_;
    std::vector<State>& states_;
    Rays rays_;
};

/// The mean of max(0, n.w) over a texel that the horizon crosses: n.w counts as spread evenly
/// between its least and its greatest.
float cosine_at_horizon(const CubeTexels& cube, std::size_t texel, const Vec3& normal, float mean) {
    const auto n = static_cast<std::size_t>(cube.face_size);
    const Vec3* corner =
        &cube.corners[(texel / (n * n) * (n + 1) + texel / n % n) * (n + 1) + texel % n];
    float low = 1, high = -1;
    for (const std::size_t k : {std::size_t{0}, std::size_t{1}, n + 1, n + 2}) {
        const float x = glm::dot(corner[k], normal);
        low = std::min(low, x);
        high = std::max(high, x);
    }
    const float half = (high - low) / 2;
    return mean <= -half ? 0 : mean >= half ? mean : (mean + half) * (mean + half) / (4 * half);
}

/// Visibility becomes transport: times 1 / pi of the mean of max(0, n.w) over a texel.
void multiply_by_cosine(const CubeTexels& cube, const Vec3& n, std::span<float> transport) {
    const std::size_t count = transport.size();
    const float *x = cube.mean_x.data(), *y = x + count, *z = y + count;
    float* const texels = transport.data();
    thread_local std::vector<float> memory;
    memory.resize(count);
    float* const cosines = memory.data();
    // Three loops: the first and the last are arithmetic alone.
    for (std::size_t t = 0; t < count; ++t) cosines[t] = x[t] * n.x + y[t] * n.y + z[t] * n.z;
    for (std::size_t t = 0; t < count; ++t)
        if (std::abs(cosines[t]) < cube.widest && texels[t] > 0)
            cosines[t] = cosine_at_horizon(cube, t, n, cosines[t]);
    constexpr float kInversePi = std::numbers::inv_pi_v<float>;
    for (std::size_t t = 0; t < count; ++t) texels[t] *= std::max(cosines[t], 0.0f) * kInversePi;
}

}  // namespace

CubeTexels::CubeTexels(int size) : face_size(size), coarsest(std::max(1, size / kCoarsestPerFace)) {
    // Corners in units of half a texel from the middle, exact: -size .. size in steps of 2.
    std::map<std::tuple<int, int, int>, std::uint32_t> known;
    const auto direction = [&](int face, double row, double column) {
        const auto w = cube::direction(static_cast<cube::Face>(face), 2 * column / size - 1,
                                       2 * row / size - 1);
        return Vec3(DVec3(w[0], w[1], w[2]));
    };
    for (int face = 0; face < cube::kFaceCount; ++face)
        for (int r = 0; r <= size; ++r)
            for (int c = 0; c <= size; ++c) {
                const auto p = cube::point(static_cast<cube::Face>(face), 2.0 * c / size - 1,
                                           2.0 * r / size - 1);
                const auto key = [&](std::size_t i) { return static_cast<int>(p[i] * size); };
                const auto [at, is_new] = known.try_emplace(
                    {key(0), key(1), key(2)}, static_cast<std::uint32_t>(directions.size()));
                if (is_new)
                    directions.push_back(
                        direction(face, r + kDown * side(c), c + kRight * side(r)));
                points.push_back(at->second);
                corners.push_back(direction(face, r, c));
            }
    std::vector<DVec3> means;
    for (int face = 0; face < cube::kFaceCount; ++face)
        for (int r = 0; r < size; ++r)
            for (int c = 0; c < size; ++c) means.push_back(mean_direction(face, r, c, size));
    for (int axis = 0; axis < 3; ++axis)
        for (const DVec3& mean : means) mean_x.push_back(static_cast<float>(mean[axis]));
    widest = static_cast<float>(std::sqrt(2.0) * 2 / size);  // a diagonal in the middle of a face

    const int per_edge = size / coarsest;
    for (int face = 0; face < cube::kFaceCount; ++face)
        for (int z = 0; z < per_edge * per_edge; ++z) {  // along a Z curve
            int r = 0, c = 0;
            for (int bit = 0; bit < 8; ++bit) {
                c |= (z >> (2 * bit) & 1) << bit;
                r |= (z >> (2 * bit + 1) & 1) << bit;
            }
            blocks.push_back({static_cast<std::uint16_t>(face),
                              static_cast<std::uint16_t>(r * coarsest),
                              static_cast<std::uint16_t>(c * coarsest)});
        }
}

int texel_transport(const CubeTexels& cube, const Tracer& tracer, const RayOrigin& origin,
                    std::span<float> texels, Look look) {
    thread_local std::vector<State> states;
    const int rays = CubeLook(cube, tracer, origin, texels, states).run(look);
    multiply_by_cosine(cube, Vec3(origin.normal), texels);
    return rays;
}

void open_texel_transport(const CubeTexels& cube, const DVec3& normal, std::span<float> texels) {
    std::fill(texels.begin(), texels.end(), 1.0f);
    multiply_by_cosine(cube, Vec3(normal), texels);
}

}  // namespace envbake
