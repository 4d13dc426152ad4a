// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/numbered_names.h"

#include <algorithm>

namespace envbake {

NumberedName split_at_number(std::string_view name) {
    constexpr std::size_t kMostDigits = 9;
    std::size_t begin = 0;
    while (begin <= name.size()) {
        const std::size_t end = std::min(name.find('/', begin), name.size());
        const std::string_view part = name.substr(begin, end - begin);
        if (!part.empty() && part.size() <= kMostDigits &&
            std::all_of(part.begin(), part.end(), [](char c) { return c >= '0' && c <= '9'; }))
            return {std::string(name.substr(0, begin)), std::string(name.substr(end)),
                    std::stoi(std::string(part))};
        begin = end + 1;
    }
    return {std::string(name), "", -1};
}

std::string joined_name(const std::vector<NumberedName>& names) {
    if (names.front().number < 0) return names.front().prefix;
    std::string numbers;
    for (std::size_t first = 0; first < names.size();) {
        std::size_t last = first;
        while (last + 1 < names.size() && names[last + 1].number == names[last].number + 1) ++last;
        if (first > 0) numbers += ',';
        numbers += std::to_string(names[first].number);
        if (last > first) numbers += ".." + std::to_string(names[last].number);
        first = last + 1;
    }
    return names.front().prefix + numbers + names.front().suffix;
}

}  // namespace envbake
