// SPDX-License-Identifier: Apache-2.0
// The worked example of docs/format.md, byte for byte what the writer writes.
#include "envbake/format/writer.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cctype>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

namespace envbake::format {
namespace {

/// The bytes of the ```hex block of the document: "offset  xx xx ...  | remark" lines.
std::vector<unsigned char> bytes_of_document(const std::string& path) {
    std::ifstream in(path);
    EXPECT_TRUE(in) << path;
    std::vector<unsigned char> bytes;
    bool inside = false;
    for (std::string line; std::getline(in, line);) {
        if (line.rfind("```", 0) == 0) {
            inside = line == "```hex";
            continue;
        }
        if (!inside || line.empty()) continue;
        std::istringstream words(line.substr(0, line.find('|')));
        std::string word;
        words >> word;
        EXPECT_EQ(std::stoul(word, nullptr, 16), bytes.size()) << "offset of: " << line;
        while (words >> word)
            bytes.push_back(static_cast<unsigned char>(std::stoul(word, nullptr, 16)));
    }
    return bytes;
}

TEST(FormatExample, IsWhatTheWriterWrites) {
    const auto path = std::filesystem::temp_directory_path() /
                      ("envbake_format_example_" + std::to_string(::getpid()) + ".envb");
    {
        auto writer = Writer::create(path.string());
        ASSERT_TRUE(writer) << to_string(writer.error());
        const std::vector<float> sh{1.0f, 0.5f, 0.25f};
        const std::string metadata = "{}";
        ASSERT_TRUE(writer->add<float>("environment/sh", {1, 3}, sh));
        ASSERT_TRUE(writer->add<std::uint8_t>(
            "metadata", {2}, {reinterpret_cast<const std::uint8_t*>(metadata.data()), 2}));
        ASSERT_TRUE(writer->finish());
    }
    std::ifstream in(path, std::ios::binary);
    const std::vector<unsigned char> written{std::istreambuf_iterator<char>(in), {}};
    std::filesystem::remove(path);
    EXPECT_EQ(bytes_of_document(ENVBAKE_FORMAT_DOCUMENT), written);
}

}  // namespace
}  // namespace envbake::format
