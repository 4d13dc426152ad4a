// SPDX-License-Identifier: Apache-2.0
#include "envbake/format/reader.h"

#include "byte_order.h"
#include "codec.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

namespace envbake::format {

namespace {

/// Decodes the entry without judging it, except that its name must lie inside the table.
ArrayInfo decode_entry(const std::byte* table, std::uint64_t table_size, std::size_t i) noexcept {
    using namespace entry_field;
    const std::byte* entry = table + i * kEntrySize;
    ArrayInfo info;
    const std::uint64_t name_offset = load<std::uint32_t>(entry + kNameOffsetAt);
    const std::uint64_t name_size = load<std::uint16_t>(entry + kNameSizeAt);
    if (name_offset + name_size <= table_size)
        info.name = {reinterpret_cast<const char*>(table + name_offset),
                     static_cast<std::size_t>(name_size)};
    info.type = static_cast<ElementType>(load<std::uint8_t>(entry + kTypeAt));
    info.codec = static_cast<Codec>(load<std::uint8_t>(entry + kCodecAt));
    info.rank = load<std::uint8_t>(entry + kRankAt);
    for (std::size_t axis = 0; axis < kMaxRank; ++axis)
        info.shape[axis] = load<std::uint64_t>(entry + kShapeAt + 8 * axis);
    info.offset = load<std::uint64_t>(entry + kOffsetAt);
    info.stored_size = load<std::uint64_t>(entry + kStoredSizeAt);
    info.size = load<std::uint64_t>(entry + kSizeAt);
    info.checksum = load<std::uint64_t>(entry + kChecksumAt);
    return info;
}

bool all_zero(const std::byte* begin, std::size_t size) noexcept {
    return std::all_of(begin, begin + size, [](std::byte b) { return b == std::byte{0}; });
}

/// The rules of one entry, each before the value it guards is used.
Errc judge_entry(const std::byte* entry, const ArrayInfo& info,
                 std::uint64_t table_offset) noexcept {
    if (!is_valid_name(info.name)) return Errc::EntryName;
    if (!all_zero(entry + entry_field::kReservedAt,
                  entry_field::kShapeAt - entry_field::kReservedAt))
        return Errc::EntryReserved;
    if (static_cast<std::uint8_t>(info.type) >= kElementTypeCount) return Errc::EntryType;
    if (static_cast<std::uint8_t>(info.codec) >= kCodecCount) return Errc::EntryCodec;
    if (info.rank < 1 || info.rank > kMaxRank) return Errc::EntryRank;
    std::uint64_t size = element_size(info.type);
    for (std::size_t axis = 0; axis < kMaxRank; ++axis) {
        if (axis >= info.rank) {
            if (info.shape[axis] != 0) return Errc::EntryShape;
        } else if (__builtin_mul_overflow(size, info.shape[axis], &size)) {
            return Errc::EntryShape;
        }
    }
    if (size != info.size) return Errc::EntrySize;
    if (info.codec == Codec::None && info.stored_size != info.size) return Errc::EntrySize;
    if (info.offset % kAlignment != 0 || info.offset < kHeaderSize || info.offset > table_offset ||
        info.stored_size > table_offset - info.offset)
        return Errc::EntryBounds;
    return Errc::None;
}

}  // namespace

Expected<Reader> Reader::open(const char* path) noexcept {
    const int file = ::open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file < 0) return Error::from_errno(Errc::CannotOpen);
    struct stat status {};
    if (::fstat(file, &status) != 0 || !S_ISREG(status.st_mode)) {
        const Error error = S_ISREG(status.st_mode) ? Error::from_errno(Errc::CannotRead)
                                                    : Error::at(Errc::CannotRead);
        ::close(file);
        return error;
    }
    const auto size = static_cast<std::size_t>(status.st_size);
    if (size < kHeaderSize) {
        ::close(file);
        return Error::at(Errc::TooShort);
    }
    void* mapping = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file, 0);
    const Error mapping_error = Error::from_errno(Errc::CannotRead);
    ::close(file);
    if (mapping == MAP_FAILED) return mapping_error;
    Reader reader(static_cast<const std::byte*>(mapping), size, true);
    ENVBAKE_TRY_VOID(reader.check());
    return reader;
}

Expected<Reader> Reader::open(std::span<const std::byte> bytes) noexcept {
    if (bytes.size() < kHeaderSize) return Error::at(Errc::TooShort);
    if (reinterpret_cast<std::uintptr_t>(bytes.data()) % 8 != 0) return Error::at(Errc::Misaligned);
    Reader reader(bytes.data(), bytes.size(), false);
    ENVBAKE_TRY_VOID(reader.check());
    return reader;
}

Reader::Reader(Reader&& other) noexcept
    : base_(std::exchange(other.base_, nullptr)),
      size_(std::exchange(other.size_, 0)),
      mapped_(std::exchange(other.mapped_, false)) {}

Reader& Reader::operator=(Reader&& other) noexcept {
    std::swap(base_, other.base_);
    std::swap(size_, other.size_);
    std::swap(mapped_, other.mapped_);
    return *this;
}

Reader::~Reader() {
    if (mapped_) ::munmap(const_cast<std::byte*>(base_), size_);
}

Expected<void> Reader::check() const noexcept {
    using namespace header_field;
    if (std::memcmp(base_, kMagic.data(), kMagic.size()) != 0) return Error::at(Errc::BadMagic);
    if (major() != kMajor) return Error::at(Errc::NewerMajor, kMajorAt);
    if (checksums_available() &&
        checksum({base_, kHeaderChecksumAt}) != load<std::uint64_t>(base_ + kHeaderChecksumAt))
        return Error::at(Errc::HeaderChecksum, kHeaderChecksumAt);
    if (load<std::uint64_t>(base_ + kReservedAt) != 0)
        return Error::at(Errc::HeaderReserved, kReservedAt);
    if (load<std::uint64_t>(base_ + kFileSizeAt) != size_)
        return Error::at(Errc::FileSize, kFileSizeAt);

    const auto table_at = load<std::uint64_t>(base_ + kTableOffsetAt);
    const auto table_size = load<std::uint64_t>(base_ + kTableSizeAt);
    if (table_at < kHeaderSize || table_at > size_ || table_at % kAlignment != 0 ||
        table_size != size_ - table_at || table_size / kEntrySize < array_count())
        return Error::at(Errc::TableBounds, kTableOffsetAt);
    const std::byte* table = base_ + table_at;
    if (checksums_available() && checksum({table, static_cast<std::size_t>(table_size)}) !=
                                     load<std::uint64_t>(base_ + kTableChecksumAt))
        return Error::at(Errc::TableChecksum, kTableChecksumAt);

    std::string_view previous;
    std::uint64_t decoded = 0;
    const std::uint64_t most_decoded = max_decoded_size(size_);
    for (std::size_t i = 0; i < array_count(); ++i) {
        const ArrayInfo info = array(i);
        const Errc fault = judge_entry(table + i * kEntrySize, info, table_at);
        const std::uint64_t at = table_at + i * kEntrySize;
        if (fault == Errc::EntryName) return Error::at(fault, at);
        if (fault != Errc::None) return Error::at(fault, at, info.name);
        if (i > 0 && info.name <= previous) return Error::at(Errc::NameOrder, at, info.name);
        if (info.codec != Codec::None) {
            if (info.size > most_decoded - decoded)
                return Error::at(Errc::DecodedSize, at, info.name);
            decoded += info.size;
        }
        previous = info.name;
    }
    return {};
}

std::uint16_t Reader::major() const noexcept {
    return load<std::uint16_t>(base_ + header_field::kMajorAt);
}
std::uint16_t Reader::minor() const noexcept {
    return load<std::uint16_t>(base_ + header_field::kMinorAt);
}

std::size_t Reader::array_count() const noexcept {
    return load<std::uint32_t>(base_ + header_field::kArrayCountAt);
}

std::uint64_t Reader::table_offset() const noexcept {
    return load<std::uint64_t>(base_ + header_field::kTableOffsetAt);
}

ArrayInfo Reader::array(std::size_t i) const noexcept {
    return decode_entry(base_ + table_offset(), size_ - table_offset(), i);
}

std::optional<ArrayInfo> Reader::find(std::string_view name) const noexcept {
    std::size_t low = 0;
    std::size_t high = array_count();
    while (low < high) {
        const std::size_t middle = low + (high - low) / 2;
        const ArrayInfo info = array(middle);
        if (info.name == name) return info;
        if (info.name < name)
            low = middle + 1;
        else
            high = middle;
    }
    return std::nullopt;
}

bool Reader::size_is_plausible(const ArrayInfo& info) const noexcept {
    return info.codec == Codec::None || zstd_states_size(stored_bytes(info), info.size);
}

Expected<void> Reader::read(const ArrayInfo& info, std::span<std::byte> out) const noexcept {
    if (out.size() != info.size) return Error::at(Errc::BufferSize, info.offset, info.name);
    const auto stored = stored_bytes(info);
    if (info.codec == Codec::None) {
        std::copy(stored.begin(), stored.end(), out.begin());
        return {};
    }
    const Errc fault = zstd_decode(stored, out);
    if (fault != Errc::None) return Error::at(fault, info.offset, info.name);
    return {};
}

Expected<void> Reader::verify(const ArrayInfo& info) const noexcept {
    if (checksums_available() && checksum(stored_bytes(info)) != info.checksum)
        return Error::at(Errc::ArrayChecksum, info.offset, info.name);
    return {};
}

std::string_view Reader::metadata() const noexcept {
    const auto text = view<std::uint8_t>(kMetadataName);
    if (!text) return {};
    return {reinterpret_cast<const char*>(text->data()), text->size()};
}

}  // namespace envbake::format
