// SPDX-License-Identifier: Apache-2.0
#include "envbake/format/writer.h"

#include "byte_order.h"
#include "codec.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <utility>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#ifdef ENVBAKE_WITH_ZSTD
#include <zstd.h>
#endif

namespace envbake::format {

namespace {

std::string folder_of(const std::string& path) {
    const auto slash = path.find_last_of('/');
    if (slash == std::string::npos) return ".";
    return slash == 0 ? "/" : path.substr(0, slash);
}

/// The file a link points at: what is replaced is the file, not the link.
std::string resolved(const std::string& path) {
    char* real = ::realpath(path.c_str(), nullptr);
    if (real == nullptr) return path;
    std::string target = real;
    std::free(real);
    return target;
}

/// Beside `path`, which is no link.
std::string temporary_beside(const std::string& path) {
    const auto slash = path.find_last_of('/');
    const std::string file = slash == std::string::npos ? path : path.substr(slash + 1);
    return folder_of(path) + "/." + file + "." + std::to_string(::getpid()) + ".tmp";
}

Expected<void> write_all(int file, const std::byte* bytes, std::size_t size) {
    while (size > 0) {
        const ssize_t written = ::write(file, bytes, size);
        if (written < 0) {
            if (errno == EINTR) continue;
            return Error::from_errno(Errc::CannotWrite);
        }
        bytes += written;
        size -= static_cast<std::size_t>(written);
    }
    return {};
}

struct Entry {
    ArraySpec spec;
    std::uint64_t offset = 0, stored_size = 0, size = 0, checksum = 0;
};

}  // namespace

struct Writer::State {
    std::string path;
    std::string temporary;  ///< name of the temporary file; empty while the file has none
    int file = -1;
    std::uint64_t position = 0;
    std::map<std::string, Entry> entries;  ///< the table's order: ascending by bytes
    Entry* open_entry = nullptr;
    std::uint64_t appended = 0;
    XXH3_state_t hash;
#ifdef ENVBAKE_WITH_ZSTD
    ZSTD_CCtx* compressor = nullptr;
    std::vector<std::byte> compressed;
#endif

    ~State() {
        if (file >= 0) ::close(file);
        if (!temporary.empty()) ::unlink(temporary.c_str());
#ifdef ENVBAKE_WITH_ZSTD
        ZSTD_freeCCtx(compressor);
#endif
    }

    Expected<void> write(std::span<const std::byte> bytes) {
        ENVBAKE_TRY_VOID(write_all(file, bytes.data(), bytes.size()));
        position += bytes.size();
        return {};
    }

    Expected<void> pad_to_alignment() {
        const std::array<std::byte, kAlignment> zeros{};
        return write(
            {zeros.data(), static_cast<std::size_t>(align_up(position, kAlignment) - position)});
    }

    Expected<void> store_bytes(std::span<const std::byte> bytes) {
        XXH3_64bits_update(&hash, bytes.data(), bytes.size());
        open_entry->stored_size += bytes.size();
        return write(bytes);
    }

#ifdef ENVBAKE_WITH_ZSTD
    Expected<void> compress(std::span<const std::byte> bytes, ZSTD_EndDirective directive) {
        ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
        for (;;) {
            ZSTD_outBuffer out{compressed.data(), compressed.size(), 0};
            const std::size_t left = ZSTD_compressStream2(compressor, &out, &in, directive);
            if (ZSTD_isError(left))
                return Error::at(Errc::CannotWrite, position, open_entry->spec.name);
            ENVBAKE_TRY_VOID(store_bytes({compressed.data(), out.pos}));
            if (directive == ZSTD_e_end ? left == 0 : in.pos == in.size) return {};
        }
    }
#endif

    Expected<void> open(const ArraySpec& spec);
    std::uint64_t table_position(std::size_t table_size) const;
    std::vector<std::byte> table() const;
    std::array<std::byte, kHeaderSize> header(std::span<const std::byte> table) const;
    Expected<void> put_in_place();
};

/// Behind the arrays, and so far back that the file may ask for what its compressed arrays decode
/// to: a hole, which takes no room on most disks.
std::uint64_t Writer::State::table_position(std::size_t table_size) const {
    std::uint64_t decoded = 0;
    for (const auto& [name, entry] : entries)
        if (entry.spec.codec != Codec::None) decoded += entry.size;
    const std::uint64_t least = smallest_file_for(decoded);
    return std::max(position,
                    align_up(least - std::min<std::uint64_t>(least, table_size), kAlignment));
}

std::vector<std::byte> Writer::State::table() const {
    using namespace entry_field;
    std::vector<std::byte> bytes(entries.size() * kEntrySize);
    std::size_t i = 0;
    for (const auto& [name, entry] : entries) {
        const std::size_t name_offset = bytes.size();
        for (char c : name) bytes.push_back(static_cast<std::byte>(c));
        std::byte* at = bytes.data() + i * kEntrySize;
        store(at + kNameOffsetAt, static_cast<std::uint32_t>(name_offset));
        store(at + kNameSizeAt, static_cast<std::uint16_t>(name.size()));
        store(at + kTypeAt, static_cast<std::uint8_t>(entry.spec.type));
        store(at + kCodecAt, static_cast<std::uint8_t>(entry.spec.codec));
        store(at + kRankAt, static_cast<std::uint8_t>(entry.spec.shape.size()));
        for (std::size_t axis = 0; axis < entry.spec.shape.size(); ++axis)
            store(at + kShapeAt + 8 * axis, entry.spec.shape[axis]);
        store(at + kOffsetAt, entry.offset);
        store(at + kStoredSizeAt, entry.stored_size);
        store(at + kSizeAt, entry.size);
        store(at + kChecksumAt, entry.checksum);
        ++i;
    }
    return bytes;
}

std::array<std::byte, kHeaderSize> Writer::State::header(
    std::span<const std::byte> table_bytes) const {
    using namespace header_field;
    std::array<std::byte, kHeaderSize> bytes{};
    for (std::size_t i = 0; i < kMagic.size(); ++i) bytes[i] = static_cast<std::byte>(kMagic[i]);
    store(bytes.data() + kMajorAt, kMajor);
    store(bytes.data() + kMinorAt, kMinor);
    store(bytes.data() + kArrayCountAt, static_cast<std::uint32_t>(entries.size()));
    store(bytes.data() + kFileSizeAt, position);
    store(bytes.data() + kTableOffsetAt, position - table_bytes.size());
    store(bytes.data() + kTableSizeAt, static_cast<std::uint64_t>(table_bytes.size()));
    store(bytes.data() + kTableChecksumAt, checksum(table_bytes));
    store(bytes.data() + kHeaderChecksumAt, checksum({bytes.data(), kHeaderChecksumAt}));
    return bytes;
}

Expected<void> Writer::State::put_in_place() {
    if (::fsync(file) != 0) return Error::from_errno(Errc::CannotWrite);
    if (temporary.empty()) {
        // An unnamed file gets a name beside the target first: a link cannot replace a file, rename
        // can.
        const std::string name = temporary_beside(path);
        const std::string descriptor = "/proc/self/fd/" + std::to_string(file);
        ::unlink(name.c_str());
        if (::linkat(AT_FDCWD, descriptor.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) != 0)
            return Error::from_errno(Errc::CannotWrite);
        temporary = name;
    }
    if (::rename(temporary.c_str(), path.c_str()) != 0) return Error::from_errno(Errc::CannotWrite);
    temporary.clear();
    return {};
}

Writer::Writer(std::unique_ptr<State> state) : state_(std::move(state)) {}
Writer::Writer(Writer&&) noexcept = default;
Writer& Writer::operator=(Writer&&) noexcept = default;
Writer::~Writer() = default;

std::string Writer::temporary_name(const std::string& path) {
    return temporary_beside(resolved(path));
}

Expected<Writer> Writer::create(const std::string& path) {
    auto state = std::make_unique<State>();
    state->path = resolved(path);
#ifdef O_TMPFILE
    state->file = ::open(folder_of(state->path).c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
#endif
    if (state->file < 0) {
        const std::string name = temporary_beside(state->path);
        state->file = ::open(name.c_str(), O_CREAT | O_TRUNC | O_RDWR | O_CLOEXEC, 0666);
        if (state->file < 0) return Error::from_errno(Errc::CannotOpen);
        state->temporary = name;
    }
    const std::array<std::byte, kHeaderSize> room_for_header{};
    ENVBAKE_TRY_VOID(state->write(room_for_header));
    return Writer(std::move(state));
}

/// A new entry of the table, into which store_bytes() writes.
Expected<void> Writer::State::open(const ArraySpec& spec) {
    if (!is_valid_name(spec.name)) return Error::at(Errc::BadName, 0, spec.name);
    if (spec.shape.empty() || spec.shape.size() > kMaxRank)
        return Error::at(Errc::EntryRank, 0, spec.name);
    std::uint64_t size = element_size(spec.type);
    const bool open_ended = spec.shape[0] == kOpenEnded;
    if (open_ended && spec.codec != Codec::None) return Error::at(Errc::ArrayCodec, 0, spec.name);
    for (const std::uint64_t extent : std::span(spec.shape).subspan(open_ended ? 1 : 0))
        if (__builtin_mul_overflow(size, extent, &size))
            return Error::at(Errc::EntryShape, 0, spec.name);
    ENVBAKE_TRY_VOID(pad_to_alignment());
    const auto [at, is_new] = entries.try_emplace(spec.name);
    if (!is_new) return Error::at(Errc::DuplicateName, 0, spec.name);
    at->second = Entry{.spec = spec, .offset = position, .size = size};  // open-ended: of a row
    open_entry = &at->second;
    appended = 0;
    XXH3_64bits_reset(&hash);
    return {};
}

Expected<void> Writer::begin(const ArraySpec& spec) {
    State& s = *state_;
    ENVBAKE_TRY_VOID(s.open(spec));
    if (spec.codec == Codec::Zstd) {
#ifdef ENVBAKE_WITH_ZSTD
        if (s.compressor == nullptr) s.compressor = ZSTD_createCCtx();
        s.compressed.resize(ZSTD_CStreamOutSize());
        ZSTD_CCtx_reset(s.compressor, ZSTD_reset_session_only);
        ZSTD_CCtx_setPledgedSrcSize(s.compressor, s.open_entry->size);
#else
        return Error::at(Errc::ArrayCodec, 0, spec.name);
#endif
    }
    return {};
}

Expected<void> Writer::append(std::span<const std::byte> bytes) {
    State& s = *state_;
    s.appended += bytes.size();
    const bool open_ended = s.open_entry->spec.shape[0] == kOpenEnded;
    if (!open_ended && s.appended > s.open_entry->size)
        return Error::at(Errc::WrongByteCount, s.open_entry->offset, s.open_entry->spec.name);
#ifdef ENVBAKE_WITH_ZSTD
    if (s.open_entry->spec.codec == Codec::Zstd) return s.compress(bytes, ZSTD_e_continue);
#endif
    return s.store_bytes(bytes);
}

Expected<void> Writer::end() {
    State& s = *state_;
    if (Entry& entry = *s.open_entry; entry.spec.shape[0] == kOpenEnded && entry.size > 0) {
        entry.spec.shape[0] = s.appended / entry.size;
        entry.size *= entry.spec.shape[0];
    }
    if (s.appended != s.open_entry->size)
        return Error::at(Errc::WrongByteCount, s.open_entry->offset, s.open_entry->spec.name);
#ifdef ENVBAKE_WITH_ZSTD
    if (s.open_entry->spec.codec == Codec::Zstd) ENVBAKE_TRY_VOID(s.compress({}, ZSTD_e_end));
#endif
    s.open_entry->checksum = XXH3_64bits_digest(&s.hash);
    s.open_entry = nullptr;
    return {};
}

Expected<void> Writer::add(const ArraySpec& spec, std::span<const std::byte> bytes) {
    ENVBAKE_TRY_VOID(begin(spec));
    ENVBAKE_TRY_VOID(append(bytes));
    return end();
}

Expected<void> Writer::copy(const Reader& from, const ArrayInfo& array) {
    State& s = *state_;
    ENVBAKE_TRY_VOID(s.open({std::string(array.name),
                             array.type,
                             {array.shape.begin(), array.shape.begin() + array.rank},
                             array.codec}));
    ENVBAKE_TRY_VOID(s.store_bytes(from.stored_bytes(array)));
    s.open_entry->checksum = XXH3_64bits_digest(&s.hash);
    if (s.open_entry->checksum != array.checksum)
        return Error::at(Errc::ArrayChecksum, array.offset, array.name);
    s.open_entry = nullptr;
    return {};
}

Expected<void> Writer::finish() {
    State& s = *state_;
    ENVBAKE_TRY_VOID(s.pad_to_alignment());
    const std::vector<std::byte> table = s.table();
    s.position = s.table_position(table.size());
    if (::lseek(s.file, static_cast<off_t>(s.position), SEEK_SET) < 0)
        return Error::from_errno(Errc::CannotWrite);
    ENVBAKE_TRY_VOID(s.write(table));
    const auto header = s.header(table);
    if (::lseek(s.file, 0, SEEK_SET) != 0) return Error::from_errno(Errc::CannotWrite);
    ENVBAKE_TRY_VOID(write_all(s.file, header.data(), header.size()));
    return s.put_in_place();
}

}  // namespace envbake::format
