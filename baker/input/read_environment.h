// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/input/environment.h"

#include <filesystem>

namespace envbake {

struct ReadEnvironmentOptions {
    bool strict = false;  ///< refuse non-finite and negative texels instead of repairing them
};

/// Reads a .hdr or .exr image as an environment. The shape decides what it is: an EXR `envmap`
/// attribute is obeyed (lat-long or cube, by OpenEXR's own convention), 6:1 and 1:6 are strips of
/// faces, 4:3 and 3:4 are crosses, everything else is equirectangular.
///
/// Errors:  InvalidInput  not readable as an image, no pixels, or texels refused by `strict`
///          Failed        the file cannot be opened, or the image worker cannot be started
Expected<Environment> read_environment(const std::filesystem::path& file,
                                       const ReadEnvironmentOptions& options = {});

}  // namespace envbake
