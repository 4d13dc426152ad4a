// SPDX-License-Identifier: Apache-2.0
// The mutator of bundles: as libFuzzer's own, but half of what it makes gets its checksums made
// right, so that what lies behind them is reached.
#include "tests/support/bundle_bytes.h"

#include "envbake/format/layout.h"

#include <algorithm>
#include <cstdint>
#include <span>

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace {

namespace format = envbake::format;
using envbake::test::get;
using envbake::test::put;

/// Makes the magic, the version, the file size, the table's place and all checksums what they
/// should be, as far as the bytes allow. Places of fields: docs/format.md.
void repair(std::span<std::byte> bundle) {
    const std::size_t size = bundle.size();
    if (size < format::kHeaderSize) return;
    std::copy(format::kMagic.begin(), format::kMagic.end(),
              reinterpret_cast<unsigned char*>(bundle.data()));
    put<std::uint16_t>(bundle, 8, format::kMajor);
    put<std::uint64_t>(bundle, 16, size);
    put<std::uint64_t>(bundle, 48, 0);
    const auto table = get<std::uint64_t>(bundle, 24);
    if (table < format::kHeaderSize || table > size) return envbake::test::seal_header(bundle);
    put<std::uint64_t>(bundle, 32, size - table);
    const std::uint64_t count = std::min<std::uint64_t>(get<std::uint32_t>(bundle, 12),
                                                        (size - table) / format::kEntrySize);
    for (std::uint64_t i = 0; i < count; ++i) {
        const std::size_t entry = table + format::kEntrySize * i;
        const auto offset = get<std::uint64_t>(bundle, entry + 64),
                   stored = get<std::uint64_t>(bundle, entry + 72);
        if (offset <= table && stored <= table - offset)
            put(bundle, entry + 88, format::checksum(bundle.subspan(offset, stored)));
    }
    envbake::test::seal(bundle, table);
}

}  // namespace

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
    size = LLVMFuzzerMutate(data, size, max_size);
    if (seed % 2 == 0) repair({reinterpret_cast<std::byte*>(data), size});
    return size;
}
