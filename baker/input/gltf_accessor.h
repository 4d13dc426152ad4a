// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/input/gltf_asset.h"
#include "baker/input/gltf_compression.h"

#include <cstdint>
#include <span>
#include <vector>

namespace envbake::gltf {

/// The values of an accessor: `components` numbers an element, tightly packed.
struct Numbers {
    int components = 1;
    std::vector<float> values;

    std::size_t count() const { return values.size() / static_cast<std::size_t>(components); }
};

/// Reads an accessor of any format, sparse or not; one without data is all zeros. Normalized
/// integers become c / 255, c / 65535, max(c / 127, -1), max(c / 32767, -1) [glTF 2.0, 3.6.2.2],
/// other integers keep their value. Integers above 2^24 lose digits: indices have their own reader.
///
/// Errors:  InvalidInput  "accessors[3]: ...": no data, or a sparse index out of order or range
Expected<Numbers> read_numbers(Asset& asset, int accessor);

/// Reads a SCALAR accessor of unsigned integers.
Expected<std::vector<std::uint32_t>> read_indices(Asset& asset, int accessor);

/// The values of a Draco attribute, read as the format of `accessor` says.
///
/// Errors:  InvalidInput  the attribute and the accessor differ in format
Expected<Numbers> read_numbers(const Asset& asset, int accessor, const DracoAttribute& attribute);

}  // namespace envbake::gltf
