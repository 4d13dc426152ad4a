// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/array_values.h"

#include "envbake/runtime/half.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>
#include <type_traits>

namespace envbake {

namespace {

template <class T, class Visit>
void visit_elements(std::span<const std::byte> bytes, Visit&& visit) {
    for (std::size_t at = 0; at + sizeof(T) <= bytes.size(); at += sizeof(T)) {
        T element;
        std::memcpy(&element, bytes.data() + at, sizeof(T));
        if constexpr (std::is_same_v<T, format::Half>)
            visit(static_cast<double>(runtime::half_to_float(element.bits)));
        else
            visit(static_cast<double>(element));
    }
}

/// Calls visit(double) for every element.
template <class Visit>
void visit_values(std::span<const std::byte> bytes, format::ElementType type, Visit&& visit) {
    using format::ElementType;
    switch (type) {
        case ElementType::F32:
            return visit_elements<float>(bytes, visit);
        case ElementType::F16:
            return visit_elements<format::Half>(bytes, visit);
        case ElementType::U8:
            return visit_elements<std::uint8_t>(bytes, visit);
        case ElementType::U16:
            return visit_elements<std::uint16_t>(bytes, visit);
        case ElementType::U32:
            return visit_elements<std::uint32_t>(bytes, visit);
        case ElementType::I8:
            return visit_elements<std::int8_t>(bytes, visit);
        case ElementType::I16:
            return visit_elements<std::int16_t>(bytes, visit);
    }
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
    if (!reader.size_is_plausible(info))
        return Error{Errc::InvalidBundle,
                     concat("array ", info.name, ": what is stored does not decode to the ",
                            info.size, " bytes of its shape")};
    std::vector<std::byte> bytes(static_cast<std::size_t>(info.size));
    if (auto done = reader.read(info, bytes); !done)
        return Error{Errc::InvalidBundle, format::to_string(done.error())};
    return bytes;
}

Expected<std::vector<double>> read_values(const format::Reader& reader,
                                          const format::ArrayInfo& info) {
    ENVBAKE_TRY(const std::vector<std::byte> bytes, read_bytes(reader, info));
    std::vector<double> values;
    values.reserve(static_cast<std::size_t>(info.element_count()));
    visit_values(bytes, info.type, [&](double value) { values.push_back(value); });
    return values;
}

Expected<ArrayStatistics> statistics(const format::Reader& reader, const format::ArrayInfo& info) {
    std::vector<std::byte> decoded;
    std::span<const std::byte> bytes = reader.stored_bytes(info);
    if (info.codec != format::Codec::None) {
        ENVBAKE_TRY(decoded, read_bytes(reader, info));
        bytes = decoded;
    }
    ArrayStatistics s;
    s.min = std::numeric_limits<double>::infinity();
    s.max = -s.min;
    double sum = 0;
    visit_values(bytes, info.type, [&](double value) {
        if (!std::isfinite(value)) {
            ++s.non_finite_count;
            return;
        }
        s.min = std::min(s.min, value);
        s.max = std::max(s.max, value);
        sum += value;
    });
    const std::uint64_t finite = info.element_count() - s.non_finite_count;
    if (finite == 0) return ArrayStatistics{0, 0, 0, s.non_finite_count};
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
