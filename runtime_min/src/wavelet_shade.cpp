// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/shade.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace envbake::runtime {
namespace {

constexpr std::size_t kBlockSize = 256;  ///< vertices; one byte names one of them
constexpr std::uint32_t kUpper = 0x80000000;

/// One block as it lies in the file, docs/format.md.
struct Block {
    std::span<const std::uint32_t> runs;   ///< index of the coefficient, kUpper: of upper bytes
    std::span<const std::uint32_t> first;  ///< [runs + 1], of the entries
    const std::uint8_t* vertices = nullptr;
    const std::int8_t* values = nullptr;
};

/// Without runs where the block is not as it must be.
Block block_of(const WaveletTransportView& transport, std::size_t i) noexcept {
    if (i + 1 >= transport.offsets.size()) return {};
    const std::uint32_t begin = transport.offsets[i], end = transport.offsets[i + 1];
    if (begin >= end || end > transport.words.size()) return {};
    const std::span<const std::uint32_t> words = transport.words.subspan(begin, end - begin);
    const std::uint64_t run_count = words[0];
    const std::uint64_t head = 2 * run_count + 2;
    if (head > words.size()) return {};
    const std::uint64_t entry_count = words[head - 1];
    if (2 * entry_count > 4 * (words.size() - head)) return {};
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(words.data() + head);
    return {words.subspan(1, run_count), words.subspan(1 + run_count, run_count + 1), bytes,
            reinterpret_cast<const std::int8_t*>(bytes + entry_count)};
}

using Sums = std::array<std::array<float, kBlockSize>, 3>;

void add_term(const Block& block, std::size_t run, const wavelet::Term& term, float step,
              Sums& sums) noexcept {
    const std::uint32_t begin = block.first[run], end = block.first[run + 1];
    if (begin > end || end > block.first.back()) return;
    const float unit = (block.runs[run] & kUpper) != 0 ? 256 * step : step;
    const float r = unit * term.value[0], g = unit * term.value[1], b = unit * term.value[2];
    for (std::uint32_t e = begin; e < end; ++e) {
        const std::size_t v = block.vertices[e];
        const auto value = static_cast<float>(block.values[e]);
        sums[0][v] += r * value;
        sums[1][v] += g * value;
        sums[2][v] += b * value;
    }
}

}  // namespace

void diffuse_exit(const WaveletTransportView& transport, std::span<const wavelet::Term> terms,
                  std::uint64_t first, std::span<Rgb> out) noexcept {
    std::fill(out.begin(), out.end(), Rgb{});
    if (transport.face_size == 0 || first >= transport.vertex_count || out.empty()) return;
    const std::uint64_t end =
        first + std::min<std::uint64_t>(out.size(), transport.vertex_count - first);
    for (std::uint64_t i = first / kBlockSize; i * kBlockSize < end; ++i) {
        const Block block = block_of(transport, static_cast<std::size_t>(i));
        Sums sums{};
        auto run = block.runs.begin();
        for (const wavelet::Term& term : terms) {
            run = std::lower_bound(
                run, block.runs.end(), term.index,
                [](std::uint32_t a, std::uint32_t b) { return (a & ~kUpper) < b; });
            for (; run != block.runs.end() && (*run & ~kUpper) == term.index; ++run)
                add_term(block, static_cast<std::size_t>(run - block.runs.begin()), term,
                         transport.step, sums);
        }
        const std::uint64_t begin = i * kBlockSize;
        for (std::uint64_t v = std::max(first, begin); v < std::min(end, begin + kBlockSize); ++v)
            for (std::size_t c = 0; c < 3; ++c) out[v - first][c] = sums[c][v - begin];
    }
}

}  // namespace envbake::runtime
