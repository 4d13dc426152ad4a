// SPDX-License-Identifier: Apache-2.0
// examples/read_bundle/envb.py, written from docs/format.md alone, against the C++ side: the same
// arrays from the same file, and no for the same files.
#include "tests/support/run_program.h"
#include "tests/support/small_scene.h"

#include "envbake/format/reader.h"
#include "envbake/format/writer.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;

Outcome run(const std::string& python, const std::vector<std::string>& arguments) {
    std::vector<std::string> all{python, "-B"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return Program("/usr/bin/env", std::move(all)).wait();
}

/// That of the path, or else the system's, which a numpy of a package is for; empty: neither has
/// it.
std::string python_with_numpy() {
    for (const char* python : {"python3", "/usr/bin/python3"})
        if (run(python, {"-c", "import numpy"}).status == 0) return python;
    return {};
}

class PythonReader : public ::testing::Test {
  protected:
    void SetUp() override {
        if (python_.empty()) GTEST_SKIP() << "*** SKIPPED: no python3 with numpy ***";
    }
    Outcome python(const std::vector<std::string>& arguments) const {
        return run(python_, arguments);
    }

    const std::string python_ = python_with_numpy();
    const std::string script_ = ENVBAKE_PYTHON_READER;
    TemporaryFolder folder_;
};

TEST_F(PythonReader, ReadsWhatExtractGives) {
    const std::string scene = write_small_scene(folder_.path()).string();
    const std::string sky = write_small_sky(folder_ / "sky.hdr").string();
    const std::string bundle = (folder_ / "scene.envb").string();
    const Outcome baked = envbake({"bake", scene, "--env", sky, "-o", bundle, "--mip-size", "16",
                                   "--mip-count", "3", "--table-size", "16", "--irradiance",
                                   "--unshadowed", "--half-tables", "--bounces", "all"});
    ASSERT_EQ(baked.status, 0) << baked.err;

    const auto reader = format::Reader::open(bundle.c_str());
    ASSERT_TRUE(reader);
    ASSERT_GT(reader->array_count(), 12u);
    std::ofstream pairs(folder_ / "pairs");
    for (std::size_t i = 0; i < reader->array_count(); ++i) {
        const std::string name(reader->array(i).name);
        const std::string file = (folder_ / (std::to_string(i) + ".npy")).string();
        const Outcome extracted = envbake({"extract", bundle, name, "-o", file});
        ASSERT_EQ(extracted.status, 0) << extracted.err;
        pairs << name << ' ' << file << '\n';
    }
    pairs.close();
    const Outcome compared =
        python({"-c",
                "import sys; sys.path.insert(0, sys.argv[1])\n"
                "import envb, numpy\n"
                "bundle, same = envb.Bundle(sys.argv[2]), 0\n"
                "for name, file in map(str.split, open(sys.argv[3])):\n"
                "    a, b = bundle[name], numpy.load(file)\n"
                "    assert a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == "
                "b.tobytes(), name\n"
                "    same += 1\n"
                "print(same, len(bundle.entries), envb.self_test(bundle) > 20)\n",
                fs::path(script_).parent_path().string(), bundle, (folder_ / "pairs").string()});
    ASSERT_EQ(compared.status, 0) << compared.err;
    const std::string count = std::to_string(reader->array_count());
    EXPECT_EQ(compared.out, count + " " + count + " True\n");
}

/// Every encoding of one transport: the bundle is valid, the reader's answers are those of the
/// self-test, what it decodes is off from the f32 by what the metadata says, and the bytes are the
/// same on any number of threads.
TEST_F(PythonReader, DecodesEveryEncodingOfTransport) {
    const std::string scene = write_small_scene(folder_.path(), "scene", 16).string();
    const std::string sky = write_small_sky(folder_ / "sky.hdr").string();
    const auto bake = [&](const std::string& name, std::vector<std::string> options) {
        std::vector<std::string> arguments{
            "bake",       scene, "--env",        sky, "-o",     (folder_ / name).string(),
            "--mip-size", "4",   "--table-size", "4", "--rays", "256"};
        arguments.insert(arguments.end(), options.begin(), options.end());
        const Outcome baked = envbake(arguments);
        EXPECT_EQ(baked.status, 0) << baked.err;
        return (folder_ / name).string();
    };
    // The encoding, the bounces, and the tolerance at which f32 is baked alike: the share of 1e-2
    // that the plan leaves to the bake.
    const std::vector<std::array<std::string, 3>> cases{
        {"f16", "0", "0.01"},     {"unorm16", "1", "0.01"}, {"unorm8", "0", "0.009"},
        {"unorm8", "1", "0.009"}, {"cpca", "0", "0.008"},   {"cpca", "1", "0.008"},
        {"auto", "0", "0.008"}};
    for (const auto& [encoding, bounces, tolerance] : cases) {
        const std::string plain =
            bake("f32", {"--bounces", bounces, "--tolerance", tolerance, "--force"});
        std::string files[2];
        for (const std::string threads : {"1", "2"})
            files[threads == "2"] = bake(
                encoding + threads,
                {"--bounces", bounces, "--encoding", encoding, "--threads", threads, "--force"});
        EXPECT_EQ(read_file(files[0]), read_file(files[1])) << encoding;
        EXPECT_EQ(envbake({"validate", files[0]}).status, 0) << encoding;
        const Outcome compared =
            python({"-c",
                    "import sys; sys.path.insert(0, sys.argv[1])\n"
                    "import envb, numpy as np\n"
                    "plain, bundle = envb.Bundle(sys.argv[2]), envb.Bundle(sys.argv[3])\n"
                    "assert envb.self_test(bundle) > 20\n"
                    "a, b = plain.transport(0).astype('f8'), bundle.transport(0).astype('f8')\n"
                    "stated = bundle.metadata()['meshes'][0]['diffuse']['encoding']\n"
                    "A = envb.clamped_cosine(5) / np.pi\n"
                    "norm = np.sqrt(np.sum(A ** 2) / (4 * np.pi) * a[0].size / 25)\n"
                    "off = np.sqrt(np.sum((a - b).reshape(len(a), -1) ** 2, 1)) / norm\n"
                    "rms, worst = np.sqrt(np.mean(off ** 2)), off.max()\n"
                    "assert 0 < rms < 6.1e-3, rms\n"
                    "assert abs(rms / stated['error_rms'] - 1) < 6e-3, (rms, stated)\n"
                    "assert abs(worst / stated['error_worst'] - 1) < 6e-3, (worst, stated)\n"
                    "print(stated['name'])\n",
                    fs::path(script_).parent_path().string(), plain, files[0]});
        EXPECT_EQ(compared.status, 0) << encoding << ' ' << compared.err;
        if (encoding != "auto") {
            EXPECT_EQ(compared.out, encoding + "\n");
        }
    }
}

/// Array lengths take every path of the checksum.
std::string small_bundle(const std::string& path) {
    auto writer = format::Writer::create(path);
    EXPECT_TRUE(writer);
    constexpr std::size_t kSizes[] = {0, 1, 3, 8, 16, 17, 128, 129, 240, 241, 1025, 4000};
    for (const std::size_t size : kSizes) {
        std::vector<std::uint8_t> values(size);
        for (std::size_t i = 0; i < size; ++i) values[i] = static_cast<std::uint8_t>(i * 37 + size);
        std::ostringstream name;
        name << "bytes/" << size;
        EXPECT_TRUE(writer->add<std::uint8_t>(name.str(), {size}, values, format::Codec::None));
    }
    const std::string metadata = "{}";
    EXPECT_TRUE(writer->add<std::uint8_t>(
        std::string(format::kMetadataName), {metadata.size()},
        {reinterpret_cast<const std::uint8_t*>(metadata.data()), metadata.size()},
        format::Codec::None));
    EXPECT_TRUE(writer->finish());
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

bool accepted(const std::string& path) {
    const auto reader = format::Reader::open(path.c_str());
    if (!reader) return false;
    for (std::size_t i = 0; i < reader->array_count(); ++i)
        if (!reader->verify(reader->array(i))) return false;
    return true;
}

TEST_F(PythonReader, RefusesWhatTheOtherReaderRefuses) {
    const std::string whole = small_bundle((folder_ / "whole.envb").string());
    ASSERT_GT(whole.size(), 7000u);
    std::vector<std::string> files;
    const auto add = [&](const std::string& bytes) {
        files.push_back((folder_ / std::to_string(files.size())).string());
        std::ofstream(files.back(), std::ios::binary) << bytes;
    };
    add(whole);
    add(whole + '\0');
    for (std::size_t size = 0; size < whole.size(); size += size < 64 ? 9 : 997)
        add(whole.substr(0, size));
    for (std::size_t at = 0; at < whole.size(); at += at < 64 ? 1 : 41) {
        std::string damaged = whole;
        damaged[at] = static_cast<char>(damaged[at] ^ 1);
        add(damaged);
    }

    std::vector<std::string> arguments{script_};
    arguments.insert(arguments.end(), files.begin(), files.end());
    const Outcome outcome = python(arguments);
    EXPECT_EQ(outcome.status, 1);
    EXPECT_EQ(outcome.err.find("Traceback"), std::string::npos) << outcome.err;
    std::map<std::string, bool> verdict;
    const auto read = [&](const std::string& text, bool good) {
        std::istringstream lines(text);
        for (std::string line; std::getline(lines, line);)
            if (line[0] != ' ') verdict[line.substr(0, line.find(": "))] = good;
    };
    read(outcome.out, true);
    read(outcome.err, false);
    ASSERT_EQ(verdict.size(), files.size()) << outcome.err;
    std::size_t refused = 0;
    for (std::size_t i = 0; i < files.size(); ++i) {
        EXPECT_EQ(verdict[files[i]], accepted(files[i])) << "file " << i;
        refused += !verdict[files[i]];
    }
    EXPECT_TRUE(verdict[files[0]]);
    EXPECT_GT(refused, files.size() / 2);  // padding has no checksum
}

}  // namespace
}  // namespace envbake::test
