// SPDX-License-Identifier: Apache-2.0
#include "baker/input/image_worker.h"

#include "tests/support/image_files.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <fstream>
#include <limits>
#include <string>
#include <thread>
#include <vector>

namespace envbake {
namespace {

namespace fs = std::filesystem;

std::span<const std::byte> as_bytes(const std::string& text) {
    return std::as_bytes(std::span(text.data(), text.size()));
}

std::vector<float> numbered_rgb(int width, int height, float first = 0) {
    std::vector<float> rgb(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    for (std::size_t i = 0; i < rgb.size(); ++i) rgb[i] = first + static_cast<float>(i);
    return rgb;
}

/// The workers that this process has started and that still run.
std::vector<pid_t> workers() {
    std::vector<pid_t> found;
    for (const auto& entry : fs::directory_iterator("/proc")) {
        std::ifstream status(entry.path() / "status");
        std::string name, line;
        for (pid_t parent = 0; std::getline(status, line);) {
            if (line.starts_with("Name:")) name = line.substr(6);
            if (!line.starts_with("PPid:")) continue;
            parent = std::stoi(line.substr(6));
            if (parent == getpid() &&
                name == "envbake-image-w") {  // the kernel keeps 15 characters
                found.push_back(std::stoi(entry.path().filename().string()));
            }
        }
    }
    return found;
}

bool one_line(const std::string& message) {
    return message.find('\n') == std::string::npos;
}

TEST(ImageWorker, ExrKeepsEveryBitPattern) {
    const test::TemporaryFolder folder;
    using Limits = std::numeric_limits<float>;
    std::vector<float> rgb = numbered_rgb(5, 3);
    rgb[0] = Limits::quiet_NaN();
    rgb[4] = Limits::infinity();
    rgb[8] = -Limits::infinity();
    rgb[9] = Limits::denorm_min();
    rgb[10] = Limits::max();
    rgb[11] = -0.0f;
    const auto written = write_exr(folder / "a.exr", 5, 3, rgb);
    ASSERT_TRUE(written) << written.error();
    const auto image = decode_float_image(folder / "a.exr");
    ASSERT_TRUE(image) << image.error();
    ASSERT_EQ(image->width, 5);
    ASSERT_EQ(image->height, 3);
    EXPECT_EQ(image->envmap, Envmap::None);
    EXPECT_EQ(image->data_window, (TexelWindow{0, 0, 4, 2}));
    EXPECT_EQ(image->display_window, (TexelWindow{0, 0, 4, 2}));
    EXPECT_FALSE(image->chromaticities);
    for (int y = 0; y < 3; ++y) {
        const std::span<const float> row = image->row(y);
        ASSERT_EQ(row.size(), 15u);
        for (std::size_t i = 0; i < 15; ++i) {
            EXPECT_EQ(std::bit_cast<std::uint32_t>(row[i]),
                      std::bit_cast<std::uint32_t>(rgb[15 * static_cast<std::size_t>(y) + i]));
        }
    }
}

TEST(ImageWorker, PngComesBackAsWritten) {
    const test::TemporaryFolder folder;
    std::vector<std::uint8_t> rgb;
    for (int i = 0; i < 3 * 7 * 5; ++i) rgb.push_back(static_cast<std::uint8_t>(i * 37));
    const auto written = write_png(folder / "a.png", 7, 5, rgb);
    ASSERT_TRUE(written) << written.error();
    const auto image = decode_image(as_bytes(test::read_file(folder / "a.png")), "a.png");
    ASSERT_TRUE(image) << image.error();
    EXPECT_EQ(image->name, "a.png");
    ASSERT_EQ(image->width, 7);
    ASSERT_EQ(image->height, 5);
    ASSERT_EQ(image->rgba.size(), 4u * 35);
    for (std::size_t i = 0; i < 35; ++i) {
        for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(image->rgba[4 * i + k], rgb[3 * i + k]);
        EXPECT_EQ(image->rgba[4 * i + 3], 255);
    }
}

// Pixels under alpha must not be darkened, nor those under alpha 0 lost.
TEST(ImageWorker, PngPixelsComeAsStored) {
    struct Case {
        const char* what;
        test::PngHeader header;
        std::string row;
        std::vector<std::uint8_t> rgba;
    };
    using std::string;
    const Case cases[] = {
        {"RGBA",
         {.width = 2, .color_type = 6},
         string("\x64\xc8\x32\x00\x64\xc8\x32\x80", 8),
         {100, 200, 50, 0, 100, 200, 50, 128}},
        {"RGB", {.width = 1, .color_type = 2}, "\x01\x02\x03", {1, 2, 3, 255}},
        {"grey", {.width = 2, .color_type = 0}, "\x07\xf0", {7, 7, 7, 255, 240, 240, 240, 255}},
        {"grey and alpha", {.width = 1, .color_type = 4}, "\x50\x03", {80, 80, 80, 3}},
        {"16 bits",
         {.width = 1, .bit_depth = 16, .color_type = 2},
         string("\x80\x80\x00\x00\xff\xff", 6),
         {128, 0, 255, 255}},
    };
    for (const Case& c : cases) {
        const auto image = decode_image(as_bytes(test::png_bytes(c.header, {c.row})), c.what);
        ASSERT_TRUE(image) << image.error();
        EXPECT_EQ(image->rgba, c.rgba) << c.what;
    }
}

TEST(ImageWorker, JpegIsRead) {
    // Baseline, 8 x 8, grey, one block of value 64: the DC difference is (64 - 128) * 8 / 16 = -32,
    // category 6, extra bits 31 = 011111. Huffman tables of one code each: DC "0" = 6, AC "0" =
    // EOB. Bits: 0 011111 0, filled up with ones.
    std::string jpeg("\xff\xd8\xff\xdb\x00\x43\x00", 7);
    jpeg += std::string(64, '\x10');
    jpeg += std::string("\xff\xc0\x00\x0b\x08\x00\x08\x00\x08\x01\x01\x11\x00", 13);
    jpeg += std::string("\xff\xc4\x00\x14\x00\x01", 6) + std::string(15, '\0') + '\x06';
    jpeg += std::string("\xff\xc4\x00\x14\x10\x01", 6) + std::string(15, '\0') + '\0';
    jpeg += std::string("\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00", 10);
    jpeg += '\x3e';
    jpeg += "\xff\xd9";
    const auto image = decode_image(as_bytes(jpeg), "grey.jpg");
    ASSERT_TRUE(image) << image.error();
    ASSERT_EQ(image->width, 8);
    ASSERT_EQ(image->height, 8);
    for (std::size_t i = 0; i < 64; ++i) {
        EXPECT_EQ(image->rgba[4 * i], 64);
        EXPECT_EQ(image->rgba[4 * i + 2], 64);
        EXPECT_EQ(image->rgba[4 * i + 3], 255);
    }
}

TEST(ImageWorker, UnreadableImagesAreOneLine) {
    const std::string good = test::png_bytes({.width = 2, .height = 2, .color_type = 2},
                                             {"\1\2\3\4\5\6", "\1\2\3\4\5\6"});
    const std::pair<const char*, std::string> cases[] = {
        {"empty", ""},
        {"a GIF", "GIF89a\1\0\1\0"},
        {"text", "this is not an image"},
        {"magic only", good.substr(0, 8)},
        {"no IDAT", good.substr(0, 33)},
        {"cut", good.substr(0, good.size() - 30)},
        {"a size it cannot hold",
         test::png_bytes({.width = 60000, .height = 4000, .color_type = 2}, {"\1\2\3"})},
        {"too large", test::png_bytes({.width = 70000, .height = 70000, .color_type = 2}, {"\1"})},
    };
    for (const auto& [what, bytes] : cases) {
        const auto image = decode_image(as_bytes(bytes), "texture");
        ASSERT_FALSE(image) << what;
        EXPECT_EQ(image.error().code, Errc::InvalidInput) << what;
        EXPECT_TRUE(image.error().message.starts_with("texture: not a readable image ("))
            << image.error();
        EXPECT_TRUE(one_line(image.error().message)) << image.error();
    }
    EXPECT_TRUE(decode_image(as_bytes(good), "texture"));
}

/// OpenEXR 3.1 would set the memory aside first and find the end of the file later.
TEST(ImageWorker, AnAttributeLargerThanItsFileIsRefusedBeforeItIsRead) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(write_exr(folder / "a.exr", 4, 4, numbered_rgb(4, 4)));
    std::string bytes = test::read_file(folder / "a.exr");
    const std::string attribute("channels\0chlist\0", 16);
    const std::size_t size_at = bytes.find(attribute) + attribute.size();
    for (const char* size : {"\xff\xff\xff\x7f", "\xff\xff\xff\xff"}) {
        bytes.replace(size_at, 4, size, 4);
        test::write_file(folder / "b.exr", bytes);
        const auto image = decode_float_image(folder / "b.exr");
        ASSERT_FALSE(image);
        EXPECT_EQ(image.error().code, Errc::InvalidInput);
        EXPECT_NE(image.error().message.find("an attribute claims"), std::string::npos)
            << image.error();
    }
}

TEST(ImageWorker, FilesThatCannotBeOpenedFail) {
    const test::TemporaryFolder folder;
    for (const fs::path& path : {folder / "absent.exr", folder.path()}) {
        const auto image = decode_float_image(path);
        ASSERT_FALSE(image);
        EXPECT_EQ(image.error().code, Errc::Failed);
        EXPECT_TRUE(image.error().message.starts_with(path.string() + ": ")) << image.error();
    }
}

TEST(ImageWorker, WritingFailsWithoutTraces) {
    const test::TemporaryFolder folder;
    const std::vector<float> rgb = numbered_rgb(2, 2);

    const auto nowhere = write_exr(folder / "absent/a.exr", 2, 2, rgb);
    ASSERT_FALSE(nowhere);
    EXPECT_EQ(nowhere.error().code, Errc::Failed);

    test::write_file(folder / "kept.exr", "precious");
    const auto misfit = write_exr(folder / "kept.exr", 3, 2, rgb);  // one texel column too many
    ASSERT_FALSE(misfit);
    EXPECT_EQ(misfit.error().code, Errc::Failed);
    EXPECT_EQ(test::read_file(folder / "kept.exr"), "precious");

    fs::create_directory(folder / "taken.exr");
    EXPECT_FALSE(write_exr(folder / "taken.exr", 2, 2, rgb));

    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder.path()))
        names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    EXPECT_EQ(names, (std::vector<std::string>{"kept.exr", "taken.exr"}));
}

TEST(ImageWorker, WritingTheSameTwiceGivesTheSameBytes) {
    const test::TemporaryFolder folder;
    const std::vector<float> rgb = numbered_rgb(40, 30);
    const std::vector<std::uint8_t> bytes(3 * 40 * 30, 77);
    for (const char* suffix : {"1", "2"}) {
        ASSERT_TRUE(write_exr(folder / ("exr" + std::string(suffix)), 40, 30, rgb));
        ASSERT_TRUE(write_png(folder / ("png" + std::string(suffix)), 40, 30, bytes));
    }
    EXPECT_EQ(test::read_file(folder / "exr1"), test::read_file(folder / "exr2"));
    EXPECT_EQ(test::read_file(folder / "png1"), test::read_file(folder / "png2"));
}

TEST(ImageWorker, ADeadWorkerIsReplaced) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(write_exr(folder / "a.exr", 4, 2, numbered_rgb(4, 2)));
    const std::vector<pid_t> before = workers();
    ASSERT_EQ(before.size(), 1u);
    kill(before[0], SIGKILL);
    siginfo_t info{};
    waitid(P_PID, static_cast<id_t>(before[0]), &info, WEXITED | WNOWAIT);  // dead, not yet reaped
    const auto image = decode_float_image(folder / "a.exr");
    ASSERT_TRUE(image) << image.error();
    EXPECT_EQ(image->row(1)[11], 23);
    const std::vector<pid_t> after = workers();
    ASSERT_EQ(after.size(), 1u);
    EXPECT_NE(after[0], before[0]);
}

TEST(ImageWorker, ALateDecoderIsEndedAndTheWorkerLives) {
    const test::TemporaryFolder folder;
    constexpr int kWidth = 2048, kHeight = 1024;  // tens of milliseconds of work
    ASSERT_TRUE(write_exr(folder / "a.exr", kWidth, kHeight, numbered_rgb(kWidth, kHeight)));
    const std::vector<pid_t> before = workers();
    const auto late = decode_float_image(folder / "a.exr", {.seconds = 0.001});
    ASSERT_FALSE(late);
    EXPECT_EQ(late.error().code, Errc::InvalidInput);
    EXPECT_TRUE(late.error().message.ends_with("not a readable image (it takes more than 0.001 s)"))
        << late.error();
    const auto image = decode_float_image(folder / "a.exr");
    ASSERT_TRUE(image) << image.error();
    EXPECT_EQ(image->row(0)[5], 5);
    EXPECT_EQ(workers(), before);
}

TEST(ImageWorker, ServesManyThreads) {
    const test::TemporaryFolder folder;
    constexpr int kThreads = 8;
    std::vector<std::string> wrong(kThreads);
    std::vector<std::thread> threads;
    for (int t = 0; t < kThreads; ++t) {
        threads.emplace_back([&, t] {
            const fs::path file = folder / (std::to_string(t) + ".exr");
            const auto first = static_cast<float>(1000 * t);
            for (int i = 0; i < 5; ++i) {
                const auto written = write_exr(file, 3 + t, 2, numbered_rgb(3 + t, 2, first));
                const auto image = decode_float_image(file);
                if (!written || !image || image->width != 3 + t || image->row(0)[1] != first + 1) {
                    wrong[static_cast<std::size_t>(t)] = "wrong image";
                }
            }
        });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(wrong, std::vector<std::string>(kThreads));
    EXPECT_EQ(workers().size(), 1u);
}

TEST(ImageWorker, ReleasedRowsLeaveTheOthersAlone) {
    const test::TemporaryFolder folder;
    constexpr int kWidth = 512, kHeight = 16;  // a row is 1.5 pages
    ASSERT_TRUE(write_exr(folder / "a.exr", kWidth, kHeight, numbered_rgb(kWidth, kHeight, 1)));
    auto image = decode_float_image(folder / "a.exr");
    ASSERT_TRUE(image) << image.error();
    for (int y = 0; y < kHeight; ++y) {
        image->release_rows_before(y);
        EXPECT_EQ(image->row(y)[0], static_cast<float>(3 * kWidth * y + 1));
    }
    EXPECT_EQ(image->row(0)[0], 0);
}

}  // namespace
}  // namespace envbake
