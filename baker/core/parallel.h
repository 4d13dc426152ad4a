// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

namespace envbake {

/// Calls body(i) once for every i in [0, count), on as many threads as the ThreadLimit in force
/// allows. The split into calls never depends on the number of threads: a body that writes only to
/// slot i gives the same bits on one thread and on sixty-four. Exceptions must not leave the body.
void parallel_for(std::size_t count, const std::function<void(std::size_t)>& body);

/// Caps the threads of parallel_for, and of Embree's builds, while it lives. 0: every core.
class ThreadLimit {
  public:
    explicit ThreadLimit(int threads);
    ~ThreadLimit();
    ThreadLimit(const ThreadLimit&) = delete;
    ThreadLimit& operator=(const ThreadLimit&) = delete;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

/// Threads that parallel_for uses now.
int thread_count();

}  // namespace envbake
