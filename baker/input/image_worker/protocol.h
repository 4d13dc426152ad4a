// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

/// What the baker and `envbake-image-worker` say to each other.
///
/// They share one SOCK_SEQPACKET socket, so a message is a message: the baker sends a Request with
/// two file descriptors (input, output) and gets one Reply. The worker forks for every request; the
/// child alone touches the input, and may crash. Pixels never travel through the socket:
///
///     task         input                           output
///     DecodeFloat  the image file                  a memory file, left with 3 floats a texel
///     DecodeRgba8  the image file                  a memory file, left with 4 bytes a texel
///     DecodeDraco  the stream                      a memory file, left with a DracoHeader and what
///                                                  it says
///     EncodePng    3 bytes a texel                 the file to write
///     EncodeGif    frames of 3 bytes a texel       the file to write
///     EncodeExr    3 floats a texel                the file to write
///
/// Both ends are built together and run on one machine: structs go as they lie in memory.
namespace envbake::worker {

inline constexpr std::uint32_t kMagic = 0x31574245;  ///< "EBW1"
inline constexpr int kSocket = 3;                    ///< the worker's end, as inherited

/// Larger images are refused before anything is allocated for them.
inline constexpr int kMaxEdge = 1 << 16;
inline constexpr std::int64_t kMaxTexels = std::int64_t{1} << 28;

enum class Task : std::uint32_t {
    DecodeFloat,
    DecodeRgba8,
    DecodeDraco,
    EncodePng,
    EncodeGif,
    EncodeExr
};

struct Request {
    std::uint32_t magic = kMagic;
    Task task = Task::DecodeFloat;
    std::int32_t width = 0;              ///< Encode only
    std::int32_t height = 0;             ///< Encode only
    std::int32_t frames = 1;             ///< EncodeGif only
    std::int32_t frames_per_second = 0;  ///< EncodeGif only
    std::int32_t threads = 1;
    std::int32_t milliseconds = 0;  ///< wall time that the child may take
};

enum class Outcome : std::uint32_t {
    Crashed,   ///< by a signal, or with a status of its own: `message` is empty
    TimedOut,  ///< `milliseconds` have passed
    Refused,   ///< `message` says why
    Unable,    ///< the worker itself lacks something: `message` says what
    Done,
};

enum class Projection : std::uint32_t { Plain, EnvmapLatLong, EnvmapCube };

struct Reply {
    std::uint32_t magic = kMagic;
    Outcome outcome = Outcome::Crashed;
    std::int32_t width = 0;
    std::int32_t height = 0;
    Projection projection = Projection::Plain;
    std::uint32_t has_chromaticities = 0;
    std::array<std::int32_t, 4> data_window{};     ///< min x, min y, max x, max y, inclusive
    std::array<std::int32_t, 4> display_window{};  ///< likewise
    std::array<float, 8> chromaticities{};         ///< x, y of red, green, blue, white
    std::array<char, 200> message{};               ///< ends in 0
};

/// A triangle mesh that was compressed with Draco: this, the attributes, three indices (u32) a
/// triangle, and the values of each attribute, tightly packed.
struct DracoHeader {
    std::uint32_t vertex_count = 0;
    std::uint32_t attribute_count = 0;
    std::uint64_t index_count = 0;
};
struct DracoAttribute {
    std::uint32_t id = 0;             ///< the stream's own
    std::int32_t component_type = 0;  ///< glTF's number; 0 where glTF has none: there are no values
    std::int32_t component_count = 0;
};
inline constexpr int kMaxDracoComponents = 4;  ///< those of a glTF attribute

/// Bytes of an attribute's value at a vertex; 0 for what the worker does not write.
inline std::size_t bytes_of(const DracoAttribute& a) {
    if (a.component_count < 1 || a.component_count > kMaxDracoComponents) return 0;
    const auto count = static_cast<std::size_t>(a.component_count);
    switch (a.component_type) {
        case 5120:
        case 5121:
            return count;
        case 5122:
        case 5123:
            return 2 * count;
        case 5125:
        case 5126:
            return 4 * count;
        default:
            return 0;
    }
}

/// Bytes that a stream may decode to, and that its decoder may use on the way. The connectivity of
/// a regular grid and values that are all the same take next to nothing.
inline std::uint64_t most_draco_bytes(std::uint64_t stream_bytes) {
    return (std::uint64_t{1} << 30) + 1024 * stream_bytes;
}

}  // namespace envbake::worker
