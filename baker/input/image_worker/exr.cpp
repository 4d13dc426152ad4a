// SPDX-License-Identifier: Apache-2.0
#include "baker/input/image_worker/codec.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfOutputFile.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfThreading.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <set>
#include <string>

namespace envbake::worker {
namespace {

/// A file that lies in memory.
class MemoryIn : public Imf::IStream {
  public:
    explicit MemoryIn(Bytes file) : Imf::IStream(""), file_(file) {}

    bool read(char* to, int count) override {
        const auto wanted = static_cast<std::uint64_t>(std::max(count, 0));
        if (position_ > file_.size() || wanted > file_.size() - position_) {
            throw Refusal("the file ends early");
        }
        std::memcpy(to, file_.data() + position_, wanted);
        position_ += wanted;
        if ((since_forget_ += wanted) >= kForget) {
            forget(file_);
            since_forget_ = 0;
        }
        return position_ < file_.size();
    }
    std::uint64_t tellg() override { return position_; }
    void seekg(std::uint64_t position) override { position_ = position; }

  private:
    static constexpr std::uint64_t kForget = std::uint64_t{4} << 20;
    Bytes file_;
    std::uint64_t position_ = 0;
    std::uint64_t since_forget_ = 0;  ///< bytes read
};

class MemoryOut : public Imf::OStream {
  public:
    MemoryOut() : Imf::OStream("") {}

    void write(const char* from, int count) override {
        const auto size = static_cast<std::size_t>(count);
        if (bytes.size() < position_ + size) bytes.resize(position_ + size);
        std::memcpy(bytes.data() + position_, from, size);
        position_ += size;
    }
    std::uint64_t tellp() override { return position_; }
    void seekp(std::uint64_t position) override { position_ = position; }

    std::vector<unsigned char> bytes;

  private:
    std::size_t position_ = 0;
};

/// The names of the channels that make up the picture.
struct Channels {
    std::string r, g, b;
};

/// Plain R, G, B; else luminance alone; else the one layer that has R, G, B. None: the part has no
/// picture, e.g. only depth.
std::optional<Channels> picture_channels(const Imf::ChannelList& list) {
    const auto has = [&](const std::string& name) { return list.findChannel(name) != nullptr; };
    if (has("R") && has("G") && has("B")) return Channels{"R", "G", "B"};
    if (has("Y")) {
        if (has("RY") || has("BY")) {
            throw Refusal("luminance-chroma channels Y, RY, BY: store the image as R, G, B");
        }
        return Channels{"Y", "Y", "Y"};
    }
    std::vector<std::string> layers;
    for (auto channel = list.begin(); channel != list.end(); ++channel) {
        const std::string name = channel.name();
        if (name.size() < 3 || !name.ends_with(".R")) continue;
        const std::string layer = name.substr(0, name.size() - 1);
        if (has(layer + "G") && has(layer + "B")) layers.push_back(layer);
    }
    if (layers.size() > 1) {
        throw Refusal("no R, G, B channels, and more than one layer that has them: " + layers[0] +
                      "R, " + layers[1] + "R");
    }
    if (layers.empty()) return std::nullopt;
    return Channels{layers[0] + "R", layers[0] + "G", layers[0] + "B"};
}

bool is_deep(const Imf::Header& header) {
    return header.hasType() &&
           (header.type() == Imf::DEEPSCANLINE || header.type() == Imf::DEEPTILE);
}

/// Walks over the attributes of every header: none may claim more bytes than the file has left.
/// OpenEXR 3.1 sets memory aside for what an attribute claims before it reads it. All other faults
/// are left for it to find.
void check_attributes(Bytes file) {
    constexpr std::size_t kMagicAndVersion = 8, kSize = 4;
    constexpr unsigned char kMultiPart = 0x10;  // bit 12 of the version field
    if (file.size() < kMagicAndVersion) return;
    const bool multi_part = (static_cast<unsigned char>(file[5]) & kMultiPart) != 0;
    std::size_t at = kMagicAndVersion;
    const auto end_of_text = [&](std::size_t from) {
        while (from < file.size() && static_cast<unsigned char>(file[from]) != 0) ++from;
        return from;
    };
    for (bool header_began = false; at < file.size();) {
        const std::size_t name_end = end_of_text(at);
        if (name_end == at) {  // the end of a header; of the last one, or an empty one
            if (!multi_part || !header_began) return;
            header_began = false;
            ++at;
            continue;
        }
        header_began = true;
        const std::size_t type_end = end_of_text(name_end + 1);
        if (type_end + 1 + kSize > file.size()) return;
        std::int32_t size = 0;
        std::memcpy(&size, file.data() + type_end + 1, kSize);
        at = type_end + 1 + kSize;
        if (size < 0 || static_cast<std::size_t>(size) > file.size() - at)
            throw Refusal("an attribute claims " + std::to_string(size) + " bytes, the file has " +
                          std::to_string(file.size() - at) + " left");
        at += static_cast<std::size_t>(size);
    }
}

/// Every chunk of the file costs at least an entry of the offset table, its own header and a byte.
void check_chunks(const Imf::Header& header, std::int64_t width, std::int64_t height,
                  std::size_t file_size) {
    std::int64_t chunk_width = width, chunk_height = 256;  // DWAB holds the most rows: 256
    if (header.hasTileDescription()) {
        chunk_width = header.tileDescription().xSize;
        chunk_height = header.tileDescription().ySize;
        if (chunk_width < 1 || chunk_height < 1 || chunk_width * chunk_height > kMaxTexels) {
            throw Refusal("tiles of an impossible size");
        }
    }
    constexpr std::int64_t kLeastBytes = 8 + 8 + 1;
    const std::int64_t chunks =
        ((width + chunk_width - 1) / chunk_width) * ((height + chunk_height - 1) / chunk_height);
    if (chunks * kLeastBytes > static_cast<std::int64_t>(file_size)) {
        throw Refusal("the file is too short for the size it claims");
    }
}

}  // namespace

void decode_exr(Bytes file, int threads, Reply& reply, const AllocatePixels& allocate) {
    Imf::Header::setMaxImageSize(kMaxEdge, kMaxEdge);
    Imf::Header::setMaxTileSize(kMaxEdge, kMaxEdge);
    check_attributes(file);
    MemoryIn stream(file);
    constexpr bool kRebuildOffsets = false;  // an unfinished file is refused, not guessed at
    Imf::MultiPartInputFile input(stream, std::max(threads, 1), kRebuildOffsets);

    bool found_deep = false;
    int part_index = -1;
    Channels channels;
    for (int i = 0; i < input.parts() && part_index < 0; ++i) {
        if (is_deep(input.header(i))) {
            found_deep = true;
        } else if (const auto found = picture_channels(input.header(i).channels())) {
            part_index = i;
            channels = *found;
        }
    }
    if (part_index < 0) {
        throw Refusal(found_deep ? "deep data, which has no one colour a texel"
                                 : "no R, G, B or Y channels");
    }

    const Imf::Header& header = input.header(part_index);
    const Imath::Box2i data = header.dataWindow();
    const Imath::Box2i display = header.displayWindow();
    const std::int64_t width = std::int64_t{data.max.x} - data.min.x + 1;
    const std::int64_t height = std::int64_t{data.max.y} - data.min.y + 1;
    check_size(width, height);
    check_chunks(header, width, height, file.size());

    for (const std::string& name : {channels.r, channels.g, channels.b}) {
        const Imf::Channel& channel = header.channels()[name];
        if (channel.xSampling != 1 || channel.ySampling != 1) {
            throw Refusal("channel " + name + " is subsampled");
        }
    }

    reply.width = static_cast<std::int32_t>(width);
    reply.height = static_cast<std::int32_t>(height);
    reply.data_window = {data.min.x, data.min.y, data.max.x, data.max.y};
    reply.display_window = {display.min.x, display.min.y, display.max.x, display.max.y};
    if (Imf::hasEnvmap(header)) {
        switch (Imf::envmap(header)) {
            case Imf::ENVMAP_LATLONG:
                reply.projection = Projection::EnvmapLatLong;
                break;
            case Imf::ENVMAP_CUBE:
                reply.projection = Projection::EnvmapCube;
                break;
            default:
                throw Refusal("an envmap attribute of an unknown kind");
        }
    }
    if (Imf::hasChromaticities(header)) {
        const Imf::Chromaticities& c = Imf::chromaticities(header);
        reply.has_chromaticities = 1;
        reply.chromaticities = {c.red.x,  c.red.y,  c.green.x, c.green.y,
                                c.blue.x, c.blue.y, c.white.x, c.white.y};
    }

    // Luminance comes as Y, Y, Y: a frame buffer takes a name once, so it is read into red and
    // copied.
    const bool luminance = channels.r == channels.g;
    float* const pixels = reinterpret_cast<float*>(allocate(3 * sizeof(float)));
    const std::size_t row_floats = 3 * static_cast<std::size_t>(width);
    const auto slice = [&](int channel) {
        return Imf::Slice::Make(Imf::FLOAT, pixels + channel, data, 3 * sizeof(float),
                                row_floats * sizeof(float));
    };
    Imf::FrameBuffer buffer;
    buffer.insert(channels.r, slice(0));
    if (!luminance) {
        buffer.insert(channels.g, slice(1));
        buffer.insert(channels.b, slice(2));
    }
    Imf::InputPart part(input, part_index);
    part.setFrameBuffer(buffer);

    // In blocks from the top: a file that lies fails at its first wrong chunk, before the output,
    // which only exists where it is written to, has grown. 256 rows fill whole chunks of every
    // compression.
    constexpr int kBlock = 256;
    for (int row = 0; row < reply.height; row += kBlock) {
        const int last = std::min(row + kBlock, reply.height) - 1;
        part.readPixels(data.min.y + row, data.min.y + last);
        if (!luminance) continue;
        float* const end = pixels + row_floats * static_cast<std::size_t>(last + 1);
        for (float* p = pixels + row_floats * static_cast<std::size_t>(row); p != end; p += 3)
            p[1] = p[2] = p[0];
    }
}

std::vector<unsigned char> encode_exr(int width, int height, Bytes rgb) {
    Imf::Header header(width, height);
    header.compression() = Imf::ZIP_COMPRESSION;
    Imf::FrameBuffer buffer;
    const char* const names[] = {"R", "G", "B"};
    const float* const pixels = reinterpret_cast<const float*>(rgb.data());
    for (int i = 0; i < 3; ++i) {
        header.channels().insert(names[i], Imf::Channel(Imf::FLOAT));
        buffer.insert(names[i], Imf::Slice::Make(
                                    Imf::FLOAT, pixels + i, header.dataWindow(), 3 * sizeof(float),
                                    3 * sizeof(float) * static_cast<std::size_t>(width)));
    }
    MemoryOut stream;
    {
        Imf::OutputFile output(stream, header);
        output.setFrameBuffer(buffer);
        output.writePixels(height);
    }  // the destructor writes the offset table
    return std::move(stream.bytes);
}

}  // namespace envbake::worker
