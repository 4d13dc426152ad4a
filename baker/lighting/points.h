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

/// value(i) for `count` points in groups of lanes; the last group repeats its last point.
template <class S, class Value>
inline std::vector<Lanes<S>> in_groups(std::size_t count, const Value& value) {
    std::vector<Lanes<S>> groups((count + kLanes<S> - 1) / kLanes<S>);
    for (std::size_t g = 0; g < groups.size(); ++g) {
        for (std::size_t lane = 0; lane < kLanes<S>; ++lane) {
            groups[g][lane] = static_cast<S>(value(std::min(g * kLanes<S> + lane, count - 1)));
        }
    }
    return groups;
}
template <class S>
inline std::vector<Lanes<S>> in_groups(const std::vector<double>& values) {
    return in_groups<S>(values.size(), [&](std::size_t i) { return values[i]; });
}

/// Directions to evaluate, as they are and counted from an origin that lies among them.
template <class S>
struct Points {
    std::vector<Lanes<S>> x, y, z;
    std::vector<Lanes<S>> from_x, from_y, from_z;

    Points() = default;
    Points(const std::vector<DVec3>& directions, const DVec3& origin) {
        const auto component = [&](int axis, double less) {
            return in_groups<S>(directions.size(),
                                [&](std::size_t i) { return directions[i][axis] - less; });
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
