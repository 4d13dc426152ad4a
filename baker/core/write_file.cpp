// SPDX-License-Identifier: Apache-2.0
#include "baker/core/write_file.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

namespace envbake {

Expected<void> write_file(const std::filesystem::path& file, std::string_view content) {
    std::filesystem::path temporary = file;
    temporary += concat(".", ::getpid(), ".tmp");
    std::ofstream out(temporary, std::ios::binary);
    out.write(content.data(), static_cast<std::streamsize>(content.size()));
    out.close();
    std::error_code renamed;
    if (out) std::filesystem::rename(temporary, file, renamed);
    if (out && !renamed) return {};
    const std::string reason = renamed ? renamed.message() : std::strerror(errno);
    std::error_code ignored;
    std::filesystem::remove(temporary, ignored);
    return Error{Errc::Failed, concat(file.string(), ": cannot be written: ", reason)};
}

}  // namespace envbake
