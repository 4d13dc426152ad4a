// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/sampled_prefilter.h"

#include "baker/core/parallel.h"
#include "baker/lighting/box_average.h"
#include "baker/math/frame.h"
#include "envbake/runtime/cube.h"
#include "tests/bench/hammersley.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace envbake::bench {
namespace {

using Level = CubeChain::Level;

std::size_t slot(int i) {
    return static_cast<std::size_t>(i);
}

const Vec3& texel(const Level& level, int face, int row, int column) {
    row = std::clamp(row, 0, level.size - 1);
    column = std::clamp(column, 0, level.size - 1);
    return level.texels[slot((face * level.size + row) * level.size + column)];
}

Vec3 bilinear(const Level& level, const Vec3& w) {
    const auto p = cube::project(std::array<float, 3>{w.x, w.y, w.z});
    const float x = (p.u + 1) / 2 * static_cast<float>(level.size) - 0.5f;
    const float y = (p.v + 1) / 2 * static_cast<float>(level.size) - 0.5f;
    const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
    const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
    const int face = static_cast<int>(p.face);
    return glm::mix(
        glm::mix(texel(level, face, row, column), texel(level, face, row, column + 1), fx),
        glm::mix(texel(level, face, row + 1, column), texel(level, face, row + 1, column + 1), fx),
        fy);
}

Vec3 trilinear(const CubeChain& chain, const Vec3& w, float lod) {
    const float last = static_cast<float>(chain.levels.size() - 1);
    lod = std::clamp(lod, 0.0f, last);
    const auto below = static_cast<std::size_t>(lod);
    const std::size_t above = std::min(below + 1, chain.levels.size() - 1);
    return glm::mix(bilinear(chain.levels[below], w), bilinear(chain.levels[above], w),
                    lod - static_cast<float>(below));
}

/// A light direction about n = +Z, its weight n.l and the mip that it is read from.
struct Sample {
    Vec3 l;
    float n_dot_l;
    float lod;
};

std::vector<Sample> make_samples(double alpha, int count, int source_size) {
    const double a2 = alpha * alpha;
    const double texel = 4 * std::numbers::pi / (6.0 * source_size * source_size);
    std::vector<Sample> samples;
    for (int i = 0; i < count; ++i) {
        const DVec2 u = hammersley(i, count);
        // [Walter07] eq. 35 and 36: tan^2 = a2 u / (1 - u).
        const double cos_h = std::sqrt((1 - u.x) / (1 + (a2 - 1) * u.x));
        const double sin_h = std::sqrt(std::max(0.0, 1 - cos_h * cos_h));
        const double phi = 2 * std::numbers::pi * u.y;
        const DVec3 h(sin_h * std::cos(phi), sin_h * std::sin(phi), cos_h);
        const DVec3 l = 2 * cos_h * h - DVec3(0, 0, 1);
        if (l.z <= 0) continue;
        const double q = cos_h * cos_h * (a2 - 1) + 1;
        const double pdf = a2 / (std::numbers::pi * q * q) / 4;  // D n.h / (4 v.h), v = n
        const double lod = 0.5 * std::log2(1 / (count * pdf) / texel) + 1;
        samples.push_back({Vec3(l), static_cast<float>(l.z), static_cast<float>(lod)});
    }
    return samples;
}

}  // namespace

CubeChain make_cube_chain(const Environment& environment, int size) {
    CubeChain chain;
    const std::vector<float> base =
        lighting::box_average(environment, MipLayout::CubeFaces, size, 3);
    chain.levels.push_back({size, {}});
    for (std::size_t i = 0; i < base.size(); i += 3) {
        chain.levels[0].texels.emplace_back(base[i], base[i + 1], base[i + 2]);
    }
    while (chain.levels.back().size > 1) {
        const Level& fine = chain.levels.back();
        Level coarse{fine.size / 2, {}};
        for (int face = 0; face < cube::kFaceCount; ++face) {
            for (int row = 0; row < fine.size; row += 2) {
                for (int column = 0; column < fine.size; column += 2) {
                    coarse.texels.push_back((texel(fine, face, row, column) +
                                             texel(fine, face, row, column + 1) +
                                             texel(fine, face, row + 1, column) +
                                             texel(fine, face, row + 1, column + 1)) *
                                            0.25f);
                }
            }
        }
        chain.levels.push_back(std::move(coarse));
    }
    return chain;
}

std::vector<Vec3> sampled_prefilter(const CubeChain& source, double perceptual_roughness, int size,
                                    int sample_count, bool filtered) {
    const std::vector<Sample> samples = make_samples(perceptual_roughness * perceptual_roughness,
                                                     sample_count, source.levels[0].size);
    double total = 0;
    for (const Sample& s : samples) total += static_cast<double>(s.n_dot_l);
    std::vector<Vec3> result(slot(6 * size * size));
    parallel_for(slot(6 * size), [&](std::size_t line) {
        const auto face = static_cast<cube::Face>(line / slot(size));
        const int row = static_cast<int>(line % slot(size));
        for (int column = 0; column < size; ++column) {
            const auto n = cube::texel_direction<double>(face, row, column, size);
            const Frame frame = frame_about({n[0], n[1], n[2]});
            const Vec3 t(frame.tangent), b(frame.bitangent), z(frame.normal);
            DVec3 sum(0);
            for (const Sample& s : samples) {
                const Vec3 l = t * s.l.x + b * s.l.y + z * s.l.z;
                const Vec3 L =
                    filtered ? trilinear(source, l, s.lod) : bilinear(source.levels[0], l);
                sum += DVec3(L * s.n_dot_l);
            }
            result[line * slot(size) + slot(column)] = Vec3(sum / total);
        }
    });
    return result;
}

}  // namespace envbake::bench
