// SPDX-License-Identifier: Apache-2.0
#include "baker/core/write_file.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

namespace envbake {

Expected<void> check_output(const std::filesystem::path& output,
                            const std::vector<std::filesystem::path>& inputs) {
    std::error_code ignored;  // of a file that does not exist
    const auto status = std::filesystem::status(output, ignored);
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
        return Error{Errc::Usage, concat(output.string(), ": not a regular file")};
    for (const auto& input : inputs)
        if (!input.empty() && std::filesystem::equivalent(output, input, ignored))
            return Error{Errc::Usage,
                         concat(output.string(), ": would overwrite the input ", input.string())};
    return {};
}

std::filesystem::path temporary_of(const std::filesystem::path& file) {
    std::filesystem::path temporary = file;
    temporary += concat(".", ::getpid(), ".tmp");
    return temporary;
}

Expected<void> write_file(const std::filesystem::path& file, std::string_view content) {
    const std::filesystem::path temporary = temporary_of(file);
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
