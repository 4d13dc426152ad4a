// SPDX-License-Identifier: Apache-2.0
#include "baker/input/image_worker/codec.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

namespace envbake::worker {
namespace {

/// What OpenImageIO says, or a plain word where it says nothing.
std::string reason(const OIIO::ImageInput& input) {
    const std::string text = input.geterror();
    return text.empty() ? "damaged" : text;
}

/// Opens `file` with the decoder of one format: OpenImageIO's own guess goes by file name.
/// `reader` must outlive the result.
std::unique_ptr<OIIO::ImageInput> open(const char* format, OIIO::Filesystem::IOMemReader& reader,
                                       OIIO::ImageSpec& spec) {
    std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::create(format);
    if (!input) throw Refusal(std::string("OpenImageIO lacks the format ") + format);
    OIIO::Filesystem::IOProxy* proxy = &reader;
    OIIO::ImageSpec config;
    config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    config.attribute("oiio:UnassociatedAlpha", 1);
    if (!input->open(std::string("image.") + format, spec, config)) throw Refusal(reason(*input));
    return input;
}

OIIO::Filesystem::IOMemReader reader_of(Bytes file) {
    return {file.data(), file.size()};
}

void decode_rgba8(Bytes file, Reply& reply, const AllocatePixels& allocate) {
    const bool png = starts_with(file, kPngMagic);
    if (!png && !starts_with(file, kJpegMagic)) throw Refusal("neither PNG nor JPEG");
    OIIO::Filesystem::IOMemReader reader = reader_of(file);
    OIIO::ImageSpec spec;
    const auto input = open(png ? "png" : "jpeg", reader, spec);
    check_size(spec.width, spec.height);
    if (spec.nchannels < 1 || spec.nchannels > 4) throw Refusal("not 1 to 4 channels");

    // Deflate packs 1032 bytes into one at most, and a texel takes an eighth of a byte at least; a
    // JPEG block of 8 x 8 takes a bit at least.
    const std::int64_t densest = png ? 1032 * 8 : 64 * 8;
    const std::int64_t texels = std::int64_t{spec.width} * spec.height;
    if (texels / densest > static_cast<std::int64_t>(file.size())) {
        throw Refusal("the file is too short for the size it claims");
    }

    reply.width = spec.width;
    reply.height = spec.height;
    reply.data_window = reply.display_window = {0, 0, spec.width - 1, spec.height - 1};
    auto* const rgba = reinterpret_cast<unsigned char*>(allocate(4));
    constexpr OIIO::stride_t kTexel = 4;
    const OIIO::stride_t row_bytes = kTexel * spec.width;
    // Interlaced PNGs only come whole; the others are no larger than the output either.
    if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::UINT8, rgba, kTexel,
                           row_bytes)) {
        throw Refusal(reason(*input));
    }
    const int channels = spec.nchannels;
    if (channels == 4) return;
    for (std::int64_t i = 0; i < texels; ++i) {
        unsigned char* const p = rgba + 4 * i;
        if (channels == 3) {
            p[3] = 255;
        } else {  // grey, or grey and alpha
            p[3] = channels == 2 ? p[1] : 255;
            p[1] = p[2] = p[0];
        }
    }
}

std::vector<unsigned char> encode_png(int width, int height, Bytes rgb) {
    const auto output = OIIO::ImageOutput::create("png");
    if (!output) throw Refusal("OpenImageIO lacks the format png");
    OIIO::Filesystem::IOVecOutput writer;
    OIIO::Filesystem::IOProxy* proxy = &writer;
    OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::UINT8);
    spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    if (!output->open("image.png", spec) ||
        !output->write_image(OIIO::TypeDesc::UINT8, rgb.data()) || !output->close()) {
        throw Refusal(output->geterror());
    }
    return writer.buffer();
}

std::vector<unsigned char> encode_gif(int width, int height, int frames, int frames_per_second,
                                      Bytes rgb) {
    const auto output = OIIO::ImageOutput::create("gif");
    if (!output) throw Refusal("OpenImageIO lacks the format gif");
    OIIO::Filesystem::IOVecOutput writer;
    OIIO::Filesystem::IOProxy* proxy = &writer;
    OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::UINT8);
    const std::array<int, 2> rate{frames_per_second, 1};
    spec.attribute("FramesPerSecond", OIIO::TypeRational, rate.data());
    spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    const std::vector<OIIO::ImageSpec> specs(static_cast<std::size_t>(frames), spec);
    const std::size_t frame_size = rgb.size() / specs.size();
    bool done = output->open("image.gif", frames, specs.data());
    for (std::size_t k = 0; done && k < specs.size(); ++k) {
        if (k > 0) done = output->open("image.gif", spec, OIIO::ImageOutput::AppendSubimage);
        done = done && output->write_image(OIIO::TypeDesc::UINT8, rgb.data() + k * frame_size);
    }
    if (!done || !output->close()) throw Refusal(output->geterror());
    return writer.buffer();
}

}  // namespace
}  // namespace envbake::worker

// The name is that of kOiioSymbol.
extern "C" const envbake::worker::OiioCodecs envbake_oiio_codecs{
    .decode_rgba8 = envbake::worker::decode_rgba8,
    .encode_png = envbake::worker::encode_png,
    .encode_gif = envbake::worker::encode_gif};
