// SPDX-License-Identifier: Apache-2.0
#include "baker/input/worker_reply.h"

#include "baker/core/text.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include <algorithm>
#include <string_view>

namespace envbake {
namespace {

Error nonsense(const std::string& name) {
    return {Errc::InvalidInput, concat(name, ": its decoder answers nonsense")};
}

/// What the worker says in words.
std::string text_of(const worker::Reply& reply) {
    const auto end = std::find(reply.message.begin(), reply.message.end(), '\0');
    if (end == reply.message.begin()) return "damaged";
    return printable(std::string_view(reply.message.begin(), end));
}

/// Bytes in a file that gets these seals; -1 where it cannot.
off_t sealed_size(int file, int seals) {
    struct stat info {};
    if (fcntl(file, F_ADD_SEALS, seals) != 0 || fstat(file, &info) != 0) return -1;
    return info.st_size;
}

Expected<SharedPixels> map(int file, std::size_t size, int protection, const std::string& name) {
    void* const at = mmap(nullptr, size, protection, MAP_SHARED, file, 0);
    if (at == MAP_FAILED)
        return Error{Errc::Failed,
                     concat(name, ": no memory for ", size, " bytes of what it decodes to")};
    return SharedPixels(at, size);
}

}  // namespace

std::string complaint(const worker::Reply& reply, double seconds) {
    switch (reply.outcome) {
        case worker::Outcome::Done:
            return {};
        case worker::Outcome::Refused:
        case worker::Outcome::Unable:
            return text_of(reply);
        case worker::Outcome::TimedOut:
            return concat("it takes more than ", seconds, " s");
        case worker::Outcome::Crashed:
            break;
    }
    return "its decoder crashed";
}

Expected<SharedPixels> map_pixels(const worker::Reply& reply, std::size_t bytes_per_texel, int file,
                                  const std::string& name) {
    if (reply.width < 1 || reply.height < 1 || reply.width > worker::kMaxEdge ||
        reply.height > worker::kMaxEdge ||
        std::int64_t{reply.width} * reply.height > worker::kMaxTexels)
        return nonsense(name);
    const std::size_t size = static_cast<std::size_t>(reply.width) *
                             static_cast<std::size_t>(reply.height) * bytes_per_texel;
    if (sealed_size(file, F_SEAL_SHRINK) != static_cast<off_t>(size)) return nonsense(name);
    return map(file, size, PROT_READ | PROT_WRITE, name);
}

Expected<SharedPixels> map_output(int file, std::uint64_t most, const std::string& name) {
    const off_t size = sealed_size(file, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE);
    if (size < 1 || static_cast<std::uint64_t>(size) > most) return nonsense(name);
    return map(file, static_cast<std::size_t>(size), PROT_READ, name);
}

}  // namespace envbake
