// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/commands/request_options.h"
#include "baker/commands/stage_list.h"
#include "baker/core/text.h"
#include "baker/pipeline/bake.h"
#include "baker/pipeline/metadata.h"

#include "envbake/format/reader.h"

#include <algorithm>
#include <memory>
#include <ostream>
#include <utility>
#include <vector>

namespace envbake {

namespace {

struct PlanOptions {
    BakeRequest request;
    bool json = false;
};

Expected<void> print_new_plan(const PlanOptions& options, std::ostream& out) {
    ENVBAKE_TRY(const BakeInputs inputs, load_inputs(options.request));
    ENVBAKE_TRY(const BakePlan plan, make_plan(options.request, inputs.facts));
    Json stages = plan_json(plan);
    const std::vector<bool> kept = stages_to_keep(options.request, inputs, plan);
    for (std::size_t i = 0; i < kept.size(); ++i)
        if (kept[i]) stages[i]["decision"] = "keep";
    if (options.json) {
        const Json json = {{"up_to_date", false},
                           {"stages", std::move(stages)},
                           {"expected_rays", plan.ray_count},
                           {"expected_bytes", plan.output_bytes}};
        out << to_text(json, 2) << '\n';
        return {};
    }
    print_stages(stages, out);
    const bool some_kept = std::count(kept.begin(), kept.end(), true) > 0;
    out << (some_kept ? "\ncost, kept or not   " : "\ncost   ") << format_count(plan.ray_count)
        << " rays, " << format_bytes(plan.output_bytes) << " of arrays before compression\n";
    return {};
}

/// The plan that stands in an up-to-date bundle: no input is opened for it.
Expected<void> print_stored_plan(const PlanOptions& options, std::ostream& out) try {
    const auto reader = format::Reader::open(options.request.output.c_str());
    const Json metadata = reader ? parse_metadata(reader->metadata()) : Json();
    if (!metadata.is_object() || !metadata.contains("plan"))
        return Error{Errc::InvalidBundle,
                     concat(options.request.output.string(), ": holds no plan")};
    if (options.json) {
        out << to_text({{"up_to_date", true}, {"stages", metadata["plan"]}}, 2) << '\n';
        return {};
    }
    out << options.request.output.string()
        << " is up to date: nothing to bake. It was baked so:\n\n";
    print_stages(metadata["plan"], out);
    return {};
} catch (const Json::exception&) {
    return Error{Errc::InvalidBundle, concat(options.request.output.string(),
                                             ": its plan is not as docs/format.md has it")};
}

}  // namespace

RunCommand declare_plan(CLI::App& app) {
    const auto options = std::make_shared<PlanOptions>();
    declare_request(app, options->request);
    app.add_option("-o,--output", options->request.output,
                   "Bundle that would be written: what of it would be kept is said; if it is up to "
                   "date, its own plan is printed");
    app.add_flag("--json", options->json, "Machine-readable output");
    return [options](std::ostream& out, std::ostream& err) {
        const bool stored =
            !options->request.output.empty() && files_if_up_to_date(options->request);
        const auto done = stored ? print_stored_plan(*options, out) : print_new_plan(*options, out);
        return done ? ExitCode::Done : report(done.error(), err);
    };
}

}  // namespace envbake
