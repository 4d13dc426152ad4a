// SPDX-License-Identifier: Apache-2.0
// Any bytes as a Radiance or OpenEXR image, by the decoders of the image worker in this process:
// the first is our own, the second OpenEXR's. In a bake they run in a child that may die.
#include "baker/input/image_worker/codec.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <vector>

namespace envbake::worker {

void forget(Bytes) {}

}  // namespace envbake::worker

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace envbake::worker;
    const Bytes file(reinterpret_cast<const std::byte*>(data), size);
    Reply reply;
    std::vector<std::byte> pixels;
    const AllocatePixels allocate = [&](std::size_t bytes_per_texel) {
        check_size(reply.width, reply.height);
        const std::size_t bytes = static_cast<std::size_t>(reply.width) *
                                  static_cast<std::size_t>(reply.height) * bytes_per_texel;
        if (bytes > (std::size_t{64} << 20)) throw std::bad_alloc();
        pixels.resize(bytes);
        return pixels.data();
    };
    try {
        if (starts_with(file, kExrMagic)) {
            decode_exr(file, 1, reply, allocate);
        } else if (starts_with(file, kRadianceMagic)) {
            decode_radiance(file, 1, reply, allocate);
        } else {
            return 0;
        }
    } catch (const std::exception&) {
        return 0;  // refused
    }
    if (!pixels.empty()) return 0;
    std::fprintf(stderr, "an image without pixels\n");
    std::abort();
}
