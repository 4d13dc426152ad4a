// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/encode_mip.h"

#include "envbake/runtime/half.h"

#include <algorithm>
#include <cmath>

namespace envbake {

std::optional<HalfMip> encode_half(const Mip& mip, double mean, double error_budget) {
    HalfMip encoded;
    encoded.texels.reserve(mip.texels.size());
    for (const float texel : mip.texels) {
        const format::Half half{runtime::float_to_half(texel)};
        const double error =
            std::abs(static_cast<double>(runtime::half_to_float(half.bits)) - texel);
        if (error > 0) encoded.error = std::max(encoded.error, error / (texel + 1e-3 * mean));
        if (!(encoded.error <= error_budget)) return std::nullopt;
        encoded.texels.push_back(half);
    }
    return encoded;
}

}  // namespace envbake
