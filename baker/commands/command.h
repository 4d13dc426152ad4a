// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/pipeline/bake.h"

#include <CLI/CLI.hpp>

#include <filesystem>
#include <functional>
#include <iosfwd>

namespace envbake {

/// What the process tells the shell. Documented in docs/cli.md; the numbers are stable.
enum class ExitCode : int {
    Done = 0,
    Failed = 1,         ///< the work failed: I/O, memory
    Usage = 2,          ///< wrong usage
    InvalidInput = 3,   ///< an image or a scene is invalid
    InvalidBundle = 4,  ///< a bundle is invalid, or differs
};

/// Prints "envbake: MESSAGE" as one line, and says which status that is.
ExitCode report(const Error& error, std::ostream& err);

/// Says on one line each what came out less exact than was asked for.
void print_shortfalls(const std::filesystem::path& output, const BakeOutcome& outcome,
                      std::ostream& err);

/// Runs a subcommand with the options that were parsed. Data goes to `out`, all else to `err`.
using RunCommand = std::function<ExitCode(std::ostream& out, std::ostream& err)>;

// Each declares a subcommand's options and returns what runs it. One file each.
RunCommand declare_bake(CLI::App& app);
RunCommand declare_merge(CLI::App& app);
RunCommand declare_plan(CLI::App& app);
RunCommand declare_dump(CLI::App& app);
RunCommand declare_validate(CLI::App& app);
RunCommand declare_extract(CLI::App& app);
RunCommand declare_diff(CLI::App& app);
RunCommand declare_render(CLI::App& app);
RunCommand declare_version(CLI::App& app);

}  // namespace envbake
