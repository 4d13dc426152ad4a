// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/transport_truth.h"

#include "baker/core/parallel.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <random>

namespace envbake::bench {

namespace {

using std::numbers::pi;

/// 16 bits a coordinate: every interval of the tree swaps its halves or does not, by a coin.
std::vector<std::uint16_t> scrambling_tree(std::mt19937_64& random) {
    std::vector<std::uint16_t> level{0}, next;
    std::uint64_t coins = 0;
    int left = 0;
    for (int bit = 0; bit < 16; ++bit) {
        next.resize(2 * level.size());
        for (std::size_t i = 0; i < level.size(); ++i) {
            if (left == 0) {
                coins = random();
                left = 64;
            }
            const std::uint64_t coin = coins & 1;
            coins >>= 1;
            --left;
            next[2 * i] = static_cast<std::uint16_t>(2 * level[i] + coin);
            next[2 * i + 1] = static_cast<std::uint16_t>(2 * level[i] + 1 - coin);
        }
        level.swap(next);
    }
    return level;
}

std::uint16_t radical_inverse(unsigned i) {
    unsigned reversed = 0;
    for (int bit = 0; bit < 16; ++bit) reversed |= (i >> bit & 1u) << (15 - bit);
    return static_cast<std::uint16_t>(reversed);
}

/// The second coordinate: generator matrix of Pascal's triangle modulo 2.
std::uint16_t sobol(unsigned i) {
    unsigned column = 1u << 15, x = 0;
    for (; i != 0; i >>= 1) {
        if ((i & 1u) != 0) x ^= column;
        column ^= column >> 1;
    }
    return static_cast<std::uint16_t>(x);
}

}  // namespace

TransportTruth::TransportTruth(int bands) : bands_(bands) {
    constexpr int kSteps = 2000;
    for (int l = 0; l < bands; ++l) {
        double sum = 0;
        for (int i = 0; i <= kSteps; ++i) {
            const double z = static_cast<double>(i) / kSteps;
            const double weight = i == 0 || i == kSteps ? 1 : i % 2 == 1 ? 4 : 2;
            sum += weight * z * std::legendre(static_cast<unsigned>(l), z) / (3.0 * kSteps);
        }
        zonal_.push_back(2 * sum);
        for (int m = 0; m <= l; ++m) {
            double ratio = 1;  // (l - m)! / (l + m)!
            for (int k = l - m + 1; k <= l + m; ++k) ratio /= k;
            normalizer_.push_back(std::sqrt((m == 0 ? 1 : 2) * (2 * l + 1) / (4 * pi) * ratio));
        }
    }
}

double TransportTruth::unoccluded_norm() const {
    double sum = 0;
    for (int l = 0; l < bands_; ++l) {
        const double a = zonal_[static_cast<std::size_t>(l)];
        sum += a * a * (2 * l + 1) / (4 * pi);
    }
    return std::sqrt(sum);
}

/// Real SH without the Condon-Shortley phase: P_lm / sin^m by upward recurrence in l, times the
/// real and imaginary part of (x + iy)^m.
void TransportTruth::basis(const DVec3& w, std::span<double> y) const {
    double diagonal = 1, real = 1, imaginary = 0;
    for (int m = 0; m < bands_; ++m) {
        double before = 0, legendre = diagonal;
        for (int l = m; l < bands_; ++l) {
            const double k = normalizer_[static_cast<std::size_t>(l * (l + 1) / 2 + m)] * legendre;
            y[static_cast<std::size_t>(l * l + l + m)] = k * real;
            if (m > 0) y[static_cast<std::size_t>(l * l + l - m)] = k * imaginary;
            const double above = ((2 * l + 1) * w.z * legendre - (l + m) * before) / (l + 1 - m);
            before = legendre;
            legendre = above;
        }
        diagonal *= 2 * m + 1;
        const double turned = real * w.x - imaginary * w.y;
        imaginary = real * w.y + imaginary * w.x;
        real = turned;
    }
}

std::vector<double> TransportTruth::at(const RayOrigin& origin, const Tracer& tracer,
                                       std::uint64_t seed, int log_rays) const {
    std::mt19937_64 random(seed);
    const std::vector<std::uint16_t> tree_u = scrambling_tree(random),
                                     tree_v = scrambling_tree(random);
    std::uniform_real_distribution<double> within(0, 1);
    const DVec3& n = origin.normal;
    const DVec3 aside = std::abs(n.x) < 0.5 ? DVec3(1, 0, 0) : DVec3(0, 1, 0);
    const DVec3 tangent = glm::normalize(glm::cross(aside, n)), bitangent = glm::cross(n, tangent);

    const unsigned count = 1u << log_rays;
    std::vector<double> blocked(static_cast<std::size_t>(bands_ * bands_), 0), open(blocked);
    std::vector<double> y(blocked);
    unsigned blocked_count = 0;
    for (unsigned first = 0; first < count; first += 16) {
        DirectionPacket packet;
        DVec3 directions[16];
        for (unsigned i = 0; i < 16; ++i) {
            const double u = (tree_u[radical_inverse(first + i)] + within(random)) * 0x1p-16;
            const double phi = 2 * pi * (tree_v[sobol(first + i)] + within(random)) * 0x1p-16;
            const double r = std::sqrt(u);
            const DVec3 w = tangent * (r * std::cos(phi)) + bitangent * (r * std::sin(phi)) +
                            n * std::sqrt(1 - u);
            directions[i] = w;
            packet.x[i] = static_cast<float>(w.x);
            packet.y[i] = static_cast<float>(w.y);
            packet.z[i] = static_cast<float>(w.z);
        }
        const std::uint32_t mask = tracer.occluded16(origin.position, packet);
        for (unsigned i = 0; i < 16; ++i) {
            const bool is_blocked = (mask >> i & 1) != 0;
            blocked_count += is_blocked;
            basis(directions[i], y);
            std::vector<double>& sum = is_blocked ? blocked : open;
            for (std::size_t c = 0; c < y.size(); ++c) sum[c] += y[c] / count;
        }
    }
    if (2 * blocked_count > count) return open;
    basis(n, y);
    for (int l = 0; l < bands_; ++l)
        for (int m = -l; m <= l; ++m) {
            const auto c = static_cast<std::size_t>(l * l + l + m);
            blocked[c] = zonal_[static_cast<std::size_t>(l)] * y[c] - blocked[c];
        }
    return blocked;
}

std::vector<Place> random_places(const Scene& scene, std::size_t count) {
    std::vector<Place> all, places;
    for (std::size_t m = 0; m < scene.meshes.size(); ++m)
        for (std::uint32_t v = 0; v < scene.meshes[m].vertex_count(); ++v) all.push_back({m, v});
    std::sample(all.begin(), all.end(), std::back_inserter(places), count, std::mt19937(1));
    return places;
}

std::vector<std::vector<double>> find_truth(int bands, const Scene& scene, const Tracer& tracer,
                                            const std::vector<Place>& places, int log_rays) {
    const TransportTruth truth(bands);
    std::vector<SurfacePoints> points;
    for (const Mesh& mesh : scene.meshes) points.emplace_back(mesh);
    std::vector<std::vector<double>> rows(places.size());
    parallel_for(places.size(), [&](std::size_t i) {
        const SurfacePoints& surface = points[places[i].mesh];
        const std::uint32_t place = surface.representative(places[i].vertex);
        rows[i] = place == SurfacePoints::kNone
                      ? std::vector<double>(static_cast<std::size_t>(bands * bands), 0)
                      : truth.at(surface.origin(place, tracer.space()), tracer,
                                 0x7275746800000000u + i, log_rays);
    });
    return rows;
}

}  // namespace envbake::bench
