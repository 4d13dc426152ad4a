// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/simd.h"
#include "baker/math/vector.h"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace envbake::lighting {

/// The vector that holds numbers of a kind: 16 floats or 8 doubles.
template <class S>
struct LanesOf;
template <>
struct LanesOf<float> {
    using Vector = Float16;
};
template <>
struct LanesOf<double> {
    using Vector = Double8;
};
template <class S>
using Lanes = typename LanesOf<S>::Vector;
template <class S>
inline constexpr std::size_t kLanes = sizeof(Lanes<S>) / sizeof(S);

/// Values at points in groups of lanes; the last group repeats its last point.
template <class S>
inline std::vector<Lanes<S>> in_groups(const std::vector<double>& values) {
    std::vector<Lanes<S>> groups((values.size() + kLanes<S> - 1) / kLanes<S>);
    for (std::size_t i = 0; i < groups.size() * kLanes<S>; ++i) {
        groups[i / kLanes<S>][i % kLanes<S>] =
            static_cast<S>(values[std::min(i, values.size() - 1)]);
    }
    return groups;
}

/// Directions to evaluate, as they are and counted from an origin that lies among them.
template <class S>
struct Points {
    std::vector<Lanes<S>> x, y, z;
    std::vector<Lanes<S>> from_x, from_y, from_z;

    Points() = default;
    Points(const std::vector<DVec3>& directions, const DVec3& origin) {
        const auto component = [&](int axis, double less) {
            std::vector<double> values;
            values.reserve(directions.size());
            for (const DVec3& d : directions) values.push_back(d[axis] - less);
            return in_groups<S>(values);
        };
        x = component(0, 0);
        y = component(1, 0);
        z = component(2, 0);
        from_x = component(0, origin.x);
        from_y = component(1, origin.y);
        from_z = component(2, origin.z);
    }

    std::size_t groups() const { return x.size(); }
};

}  // namespace envbake::lighting
