// SPDX-License-Identifier: Apache-2.0
// What is on the disk after a bake that could not end: killed, interrupted, out of room.
#include "tests/support/run_program.h"
#include "tests/support/small_scene.h"

#include <gtest/gtest.h>

#include <sys/mount.h>

#include <chrono>
#include <cstdlib>
#include <random>
#include <set>
#include <thread>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;

class Interrupted : public ::testing::Test {
  protected:
    void SetUp() override {
        scene_ = write_small_scene(folder_.path(), "scene", 40).string();
        sky_ = write_small_sky(folder_ / "sky.hdr").string();
        fs::create_directory(out_);
        bundle_ = (out_ / "scene.envb").string();
    }

    std::vector<std::string> bake_arguments(std::vector<std::string> more = {}) const {
        std::vector<std::string> arguments{
            "bake",        scene_,    "--env",        sky_,
            "-o",          bundle_,   "--mip-size",   "16",
            "--mip-count", "3",       "--table-size", "16",
            "--quiet",     "--force", "--depfile",    (out_ / "scene.d").string()};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return arguments;
    }

    std::string baked(std::vector<std::string> more = {}) const {
        const Outcome outcome = envbake(bake_arguments(std::move(more)));
        EXPECT_EQ(outcome.status, 0) << outcome.err;
        return read_file(bundle_);
    }

    std::set<std::string> files() const {
        std::set<std::string> names;
        for (const auto& entry : fs::directory_iterator(out_))
            names.insert(entry.path().filename().string());
        return names;
    }

    TemporaryFolder folder_;
    fs::path out_ = folder_ / "out";
    std::string scene_, sky_, bundle_;
};

/// Moments of a long run: ENVBAKE_KILLS=200.
int kill_count() {
    const char* asked = std::getenv("ENVBAKE_KILLS");
    return asked == nullptr ? 16 : std::atoi(asked);
}

// SIGKILL cannot be answered: what it leaves is what the file system has at that moment.
TEST_F(Interrupted, AKilledBakeLeavesTheOldFileNoFileOrTheNewOne) {
    const std::string old_bundle = baked({"--bands", "3"});
    const auto begin = std::chrono::steady_clock::now();
    const std::string new_bundle = baked();
    const std::chrono::duration<double> duration = std::chrono::steady_clock::now() - begin;
    ASSERT_TRUE(old_bundle != new_bundle);

    std::mt19937 random(1);
    std::uniform_real_distribution<double> moment(0, 1.1 * duration.count());
    int killed = 0;
    for (int i = 0; i < kill_count(); ++i) {
        const bool had_old = i % 2 == 0;
        for (const std::string& name : files()) fs::remove(out_ / name);
        if (had_old) write_file(bundle_, old_bundle);
        const std::chrono::duration<double> delay(moment(random));
        Program program("envbake", bake_arguments());
        std::this_thread::sleep_for(delay);
        program.signal(SIGKILL);
        killed += program.wait().status == 128 + SIGKILL ? 1 : 0;

        const std::string after = fs::exists(bundle_) ? read_file(bundle_) : "";
        EXPECT_TRUE(after == new_bundle || after == (had_old ? old_bundle : ""))
            << "after " << delay.count() << " s of " << duration.count();
        for (const std::string& name : files())
            EXPECT_TRUE(name == "scene.envb" || name == "scene.d")
                << name << " after " << delay.count() << " s";
    }
    EXPECT_GT(killed, 0) << "every bake was faster than its killer";
    std::printf("%d of %d bakes of %.0f ms were killed\n", killed, kill_count(),
                1e3 * duration.count());
}

TEST_F(Interrupted, ASignalEndsABakeAndLeavesTheOldFileAlone) {
    const std::string old_bundle = baked({"--bands", "3"});
    const auto before = files();
    for (const int signal : {SIGINT, SIGTERM, SIGHUP})
        for (const int delay_ms : {100, 300}) {
            // Billions of rays: it does not end by itself.
            Program program("envbake", bake_arguments({"--rays", "1048576"}));
            std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms));
            program.signal(signal);
            const Outcome outcome = program.wait();
            EXPECT_EQ(outcome.status, 128 + signal);
            EXPECT_EQ(outcome.err, "envbake: interrupted\n");
            EXPECT_TRUE(read_file(bundle_) == old_bundle);
            EXPECT_EQ(files(), before);
        }
}

/// Caps the files that programs started from here may write, while it lives.
class FileSizeLimit {
  public:
    explicit FileSizeLimit(rlim_t bytes) {
        ::getrlimit(RLIMIT_FSIZE, &before_);
        const rlimit limit{bytes, before_.rlim_max};
        ::setrlimit(RLIMIT_FSIZE, &limit);
    }
    ~FileSizeLimit() { ::setrlimit(RLIMIT_FSIZE, &before_); }
    FileSizeLimit(const FileSizeLimit&) = delete;
    FileSizeLimit& operator=(const FileSizeLimit&) = delete;

  private:
    rlimit before_{};
};

TEST_F(Interrupted, AFileThatMayNotGrowIsOneLineAndNoFile) {
    const std::size_t size = baked().size();
    for (const std::string& name : files()) fs::remove(out_ / name);
    for (const std::size_t limit : {size / 2, size - 1}) {
        Outcome outcome;
        {
            const FileSizeLimit limited(limit);
            outcome = envbake(bake_arguments());
        }
        EXPECT_EQ(outcome.status, 1) << limit;
        EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
        EXPECT_NE(outcome.err.find("scene.envb"), std::string::npos) << outcome.err;
        EXPECT_TRUE(files().empty()) << limit;
    }
}

/// A file system in memory over `folder`, where the test may mount one (as root).
class Mount {
  public:
    Mount(const fs::path& folder, unsigned long flags, const char* options)
        : folder_(folder),
          mounted_(::mount("envbake_test", folder.c_str(), "tmpfs", flags, options) == 0) {}
    ~Mount() {
        if (mounted_) ::umount2(folder_.c_str(), MNT_DETACH);
    }
    Mount(const Mount&) = delete;
    Mount& operator=(const Mount&) = delete;
    explicit operator bool() const { return mounted_; }

  private:
    fs::path folder_;
    bool mounted_;
};

TEST_F(Interrupted, AFullDiskIsOneLineAndNoFile) {
    for (const char* options : {"size=4k", "size=64k"}) {
        const Mount small(out_, 0, options);
        if (!small) GTEST_SKIP() << "no file system can be mounted here";
        const Outcome outcome = envbake(bake_arguments());
        EXPECT_EQ(outcome.status, 1) << options;
        EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
        EXPECT_NE(outcome.err.find("No space left"), std::string::npos) << outcome.err;
        EXPECT_TRUE(files().empty()) << options;
    }
}

TEST_F(Interrupted, AReadOnlyFolderIsOneLineAndNoFile) {
    const Mount read_only(out_, MS_RDONLY, "");
    if (!read_only) {
        if (::geteuid() == 0) GTEST_SKIP() << "root writes everywhere, and cannot mount here";
        fs::permissions(out_, fs::perms::owner_read | fs::perms::owner_exec);
    }
    const Outcome outcome = envbake(bake_arguments());
    EXPECT_EQ(outcome.status, 1);
    EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
    EXPECT_TRUE(files().empty());
    if (!read_only) fs::permissions(out_, fs::perms::owner_all);
}

}  // namespace
}  // namespace envbake::test
