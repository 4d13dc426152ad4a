// SPDX-License-Identifier: Apache-2.0
// Radiance pictures. Source: Ward, "Real Pixels", Graphics Gems II, 1991, and the file format page
// of the Radiance manual.
#include "baker/input/image_worker/codec.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace envbake::worker {
namespace {

struct RadianceHeader {
    int width = 0;
    int height = 0;
    std::size_t first_scanline = 0;  ///< bytes from the start of the file
};

/// Shorter and longer scanlines are always flat.
bool may_be_encoded(int width) {
    return width >= 8 && width < 32768;
}

RadianceHeader read_radiance_header(Bytes file) {
    std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    const auto next_line = [&] {
        const std::size_t end = text.find('\n');
        if (end == std::string_view::npos || end > 4096) throw Refusal("its header has no end");
        const std::string_view line = text.substr(0, end);
        text.remove_prefix(end + 1);
        return line;
    };
    for (std::string_view line = next_line(); !line.empty() && line != "\r"; line = next_line()) {
        if (line.starts_with("FORMAT=") && !line.starts_with("FORMAT=32-bit_rle_rgbe")) {
            throw Refusal("pixels of " + std::string(line) + "; only 32-bit_rle_rgbe is read");
        }
    }
    const std::string size(next_line());
    RadianceHeader header;
    char y_sign = 0, x_sign = 0, tail = 0;
    const int fields = std::sscanf(size.c_str(), "%cY %d %cX %d%c", &y_sign, &header.height,
                                   &x_sign, &header.width, &tail);
    if (fields < 4 || (fields == 5 && tail != '\r')) {
        throw Refusal("no resolution line such as -Y 512 +X 1024, but \"" + size.substr(0, 40) +
                      "\"");
    }
    if (y_sign != '-' || x_sign != '+') {
        throw Refusal("rows stored as \"" + size + "\"; only -Y +X, from the top left, is read");
    }
    check_size(header.width, header.height);

    // The least that a scanline can take: flat, or run-length encoded with runs of 127.
    const std::int64_t w = header.width;
    const std::int64_t least =
        may_be_encoded(header.width) ? std::min(4 * w, 4 + 4 * 2 * ((w + 126) / 127)) : 4 * w;
    if (least * header.height > static_cast<std::int64_t>(text.size())) {
        throw Refusal("the file is too short for the size it claims");
    }
    header.first_scanline = file.size() - text.size();
    return header;
}

unsigned int byte_at(Bytes file, std::size_t at) {
    return std::to_integer<unsigned int>(file[at]);
}

/// A scanline begins with 2, 2 and its width if it is encoded; a flat one that is properly written
/// does not, for the largest of a colour's mantissas is 128 or more.
bool is_encoded(Bytes scanline, int width) {
    return may_be_encoded(width) && scanline.size() >= 4 && byte_at(scanline, 0) == 2 &&
           byte_at(scanline, 1) == 2 && byte_at(scanline, 2) < 128;
}

constexpr unsigned int kLongestLiteral = 128;  ///< a larger count, less this, is that of a run

/// Bytes of the scanline at the start of `rest`; throws if anything is wrong with it. Red, green,
/// blue and exponent stand one after another, each as runs (count, byte) and literals (count,
/// bytes).
std::size_t checked_scanline_bytes(Bytes rest, int width) {
    constexpr int kPlanes = 4;
    const auto texels = static_cast<std::size_t>(width);
    if (!is_encoded(rest, width)) {
        if (rest.size() < kPlanes * texels) throw Refusal("the file ends early");
        return kPlanes * texels;
    }
    if ((byte_at(rest, 2) << 8 | byte_at(rest, 3)) != static_cast<unsigned int>(width)) {
        throw Refusal("a scanline of another width than the picture's");
    }
    std::size_t at = 4;
    for (int plane = 0; plane < kPlanes; ++plane) {
        for (std::size_t done = 0; done < texels;) {
            if (at >= rest.size()) throw Refusal("the file ends early");
            const unsigned int count = byte_at(rest, at);
            const bool run = count > kLongestLiteral;
            const std::size_t values = run ? count - kLongestLiteral : count;
            at += run ? 2 : 1 + values;
            done += values;
            if (values == 0 || done > texels) throw Refusal("a scanline with damaged runs");
        }
    }
    if (at > rest.size()) throw Refusal("the file ends early");
    return at;
}

/// Separates a checked scanline into its four planes, `width` bytes each.
void unpack(const std::byte* scanline, int width, bool encoded, std::byte* planes) {
    const auto texels = static_cast<std::size_t>(width);
    if (!encoded) {
        for (std::size_t i = 0; i < texels; ++i)
            for (std::size_t plane = 0; plane < 4; ++plane)
                planes[plane * texels + i] = scanline[4 * i + plane];
        return;
    }
    // The planes lie one behind another and no run crosses their borders. A file that somebody
    // changes meanwhile may hold anything, so the end is guarded once more.
    const std::byte* from = scanline + 4;
    std::byte* to = planes;
    for (std::size_t left = 4 * texels; left > 0;) {
        const auto count = std::to_integer<std::size_t>(*from++);
        const bool run = count > kLongestLiteral;
        const std::size_t values = std::min(run ? count - kLongestLiteral : count, left);
        if (run) {
            std::memset(to, std::to_integer<int>(*from), values);
        } else {
            std::memcpy(to, from, values);
        }
        from += run ? 1 : values;
        to += values;
        left -= values;
    }
}

/// Value of a mantissa's unit under each exponent: 2^(e - 136), and 0 for e = 0.
std::array<float, 256> make_units() {
    std::array<float, 256> units{};
    for (int e = 1; e < 256; ++e) units[static_cast<std::size_t>(e)] = std::ldexp(1.0f, e - 136);
    return units;
}

void to_floats(const std::byte* planes, int width, const std::array<float, 256>& units,
               float* rgb) {
    const auto texels = static_cast<std::size_t>(width);
    const std::byte *const r = planes, *const g = r + texels, *const b = g + texels,
                           *const e = b + texels;
    const auto value = [](std::byte mantissa) {
        return static_cast<float>(std::to_integer<int>(mantissa));
    };
    for (std::size_t i = 0; i < texels; ++i) {
        const float unit = units[std::to_integer<std::size_t>(e[i])];
        rgb[3 * i] = unit * value(r[i]);
        rgb[3 * i + 1] = unit * value(g[i]);
        rgb[3 * i + 2] = unit * value(b[i]);
    }
}

/// Hands out scanlines from the top. Where one ends is only known once it has been walked through:
/// that is done, and all that can be wrong with it found, under a lock; decoding is not.
class Scanlines {
  public:
    Scanlines(Bytes file, const RadianceHeader& header)
        : file_(file), header_(header), at_(header.first_scanline) {}

    struct Block {
        int first_row = 0;
        std::vector<Bytes> scanlines;
    };

    /// The next few scanlines; none at the end, or once a thread has met a damaged one.
    Block take() {
        constexpr int kRows = 16;
        constexpr std::size_t kForget = std::size_t{4} << 20;
        const std::lock_guard lock(mutex_);
        Block block{.first_row = row_, .scanlines = {}};
        try {
            for (; row_ < header_.height && row_ - block.first_row < kRows; ++row_) {
                const Bytes rest = file_.subspan(at_);
                const std::size_t size = checked_scanline_bytes(rest, header_.width);
                block.scanlines.push_back(rest.first(size));
                at_ += size;
            }
        } catch (...) {
            failure_ = std::current_exception();
            row_ = header_.height;
            return {};
        }
        if (at_ - forgotten_ >= kForget) {
            forget(file_);
            forgotten_ = at_;
        }
        return block;
    }

    void rethrow_failure() const {
        if (failure_) std::rethrow_exception(failure_);
    }

  private:
    std::mutex mutex_;
    Bytes file_;
    RadianceHeader header_;
    std::size_t at_;
    std::size_t forgotten_ = 0;
    int row_ = 0;
    std::exception_ptr failure_;
};

}  // namespace

void decode_radiance(Bytes file, int threads, Reply& reply, const AllocatePixels& allocate) {
    const RadianceHeader header = read_radiance_header(file);
    reply.width = header.width;
    reply.height = header.height;
    reply.data_window = reply.display_window = {0, 0, header.width - 1, header.height - 1};
    float* const pixels = reinterpret_cast<float*>(allocate(3 * sizeof(float)));
    const auto texels = static_cast<std::size_t>(header.width);
    const std::array<float, 256> units = make_units();

    Scanlines scanlines(file, header);
    const auto work = [&] {
        std::vector<std::byte> planes(4 * texels);
        for (;;) {
            const Scanlines::Block block = scanlines.take();
            if (block.scanlines.empty()) return;
            float* row = pixels + 3 * texels * static_cast<std::size_t>(block.first_row);
            for (const Bytes scanline : block.scanlines) {
                unpack(scanline.data(), header.width, is_encoded(scanline, header.width),
                       planes.data());
                to_floats(planes.data(), header.width, units, row);
                row += 3 * texels;
            }
        }
    };
    {
        std::vector<std::jthread> others;
        for (int i = 1; i < threads; ++i) others.emplace_back(work);
        work();
    }
    scanlines.rethrow_failure();
}

}  // namespace envbake::worker
