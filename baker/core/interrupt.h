// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <vector>

namespace envbake {

/// From now on SIGINT (Ctrl-C), SIGTERM and SIGHUP end the process at once, whatever its threads
/// are doing, with exit status 128 + the signal's number, and remove `temporaries` where they
/// exist. A signal that the process was started to ignore (nohup) stays ignored. Called once.
void end_when_interrupted(const std::vector<std::filesystem::path>& temporaries);

}  // namespace envbake
