// SPDX-License-Identifier: Apache-2.0
// Error against time of the lighting stages, and of the textbook methods beside them, as CSV:
//
//     stage,input,method,setting,cpu_s,worst,rms,energy
//
// cpu_s    CPU seconds over all threads, the least of the repetitions
// worst    largest error of all that were compared
// rms      of a random sample; for mips weighted by solid angle, sqrt(sum w (v - r)^2 / sum w r^2)
// energy   mips: the mean of the map that is gained or lost, relative, the worst of the levels
//
// Mips: |v - r| / (r + 1e-3 mean), r by brute force over the source's own texels
// (tests/support/prefilter_reference.h), on random texels and on those beside the brightest texel
// of the map and at its horizon. Table: |A or B - truth|. SH: |c - truth| / |c_00|.
#include "baker/brdf/albedo_integral.h"
#include "baker/brdf/table.h"
#include "baker/core/random.h"
#include "baker/input/read_environment.h"
#include "baker/lighting/mips.h"
#include "baker/lighting/sh_projection.h"
#include "tests/bench/sampled_prefilter.h"
#include "tests/bench/sampled_sh.h"
#include "tests/bench/sampled_table.h"
#include "tests/support/baked_mip.h"
#include "tests/support/prefilter_reference.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace envbake::bench {
namespace {

const std::vector<float> kRoughness{0.25f, 0.5f, 0.75f, 1};
const std::vector<int> kLevels{1, 2, 3, 4};
constexpr int kFaceSize = 256;

struct Error {
    double worst = 0, rms = 0, energy = 0;
};

double cpu_seconds() {
    return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

/// The least CPU time of some runs, for at least a quarter of a second.
double timed(const std::function<void()>& work) {
    double least = std::numeric_limits<double>::max(), total = 0;
    for (int run = 0; run < 20 && (run == 0 || total < 0.25); ++run) {
        const double begin = cpu_seconds();
        work();
        const double taken = cpu_seconds() - begin;
        least = std::min(least, taken);
        total += taken;
    }
    return least;
}

void print(const std::string& stage, const std::string& input, const std::string& method,
           double setting, double seconds, const Error& error) {
    std::printf("%s,%s,%s,%g,%.4g,%.3g,%.3g,%.3g\n", stage.c_str(), input.c_str(), method.c_str(),
                setting, seconds, error.worst, error.rms, error.energy);
    std::fflush(stdout);
}

// ---- mips ---------------------------------------------------------------------------------------

Mip empty_mip(std::size_t k) {
    Mip mip;
    mip.level = kLevels[k];
    mip.width = mip.height = kFaceSize >> kLevels[k];
    mip.perceptual_roughness = kRoughness[k];
    return mip;
}

/// Texels of every level with their true values, found once for all methods.
class MipsTruth {
  public:
    explicit MipsTruth(const Environment& environment) : reference_(environment) {
        const DVec3 bright = brightest(environment);
        for (std::size_t k = 0; k < kLevels.size(); ++k) {
            const Mip shape = empty_mip(k);
            Level level;
            RandomStream random(5, 0, k);
            const std::size_t count = test::texel_count(shape);
            for (int i = 0; i < kRandom; ++i) {
                level.texels.push_back(
                    static_cast<std::size_t>(random.next() * static_cast<double>(count)));
            }
            std::vector<std::size_t> all(count);
            for (std::size_t i = 0; i < count; ++i) all[i] = i;
            const auto nearest_to = [&](double cosine) {
                std::partial_sort(all.begin(), all.begin() + kSpecial, all.end(),
                                  [&](std::size_t a, std::size_t b) {
                                      return distance(shape, a, bright, cosine) <
                                             distance(shape, b, bright, cosine);
                                  });
                level.texels.insert(level.texels.end(), all.begin(), all.begin() + kSpecial);
            };
            nearest_to(1);
            nearest_to(0);
            for (const std::size_t texel : level.texels) {
                level.values.push_back(reference_.value(test::direction_of(shape, texel),
                                                        static_cast<double>(kRoughness[k])));
            }
            levels_.push_back(std::move(level));
        }
    }

    Error compare(const std::vector<Mip>& mips) const {
        Error error;
        double difference = 0, total = 0;
        for (std::size_t k = 0; k < mips.size(); ++k) {
            const Level& level = levels_[k];
            for (std::size_t i = 0; i < level.texels.size(); ++i) {
                const DVec3 value = test::texel_of(mips[k], level.texels[i]);
                error.worst = std::max(error.worst, reference_.error(value, level.values[i]));
                if (i >= kRandom) continue;
                const double omega = test::solid_angle_of(mips[k], level.texels[i]);
                const DVec3 d = value - level.values[i];
                difference += omega * glm::dot(d, d);
                total += omega * glm::dot(level.values[i], level.values[i]);
            }
            const DVec3 kept = test::average_of(mips[k]) / reference_.mean() - DVec3(1);
            for (int c = 0; c < 3; ++c) error.energy = std::max(error.energy, std::abs(kept[c]));
        }
        error.rms = std::sqrt(difference / total);
        return error;
    }

  private:
    static constexpr int kRandom = 200, kSpecial = 20;
    struct Level {
        std::vector<std::size_t> texels;  ///< random ones first
        std::vector<DVec3> values;
    };

    static DVec3 brightest(const Environment& environment) {
        const auto texels = test::texels_of(environment.grid);
        std::size_t best = 0;
        for (std::size_t i = 0; i < texels.size(); ++i) {
            if (environment.radiance[i].g > environment.radiance[best].g) best = i;
        }
        return texels[best].middle();
    }
    static double distance(const Mip& shape, std::size_t texel, const DVec3& from, double cosine) {
        return std::abs(glm::dot(test::direction_of(shape, texel), from) - cosine);
    }

    test::PrefilterReference reference_;
    std::vector<Level> levels_;
};

std::vector<int> sample_counts(bool quick) {
    return quick ? std::vector{64, 256} : std::vector{64, 256, 1024, 4096};
}

void measure_mips(const std::string& input, const Environment& environment, bool quick) {
    const MipsTruth truth(environment);
    for (const double tolerance : {1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4}) {
        if (quick && tolerance < 1e-3) break;
        std::vector<Mip> mips;
        const MipsJob job{.face_size = kFaceSize,
                          .perceptual_roughness = kRoughness,
                          .levels = kLevels,
                          .tolerance = tolerance};
        const double seconds = timed([&] {
            Progress progress;
            mips = bake_mips(job, environment, progress);
        });
        print("mips", input, "envbake", tolerance, seconds, truth.compare(mips));
    }
    for (const bool filtered : {false, true}) {
        for (const int samples : sample_counts(quick)) {
            std::vector<Mip> mips;
            const double seconds = timed([&] {
                mips.clear();
                const CubeChain chain = make_cube_chain(environment, kFaceSize);
                for (std::size_t k = 0; k < kLevels.size(); ++k) {
                    Mip mip = empty_mip(k);
                    for (const Vec3& L :
                         sampled_prefilter(chain, static_cast<double>(kRoughness[k]), mip.width,
                                           samples, filtered)) {
                        mip.texels.insert(mip.texels.end(), {L.x, L.y, L.z});
                    }
                    mips.push_back(std::move(mip));
                }
            });
            print("mips", input, filtered ? "filtered importance sampling" : "importance sampling",
                  samples, seconds, truth.compare(mips));
        }
    }
}

// ---- table --------------------------------------------------------------------------------------

/// Every 7th texel of linear axes.
Error compare_table(const std::vector<Vec2>& texels, int size) {
    Error error;
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < texels.size(); i += 7, ++count) {
        const auto at = [&](std::size_t k) { return (static_cast<double>(k) + 0.5) / size; };
        const auto n = static_cast<std::size_t>(size);
        const DVec2 d = DVec2(texels[i]) -
                        albedo_integral(runtime::Distribution::Ggx, {at(i % n), at(i / n)}, 40);
        error.worst = std::max({error.worst, std::abs(d.x), std::abs(d.y)});
        sum += glm::dot(d, d) / 2;
    }
    error.rms = std::sqrt(sum / static_cast<double>(count));
    return error;
}

void measure_table(bool quick) {
    constexpr int kSize = 128;
    std::vector<Vec2> texels;
    double seconds = timed([&] {
        texels = bake_brdf_table({.size = kSize, .axes = runtime::TableAxes::LinearCentres}).texels;
    });
    print("brdf", "ggx 128 x 128", "envbake", kSize, seconds, compare_table(texels, kSize));
    for (const int samples : sample_counts(quick)) {
        seconds = timed([&] { texels = sampled_table(kSize, samples); });
        print("brdf", "ggx 128 x 128", "importance sampling", samples, seconds,
              compare_table(texels, kSize));
    }
}

// ---- SH -----------------------------------------------------------------------------------------

void measure_sh(const std::string& input, const Environment& environment) {
    constexpr int kBands = 5;
    const auto truth = integrated_sh(environment, kBands);
    const auto compare = [&](const std::vector<DVec3>& coeffs) {
        Error error;
        double sum = 0;
        for (std::size_t i = 0; i < coeffs.size(); ++i) {
            const DVec3 d = (coeffs[i] - truth[i]) / truth[0];
            for (int c = 0; c < 3; ++c) error.worst = std::max(error.worst, std::abs(d[c]));
            sum += glm::dot(d, d) / 3;
        }
        error.rms = std::sqrt(sum / static_cast<double>(coeffs.size()));
        return error;
    };
    std::vector<DVec3> ours;
    const double seconds = timed([&] { ours = project_sh({.bands = kBands}, environment).coeffs; });
    print("sh", input, "envbake", kBands, seconds, compare(ours));
    Environment map = environment;
    for (int size = std::get<LatLongGrid>(map.grid).height; size >= 32; size /= 2) {
        std::vector<DVec3> coeffs;
        const double taken = timed([&] { coeffs = sampled_sh(map, kBands); });
        print("sh", input, "texel centres", size, taken, compare(coeffs));
        map = halved(map);
    }
}

}  // namespace
}  // namespace envbake::bench

/// Arguments: the stages to measure, brdf, sh or mips, none: all; the one map to do it on; "quick"
/// for the short ends of the ladders.
int main(int argc, char** argv) {
    using namespace envbake;
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    const std::vector<std::string> maps{"kloppenheim_05_1k", "studio_small_03_1k",
                                        "potsdamer_platz_1k"};
    const auto named = [&](const std::string& name) {
        return std::find(arguments.begin(), arguments.end(), name) != arguments.end();
    };
    const bool all_stages = !named("brdf") && !named("sh") && !named("mips");
    const bool all_maps = std::none_of(maps.begin(), maps.end(), named);
    const auto wanted = [&](const std::string& stage) { return all_stages || named(stage); };
    std::printf("stage,input,method,setting,cpu_s,worst,rms,energy\n");
    if (wanted("brdf")) bench::measure_table(named("quick"));
    for (const std::string& name : maps) {
        if (!all_maps && !named(name)) continue;
        const auto file =
            std::filesystem::path(ENVBAKE_TEST_DATA) / "environments" / (name + ".hdr");
        const auto environment = read_environment(file);
        if (!environment) {
            std::fprintf(stderr, "%s\n", environment.error().message.c_str());
            return 1;
        }
        if (wanted("sh")) bench::measure_sh(name, *environment);
        if (wanted("mips")) bench::measure_mips(name, *environment, named("quick"));
    }
}
