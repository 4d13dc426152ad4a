// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/stage_list.h"

#include "baker/commands/numbered_names.h"
#include "baker/core/text.h"

#include <algorithm>
#include <ostream>
#include <vector>

namespace envbake {

namespace {

struct Line {
    std::string decision, reason;
    std::vector<NumberedName> outputs;
};

std::vector<Line> lines_of(const Json& stages) {
    std::vector<Line> lines;
    for (const Json& stage : stages) {
        const auto text = [&stage](const char* member) {
            return printable(stage.at(member).get<std::string>());
        };
        const Line line{text("decision"), text("reason"), {split_at_number(text("output"))}};
        const auto same = std::find_if(lines.begin(), lines.end(), [&](const Line& other) {
            return other.decision == line.decision && other.reason == line.reason &&
                   line.outputs[0].number >= 0 && other.outputs[0].same_kind(line.outputs[0]);
        });
        if (same == lines.end())
            lines.push_back(line);
        else
            same->outputs.push_back(line.outputs[0]);
    }
    return lines;
}

void print(const std::vector<Line>& lines, bool with_decision, std::ostream& out) {
    std::size_t width = 0;
    for (const Line& line : lines) width = std::max(width, joined_name(line.outputs).size());
    for (const Line& line : lines) {
        std::string name = joined_name(line.outputs);
        name.resize(width, ' ');
        if (with_decision) out << line.decision << "   ";
        out << name << "   " << line.reason << '\n';
    }
}

}  // namespace

void print_stages(const Json& stages, std::ostream& out) {
    print(lines_of(stages), true, out);
}

void print_skipped_stages(const Json& stages, std::ostream& out) {
    std::vector<Line> lines = lines_of(stages);
    lines.erase(std::remove_if(lines.begin(), lines.end(),
                               [](const Line& line) { return line.decision != "skip"; }),
                lines.end());
    if (lines.empty()) return;
    out << "\nskipped\n";
    print(lines, false, out);
}

}  // namespace envbake
