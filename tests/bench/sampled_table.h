// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"

#include <vector>

namespace envbake::bench {

/// The textbook split-sum table as a baseline ([Karis13] with height-correlated Smith): half
/// vectors from D(h) n.h by a Hammersley set. Texel (row, column) of `size` holds roughness
/// (row + 1/2) / size and n.v (column + 1/2) / size; A and B.
std::vector<Vec2> sampled_table(int size, int sample_count);

}  // namespace envbake::bench
