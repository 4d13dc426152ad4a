// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/validate.h"

#include "envbake/format/reader.h"
#include "envbake/format/writer.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

namespace envbake {
namespace {

using format::Writer;

class Validate : public ::testing::Test {
  protected:
    void SetUp() override {
        path_ = std::filesystem::temp_directory_path() /
                ("envbake_validate_" + std::to_string(::getpid()) + ".envb");
    }
    void TearDown() override { std::filesystem::remove(path_); }

    /// Every coefficient and every texel of mips is 1, every element of the table and of the
    /// transport is 1/2: the self-test's answers are closed forms.
    struct Content {
        std::vector<float> sh = std::vector<float>(12, 1.0f);
        std::vector<std::uint64_t> sh_shape{4, 3};
        std::vector<float> mip = std::vector<float>(18, 1.0f);
        std::vector<std::uint64_t> mip_shape{6, 1, 1, 3};
        std::vector<float> diffuse = std::vector<float>(8, 0.5f);
        bool diffuse_as_u32 = false;
        std::string metadata =
            R"({"environment":{"mips":{"count":1,"levels":[{"level":0,"face_size":1,"roughness":0}]}},
                "brdf":{"ggx":{"axes":"roots"}},
                "meshes":[{"node":0,"mesh":0,"primitive":0,"vertex_count":2}],
                "self_test":{"tolerance":1e-3}})";
        bool with_metadata = true;
        bool with_environment = true;
        std::vector<std::string> without;       ///< arrays under "selftest/" to leave away
        float irradiance = kIrradianceUpwards;  ///< the stored answer
        std::vector<float> normal{0, 1, 0};
        std::function<void(Writer&)> also;  ///< adds more arrays

        void replace(const std::string& text, const std::string& by) {
            const std::size_t at = metadata.find(text);
            ASSERT_NE(at, std::string::npos) << text;
            metadata.replace(at, text.size(), by);
        }
    };

    /// pi Y_00 + 2 pi / 3 (Y_1-1 + Y_10 + Y_11), all coefficients 1.
    static constexpr float kIrradianceUpwards = 0.88622693f + 1.02332671f;

    static void add_ones(Writer& writer, const std::string& name,
                         std::vector<std::uint64_t> shape) {
        std::uint64_t count = 1;
        for (const std::uint64_t axis : shape) count *= axis;
        EXPECT_TRUE(writer.add<float>(name, std::move(shape), std::vector<float>(count, 1.0f)));
    }

    static void add_self_test(Writer& writer, const Content& c) {
        const auto add = [&](const std::string& name, std::vector<std::uint64_t> shape,
                             const auto& values) {
            using T = typename std::decay_t<decltype(values)>::value_type;
            if (std::find(c.without.begin(), c.without.end(), name) == c.without.end()) {
                EXPECT_TRUE(writer.add<T>("selftest/" + name, std::move(shape), values)) << name;
            }
        };
        add("irradiance/normal", {c.normal.size() / 3, 3}, c.normal);
        add("irradiance/value", {c.normal.size() / 3, 3},
            std::vector<float>(c.normal.size(), c.irradiance));
        add("diffuse/vertex", {1, 2}, std::vector<std::uint32_t>{0, 1});
        add("diffuse/value", {1, 3}, std::vector<float>(3, 2.0f));  // 4 coefficients of 1/2
        add("specular/input", {1, 8}, std::vector<float>{0, 1, 0, 0, 1, 0, 0.5f, 1});
        add("specular/value", {1, 3}, std::vector<float>(3, 1.0f));  // 1 (1 1/2 + 1/2)
    }

    std::vector<int> codes(const Content& c) {
        {
            auto writer = Writer::create(path_.string());
            EXPECT_TRUE(writer);
            if (c.with_environment) {
                EXPECT_TRUE(writer->add<float>("environment/sh", c.sh_shape, c.sh));
                EXPECT_TRUE(writer->add<float>("environment/mips/0", c.mip_shape, c.mip));
                add_self_test(*writer, c);
            }
            if (c.also) c.also(*writer);
            EXPECT_TRUE(writer->add<float>("brdf/ggx", {2, 2, 2}, std::vector<float>(8, 0.5f)));
            if (c.diffuse_as_u32) {
                EXPECT_TRUE(writer->add<std::uint32_t>("mesh/0/diffuse", {2, 4},
                                                       std::vector<std::uint32_t>(8)));
            } else {
                EXPECT_TRUE(writer->add<float>("mesh/0/diffuse", {2, 4}, c.diffuse));
            }
            if (c.with_metadata) {
                EXPECT_TRUE(writer->add<std::uint8_t>(
                    "metadata", {c.metadata.size()},
                    std::vector<std::uint8_t>(c.metadata.begin(), c.metadata.end())));
            }
            EXPECT_TRUE(writer->finish());
        }
        return codes_of_file();
    }

    std::vector<int> codes_of_file() {
        std::vector<int> codes;
        const auto findings = validate_bundle(path_);
        EXPECT_TRUE(findings);
        for (const Finding& finding : *findings) {
            EXPECT_FALSE(finding.message.empty());
            EXPECT_EQ(finding.message.find('\n'), std::string::npos);
            codes.push_back(finding.code);
        }
        return codes;
    }

    void overwrite(std::size_t at, char byte) {
        std::fstream file(path_, std::ios::in | std::ios::out | std::ios::binary);
        file.seekp(static_cast<std::streamoff>(at));
        file.put(byte);
    }

    /// Stores `bytes` as the zstd form of the array "other", u8 [size], in a bundle whose checksums
    /// are right.
    void write_zstd(const std::string& bytes, std::uint64_t size) {
        Content content;
        content.also = [&](Writer& writer) {
            EXPECT_TRUE(writer.add<std::uint8_t>(
                "other", {bytes.size()}, std::vector<std::uint8_t>(bytes.begin(), bytes.end())));
        };
        ASSERT_EQ(codes(content), std::vector<int>{});
        std::vector<std::byte> file(std::filesystem::file_size(path_));
        std::ifstream(path_, std::ios::binary)
            .read(reinterpret_cast<char*>(file.data()), static_cast<std::streamsize>(file.size()));
        const auto put = [&](std::size_t at, std::uint64_t value) {
            std::memcpy(file.data() + at, &value, sizeof(value));
        };
        std::size_t table = 0, entry = 0;
        {
            const auto reader = format::Reader::open(path_.c_str());
            ASSERT_TRUE(reader);
            table = reader->table_offset();
            while (reader->array(entry).name != "other") ++entry;
        }
        const std::size_t at = table + entry * format::kEntrySize;
        file[at + 7] = std::byte{1};  // codec
        put(at + 16, size);           // shape
        put(at + 80, size);
        put(40, format::checksum({file.data() + table, file.size() - table}));
        put(56, format::checksum({file.data(), 56}));
        std::ofstream(path_, std::ios::binary)
            .write(reinterpret_cast<const char*>(file.data()),
                   static_cast<std::streamsize>(file.size()));
    }

    std::filesystem::path path_;
};

using Codes = std::vector<int>;

TEST_F(Validate, AGoodBundleHasNoFindings) {
    EXPECT_EQ(codes({}), Codes{});
}

TEST_F(Validate, EachRuleHasItsCode) {
    const std::vector<std::pair<int, std::function<void(Content&)>>> faults{
        {34, [](Content& c) { c.with_metadata = false; }},
        {100, [](Content& c) { c.metadata = "[1"; }},
        {100, [](Content& c) { c.metadata = "[]"; }},
        {100, [](Content& c) { c.metadata = "{\"a\":" + std::string(100000, '['); }},
        {100,
         [](Content& c) {
             c.metadata = "{\"a\":" + std::string(65, '[') + std::string(65, ']') + "}";
         }},
        {100, [](Content& c) { c.metadata = "{\"\xff\":1}"; }},
        {101, [](Content& c) { c.metadata = "{}"; }},
        {101, [](Content& c) { c.replace("1e-3", "1e30"); }},
        {101, [](Content& c) { c.replace("1e-3", "0.011"); }},
        {101, [](Content& c) { c.replace("1e-3", "0"); }},
        {101, [](Content& c) { c.replace("1e-3", "-1e-3"); }},
        {101, [](Content& c) { c.replace("1e-3", "\"1e-3\""); }},
        {101, [](Content& c) { c.replace("tolerance", "patience"); }},
        {101, [](Content& c) { c.replace("self_test", "shelf_test"); }},
        {101,
         [](Content& c) {
             c.without = {"irradiance/normal", "irradiance/value"};
         }},
        {101,
         [](Content& c) {
             c.without = {"diffuse/vertex", "diffuse/value"};
         }},
        {101, [](Content& c) { c.without = {"irradiance/value"}; }},
        {101, [](Content& c) { c.without = {"specular/value"}; }},
        {101, [](Content& c) { c.without = {"specular/input"}; }},
        {103, [](Content& c) { c.normal.clear(); }},
        {110, [](Content& c) { c.irradiance *= 1.02f; }},
        {101, [](Content& c) { c.replace("\"count\":1", "\"count\":0"); }},
        {101, [](Content& c) { c.replace("\"count\":1", "\"count\":17"); }},
        {101, [](Content& c) { c.replace("\"count\":1", "\"count\":1.5"); }},
        {101, [](Content& c) { c.replace("\"level\":0", "\"level\":1"); }},
        {101, [](Content& c) { c.replace("\"roughness\":0", "\"roughness\":2e-6"); }},
        {101, [](Content& c) { c.replace("\"roughness\":0", "\"rawness\":0"); }},
        {101, [](Content& c) { c.replace("\"node\":0", "\"node\":-1"); }},
        {101, [](Content& c) { c.replace("\"mesh\":0", "\"mesh\":\"0\""); }},
        {101, [](Content& c) { c.replace("\"primitive\":0", "\"primitive\":0.5"); }},
        {101, [](Content& c) { c.replace("\"node\":0,", ""); }},
        {102, [](Content& c) { c.diffuse_as_u32 = true; }},
        {103,
         [](Content& c) {
             c.sh_shape = {3, 4};
         }},
        {103, [](Content& c) { c.sh_shape = {12}; }},
        {103,
         [](Content& c) {
             c.mip_shape = {6, 3};
         }},
        {104, [](Content& c) { c.diffuse[3] = NAN; }},
        {104, [](Content& c) { c.sh[0] = INFINITY; }},
        {105, [](Content& c) { c.mip[2] = -1e-6f; }},
    };
    for (std::size_t i = 0; i < faults.size(); ++i) {
        Content content;
        faults[i].second(content);
        const Codes found = codes(content);
        ASSERT_FALSE(found.empty()) << i;
        for (const int code : found) EXPECT_EQ(code, faults[i].first) << i;
    }
}

TEST_F(Validate, VertexCountsAndFaceSizesMustAgree) {
    Content content;
    content.metadata.replace(content.metadata.find("\"vertex_count\":2"), 16, "\"vertex_count\":3");
    EXPECT_EQ(codes(content), Codes{101});
    content = {};
    content.metadata.replace(content.metadata.find("\"face_size\":1"), 13, "\"face_size\":2");
    EXPECT_EQ(codes(content), Codes{101});
    content = {};
    content.metadata.replace(content.metadata.find("roots"), 5, "cubic");
    EXPECT_EQ(codes(content), Codes{101});
}

TEST_F(Validate, TheSelfTestsToleranceMayBeItsLargest) {
    Content content;
    content.replace("1e-3", "1e-2");
    EXPECT_EQ(codes(content), Codes{});
}

TEST_F(Validate, WithoutAnEnvironmentNothingNeedBeAsked) {
    Content content;
    content.with_environment = false;
    content.metadata = R"({"brdf":{"ggx":{"axes":"roots"}},
        "meshes":[{"node":0,"mesh":0,"primitive":0,"vertex_count":2}]})";
    EXPECT_EQ(codes(content), Codes{});
}

/// A bundle of mips of these levels and face sizes beside level 0 of 12 texels.
struct MipChain {
    std::vector<std::pair<int, std::uint64_t>> stored;
    std::string count, levels;
    Codes codes;
};

TEST_F(Validate, MipsFollowFromTheirFirstAndAreListedInOrder) {
    const std::string level_0 = R"({"level":0,"face_size":12,"roughness":0},)";
    const std::string level_1 = R"({"level":1,"face_size":6,"roughness":0.3333333})";
    const std::string level_2 = R"({"level":2,"face_size":3,"roughness":0.6666667})";
    const MipChain chains[] = {
        {{{1, 6}, {2, 3}}, "4", level_0 + level_1 + "," + level_2, {}},
        {{{1, 5}}, "4", level_0 + R"({"level":1,"face_size":5,"roughness":0.3333333})", {103}},
        {{{1, 12}}, "4", level_0 + R"({"level":1,"face_size":12,"roughness":0.3333333})", {103}},
        {{{1, 6}, {2, 3}}, "3", level_0 + level_1 + "," + level_2, {101, 101}},  // roughness
        {{{1, 6}, {2, 3}}, "2", level_0 + level_1 + "," + level_2, {101, 101}},
        {{{1, 6}, {2, 3}}, "4", level_0 + level_2 + "," + level_1, {101, 101}},
        {{{1, 6}, {2, 3}}, "4", level_0 + level_1, {101}},
        {{{1, 6}}, "4", level_0 + level_1 + "," + level_2, {101}},
        {{{2, 3}}, "4", level_0 + level_2, {101}},
        {{{1, 6}}, "4", level_0 + R"({"level":1,"face_size":6,"roughness":0.333331})", {101}},
    };
    for (const MipChain& chain : chains) {
        SCOPED_TRACE(chain.count + " " + chain.levels);
        Content content;
        content.mip.assign(6 * 12 * 12 * 3, 1.0f);
        content.mip_shape = {6, 12, 12, 3};
        content.replace("\"count\":1", "\"count\":" + chain.count);
        content.replace(R"({"level":0,"face_size":1,"roughness":0})", chain.levels);
        content.also = [&](Writer& writer) {
            for (const auto& [level, size] : chain.stored)
                add_ones(writer, "environment/mips/" + std::to_string(level), {6, size, size, 3});
        };
        EXPECT_EQ(codes(content), chain.codes);
    }
}

TEST_F(Validate, GreyLatLongMipsOfBothLobesAreGood) {
    Content content;
    content.mip.assign(8 * 16, 1.0f);
    content.mip_shape = {8, 16, 1};
    content.replace("\"count\":1", "\"count\":3");
    const std::string level_1 = R"({"level":1,"width":8,"height":4,"roughness":0.5})";
    const std::string lists = R"({"level":0,"width":16,"height":8,"roughness":0},)" + level_1;
    content.replace(R"({"level":0,"face_size":1,"roughness":0})", lists);
    content.replace(R"("mips":)", R"("lights":{"extracted":false},"mips":)");
    content.replace(R"("mips":)",
                    R"("mips_beckmann":{"count":3,"levels":[)" + level_1 + R"(]},"mips":)");
    content.replace(R"("ggx":)", R"("beckmann":{"axes":"linear"},"ggx":)");
    content.also = [](Writer& writer) {
        add_ones(writer, "environment/mips/1", {4, 8, 1});
        add_ones(writer, "environment/mips_beckmann/1", {4, 8, 1});
        add_ones(writer, "environment/lights", {2, 9});
        add_ones(writer, "environment/irradiance", {9, 1});
        add_ones(writer, "brdf/ggx_average_albedo", {2});
        add_ones(writer, "brdf/beckmann", {4, 4, 2});
        add_ones(writer, "brdf/beckmann_average_albedo", {4});
    };
    EXPECT_EQ(codes(content), Codes{});
}

TEST_F(Validate, LightingArraysHaveTheirShapes) {
    const std::vector<std::pair<int, std::function<void(Writer&)>>> faults{
        {103,
         [](Writer& w) {
             add_ones(w, "environment/lights", {1, 8});
         }},
        {103, [](Writer& w) { add_ones(w, "environment/lights", {9}); }},
        {102,
         [](Writer& w) {
             EXPECT_TRUE(
                 w.add<std::uint32_t>("environment/lights", {1, 9}, std::vector<std::uint32_t>(9)));
         }},
        {101,
         [](Writer& w) {
             add_ones(w, "environment/lights", {1, 9});
         }},  // extracted?
        {103,
         [](Writer& w) {
             add_ones(w, "environment/irradiance", {4, 2});
         }},
        {103,
         [](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {6, 1, 1, 2});
         }},
        {103,
         [](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {3, 6, 3});
         }},
        {103,
         [](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {4, 6, 3});
         }},
        {101,
         [](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {6, 1, 1, 3});
         }},
        {103,
         [](Writer& w) {
             add_ones(w, "brdf/beckmann", {4, 3, 2});
         }},
        {101,
         [](Writer& w) {
             add_ones(w, "brdf/beckmann", {4, 4, 2});
         }},
        {103, [](Writer& w) { add_ones(w, "brdf/ggx_average_albedo", {3}); }},
        {103, [](Writer& w) { add_ones(w, "brdf/beckmann_average_albedo", {4}); }},
        {101,
         [](Writer& w) {
             add_ones(w, "selftest/specular_beckmann/input", {1, 8});
         }},
        {101,
         [](Writer& w) {
             add_ones(w, "selftest/specular_beckmann/value", {1, 3});
         }},
    };
    for (std::size_t i = 0; i < faults.size(); ++i) {
        Content content;
        content.also = faults[i].second;
        EXPECT_EQ(codes(content), Codes{faults[i].first}) << i;
    }
}

TEST_F(Validate, TheMipsOfAChainAreOfAKind) {
    for (const std::vector<std::uint64_t>& shape :
         {std::vector<std::uint64_t>{6, 1, 1, 1}, {2, 4, 3}}) {
        Content content;
        content.mip.assign(6 * 2 * 2 * 3, 1.0f);
        content.mip_shape = {6, 2, 2, 3};
        content.also = [&](Writer& writer) { add_ones(writer, "environment/mips/1", shape); };
        EXPECT_EQ(codes(content), Codes{103});
    }
}

TEST_F(Validate, ElevenMipsEndAtOneTexel) {
    Content content;
    content.mip.assign(6 * 4 * 4 * 3, 1.0f);
    content.mip_shape = {6, 4, 4, 3};
    std::string levels = R"({"level":0,"face_size":4,"roughness":0})";
    for (int level = 1; level < 11; ++level)
        levels += ",{\"level\":" + std::to_string(level) +
                  ",\"face_size\":" + std::to_string(level == 1 ? 2 : 1) +
                  ",\"roughness\":" + std::to_string(level / 10.0) + "}";
    content.replace("\"count\":1", "\"count\":11");
    content.replace(R"({"level":0,"face_size":1,"roughness":0})", levels);
    content.also = [](Writer& writer) {
        for (int level = 1; level < 11; ++level) {
            const std::uint64_t size = level == 1 ? 2 : 1;
            add_ones(writer, "environment/mips/" + std::to_string(level), {6, size, size, 3});
        }
    };
    EXPECT_EQ(codes(content), Codes{});
}

TEST_F(Validate, NamesThatTheFormatDoesNotKnowAreNotJudged) {
    Content content;
    content.also = [](Writer& writer) {
        for (const char* name :
             {"brdf/ggx_albedo", "brdf/sheen", "environment/mips/note", "environment/mips/01",
              "environment/mips/0/mask", "environment/mips", "environment/sh2", "mesh/0/other",
              "mesh/7/other", "mesh/00/diffuse", "mesh/0/diffuse/sums", "mesh/x/diffuse",
              "selftest/refraction/input"})
            add_ones(writer, name, {64, 64});
        EXPECT_TRUE(writer.add<float>("environment/mips/deep", {2}, std::vector<float>{NAN, -1}));
    };
    EXPECT_EQ(codes(content), Codes{});
    content.also = [](Writer& writer) { add_ones(writer, "mesh/7/unshadowed", {2, 4}); };
    EXPECT_EQ(codes(content), Codes{101});
    content.also = [](Writer& writer) {
        add_ones(writer, "mesh/99999999999999999999/diffuse", {2, 4});
    };
    EXPECT_EQ(codes(content), Codes{101});
}

// Frames of raw blocks by hand, RFC 8878 section 3.1.1.
TEST_F(Validate, ZstdIsOneFrameThatStatesItsSize) {
    const std::string magic = "\x28\xb5\x2f\xfd";
    const auto raw_block = [](const std::string& content) {
        return std::string{static_cast<char>(content.size() << 3 | 1), 0, 0} + content;
    };
    const auto frame = [&](const std::string& content) {  // one segment, size in one byte
        return magic + std::string{0x20, static_cast<char>(content.size())} + raw_block(content);
    };
    const std::string sizeless = magic + std::string{0, 0} + raw_block("abcd");
    const std::string skippable{0x50, 0x2a, 0x4d, 0x18, 0, 0, 0, 0};
    const auto judge = [&](const std::string& bytes, std::uint64_t size, bool plausible) {
        write_zstd(bytes, size);
        const auto reader = format::Reader::open(path_.c_str());
        EXPECT_TRUE(reader);
        EXPECT_EQ(reader->size_is_plausible(*reader->find("other")), plausible);
        EXPECT_TRUE(reader->size_is_plausible(*reader->find("metadata")));
        return codes_of_file();
    };
    EXPECT_EQ(judge(frame("abcd"), 4, true), Codes{});
    EXPECT_EQ(judge(frame(""), 0, true), Codes{});
    EXPECT_EQ(judge(frame("ab") + frame("cd"), 4, false), Codes{31});
    EXPECT_EQ(judge(frame("abcd") + frame(""), 4, true), Codes{31});
    EXPECT_EQ(judge(frame("abcd") + skippable, 4, true), Codes{31});
    EXPECT_EQ(judge(skippable + frame("abcd"), 4, false), Codes{31});
    EXPECT_EQ(judge(skippable, 0, false), Codes{31});
    EXPECT_EQ(judge(frame("abcd") + '\0', 4, true), Codes{31});
    EXPECT_EQ(judge(sizeless, 4, false), Codes{31});
    EXPECT_EQ(judge(frame("abcd"), 5, false), Codes{31});
    EXPECT_EQ(judge(frame("abcd"), std::uint64_t{1} << 24, false), Codes{31});
    EXPECT_EQ(judge(frame("abcd").substr(0, 10), 4, true), Codes{31});
    EXPECT_EQ(judge("abc", 4, false), Codes{31});
}

TEST_F(Validate, TheWritersOwnZstdFramesStateTheirSize) {
    Content content;
    content.also = [](Writer& writer) {
        EXPECT_TRUE(
            writer.add<float>("other/empty", {0}, std::vector<float>(), format::Codec::Zstd));
        EXPECT_TRUE(writer.add<float>("other/large", {300000}, std::vector<float>(300000, 1.0f),
                                      format::Codec::Zstd));
    };
    EXPECT_EQ(codes(content), Codes{});
}

TEST_F(Validate, DamageIsFoundByteByByte) {
    ASSERT_EQ(codes({}), Codes{});
    overwrite(64, 7);  // in the first array
    EXPECT_EQ(codes_of_file(), Codes{30});
    ASSERT_EQ(codes({}), Codes{});
    overwrite(64 + 48 + 1, 7);  // in the padding behind it
    EXPECT_EQ(codes_of_file(), Codes{32});
    ASSERT_EQ(codes({}), Codes{});
    overwrite(0, 7);
    EXPECT_EQ(codes_of_file(), Codes{11});
    std::filesystem::resize_file(path_, 3);
    EXPECT_EQ(codes_of_file(), Codes{10});
}

TEST_F(Validate, AnAbsentFileIsNoFinding) {
    const auto findings = validate_bundle(path_);
    ASSERT_FALSE(findings);
    EXPECT_EQ(findings.error().code, Errc::Failed);
}

}  // namespace
}  // namespace envbake
