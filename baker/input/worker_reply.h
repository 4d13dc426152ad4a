// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/input/image_worker.h"
#include "baker/input/image_worker/protocol.h"

#include <cstddef>
#include <cstdint>
#include <string>

/// What the worker answers. A decoder that has gone astray may have written anything into its reply
/// and its output: nothing of it is believed before it is checked.
namespace envbake {

/// Why there is no result, for the brackets of a message; empty when there is one.
///   seconds  that it had
std::string complaint(const worker::Reply& reply, double seconds);

/// Maps the pixels that the worker has left in the memory file `file`. It has exactly the size that
/// the reply says, and can no longer shrink under the mapping.
///
/// Errors:  InvalidInput  reply and file do not agree, or more than an image may have
///          Failed        no memory
Expected<SharedPixels> map_pixels(const worker::Reply& reply, std::size_t bytes_per_texel, int file,
                                  const std::string& name);

/// Maps all that the worker has left in the memory file `file`; it can no longer change.
///
/// Errors:  InvalidInput  it is empty, has more than `most` bytes, or can still be written to
///          Failed        no memory
Expected<SharedPixels> map_output(int file, std::uint64_t most, const std::string& name);

}  // namespace envbake
