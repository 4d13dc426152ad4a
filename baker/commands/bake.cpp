// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/bake.h"
#include "baker/commands/command.h"
#include "baker/commands/progress_printer.h"
#include "baker/commands/request_options.h"
#include "baker/core/interrupt.h"
#include "baker/core/parallel.h"
#include "baker/core/text.h"
#include "baker/core/write_file.h"
#include "baker/pipeline/depfile.h"

#include "envbake/format/writer.h"

#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>

namespace envbake {

namespace {

struct BakeOptions {
    BakeRequest request;
    std::filesystem::path depfile;  ///< empty: none
    bool force = false;
    bool quiet = false;
    ProgressStyle progress = ProgressStyle::Text;
    bool verbose = false;
    int threads = 0;
};

/// What was repaired or passed over: usable results, but not quite as asked.
void print_notes(const BakeInputs& inputs, std::ostream& err) {
    if (inputs.environment && inputs.environment->repairs.total() > 0) {
        const RadianceRepairs& r = inputs.environment->repairs;
        err << "envbake: " << inputs.environment->file_name << ": repaired "
            << format_count(r.nan_count) << " NaN, " << format_count(r.infinite_count)
            << " infinite and " << format_count(r.negative_count)
            << " negative values (--strict refuses them)\n";
    }
    if (inputs.scene)
        for (const std::string& note : inputs.scene->notes)
            err << "envbake: " << printable(concat(inputs.scene->file_name, ": ", note)) << '\n';
}

std::vector<std::filesystem::path> files_read(const BakeInputs& inputs,
                                              const BakeRequest& request) {
    std::vector<std::filesystem::path> files;
    if (inputs.scene) files = inputs.scene->files_read;
    if (inputs.environment) files.push_back(request.environment);
    return files;
}

/// What --depfile is going to hold, settled before anything is baked.
Expected<std::string> depfile_content(const BakeOptions& options,
                                      const std::vector<std::filesystem::path>& files) {
    if (options.depfile.empty()) return std::string();
    ENVBAKE_TRY_VOID(check_output(options.depfile, files));
    std::error_code ignored;
    if (std::filesystem::weakly_canonical(options.depfile, ignored) ==
        std::filesystem::weakly_canonical(options.request.output, ignored))
        return Error{Errc::Usage, concat(options.depfile.string(), ": is the output already")};
    return depfile_text(options.request.output, files);
}

Expected<void> write_depfile(const BakeOptions& options, std::string_view content) {
    if (options.depfile.empty()) return {};
    return write_file(options.depfile, content);
}

void print_stages(const BakePlan& plan, const BakeOutcome& outcome, std::ostream& err) {
    for (std::size_t i = 0; i < plan.stages.size(); ++i) {
        const PlannedStage& stage = plan.stages[i];
        err << "envbake: "
            << (!stage.job        ? "skipped "
                : outcome.kept[i] ? "kept "
                                  : "baked ")
            << stage.output << ": " << stage.reason << '\n';
    }
    if (!outcome.traced) err << "envbake: no ray was traced\n";
}

/// "3/8"
Shard shard_of(const std::string& text) {
    Shard shard;
    const auto slash = text.find('/');
    if (slash == std::string::npos ||
        !CLI::detail::lexical_cast(text.substr(0, slash), shard.index) ||
        !CLI::detail::lexical_cast(text.substr(slash + 1), shard.count) || shard.index < 1 ||
        shard.index > shard.count || shard.count > kMaxShards)
        throw CLI::ValidationError(
            "--shard", concat(text, ": I/N, part I of N, 1 to N; N up to ", kMaxShards));
    return shard;
}

Expected<void> bake(const BakeOptions& options, std::ostream& err) {
    const BakeRequest& request = options.request;
    if (!options.force) {
        if (const auto files = files_if_up_to_date(request)) {
            if (!options.quiet) err << "envbake: " << request.output.string() << " is up to date\n";
            ENVBAKE_TRY(const std::string depfile, depfile_content(options, *files));
            return write_depfile(options, depfile);
        }
    }
    std::vector<std::filesystem::path> temporaries{
        format::Writer::temporary_name(request.output.string())};
    if (!options.depfile.empty()) temporaries.push_back(temporary_of(options.depfile));
    end_when_interrupted(temporaries);
    const ThreadLimit limit(options.threads);
    Progress progress;
    std::optional<ProgressPrinter> printer;
    if (!options.quiet) printer.emplace(progress, err, options.progress);
    ENVBAKE_TRY_VOID(check_output(request.output, {request.scene, request.environment}));
    ENVBAKE_TRY(const BakeInputs inputs, load_inputs(request));
    if (inputs.scene) ENVBAKE_TRY_VOID(check_output(request.output, inputs.scene->files_read));
    ENVBAKE_TRY(const std::string depfile, depfile_content(options, files_read(inputs, request)));
    ENVBAKE_TRY(const BakePlan plan, make_plan(request, inputs.facts));
    std::optional<BakeOutcome> outcome;  // of a shard, merge says how it came out
    if (request.shard) {
        ENVBAKE_TRY_VOID(run_shard(request, inputs, plan, progress));
    } else {
        ENVBAKE_TRY(outcome, run_plan(request, inputs, plan,
                                      options.force ? Older::Forget : Older::Keep, progress));
    }
    printer.reset();
    if (!options.quiet) print_notes(inputs, err);
    if (!options.quiet && outcome) print_shortfalls(request.output, *outcome, err);
    ENVBAKE_TRY_VOID(write_depfile(options, depfile));
    if (options.verbose && outcome) print_stages(plan, *outcome, err);
    return {};
}

}  // namespace

void print_shortfalls(const std::filesystem::path& output, const BakeOutcome& outcome,
                      std::ostream& err) {
    for (const std::string& line : outcome.shortfalls)
        err << "envbake: " << printable(output.string()) << ": " << line << '\n';
}

RunCommand declare_bake(CLI::App& app) {
    const auto options = std::make_shared<BakeOptions>();
    declare_request(app, options->request);
    app.add_option("-o,--output", options->request.output, "Bundle to write (.envb)")->required();
    app.add_option("--depfile", options->depfile,
                   "Also write which files the bundle depends on, for make, ninja or CMake");
    app.add_option_function<std::string>(
           "--shard",
           [options](const std::string& text) { options->request.shard = shard_of(text); },
           "Bake part I of N of the work, on any machine; `envbake merge` joins the parts")
        ->type_name("I/N")
        ->excludes("--time-budget");
    app.add_flag("--force", options->force, "Bake everything, whatever the older bundle has");
    app.add_option("--threads", options->threads, "Threads; 0 uses every core")
        ->capture_default_str()
        ->check(CLI::Range(0, 4096));
    app.add_flag("-q,--quiet", options->quiet, "Print nothing but errors");
    app.add_option_function<std::string>(
           "--progress",
           [options](const std::string& style) {
               options->progress = style == "json" ? ProgressStyle::Json : ProgressStyle::Text;
           },
           "How progress is said on stderr: text, or json, one object a line")
        ->check(CLI::IsMember({"text", "json"}))
        ->default_str("text");
    app.add_flag("-v,--verbose", options->verbose,
                 "Say what each stage was baked, kept or skipped for");
    app.footer(
        "Example:\n"
        "  envbake bake scene.glb --env sky.hdr -o scene.envb --preset reference");
    return [options](std::ostream&, std::ostream& err) {
        const auto done = bake(*options, err);
        return done ? ExitCode::Done : report(done.error(), err);
    };
}

}  // namespace envbake
