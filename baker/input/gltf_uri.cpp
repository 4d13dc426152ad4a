// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_uri.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <fstream>
#include <system_error>

namespace envbake::gltf {

namespace {

Error refuse(std::string message) {
    return {Errc::InvalidInput, std::move(message)};
}

int base64_digit(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    if (c == '+') return 62;
    if (c == '/') return 63;
    return -1;
}

int hex_digit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

/// "%20" becomes a space; a '%' that starts no escape stays.
std::string percent_decoded(std::string_view text) {
    std::string out;
    out.reserve(text.size());
    for (std::size_t i = 0; i < text.size(); ++i) {
        const bool escape = text[i] == '%' && i + 2 < text.size() && hex_digit(text[i + 1]) >= 0 &&
                            hex_digit(text[i + 2]) >= 0;
        if (escape) {
            out.push_back(static_cast<char>(hex_digit(text[i + 1]) * 16 + hex_digit(text[i + 2])));
            i += 2;
        } else {
            out.push_back(text[i]);
        }
    }
    return out;
}

/// scheme ":" with scheme = letter *(letter / digit / "+" / "-" / ".")  [RFC 3986, 3.1]
bool has_scheme(std::string_view uri) {
    const std::size_t colon = uri.find(':');
    if (colon == std::string_view::npos || colon == 0) return false;
    const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
    return letter(uri[0]) &&
           std::all_of(uri.begin(), uri.begin() + static_cast<long>(colon), [&](char c) {
               return letter(c) || (c >= '0' && c <= '9') || c == '+' || c == '-' || c == '.';
           });
}

Expected<std::vector<std::byte>> decode_base64(std::string_view text) {
    while (!text.empty() && text.back() == '=') text.remove_suffix(1);
    if (text.size() % 4 == 1) return refuse("the base64 data ends in the middle of a byte");
    std::vector<std::byte> out;
    out.reserve(text.size() / 4 * 3 + 2);
    std::uint32_t bits = 0;
    int bit_count = 0;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const int digit = base64_digit(text[i]);
        if (digit < 0) return refuse(concat("character ", i, " of the data is not base64"));
        bits = (bits << 6 | static_cast<std::uint32_t>(digit)) & 0xffffff;
        bit_count += 6;
        if (bit_count >= 8) {
            bit_count -= 8;
            out.push_back(static_cast<std::byte>(bits >> bit_count & 0xff));
        }
    }
    return out;
}

}  // namespace

std::string shown(std::string_view text) {
    constexpr std::size_t kMaxShown = 80;
    const bool cut = text.size() > kMaxShown;
    const std::string head(cut ? text.substr(0, kMaxShown) : text);
    return nlohmann::json(head).dump(-1, ' ', false, nlohmann::json::error_handler_t::ignore) +
           (cut ? "..." : "");
}

bool is_data_uri(std::string_view uri) {
    constexpr std::string_view kScheme = "data:";
    return uri.size() >= kScheme.size() &&
           std::equal(kScheme.begin(), kScheme.end(), uri.begin(), [](char a, char b) {
               return a == (b >= 'A' && b <= 'Z' ? b - 'A' + 'a' : b);
           });
}

Expected<std::vector<std::byte>> decode_data_uri(std::string_view uri) {
    const std::size_t comma = uri.find(',');
    if (!is_data_uri(uri) || comma == std::string_view::npos)
        return refuse("a data URI is data:<media type>;base64,<data>");
    std::string_view head = uri.substr(5, comma - 5);
    constexpr std::string_view kMarker = ";base64";
    if (head.size() < kMarker.size() || head.substr(head.size() - kMarker.size()) != kMarker)
        return refuse("a data URI that is not base64 is not supported");
    head.remove_suffix(kMarker.size());
    if (!head.empty() && (head.back() == ';' || head.find(";;") != std::string_view::npos))
        return refuse("the data URI has an empty parameter (two semicolons in a row)");
    return decode_base64(uri.substr(comma + 1));
}

Expected<std::filesystem::path> resolve_uri(const std::filesystem::path& folder,
                                            const std::string& uri) {
    const std::string decoded = percent_decoded(uri);
    if (decoded.empty()) return refuse("the URI is empty");
    if (decoded.find('\0') != std::string::npos) return refuse("the URI contains a NUL");
    if (has_scheme(uri))
        return refuse(concat("the URI ", shown(uri),
                             " has a scheme: only files relative to the scene are read"));
    if (decoded[0] == '/' || decoded[0] == '\\')
        return refuse(concat("the URI ", shown(uri),
                             " is absolute: only files relative to the scene are read"));
    std::error_code ignored;
    for (const std::string& name : {decoded, uri}) {
        const std::filesystem::path path = folder / name;
        if (std::filesystem::is_regular_file(path, ignored)) return path;
    }
    return refuse(concat("there is no file ", shown(uri)));
}

Expected<std::vector<std::byte>> read_bytes(const std::filesystem::path& file,
                                            std::uint64_t max_bytes) {
    std::error_code failure;
    const std::uint64_t size = std::filesystem::file_size(file, failure);
    if (failure) return Error{Errc::Failed, failure.message()};
    std::ifstream stream(file, std::ios::binary);
    if (!stream) return Error{Errc::Failed, "cannot be opened"};
    std::vector<std::byte> bytes(static_cast<std::size_t>(std::min(size, max_bytes)));
    if (!bytes.empty() && !stream.read(reinterpret_cast<char*>(bytes.data()),
                                       static_cast<std::streamsize>(bytes.size())))
        return Error{Errc::Failed, "cannot be read"};
    return bytes;
}

}  // namespace envbake::gltf
