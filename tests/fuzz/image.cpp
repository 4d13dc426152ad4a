// SPDX-License-Identifier: Apache-2.0
// Any bytes as an image, by the decoders of the image worker in this process: Radiance by our own,
// OpenEXR's, and OpenImageIO's for PNG and JPEG. In a bake they run in a child that may die.
#include "baker/input/image_worker/codec.h"
#include "tests/support/image_files.h"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <string>
#include <vector>

namespace envbake::worker {

void forget(Bytes) {}

}  // namespace envbake::worker

extern "C" const envbake::worker::OiioCodecs envbake_oiio_codecs;

// OpenImageIO 2.4 loses memory on damaged PNGs: a child ends after every image.
extern "C" const char* __lsan_default_suppressions() {
    return "leak:libOpenImageIO\nleak:libpng\nleak:libjpeg\n";
}

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

/// As libFuzzer's own, but half of the PNGs get the checksums of their chunks made right: what lies
/// behind those is reached.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
    using namespace envbake::worker;
    size = LLVMFuzzerMutate(data, size, max_size);
    if (seed % 2 != 0 || !starts_with({reinterpret_cast<std::byte*>(data), size}, kPngMagic))
        return size;
    // A chunk: size of its data, kind, data, checksum of the last two; numbers are big-endian.
    for (std::size_t at = kPngMagic.size(); at + 12 <= size;) {
        const std::size_t bytes = std::size_t{data[at]} << 24 | std::size_t{data[at + 1]} << 16 |
                                  std::size_t{data[at + 2]} << 8 | data[at + 3];
        if (bytes > size - at - 12) break;
        const std::string summed(reinterpret_cast<const char*>(data + at + 4), bytes + 4);
        const std::uint32_t crc = envbake::test::detail::crc32(summed);
        for (std::size_t i = 0; i < 4; ++i)
            data[at + 8 + bytes + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
        at += 12 + bytes;
    }
    return size;
}

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
        } else if (starts_with(file, kPngMagic) || starts_with(file, kJpegMagic)) {
            envbake_oiio_codecs.decode_rgba8(file, reply, allocate);
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
