// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/wavelet_block.h"

#include <cmath>
#include <cstring>
#include <utility>

namespace envbake {

namespace {

constexpr std::uint32_t kUpper = 0x80000000;  ///< of a run: it has the upper bytes

}  // namespace

std::vector<WaveletEntry> quantised(std::span<const float> coeffs, float step) {
    std::vector<WaveletEntry> entries;
    const float per_step = 1 / step;
    for (std::size_t i = 0; i < coeffs.size(); ++i) {
        if (std::abs(coeffs[i]) < step) continue;
        const long units = std::lround(coeffs[i] * per_step);
        entries.push_back({static_cast<std::uint32_t>(i), static_cast<std::int16_t>(units)});
    }
    return entries;
}

std::vector<std::byte> encode_wavelet_block(std::span<const std::vector<WaveletEntry>> rows) {
    // Runs in the order of the file: 2 * index, and 2 * index + 1 for the upper bytes.
    const auto for_each_byte = [&](const auto& visit) {
        for (std::size_t v = 0; v < rows.size(); ++v)
            for (const WaveletEntry& e : rows[v]) {
                const int upper = (e.units + 128) >> 8, lower = e.units - 256 * upper;
                if (lower != 0) visit(2 * std::size_t{e.index}, v, lower);
                if (upper != 0) visit(2 * std::size_t{e.index} + 1, v, upper);
            }
    };
    std::vector<std::uint32_t> next;  // where the next byte of a run goes
    for_each_byte([&](std::size_t run, std::size_t, int) {
        if (run >= next.size()) next.resize(run + 1, 0);
        ++next[run];
    });
    std::vector<std::uint32_t> words{0}, first;
    std::uint32_t count = 0;
    for (std::size_t run = 0; run < next.size(); ++run) {
        if (next[run] == 0) continue;
        words.push_back(static_cast<std::uint32_t>(run / 2) | (run % 2 != 0 ? kUpper : 0));
        first.push_back(count);
        count += std::exchange(next[run], count);
    }
    words[0] = static_cast<std::uint32_t>(first.size());
    first.push_back(count);
    words.insert(words.end(), first.begin(), first.end());

    const std::size_t head = words.size() * sizeof(std::uint32_t);
    std::vector<std::byte> bytes((head + 2 * std::size_t{count} + 3) / 4 * 4);
    std::memcpy(bytes.data(), words.data(), head);
    for_each_byte([&](std::size_t run, std::size_t vertex, int value) {
        const std::size_t at = head + next[run]++;
        bytes[at] = static_cast<std::byte>(vertex);
        bytes[at + count] = static_cast<std::byte>(value);
    });
    return bytes;
}

}  // namespace envbake
