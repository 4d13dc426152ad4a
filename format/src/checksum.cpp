// SPDX-License-Identifier: Apache-2.0
#include "envbake/format/reader.h"

#ifdef ENVBAKE_WITH_XXHASH
#define XXH_INLINE_ALL
#include <xxhash.h>
#endif

namespace envbake::format {

#ifdef ENVBAKE_WITH_XXHASH
std::uint64_t checksum(std::span<const std::byte> bytes) noexcept {
    return XXH3_64bits(bytes.data(), bytes.size());
}
bool checksums_available() noexcept {
    return true;
}
#else
std::uint64_t checksum(std::span<const std::byte>) noexcept {
    return 0;
}
bool checksums_available() noexcept {
    return false;
}
#endif

}  // namespace envbake::format
