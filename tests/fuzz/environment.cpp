// SPDX-License-Identifier: Apache-2.0
// Any bytes as an environment, decoded by the worker as in a bake: what is read is whole, finite
// and nowhere negative.
#include "baker/input/read_environment.h"
#include "tests/fuzz/file_in_memory.h"
#include "tests/fuzz/require.h"

#include <cmath>

namespace {

using namespace envbake;
using envbake::fuzz::require;

std::size_t texel_count(const LatLongGrid& grid) {
    require(grid.theta_edges.size() == static_cast<std::size_t>(grid.height) + 1 &&
                grid.phi_edges.size() == static_cast<std::size_t>(grid.width) + 1,
            "an edge more than texels");
    return static_cast<std::size_t>(grid.width) * static_cast<std::size_t>(grid.height);
}
std::size_t texel_count(const CubeGrid& grid) {
    return 6 * static_cast<std::size_t>(grid.size) * static_cast<std::size_t>(grid.size);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const envbake::fuzz::FileInMemory file(data, size);
    const auto environment = read_environment(file.path());
    if (!environment) {
        require(environment.error().code != Errc::Failed, "an input that is at fault");
        require(environment.error().message.find('\n') == std::string::npos, "one line");
        return 0;
    }
    const std::size_t count =
        std::visit([](const auto& grid) { return texel_count(grid); }, environment->grid);
    require(environment->radiance.size() == count, "as many texels as the grid has");
    for (const Vec3& L : environment->radiance)
        for (int c = 0; c < 3; ++c)
            require(std::isfinite(L[c]) && L[c] >= 0, "finite radiance, nowhere negative");
    return 0;
}
