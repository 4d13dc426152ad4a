// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <cstdio>
#include <cstdlib>
#include <utility>

namespace envbake::bench {

/// The value; or its error on stderr, and the end of the program with status 1.
template <class T>
T or_exit(Expected<T> result) {
    if (result) return std::move(*result);
    std::fprintf(stderr, "%s\n", result.error().message.c_str());
    std::exit(1);
}

}  // namespace envbake::bench
