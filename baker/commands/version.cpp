// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/pipeline/metadata.h"

#include "envbake/format/layout.h"

#include <ostream>

namespace envbake {

RunCommand declare_version(CLI::App&) {
    return [](std::ostream& out, std::ostream&) {
        out << "envbake " << tool_version() << ", bundle format " << format::kMajor << '.'
            << format::kMinor << '\n';
        return ExitCode::Done;
    };
}

}  // namespace envbake
