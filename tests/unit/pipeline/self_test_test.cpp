// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/self_test.h"

#include "baker/pipeline/check_self_test.h"

#include "envbake/format/writer.h"
#include "envbake/runtime/cube.h"
#include "envbake/runtime/lat_long.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <numbers>

namespace envbake {
namespace {

/// How the mips of a test bundle are stored.
struct Storage {
    bool cube = true;
    int channels = 3;
};

DVec3 centre_of(const StoredArrays::Mip& mip, int face, int row, int column) {
    const auto w =
        mip.faces == 6
            ? cube::texel_direction<double>(static_cast<cube::Face>(face), row, column, mip.width)
            : lat_long::direction((column + 0.5) / mip.width, (row + 0.5) / mip.height);
    return {w[0], w[1], w[2]};
}

/// Texels hold 1 + level / 10 + 0.2 w.x of their own direction, twice and three times that in the
/// other channels.
StoredArrays::Mip sample_mip(int level, const Storage& storage) {
    const int n = 8 >> level;
    StoredArrays::Mip mip{level,
                          storage.cube ? 6 : 1,
                          storage.cube ? n : 4 * n,
                          storage.cube ? n : 2 * n,
                          storage.channels,
                          {}};
    for (int face = 0; face < mip.faces; ++face)
        for (int row = 0; row < mip.height; ++row)
            for (int column = 0; column < mip.width; ++column)
                for (int c = 0; c < mip.channels; ++c)
                    mip.texels.push_back(static_cast<float>(
                        (c + 1) * (1 + 0.1 * level + 0.2 * centre_of(mip, face, row, column).x)));
    return mip;
}

/// Three mips of either lobe, which share the mirror, and linear tables.
StoredArrays sample_arrays(const Storage& storage = {}) {
    StoredArrays arrays;
    arrays.bands = 3;
    for (int i = 0; i < 27; ++i) arrays.sh.push_back(0.1f * static_cast<float>(27 - i));
    arrays.mip_count = 3;
    for (int level = 0; level < 3; ++level) arrays.ggx.mips.push_back(sample_mip(level, storage));
    for (int level = 1; level < 3; ++level) {
        arrays.beckmann.mips.push_back(sample_mip(level, storage));
        for (float& texel : arrays.beckmann.mips.back().texels) texel *= 0.9f;
    }
    for (StoredArrays::Lobe* lobe : {&arrays.ggx, &arrays.beckmann}) {
        lobe->table_size = 4;
        for (int i = 0; i < 16; ++i)
            lobe->table.insert(lobe->table.end(),
                               {static_cast<float>(i % 4) / (lobe == &arrays.ggx ? 4 : 5),
                                static_cast<float>(i / 4) / 8});
    }
    arrays.vertices.push_back({0, 1, std::vector<float>(9, 0.25f)});
    return arrays;
}

const char* const kMetadata = R"({
  "environment": {
    "mips": {"count": 3, "levels": [
      {"level": 0, "roughness": 0}, {"level": 1, "roughness": 0.5},
      {"level": 2, "roughness": 1}]},
    "mips_beckmann": {"count": 3, "levels": [
      {"level": 1, "roughness": 0.5}, {"level": 2, "roughness": 1}]}},
  "brdf": {"ggx": {"axes":"roots"}, "beckmann": {"axes":"roots"}},
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
        add("environment/sh", {arrays.sh.size() / 3, 3}, arrays.sh);
        const auto add_lobe = [&](const std::string& mips, const char* table,
                                  const StoredArrays::Lobe& lobe) {
            for (const auto& mip : lobe.mips) {
                std::vector<std::uint64_t> shape;
                if (mip.faces == 6) shape.push_back(6);
                for (const int extent : {mip.height, mip.width, mip.channels})
                    shape.push_back(static_cast<std::uint64_t>(extent));
                add((mips + std::to_string(mip.level)).c_str(), shape, mip.texels);
            }
            add(table, {4, 4, 2}, lobe.table);
        };
        add_lobe("environment/mips/", "brdf/ggx", arrays.ggx);
        add_lobe("environment/mips_beckmann/", "brdf/beckmann", arrays.beckmann);
        add("mesh/0/diffuse", {2, 9}, std::vector<float>(18, 0.25f));
        add("selftest/irradiance/normal", {test.irradiance_normal.size() / 3, 3},
            test.irradiance_normal);
        add("selftest/irradiance/value", {test.irradiance_value.size() / 3, 3},
            test.irradiance_value);
        add("selftest/diffuse/vertex", {test.diffuse_vertex.size() / 2, 2}, test.diffuse_vertex);
        add("selftest/diffuse/value", {test.diffuse_value.size() / 3, 3}, test.diffuse_value);
        const auto add_specular = [&](const std::string& name, const SelfTest::Specular& group) {
            add((name + "/input").c_str(), {group.input.size() / 8, 8}, group.input);
            add((name + "/value").c_str(), {group.value.size() / 3, 3}, group.value);
        };
        add_specular("selftest/specular", test.ggx);
        add_specular("selftest/specular_beckmann", test.beckmann);
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
    for (const Storage& storage :
         {Storage{true, 3}, Storage{true, 1}, Storage{false, 3}, Storage{false, 1}}) {
        SCOPED_TRACE(testing::Message() << storage.cube << " " << storage.channels);
        const StoredArrays arrays = sample_arrays(storage);
        const SelfTest test = make_self_test(arrays);
        EXPECT_EQ(test.irradiance_normal.size(), 3u * 26);
        EXPECT_EQ(test.ggx.input.size(), 8u * 48);
        EXPECT_EQ(test.beckmann.input.size(), 8u * 48);
        for (const std::string& failure : failures_of(arrays, test)) ADD_FAILURE() << failure;
    }
}

// Beckmann's texels are 0.9 of GGX's: only questions at the mirror have the same radiance.
TEST(SelfTest, TheLobesShareTheMirrorAlone) {
    StoredArrays arrays = sample_arrays();
    arrays.beckmann.table = arrays.ggx.table;
    const SelfTest test = make_self_test(arrays);
    ASSERT_EQ(test.ggx.input, test.beckmann.input);
    for (std::size_t i = 0; i < test.ggx.value.size() / 3; ++i) {
        const double roughness = static_cast<double>(test.ggx.input[8 * i + 6]);
        const double ratio =
            static_cast<double>(test.beckmann.value[3 * i] / test.ggx.value[3 * i]);
        EXPECT_NEAR(ratio, roughness < 0.5 ? 1 - 0.2 * roughness : 0.9, 0.01) << roughness;
    }
}

TEST(SelfTest, BandsThatTheLightingLacksCountAsNothing) {
    StoredArrays arrays = sample_arrays();
    arrays.bands = 2;
    arrays.sh.resize(12);
    const SelfTest test = make_self_test(arrays);
    double red = 0;
    for (std::size_t i = 0; i < 4; ++i) red += 0.25 * static_cast<double>(arrays.sh[3 * i]);
    EXPECT_NEAR(test.diffuse_value[0], red, 1e-6);
}

TEST(SelfTest, EveryGroupCanFail) {
    const StoredArrays arrays = sample_arrays();
    for (int group = 0; group < 4; ++group) {
        SelfTest test = make_self_test(arrays);
        auto& values = group == 0   ? test.irradiance_value
                       : group == 1 ? test.diffuse_value
                       : group == 2 ? test.ggx.value
                                    : test.beckmann.value;
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
    for (auto& mip : arrays.ggx.mips) mip.texels.assign(mip.texels.size(), 1e-3f);
    arrays.ggx.mips[0].texels[40] = 1e30f;
    for (const float value : make_self_test(arrays).ggx.value) EXPECT_LT(value, 1);
}

}  // namespace
}  // namespace envbake
