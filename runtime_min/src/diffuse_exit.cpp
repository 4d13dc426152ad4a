// SPDX-License-Identifier: Apache-2.0
#include "columns.h"
#include "envbake/runtime/sh.h"
#include "envbake/runtime/shade.h"
#include "float8.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace envbake::runtime {
namespace {

/// Of a row: three channels.
constexpr std::size_t kMaxNumbers =
    3 * static_cast<std::size_t>(sh::coeff_count(sh::kMaxBundleBands));

/// Which numbers of a row meet a light.
struct RowShape {
    RowShape(int bands, int channels, const ShLightingView& lighting)
        : stride(static_cast<std::size_t>(channels)),
          size(static_cast<std::size_t>(sh::coeff_count(bands)) * stride),
          count(std::min(size, lighting.coeffs.size() / 3 * stride)) {}

    /// What red, green or blue (c) of the light is for a number of the row.
    float light(const ShLightingView& lighting, std::size_t slot, std::size_t c) const {
        return stride == 3 && slot % 3 != c ? 0 : lighting.coeffs[3 * (slot / stride) + c];
    }

    std::size_t stride;  ///< transport channels, 1 or 3
    std::size_t size;    ///< numbers of a row
    std::size_t count;   ///< of them, those of bands that the light has too
};

/// A light as rows of f32 or f16 meet it: what each number of a row is multiplied by for red, green
/// and blue.
class RowLight {
  public:
    RowLight(int bands, int channels, const ShLightingView& lighting) {
        const RowShape shape(bands, channels, lighting);
        row_size_ = shape.size;
        count_ = shape.count;
        // The last vector may overlap the one before: it counts what that has not.
        for (std::size_t begin = 0; begin < count_; begin += kLanes) {
            const std::size_t at =
                begin + kLanes <= count_ || count_ < kLanes ? begin : count_ - kLanes;
            Vector& vector = vectors_[vector_count_++];
            vector = {at, {}};
            for (std::size_t slot = begin; slot < std::min(begin + kLanes, count_); ++slot)
                for (std::size_t c = 0; c < 3; ++c)
                    vector.factors[c][slot - at] = shape.light(lighting, slot, c);
        }
    }

    std::size_t row_size() const { return row_size_; }

    /// Rows of row_size() numbers, one for each of `out`.
    template <class T>
    void exit(const T* rows, std::span<Rgb> out) const {
        std::size_t v = 0;
        for (; count_ >= kLanes && v + kRows <= out.size(); v += kRows) {
            exit_of_four(rows + v * row_size_, &out[v]);
        }
        for (; v < out.size(); ++v) exit_of_one(rows + v * row_size_, out[v]);
    }

  private:
    static constexpr std::size_t kRows = 4;

    template <class T>
    void exit_of_four(const T* rows, Rgb* out) const {
        Float8 products[3][kRows] = {};
        for (std::size_t i = 0; i < vector_count_; ++i) {
            const Vector& vector = vectors_[i];
            const Float8 factors[3] = {load8(vector.factors[0]), load8(vector.factors[1]),
                                       load8(vector.factors[2])};
            for (std::size_t k = 0; k < kRows; ++k) {
                const Float8 numbers = load8(rows + k * row_size_ + vector.at);
                for (std::size_t c = 0; c < 3; ++c)
                    multiply_add(numbers, factors[c], products[c][k]);
            }
        }
        store_colours(products, out);
    }

    template <class T>
    void exit_of_one(const T* row, Rgb& out) const {
        out = {};
        for (std::size_t i = 0; i < vector_count_; ++i) {
            const Vector& vector = vectors_[i];
            for (std::size_t k = 0; k < std::min(kLanes, count_); ++k) {
                const float number = vector.at + k < count_ ? to_float(row[vector.at + k]) : 0;
                for (std::size_t c = 0; c < 3; ++c) out[c] += number * vector.factors[c][k];
            }
        }
    }

    /// Eight neighbours of a row.
    struct Vector {
        std::size_t at = 0;  ///< the first
        float factors[3][kLanes];
    };
    static constexpr std::size_t kMaxVectors = (kMaxNumbers + kLanes - 1) / kLanes;

    std::size_t row_size_ = 0, count_ = 0, vector_count_ = 0;
    std::array<Vector, kMaxVectors> vectors_;  ///< the first vector_count_ are filled
};

/// Number i of those that lie in each word, times unit_of<Code>(i): a byte stays where it is.
template <class Code>
Floats numbers_in(const Words& words, std::size_t i) {
    constexpr std::uint32_t kBits = 8 * sizeof(Code);
    const auto begin = static_cast<std::uint32_t>(i) * kBits;
    return to_floats(begin + kBits == 32 ? words >> begin : words & ((1u << kBits) - 1) << begin);
}
template <class Code>
float unit_of(std::size_t i) {
    const std::size_t begin = 8 * sizeof(Code) * i;
    return begin + 8 * sizeof(Code) == 32 ? 1 : static_cast<float>(1u << begin);
}

/// A light as rows of unorm8 or unorm16 meet it.
template <class Code>
class CodeLight {
  public:
    /// `range`: low and step of each number of a row.
    CodeLight(int bands, int channels, const ShLightingView& lighting, const float* range) {
        const RowShape shape(bands, channels, lighting);
        row_size_ = shape.size;
        count_ = shape.count;
        for (std::size_t slot = 0; slot < count_; ++slot)
            for (std::size_t c = 0; c < 3; ++c) {
                const float light = shape.light(lighting, slot, c);
                low_[c] += light * range[2 * slot];
                factors_[slot][c] = light * range[2 * slot + 1] / unit_of<Code>(slot % kInWord);
            }
    }

    /// Rows from the `first` on, one for each of `out`.
    void exit(const void* codes, std::uint64_t first, std::span<Rgb> out) const {
        const Code* rows = static_cast<const Code*>(codes) + first * row_size_;
        std::size_t v = 0;
        while (v < out.size()) {
            const std::size_t left = out.size() - v;
            if (left >= kAtOnce && (left - kAtOnce) * row_size_ >= kOverread) {
                exit_of_some(rows + v * row_size_, &out[v]);
            } else {
                exit_of_copy(rows + v * row_size_, out.subspan(v, std::min(left, kAtOnce)));
            }
            v += kAtOnce;
        }
    }

  private:
    static constexpr std::size_t kInWord = 4 / sizeof(Code);
    static constexpr std::size_t kInColumns = 4 * kInWord;
    static constexpr std::size_t kOverread = kInColumns - 1;  ///< codes, at most
    /// Two sums a channel, so that one addition waits less for another: of two groups of vertices,
    /// or where one fills the widest vectors, of its even and odd numbers.
    static constexpr std::size_t kGroups = kWidth == 16 ? 1 : 2;
    static constexpr std::size_t kAtOnce = kGroups * kWidth;

    void exit_of_some(const Code* rows, Rgb* out) const {
        Floats sum[2][3] = {};
        for (std::size_t slot = 0; slot < count_; slot += kInColumns) {
            Words columns[kGroups][4];
            for (std::size_t g = 0; g < kGroups; ++g) {
                load_columns(
                    reinterpret_cast<const std::byte*>(rows + g * kWidth * row_size_ + slot),
                    row_size_ * sizeof(Code), columns[g]);
            }
#pragma GCC unroll 4  // columns stay in registers
            for (std::size_t w = 0; w < 4; ++w) {
                if (slot + w * kInWord >= count_) break;
                for (std::size_t i = 0; i < kInWord; ++i) {
                    const Rgb& factors = factors_[slot + w * kInWord + i];
                    for (std::size_t g = 0; g < kGroups; ++g) {
                        const Floats numbers = numbers_in<Code>(columns[g][w], i);
                        for (std::size_t c = 0; c < 3; ++c)
                            sum[kGroups == 1 ? i % 2 : g][c] += numbers * in_every_lane(factors[c]);
                    }
                }
            }
        }
        if (kGroups == 1) {
            for (std::size_t c = 0; c < 3; ++c) sum[0][c] += sum[1][c];
        }
        for (std::size_t g = 0; g < kGroups; ++g) {
            store_columns(in_every_lane(low_[0]) + sum[g][0], in_every_lane(low_[1]) + sum[g][1],
                          in_every_lane(low_[2]) + sum[g][2], out[g * kWidth].data());
        }
    }

    /// Rows that are too few, or too near the end of their array to be read beyond.
    void exit_of_copy(const Code* rows, std::span<Rgb> out) const {
        std::array<Code, kAtOnce * kMaxNumbers + kOverread> copy;
        std::array<Rgb, kAtOnce> colours;
        const auto end = std::copy_n(rows, out.size() * row_size_, copy.begin());
        std::fill(end, copy.begin() + static_cast<std::ptrdiff_t>(kAtOnce * row_size_ + kOverread),
                  Code{0});
        exit_of_some(copy.data(), colours.data());
        std::copy_n(colours.begin(), out.size(), out.begin());
    }

    std::size_t row_size_ = 0, count_ = 0;
    Rgb low_{};
    std::array<Rgb, kMaxNumbers + kInWord - 1> factors_{};  ///< 0 from count_ on
};

/// A damaged bundle may name a cluster that does not exist; it gets the first.
std::uint32_t cluster_of(const TransportView& transport, std::uint64_t vertex) {
    const std::uint32_t cluster =
        transport.clusters_are_16_bit
            ? static_cast<const std::uint16_t*>(transport.clusters)[vertex]
            : static_cast<const std::uint8_t*>(transport.clusters)[vertex];
    return cluster < transport.basis.cluster_count ? cluster : 0;
}

/// The rows of a cluster under a light, as weights meet them: the colour of the first row, then for
/// every eight weights their factors for red, for green and for blue, 0 where there is no weight.
class ProjectedClusters {
  public:
    explicit ProjectedClusters(const ClusterBasisView& basis)
        : weight_count_(static_cast<std::size_t>(basis.weight_count)) {}

    std::size_t cluster_size() const { return cluster_size(vector_count()); }

    void project(const ClusterBasisView& basis, const RowLight& light, std::uint32_t cluster,
                 float* projected) const {
        std::array<Rgb, 1 + kMaxClusterWeights> rows;
        const std::size_t first = cluster * (weight_count_ + 1) * light.row_size();
        const auto out = std::span(rows).first(weight_count_ + 1);
        if (basis.rows.is_half) {
            light.exit(static_cast<const HalfBits*>(basis.rows.data) + first, out);
        } else {
            light.exit(static_cast<const float*>(basis.rows.data) + first, out);
        }
        std::fill(projected, projected + cluster_size(), 0.0f);
        for (std::size_t c = 0; c < 3; ++c) {
            projected[c] = rows[0][c];
            for (std::size_t k = 0; k < weight_count_; ++k) {
                projected[factor(k, c)] = rows[1 + k][c];
            }
        }
    }

    void exit_of_four(const std::array<const float*, 4>& projected, const std::uint8_t* weights,
                      Rgb* out) const {
        Float8 products[3][4];
        for (std::size_t k = 0; k < 4; ++k) {
            for (std::size_t c = 0; c < 3; ++c) products[c][k] = first_lane(projected[k][c]);
        }
        for (std::size_t i = 0; i < vector_count(); ++i) {
            for (std::size_t k = 0; k < 4; ++k) {
                // Beyond the vertex' own weights lie others, times 0.
                const Float8 of_vertex = load8(weights + k * weight_count_ + kLanes * i);
                for (std::size_t c = 0; c < 3; ++c) {
                    multiply_add(of_vertex, load8(projected[k] + factor(kLanes * i, c)),
                                 products[c][k]);
                }
            }
        }
        store_colours(products, out);
    }

    Rgb exit_of_one(const float* projected, const std::uint8_t* weights) const {
        Rgb sum{projected[0], projected[1], projected[2]};
        for (std::size_t k = 0; k < weight_count_; ++k) {
            for (std::size_t c = 0; c < 3; ++c) sum[c] += weights[k] * projected[factor(k, c)];
        }
        return sum;
    }

    /// Weights that exit_of_four() reads beyond those of its vertices.
    std::size_t overread() const { return kLanes * vector_count() - weight_count_; }

    static constexpr std::size_t cluster_size(std::size_t vector_count) {
        return kFirst + 3 * kLanes * vector_count;
    }
    static constexpr std::size_t kMostVectors = (kMaxClusterWeights + kLanes - 1) / kLanes;

  private:
    static constexpr std::size_t kFirst = 4;  ///< of the factors

    std::size_t vector_count() const { return (weight_count_ + kLanes - 1) / kLanes; }
    static std::size_t factor(std::size_t weight, std::size_t c) {
        return kFirst + 3 * (weight - weight % kLanes) + kLanes * c + weight % kLanes;
    }

    std::size_t weight_count_;
};

void exit_of_clusters(const TransportView& transport, const RowLight& light, std::uint64_t first,
                      std::span<Rgb> out) {
    const ProjectedClusters clusters(transport.basis);
    const auto count = static_cast<std::size_t>(transport.basis.weight_count);
    const auto* weights = static_cast<const std::uint8_t*>(transport.codes) + first * count;
    std::array<float, ProjectedClusters::cluster_size(ProjectedClusters::kMostVectors)> projected;
    std::uint32_t cluster_projected = transport.basis.cluster_count;  // none
    for (std::size_t k = 0; k < out.size(); ++k) {
        const std::uint32_t cluster = cluster_of(transport, first + k);
        if (cluster != cluster_projected) {
            clusters.project(transport.basis, light, cluster, projected.data());
            cluster_projected = cluster;
        }
        out[k] = clusters.exit_of_one(projected.data(), weights + k * count);
    }
}

/// Those of `out` that are vertices; the others become 0.
std::span<Rgb> existing(const TransportView& transport, std::uint64_t first, std::span<Rgb> out) {
    std::size_t count = 0;
    if (transport.bands > 0 && first < transport.vertex_count) {
        count = static_cast<std::size_t>(
            std::min<std::uint64_t>(out.size(), transport.vertex_count - first));
    }
    std::fill(out.begin() + static_cast<std::ptrdiff_t>(count), out.end(), Rgb{});
    return out.first(count);
}

void add_emitted(const TransportView& transport, std::uint64_t first, std::span<Rgb> out) {
    if (transport.emitted.count == 0) return;
    for (std::size_t k = 0; k < out.size(); ++k) {
        for (std::size_t c = 0; c < 3; ++c) out[k][c] += transport.emitted[3 * (first + k) + c];
    }
}

}  // namespace

Rgb diffuse_exit(std::span<const float> row, const ShLightingView& lighting) noexcept {
    const std::size_t count = std::min(row.size(), lighting.coeffs.size() / 3);
    const float* light = lighting.coeffs.data();
    // Two sums a channel: the additions of one do not wait for each other.
    float even[3] = {}, odd[3] = {};
    std::size_t i = 0;
    for (; i + 1 < count; i += 2) {
        for (std::size_t c = 0; c < 3; ++c) {
            even[c] += row[i] * light[3 * i + c];
            odd[c] += row[i + 1] * light[3 * i + 3 + c];
        }
    }
    if (i < count) {
        for (std::size_t c = 0; c < 3; ++c) even[c] += row[i] * light[3 * i + c];
    }
    return {even[0] + odd[0], even[1] + odd[1], even[2] + odd[2]};
}

void diffuse_exit(const TransportView& transport, const ShLightingView& lighting,
                  std::uint64_t first, std::span<Rgb> out) noexcept {
    out = existing(transport, first, out);
    if (out.empty()) return;
    switch (transport.encoding) {
        case TransportEncoding::Unorm16:
            CodeLight<std::uint16_t>(transport.bands, transport.channels, lighting, transport.range)
                .exit(transport.codes, first, out);
            break;
        case TransportEncoding::Unorm8:
            CodeLight<std::uint8_t>(transport.bands, transport.channels, lighting, transport.range)
                .exit(transport.codes, first, out);
            break;
        case TransportEncoding::Float:
        case TransportEncoding::Clustered: {
            const RowLight light(transport.bands, transport.channels, lighting);
            const std::uint64_t begin = first * light.row_size();
            if (transport.encoding == TransportEncoding::Clustered) {
                exit_of_clusters(transport, light, first, out);
            } else if (transport.values.is_half) {
                light.exit(static_cast<const HalfBits*>(transport.values.data) + begin, out);
            } else {
                light.exit(static_cast<const float*>(transport.values.data) + begin, out);
            }
        }
    }
    add_emitted(transport, first, out);
}

std::size_t projected_size(const ClusterBasisView& basis) noexcept {
    return ProjectedClusters(basis).cluster_size() * basis.cluster_count;
}

void project_light(const ClusterBasisView& basis, const ShLightingView& lighting,
                   std::span<float> projected) noexcept {
    if (basis.cluster_count == 0 || projected.size() != projected_size(basis)) return;
    const ProjectedClusters clusters(basis);
    const RowLight light(basis.bands, basis.channels, lighting);
    for (std::uint32_t cluster = 0; cluster < basis.cluster_count; ++cluster) {
        clusters.project(basis, light, cluster, &projected[cluster * clusters.cluster_size()]);
    }
}

void diffuse_exit(const TransportView& transport, std::span<const float> projected,
                  std::uint64_t first, std::span<Rgb> out) noexcept {
    if (transport.encoding != TransportEncoding::Clustered ||
        projected.size() != projected_size(transport.basis)) {
        std::fill(out.begin(), out.end(), Rgb{});
        return;
    }
    out = existing(transport, first, out);
    const ProjectedClusters clusters(transport.basis);
    const auto count = static_cast<std::size_t>(transport.basis.weight_count);
    const auto* weights = static_cast<const std::uint8_t*>(transport.codes) + first * count;
    const auto of_vertex = [&](std::size_t k) {
        return &projected[cluster_of(transport, first + k) * clusters.cluster_size()];
    };
    const std::uint64_t weights_left = (transport.vertex_count - first) * count;
    std::size_t k = 0;
    for (; k + 4 <= out.size() && (k + 4) * count + clusters.overread() <= weights_left; k += 4) {
        clusters.exit_of_four({of_vertex(k), of_vertex(k + 1), of_vertex(k + 2), of_vertex(k + 3)},
                              weights + k * count, &out[k]);
    }
    for (; k < out.size(); ++k) out[k] = clusters.exit_of_one(of_vertex(k), weights + k * count);
    add_emitted(transport, first, out);
}

}  // namespace envbake::runtime
