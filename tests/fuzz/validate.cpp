// SPDX-License-Identifier: Apache-2.0
// Any bytes as a bundle for the validator: every finding has a code, a name and one line.
#include "baker/pipeline/validate.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    auto* const memory = new (std::align_val_t(64)) std::byte[size];  // exactly: ASan sees one more
    if (size > 0) std::memcpy(memory, data, size);
    if (const auto reader = envbake::format::Reader::open({memory, size})) {
        for (const envbake::Finding& finding : envbake::validate_bundle(*reader)) {
            if (finding.code > 0 && !finding.name.empty() && !finding.message.empty() &&
                finding.message.find('\n') == std::string::npos)
                continue;
            std::fprintf(stderr, "%d %s: %s\n", finding.code, finding.name.c_str(),
                         finding.message.c_str());
            std::abort();
        }
    }
    ::operator delete[](memory, std::align_val_t(64));
    return 0;
}
