// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/depfile.h"

#include "baker/core/text.h"

namespace envbake {

namespace {

Expected<std::string> escaped(const std::filesystem::path& file) {
    std::string text;
    std::size_t backslashes = 0;  // right before this character
    for (const char c : file.string()) {
        if (c == '\n' || c == '\r')
            return Error{Errc::Usage,
                         concat(printable(file.string()), ": a depfile cannot name a line break")};
        if (c == '$') text += '$';
        if (c == '#') text += '\\';
        // Before a space a backslash escapes: those of the name are doubled.
        if (c == ' ' || c == '\t') text.append(backslashes + 1, '\\');
        backslashes = c == '\\' ? backslashes + 1 : 0;
        text += c;
    }
    return text;
}

}  // namespace

Expected<std::string> depfile_text(const std::filesystem::path& output,
                                   const std::vector<std::filesystem::path>& inputs) {
    ENVBAKE_TRY(std::string rule, escaped(output));
    rule += ':';
    std::string empty_rules;
    for (const auto& input : inputs) {
        ENVBAKE_TRY(const std::string name, escaped(input));
        rule += " \\\n  " + name;
        empty_rules += "\n" + name + ":\n";
    }
    return rule + "\n" + empty_rules;
}

}  // namespace envbake
