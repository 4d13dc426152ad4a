// SPDX-License-Identifier: Apache-2.0
#include "baker/core/interrupt.h"

#include <unistd.h>

#include <csignal>
#include <string>
#include <string_view>

namespace envbake {

namespace {

/// Never freed: a signal may come until the very end.
const std::vector<std::string>* names = nullptr;

/// Only what may be called in a signal handler. No thread is stopped first: the system does that
/// faster than they could be asked to.
extern "C" void end(int signal) {
    for (const std::string& name : *names) ::unlink(name.c_str());
    constexpr std::string_view kMessage = "envbake: interrupted\n";
    (void)!::write(STDERR_FILENO, kMessage.data(), kMessage.size());
    ::_exit(128 + signal);
}

}  // namespace

void end_when_interrupted(const std::vector<std::filesystem::path>& temporaries) {
    names = new std::vector<std::string>(temporaries.begin(), temporaries.end());
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
        struct sigaction action {};
        ::sigaction(signal, nullptr, &action);
        if (action.sa_handler == SIG_IGN) continue;
        action = {};
        action.sa_handler = end;
        ::sigaction(signal, &action, nullptr);
    }
}

}  // namespace envbake
