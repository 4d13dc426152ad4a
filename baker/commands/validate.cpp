// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/validate.h"
#include "baker/commands/command.h"
#include "baker/core/text.h"
#include "baker/pipeline/metadata.h"

#include <filesystem>
#include <memory>
#include <ostream>

namespace envbake {

namespace {

struct ValidateOptions {
    std::filesystem::path bundle;
    bool json = false;
};

ExitCode print(const ValidateOptions& options, const std::vector<Finding>& findings,
               std::ostream& out) {
    if (options.json) {
        Json list = Json::array();
        for (const Finding& f : findings)
            list.push_back({{"code", f.code}, {"name", f.name}, {"message", f.message}});
        out << to_text({{"valid", findings.empty()}, {"findings", std::move(list)}}, 2) << '\n';
    } else if (findings.empty()) {
        out << options.bundle.string() << ": valid\n";
    } else {
        for (const Finding& f : findings)
            out << options.bundle.string() << ": " << f.code << ' ' << f.name << ": " << f.message
                << '\n';
    }
    return findings.empty() ? ExitCode::Done : ExitCode::InvalidBundle;
}

}  // namespace

RunCommand declare_validate(CLI::App& app) {
    const auto options = std::make_shared<ValidateOptions>();
    app.add_option("bundle", options->bundle, "Bundle to check (.envb)")->required();
    app.add_flag("--json", options->json, "Machine-readable output");
    app.footer("Each finding has a code that never changes; docs/format.md lists them.");
    return [options](std::ostream& out, std::ostream& err) {
        const auto findings = validate_bundle(options->bundle);
        return findings ? print(*options, *findings, out) : report(findings.error(), err);
    };
}

}  // namespace envbake
