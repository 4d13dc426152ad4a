// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cassert>
#include <type_traits>
#include <utility>
#include <variant>

namespace envbake {

/// A value or the reason why there is none. The member names are those of std::expected, which
/// C++20 lacks. T and E must differ. Never throws: reading the side that is absent is a bug and is
/// caught by assert.
template <class T, class E>
class [[nodiscard]] Result {
  public:
    using value_type = T;
    using error_type = E;

    Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
    Result(E error) : state_(std::in_place_index<1>, std::move(error)) {}

    bool has_value() const noexcept { return state_.index() == 0; }
    explicit operator bool() const noexcept { return has_value(); }

    T& value() & noexcept { return *get(); }
    const T& value() const& noexcept { return *get(); }
    T&& value() && noexcept { return std::move(*get()); }
    T& operator*() & noexcept { return *get(); }
    const T& operator*() const& noexcept { return *get(); }
    T&& operator*() && noexcept { return std::move(*get()); }
    T* operator->() noexcept { return get(); }
    const T* operator->() const noexcept { return get(); }

    const E& error() const& noexcept {
        assert(!has_value());
        return *std::get_if<1>(&state_);
    }
    E&& error() && noexcept {
        assert(!has_value());
        return std::move(*std::get_if<1>(&state_));
    }

  private:
    T* get() noexcept {
        assert(has_value());
        return std::get_if<0>(&state_);
    }
    const T* get() const noexcept {
        assert(has_value());
        return std::get_if<0>(&state_);
    }

    std::variant<T, E> state_;
};

/// Success without a value, or an error.
template <class E>
class [[nodiscard]] Result<void, E> {
  public:
    using value_type = void;
    using error_type = E;

    Result() = default;
    Result(E error) : state_(std::in_place_index<1>, std::move(error)) {}

    bool has_value() const noexcept { return state_.index() == 0; }
    explicit operator bool() const noexcept { return has_value(); }
    const E& error() const& noexcept {
        assert(!has_value());
        return *std::get_if<1>(&state_);
    }
    E&& error() && noexcept {
        assert(!has_value());
        return std::move(*std::get_if<1>(&state_));
    }

  private:
    std::variant<std::monostate, E> state_;
};

}  // namespace envbake

#define ENVBAKE_CONCAT_(a, b) a##b
#define ENVBAKE_CONCAT(a, b) ENVBAKE_CONCAT_(a, b)

/// Declares `decl` from the value of `expr`, or returns its error to the caller:
///     ENVBAKE_TRY(const Image image, read_image(file));
#define ENVBAKE_TRY(decl, ...)                                            \
    auto ENVBAKE_CONCAT(envbake_try_, __LINE__) = (__VA_ARGS__);          \
    if (!ENVBAKE_CONCAT(envbake_try_, __LINE__))                          \
        return std::move(ENVBAKE_CONCAT(envbake_try_, __LINE__)).error(); \
    decl = *std::move(ENVBAKE_CONCAT(envbake_try_, __LINE__))

/// Returns the error of a Result<void, E> to the caller, if it holds one.
#define ENVBAKE_TRY_VOID(...)                                         \
    do {                                                              \
        if (auto envbake_try_void = (__VA_ARGS__); !envbake_try_void) \
            return std::move(envbake_try_void).error();               \
    } while (false)
