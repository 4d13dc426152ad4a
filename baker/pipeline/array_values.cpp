// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/array_values.h"

#include "envbake/runtime/half.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <limits>

namespace envbake {

namespace {

template <class T>
std::vector<double> widen(const std::vector<std::byte>& bytes) {
    std::vector<double> values(bytes.size() / sizeof(T));
    for (std::size_t i = 0; i < values.size(); ++i) {
        T element;
        std::memcpy(&element, bytes.data() + i * sizeof(T), sizeof(T));
        if constexpr (std::is_same_v<T, format::Half>)
            values[i] = static_cast<double>(runtime::half_to_float(element.bits));
        else
            values[i] = static_cast<double>(element);
    }
    return values;
}

std::vector<double> widen(const std::vector<std::byte>& bytes, format::ElementType type) {
    using format::ElementType;
    switch (type) {
        case ElementType::F32:
            return widen<float>(bytes);
        case ElementType::F16:
            return widen<format::Half>(bytes);
        case ElementType::U8:
            return widen<std::uint8_t>(bytes);
        case ElementType::U16:
            return widen<std::uint16_t>(bytes);
        case ElementType::U32:
            return widen<std::uint32_t>(bytes);
        case ElementType::I8:
            return widen<std::int8_t>(bytes);
        case ElementType::I16:
            break;
    }
    return widen<std::int16_t>(bytes);
}

}  // namespace

Expected<format::Reader> open_bundle(const std::filesystem::path& file) {
    auto reader = format::Reader::open(file.c_str());
    if (reader) return std::move(*reader);
    const format::Error& error = reader.error();
    const bool system =
        error.code == format::Errc::CannotOpen || error.code == format::Errc::CannotRead;
    return Error{system ? Errc::Failed : Errc::InvalidBundle,
                 concat(file.string(), ": ", format::to_string(error))};
}

Expected<std::vector<std::byte>> read_bytes(const format::Reader& reader,
                                            const format::ArrayInfo& info) {
    // zstd cannot pack more than this into a byte: a size beyond it is a lie, and is not allocated.
    constexpr std::uint64_t kMostPerByte = 1 << 16;
    if (info.codec == format::Codec::Zstd && info.size / kMostPerByte > info.stored_size)
        return Error{Errc::InvalidBundle, concat("array ", info.name, " claims ", info.size,
                                                 " bytes from ", info.stored_size, " stored")};
    std::vector<std::byte> bytes(static_cast<std::size_t>(info.size));
    if (auto done = reader.read(info, bytes); !done)
        return Error{Errc::InvalidBundle, format::to_string(done.error())};
    return bytes;
}

Expected<std::vector<double>> read_values(const format::Reader& reader,
                                          const format::ArrayInfo& info) {
    ENVBAKE_TRY(const std::vector<std::byte> bytes, read_bytes(reader, info));
    return widen(bytes, info.type);
}

ArrayStatistics statistics(const std::vector<double>& values) {
    ArrayStatistics s;
    s.min = std::numeric_limits<double>::infinity();
    s.max = -s.min;
    double sum = 0;
    for (const double value : values) {
        if (!std::isfinite(value)) {
            ++s.non_finite_count;
            continue;
        }
        s.min = std::min(s.min, value);
        s.max = std::max(s.max, value);
        sum += value;
    }
    const auto finite = values.size() - s.non_finite_count;
    if (finite == 0) return {0, 0, 0, s.non_finite_count};
    s.mean = sum / static_cast<double>(finite);
    return s;
}

bool natural_less(std::string_view a, std::string_view b) {
    const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
    while (!a.empty() && !b.empty()) {
        if (is_digit(a[0]) && is_digit(b[0])) {
            const auto digits = [&](std::string_view s) {
                return static_cast<std::size_t>(std::find_if_not(s.begin(), s.end(), is_digit) -
                                                s.begin());
            };
            const std::string_view x = a.substr(0, digits(a)), y = b.substr(0, digits(b));
            if (x.size() != y.size()) return x.size() < y.size();
            if (x != y) return x < y;
            a.remove_prefix(x.size());
            b.remove_prefix(y.size());
        } else {
            if (a[0] != b[0]) return a[0] < b[0];
            a.remove_prefix(1);
            b.remove_prefix(1);
        }
    }
    return a.size() < b.size();
}

}  // namespace envbake
