// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <optional>

namespace envbake {

/// Where a stage says how far it is. Stages only count; somebody else looks and prints.
/// Threads: add() may be called from any.
class Progress {
  public:
    /// A new piece of work of `total` units ("vertices", "texels") begins.
    void begin(const char* what, const char* unit, std::uint64_t total) {
        begun_.store(std::chrono::steady_clock::now());
        done_.store(0);
        rays_.store(0);
        error_squares_.store(0);
        judged_.store(0);
        total_.store(total);
        unit_.store(unit);
        what_.store(what);
    }
    void add(std::uint64_t units, std::uint64_t rays = 0) {
        done_.fetch_add(units, std::memory_order_relaxed);
        rays_.fetch_add(rays, std::memory_order_relaxed);
    }

    /// Estimates of what was done, sum of squares.
    void add_error(double squares, std::uint64_t units) {
        error_squares_.fetch_add(squares, std::memory_order_relaxed);
        judged_.fetch_add(units, std::memory_order_relaxed);
    }

    const char* what() const { return what_.load(); }
    const char* unit() const { return unit_.load(); }
    std::uint64_t done() const { return done_.load(std::memory_order_relaxed); }
    std::chrono::steady_clock::time_point begun() const { return begun_.load(); }
    std::uint64_t rays() const { return rays_.load(std::memory_order_relaxed); }
    std::uint64_t total() const { return total_.load(); }
    /// Rms so far; nothing where the work does not tell.
    std::optional<double> error() const {
        const std::uint64_t judged = judged_.load();
        if (judged == 0) return {};
        return std::sqrt(error_squares_.load() / static_cast<double>(judged));
    }

  private:
    std::atomic<const char*> what_{""};
    std::atomic<const char*> unit_{""};
    std::atomic<std::chrono::steady_clock::time_point> begun_{};
    std::atomic<std::uint64_t> done_{0};
    std::atomic<std::uint64_t> rays_{0};  ///< traced for what is done
    std::atomic<std::uint64_t> total_{0};
    std::atomic<double> error_squares_{0};
    std::atomic<std::uint64_t> judged_{0};
};

}  // namespace envbake
