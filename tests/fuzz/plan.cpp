// SPDX-License-Identifier: Apache-2.0
// Any bytes as a scene or an environment, and the plan of a bake of it: by default, and with all
// that can be asked for. Not among the default targets: it links the whole baker, and starts from
// what those of scenes and environments have found.
#include "baker/plan/plan.h"
#include "baker/pipeline/bake.h"
#include "tests/fuzz/file_in_memory.h"
#include "tests/fuzz/require.h"

#include <string_view>

namespace {

using namespace envbake;
using envbake::fuzz::require;

BakeRequest everything() {
    BakeRequest all;
    all.bands = 2;
    all.mip_size = 4;
    all.mip_count = 2;
    all.table_size = 2;
    all.irradiance = all.window = all.unshadowed = true;
    all.distributions = {runtime::Distribution::Ggx, runtime::Distribution::Beckmann};
    all.bounces = 1;
    all.glossy = GlossyChoice::All;
    all.glossy_bands = 2;
    all.wavelet = WaveletUse::Always;
    all.wavelet_size = 16;
    all.encoding = Encoding::Auto;
    return all;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const envbake::fuzz::FileInMemory file(data, size);
    const std::string_view text(reinterpret_cast<const char*>(data), size);
    const bool image = text.starts_with("#?") || text.starts_with("\x76\x2f\x31\x01");
    BakeRequest request;
    (image ? request.environment : request.scene) = file.path();
    const auto inputs = load_inputs(request);
    if (!inputs) {
        require(inputs.error().code == Errc::InvalidInput, "an input that is at fault");
        require(inputs.error().message.find('\n') == std::string::npos, "one line");
        return 0;
    }
    for (const BakeRequest& wanted : {BakeRequest(), everything()}) {
        const auto plan = make_plan(wanted, inputs->facts);
        require(static_cast<bool>(plan), "a plan");
        for (const PlannedStage& stage : plan->stages)
            require(!stage.output.empty() && !stage.reason.empty() &&
                        stage.reason.find('\n') == std::string::npos,
                    "a name and one line of reason");
    }
    return 0;
}
