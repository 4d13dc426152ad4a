// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/error.h"
#include "envbake/format/layout.h"
#include "envbake/format/result.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace envbake::format {

template <class T>
using Expected = Result<T, Error>;

/// Opens a bundle and hands out its arrays without copying. Every offset, size, count and shape is
/// checked by open(); the contents of arrays are checked by verify(). Allocates nothing, throws
/// nothing. Movable; views live as long as the reader (or the memory it borrows).
///
/// A file that somebody shortens while it is mapped raises SIGBUS, as every mapping does: writers
/// replace bundles by rename.
///
/// Threads: all const members may run on any number of threads at once.
class Reader {
  public:
    /// Maps a file.
    ///
    /// Errors:  CannotOpen, CannotRead, and every code of the header and of the table (10 .. 29)
    [[nodiscard]] static Expected<Reader> open(const char* path) noexcept;

    /// Borrows memory that outlives the reader; 8-byte aligned, 64 to use what the format promises.
    [[nodiscard]] static Expected<Reader> open(std::span<const std::byte> bytes) noexcept;

    Reader(Reader&& other) noexcept;
    Reader& operator=(Reader&& other) noexcept;
    ~Reader();

    std::uint16_t major() const noexcept;
    std::uint16_t minor() const noexcept;
    std::span<const std::byte> file() const noexcept { return {base_, size_}; }

    std::size_t array_count() const noexcept;
    /// Where the table begins, and the arrays have ended.
    std::uint64_t table_offset() const noexcept;
    /// Arrays in ascending order of their names; i < array_count().
    ArrayInfo array(std::size_t i) const noexcept;
    std::optional<ArrayInfo> find(std::string_view name) const noexcept;

    /// The bytes of an array as they stand in the file.
    std::span<const std::byte> stored_bytes(const ArrayInfo& array) const noexcept {
        return {base_ + array.offset, static_cast<std::size_t>(array.stored_size)};
    }

    /// The elements of an uncompressed array, in place.
    ///
    /// Errors:  ArrayMissing, ArrayType, ArrayCodec
    template <class T>
    [[nodiscard]] Expected<std::span<const T>> view(std::string_view name) const noexcept {
        const auto info = find(name);
        if (!info) return Error::at(Errc::ArrayMissing, 0, name);
        if (info->type != kElementTypeOf<T>) return Error::at(Errc::ArrayType, info->offset, name);
        if (info->codec != Codec::None) return Error::at(Errc::ArrayCodec, info->offset, name);
        return std::span<const T>(reinterpret_cast<const T*>(base_ + info->offset),
                                  static_cast<std::size_t>(info->element_count()));
    }

    /// Whether memory may be set aside for the decoded array: what is stored says, too, that there
    /// will be info.size bytes. False for zstd where the build lacks it.
    bool size_is_plausible(const ArrayInfo& info) const noexcept;

    /// Copies or decodes an array into `out`, which has exactly info.size bytes.
    ///
    /// Errors:  BufferSize, ArrayDecode, ArrayCodec (this build lacks zstd)
    [[nodiscard]] Expected<void> read(const ArrayInfo& info,
                                      std::span<std::byte> out) const noexcept;

    /// Compares an array's stored bytes with their checksum. Always well where the build lacks
    /// xxHash.
    ///
    /// Errors:  ArrayChecksum
    [[nodiscard]] Expected<void> verify(const ArrayInfo& info) const noexcept;

    /// The metadata, JSON in UTF-8; empty when absent or compressed.
    std::string_view metadata() const noexcept;

  private:
    Reader(const std::byte* base, std::size_t size, bool mapped) noexcept
        : base_(base), size_(size), mapped_(mapped) {}
    Expected<void> check() const noexcept;

    const std::byte* base_ = nullptr;
    std::size_t size_ = 0;
    bool mapped_ = false;
};

/// XXH3-64 with seed 0; 0 where the build lacks xxHash.
std::uint64_t checksum(std::span<const std::byte> bytes) noexcept;
/// False where the build lacks xxHash: nothing is verified then.
bool checksums_available() noexcept;

}  // namespace envbake::format
