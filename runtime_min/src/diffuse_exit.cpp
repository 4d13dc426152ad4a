// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/sh.h"
#include "envbake/runtime/shade.h"
#include "float8.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace envbake::runtime {
namespace {

constexpr std::size_t kMaxCoeffs = static_cast<std::size_t>(sh::coeff_count(sh::kMaxBundleBands));

/// A light as rows of one kind meet it: what each number of a row is multiplied by for red, green
/// and blue, and what comes on top of the sum.
class RowLight {
  public:
    /// `range`: low and step of each number of a row; null where rows are the numbers themselves.
    RowLight(int bands, int channels, const ShLightingView& lighting, const float* range) {
        const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
        const auto stride = static_cast<std::size_t>(channels);
        row_size_ = coeffs * stride;
        count_ = std::min(coeffs, lighting.coeffs.size() / 3) * stride;
        // The last vector may overlap the one before: it counts what that has not.
        for (std::size_t begin = 0; begin < count_; begin += kLanes) {
            const std::size_t at =
                begin + kLanes <= count_ || count_ < kLanes ? begin : count_ - kLanes;
            Vector& vector = vectors_[vector_count_++];
            vector = {at, {}};
            for (std::size_t slot = begin; slot < std::min(begin + kLanes, count_); ++slot) {
                const float low = range != nullptr ? range[2 * slot] : 0;
                const float step = range != nullptr ? range[2 * slot + 1] : 1;
                for (std::size_t c = 0; c < 3; ++c) {
                    if (stride == 3 && slot % 3 != c) continue;
                    const float light = lighting.coeffs[3 * (slot / stride) + c];
                    low_[c] += light * low;
                    vector.factors[c][slot - at] = light * step;
                }
            }
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
                for (std::size_t c = 0; c < 3; ++c) products[c][k] += numbers * factors[c];
            }
        }
        for (std::size_t c = 0; c < 3; ++c) {
            const std::array<float, kRows> of_rows = sums(products[c]);
            for (std::size_t k = 0; k < kRows; ++k) out[k][c] = low_[c] + of_rows[k];
        }
    }

    template <class T>
    void exit_of_one(const T* row, Rgb& out) const {
        out = low_;
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
    static constexpr std::size_t kMaxVectors = (3 * kMaxCoeffs + kLanes - 1) / kLanes;

    std::size_t row_size_ = 0, count_ = 0, vector_count_ = 0;
    std::array<Vector, kMaxVectors> vectors_;  ///< the first vector_count_ are filled
    Rgb low_{};
};

/// A damaged bundle may name a cluster that does not exist; it gets the first.
std::uint32_t cluster_of(const TransportView& transport, std::uint64_t vertex) {
    const std::uint32_t cluster =
        transport.clusters_are_16_bit
            ? static_cast<const std::uint16_t*>(transport.clusters)[vertex]
            : static_cast<const std::uint8_t*>(transport.clusters)[vertex];
    return cluster < transport.basis.cluster_count ? cluster : 0;
}

Rgb weighted(const Rgb* rows, const std::uint8_t* weights, std::size_t count) {
    Rgb sum = rows[0];
    for (std::size_t k = 0; k < count; ++k) {
        const float weight = weights[k];
        for (std::size_t c = 0; c < 3; ++c) sum[c] += weight * rows[1 + k][c];
    }
    return sum;
}

void project_rows(const ClusterBasisView& basis, const RowLight& light, std::uint64_t first,
                  std::span<Rgb> out) {
    if (basis.rows.is_half) {
        const auto* rows = static_cast<const HalfBits*>(basis.rows.data);
        light.exit(rows + first * light.row_size(), out);
    } else {
        const auto* rows = static_cast<const float*>(basis.rows.data);
        light.exit(rows + first * light.row_size(), out);
    }
}

void exit_of_clusters(const TransportView& transport, const RowLight& light, std::uint64_t first,
                      std::span<Rgb> out) {
    const auto count = static_cast<std::size_t>(transport.basis.weight_count);
    const auto* weights = static_cast<const std::uint8_t*>(transport.codes) + first * count;
    std::array<Rgb, 1 + kMaxClusterWeights> rows;
    std::uint32_t projected = transport.basis.cluster_count;  // none
    for (std::size_t k = 0; k < out.size(); ++k) {
        const std::uint32_t cluster = cluster_of(transport, first + k);
        if (cluster != projected) {
            project_rows(transport.basis, light, cluster * (count + 1),
                         std::span(rows).first(count + 1));
            projected = cluster;
        }
        out[k] = weighted(rows.data(), weights + k * count, count);
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
    const RowLight light(transport.bands, transport.channels, lighting, transport.range);
    const std::uint64_t begin = first * light.row_size();
    switch (transport.encoding) {
        case TransportEncoding::Float:
            if (transport.values.is_half) {
                light.exit(static_cast<const HalfBits*>(transport.values.data) + begin, out);
            } else {
                light.exit(static_cast<const float*>(transport.values.data) + begin, out);
            }
            break;
        case TransportEncoding::Unorm16:
            light.exit(static_cast<const std::uint16_t*>(transport.codes) + begin, out);
            break;
        case TransportEncoding::Unorm8:
            light.exit(static_cast<const std::uint8_t*>(transport.codes) + begin, out);
            break;
        case TransportEncoding::Clustered:
            exit_of_clusters(transport, light, first, out);
            break;
    }
    add_emitted(transport, first, out);
}

void project_light(const ClusterBasisView& basis, const ShLightingView& lighting,
                   std::span<Rgb> out) noexcept {
    const std::size_t rows = static_cast<std::size_t>(basis.weight_count) + 1;
    if (basis.cluster_count == 0 || out.size() != rows * basis.cluster_count) return;
    project_rows(basis, RowLight(basis.bands, basis.channels, lighting, nullptr), 0, out);
}

void diffuse_exit(const TransportView& transport, std::span<const Rgb> projected,
                  std::uint64_t first, std::span<Rgb> out) noexcept {
    const auto count = static_cast<std::size_t>(transport.basis.weight_count);
    if (transport.encoding != TransportEncoding::Clustered ||
        projected.size() != (count + 1) * transport.basis.cluster_count) {
        std::fill(out.begin(), out.end(), Rgb{});
        return;
    }
    out = existing(transport, first, out);
    const auto* weights = static_cast<const std::uint8_t*>(transport.codes) + first * count;
    for (std::size_t k = 0; k < out.size(); ++k) {
        out[k] = weighted(&projected[cluster_of(transport, first + k) * (count + 1)],
                          weights + k * count, count);
    }
    add_emitted(transport, first, out);
}

}  // namespace envbake::runtime
