// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/error.h"
#include "envbake/format/layout.h"
#include "envbake/format/reader.h"
#include "envbake/format/result.h"

#include <cstdint>
#include <initializer_list>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace envbake::format {

/// In the place of the first axis of a shape: as many as will have been appended. Without codec,
/// for a compressed array states its size first.
inline constexpr std::uint64_t kOpenEnded = ~std::uint64_t{0};

/// What an array is, before its bytes are known.
struct ArraySpec {
    std::string name;
    ElementType type = ElementType::F32;
    std::vector<std::uint64_t> shape;  ///< 1 to 6 axes, the first may be kOpenEnded
    Codec codec = Codec::None;
};

/// Writes a bundle, array after array, without holding any in memory. The file stands under its
/// name only once finish() has returned: until then the bytes go to an unnamed file in the same
/// folder (a temporary name where the file system has no unnamed files), and a writer that is
/// destroyed or killed leaves nothing behind; an older bundle stays whole.
class Writer {
  public:
    /// Errors:  CannotOpen
    [[nodiscard]] static Expected<Writer> create(const std::string& path);
    /// The file beside `path` that a writer of this process may leave where it cannot clean up: a
    /// signal handler removes it.
    [[nodiscard]] static std::string temporary_name(const std::string& path);
    Writer(Writer&&) noexcept;
    Writer& operator=(Writer&&) noexcept;
    ~Writer();

    /// Errors:  BadName, DuplicateName, EntryRank, EntryShape, CannotWrite; ArrayCodec
    [[nodiscard]] Expected<void> begin(const ArraySpec& spec);
    [[nodiscard]] Expected<void> append(std::span<const std::byte> bytes);
    /// Errors:  WrongByteCount, CannotWrite
    [[nodiscard]] Expected<void> end();

    /// The three above in one.
    [[nodiscard]] Expected<void> add(const ArraySpec& spec, std::span<const std::byte> bytes);
    template <class T>
    [[nodiscard]] Expected<void> add(std::string name, std::vector<std::uint64_t> shape,
                                     std::span<const T> elements, Codec codec = Codec::None) {
        return add(ArraySpec{std::move(name), kElementTypeOf<T>, std::move(shape), codec},
                   std::as_bytes(elements));
    }

    /// An array of another bundle, byte for byte as it is stored there.
    ///
    /// Errors:  as begin(); CannotWrite, ArrayChecksum
    [[nodiscard]] Expected<void> copy(const Reader& from, const ArrayInfo& array);

    /// Writes the table and the header, flushes to the disk, and puts the file in its place.
    ///
    /// Errors:  CannotWrite
    [[nodiscard]] Expected<void> finish();

  private:
    struct State;
    explicit Writer(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace envbake::format
