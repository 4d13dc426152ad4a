// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/half.h"
#include "envbake/runtime/sh.h"
#include "envbake/runtime/shade.h"
#include "tests/unit/runtime/vector_code_test.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace envbake::runtime {
namespace {

/// Transport of one encoding and what it stands for, decoded here by the words of docs/format.md.
struct Encoded {
    TransportView view;
    std::vector<double> rows;  ///< [vertices, bands^2, channels]

    std::vector<float> floats, range;
    std::vector<std::uint16_t> halves, words;
    std::vector<std::uint8_t> bytes;
};

constexpr std::size_t kVertices = 37;
constexpr std::uint32_t kClusters = 5;

class Numbers {
  public:
    float next() { return uniform_(engine_); }
    std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>(engine_()) % n; }

  private:
    std::mt19937 engine_{7};
    std::uniform_real_distribution<float> uniform_{-0.5f, 0.5f};
};

void make_rows(Encoded& e, bool half, std::size_t row, Numbers& numbers) {
    for (std::size_t i = 0; i < kVertices * row; ++i) {
        e.halves.push_back(float_to_half(numbers.next()));
        e.floats.push_back(half ? half_to_float(e.halves.back()) : numbers.next());
        e.rows.push_back(double{e.floats.back()});
    }
    const void* data = half ? static_cast<const void*>(e.halves.data())
                            : static_cast<const void*>(e.floats.data());
    e.view.values = {data, e.floats.size(), half};
}

void make_unorm(Encoded& e, bool words, std::size_t row, Numbers& numbers) {
    for (std::size_t i = 0; i < row; ++i) {
        e.range.push_back(numbers.next());
        e.range.push_back((numbers.next() + 0.6f) / (words ? 65535.0f : 255.0f));
    }
    for (std::size_t i = 0; i < kVertices * row; ++i) {
        e.words.push_back(static_cast<std::uint16_t>(numbers.below(words ? 65536 : 256)));
        e.bytes.push_back(static_cast<std::uint8_t>(e.words.back() & 255));
        e.rows.push_back(double{e.range[2 * (i % row)]} +
                         double{e.range[2 * (i % row) + 1]} * (words ? e.words[i] : e.bytes[i]));
    }
    e.view.encoding = words ? TransportEncoding::Unorm16 : TransportEncoding::Unorm8;
    e.view.codes =
        words ? static_cast<const void*>(e.words.data()) : static_cast<const void*>(e.bytes.data());
    e.view.range = e.range.data();
}

void make_clustered(Encoded& e, bool half, std::size_t weights, std::size_t row, Numbers& numbers) {
    for (std::size_t i = 0; i < kClusters * (1 + weights) * row; ++i) {
        e.halves.push_back(float_to_half(numbers.next() / 100));
        e.floats.push_back(half_to_float(e.halves.back()));
    }
    for (std::size_t i = 0; i < kVertices * weights; ++i)
        e.bytes.push_back(static_cast<std::uint8_t>(numbers.below(256)));
    for (std::size_t v = 0; v < kVertices; ++v) {
        e.words.push_back(static_cast<std::uint16_t>(numbers.below(kClusters)));
        for (std::size_t i = 0; i < row; ++i) {
            const float* basis = &e.floats[e.words[v] * (1 + weights) * row + i];
            double value = double{basis[0]};
            for (std::size_t k = 0; k < weights; ++k)
                value += e.bytes[v * weights + k] * double{basis[(1 + k) * row]};
            e.rows.push_back(value);
        }
    }
    const void* data = half ? static_cast<const void*>(e.halves.data())
                            : static_cast<const void*>(e.floats.data());
    e.view.encoding = TransportEncoding::Clustered;
    e.view.basis = {kClusters,
                    static_cast<int>(weights),
                    e.view.bands,
                    e.view.channels,
                    {data, e.floats.size(), half}};
    e.view.codes = e.bytes.data();
    e.view.clusters = e.words.data();
    e.view.clusters_are_16_bit = true;
}

/// The sum over bands that both sides have, in double.
double expected(const Encoded& e, const std::vector<float>& light, std::size_t vertex,
                std::size_t c) {
    const auto coeffs = static_cast<std::size_t>(e.view.bands * e.view.bands);
    const auto channels = static_cast<std::size_t>(e.view.channels);
    double sum = 0;
    for (std::size_t i = 0; i < std::min(coeffs, light.size() / 3); ++i)
        sum += e.rows[(vertex * coeffs + i) * channels + c % channels] * double{light[3 * i + c]};
    return sum;
}

/// Of some hundred terms in any order.
double rounding(float sum) {
    return 2e-5 + 1e-6 * std::abs(double{sum});
}

template <class Make>
void expect_the_sum(Make make) {
    for (const int bands : {1, 2, 3, 5, 10}) {
        for (const int channels : {1, 3}) {
            Numbers numbers;
            Encoded e;
            e.view.vertex_count = kVertices;
            e.view.bands = bands;
            e.view.channels = channels;
            make(e, static_cast<std::size_t>(bands * bands * channels), numbers);
            // Copies are of the exact size: ASan sees what is read beyond.
            const std::vector<std::uint16_t> words = e.words;
            const std::vector<std::uint8_t> bytes = e.bytes;
            if (e.view.encoding == TransportEncoding::Unorm16) e.view.codes = words.data();
            if (e.view.codes == e.bytes.data()) e.view.codes = bytes.data();
            for (const int light_bands : {1, 4, 10}) {
                std::vector<float> light(static_cast<std::size_t>(3 * light_bands * light_bands));
                for (float& l : light) l = 4 * numbers.next();
                const ShLightingView lighting{light_bands, light};
                std::vector<Rgb> out(kVertices, Rgb{9, 9, 9});
                diffuse_exit(e.view, lighting, 2, out);
                for (std::size_t k = 0; k + 2 < kVertices; ++k)
                    for (std::size_t c = 0; c < 3; ++c)
                        EXPECT_NEAR(out[k][c], expected(e, light, k + 2, c), rounding(out[k][c]))
                            << bands << ' ' << channels << ' ' << light_bands;
                EXPECT_EQ(out[kVertices - 2], Rgb{});  // past the last vertex
                if (e.view.encoding != TransportEncoding::Clustered) continue;
                std::vector<float> projected(projected_size(e.view.basis));
                project_light(e.view.basis, lighting, projected);
                std::vector<Rgb> again(kVertices, Rgb{9, 9, 9});
                diffuse_exit(e.view, projected, 2, again);
                for (std::size_t k = 0; k < kVertices; ++k)
                    for (std::size_t c = 0; c < 3; ++c)
                        EXPECT_NEAR(again[k][c], out[k][c], rounding(out[k][c]));
            }
        }
    }
}

class EncodedTransport : public VectorCodeTest {};

TEST_F(EncodedTransport, OfFloatsIsTheSum) {
    expect_the_sum([](Encoded& e, std::size_t row, Numbers& n) { make_rows(e, false, row, n); });
}

TEST_F(EncodedTransport, OfHalvesIsTheSum) {
    expect_the_sum([](Encoded& e, std::size_t row, Numbers& n) { make_rows(e, true, row, n); });
}

TEST_F(EncodedTransport, OfBytesIsTheSum) {
    expect_the_sum([](Encoded& e, std::size_t row, Numbers& n) { make_unorm(e, false, row, n); });
}

TEST_F(EncodedTransport, OfWordsIsTheSum) {
    expect_the_sum([](Encoded& e, std::size_t row, Numbers& n) { make_unorm(e, true, row, n); });
}

TEST_F(EncodedTransport, OfClustersIsTheSum) {
    for (const bool half : {false, true})
        for (const std::size_t weights : {1u, 3u, 8u, 10u, 32u})
            expect_the_sum([half, weights](Encoded& e, std::size_t row, Numbers& n) {
                make_clustered(e, half, weights, row, n);
            });
}

// Every bit pattern of a half, in every lane: what the vector code makes of it is half_to_float().
TEST_F(EncodedTransport, EveryHalfIsExact) {
    constexpr std::size_t kRows = 5;  // four together and one alone
    std::vector<std::uint16_t> halves(9 * kRows);
    std::vector<float> light(27);
    for (std::size_t i = 0; i < 9; ++i) light[3 * i] = 0;
    TransportView view;
    view.vertex_count = kRows;
    view.bands = 3;
    view.values = {halves.data(), halves.size(), true};
    for (std::size_t slot = 0; slot < 9; ++slot) {
        std::fill(light.begin(), light.end(), 0.0f);
        light[3 * slot] = 1;
        for (std::uint32_t bits = 0; bits < 0x10000; bits += slot == 0 ? 1 : 37) {
            if ((bits & 0x7c00u) == 0x7c00u) continue;  // a validated bundle has none
            for (std::size_t v = 0; v < kRows; ++v)
                halves[9 * v + slot] = static_cast<std::uint16_t>(bits);
            std::array<Rgb, kRows> out;
            diffuse_exit(view, {3, light}, 0, out);
            for (const Rgb& rgb : out) EXPECT_EQ(rgb[0], half_to_float(halves[slot])) << bits;
        }
        std::fill(halves.begin(), halves.end(), std::uint16_t{0});
    }
}

TEST_F(EncodedTransport, AClusterThatDoesNotExistIsTheFirst) {
    Numbers numbers;
    Encoded e;
    e.view.vertex_count = kVertices;
    e.view.bands = 2;
    make_clustered(e, false, 3, 4, numbers);
    const std::vector<float> light(12, 1.0f);
    Rgb first{}, absent{};
    e.words[3] = 0;
    diffuse_exit(e.view, ShLightingView{2, light}, 3, {&first, 1});
    e.words[3] = 60000;
    diffuse_exit(e.view, ShLightingView{2, light}, 3, {&absent, 1});
    EXPECT_EQ(first, absent);
    // A projection of another size is refused, not read.
    const std::vector<float> projected(3);
    diffuse_exit(e.view, projected, 3, {&absent, 1});
    EXPECT_EQ(absent, Rgb{});
}

}  // namespace
}  // namespace envbake::runtime
