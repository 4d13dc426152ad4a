// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/writer.h"

#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <new>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace envbake::test {

/// The bytes of a file, where an exactly sized, 64-byte aligned copy of them can be had.
class AlignedBytes {
  public:
    explicit AlignedBytes(std::span<const std::byte> bytes)
        : size_(bytes.size()), memory_(new (std::align_val_t(64)) std::byte[size_ + 1]) {
        std::copy(bytes.begin(), bytes.end(), memory_);
    }
    ~AlignedBytes() { ::operator delete[](memory_, std::align_val_t(64)); }
    AlignedBytes(const AlignedBytes&) = delete;
    AlignedBytes& operator=(const AlignedBytes&) = delete;

    std::span<std::byte> bytes() { return {memory_, size_}; }
    std::span<const std::byte> bytes() const { return {memory_, size_}; }

  private:
    std::size_t size_;
    std::byte* memory_;
};

/// A small bundle, through the real writer, without the baker.
class BundleBuilder {
  public:
    BundleBuilder() {
        static std::atomic<int> serial{0};
        path_ =
            std::filesystem::path(testing::TempDir()) /
            ("envbake-" + std::to_string(::getpid()) + "-" + std::to_string(serial++) + ".envb");
        auto writer = format::Writer::create(path_.string());
        if (!writer) throw std::runtime_error(format::to_string(writer.error()));
        writer_.emplace(*std::move(writer));
    }
    ~BundleBuilder() { std::filesystem::remove(path_); }
    BundleBuilder(const BundleBuilder&) = delete;
    BundleBuilder& operator=(const BundleBuilder&) = delete;

    template <class T>
    BundleBuilder& add(std::string name, std::vector<std::uint64_t> shape,
                       const std::vector<T>& elements, format::Codec codec = format::Codec::None) {
        const auto added =
            writer_->add(std::move(name), std::move(shape), std::span<const T>(elements), codec);
        if (!added) throw std::runtime_error(format::to_string(added.error()));
        return *this;
    }
    BundleBuilder& metadata(const std::string& json) {
        return add(std::string(format::kMetadataName), {json.size()},
                   std::vector<std::uint8_t>(json.begin(), json.end()));
    }

    /// Closes the bundle and gives its path; the file lives as long as the builder.
    std::string finish() {
        if (writer_) {
            const auto finished = writer_->finish();
            if (!finished) throw std::runtime_error(format::to_string(finished.error()));
            writer_.reset();
        }
        return path_.string();
    }
    AlignedBytes finish_in_memory() {
        std::ifstream file(finish(), std::ios::binary);
        const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
        return AlignedBytes(std::as_bytes(std::span(bytes)));
    }

  private:
    std::filesystem::path path_;
    std::optional<format::Writer> writer_;
};

}  // namespace envbake::test
