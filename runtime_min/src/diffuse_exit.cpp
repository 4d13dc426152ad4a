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

/// A light as rows of one kind meet it: what each number of a row is multiplied by, and what comes
/// on top of the sum.
class RowLight {
  public:
    /// `range`: low and step of each number of a row; null where rows are the numbers themselves.
    RowLight(int bands, int channels, const ShLightingView& lighting, const float* range)
        : channels_(static_cast<std::size_t>(channels)) {
        const auto coeffs = static_cast<std::size_t>(sh::coeff_count(bands));
        row_size_ = coeffs * channels_;
        shared_ = std::min(coeffs, lighting.coeffs.size() / 3);
        for (std::size_t i = 0; i < shared_; ++i) {
            for (std::size_t c = 0; c < 3; ++c) {
                const std::size_t slot = channels_ == 3 ? 3 * i + c : i;
                const float light = lighting.coeffs[3 * i + c];
                const float step = range != nullptr ? range[2 * slot + 1] : 1;
                if (range != nullptr) low_[c] += light * range[2 * slot];
                factors_[channels_ == 3 ? slot : c * kMaxCoeffs + i] = light * step;
            }
        }
    }

    std::size_t row_size() const { return row_size_; }

    /// `row`: row_size() numbers.
    template <class T>
    Rgb exit(const T* row) const {
        return channels_ == 3 ? coloured(row) : grey(row);
    }

  private:
    template <class T>
    Rgb grey(const T* row) const {
        const float *red = factors_.data(), *green = red + kMaxCoeffs, *blue = green + kMaxCoeffs;
        Float8 r{}, g{}, b{};
        std::size_t i = 0;
        for (; i + kLanes <= shared_; i += kLanes) {
            const Float8 t = load8(row + i);
            r += t * load8(red + i);
            g += t * load8(green + i);
            b += t * load8(blue + i);
        }
        Rgb out{low_[0] + sum(r), low_[1] + sum(g), low_[2] + sum(b)};
        for (; i < shared_; ++i) {
            const float t = to_float(row[i]);
            out[0] += t * red[i];
            out[1] += t * green[i];
            out[2] += t * blue[i];
        }
        return out;
    }

    /// Lane k of vector v holds channel (8 v + k) mod 3.
    template <class T>
    Rgb coloured(const T* row) const {
        Float8 sums[3] = {};
        const std::size_t count = 3 * shared_;
        std::size_t i = 0;
        for (; i + 3 * kLanes <= count; i += 3 * kLanes) {
            for (std::size_t v = 0; v < 3; ++v) {
                sums[v] += load8(row + i + v * kLanes) * load8(factors_.data() + i + v * kLanes);
            }
        }
        Rgb out = low_;
        for (std::size_t k = 0; k < 3 * kLanes; ++k) {
            out[k % 3] += lane(sums[k / kLanes], k % kLanes);
        }
        for (; i < count; ++i) out[i % 3] += to_float(row[i]) * factors_[i];
        return out;
    }

    std::size_t channels_, row_size_ = 0, shared_ = 0;
    std::array<float, 3 * kMaxCoeffs> factors_;  ///< [3][kMaxCoeffs]; coloured rows: as they lie
    Rgb low_{};
};

template <class T>
void exit_of_rows(const T* rows, const RowLight& light, std::span<Rgb> out) {
    for (Rgb& value : out) {
        value = light.exit(rows);
        rows += light.row_size();
    }
}

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
        exit_of_rows(rows + first * light.row_size(), light, out);
    } else {
        const auto* rows = static_cast<const float*>(basis.rows.data);
        exit_of_rows(rows + first * light.row_size(), light, out);
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
                exit_of_rows(static_cast<const HalfBits*>(transport.values.data) + begin, light,
                             out);
            } else {
                exit_of_rows(static_cast<const float*>(transport.values.data) + begin, light, out);
            }
            break;
        case TransportEncoding::Unorm16:
            exit_of_rows(static_cast<const std::uint16_t*>(transport.codes) + begin, light, out);
            break;
        case TransportEncoding::Unorm8:
            exit_of_rows(static_cast<const std::uint8_t*>(transport.codes) + begin, light, out);
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
