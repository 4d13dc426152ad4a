// SPDX-License-Identifier: Apache-2.0
#include "envbake/format/error.h"

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace envbake::format {

namespace {

struct Text {
    Errc code;
    std::string_view name, meaning;
};

constexpr Text kTexts[] = {
    {Errc::None, "None", "no error"},
    {Errc::CannotOpen, "CannotOpen", "the file cannot be opened"},
    {Errc::CannotRead, "CannotRead", "the file cannot be read"},
    {Errc::CannotWrite, "CannotWrite", "the file cannot be written"},
    {Errc::Misaligned, "Misaligned", "the memory is not 8-byte aligned"},
    {Errc::TooShort, "TooShort", "shorter than the 64 bytes of a header"},
    {Errc::BadMagic, "BadMagic", "does not begin with the bytes of a bundle"},
    {Errc::NewerMajor, "NewerMajor", "the major version is not 1, the only one known here"},
    {Errc::HeaderChecksum, "HeaderChecksum", "the header does not match its checksum"},
    {Errc::HeaderReserved, "HeaderReserved", "reserved bytes of the header are not 0"},
    {Errc::FileSize, "FileSize", "the file is not as long as its header says"},
    {Errc::TableBounds, "TableBounds",
     "the table does not fit between the header and the end of the file"},
    {Errc::TableChecksum, "TableChecksum", "the table does not match its checksum"},
    {Errc::EntryReserved, "EntryReserved", "reserved bytes of a table entry are not 0"},
    {Errc::EntryName, "EntryName",
     "an array's name is outside the table or has characters that no name may have"},
    {Errc::NameOrder, "NameOrder", "the names of the table are not in strictly ascending order"},
    {Errc::EntryType, "EntryType", "an unknown element type"},
    {Errc::EntryCodec, "EntryCodec", "an unknown codec"},
    {Errc::EntryRank, "EntryRank", "the number of axes is not 1 to 6"},
    {Errc::EntryShape, "EntryShape",
     "the shape has sizes on unused axes, or its product overflows"},
    {Errc::EntrySize, "EntrySize", "the size is not that of the shape, or contradicts the codec"},
    {Errc::EntryBounds, "EntryBounds",
     "the array is not on a 64-byte boundary between header and table"},
    {Errc::DecodedSize, "DecodedSize",
     "the compressed arrays decode to more than 8 MiB and 16 times the file's size"},
    {Errc::ArrayChecksum, "ArrayChecksum", "the stored bytes do not match their checksum"},
    {Errc::ArrayDecode, "ArrayDecode", "the stored bytes do not decode to the stated size"},
    {Errc::PaddingBytes, "PaddingBytes", "bytes between arrays are not 0"},
    {Errc::ArraysOverlap, "ArraysOverlap", "two arrays share bytes of the file"},
    {Errc::MissingMetadata, "MissingMetadata", "there is no metadata"},
    {Errc::ArrayMissing, "ArrayMissing", "the bundle has no such array"},
    {Errc::ArrayType, "ArrayType", "the array has another element type than asked for"},
    {Errc::ArrayShape, "ArrayShape", "the array has another shape than its name calls for"},
    {Errc::ArrayCodec, "ArrayCodec",
     "the array is compressed and cannot be used in place, or zstd is not built in"},
    {Errc::BufferSize, "BufferSize", "the memory to decode into has another size than the array"},
    {Errc::Metadata, "Metadata",
     "the metadata lacks a field that is needed, or has it with another type"},
    {Errc::Shard, "Shard", "a part of a bake: `envbake merge` makes a bundle of all parts"},
    {Errc::BadName, "BadName", "not a valid array name"},
    {Errc::DuplicateName, "DuplicateName", "an array of this name was written before"},
    {Errc::WrongByteCount, "WrongByteCount",
     "the bytes written are not those that the shape asks for"},
};

const Text& text(Errc code) noexcept {
    const auto* found = std::find_if(std::begin(kTexts), std::end(kTexts),
                                     [code](const Text& t) { return t.code == code; });
    return found != std::end(kTexts) ? *found : kTexts[0];
}

}  // namespace

Error Error::at(Errc code, std::uint64_t offset, std::string_view array_name) noexcept {
    Error error;
    error.code = code;
    error.offset = offset;
    const std::size_t size = std::min(array_name.size(), error.array.size() - 1);
    std::copy_n(array_name.data(), size, error.array.data());
    return error;
}

Error Error::from_errno(Errc code) noexcept {
    Error error;
    error.code = code;
    error.system_error = errno;
    return error;
}

std::string_view to_string(Errc code) noexcept {
    return text(code).name;
}
std::string_view describe(Errc code) noexcept {
    return text(code).meaning;
}

std::string to_string(const Error& error) {
    std::string line;
    if (error.array[0] != 0) line += "array " + std::string(error.array.data()) + ": ";
    if (error.offset != 0) line += "byte " + std::to_string(error.offset) + ": ";
    line += describe(error.code);
    if (error.system_error != 0) line += std::string(": ") + std::strerror(error.system_error);
    line += " (" + std::string(to_string(error.code)) + ")";
    return line;
}

}  // namespace envbake::format
