// SPDX-License-Identifier: Apache-2.0
// A bake in parts and their merge give the bytes of one bake.
#include "envbake/format/reader.h"
#include "tests/support/bundle_bytes.h"
#include "tests/support/run_program.h"
#include "tests/support/small_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;

class Shards : public ::testing::Test {
  protected:
    /// Of 965 vertices: four blocks that work is cut into, the last one short.
    void SetUp() override {
        scene_ = write_small_scene(folder_.path(), "scene", 30).string();
        sky_ = write_small_sky(folder_ / "sky.hdr").string();
        two_ = write_two_meshes(folder_.path(), "two", 30, kShines).string();
    }

    fs::path shard_file(int index) const { return folder_ / concat_name(index); }
    static std::string concat_name(int index) { return std::to_string(index) + ".part.envb"; }

    static void run(const Arguments& arguments) {
        const Outcome outcome = envbake(arguments);
        ASSERT_EQ(outcome.status, 0) << outcome.err;
    }
    void bake_shard(const Arguments& arguments, int index, int count, const char* threads = "1") {
        run(Arguments{"bake"} + arguments +
            Arguments{"--shard", std::to_string(index) + "/" + std::to_string(count), "-o",
                      shard_file(index).string(), "--threads", threads, "-q", "--force"});
    }
    Arguments shard_files(int count) const {
        Arguments files;
        for (int i = 1; i <= count; ++i) files.push_back(shard_file(i).string());
        return files;
    }
    std::string merged(const Arguments& files, const Arguments& scene = {}) {
        const fs::path output = folder_ / "merged.envb";
        fs::remove(output);
        run(Arguments{"merge"} + files + Arguments{"-o", output.string(), "-q"} + scene);
        return read_file(output);
    }
    std::string whole(const Arguments& arguments) {
        const fs::path output = folder_ / "whole.envb";
        fs::remove(output);
        run(Arguments{"bake"} + arguments + Arguments{"-o", output.string(), "-q"});
        return read_file(output);
    }
    /// What `merge` says of files that it refuses, and that it leaves nothing.
    std::string refused(const Arguments& files, int status) {
        const fs::path output = folder_ / "refused.envb";
        const Outcome outcome =
            envbake(Arguments{"merge"} + files + Arguments{"-o", output.string(), "-q"});
        EXPECT_EQ(outcome.status, status) << outcome.err;
        EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
        EXPECT_FALSE(fs::exists(output));
        return outcome.err;
    }

    static constexpr const char* kShines = R"("emissiveFactor":[0.5,0.25,0.125],)";
    TemporaryFolder folder_;
    std::string scene_, two_, sky_;
    const Arguments small_{"--mip-size", "16", "--mip-count", "3", "--table-size", "16"};
};

TEST_F(Shards, MergedTheyAreTheBytesOfOneBake) {
    struct Case {
        int count;
        Arguments arguments;
    };
    const Arguments lit = Arguments{two_, "--env", sky_, "--rays", "48"} + small_;
    for (const auto& [count, arguments] : std::vector<Case>{
             {1, lit},
             {2, lit},
             {3, Arguments{scene_, "--env", sky_, "--tolerance", "0.05"} + small_},
             {7, lit + Arguments{"--distribution", "both", "--irradiance", "--window"}},
             {3, lit + Arguments{"--glossy", "all", "--unshadowed", "--compress"}},
             {2, lit + Arguments{"--encoding", "f16", "--glossy", "all"}},
             {3, lit + Arguments{"--encoding", "unorm8", "--half-tables", "--extract-lights"}},
             {2, lit + Arguments{"--encoding", "cpca"}},
             {7, lit + Arguments{"--encoding", "auto", "--no-receive", "above"}},
             {3, lit + Arguments{"--wavelet", "16"}},
             {20, {scene_, "--rays", "48"}},
             {3, lit + Arguments{"--bounces", "all"}},
             {4, lit + Arguments{"--bounces", "2", "--glossy", "all", "--encoding", "unorm8"}},
             {3, Arguments{"--env", sky_, "--wavelet", "16", "--mip-layout", "lat-long"} + small_},
         }) {
        SCOPED_TRACE(std::to_string(count) + " of " + arguments.front() + " ... " +
                     arguments.back());
        for (int i = 1; i <= count; ++i) bake_shard(arguments, i, count, i % 2 == 0 ? "2" : "1");
        Arguments files = shard_files(count);
        std::rotate(files.begin(), files.begin() + (count + 1) / 2, files.end());
        std::reverse(files.begin(), files.begin() + count / 2);
        const bool bounces = std::count(arguments.begin(), arguments.end(), "--bounces") > 0;
        const Arguments scene = bounces ? Arguments{"--scene", arguments.front()} : Arguments{};
        EXPECT_TRUE(merged(files, scene) == whole(arguments)) << "the bytes differ";
    }
}

TEST_F(Shards, WhatSurfacesSendIntoLobesIsThatOfOneBake) {
    const std::string metal = write_metal_below_clay(folder_.path(), "metal", 16).string();
    const Arguments arguments = Arguments{metal,       "--env", sky_,          "--glossy", "all",
                                          "--bounces", "all",   "--tolerance", "0.02"} +
                                small_;
    for (int i = 1; i <= 3; ++i) bake_shard(arguments, i, 3, i == 2 ? "2" : "1");
    const std::string bytes = merged(shard_files(3), {"--scene", metal});
    EXPECT_NE(bytes.find("mesh/1/reflected"), std::string::npos);
    EXPECT_TRUE(bytes == whole(arguments)) << "the bytes differ";
}

TEST_F(Shards, BouncesNeedTheSceneThatThePartsWereBakedFrom) {
    const Arguments arguments{two_, "--rays", "48", "--bounces", "1"};
    for (int i = 1; i <= 2; ++i) bake_shard(arguments, i, 2);
    const Arguments files = shard_files(2);
    EXPECT_NE(refused(files, 2).find("--scene"), std::string::npos);
    EXPECT_NE(refused(files + Arguments{"--scene", scene_}, 3).find("is not the scene"),
              std::string::npos);
    refused(files + Arguments{"--scene", (folder_ / "nowhere.gltf").string()}, 1);
    // A file that it refers to.
    const fs::path geometry = fs::path(two_).replace_extension(".bin");
    const std::string bytes = read_file(geometry);
    std::string changed = bytes;
    changed[2] ^= 1;
    write_file(geometry, changed);
    EXPECT_NE(refused(files + Arguments{"--scene", two_}, 3).find("has changed"),
              std::string::npos);
    write_file(geometry, bytes);
    EXPECT_TRUE(merged(files, {"--scene", two_}) == whole(arguments));
    EXPECT_EQ(envbake(Arguments{"merge"} + files + Arguments{"--scene", two_, "-o", two_}).status,
              2);
}

TEST_F(Shards, APartIsKnownForWhatItIs) {
    bake_shard({scene_, "--rays", "48"}, 2, 3);
    const std::string part = shard_file(2).string();
    const Outcome valid = envbake({"validate", part});
    EXPECT_EQ(valid.status, 0) << valid.out;
    EXPECT_NE(envbake({"dump", part}).out.find("part 2 of 3"), std::string::npos);
    const Outcome rendered =
        envbake({"render", part, scene_, "-o", (folder_ / "picture.png").string()});
    EXPECT_EQ(rendered.status, 4);
    EXPECT_NE(rendered.err.find("envbake merge"), std::string::npos) << rendered.err;

    // It is no up-to-date output of the whole bake or of another part, but of this part it is.
    const auto again = [&](const Arguments& more) {
        return envbake(Arguments{"bake", scene_, "--rays", "48", "-o", part} + more).err;
    };
    EXPECT_NE(again({"--shard", "2/3"}).find("is up to date"), std::string::npos);
    EXPECT_EQ(again({"--shard", "1/3"}).find("is up to date"), std::string::npos);
    EXPECT_EQ(again({}).find("is up to date"), std::string::npos);
    EXPECT_TRUE(read_file(part) == whole({scene_, "--rays", "48"}));
}

TEST_F(Shards, WhatIsNoWholeBakeIsRefused) {
    const Arguments arguments{scene_, "--rays", "48"};
    for (int i = 1; i <= 3; ++i) bake_shard(arguments, i, 3);
    const Arguments files = shard_files(3);
    EXPECT_NE(refused({files[0], files[2]}, 2).find("part 2 of 3 is missing"), std::string::npos);
    EXPECT_NE(refused(files + Arguments{files[1]}, 2).find("is there already"), std::string::npos);
    whole(arguments);
    EXPECT_NE(refused({(folder_ / "whole.envb").string()}, 2).find("whole bundle"),
              std::string::npos);
    refused({(folder_ / "nowhere.envb").string()}, 1);

    const auto foreign = [&](const Arguments& other, int count) {
        bake_shard(other, 2, count);
        return refused(files, 4);
    };
    EXPECT_NE(foreign({scene_, "--rays", "64"}, 3).find("other options"), std::string::npos);
    EXPECT_NE(foreign({two_, "--rays", "48"}, 3).find("other inputs"), std::string::npos);
    EXPECT_NE(foreign(arguments, 4).find("one of 4 parts"), std::string::npos);
    bake_shard(arguments, 2, 3);
    EXPECT_TRUE(merged(files) == whole(arguments));

    // Each array in turn, and the table.
    const std::string bytes = read_file(files[1]);
    std::vector<std::size_t> places{bytes.size() - 1};
    {
        const auto reader = format::Reader::open(files[1].c_str());
        ASSERT_TRUE(reader);
        for (std::size_t i = 0; i < reader->array_count(); ++i)
            places.push_back(reader->array(i).offset);
    }
    EXPECT_GE(places.size(), 4u);
    for (const std::size_t at : places) {
        std::string damaged = bytes;
        damaged[at] ^= 1;
        write_file(files[1], damaged);
        EXPECT_NE(refused(files, 4).find("2.part.envb"), std::string::npos) << at;
    }
    write_file(files[1], bytes.substr(0, bytes.size() - 64));
    refused(files, 4);
}

TEST_F(Shards, WrongUsage) {
    const std::string output = (folder_ / "x.envb").string();
    for (const char* text : {"0/3", "4/3", "3", "a/b", "1/", "/2", "-1/3", "1/1000000"})
        EXPECT_EQ(envbake({"bake", scene_, "--shard", text, "-o", output}).status, 2) << text;
    EXPECT_EQ(
        envbake({"bake", scene_, "--shard", "1/2", "--time-budget", "5", "-o", output}).status, 2);
    EXPECT_FALSE(fs::exists(output));
    bake_shard({scene_, "--rays", "48"}, 1, 1);
    EXPECT_EQ(envbake({"merge", shard_file(1).string(), "-o", shard_file(1).string()}).status, 2);
}

// A task of a farm dies at any moment; run again, it leaves what it would have left.
TEST_F(Shards, AKilledPartIsBakedAgain) {
    const Arguments arguments{scene_, "--rays", "4096"};
    bake_shard(arguments, 1, 2);
    for (const int milliseconds : {2, 20, 60}) {
        fs::remove(shard_file(2));
        Program killed("envbake", Arguments{"bake"} + arguments +
                                      Arguments{"--shard", "2/2", "-o", shard_file(2).string()});
        std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
        killed.signal(SIGKILL);
        killed.wait();
        if (!fs::exists(shard_file(2)))
            refused({shard_file(1).string(), shard_file(2).string()}, 1);
    }
    bake_shard(arguments, 2, 2);
    EXPECT_TRUE(merged(shard_files(2)) == whole(arguments));
}

}  // namespace
}  // namespace envbake::test
