// SPDX-License-Identifier: Apache-2.0
// Replies and outputs as a decoder that has gone astray could leave them.
#include "baker/input/worker_reply.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <string>

namespace envbake {
namespace {

class MemoryFile {
  public:
    explicit MemoryFile(std::int64_t size)
        : file_(memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING)) {
        EXPECT_EQ(ftruncate(file_, size), 0);
    }
    ~MemoryFile() { close(file_); }
    MemoryFile(const MemoryFile&) = delete;
    MemoryFile& operator=(const MemoryFile&) = delete;
    int get() const { return file_; }

  private:
    int file_;
};

template <class T>
void expect_refused(const Expected<T>& result) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, Errc::InvalidInput);
    EXPECT_EQ(result.error().message, "a.png: its decoder answers nonsense");
}

Expected<SharedPixels> pixels(int width, int height, std::int64_t file_size,
                              std::size_t bytes_per_texel = 4) {
    worker::Reply reply;
    reply.width = width;
    reply.height = height;
    const MemoryFile file(file_size);
    return map_pixels(reply, bytes_per_texel, file.get(), "a.png");
}

TEST(WorkerReply, PixelsFillTheirFileToTheByte) {
    for (const std::int64_t size : {0, 1, 4, 47, 49, 96, 4096, 1 << 20})
        expect_refused(pixels(3, 4, size));
    const auto good = pixels(3, 4, 48);
    ASSERT_TRUE(good) << good.error();
    EXPECT_EQ(good->bytes().size(), 48u);
    EXPECT_EQ(good->bytes()[47], std::byte{0});
    EXPECT_TRUE(pixels(3, 4, 144, 12));

    // A file that is as large as they say, and holds next to nothing of it.
    EXPECT_TRUE(pixels(1 << 14, 1 << 14, std::int64_t{4} << 28));
    expect_refused(pixels(1 << 14, (1 << 14) + 1, std::int64_t{4} * (1 << 14) * ((1 << 14) + 1)));
}

TEST(WorkerReply, ImpossibleSizes) {
    constexpr int kLeast = std::numeric_limits<int>::min(), kMost = std::numeric_limits<int>::max();
    for (const int a : {kLeast, -65536, -3, -1, 0, 3, 65536, 65537, 1 << 30, kMost - 1, kMost})
        for (const int b : {kLeast, -4, -1, 0, 4, 65536, 65537, 1 << 30, kMost})
            for (const std::int64_t size : {0, 48})
                if (a != 3 || b != 4 || size != 48) expect_refused(pixels(a, b, size));
}

TEST(WorkerReply, PixelsCannotBeTakenAway) {
    worker::Reply reply;
    reply.width = reply.height = 64;
    const MemoryFile file(4 * 64 * 64);
    const auto mapped = map_pixels(reply, 4, file.get(), "a.png");
    ASSERT_TRUE(mapped) << mapped.error();
    EXPECT_NE(ftruncate(file.get(), 0), 0);
    EXPECT_EQ(mapped->bytes()[4 * 64 * 64 - 1], std::byte{0});

    int pipe_ends[2];
    ASSERT_EQ(pipe(pipe_ends), 0);
    expect_refused(map_pixels(reply, 4, pipe_ends[0], "a.png"));
    expect_refused(map_output(pipe_ends[0], 100, "a.png"));
    close(pipe_ends[0]);
    close(pipe_ends[1]);
}

TEST(WorkerReply, OutputsHaveALargestSizeAndStayAsTheyAre) {
    expect_refused(map_output(MemoryFile(0).get(), 100, "a.png"));
    expect_refused(map_output(MemoryFile(101).get(), 100, "a.png"));
    expect_refused(map_output(MemoryFile(std::int64_t{1} << 40).get(), 100, "a.png"));
    const MemoryFile file(100);
    const auto mapped = map_output(file.get(), 100, "a.png");
    ASSERT_TRUE(mapped) << mapped.error();
    EXPECT_EQ(mapped->bytes().size(), 100u);
    EXPECT_EQ(write(file.get(), "x", 1), -1);
    EXPECT_NE(ftruncate(file.get(), 200), 0);

    // One that somebody has still mapped to write to.
    const MemoryFile shared(4096);
    void* const at = mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, shared.get(), 0);
    ASSERT_NE(at, MAP_FAILED);
    expect_refused(map_output(shared.get(), 4096, "a.png"));
    munmap(at, 4096);
}

TEST(WorkerReply, WordsAreOneLine) {
    worker::Reply reply;
    reply.outcome = worker::Outcome::Done;
    EXPECT_EQ(complaint(reply, 1), "");
    reply.outcome = worker::Outcome::TimedOut;
    EXPECT_EQ(complaint(reply, 1.5), "it takes more than 1.5 s");
    for (const std::uint32_t unknown : {0u, 5u, 1000u, ~0u}) {
        reply.outcome = static_cast<worker::Outcome>(unknown);
        EXPECT_EQ(complaint(reply, 1), "its decoder crashed");
    }
    reply.outcome = worker::Outcome::Refused;
    EXPECT_EQ(complaint(reply, 1), "damaged");
    const std::string text = "two\nlines\x1b[1m";
    std::copy(text.begin(), text.end(), reply.message.begin());
    EXPECT_EQ(complaint(reply, 1), "two\\x0alines\\x1b[1m");
    reply.message.fill('x');  // without an end
    EXPECT_EQ(complaint(reply, 1), std::string(reply.message.size(), 'x'));
}

}  // namespace
}  // namespace envbake
