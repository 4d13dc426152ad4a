// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/file_hash.h"

#include "envbake/format/reader.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>

namespace envbake {

std::string hash_text(std::span<const std::byte> bytes) {
    std::array<char, 17> text{};
    std::snprintf(text.data(), text.size(), "%016llx",
                  static_cast<unsigned long long>(format::checksum(bytes)));
    return text.data();
}

Expected<FileHash> hash_file(const std::filesystem::path& file) {
    const auto refused = [&file] {
        return Error{Errc::Failed,
                     concat(file.string(), ": cannot be read: ", std::strerror(errno))};
    };
    const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) return refused();
    struct stat status {};
    if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
        ::close(descriptor);
        return Error{Errc::Failed, concat(file.string(), ": not a regular file")};
    }
    FileHash hash;
    hash.bytes = static_cast<std::uint64_t>(status.st_size);
    hash.xxh3 = hash_text({});
    if (hash.bytes > 0) {
        const auto size = static_cast<std::size_t>(hash.bytes);
        void* mapping = ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, descriptor, 0);
        if (mapping == MAP_FAILED) {
            ::close(descriptor);
            return refused();
        }
        hash.xxh3 = hash_text({static_cast<const std::byte*>(mapping), size});
        ::munmap(mapping, size);
    }
    ::close(descriptor);
    return hash;
}

}  // namespace envbake
