// SPDX-License-Identifier: Apache-2.0
#include "baker/core/row_store.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>

namespace envbake {

namespace {

Error system_error(const char* what) {
    return {Errc::Failed, concat("file for transport that waits to be encoded: ", what, ": ",
                                 std::strerror(errno))};
}

}  // namespace

Expected<RowStore> RowStore::create(const std::filesystem::path& folder) {
    const std::string where = folder.empty() ? "." : folder.string();
    int file = open(where.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (file < 0) {  // a file system without unnamed files
        std::string name = where + "/.envbake-XXXXXX";
        file = mkostemp(name.data(), O_CLOEXEC);
        if (file >= 0) unlink(name.c_str());
    }
    if (file < 0) return system_error("cannot be made");
    return RowStore(file);
}

RowStore::RowStore(RowStore&& other) noexcept
    : file_(std::exchange(other.file_, -1)),
      size_(std::exchange(other.size_, 0)),
      mapping_(std::exchange(other.mapping_, nullptr)) {}

RowStore::~RowStore() {
    if (mapping_ != nullptr) munmap(mapping_, size_ * sizeof(float));
    if (file_ >= 0) close(file_);
}

Expected<void> RowStore::append(std::span<const float> values) {
    const std::span<const std::byte> bytes = std::as_bytes(values);
    for (std::size_t done = 0; done < bytes.size();) {
        const ssize_t written = write(file_, bytes.data() + done, bytes.size() - done);
        if (written < 0 && errno == EINTR) continue;
        if (written < 0) return system_error("cannot be written");
        done += static_cast<std::size_t>(written);
    }
    size_ += values.size();
    return {};
}

Expected<std::span<const float>> RowStore::map() {
    if (mapping_ == nullptr && size_ > 0) {
        void* mapping = mmap(nullptr, size_ * sizeof(float), PROT_READ, MAP_SHARED, file_, 0);
        if (mapping == MAP_FAILED) return system_error("cannot be mapped");
        mapping_ = mapping;
    }
    return std::span<const float>(static_cast<const float*>(mapping_), size_);
}

}  // namespace envbake
