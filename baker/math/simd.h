// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstring>

namespace envbake {

/// Vectors of the GCC/clang vector extension: arithmetic by element, lowered to whatever the target
/// has. No alignment is assumed of memory: load() and store() copy.
using Float16 = float __attribute__((vector_size(64)));
using Double8 = double __attribute__((vector_size(64)));

inline constexpr int kFloatLanes = 16;
inline constexpr int kDoubleLanes = 8;

template <class Vector, class T>
inline Vector load(const T* from) {
    Vector v;
    std::memcpy(&v, from, sizeof v);
    return v;
}
template <class Vector, class T>
inline void store(const Vector& v, T* to) {
    std::memcpy(to, &v, sizeof v);
}

/// The sum of the elements, pairwise, in one fixed order.
inline double sum(const Double8& v) {
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

}  // namespace envbake
