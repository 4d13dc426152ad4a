// SPDX-License-Identifier: Apache-2.0
#include "rgbe.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace envbake::sample {
namespace {

/// One channel of one row in the run-length scheme of 1991: a count above 128 repeats the byte that
/// follows it count - 128 times, a count up to 128 announces that many literal bytes.
void encode_channel(const std::vector<std::uint8_t>& bytes, std::string& out) {
    constexpr std::size_t kShortestRun = 4, kLongestRun = 127, kLongestLiteral = 128;
    const auto run_at = [&](std::size_t i) {
        std::size_t n = 1;
        while (i + n < bytes.size() && n < kLongestRun && bytes[i + n] == bytes[i]) ++n;
        return n;
    };
    std::size_t i = 0;
    while (i < bytes.size()) {
        std::size_t literal = 0;
        while (i + literal < bytes.size() && literal < kLongestLiteral &&
               run_at(i + literal) < kShortestRun)
            ++literal;
        if (literal > 0) {
            out.push_back(static_cast<char>(literal));
            for (std::size_t k = 0; k < literal; ++k)
                out.push_back(static_cast<char>(bytes[i + k]));
            i += literal;
        } else {
            const std::size_t run = run_at(i);
            out.push_back(static_cast<char>(128 + run));
            out.push_back(static_cast<char>(bytes[i]));
            i += run;
        }
    }
}

}  // namespace

std::array<std::uint8_t, 4> to_rgbe(const std::array<float, 3>& rgb) {
    const double largest = std::max({rgb[0], rgb[1], rgb[2]});
    if (largest < 0x1p-127) return {0, 0, 0, 0};
    int exponent = 0;
    std::frexp(largest, &exponent);
    // Rounding may carry the largest mantissa to 256: then the next exponent is the nearest one.
    if (std::round(std::ldexp(largest, 8 - exponent)) > 255) ++exponent;
    const auto mantissa = [exponent](float v) {
        return static_cast<std::uint8_t>(
            std::round(std::ldexp(static_cast<double>(v), 8 - exponent)));
    };
    return {mantissa(rgb[0]), mantissa(rgb[1]), mantissa(rgb[2]),
            static_cast<std::uint8_t>(exponent + 128)};
}

std::string encode_hdr(const SkyImage& image) {
    std::string out = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " + std::to_string(image.height) +
                      " +X " + std::to_string(image.width) + "\n";
    const auto width = static_cast<std::size_t>(image.width);
    const bool run_lengths = image.width >= 8 && image.width <= 32767;
    std::array<std::vector<std::uint8_t>, 4> channels;
    for (std::size_t row = 0; row < static_cast<std::size_t>(image.height); ++row) {
        for (auto& channel : channels) channel.clear();
        for (std::size_t column = 0; column < width; ++column) {
            const auto rgbe = to_rgbe(image.radiance[row * width + column]);
            for (std::size_t c = 0; c < 4; ++c) channels[c].push_back(rgbe[c]);
        }
        if (run_lengths) {
            for (const std::size_t byte : {std::size_t{2}, std::size_t{2}, width >> 8, width & 255})
                out.push_back(static_cast<char>(byte));
            for (const auto& channel : channels) encode_channel(channel, out);
        } else {
            for (std::size_t column = 0; column < width; ++column)
                for (const auto& channel : channels)
                    out.push_back(static_cast<char>(channel[column]));
        }
    }
    return out;
}

}  // namespace envbake::sample
