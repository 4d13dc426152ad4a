// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace envbake::runtime {

/// A value inside a JSON text, found by walking: no tree, no allocation, no recursion. The text is
/// hostile: every read is bounded by it, and nesting beyond kMaxDepth ends a search. What is
/// returned was well formed; what was only skipped is not judged. Of equal keys the first counts.
/// Keys and strings are compared as they stand in the text: one with an escape equals nothing.
class JsonCursor {
  public:
    static constexpr int kMaxDepth = 64;

    /// The value that a document consists of.
    explicit JsonCursor(std::string_view text) : JsonCursor(text, 0) {}

    /// The member at a path of keys, "environment/mips/count"; nothing when any part is absent.
    std::optional<JsonCursor> find(std::string_view path) const {
        JsonCursor value = *this;
        while (true) {
            const std::size_t slash = path.find('/');
            const std::optional<JsonCursor> next = value.member(path.substr(0, slash));
            if (!next || slash == std::string_view::npos) return next;
            value = *next;
            path.remove_prefix(slash + 1);
        }
    }

    /// Calls visit(JsonCursor) for each element of an array, in order, until it returns false.
    /// False: not an array, malformed, or stopped.
    template <class Visit>
    bool for_each_element(Visit visit) const {
        if (peek(at_) != '[') return false;
        std::size_t at = skip_space(at_ + 1);
        if (peek(at) == ']') return true;
        while (true) {
            if (!visit(JsonCursor(text_, at))) return false;
            const std::optional<std::size_t> end = skip_value(at);
            if (!end) return false;
            at = skip_space(*end);
            if (peek(at) == ']') return true;
            if (peek(at) != ',') return false;
            at = skip_space(at + 1);
        }
    }

    bool is_true() const {
        constexpr std::string_view kTrue = "true";
        for (std::size_t i = 0; i < kTrue.size(); ++i) {
            if (peek(at_ + i) != kTrue[i]) return false;
        }
        return ends_value(at_ + kTrue.size());
    }

    /// A string without escapes.
    std::optional<std::string_view> string() const {
        if (peek(at_) != '"') return {};
        const std::optional<std::size_t> end = skip_string(at_);
        if (!end) return {};
        const std::string_view inside = text_.substr(at_ + 1, *end - at_ - 2);
        if (inside.find('\\') != std::string_view::npos) return {};
        return inside;
    }

    /// A number without fraction, exponent or sign, below 2^53.
    std::optional<std::uint64_t> integer() const {
        const std::optional<double> value = number();
        if (!value || *value < 0 || *value >= 0x1p53) return {};
        const auto whole = static_cast<std::uint64_t>(*value);
        if (static_cast<double>(whole) != *value) return {};
        return whole;
    }

    /// A number below 1e300 in magnitude, to within 1e-15 for ordinary exponents.
    std::optional<double> number() const {
        std::size_t at = at_;
        const bool negative = peek(at) == '-';
        if (negative) ++at;
        if (!is_digit(peek(at))) return {};
        double value = 0;
        std::int64_t exponent = 0;
        for (; is_digit(peek(at)); ++at) value = value * 10 + (peek(at) - '0');
        if (peek(at) == '.') {
            if (!is_digit(peek(++at))) return {};
            for (; is_digit(peek(at)); ++at) {
                if (value >= 0x1p60) continue;  // further digits are beyond a double's
                value = value * 10 + (peek(at) - '0');
                --exponent;
            }
        }
        if (peek(at) == 'e' || peek(at) == 'E') {
            const bool down = peek(++at) == '-';
            if (down || peek(at) == '+') ++at;
            if (!is_digit(peek(at))) return {};
            int power = 0;
            for (; is_digit(peek(at)); ++at) {
                if (power < 10000) power = power * 10 + (peek(at) - '0');
            }
            exponent += down ? -power : power;
        }
        if (!ends_value(at) || !(value < kLimit)) return {};
        for (; exponent > 0 && value != 0; --exponent) {
            value *= 10;
            if (!(value < kLimit)) return {};
        }
        for (; exponent < 0 && value != 0; ++exponent) value /= 10;
        return negative ? -value : value;
    }

  private:
    JsonCursor(std::string_view text, std::size_t at) : text_(text), at_(0) {
        at_ = skip_space(at);
    }

    char peek(std::size_t at) const { return at < text_.size() ? text_[at] : '\0'; }
    bool ends_value(std::size_t at) const {
        const char c = peek(at);
        return at >= text_.size() || c == ',' || c == ']' || c == '}' || skip_space(at) != at;
    }
    static constexpr double kLimit = 1e300;
    static bool is_digit(char c) { return c >= '0' && c <= '9'; }

    std::size_t skip_space(std::size_t at) const {
        while (peek(at) == ' ' || peek(at) == '\n' || peek(at) == '\r' || peek(at) == '\t') ++at;
        return at;
    }

    /// From an opening quote to the place after the closing one.
    std::optional<std::size_t> skip_string(std::size_t at) const {
        for (++at; at < text_.size(); ++at) {
            if (text_[at] == '"') return at + 1;
            if (text_[at] == '\\') ++at;
        }
        return {};
    }

    std::optional<std::size_t> skip_value(std::size_t at) const {
        int depth = 0;
        do {
            const std::size_t begin = at;
            switch (peek(at)) {
                case '"': {
                    const std::optional<std::size_t> end = skip_string(at);
                    if (!end) return {};
                    at = *end;
                    break;
                }
                case '{':
                case '[':
                    if (++depth > kMaxDepth) return {};
                    ++at;
                    break;
                case '}':
                case ']':
                    if (--depth < 0) return {};
                    ++at;
                    break;
                case ',':
                case ':':
                    if (depth == 0) return {};
                    ++at;
                    break;
                default:  // a number, true, false, null
                    while (is_digit(peek(at)) || peek(at) == '-' || peek(at) == '+' ||
                           peek(at) == '.' || (peek(at) >= 'a' && peek(at) <= 'z') ||
                           peek(at) == 'E') {
                        ++at;
                    }
                    if (at == begin) return {};
            }
            if (depth > 0) at = skip_space(at);
        } while (depth > 0);
        return at;
    }

    std::optional<JsonCursor> member(std::string_view key) const {
        if (peek(at_) != '{') return {};
        std::size_t at = skip_space(at_ + 1);
        while (peek(at) == '"') {
            const std::optional<std::size_t> key_end = skip_string(at);
            if (!key_end) return {};
            const std::string_view name = text_.substr(at + 1, *key_end - at - 2);
            at = skip_space(*key_end);
            if (peek(at) != ':') return {};
            at = skip_space(at + 1);
            if (name == key) return JsonCursor(text_, at);
            const std::optional<std::size_t> end = skip_value(at);
            if (!end) return {};
            at = skip_space(*end);
            if (peek(at) != ',') return {};
            at = skip_space(at + 1);
        }
        return {};
    }

    std::string_view text_;
    std::size_t at_;
};

}  // namespace envbake::runtime
