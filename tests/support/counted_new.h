// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace envbake::test {

/// What the program has asked of operator new so far; link counted_new.cpp, which replaces it.
std::size_t allocated_bytes();

}  // namespace envbake::test
