// SPDX-License-Identifier: Apache-2.0
// Reading a map takes the memory of the map: neither the file nor a second copy of the pixels lies
// beside it.
#include "baker/input/image_worker.h"
#include "baker/input/read_environment.h"
#include "tests/support/image_files.h"
#include "tests/support/sanitized.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

namespace envbake {
namespace {

namespace fs = std::filesystem;

constexpr bool kSanitized = test::kAddressSanitizer || test::kThreadSanitizer;

/// This process, its children, and theirs.
std::set<pid_t> family() {
    std::multimap<pid_t, pid_t> children;
    for (const auto& entry : fs::directory_iterator("/proc")) {
        const std::string name = entry.path().filename().string();
        if (!std::all_of(name.begin(), name.end(), [](char c) { return c >= '0' && c <= '9'; }))
            continue;
        std::ifstream stat(entry.path() / "stat");
        std::string text;
        std::getline(stat, text);
        const std::size_t end_of_name = text.rfind(')');  // "1 (name) S parent ..."
        if (end_of_name == std::string::npos) continue;   // it has ended meanwhile
        children.emplace(std::stoi(text.substr(end_of_name + 4)), std::stoi(name));
    }
    std::set<pid_t> found{getpid()};
    for (std::vector<pid_t> next{getpid()}; !next.empty();) {
        const auto [first, last] = children.equal_range(next.back());
        next.pop_back();
        for (auto child = first; child != last; ++child)
            if (found.insert(child->second).second) next.push_back(child->second);
    }
    return found;
}

/// Bytes of memory of the whole family: what processes share counts once. 0 where the system does
/// not tell.
std::size_t family_bytes() {
    std::size_t kilobytes = 0;
    for (const pid_t process : family()) {
        std::ifstream rollup("/proc/" + std::to_string(process) + "/smaps_rollup");
        for (std::string line; std::getline(rollup, line);)
            if (line.starts_with("Pss:")) kilobytes += std::stoul(line.substr(4));
    }
    return kilobytes * 1024;
}

/// The most that the family has held while `work` ran. A poll may miss a peak that is over at once,
/// but never sees one that was not there.
template <class Work>
std::size_t peak_bytes(const Work& work) {
    std::atomic<bool> done = false;
    std::size_t peak = 0;
    std::thread observer([&] {
        while (!done) {
            peak = std::max(peak, family_bytes());
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
    });
    work();
    done = true;
    observer.join();
    return peak;
}

constexpr int kWidth = 3072, kHeight = 1536;
constexpr std::size_t kMapBytes = std::size_t{3} * sizeof(float) * kWidth * kHeight;

std::vector<float> picture() {
    std::vector<float> rgb(kMapBytes / sizeof(float));
    for (std::size_t i = 0; i < rgb.size(); ++i) rgb[i] = static_cast<float>(i * 37 % 251);
    return rgb;
}

/// The file is as large as the map.
void write_uncompressed_exr(const fs::path& file) {
    std::vector<float> rgb = picture();
    Imf::Header header(kWidth, kHeight);
    header.compression() = Imf::NO_COMPRESSION;
    Imf::FrameBuffer buffer;
    const char* const names[] = {"R", "G", "B"};
    for (std::size_t i = 0; i < 3; ++i) {
        header.channels().insert(names[i], Imf::Channel(Imf::FLOAT));
        buffer.insert(names[i],
                      Imf::Slice::Make(Imf::FLOAT, rgb.data() + i, header.dataWindow(),
                                       3 * sizeof(float), 3 * sizeof(float) * std::size_t{kWidth}));
    }
    Imf::OutputFile output(file.c_str(), header);
    output.setFrameBuffer(buffer);
    output.writePixels(kHeight);
}

void expect_the_map_alone(const fs::path& file) {
    if (kSanitized) GTEST_SKIP() << "a sanitizer's own memory is not the reader's";
    start_image_worker();
    // A small picture first: what starting up takes is not the map's.
    const test::TemporaryFolder folder;
    const std::vector<float> black(3, 0.0f);
    test::write_file(folder / "small.hdr", test::radiance_bytes(1, 1, black));
    ASSERT_TRUE(read_environment(folder / "small.hdr"));
    const std::size_t before = family_bytes();
    if (before == 0) GTEST_SKIP() << "no /proc/*/smaps_rollup";

    std::size_t texels = 0;
    const std::size_t peak = peak_bytes([&] {
        const auto environment = read_environment(file);
        ASSERT_TRUE(environment) << environment.error();
        texels = environment->radiance.size();
    });
    EXPECT_EQ(texels, std::size_t{kWidth} * kHeight);
    EXPECT_GT(peak, before + kMapBytes / 2) << "nothing was measured";
    // Measured: 1.03 to 1.08; 1.3 and 2.0 with the file in memory, 2.0 with the pixels there twice.
    EXPECT_LT(static_cast<double>(peak - before), 1.2 * static_cast<double>(kMapBytes));
}

TEST(EnvironmentMemory, RadianceFile) {
    const test::TemporaryFolder folder;
    test::write_file(folder / "a.hdr", test::radiance_bytes(kWidth, kHeight, picture()));
    expect_the_map_alone(folder / "a.hdr");
}

TEST(EnvironmentMemory, ExrFile) {
    const test::TemporaryFolder folder;
    write_uncompressed_exr(folder / "a.exr");
    expect_the_map_alone(folder / "a.exr");
}

}  // namespace
}  // namespace envbake
