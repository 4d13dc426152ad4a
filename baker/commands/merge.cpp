// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/commands/progress_printer.h"
#include "baker/core/interrupt.h"
#include "baker/core/parallel.h"
#include "baker/core/write_file.h"
#include "baker/pipeline/bake.h"

#include "envbake/format/writer.h"

#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>
#include <vector>

namespace envbake {

namespace {

struct MergeOptions {
    std::vector<std::filesystem::path> shards;
    std::filesystem::path scene, output;
    int threads = 0;
    bool quiet = false;
};

Expected<void> merge(const MergeOptions& options, std::ostream& err) {
    end_when_interrupted({format::Writer::temporary_name(options.output.string())});
    const ThreadLimit limit(options.threads);
    Progress progress;
    std::optional<ProgressPrinter> printer;
    if (!options.quiet) printer.emplace(progress, err, ProgressStyle::Text);
    ENVBAKE_TRY_VOID(check_output(options.output, options.shards));
    ENVBAKE_TRY_VOID(check_output(options.output, {options.scene}));
    ENVBAKE_TRY(const BakeOutcome outcome,
                merge_shards(options.shards, options.scene, options.output, progress));
    printer.reset();
    if (!options.quiet) print_shortfalls(options.output, outcome, err);
    return {};
}

}  // namespace

RunCommand declare_merge(CLI::App& app) {
    const auto options = std::make_shared<MergeOptions>();
    app.add_option("shards", options->shards,
                   "All the parts that `envbake bake --shard I/N` wrote, in any order")
        ->required();
    app.add_option("--scene", options->scene,
                   "Scene that the parts were baked from; needed where light bounces");
    app.add_option("-o,--output", options->output, "Bundle to write (.envb)")->required();
    app.add_option("--threads", options->threads, "Threads; 0 uses every core")
        ->capture_default_str()
        ->check(CLI::Range(0, 4096));
    app.add_flag("-q,--quiet", options->quiet, "Print nothing but errors");
    app.footer(
        "Example:\n"
        "  envbake bake scene.glb --env sky.hdr --shard 1/2 -o 1.shard.envb\n"
        "  envbake bake scene.glb --env sky.hdr --shard 2/2 -o 2.shard.envb\n"
        "  envbake merge 1.shard.envb 2.shard.envb -o scene.envb");
    return [options](std::ostream&, std::ostream& err) {
        const auto done = merge(*options, err);
        return done ? ExitCode::Done : report(done.error(), err);
    };
}

}  // namespace envbake
