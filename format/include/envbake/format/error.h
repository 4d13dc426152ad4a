// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace envbake::format {

/// What is wrong with a bundle, or with a request to one. The numbers are stable: docs/format.md
/// lists them, scripts and the C API use them.
enum class Errc : std::uint16_t {
    None = 0,
    CannotOpen = 1,  ///< the operating system's reason is in system_error
    CannotRead = 2,
    CannotWrite = 3,
    Misaligned = 4,   ///< memory handed to Reader::open is not 8-byte aligned
    TooShort = 10,    ///< shorter than a header
    BadMagic = 11,    ///< not a bundle
    NewerMajor = 12,  ///< a major version this reader does not know
    HeaderChecksum = 13,
    HeaderReserved = 14,
    FileSize = 15,     ///< the header's file size is not that of the file
    TableBounds = 16,  ///< the table does not end with the file, or is too small for its entries
    TableChecksum = 17,
    EntryReserved = 20,
    EntryName = 21,  ///< characters or bounds of a name
    NameOrder = 22,  ///< names are not strictly ascending
    EntryType = 23,
    EntryCodec = 24,
    EntryRank = 25,
    EntryShape = 26,   ///< unused axes are not 0, or the product overflows
    EntrySize = 27,    ///< size is not that of the shape, or stored_size contradicts the codec
    EntryBounds = 28,  ///< outside the file's array section, or not 64-byte aligned
    DecodedSize = 29,  ///< compressed arrays decode to more than a file of this size may ask for
    ArrayChecksum = 30,
    ArrayDecode = 31,   ///< zstd refuses the stored bytes, or they decode to another size
    PaddingBytes = 32,  ///< bytes between arrays are not 0
    ArraysOverlap = 33,
    MissingMetadata = 34,
    ArrayMissing = 40,    ///< a reader asked for an array that is not there
    ArrayType = 41,       ///< ... for another element type
    ArrayShape = 42,      ///< ... for another shape
    ArrayCodec = 43,      ///< ... for a view of a compressed array; or this build lacks the codec
    BufferSize = 44,      ///< the memory to decode into is not as large as the array
    Metadata = 45,        ///< the metadata lacks a field that the request needs
    Shard = 46,           ///< a part of a bake, which `envbake merge` joins to a bundle
    BadName = 50,         ///< writer: not a valid array name
    DuplicateName = 51,   ///< writer: this name was added before
    WrongByteCount = 52,  ///< writer: the bytes appended are not those the shape asks for
};

/// Allocates nothing.
struct Error {
    Errc code = Errc::None;
    std::uint64_t offset = 0;      ///< bytes into the file where the fault is seen, 0 if nowhere
    int system_error = 0;          ///< errno, where the operating system refused
    std::array<char, 64> array{};  ///< name of the array concerned, cut to 63 characters

    static Error at(Errc code, std::uint64_t offset = 0, std::string_view array_name = {}) noexcept;
    static Error from_errno(Errc code) noexcept;
};

/// "NameOrder": the code's own name.
std::string_view to_string(Errc code) noexcept;
/// One sentence: what the code means.
std::string_view describe(Errc code) noexcept;
/// "array mesh/0/diffuse, byte 4096: the checksum ... (ArrayChecksum)".
std::string to_string(const Error& error);

}  // namespace envbake::format
