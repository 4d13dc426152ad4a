// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/visible_transport.h"

#include "baker/math/frame.h"
#include "baker/math/simd.h"
#include "baker/transport/diffuse.h"

#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace envbake {

namespace {

struct WorldDirections {
    Float16 x, y, z;
};

WorldDirections to_world(const DirectionPacket& local, const Frame& frame) {
    const auto axis = [](const DVec3& v, int i) { return static_cast<float>(v[i]); };
    const auto lx = load<Float16>(local.x.data()), ly = load<Float16>(local.y.data()),
               lz = load<Float16>(local.z.data());
    const auto component = [&](int i) {
        return lx * axis(frame.tangent, i) + ly * axis(frame.bitangent, i) +
               lz * axis(frame.normal, i);
    };
    return {component(0), component(1), component(2)};
}

/// Weights of the rays in `mask`, 0 elsewhere.
Float16 masked(const std::array<float, 16>& weights, std::uint32_t mask) {
    using Int16 = int __attribute__((vector_size(64)));
    constexpr Int16 kBit = {1 << 0, 1 << 1, 1 << 2,  1 << 3,  1 << 4,  1 << 5,  1 << 6,  1 << 7,
                            1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15};
    const Int16 bits = Int16{} + static_cast<int>(mask);
    const Int16 chosen = ((bits & kBit) != 0) & load<Int16>(weights.data());  // -1 or 0 a lane
    return load<Float16>(&chosen);
}

/// Sum of w_k Y_i over the rays whose bit is set. The number of bands is a constant of each
/// instance, so that the recurrence unrolls into straight arithmetic.
template <int kBands>
void project(const RaySet& set, const Frame& frame, std::span<const std::uint16_t> masks,
             std::uint16_t flip, double* out) {
    constexpr std::size_t kCoeffs = sh::coeff_count(kBands);
    std::array<Float16, kCoeffs> sums{};
    for (std::size_t p = 0; p < masks.size(); ++p) {
        const auto mask = static_cast<std::uint16_t>(masks[p] ^ flip);
        if (mask == 0) continue;
        const WorldDirections w = to_world(set.directions[p], frame);
        std::array<Float16, kCoeffs> basis;
        sh::evaluate(kBands, w.x, w.y, w.z, basis.data());
        const Float16 weights = masked(set.weights[p], mask);
        for (std::size_t i = 0; i < kCoeffs; ++i) sums[i] += weights * basis[i];
    }
    for (std::size_t i = 0; i < kCoeffs; ++i) {
        out[i] = 0;
        for (int lane = 0; lane < kFloatLanes; ++lane) out[i] += static_cast<double>(sums[i][lane]);
    }
}

using Project = void (*)(const RaySet&, const Frame&, std::span<const std::uint16_t>, std::uint16_t,
                         double*);
template <int... kLess>
constexpr std::array<Project, sizeof...(kLess)> projections(std::integer_sequence<int, kLess...>) {
    return {project<kLess + 1>...};
}
constexpr auto kProject = projections(std::make_integer_sequence<int, kMaxRowBands>());

int bands_of(std::size_t coeffs) {
    return static_cast<int>(std::lround(std::sqrt(coeffs)));
}

}  // namespace

void blocked_about_normal(const RaySet& set, double turn_rad, std::span<const std::uint16_t> masks,
                          std::span<double> out) {
    const Frame frame = turned(Frame{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, turn_rad);
    kProject[static_cast<std::size_t>(bands_of(out.size()) - 1)](set, frame, masks, 0, out.data());
}

Traced visible_transport(const RaySet& set, const Tracer& tracer, const RayOrigin& origin,
                         double turn_rad, std::span<float> row, Stop stop,
                         std::span<std::uint16_t> masks_wanted) {
    const Frame frame = turned(frame_about(origin.normal), turn_rad);
    thread_local std::vector<std::uint16_t> masks;
    masks.assign(set.directions.size(), 0);
    Traced traced;
    const auto trace = [&](std::size_t begin, std::size_t end) {
        unsigned before = 0;  // the last ray of the packet before
        for (std::size_t p = begin; p < end; ++p) {
            const WorldDirections w = to_world(set.directions[p], frame);
            DirectionPacket world;
            store(w.x, world.x.data());
            store(w.y, world.y.data());
            store(w.z, world.z.data());
            const std::uint32_t mask = tracer.occluded16(origin.position, world);
            masks[p] = static_cast<std::uint16_t>(mask);
            if (p == begin) before = mask & 1;
            traced.crossings += std::popcount((mask ^ (mask << 1 | before)) & 0xffff);
            before = mask >> 15;
            traced.blocked += std::popcount(mask);
            traced.rays += 16;
        }
    };
    trace(0, set.pilot_packets);
    traced.solved = stop == Stop::WhereSolved && traced.rays > 0 &&
                    (traced.blocked == 0 || traced.blocked == traced.rays);
    if (!traced.solved) trace(set.pilot_packets, set.directions.size());

    std::copy_n(masks.begin(), masks_wanted.size(), masks_wanted.begin());

    const int bands = bands_of(row.size());
    std::array<double, sh::coeff_count(kMaxRowBands)> base{}, sum;
    const bool sum_blocked = 2 * traced.blocked <= traced.rays;
    if (sum_blocked) unoccluded_transport(bands, origin.normal, base);
    kProject[static_cast<std::size_t>(bands - 1)](
        set, frame, std::span(masks).first(static_cast<std::size_t>(traced.rays / 16)),
        static_cast<std::uint16_t>(sum_blocked ? 0 : 0xffff), sum.data());
    for (std::size_t i = 0; i < row.size(); ++i)
        row[i] = static_cast<float>(sum_blocked ? base[i] - sum[i] : sum[i]);
    return traced;
}

}  // namespace envbake
