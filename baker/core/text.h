// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace envbake {

/// Three significant digits, as short as they can be: 0.25, 1.61, 83500, 3e-09.
std::string format_number(double value);
/// Thousands apart: 41,980.
std::string format_count(std::uint64_t count);
/// "300 B", "1.6 kB", "4.3 MB": powers of ten.
std::string format_bytes(std::uint64_t bytes);
/// Control characters escaped as \\x1b: safe to print, and one line.
std::string printable(std::string_view text);
/// In double quotes, control characters escaped: safe to print.
std::string quoted(std::string_view text);

}  // namespace envbake
