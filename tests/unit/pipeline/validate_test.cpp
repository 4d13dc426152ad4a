// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/validate.h"

#include "envbake/format/writer.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
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

    struct Content {
        std::vector<float> sh = std::vector<float>(12, 1.0f);
        std::vector<std::uint64_t> sh_shape{4, 3};
        std::vector<float> mip = std::vector<float>(18, 1.0f);
        std::vector<std::uint64_t> mip_shape{6, 1, 1, 3};
        std::vector<float> diffuse = std::vector<float>(8, 0.5f);
        bool diffuse_as_u32 = false;
        std::string metadata =
            R"({"environment":{"mips":{"count":1,"levels":[{"level":0,"face_size":1,"roughness":0}]}},
                "brdf":{"ggx":{"axes":"sqrt"}},
                "meshes":[{"node":0,"mesh":0,"primitive":0,"vertex_count":2}]})";
        bool with_metadata = true;
    };

    std::vector<int> codes(const Content& c) {
        {
            auto writer = Writer::create(path_.string());
            EXPECT_TRUE(writer);
            EXPECT_TRUE(writer->add<float>("environment/sh", c.sh_shape, c.sh));
            EXPECT_TRUE(writer->add<float>("environment/mips/0", c.mip_shape, c.mip));
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
    content.metadata.replace(content.metadata.find("sqrt"), 4, "cubic");
    EXPECT_EQ(codes(content), Codes{101});
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
