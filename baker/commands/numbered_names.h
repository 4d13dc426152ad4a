// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace envbake {

/// An array's name around its number: "mesh/", 12, "/diffuse". Without a number, -1 and no suffix.
struct NumberedName {
    std::string prefix, suffix;
    int number = -1;

    bool same_kind(const NumberedName& other) const {
        return prefix == other.prefix && suffix == other.suffix &&
               (number < 0) == (other.number < 0);
    }
};

NumberedName split_at_number(std::string_view name);

/// One name for many of a kind: "mesh/0..11,13/diffuse". `names` are of one kind, numbers rising.
std::string joined_name(const std::vector<NumberedName>& names);

}  // namespace envbake
