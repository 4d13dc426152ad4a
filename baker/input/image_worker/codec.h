// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/image_worker/protocol.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

/// The decoders and encoders of the worker. They run in a process that may crash, so they check
/// what lets them refuse early and leave the rest to the libraries.
namespace envbake::worker {

/// An image that is not read, with the reason for the user. Everything that a library throws counts
/// as one as well.
struct Refusal : std::runtime_error {
    using std::runtime_error::runtime_error;
};

using Bytes = std::span<const std::byte>;

/// Gives the memory of a mapped file back: what is touched again is read again. Decoders call it
/// now and then, or a large file would lie in memory beside its pixels.
void forget(Bytes file);

/// Makes room for the pixels of `reply.width` x `reply.height`, `bytes_per_texel` each, in the
/// output.
using AllocatePixels = std::function<std::byte*(std::size_t bytes_per_texel)>;

/// Refuses images that are empty or larger than the limits of protocol.h.
inline void check_size(std::int64_t width, std::int64_t height) {
    const std::string size = std::to_string(width) + " x " + std::to_string(height) + " texels";
    if (width < 1 || height < 1) throw Refusal("it claims " + size);
    if (width > kMaxEdge || height > kMaxEdge || width * height > kMaxTexels) {
        throw Refusal(size + "; at most " + std::to_string(kMaxEdge) + " along an edge and " +
                      std::to_string(kMaxTexels) + " in all are read");
    }
}

// The decoders set every field of `reply` that describes the image, then allocate and fill the
// pixels, rows from the top.

/// Linear RGB floats.
void decode_exr(Bytes file, int threads, Reply& reply, const AllocatePixels& allocate);
void decode_radiance(Bytes file, int threads, Reply& reply, const AllocatePixels& allocate);
std::vector<unsigned char> encode_exr(int width, int height, Bytes rgb);

using WriteBytes = std::function<void(Bytes)>;
/// Writes a Draco mesh as protocol.h says.
void decode_draco(Bytes file, const WriteBytes& write);

/// What needs OpenImageIO. It takes 0.3 s and 100 MB to load, against nothing for OpenEXR, so it
/// sits in a module that the worker loads when it first needs it, under this name:
struct OiioCodecs {
    /// PNG and JPEG to 8-bit RGBA as stored: alpha not multiplied in, no colour conversion.
    void (*decode_rgba8)(Bytes file, Reply& reply, const AllocatePixels& allocate);
    std::vector<unsigned char> (*encode_png)(int width, int height, Bytes rgb);
    std::vector<unsigned char> (*encode_gif)(int width, int height, int frames,
                                             int frames_per_second, Bytes rgb);
};
inline constexpr const char* kOiioModule = "envbake-image-worker-oiio.so";  ///< beside the worker
inline constexpr const char* kOiioSymbol = "envbake_oiio_codecs";

inline bool starts_with(Bytes file, std::span<const unsigned char> magic) {
    if (file.size() < magic.size()) return false;
    for (std::size_t i = 0; i < magic.size(); ++i)
        if (file[i] != std::byte{magic[i]}) return false;
    return true;
}

inline constexpr std::array<unsigned char, 4> kExrMagic{0x76, 0x2f, 0x31, 0x01};
inline constexpr std::array<unsigned char, 2> kRadianceMagic{'#', '?'};
inline constexpr std::array<unsigned char, 8> kPngMagic{0x89, 'P',  'N',  'G',
                                                        '\r', '\n', 0x1a, '\n'};
inline constexpr std::array<unsigned char, 3> kJpegMagic{0xff, 0xd8, 0xff};

}  // namespace envbake::worker
