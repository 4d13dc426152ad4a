// SPDX-License-Identifier: Apache-2.0
// A bake over an older bundle keeps what is the same, and gives the bytes of a bake from nothing.
#include "envbake/format/reader.h"
#include "tests/support/bundle_bytes.h"
#include "tests/support/run_program.h"
#include "tests/support/small_scene.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <set>
#include <sstream>
#include <thread>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;

/// With an option given, or given otherwise.
Arguments changed(Arguments arguments, const Arguments& option) {
    const auto at = std::find(arguments.begin(), arguments.end(), option.front());
    if (at == arguments.end()) return arguments + option;
    std::copy(std::next(option.begin()), option.end(), std::next(at));
    return arguments;
}

class Rebuild : public ::testing::Test {
  protected:
    void SetUp() override {
        scene_ = write_small_scene(folder_.path(), "scene").string();
        sky_ = write_small_sky(folder_ / "sky.hdr").string();
        other_sky_ = write_small_sky(folder_ / "other.hdr", 3).string();
        two_ = write_two_meshes(folder_.path(), "two", 4, kTwoSides).string();
    }

    struct Result {
        std::set<std::string> kept, baked;
        bool traced = true;
        std::string bytes;
    };

    static Result bake_to(const fs::path& output, const Arguments& arguments) {
        const Outcome outcome =
            envbake(Arguments{"bake"} + arguments + Arguments{"-o", output.string(), "-v"});
        EXPECT_EQ(outcome.status, 0) << outcome.err;
        Result result;
        std::istringstream lines(outcome.err);
        std::string line, tool, word, name;
        while (std::getline(lines, line)) {
            std::istringstream words(line);
            words >> tool >> word >> name;
            if (!name.empty() && name.back() == ':') name.pop_back();
            if (word == "kept") result.kept.insert(name);
            if (word == "baked") result.baked.insert(name);
            if (line == "envbake: no ray was traced") result.traced = false;
        }
        result.bytes = read_file(output);
        return result;
    }

    /// Bakes `before`, then `after` over it, which has to give the bytes of `after` alone.
    Result rebuild(const Arguments& before, const Arguments& after) {
        const fs::path output = folder_ / "over.envb", fresh = folder_ / "fresh.envb";
        fs::remove(output);
        fs::remove(fresh);
        bake_to(output, before);
        const Result over = bake_to(output, after);
        const Result alone = bake_to(fresh, after);
        EXPECT_TRUE(alone.kept.empty());
        EXPECT_TRUE(over.bytes == alone.bytes) << "the bytes differ";
        const Outcome valid = envbake({"validate", output.string()});
        EXPECT_EQ(valid.status, 0) << valid.out << valid.err;
        return over;
    }

    const std::string kTwoSides = R"("doubleSided":true,)";
    TemporaryFolder folder_;
    std::string scene_, sky_, other_sky_, two_;
    const Arguments small_{"--mip-size", "16", "--mip-count", "3", "--table-size", "16"};
};

using Names = std::set<std::string>;

// What every bake makes anew is a by-product of reading the environment.
const Names kOfFacts{"environment/sh"};

using test::operator+;  // not hidden by the next
Names operator+(Names a, const Names& b) {
    a.insert(b.begin(), b.end());
    return a;
}

TEST_F(Rebuild, AnotherEnvironmentTracesNoRay) {
    const Result result = rebuild(Arguments{scene_, "--env", sky_} + small_,
                                  Arguments{scene_, "--env", other_sky_} + small_);
    EXPECT_FALSE(result.traced);
    EXPECT_EQ(result.kept, (Names{"brdf/ggx", "mesh/0/diffuse"}));
    EXPECT_EQ(result.baked, (kOfFacts + Names{"environment/mips"}));
}

TEST_F(Rebuild, ThePlanSaysWhatIsKept) {
    const fs::path output = folder_ / "x.envb";
    bake_to(output, Arguments{scene_, "--env", sky_} + small_);
    const auto kept = [&](const Arguments& arguments) {
        const Outcome plan =
            envbake(Arguments{"plan"} + arguments + Arguments{"-o", output.string(), "--json"});
        EXPECT_EQ(plan.status, 0) << plan.err;
        Names names;
        const auto json = nlohmann::json::parse(plan.out);
        for (const auto& stage : json["stages"])
            if (stage["decision"] == "keep") names.insert(stage["output"]);
        return names;
    };
    const Arguments changed = Arguments{scene_, "--env", other_sky_} + small_;
    const Names names = kept(changed);
    EXPECT_EQ(names, (Names{"brdf/ggx", "mesh/0/diffuse"}));
    EXPECT_EQ(bake_to(output, changed).kept, names);
    EXPECT_TRUE(kept(changed + Arguments{"--rays", "40"}) ==
                (Names{"brdf/ggx", "environment/mips"}));
}

TEST_F(Rebuild, AnotherSceneKeepsTheLighting) {
    const Result result =
        rebuild(Arguments{scene_, "--env", sky_} + small_, Arguments{two_, "--env", sky_} + small_);
    EXPECT_TRUE(result.traced);
    EXPECT_EQ(result.kept, (Names{"brdf/ggx", "environment/mips"}));
}

TEST_F(Rebuild, AnOptionOfOneStageBakesThatStage) {
    const Arguments both = Arguments{two_, "--env", sky_} + small_;
    const Names all{"environment/mips", "brdf/ggx", "mesh/0/diffuse", "mesh/1/diffuse"};
    struct Case {
        Arguments more;
        Names baked, new_stages;
    };
    const Names transport{"mesh/0/diffuse", "mesh/1/diffuse"};
    for (const Case& c : std::vector<Case>{
             {{"--mip-size", "8"}, {"environment/mips"}, {}},
             {{"--mip-layout", "lat-long"}, {"environment/mips"}, {}},
             {{"--mip-count", "4"}, {"environment/mips"}, {}},
             {{"--roughness-range", "0", "0.4"}, {"environment/mips"}, {}},
             {{"--certify"}, {"environment/mips"}, {}},
             {{"--extract-lights"}, {"environment/mips"}, {}},
             {{"--table-axes", "linear"}, {"brdf/ggx"}, {}},
             {{"--area-normals"}, transport, {}},
             {{"--glossy", "all"}, transport, {"mesh/0/glossy", "mesh/1/glossy", "brdf/ggx_lobe"}},
             {{"--table-size", "8"}, {"brdf/ggx"}, {}},
             {{"--half-tables"}, {"brdf/ggx"}, {}},
             {{"--rays", "40"}, transport, {}},
             {{"--seed", "1"}, transport, {}},
             {{"--bands", "3"}, transport, {}},
             {{"--no-cast", "above"}, transport, {}},
             {{"--encoding", "unorm8"}, transport, {"encoding"}},
             {{"--bounces", "2"}, transport, {"bounces"}},
             {{"--unshadowed"}, {}, {"mesh/0/unshadowed", "mesh/1/unshadowed"}},
             {{"--irradiance"}, {}, {"environment/irradiance"}},
             {{"--distribution", "both"}, {}, {"environment/mips_beckmann", "brdf/beckmann"}},
             {{"--compress"}, {"environment/mips", "mesh/0/diffuse", "mesh/1/diffuse"}, {}},
             {{"--tolerance", "0.02"},
              {"environment/mips", "mesh/0/diffuse", "mesh/1/diffuse"},
              {}},
         }) {
        SCOPED_TRACE(c.more.front() + (c.more.size() > 1 ? " " + c.more[1] : ""));
        const Result result = rebuild(both, changed(both, c.more));
        Names kept = all;
        for (const std::string& name : c.baked) kept.erase(name);
        EXPECT_EQ(result.kept, kept);
        EXPECT_EQ(result.baked, (c.baked + c.new_stages + kOfFacts));
    }
}

// The rays are those of before; what becomes of their rows is not.
TEST_F(Rebuild, RowsThatWaitAreBakedAgainWithWhatTheyWaitFor) {
    const Names transport{"mesh/0/diffuse", "mesh/1/diffuse"};
    EXPECT_EQ(rebuild({two_, "--bounces", "1"}, {two_, "--bounces", "2"}).baked,
              (transport + Names{"bounces"}));
    EXPECT_EQ(rebuild({two_, "--encoding", "f16"}, {two_, "--encoding", "unorm16"}).baked,
              (transport + Names{"encoding"}));
}

TEST_F(Rebuild, AMeshThatIsLeftOutLeavesTheOthersAlone) {
    const Result result = rebuild({two_}, {two_, "--no-receive", "mesh/0"});
    EXPECT_EQ(result.kept, Names{"mesh/1/diffuse"});
    EXPECT_TRUE(result.baked.empty());
    EXPECT_FALSE(result.traced);
}

// Every kind of transport, read back for the answers of the self-test.
TEST_F(Rebuild, AnotherEnvironmentOverEveryKindOfTransport) {
    const std::string shining =
        write_two_meshes(folder_.path(), "shining", 4,
                         kTwoSides + R"("emissiveFactor":[0.5,0.25,0.125],)")
            .string();
    struct Case {
        std::string scene;
        Arguments options;
    };
    for (const auto& [scene, options] : std::vector<Case>{
             {two_, {"--glossy", "all"}},
             {two_, {"--glossy", "all", "--distribution", "both", "--encoding", "f16"}},
             {two_, {"--glossy", "all", "--bounces", "all", "--encoding", "unorm8"}},
             {two_, {"--bounces", "2", "--compress"}},
             {shining, {"--bounces", "2"}},
             {shining, {"--glossy", "all", "--bounces", "all", "--encoding", "cpca"}},
             {two_, {"--encoding", "unorm16", "--compress"}},
             {two_, {"--encoding", "cpca"}},
             {two_, {"--encoding", "auto", "--unshadowed"}},
             {two_, {"--half-tables", "--mip-layout", "lat-long", "--compress"}},
         }) {
        SCOPED_TRACE(options.front() + " " + options.back() + " " + scene);
        const Arguments more = small_ + options;
        const Result result = rebuild(Arguments{scene, "--env", sky_} + more,
                                      Arguments{scene, "--env", other_sky_} + more);
        EXPECT_FALSE(result.traced);
        for (const std::string& name : result.baked)
            EXPECT_EQ(name.rfind("environment/", 0), 0u) << name;
    }
}

// What they send into lobes by direction is kept with the rest, and the self-test asks about it.
TEST_F(Rebuild, AnotherEnvironmentKeepsTheLightThatSurfacesSend) {
    const std::string metal = write_metal_below_clay(folder_.path(), "metal", 2).string();
    for (const Arguments& encoding :
         std::vector<Arguments>{{"--encoding", "f32"}, {"--encoding", "cpca", "--compress"}}) {
        const Arguments more = small_ + Arguments{"--glossy", "all", "--bounces", "all"} + encoding;
        const Result result = rebuild(Arguments{metal, "--env", sky_} + more,
                                      Arguments{metal, "--env", other_sky_} + more);
        EXPECT_FALSE(result.traced);
        EXPECT_TRUE(result.kept.contains("bounces"));
        EXPECT_NE(result.bytes.find("mesh/1/reflected"), std::string::npos);
    }
}

// Their light is chosen by looking at a few vertices: these rays are traced, no others.
TEST_F(Rebuild, AnotherEnvironmentKeepsTheTransportOfWavelets) {
    const Arguments more = small_ + Arguments{"--wavelet", "16"};
    const Result result =
        rebuild(Arguments{two_, "--env", sky_} + more, Arguments{two_, "--env", other_sky_} + more);
    EXPECT_EQ(result.baked, (kOfFacts + Names{"environment/mips", "environment/wavelet"}));
    EXPECT_EQ(result.kept, (Names{"brdf/ggx", "mesh/0/diffuse", "mesh/1/diffuse", "mesh/0/wavelet",
                                  "mesh/1/wavelet", "wavelet/weight"}));

    const Result all = rebuild(Arguments{two_, "--env", sky_} + more,
                               Arguments{two_, "--env", sky_, "--irradiance"} + more);
    EXPECT_EQ(all.baked, (kOfFacts + Names{"environment/irradiance"}));
    EXPECT_FALSE(all.traced);

    const Result without_scene =
        rebuild(Arguments{"--env", sky_} + more, Arguments{"--env", other_sky_} + more);
    EXPECT_EQ(without_scene.kept, (Names{"brdf/ggx", "wavelet/weight"}));
}

// One output, many bakes: whatever was there before makes no difference.
TEST_F(Rebuild, AnySequenceGivesTheBytesOfTheLast) {
    const fs::path output = folder_ / "sequence.envb", fresh = folder_ / "fresh.envb";
    const Arguments base = Arguments{two_, "--env", sky_} + small_;
    for (const Arguments& arguments : std::vector<Arguments>{
             base,
             base + Arguments{"--glossy", "all"},
             Arguments{two_, "--env", other_sky_, "--glossy", "all"} + small_,
             Arguments{two_},
             Arguments{two_, "--glossy", "all"},
             Arguments{two_, "--env", other_sky_, "--glossy", "all", "--extract-lights"} + small_,
             Arguments{scene_, "--env", other_sky_, "--wavelet", "16"} + small_,
             base + Arguments{"--wavelet", "16", "--encoding", "auto"},
             base + Arguments{"--encoding", "auto"},
             Arguments{"--env", sky_} + small_,
             base,
         }) {
        const std::string over = bake_to(output, arguments).bytes;
        fs::remove(fresh);
        EXPECT_TRUE(over == bake_to(fresh, arguments).bytes) << arguments.back();
    }
}

TEST_F(Rebuild, ForceKeepsNothing) {
    const fs::path output = folder_ / "x.envb";
    const Arguments arguments = Arguments{scene_, "--env", sky_} + small_;
    const Result first = bake_to(output, arguments);
    const Result again = bake_to(output, arguments + Arguments{"--force"});
    EXPECT_TRUE(again.kept.empty());
    EXPECT_TRUE(again.traced);
    EXPECT_TRUE(first.bytes == again.bytes);
}

// What a bake that may end on its time has reached is nothing for one that may not.
TEST_F(Rebuild, TransportOfATimeBudgetIsForThatBudget) {
    const fs::path output = folder_ / "x.envb";
    const Arguments budget{"--time-budget", "100"};
    bake_to(output, Arguments{scene_, "--env", sky_} + small_ + budget);
    const Result same = bake_to(output, Arguments{scene_, "--env", other_sky_} + small_ + budget);
    EXPECT_TRUE(same.kept.count("mesh/0/diffuse"));
    const Result without = bake_to(output, Arguments{scene_, "--env", other_sky_} + small_);
    EXPECT_EQ(without.kept, (Names{"brdf/ggx", "environment/mips"}));
    EXPECT_TRUE(without.traced);
}

TEST_F(Rebuild, DamagedAndForeignBundlesAreBakedOver) {
    const Arguments before = Arguments{scene_, "--env", sky_} + small_;
    const Arguments after = Arguments{scene_, "--env", other_sky_} + small_;
    const fs::path output = folder_ / "x.envb";
    const std::string old_bytes = bake_to(output, before).bytes;
    fs::remove(output);
    const std::string expected = bake_to(output, after).bytes;

    const auto over = [&](const std::string& bytes) {
        write_file(output, bytes);
        const Result result = bake_to(output, after);
        EXPECT_TRUE(result.bytes == expected);
        return result.kept;
    };
    const auto place = [&](const char* name) {
        write_file(output, old_bytes);
        const auto reader = format::Reader::open(output.c_str());
        return reader->find(name)->offset;
    };
    std::string damaged = old_bytes;
    damaged[place("mesh/0/diffuse") + 5] ^= 1;
    EXPECT_EQ(over(damaged), Names{"brdf/ggx"});
    damaged = old_bytes;
    damaged[place("brdf/ggx_average_albedo") + 5] ^= 1;
    EXPECT_EQ(over(damaged), Names{"mesh/0/diffuse"});
    damaged = old_bytes;
    damaged[place("metadata") + 5] ^= 1;
    EXPECT_EQ(over(damaged), Names{});
    EXPECT_EQ(over(old_bytes.substr(0, old_bytes.size() - 1)), Names{});
    EXPECT_EQ(over("no bundle"), Names{});
    EXPECT_EQ(over(""), Names{});
}

// A bundle with the right keys and checksums that holds something else.
TEST_F(Rebuild, AForgedBundleIsBakedOver) {
    const Arguments before = Arguments{scene_, "--env", sky_} + small_;
    const Arguments after = Arguments{scene_, "--env", other_sky_} + small_;
    const fs::path output = folder_ / "x.envb";
    const std::string old_bytes = bake_to(output, before).bytes;
    fs::remove(output);
    const std::string expected = bake_to(output, after).bytes;

    const auto forged = [&](const std::string& from, const std::string& to) {
        std::string bytes = old_bytes;
        ASSERT_EQ(from.size(), to.size());
        write_file(output, bytes);
        {
            const auto reader = format::Reader::open(output.c_str());
            const auto info = *reader->find("metadata");
            const auto at = bytes.find(from, info.offset);
            ASSERT_NE(at, std::string::npos) << from;
            ASSERT_LT(at, info.offset + info.size);
            bytes.replace(at, from.size(), to);
            std::span<std::byte> all(reinterpret_cast<std::byte*>(bytes.data()), bytes.size());
            const std::size_t table = get<std::uint64_t>(all, 24);
            for (std::size_t i = 0; i < reader->array_count(); ++i)
                if (reader->array(i).name == "metadata")
                    put(all, table + 96 * i + 88,
                        format::checksum(all.subspan(info.offset, info.size)));
            seal(all, table);
        }
        write_file(output, bytes);
        const Result result = bake_to(output, after);
        EXPECT_TRUE(result.kept.empty()) << from;
        EXPECT_TRUE(result.bytes == expected) << from;
    };
    forged("\"check_rays\"", "\"check_rayz\"");              // a part of the report is missing,
    forged("\"unreferenced\": 0", "\"unreferenced\":\"\"");  // or of another type
    forged("\"arrays\": {", "\"arrayz\": {");
}

// SIGKILL at some moments of a bake over an older bundle: the next one comes to the same bytes.
TEST_F(Rebuild, AKilledBakeLeavesWhatTheNextOneCanKeep) {
    const std::string scene = write_small_scene(folder_.path(), "large", 40).string();
    const Arguments before = Arguments{scene, "--env", sky_} + small_;
    const Arguments after = Arguments{scene, "--env", other_sky_} + small_;
    const fs::path output = folder_ / "x.envb";
    bake_to(output, after);
    const std::string expected = read_file(output);
    fs::remove(output);
    const std::string old_bytes = bake_to(output, before).bytes;
    for (const int delay_ms : {2, 10, 20}) {
        write_file(output, old_bytes);
        Program program("envbake",
                        Arguments{"bake"} + after + Arguments{"-o", output.string(), "-q"});
        std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms));
        program.signal(SIGKILL);
        program.wait();
        const Result next = bake_to(output, after);
        EXPECT_TRUE(next.bytes == expected) << delay_ms;
    }
}

}  // namespace
}  // namespace envbake::test
