// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/lighting/points.h"
#include "baker/math/vector.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace envbake::lighting {

// From where a walk looks at sources: how far the nearest output direction is. Either one number
// for a whole tile, or one for every direction of it, by lanes. Distances are chords.

inline float square_root(float x) {
    return std::sqrt(x);
}
inline double square_root(double x) {
    return std::sqrt(x);
}
template <class Vector>
inline Vector square_root(const Vector& x) {
    Vector root = x;
    for (std::size_t i = 0; i < sizeof(Vector) / sizeof(x[0]); ++i) root[i] = std::sqrt(x[i]);
    return root;
}

/// The greatest of all lanes.
inline double greatest(float x) {
    return static_cast<double>(x);
}
inline double greatest(double x) {
    return x;
}
template <class Vector>
inline double greatest(const Vector& x) {
    double most = static_cast<double>(x[0]);
    for (std::size_t i = 1; i < sizeof(Vector) / sizeof(x[0]); ++i) {
        most = std::max(most, static_cast<double>(x[i]));
    }
    return most;
}

/// Whether the comparison holds in any lane.
inline bool any(bool holds) {
    return holds;
}
template <class Mask>
inline bool any(const Mask& holds) {
    std::uint64_t words[sizeof(Mask) / sizeof(std::uint64_t)], all = 0;
    std::memcpy(words, &holds, sizeof words);
    for (const std::uint64_t word : words) all |= word;
    return all != 0;
}

template <class Real>
inline Real larger(const Real& a, const Real& b) {
    return a > b ? a : b;
}

/// All directions within a disc.
template <class S>
class FromDisc {
  public:
    using Real = S;
    FromDisc(const DVec3& middle, double radius)
        : x_(static_cast<S>(middle.x)),
          y_(static_cast<S>(middle.y)),
          z_(static_cast<S>(middle.z)),
          radius_(static_cast<S>(radius)) {}

    static constexpr std::size_t groups() { return 1; }
    /// From the disc's edge, 0 inside.
    template <class T>
    S distance2(std::size_t, const T* c) const {
        const S x = x_ - S(c[0]), y = y_ - S(c[1]), z = z_ - S(c[2]);
        const S distance = std::max(S(0), std::sqrt(x * x + y * y + z * z) - radius_);
        return distance * distance;
    }

  private:
    S x_, y_, z_, radius_;
};

/// Each direction by itself.
template <class S>
class FromPoints {
  public:
    using Real = Lanes<S>;
    explicit FromPoints(const Points<S>& points) : points_(&points) {}

    std::size_t groups() const { return points_->groups(); }
    template <class T>
    Real distance2(std::size_t group, const T* c) const {
        const Real x = points_->x[group] - S(c[0]), y = points_->y[group] - S(c[1]),
                   z = points_->z[group] - S(c[2]);
        return x * x + y * y + z * z;
    }

  private:
    const Points<S>* points_;
};

}  // namespace envbake::lighting
