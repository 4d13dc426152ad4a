// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/core/error.h"
#include "baker/input/scene.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

/// Images in and out, and Draco meshes in, by way of `envbake-image-worker`.
///
/// The libraries that know image formats are large to load and crash on some damaged files, and so
/// does Draco: the baker never links them. A small program does, which is started at the first call
/// and serves until the baker ends. It forks for every image. A decoder that crashes, hangs or asks
/// for too much memory costs one error message.
///
/// The program is looked for beside the running executable, then in ../libexec/envbake.
/// Threads: every function may be called from any; images are worked on one after another.
namespace envbake {

/// Which way an EXR `envmap` attribute maps texels to directions.
enum class Envmap { None, LatLong, Cube };

/// A rectangle of texels, inclusive, as OpenEXR has it: y downwards.
struct TexelWindow {
    int min_x = 0;
    int min_y = 0;
    int max_x = 0;
    int max_y = 0;

    friend bool operator==(const TexelWindow&, const TexelWindow&) = default;
};

/// Memory shared with the worker; freed with its owner.
class SharedPixels {
  public:
    SharedPixels() = default;
    SharedPixels(void* begin, std::size_t size)
        : begin_(static_cast<std::byte*>(begin)), size_(size) {}
    SharedPixels(SharedPixels&& other) noexcept;
    SharedPixels& operator=(SharedPixels&& other) noexcept;
    ~SharedPixels();

    std::span<const std::byte> bytes() const { return {begin_, size_}; }
    /// Gives the first `size` bytes back to the system; they read as 0 from now on.
    void release_front(std::size_t size);

  private:
    std::byte* begin_ = nullptr;
    std::size_t size_ = 0;
    std::size_t released_ = 0;
};

/// An image as its file has it: nothing converted, repaired or reordered.
struct FloatImage {
    int width = 0;  ///< of the data window, texels
    int height = 0;
    Envmap envmap = Envmap::None;
    TexelWindow data_window;
    TexelWindow display_window;
    std::optional<std::array<float, 8>> chromaticities;  ///< CIE x, y of red, green, blue, white
    SharedPixels pixels;

    /// Row `y` from the top: 3 * width floats, R, G, B.
    std::span<const float> row(int y) const;
    /// Frees the memory of the rows before `y`, for readers that go from the top to the bottom.
    void release_rows_before(int y);
};

struct ImageLimits {
    double seconds = 60;  ///< wall time for one image
};

/// Reads a Radiance .hdr (32-bit_rle_rgbe, rows from the top left; its EXPOSURE is not divided out,
/// as in every common reader) or an OpenEXR file: scan lines or tiles (the finest level), any
/// compression, the first part that has R, G, B or else Y (grey), or one layer that has them; alpha
/// and all other channels are passed over. The content decides which it is, not the name.
///
/// Errors:  InvalidInput  not readable as an image: "FILE: not a readable image (REASON)"
///          Failed        the file cannot be opened, or the worker cannot be started
Expected<FloatImage> decode_float_image(const std::filesystem::path& file,
                                        const ImageLimits& limits = {});

/// Decodes a PNG or JPEG file that lies in memory. Values as stored: no colour conversion, alpha
/// not multiplied in, 16 bits rounded to 8.
///
///   name    what the image is called in messages, and Image::name
///
/// Errors:  as decode_float_image
Expected<Image> decode_image(std::span<const std::byte> encoded, const std::string& name,
                             const ImageLimits& limits = {});

/// Decodes a Draco stream to what image_worker/protocol.h says of DecodeDraco: bytes that are still
/// to be distrusted.
///
/// Errors:  InvalidInput  not readable: "the Draco stream cannot be decoded (REASON)"
///          Failed        the worker cannot be started
Expected<SharedPixels> decode_draco_stream(std::span<const std::byte> stream);

/// Writes an 8-bit RGB PNG; `rgb` holds 3 * width * height bytes, rows from the top, already
/// encoded as they are to be shown (sRGB). The file appears under its name when it is whole.
///
/// Errors:  Failed  the file cannot be written, or the worker cannot be started
Expected<void> write_png(const std::filesystem::path& file, int width, int height,
                         std::span<const std::uint8_t> rgb);

/// Writes `frames` pictures, one after the other in `rgb`, as an animated GIF that runs for ever:
/// 256 colours a frame. Else as write_png.
Expected<void> write_gif(const std::filesystem::path& file, int width, int height, int frames,
                         int frames_per_second, std::span<const std::uint8_t> rgb);

/// Writes a float RGB OpenEXR file, ZIP-compressed: every bit pattern comes back. Else as
/// write_png.
Expected<void> write_exr(const std::filesystem::path& file, int width, int height,
                         std::span<const float> rgb);

/// Starts the worker without waiting for it. Optional: its start-up then overlaps other work.
void start_image_worker();

}  // namespace envbake
