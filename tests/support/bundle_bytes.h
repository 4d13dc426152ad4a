// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/reader.h"

#include <cstddef>
#include <cstring>
#include <span>

// The bytes of a bundle, to be damaged by hand. Places of fields: docs/format.md.
namespace envbake::test {

template <class T>
inline T get(std::span<const std::byte> bundle, std::size_t at) {
    T value;
    std::memcpy(&value, bundle.data() + at, sizeof value);
    return value;
}
template <class T>
inline void put(std::span<std::byte> bundle, std::size_t at, T value) {
    std::memcpy(bundle.data() + at, &value, sizeof value);
}

/// Makes the header's checksum right again: what is left to refuse a file are the rules behind it.
inline void seal_header(std::span<std::byte> bundle) {
    put(bundle, 56, format::checksum(bundle.first(56)));
}
/// ... and that of the table, which begins at `table`.
inline void seal(std::span<std::byte> bundle, std::size_t table) {
    put(bundle, 40, format::checksum(bundle.subspan(table)));
    seal_header(bundle);
}

}  // namespace envbake::test
