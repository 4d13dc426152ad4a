// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/self_test.h"

#include "baker/pipeline/check_self_test.h"

#include "envbake/format/writer.h"
#include "envbake/runtime/cube.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <numbers>

namespace envbake {
namespace {

/// Mips whose texels hold 1 + level / 10 + 0.2 w.x of their own direction; a linear table.
StoredArrays sample_arrays() {
    StoredArrays arrays;
    arrays.bands = 3;
    for (int i = 0; i < 27; ++i) arrays.sh.push_back(0.1f * static_cast<float>(27 - i));
    arrays.mip_count = 3;
    for (int level = 0; level < 3; ++level) {
        StoredArrays::Mip mip{level, 8 >> level, {}};
        for (int face = 0; face < 6; ++face)
            for (int row = 0; row < mip.face_size; ++row)
                for (int column = 0; column < mip.face_size; ++column) {
                    const auto w = cube::texel_direction<double>(static_cast<cube::Face>(face), row,
                                                                 column, mip.face_size);
                    const auto value = static_cast<float>(1 + 0.1 * level + 0.2 * w[0]);
                    mip.texels.insert(mip.texels.end(), {value, 2 * value, 3 * value});
                }
        arrays.mips.push_back(std::move(mip));
    }
    arrays.table_size = 4;
    for (int i = 0; i < 16; ++i)
        arrays.table.insert(arrays.table.end(),
                            {static_cast<float>(i % 4) / 4, static_cast<float>(i / 4) / 8});
    arrays.vertices.push_back({0, 1, std::vector<float>(9, 0.25f)});
    return arrays;
}

const char* const kMetadata = R"({
  "environment": {"mips": {"count": 3, "levels": [
    {"level": 0, "face_size": 8, "roughness": 0},
    {"level": 1, "face_size": 4, "roughness": 0.5},
    {"level": 2, "face_size": 2, "roughness": 1}]}},
  "brdf": {"ggx": {"axes":"roots"}},
  "meshes": [{"node": 0, "mesh": 0, "primitive": 0, "vertex_count": 2}],
  "self_test": {"tolerance": 1e-3}})";

/// Writes the arrays and their self-test as a bundle and lets the runtime answer.
std::vector<std::string> failures_of(const StoredArrays& arrays, const SelfTest& test) {
    const auto path = std::filesystem::temp_directory_path() /
                      ("envbake_self_test_" + std::to_string(::getpid()) + ".envb");
    {
        auto writer = format::Writer::create(path.string());
        EXPECT_TRUE(writer);
        const auto add = [&](const char* name, std::vector<std::uint64_t> shape,
                             const auto& values) {
            using T = typename std::decay_t<decltype(values)>::value_type;
            EXPECT_TRUE(writer->add<T>(name, std::move(shape), values)) << name;
        };
        add("environment/sh", {9, 3}, arrays.sh);
        for (const auto& mip : arrays.mips) {
            const auto s = static_cast<std::uint64_t>(mip.face_size);
            add(("environment/mips/" + std::to_string(mip.level)).c_str(), {6, s, s, 3},
                mip.texels);
        }
        add("brdf/ggx", {4, 4, 2}, arrays.table);
        add("mesh/0/diffuse", {2, 9}, std::vector<float>(18, 0.25f));
        add("selftest/irradiance/normal", {test.irradiance_normal.size() / 3, 3},
            test.irradiance_normal);
        add("selftest/irradiance/value", {test.irradiance_value.size() / 3, 3},
            test.irradiance_value);
        add("selftest/diffuse/vertex", {test.diffuse_vertex.size() / 2, 2}, test.diffuse_vertex);
        add("selftest/diffuse/value", {test.diffuse_value.size() / 3, 3}, test.diffuse_value);
        add("selftest/specular/input", {test.specular_input.size() / 8, 8}, test.specular_input);
        add("selftest/specular/value", {test.specular_value.size() / 3, 3}, test.specular_value);
        const std::string metadata = kMetadata;
        add("metadata", {metadata.size()},
            std::vector<std::uint8_t>(metadata.begin(), metadata.end()));
        EXPECT_TRUE(writer->finish());
    }
    const auto reader = format::Reader::open(path.c_str());
    EXPECT_TRUE(reader);
    auto failures = check_self_test(*reader, SelfTest::kTolerance);
    std::filesystem::remove(path);
    return failures;
}

TEST(SelfTest, TheRuntimeGivesTheSameAnswersAsTheDoublePrecisionOnes) {
    const StoredArrays arrays = sample_arrays();
    const SelfTest test = make_self_test(arrays);
    EXPECT_EQ(test.irradiance_normal.size(), 3u * 26);
    EXPECT_EQ(test.specular_input.size(), 8u * 48);
    for (const std::string& failure : failures_of(arrays, test)) ADD_FAILURE() << failure;
}

TEST(SelfTest, EveryGroupCanFail) {
    const StoredArrays arrays = sample_arrays();
    for (int group = 0; group < 3; ++group) {
        SelfTest test = make_self_test(arrays);
        auto& values = group == 0   ? test.irradiance_value
                       : group == 1 ? test.diffuse_value
                                    : test.specular_value;
        values[1] *= 1.01f;
        EXPECT_EQ(failures_of(arrays, test).size(), 1u) << group;
    }
}

// A constant environment of radiance 1 has l_00 = 2 sqrt(pi) and irradiance pi everywhere.
TEST(SelfTest, IrradianceOfAConstantEnvironmentIsPi) {
    StoredArrays arrays;
    arrays.bands = 5;
    arrays.sh.assign(75, 0);
    for (std::size_t c = 0; c < 3; ++c)
        arrays.sh[c] = static_cast<float>(2 * std::sqrt(std::numbers::pi));
    for (const float E : make_self_test(arrays).irradiance_value)
        EXPECT_NEAR(E, std::numbers::pi, 1e-6);
}

TEST(SelfTest, SpecularQuestionsBesideASunAreNotAsked) {
    StoredArrays arrays = sample_arrays();
    for (auto& mip : arrays.mips) mip.texels.assign(mip.texels.size(), 1e-3f);
    arrays.mips[0].texels[40] = 1e30f;
    for (const float value : make_self_test(arrays).specular_value) EXPECT_LT(value, 1);
}

}  // namespace
}  // namespace envbake
