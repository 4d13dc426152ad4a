// SPDX-License-Identifier: Apache-2.0
#include "baker/lighting/dominant_lights.h"

#include "baker/core/parallel.h"
#include "baker/lighting/texel_runs.h"
#include "baker/math/simd.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <iterator>
#include <numbers>
#include <utility>

namespace envbake {
namespace {

using lighting::SourcePatch;
using lighting::TexelLines;
using lighting::TexelRun;
using std::numbers::pi;

/// Of the least mean luminance that a light can have: the lower, the more of a light's fringe is
/// found with it, and the more texels are looked at. At a quarter, 72 % of the flux of a Gaussian
/// source of 2 degrees that just reaches the share.
constexpr double kFirstLevel = 0.25;
/// How far a part of a light may be from its direction, in its largest angular radii.
constexpr double kReach = 2;
/// Weaker sets are not followed: it bounds their number, and the work of joining them.
constexpr double kLeastPart = 1.0 / 16;

std::size_t slot(int i) {
    return static_cast<std::size_t>(i);
}

template <class V>
double luminance(const V& rgb) {
    return 0.2126 * static_cast<double>(rgb.x) + 0.7152 * static_cast<double>(rgb.y) +
           0.0722 * static_cast<double>(rgb.z);
}

/// Solid angle of a disc of some angular radius.
double cap(double radius) {
    return 4 * pi * std::pow(std::sin(radius / 2), 2);
}

/// What a light adds to its surroundings in one texel.
DVec3 excess(const Vec3& radiance, const Vec3& surroundings) {
    return DVec3(radiance) - DVec3(glm::min(radiance, surroundings));
}

struct Texels {
    TexelLines lines;
    const Vec3* radiance;

    const Vec3* line(int i) const { return radiance + slot(i) * slot(lines.width()); }
};

// ---- the whole map -----------------------------------------------------------------------------

struct Survey {
    double flux = 0;                ///< of luminance, W m^-2
    double peak = 0;                ///< highest luminance
    std::vector<double> line_peak;  ///< of every line
};

Survey survey(const Texels& texels) {
    const TexelLines& lines = texels.lines;
    Survey result;
    result.line_peak.resize(slot(lines.count()));
    std::vector<double> row_flux(slot(lines.rows()), 0.0);
    const int padded = (lines.width() + kDoubleLanes - 1) / kDoubleLanes * kDoubleLanes;
    // The faces of a cube share the solid angles of a row.
    parallel_for(slot(lines.rows()), [&](std::size_t row) {
        std::vector<double> omega(slot(padded)), L(slot(padded));
        for (int c = 0; c < lines.width(); ++c) {
            omega[slot(c)] = lines.solid_angle(static_cast<int>(row), c);
        }
        for (int face = 0; face < lines.faces(); ++face) {
            const int line = face * lines.rows() + static_cast<int>(row);
            const Vec3* radiance = texels.line(line);
            for (int c = 0; c < lines.width(); ++c) L[slot(c)] = luminance(radiance[c]);
            Double8 flux{}, peak{};
            for (int c = 0; c < padded; c += kDoubleLanes) {
                const auto some = load<Double8>(L.data() + c);
                flux += some * load<Double8>(omega.data() + c);
                peak = some > peak ? some : peak;
            }
            row_flux[row] += sum(flux);
            for (int k = 0; k < kDoubleLanes; ++k) {
                result.line_peak[slot(line)] = std::max(result.line_peak[slot(line)], peak[k]);
            }
        }
    });
    for (const double flux : row_flux) result.flux += flux;
    for (const double peak : result.line_peak) result.peak = std::max(result.peak, peak);
    return result;
}

/// Appends the runs above `level` within begin .. end - 1 of a line.
void add_runs_above(double level, const Texels& texels, const TexelRun& within,
                    std::vector<TexelRun>& runs) {
    const Vec3* radiance = texels.line(within.line);
    for (int c = within.begin; c < within.end; ++c) {
        if (!(luminance(radiance[c]) > level)) continue;
        const int begin = c;
        while (c < within.end && luminance(radiance[c]) > level) ++c;
        runs.push_back({within.line, begin, c});
    }
}

std::vector<TexelRun> runs_above(double level, const Texels& texels, const Survey& whole) {
    constexpr std::size_t kLinesPerBlock = 16;
    const std::size_t count = slot(texels.lines.count());
    const std::size_t blocks = (count + kLinesPerBlock - 1) / kLinesPerBlock;
    std::vector<std::vector<TexelRun>> found(blocks);
    parallel_for(blocks, [&](std::size_t block) {
        const std::size_t first = block * kLinesPerBlock;
        for (std::size_t i = first; i < std::min(first + kLinesPerBlock, count); ++i) {
            if (!(whole.line_peak[i] > level)) continue;
            const TexelRun line{static_cast<int>(i), 0, texels.lines.width()};
            add_runs_above(level, texels, line, found[block]);
        }
    });
    std::vector<TexelRun> runs;
    for (auto& part : found) {
        runs.insert(runs.end(), part.begin(), part.end());
        part = {};
    }
    return runs;
}

// ---- one light ---------------------------------------------------------------------------------

/// A connected set of texels, and what surrounds it.
struct Part {
    std::vector<TexelRun> runs;
    Vec3 surroundings{0};
};

struct Source {
    std::vector<Part> parts;
    DominantLight light;
    double reach = 0;  ///< radians from the direction to the centre of the furthest texel
};

template <class Visit>
void for_texels(const std::vector<Part>& parts, const Texels& texels, const Visit& visit) {
    for (const Part& part : parts) {
        for (const TexelRun& run : part.runs) {
            const Vec3* radiance = texels.line(run.line);
            for (int c = run.begin; c < run.end; ++c) {
                visit(texels.lines.patch(run.line, c), excess(radiance[c], part.surroundings));
            }
        }
    }
}

double angle_between(const DVec3& a, const DVec3& b) {
    return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
}

/// Integrates the parts; map_flux is that of the whole map.
Source integrate(std::vector<Part> parts, const Texels& texels, double map_flux) {
    Source source{std::move(parts), {}, 0};
    DominantLight& light = source.light;
    double flux = 0, square = 0, peak = 0;
    DVec3 towards{0};
    for_texels(source.parts, texels, [&](const SourcePatch& patch, const DVec3& rgb) {
        const double L = luminance(rgb);
        light.irradiance += rgb * patch.omega;
        flux += L * patch.omega;
        square += L * L * patch.omega;
        towards += L * patch.omega * patch.centre;
        if (L > peak) {
            peak = L;
            light.direction_error =
                std::hypot(glm::length(patch.half_a), glm::length(patch.half_b));
        }
    });
    if (!(flux > 0)) return source;
    light.direction = glm::normalize(towards);
    light.solid_angle = flux * flux / square;
    light.share = flux / map_flux;

    // 1 - c.d = |c - d|^2 / 2 + (1 - |c|^2) / 2 keeps the digits of a small source.
    double lack = 0;
    for_texels(source.parts, texels, [&](const SourcePatch& patch, const DVec3& rgb) {
        const DVec3 off = patch.centre - light.direction;
        lack += luminance(rgb) * patch.omega * (glm::dot(off, off) / 2 + patch.variance);
        source.reach = std::max(source.reach, angle_between(patch.centre, light.direction));
    });
    light.angular_radius = 2 * std::asin(std::sqrt(std::min(1.0, lack / flux)));
    return source;
}

/// The mean radiance of the texels around a set of all that is above `level`.
Vec3 surroundings_of(const std::vector<TexelRun>& runs, double level, const Texels& texels) {
    DVec3 sum{0};
    double omega = 0;
    for (const TexelRun& run : runs) {
        texels.lines.for_neighbours(run, [&](const TexelRun& span) {
            const Vec3* radiance = texels.line(span.line);
            for (int c = span.begin; c < span.end; ++c) {
                if (luminance(radiance[c]) > level) continue;  // of the set
                const double d_omega = texels.lines.solid_angle(span.line, c);
                sum += d_omega * DVec3(radiance[c]);
                omega += d_omega;
            }
        });
    }
    return omega > 0 ? Vec3(sum / omega) : Vec3(0);
}

// ---- all lights --------------------------------------------------------------------------------

/// A set that has too little flux for a light is dropped; one that is small and distinct is a
/// candidate; what is left may hold one at a higher level.
class Search {
  public:
    Search(const DominantLightsJob& job, const Texels& texels, double map_flux)
        : job_(job),
          texels_(texels),
          map_flux_(map_flux),
          largest_(cap(kReach * job.max_angular_radius)) {}

    std::vector<Source> run(const Survey& whole) {
        double level = kFirstLevel * job_.min_share * map_flux_ / cap(job_.max_angular_radius);
        std::vector<TexelRun> runs = runs_above(level, texels_, whole);
        while (!runs.empty()) {
            runs = remaining(runs, level);
            level *= std::numbers::sqrt2;
            std::vector<TexelRun> higher;
            for (const TexelRun& run : runs) add_runs_above(level, texels_, run, higher);
            runs = std::move(higher);
        }
        return std::move(candidates_);
    }

  private:
    /// Takes the candidates out of `runs`, all that is above `level`.
    std::vector<TexelRun> remaining(const std::vector<TexelRun>& runs, double level) {
        const auto connected = lighting::connect(texels_.lines, runs);
        std::vector<double> flux(slot(connected.count)), omega(slot(connected.count));
        for (std::size_t i = 0; i < runs.size(); ++i) {
            const auto set = slot(connected.label[i]);
            const Vec3* radiance = texels_.line(runs[i].line);
            for (int c = runs[i].begin; c < runs[i].end && omega[set] <= largest_; ++c) {
                const double d_omega = texels_.lines.solid_angle(runs[i].line, c);
                omega[set] += d_omega;
                flux[set] += d_omega * luminance(radiance[c]);
            }
        }
        // Sets worth measuring get a number, the faint ones none, the large ones stay.
        constexpr int kFaint = -1, kLarge = -2;
        std::vector<int> verdict(slot(connected.count));
        int small_count = 0;
        for (std::size_t set = 0; set < verdict.size(); ++set) {
            const bool is_faint = flux[set] < kLeastPart * job_.min_share * map_flux_;
            verdict[set] = omega[set] > largest_ ? kLarge : is_faint ? kFaint : small_count++;
        }
        std::vector<std::vector<TexelRun>> small(slot(small_count));
        for (std::size_t i = 0; i < runs.size(); ++i) {
            const int number = verdict[slot(connected.label[i])];
            if (number >= 0) small[slot(number)].push_back(runs[i]);
        }
        std::vector<bool> taken;
        for (std::vector<TexelRun>& set : small) taken.push_back(is_candidate(set, level));
        std::vector<TexelRun> left;
        for (std::size_t i = 0; i < runs.size(); ++i) {
            const int number = verdict[slot(connected.label[i])];
            if (number == kLarge || (number >= 0 && !taken[slot(number)])) left.push_back(runs[i]);
        }
        return left;
    }

    bool is_candidate(std::vector<TexelRun>& runs, double level) {
        const Vec3 around = surroundings_of(runs, level, texels_);
        Source source = integrate({Part{std::move(runs), around}}, texels_, map_flux_);
        const DominantLight& light = source.light;
        const bool small = source.reach <= kReach * job_.max_angular_radius &&
                           light.angular_radius <= job_.max_angular_radius;
        const bool distinct = luminance(light.irradiance) > luminance(around) * light.solid_angle;
        if (!small || !distinct) return false;
        candidates_.push_back(std::move(source));
        return true;
    }

    const DominantLightsJob& job_;
    const Texels& texels_;
    double map_flux_;
    double largest_;  ///< solid angle of a set that can be small, sr
    std::vector<Source> candidates_;
};

void sort_by_share(std::vector<Source>& sources) {
    std::stable_sort(sources.begin(), sources.end(), [](const Source& a, const Source& b) {
        return a.light.share > b.light.share;
    });
}

/// From the strongest on, each takes in those that lie wholly within `radius` of it.
std::vector<Source> join_near(std::vector<Source> sources, double radius, const Texels& texels,
                              double map_flux) {
    sort_by_share(sources);
    std::vector<Source> joined;
    std::vector<bool> taken(sources.size());
    for (std::size_t i = 0; i < sources.size(); ++i) {
        if (taken[i]) continue;
        Source source = std::move(sources[i]);
        bool grown = false;
        for (std::size_t j = i + 1; j < sources.size(); ++j) {
            if (taken[j]) continue;
            const double away = angle_between(source.light.direction, sources[j].light.direction);
            if (away + sources[j].reach > radius) continue;
            std::move(sources[j].parts.begin(), sources[j].parts.end(),
                      std::back_inserter(source.parts));
            taken[j] = grown = true;
        }
        joined.push_back(grown ? integrate(std::move(source.parts), texels, map_flux)
                               : std::move(source));
    }
    sort_by_share(joined);
    return joined;
}

}  // namespace

DominantLights find_dominant_lights(const DominantLightsJob& job, const Environment& environment) {
    assert(job.max_angular_radius > 0 && job.min_share > 0);
    const Texels texels{TexelLines(environment.grid), environment.radiance.data()};
    const Survey whole = survey(texels);
    DominantLights result;
    if (!(whole.flux > 0)) return result;
    result.peak_over_mean = whole.peak / (whole.flux / (4 * pi));

    std::vector<Source> sources = Search(job, texels, whole.flux).run(whole);
    sources = join_near(std::move(sources), job.max_angular_radius, texels, whole.flux);
    if (!sources.empty()) result.strongest_share = sources.front().light.share;
    for (const Source& source : sources) {
        if (source.light.share < job.min_share) break;
        result.lights.push_back(source.light);
        for (const Part& part : source.parts) {
            for (const TexelRun& run : part.runs) {
                result.texels.push_back(
                    {slot(run.line) * slot(texels.lines.width()) + slot(run.begin),
                     slot(run.end - run.begin), part.surroundings});
            }
        }
    }
    return result;
}

void remove_lights(const DominantLights& lights, Environment& environment) {
    for (const LightTexels& run : lights.texels) {
        for (std::size_t i = run.first; i < run.first + run.count; ++i) {
            environment.radiance[i] = glm::min(environment.radiance[i], run.surroundings);
        }
    }
}

}  // namespace envbake
