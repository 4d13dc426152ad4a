// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"

#include <cstddef>
#include <filesystem>
#include <span>

namespace envbake {

/// Floats that are written one after another and then all looked at, in a file without a name
/// rather than in memory: the system keeps of it what it has room for. Nothing is left behind,
/// whatever happens.
class RowStore {
  public:
    /// Errors:  Failed  no file can be made in `folder`
    static Expected<RowStore> create(const std::filesystem::path& folder);
    RowStore(RowStore&& other) noexcept;
    RowStore& operator=(RowStore&&) = delete;
    ~RowStore();

    /// Not after map().
    ///
    /// Errors:  Failed  the disk is full
    Expected<void> append(std::span<const float> values);
    std::size_t size() const { return size_; }

    /// All of them, as long as the store lives.
    ///
    /// Errors:  Failed
    Expected<std::span<const float>> map();

  private:
    explicit RowStore(int file) : file_(file) {}

    int file_ = -1;
    std::size_t size_ = 0;  ///< floats
    void* mapping_ = nullptr;
};

}  // namespace envbake
