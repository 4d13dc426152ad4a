// SPDX-License-Identifier: Apache-2.0
// `bake --depfile` under the tools that read it: what they rebuild, and when, is what counts.
#include "tests/support/run_program.h"
#include "tests/support/small_scene.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <thread>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;

/// A scene, a sky and the build files of one output, all under names that tools find hard.
class BuildTools : public ::testing::Test {
  protected:
    void SetUp() override {
        fs::create_directory(project_);
        write_small_scene(project_, kName);
        write_small_sky(project_ / "sky 1 #2 $3.hdr");
    }

    /// The command, quoted for the shell, its dollars doubled for the build file.
    static std::string command() {
        std::string text = fs::read_symlink("/proc/self/exe").parent_path().string();
        text.append(
            "/envbake bake 'a #b $$c.gltf' --env 'sky 1 #2 $$3.hdr' -o 'out #1 $$2.envb'"
            " --depfile out.d --mip-size 8 --mip-count 2 --table-size 8 --quiet");
        return text;
    }

    /// Runs a build that does not `fail`; returns what it printed.
    std::string build(const std::string& tool, bool fail = false) const {
        const auto log = folder_ / "log";
        const std::string line =
            "cd '" + project_.string() + "' && " + tool + " > '" + log.string() + "' 2>&1";
        EXPECT_EQ(std::system(line.c_str()) != 0, fail) << read_file(log);
        return read_file(log);
    }

    /// Makes a file newer than the last output, whatever the resolution of its time.
    static void touch(const fs::path& file) {
        fs::last_write_time(file, fs::file_time_type::clock::now() + std::chrono::seconds(2));
    }

    static constexpr const char* kName = "a #b $c";
    TemporaryFolder folder_;
    fs::path project_ = folder_ / "a project";
    fs::path output_ = project_ / "out #1 $2.envb";
};

TEST_F(BuildTools, NinjaBakesWhenAFileThatOnlyTheSceneNamesHasChanged) {
    if (std::system("ninja --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "no ninja";
    write_file(project_ / "build.ninja", "rule bake\n  command = " + command() +
                                             "\n  depfile = out.d\n  restat = 1\n"
                                             "build out$ #1$ $$2.envb: bake a$ #b$ $$c.gltf\n");
    build("ninja");
    ASSERT_TRUE(fs::exists(output_));
    EXPECT_NE(build("ninja").find("no work to do"), std::string::npos);

    const std::string first = read_file(output_);
    for (const auto& change :
         {+[](const fs::path& p) { write_small_scene(p, kName, 5); },
          +[](const fs::path& p) { write_small_sky(p / "sky 1 #2 $3.hdr", 3); }}) {
        const auto gltf_time = fs::last_write_time(project_ / "a #b $c.gltf");
        const std::string before = read_file(output_);
        change(project_);
        fs::last_write_time(project_ / "a #b $c.gltf", gltf_time);  // only the .bin is newer
        build("ninja");
        EXPECT_TRUE(read_file(output_) != before);
        EXPECT_NE(build("ninja").find("no work to do"), std::string::npos);
    }
    const auto time = fs::last_write_time(output_);
    touch(project_ / "a #b $c.bin");  // newer, but the same
    build("ninja");
    EXPECT_EQ(fs::last_write_time(output_), time);
}

TEST_F(BuildTools, MakeBakesWhenAFileThatOnlyTheSceneNamesHasChanged) {
    if (std::system("make --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "no make";
    write_file(project_ / "Makefile",
               "out\\ \\#1\\ $$2.envb: a\\ \\#b\\ $$c.gltf\n\t" + command() + "\n-include out.d\n");
    build("make");
    ASSERT_TRUE(fs::exists(output_));
    EXPECT_NE(build("make").find("up to date"), std::string::npos);
    const std::string before = read_file(output_);
    const auto gltf_time = fs::last_write_time(project_ / "a #b $c.gltf");
    write_small_scene(project_, kName, 5);
    fs::last_write_time(project_ / "a #b $c.gltf", gltf_time);
    touch(project_ / "a #b $c.bin");
    build("make");
    EXPECT_TRUE(read_file(output_) != before);

    // A file that is gone is an error of the bake, which knows why it needs it, not of make.
    fs::remove(project_ / "a #b $c.bin");
    const std::string gone = build("make", true);
    EXPECT_NE(gone.find("envbake: a #b $c.gltf: "), std::string::npos) << gone;
}

TEST_F(BuildTools, ADepfileIsNoOtherFileAndNamesNoLineBreak) {
    const std::string scene = (project_ / "a #b $c.gltf").string();
    const std::string bundle = output_.string();
    for (const std::string& depfile : {scene, bundle, (project_ / "a #b $c.bin").string()}) {
        EXPECT_EQ(envbake({"bake", scene, "-o", bundle, "--depfile", depfile}).status, 2);
        EXPECT_FALSE(fs::exists(output_));
    }
    const std::string depfile = (folder_ / "x.d").string();
    const std::string broken = (project_ / "two\nlines.envb").string();
    const Outcome outcome = envbake({"bake", scene, "-o", broken, "--depfile", depfile});
    EXPECT_EQ(outcome.status, 2);
    EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
    EXPECT_FALSE(fs::exists(depfile) || fs::exists(broken));
    // Written anew where the bundle is up to date.
    ASSERT_EQ(envbake({"bake", scene, "-o", bundle}).status, 0);
    ASSERT_EQ(envbake({"bake", scene, "-o", bundle, "--depfile", depfile}).status, 0);
    EXPECT_TRUE(fs::exists(depfile));
}

}  // namespace
}  // namespace envbake::test
