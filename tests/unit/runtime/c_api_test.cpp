// SPDX-License-Identifier: Apache-2.0
#include "envbake/envbake.h"

#include "envbake/runtime/bundle.h"
#include "envbake/runtime/shade.h"
#include "tests/unit/runtime/bundle_builder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

extern "C" int use_from_c(const char* path, float* irradiance_up, float* first_exit,
                          size_t* vertex_count);

namespace envbake {
namespace {

using format::Codec;
using std::numbers::pi;
using test::AlignedBytes;
using test::BundleBuilder;

constexpr std::size_t kVertices = 150;  // more than the implementation's block

/// Constant radiance (1, 2, 3); vertex k sees the share k / kVertices of it.
void fill(BundleBuilder& builder, Codec codec = Codec::None) {
    std::vector<float> sh(12), transport(4 * kVertices), mips, table;
    for (std::size_t c = 0; c < 3; ++c)
        sh[c] = static_cast<float>(2 * std::sqrt(pi) * static_cast<double>(c + 1));
    for (std::size_t k = 0; k < kVertices; ++k) {
        transport[4 * k] =
            static_cast<float>(0.5 / std::sqrt(pi) * static_cast<double>(k) / kVertices);
    }
    for (int i = 0; i < 6; ++i) mips.insert(mips.end(), {1, 2, 3});
    for (int i = 0; i < 4; ++i) table.insert(table.end(), {0.5f, 0.25f});
    builder.add("environment/sh", {4, 3}, sh, codec)
        .add("environment/mips/0", {6, 1, 1, 3}, mips, codec)
        .add("brdf/ggx", {2, 2, 2}, table, codec)
        .add("mesh/0/diffuse", {kVertices, 4}, transport, codec)
        .metadata(R"({"environment": {"mips": {"count": 1,
                      "levels": [{"level": 0, "roughness": 0}]}},
                      "brdf": {"ggx": {"axes": "linear"}}, "meshes": [
                      {"node": 0, "mesh": 0, "primitive": 0, "vertex_count": 150},
                      {"node": 0, "mesh": 0, "primitive": 1, "vertex_count": 9}]})");
}

TEST(CApi, WorksFromC) {
    BundleBuilder builder;
    fill(builder);
    float up[3], exit[3];
    size_t vertex_count = 0;
    EXPECT_EQ(use_from_c(builder.finish().c_str(), up, exit, &vertex_count), 0);
    EXPECT_NEAR(up[2], 3 * pi, 1e-5);
    EXPECT_EQ(exit[0], 0);
    EXPECT_EQ(vertex_count, kVertices);
    EXPECT_EQ(use_from_c("/nonexistent", up, exit, &vertex_count),
              static_cast<int>(format::Errc::CannotOpen));
}

TEST(CApi, ShadesAsTheOtherSide) {
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        BundleBuilder builder;
        fill(builder, codec);
        const AlignedBytes memory = builder.finish_in_memory();
        envbake_bundle* bundle =
            envbake_open_memory(memory.bytes().data(), memory.bytes().size(), nullptr);
        ASSERT_NE(bundle, nullptr);

        const float n[3] = {0, 0, 1}, v[3] = {0.6f, 0, 0.8f}, r0[3] = {1, 0.5f, 0};
        float rgb[3], ab[2];
        envbake_irradiance(bundle, n, rgb);
        EXPECT_NEAR(rgb[1], 2 * pi, 1e-5);
        envbake_specular(bundle, n, v, 0.5f, r0, rgb);
        EXPECT_NEAR(rgb[0], 0.75, 1e-6);
        EXPECT_NEAR(rgb[1], 1, 1e-6);
        EXPECT_NEAR(rgb[2], 0.75, 1e-6);
        envbake_sample_mips(bundle, v, 1, rgb);
        EXPECT_NEAR(rgb[2], 3, 1e-6);
        envbake_lookup_brdf(bundle, 0.3f, 0.4f, ab);
        EXPECT_NEAR(ab[0], 0.5, 1e-6);
        EXPECT_NEAR(ab[1], 0.25, 1e-6);

        EXPECT_EQ(envbake_mesh_count(bundle), 2u);
        EXPECT_EQ(envbake_mesh_vertex_count(bundle, 1), 9u);
        EXPECT_EQ(envbake_mesh_vertex_count(bundle, 2), 0u);
        std::vector<float> exit(3 * 140 + 1, -1);
        EXPECT_EQ(envbake_diffuse(bundle, 0, 10, 140, exit.data(), nullptr), 0);
        for (std::size_t k = 0; k < 140; ++k) {
            for (std::size_t c = 0; c < 3; ++c) {
                EXPECT_NEAR(exit[3 * k + c], static_cast<double>((c + 1) * (k + 10)) / kVertices,
                            2e-6);
            }
        }
        EXPECT_EQ(exit.back(), -1);
        envbake_close(bundle);
    }
}

TEST(CApi, ErrorsNameTheirArray) {
    envbake_error error;
    std::memset(&error, 0x55, sizeof error);
    EXPECT_EQ(envbake_open_file("/nonexistent", &error), nullptr);
    EXPECT_EQ(error.code, static_cast<int>(format::Errc::CannotOpen));
    EXPECT_EQ(error.system_error, ENOENT);
    EXPECT_GT(std::strlen(error.message), 10u);
    EXPECT_LT(std::strlen(error.message), sizeof error.message);
    EXPECT_STREQ(error.array, "");
    EXPECT_EQ(envbake_open_memory(nullptr, 0, nullptr), nullptr);
    envbake_close(nullptr);

    BundleBuilder bad;
    bad.add("environment/sh", {2, 3}, std::vector<float>(6));
    EXPECT_EQ(envbake_open_file(bad.finish().c_str(), &error), nullptr);
    EXPECT_EQ(error.code, static_cast<int>(format::Errc::ArrayShape));
    EXPECT_STREQ(error.array, "environment/sh");
    EXPECT_GT(error.offset, 0u);

    BundleBuilder builder;
    fill(builder);
    envbake_bundle* bundle = envbake_open_file(builder.finish().c_str(), &error);
    ASSERT_NE(bundle, nullptr);
    float rgb[3] = {7, 7, 7};
    EXPECT_EQ(envbake_diffuse(bundle, 1, 0, 1, rgb, &error), 40);
    EXPECT_EQ(error.code, 40);
    EXPECT_EQ(envbake_diffuse(bundle, 9, 0, 1, rgb, nullptr), 40);
    EXPECT_EQ(envbake_diffuse(bundle, 0, 149, 2, rgb, &error), 44);
    EXPECT_EQ(envbake_diffuse(bundle, 0, static_cast<size_t>(-1), 2, rgb, &error), 44);
    EXPECT_EQ(envbake_diffuse(bundle, 0, 10, static_cast<size_t>(-5), rgb, &error), 44);
    EXPECT_EQ(rgb[0], 7);
    EXPECT_EQ(envbake_diffuse(bundle, 0, 150, 0, nullptr, &error), 0);
    envbake_close(bundle);
}

TEST(CApi, ArraysByName) {
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        BundleBuilder builder;
        fill(builder, codec);
        envbake_bundle* bundle = envbake_open_file(builder.finish().c_str(), nullptr);
        ASSERT_NE(bundle, nullptr);
        envbake_array array;
        envbake_error error;
        ASSERT_EQ(envbake_find_array(bundle, "mesh/0/diffuse", &array, &error), 0);
        EXPECT_EQ(array.type, ENVBAKE_F32);
        EXPECT_EQ(array.rank, 2);
        EXPECT_EQ(array.shape[0], kVertices);
        EXPECT_EQ(array.shape[1], 4u);
        EXPECT_EQ(array.shape[2], 0u);
        EXPECT_EQ(array.size, 16 * kVertices);
        std::vector<float> values(4 * kVertices);
        ASSERT_EQ(
            envbake_read_array(bundle, "mesh/0/diffuse", values.data(), 16 * kVertices, &error), 0);
        EXPECT_GT(values[4 * kVertices - 4], 0.27f);
        if (codec == Codec::None) {
            ASSERT_NE(array.data, nullptr);
            EXPECT_EQ(std::memcmp(array.data, values.data(), 16 * kVertices), 0);
        } else {
            EXPECT_EQ(array.data, nullptr);
        }
        EXPECT_EQ(envbake_read_array(bundle, "mesh/0/diffuse", values.data(), 8, &error), 44);
        EXPECT_EQ(envbake_find_array(bundle, "nothing", &array, &error), 40);
        EXPECT_STREQ(error.array, "nothing");
        EXPECT_EQ(envbake_read_array(bundle, "nothing", values.data(), 8, nullptr), 40);

        size_t size = 0;
        const char* text = envbake_metadata(bundle, &size);
        ASSERT_NE(text, nullptr);
        EXPECT_NE(std::string(text, size).find("\"vertex_count\": 150"), std::string::npos);
        envbake_close(bundle);
    }
}

}  // namespace
}  // namespace envbake
