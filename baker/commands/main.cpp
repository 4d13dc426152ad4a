// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/core/text.h"
#include "baker/pipeline/metadata.h"

#include <csignal>
#include <exception>
#include <iostream>
#include <map>
#include <new>
#include <string>

namespace envbake {

namespace {

struct Entry {
    const char* name;
    const char* description;
    RunCommand (*declare)(CLI::App&);
};

constexpr Entry kCommands[] = {
    {"bake", "Bake a bundle from a scene, an environment, or both", declare_bake},
    {"merge", "Join the parts of a bake on many machines", declare_merge},
    {"plan", "Say what bake would do and why; bakes nothing", declare_plan},
    {"dump", "Describe a bundle", declare_dump},
    {"validate", "Check a bundle against every rule of the format", declare_validate},
    {"extract", "Write one array of a bundle to a file", declare_extract},
    {"diff", "Compare two bundles", declare_diff},
    {"render", "Preview a bundle on its scene through the runtime", declare_render},
    {"version", "Print the version", declare_version},
};

constexpr const char* kDescription =
    "envbake bakes environment lighting and per-vertex light transport into one bundle (.envb).\n\n"
    "  envbake bake scene.glb --env sky.hdr -o scene.envb\n"
    "  envbake dump scene.envb\n"
    "  envbake render scene.envb scene.glb -o scene.png\n";

constexpr const char* kFooter =
    "Exit status: 0 done, 1 the work failed, 2 wrong usage, 3 an input is invalid,\n"
    "4 a bundle is invalid or differs, 130 interrupted (Ctrl-C).";

/// Runs a command; what nobody foresaw still ends in one line. Output that did not reach its
/// destination is a failure.
ExitCode run_guarded(const RunCommand& run) {
    try {
        const ExitCode code = run(std::cout, std::cerr);
        if (std::cout.flush()) return code;
        return report({Errc::Failed, "standard output cannot be written"}, std::cerr);
    } catch (const std::bad_alloc&) {
        return report({Errc::Failed, "out of memory"}, std::cerr);
    } catch (const std::exception& e) {
        return report({Errc::Failed, concat("internal error: ", e.what())}, std::cerr);
    }
}

}  // namespace

ExitCode report(const Error& error, std::ostream& err) {
    err << "envbake: " << printable(error.message) << '\n';
    switch (error.code) {
        case Errc::Failed:
            break;
        case Errc::Usage:
            return ExitCode::Usage;
        case Errc::InvalidInput:
            return ExitCode::InvalidInput;
        case Errc::InvalidBundle:
            return ExitCode::InvalidBundle;
    }
    return ExitCode::Failed;
}

}  // namespace envbake

int main(int argc, char** argv) {
    using namespace envbake;
    // A file that grows beyond its limit (ulimit -f) is then an error of write(), with a message.
    std::signal(SIGXFSZ, SIG_IGN);
    CLI::App app{kDescription, "envbake"};
    app.footer(kFooter);
    app.require_subcommand(1);
    app.set_version_flag("--version", concat("envbake ", tool_version()));
    std::map<const CLI::App*, RunCommand> commands;
    for (const Entry& entry : kCommands) {
        CLI::App* subcommand = app.add_subcommand(entry.name, entry.description);
        commands.emplace(subcommand, entry.declare(*subcommand));
    }
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) {
            app.exit(error);  // --help
            return static_cast<int>(ExitCode::Done);
        }
        const bool unknown = app.get_subcommands().empty() && argc > 1 && argv[1][0] != '-';
        const std::string what =
            unknown ? concat("there is no command ", quoted(argv[1])) : error.what();
        return static_cast<int>(report({Errc::Usage, what + "; see envbake --help"}, std::cerr));
    }
    return static_cast<int>(run_guarded(commands.at(app.get_subcommands().front())));
}
