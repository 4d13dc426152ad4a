// SPDX-License-Identifier: Apache-2.0
#include "envbake/runtime/bundle.h"

#include "envbake/runtime/shade.h"
#include "tests/unit/runtime/bundle_builder.h"

#include <gtest/gtest.h>

#include <filesystem>

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace envbake::runtime {
namespace {

using format::Codec;
using format::Errc;
using test::AlignedBytes;
using test::BundleBuilder;

constexpr const char* kMetadata = R"({
  "tool": {"name": "test"},
  "environment": {"mips": {"count": 5, "levels": [{"level": 1, "roughness": 0.25},
                                                  {"level": 2, "roughness": 0.5}]}},
  "brdf": {"ggx": {"axes": "linear"}},
  "meshes": [
    {"node": 4, "node_name": "tree", "mesh": 2, "mesh_name": "t", "primitive": 0, "vertex_count": 3},
    {"node": 4, "node_name": "tree", "mesh": 2, "mesh_name": "t", "primitive": 1, "vertex_count": 0},
    {"node": 7, "node_name": "lamp", "mesh": 0, "mesh_name": "l", "primitive": 0, "vertex_count": 2}]
})";

std::vector<float> ramp(std::size_t count, float scale = 1) {
    std::vector<float> values(count);
    for (std::size_t i = 0; i < count; ++i) values[i] = scale * static_cast<float>(i);
    return values;
}

std::vector<format::Half> half_ramp(std::size_t count) {
    std::vector<format::Half> values(count);
    for (std::size_t i = 0; i < count; ++i) values[i] = {float_to_half(static_cast<float>(i))};
    return values;
}

void fill(BundleBuilder& builder, Codec codec = Codec::None,
          const std::string& metadata = kMetadata) {
    builder.add("environment/sh", {25, 3}, ramp(75), codec)
        .add("environment/mips/1", {6, 2, 2, 3}, half_ramp(72), codec)
        .add("environment/mips/2", {6, 1, 1, 3}, ramp(18), codec)
        .add("brdf/ggx", {2, 3, 2}, ramp(12, 0.01f), codec)
        .add("mesh/0/diffuse", {3, 9}, ramp(27), codec)
        .add("mesh/2/diffuse", {2, 4, 3}, ramp(24), codec)
        .add("mesh/2/surprise", {2}, std::vector<std::uint16_t>{1, 2}, codec)
        .metadata(metadata);
}

void expect_content(const Bundle& bundle) {
    EXPECT_EQ(bundle.lighting().bands, 5);
    ASSERT_EQ(bundle.lighting().coeffs.size(), 75u);
    EXPECT_EQ(bundle.lighting().coeffs[74], 74);

    const MipsView& mips = bundle.mips();
    EXPECT_EQ(mips.level_count, 5);
    EXPECT_EQ(mips.first, 1);
    EXPECT_EQ(mips.last, 2);
    EXPECT_EQ(mips.levels[0].width, 0);
    EXPECT_EQ(mips.levels[1].width, 2);
    EXPECT_TRUE(mips.levels[1].texels.is_half);
    EXPECT_EQ(mips.levels[1].texels[71], 71);
    EXPECT_EQ(mips.levels[2].texels[17], 17);

    EXPECT_EQ(bundle.brdf().rows, 2);
    EXPECT_EQ(bundle.brdf().columns, 3);
    EXPECT_EQ(bundle.brdf().axes, TableAxes::LinearCentres);
    EXPECT_EQ(bundle.brdf().texels[11], 11 * 0.01f);

    ASSERT_EQ(bundle.meshes().size(), 3u);
    const Mesh& first = bundle.meshes()[0];
    EXPECT_EQ(first.node, 4u);
    EXPECT_EQ(first.mesh, 2u);
    EXPECT_EQ(first.vertex_count, 3u);
    EXPECT_EQ(first.diffuse.bands, 3);
    EXPECT_EQ(first.diffuse.channels, 1);
    EXPECT_EQ(first.diffuse.values[26], 26);
    EXPECT_EQ(bundle.meshes()[1].primitive, 1u);
    EXPECT_EQ(bundle.meshes()[1].diffuse.bands, 0);
    EXPECT_EQ(bundle.meshes()[2].diffuse.bands, 2);
    EXPECT_EQ(bundle.meshes()[2].diffuse.channels, 3);
    EXPECT_EQ(bundle.meshes()[2].diffuse.values[23], 23);
}

TEST(Bundle, ResolvesWhatItNeeds) {
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        BundleBuilder builder;
        fill(builder, codec);
        auto opened = Bundle::open(builder.finish().c_str());
        ASSERT_TRUE(opened) << to_string(opened.error());
        expect_content(*opened);
        // Views survive a move.
        const Bundle moved = *std::move(opened);
        expect_content(moved);

        const auto other = moved.array("mesh/2/surprise");
        if (codec == Codec::Zstd) {
            ASSERT_FALSE(other);
            EXPECT_EQ(other.error().code, Errc::ArrayCodec);
        } else {
            ASSERT_TRUE(other);
            EXPECT_EQ(static_cast<const std::uint16_t*>(other->data)[1], 2);
            EXPECT_EQ(other->info.shape[0], 2u);
        }
        EXPECT_EQ(moved.array("mesh/9/diffuse").error().code, Errc::ArrayMissing);
    }
}

TEST(Bundle, AbsentPartsAreEmptyAndShadeToZero) {
    BundleBuilder builder;
    builder.add("something/else", {1}, std::vector<float>{1});
    const auto bundle = Bundle::open(builder.finish().c_str());
    ASSERT_TRUE(bundle) << to_string(bundle.error());
    EXPECT_TRUE(bundle->meshes().empty());
    EXPECT_EQ(irradiance(bundle->lighting(), {0, 1, 0}), (Rgb{}));
    EXPECT_EQ(specular(*bundle, {0, 1, 0}, {0, 1, 0}, 0.5f, {1, 1, 1}), (Rgb{}));
    EXPECT_EQ(lookup_brdf(bundle->brdf(), 0.5f, 0.5f).a, 0);
    std::vector<Rgb> out(2, Rgb{1, 1, 1});
    diffuse_exit(TransportView{}, bundle->lighting(), 0, out);
    EXPECT_EQ(out[1], (Rgb{}));
}

TEST(Bundle, AGreyEnvironmentHasOneChannel) {
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        BundleBuilder builder;
        builder.add("environment/sh", {9, 1}, ramp(9), codec)
            .add("environment/mips/1", {6, 2, 2, 1}, half_ramp(24), codec)
            .add("environment/mips/2", {6, 1, 1, 1}, ramp(6), codec)
            .metadata(kMetadata);
        const auto bundle = Bundle::open(builder.finish().c_str());
        ASSERT_TRUE(bundle) << to_string(bundle.error());
        EXPECT_EQ(bundle->lighting().bands, 3);
        ASSERT_EQ(bundle->lighting().coeffs.size(), 27u);
        EXPECT_EQ(bundle->lighting().coeffs[26], 8);
        EXPECT_EQ(bundle->lighting().coeffs[5], 1);
        EXPECT_EQ(bundle->mips().levels[1].channels, 1);
        EXPECT_EQ(sample_mips(bundle->mips(), {1, 0, 0}, 0.5f), (Rgb{0, 0, 0}));
        EXPECT_EQ(sample_mips(bundle->mips(), {0, 1, 0}, 0.5f), (Rgb{2, 2, 2}));
    }
}

TEST(Bundle, LightsAreRowsOfNine) {
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        BundleBuilder builder;
        const bool extracted = codec == Codec::None;
        builder.add("environment/lights", {2, 9}, ramp(18), codec)
            .metadata(extracted ? R"({"environment": {"lights": {"extracted": true}}})"
                                : R"({"environment": {"lights": {"extracted": false}}})");
        const auto bundle = Bundle::open(builder.finish().c_str());
        ASSERT_TRUE(bundle) << to_string(bundle.error());
        ASSERT_EQ(bundle->lights().size(), 2u);
        const DominantLight& second = bundle->lights()[1];
        EXPECT_EQ(second.direction, (Vec3{9, 10, 11}));
        EXPECT_EQ(second.irradiance, (Rgb{12, 13, 14}));
        EXPECT_EQ(second.angular_radius, 15);
        EXPECT_EQ(second.solid_angle, 16);
        EXPECT_EQ(second.share, 17);
        EXPECT_EQ(bundle->lights_extracted(), extracted);
    }
    BundleBuilder none;
    none.add("environment/sh", {1, 3}, ramp(3));
    EXPECT_TRUE(Bundle::open(none.finish().c_str())->lights().empty());
}

TEST(Bundle, LatLongMipsAreKnownByTheirShape) {
    BundleBuilder builder;
    builder.add("environment/mips/1", {4, 8, 3}, ramp(96))
        .add("environment/mips/2", {2, 4, 3}, ramp(24))
        .metadata(kMetadata);
    const auto bundle = Bundle::open(builder.finish().c_str());
    ASSERT_TRUE(bundle) << to_string(bundle.error());
    EXPECT_EQ(bundle->mips().layout, MipLayout::LatLong);
    EXPECT_EQ(bundle->mips().levels[1].width, 8);
    EXPECT_EQ(bundle->mips().levels[2].height, 2);
}

constexpr const char* kBeckmannMetadata = R"({
  "environment": {"mips": {"count": 3, "levels": [{"level": 0, "roughness": 0},
                                                  {"level": 1, "roughness": 0.5}]},
                  "mips_beckmann": {"count": 3, "levels": [{"level": 1, "roughness": 0.5}]}},
  "brdf": {"ggx": {"axes":"roots"}, "beckmann": {"axes":"roots"}}})";

TEST(Bundle, BeckmannStandsBesideGgxAndSharesItsMirror) {
    BundleBuilder builder;
    builder.add("environment/mips/0", {6, 2, 2, 3}, ramp(72))
        .add("environment/mips/1", {6, 1, 1, 3}, ramp(18))
        .add("environment/mips_beckmann/1", {6, 1, 1, 3}, ramp(18, 2))
        .add("brdf/ggx", {2, 2, 2}, ramp(8, 0.01f))
        .add("brdf/beckmann", {2, 2, 2}, ramp(8, 0.02f))
        .add("brdf/beckmann_average_albedo", {2}, std::vector<float>{1, 0.5f})
        .metadata(kBeckmannMetadata);
    const auto bundle = Bundle::open(builder.finish().c_str());
    ASSERT_TRUE(bundle) << to_string(bundle.error());
    EXPECT_EQ(bundle->distribution(), Distribution::Ggx);
    const MipsView& beckmann = bundle->mips(Distribution::Beckmann);
    EXPECT_EQ(beckmann.first, 0);
    EXPECT_EQ(beckmann.levels[0].texels[71], 71);
    EXPECT_EQ(beckmann.levels[1].texels[17], 34);
    EXPECT_EQ(bundle->mips().levels[1].texels[17], 17);
    EXPECT_EQ(bundle->brdf(Distribution::Beckmann).texels[7], 7 * 0.02f);
    EXPECT_EQ(lookup_average_albedo(bundle->brdf(Distribution::Beckmann), 0.25f), 0.75f);
    EXPECT_EQ(lookup_average_albedo(bundle->brdf(), 0.25f), 0);
    const Vec3 up{0, 1, 0};
    EXPECT_NE(specular(*bundle, Distribution::Beckmann, up, up, 0.5f, {1, 1, 1}),
              specular(*bundle, up, up, 0.5f, {1, 1, 1}));
}

TEST(Bundle, BeckmannAloneIsWhatTheBundleIsFor) {
    BundleBuilder builder;
    builder.add("environment/mips_beckmann/1", {6, 1, 1, 3}, ramp(18, 2))
        .add("brdf/beckmann", {2, 2, 2}, ramp(8, 0.02f))
        .metadata(kBeckmannMetadata);
    const auto bundle = Bundle::open(builder.finish().c_str());
    ASSERT_TRUE(bundle) << to_string(bundle.error());
    EXPECT_EQ(bundle->distribution(), Distribution::Beckmann);
    EXPECT_EQ(bundle->mips().first, 1);
    const Vec3 up{0, 1, 0};
    EXPECT_NE(specular(*bundle, up, up, 0.5f, {1, 1, 1}), (Rgb{}));
}

struct Fault {
    const char* what;
    std::function<void(BundleBuilder&)> build;
    Errc code;
};

void PrintTo(const Fault& fault, std::ostream* out) {
    *out << fault.what;
}

std::string with(const std::string& from, const std::string& to) {
    std::string text = kMetadata;
    return text.replace(text.find(from), from.size(), to);
}

class BadBundle : public testing::TestWithParam<Fault> {};

TEST_P(BadBundle, IsRefusedByItsCode) {
    for (const bool in_memory : {false, true}) {
        BundleBuilder builder;
        GetParam().build(builder);
        const AlignedBytes bytes = builder.finish_in_memory();
        const auto bundle = in_memory ? Bundle::open(std::as_const(bytes).bytes())
                                      : Bundle::open(builder.finish().c_str());
        ASSERT_FALSE(bundle);
        EXPECT_EQ(bundle.error().code, GetParam().code) << to_string(bundle.error());
    }
}

const Fault kFaults[] = {
    {"sh of 7 coefficients",
     [](BundleBuilder& b) {
         b.add("environment/sh", {7, 3}, ramp(21));
     },
     Errc::ArrayShape},
    {"sh of 11 bands",
     [](BundleBuilder& b) {
         b.add("environment/sh", {121, 3}, ramp(363));
     },
     Errc::ArrayShape},
    {"sh of 4 channels",
     [](BundleBuilder& b) {
         b.add("environment/sh", {9, 4}, ramp(36));
     },
     Errc::ArrayShape},
    {"flat sh", [](BundleBuilder& b) { b.add("environment/sh", {9}, ramp(9)); }, Errc::ArrayShape},
    {"sh in f16",
     [](BundleBuilder& b) {
         b.add("environment/sh", {9, 3}, half_ramp(27));
     },
     Errc::ArrayType},
    {"sh in u32",
     [](BundleBuilder& b) {
         b.add("environment/sh", {1, 3}, std::vector<std::uint32_t>{1, 2, 3});
     },
     Errc::ArrayType},
    {"lights of eight numbers",
     [](BundleBuilder& b) {
         b.add("environment/lights", {1, 8}, ramp(8));
     },
     Errc::ArrayShape},
    {"lights in f16",
     [](BundleBuilder& b) {
         b.add("environment/lights", {1, 9}, half_ramp(9));
     },
     Errc::ArrayType},
    {"five faces",
     [](BundleBuilder& b) {
         b.add("environment/mips/0", {5, 1, 1, 3}, ramp(15)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"oblong faces",
     [](BundleBuilder& b) {
         b.add("environment/mips/0", {6, 2, 1, 3}, ramp(36)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"faces without texels",
     [](BundleBuilder& b) {
         b.add("environment/mips/0", {6, 0, 0, 3}, ramp(0)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"mips in u8",
     [](BundleBuilder& b) {
         b.add("environment/mips/0", {6, 1, 1, 3}, std::vector<std::uint8_t>(18))
             .metadata(kMetadata);
     },
     Errc::ArrayType},
    {"a missing mip",
     [](BundleBuilder& b) {
         b.add("environment/mips/0", {6, 1, 1, 3}, ramp(18));
         b.add("environment/mips/2", {6, 1, 1, 3}, ramp(18)).metadata(kMetadata);
     },
     Errc::ArrayMissing},
    {"mips without metadata",
     [](BundleBuilder& b) {
         b.add("environment/mips/0", {6, 1, 1, 3}, ramp(18));
     },
     Errc::Metadata},
    {"more mips than the metadata counts",
     [](BundleBuilder& b) {
         b.add("environment/mips/5", {6, 1, 1, 3}, ramp(18)).metadata(kMetadata);
     },
     Errc::Metadata},
    {"another roughness", [](BundleBuilder& b) { fill(b, Codec::None, with("0.25", "0.35")); },
     Errc::Metadata},
    {"too many levels",
     [](BundleBuilder& b) {
         b.add("environment/mips/1", {6, 1, 1, 3}, ramp(18))
             .metadata(R"({"environment": {"mips": {"count": 17,
                           "levels": [{"level": 1, "roughness": 0.0625}]}}})");
     },
     Errc::Metadata},
    {"a lat-long image that is not twice as wide as high",
     [](BundleBuilder& b) {
         b.add("environment/mips/1", {4, 6, 3}, ramp(72)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"mips of two layouts",
     [](BundleBuilder& b) {
         b.add("environment/mips/1", {6, 2, 2, 3}, ramp(72))
             .add("environment/mips/2", {2, 4, 3}, ramp(24))
             .metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"mips of two channels",
     [](BundleBuilder& b) {
         b.add("environment/mips/1", {6, 1, 1, 2}, ramp(12)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"an average albedo of another table",
     [](BundleBuilder& b) {
         b.add("brdf/ggx", {2, 2, 2}, ramp(8))
             .add("brdf/ggx_average_albedo", {3}, ramp(3))
             .metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"Beckmann without its axes",
     [](BundleBuilder& b) {
         b.add("brdf/beckmann", {2, 2, 2}, ramp(8)).metadata(kMetadata);
     },
     Errc::Metadata},
    {"unknown axes", [](BundleBuilder& b) { fill(b, Codec::None, with("linear", "cubic")); },
     Errc::Metadata},
    {"a table of one row",
     [](BundleBuilder& b) {
         b.add("brdf/ggx", {1, 3, 2}, ramp(6)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"a table of three channels",
     [](BundleBuilder& b) {
         b.add("brdf/ggx", {2, 2, 3}, ramp(12)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"a mesh without vertex count",
     [](BundleBuilder& b) { fill(b, Codec::None, with("\"vertex_count\": 3", "\"v\": 3")); },
     Errc::Metadata},
    {"another vertex count",
     [](BundleBuilder& b) {
         fill(b, Codec::None, with("\"vertex_count\": 3", "\"vertex_count\": 4"));
     },
     Errc::ArrayShape},
    {"a negative node", [](BundleBuilder& b) { fill(b, Codec::None, with(": 7", ": -7")); },
     Errc::Metadata},
    {"meshes that are no list",
     [](BundleBuilder& b) { fill(b, Codec::None, with("[\n    {\"node\": 4", "{\"x\": 4")); },
     Errc::Metadata},
    {"a mesh of half a band",
     [](BundleBuilder& b) {
         b.add("mesh/0/diffuse", {3, 5}, ramp(15)).metadata(kMetadata);
     },
     Errc::ArrayShape},
    {"a part of a bake",
     [](BundleBuilder& b) {
         fill(b);
         b.add("shard", {2}, std::vector<std::uint32_t>{2, 3});
     },
     Errc::Shard},
    {"two channels",
     [](BundleBuilder& b) {
         b.add("mesh/0/diffuse", {3, 4, 2}, ramp(24)).metadata(kMetadata);
     },
     Errc::ArrayShape},
};
INSTANTIATE_TEST_SUITE_P(Faults, BadBundle, testing::ValuesIn(kFaults));

TEST(Bundle, MissingFileAndNoBundle) {
    const auto missing = Bundle::open("/nonexistent/x.envb");
    ASSERT_FALSE(missing);
    EXPECT_EQ(missing.error().code, Errc::CannotOpen);
    EXPECT_NE(missing.error().system_error, 0);
    const AlignedBytes zeros(std::vector<std::byte>(256));
    EXPECT_EQ(Bundle::open(zeros.bytes()).error().code, Errc::BadMagic);
    EXPECT_EQ(Bundle::open(std::span<const std::byte>()).error().code, Errc::TooShort);
}

TEST(Bundle, EveryTruncationIsAnError) {
    BundleBuilder builder;
    fill(builder);
    const AlignedBytes whole = builder.finish_in_memory();
    for (std::size_t size = 0; size < whole.bytes().size(); ++size) {
        const AlignedBytes cut(whole.bytes().first(size));
        ASSERT_FALSE(Bundle::open(std::as_const(cut).bytes())) << size;
    }
}

void use_everything(const Bundle& bundle) {
    float sum = irradiance(bundle.lighting(), {0, 0, 1})[0];
    for (const float r : {0.0f, 0.3f, 1.0f}) {
        sum += specular(bundle, {0, 1, 0}, {0.6f, 0.8f, 0}, r, {0.5f, 0.5f, 0.5f})[1];
    }
    std::vector<Rgb> out(4);
    for (const Mesh& mesh : bundle.meshes()) {
        diffuse_exit(mesh.diffuse, bundle.lighting(), 0, out);
        sum += out[0][0] + out[3][2];
    }
    volatile float sink = sum;
    (void)sink;
}

// The contents of arrays are not covered by the checksums that open() verifies: the metadata of a
// hostile file may say anything.
TEST(Bundle, DamagedContentsNeverCrash) {
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        BundleBuilder builder;
        fill(builder, codec);
        const AlignedBytes good = builder.finish_in_memory();
        const auto reader = format::Reader::open(good.bytes());
        ASSERT_TRUE(reader);
        std::uint32_t state = 7;
        int opened = 0, refused = 0;
        for (int round = 0; round < 3000; ++round) {
            AlignedBytes bad(good.bytes());
            for (int change = 0; change <= round % 3; ++change) {
                state = state * 1664525 + 1013904223;
                const auto array = reader->array((state >> 8) % reader->array_count());
                state = state * 1664525 + 1013904223;
                const std::size_t at = (state >> 8) % static_cast<std::size_t>(array.stored_size);
                bad.bytes()[static_cast<std::size_t>(array.offset) + at] =
                    static_cast<std::byte>(state >> 24);
            }
            const auto bundle = Bundle::open(std::as_const(bad).bytes());
            bundle ? ++opened : ++refused;
            if (bundle) use_everything(*bundle);
        }
        EXPECT_GT(opened, 100);
        EXPECT_GT(refused, 100);
    }
}

/// 16 texels a face; two vertices, coefficient 5 of them is 3 and -1 units of 1/2.
struct Wavelets {
    std::string basis = R"({"face_size":16,"step":0.5})";
    std::vector<std::uint32_t> index{5, 9};
    std::vector<float> value{2, 7};
    std::uint64_t channels = 1;
    std::uint64_t weight_count = 1536;
    std::vector<std::uint32_t> blocks{1, 5, 0, 2, 0xff030100};
    std::vector<std::uint32_t> offsets{0, 5};

    AlignedBytes bundle() const {
        BundleBuilder builder;
        builder.add("environment/wavelet/index", {index.size()}, index)
            .add("environment/wavelet/value", {value.size() / channels, channels}, value)
            .add("wavelet/weight", {weight_count}, std::vector<float>(weight_count, 1))
            .add("mesh/0/wavelet/blocks", {blocks.size()}, blocks)
            .add("mesh/0/wavelet/offsets", {offsets.size()}, offsets)
            .metadata("{\"wavelet\":" + basis +
                      ",\"meshes\":[{\"node\":0,\"mesh\":0,\"primitive\":0,\"vertex_count\":2}]}");
        return builder.finish_in_memory();
    }
    Errc refused() const {
        const AlignedBytes bytes = bundle();
        const auto opened = Bundle::open(bytes.bytes());
        return opened ? Errc::None : opened.error().code;
    }
};

TEST(BundleWavelets, AreOpenedAndShadedFrom) {
    const AlignedBytes bytes = Wavelets().bundle();
    const auto bundle = Bundle::open(bytes.bytes());
    ASSERT_TRUE(bundle) << format::to_string(bundle.error());
    const WaveletLightingView& lighting = bundle->wavelet_lighting();
    EXPECT_EQ(lighting.face_size, 16);
    EXPECT_EQ(lighting.weights.size(), 1536u);
    ASSERT_EQ(lighting.terms.size(), 2u);
    EXPECT_EQ(lighting.terms[1].index, 9u);
    EXPECT_EQ(lighting.terms[1].value, (Rgb{7, 7, 7})) << "grey is stored once";
    std::vector<Rgb> out(3, {NAN, NAN, NAN});
    diffuse_exit(bundle->meshes()[0].wavelet, lighting.terms, 0, out);
    EXPECT_EQ(out, (std::vector<Rgb>{{3, 3, 3}, {-1, -1, -1}, {0, 0, 0}}));

    Wavelets coloured;
    coloured.channels = 3;
    coloured.value = {1, 2, 3, 4, 5, 6};
    const AlignedBytes more = coloured.bundle();
    const auto other = Bundle::open(more.bytes());
    ASSERT_TRUE(other);
    EXPECT_EQ(other->wavelet_lighting().terms[0].value, (Rgb{1, 2, 3}));
}

TEST(BundleWavelets, AreRefusedWhereTheyDoNotFit) {
    const auto refused = [](auto change) {
        Wavelets w;
        change(w);
        return w.refused();
    };
    EXPECT_EQ(Wavelets().refused(), Errc::None);
    EXPECT_EQ(refused([](Wavelets& w) { w.basis = R"({"face_size":17,"step":0.5})"; }),
              Errc::Metadata);
    EXPECT_EQ(refused([](Wavelets& w) { w.basis = R"({"face_size":16})"; }), Errc::Metadata);
    EXPECT_EQ(refused([](Wavelets& w) { w.basis = R"({"face_size":16,"step":-1})"; }),
              Errc::Metadata);
    EXPECT_EQ(refused([](Wavelets& w) { w.index[1] = 1536; }), Errc::ArrayShape);
    EXPECT_EQ(refused([](Wavelets& w) { w.value = {1}; }), Errc::ArrayShape);
    EXPECT_EQ(refused([](Wavelets& w) { w.channels = 2; }), Errc::ArrayShape);
    EXPECT_EQ(refused([](Wavelets& w) { w.weight_count = 6; }), Errc::ArrayShape);
    EXPECT_EQ(refused([](Wavelets& w) { w.offsets = {0, 5, 5}; }), Errc::ArrayShape);
}

/// Glossy transport of three vertices in three bands, and what surfaces send by direction.
struct Reflected {
    std::vector<std::uint64_t> shape{3, 8, 9, 3};
    Codec codec = Codec::None;
    bool with_glossy = true, with_reflected = true, as_f32 = false, as_u16 = false;

    AlignedBytes bundle() const {
        std::uint64_t count = 1;
        for (const std::uint64_t axis : shape) count *= axis;
        BundleBuilder builder;
        if (with_glossy)
            builder.add("mesh/0/glossy", {3, 81}, ramp(3 * 81))
                .add("mesh/0/normal", {3, 3}, std::vector<float>{1, 0, 0, 0, 1, 0, 0, 0, 1});
        if (as_u16)
            builder.add("mesh/0/reflected", shape, std::vector<std::uint16_t>(count), codec);
        else if (as_f32)
            builder.add("mesh/0/reflected", shape, ramp(count), codec);
        else if (with_reflected)
            builder.add("mesh/0/reflected", shape, half_ramp(count), codec);
        builder.metadata(R"({"meshes":[{"node":0,"mesh":0,"primitive":0,"vertex_count":3}]})");
        return builder.finish_in_memory();
    }
    Errc refused() const {
        const AlignedBytes bytes = bundle();
        const auto opened = Bundle::open(bytes.bytes());
        return opened ? Errc::None : opened.error().code;
    }
};

TEST(BundleReflected, IsOpenedInEveryShape) {
    struct Case {
        std::vector<std::uint64_t> shape;
        int bands, channels;
    };
    for (const Case& c :
         {Case{{3, 3, 9}, 2, 1}, {{3, 3, 9, 3}, 2, 3}, {{3, 8, 9}, 3, 1}, {{3, 8, 9, 3}, 3, 3}})
        for (const Codec codec : {Codec::None, Codec::Zstd}) {
            const AlignedBytes bytes = Reflected{.shape = c.shape, .codec = codec}.bundle();
            const auto bundle = Bundle::open(bytes.bytes());
            ASSERT_TRUE(bundle) << to_string(bundle.error());
            const GlossyView& glossy = bundle->meshes()[0].glossy;
            EXPECT_EQ(glossy.light_bands, 3);
            EXPECT_EQ(glossy.reflected_bands, c.bands);
            EXPECT_EQ(glossy.reflected_channels, c.channels);
            const std::uint64_t count = 3 * c.shape[1] * 9 * static_cast<std::uint64_t>(c.channels);
            ASSERT_EQ(glossy.reflected.count, count);
            EXPECT_TRUE(glossy.reflected.is_half);
            EXPECT_EQ(glossy.reflected[count - 1], static_cast<float>(count - 1));
        }
    const AlignedBytes f32 = Reflected{.as_f32 = true}.bundle();
    const auto bundle = Bundle::open(f32.bytes());
    ASSERT_TRUE(bundle) << "who reads may take more than who writes gives";
    EXPECT_EQ(bundle->meshes()[0].glossy.reflected[1], 1);
}

TEST(BundleReflected, AbsentAndAloneItIsNothing) {
    for (const bool with_glossy : {true, false}) {
        const Reflected content{.with_glossy = with_glossy, .with_reflected = !with_glossy};
        const AlignedBytes bytes = content.bundle();
        const auto bundle = Bundle::open(bytes.bytes());
        ASSERT_TRUE(bundle) << to_string(bundle.error());
        const GlossyView& glossy = bundle->meshes()[0].glossy;
        EXPECT_EQ(glossy.light_bands, with_glossy ? 3 : 0);
        EXPECT_EQ(glossy.reflected_bands, 1);
        EXPECT_EQ(glossy.reflected_channels, 1);
        EXPECT_EQ(glossy.reflected.count, 0u);
    }
}

TEST(BundleReflected, IsRefusedWhereItDoesNotFit) {
    using Shape = std::vector<std::uint64_t>;
    EXPECT_EQ(Reflected().refused(), Errc::None);
    for (const Shape& shape : {
             Shape{3 * 8 * 9},  // of another rank
             {3, 72},
             {3, 8, 9, 3, 1},
             {2, 8, 9},  // of other vertices
             {4, 8, 9, 3},
             {3, 0, 9},  // of one band, of no whole number of them, of more than the lighting has
             {3, 7, 9},
             {3, 9, 9},
             {3, 15, 9},
             {3, 24, 9, 3},
             {3, 8, 4},  // of other lighting
             {3, 8, 10},
             {3, 8, 16},
             {3, 8, 9, 1},  // of other channels
             {3, 8, 9, 2},
             {3, 8, 9, 4},
         })
        EXPECT_EQ(Reflected{.shape = shape}.refused(), Errc::ArrayShape)
            << testing::PrintToString(shape);
    EXPECT_EQ(Reflected{.as_u16 = true}.refused(), Errc::ArrayType);
}

// The seeds of the fuzzer: between them they have every array and encoding.
TEST(Bundle, OpensWhatBakesHaveWritten) {
    bool clustered = false, quantised = false, glossy = false, wavelet = false, reflected = false;
    for (const auto& file : std::filesystem::directory_iterator(ENVBAKE_BUNDLES)) {
        const auto bundle = Bundle::open(file.path().c_str());
        ASSERT_TRUE(bundle) << file.path() << ": " << format::to_string(bundle.error());
        for (const Mesh& mesh : bundle->meshes()) {
            clustered |= mesh.diffuse.encoding == TransportEncoding::Clustered;
            quantised |= mesh.diffuse.encoding == TransportEncoding::Unorm16;
            glossy |= mesh.glossy.light_bands > 0 && bundle->glossy_lobe().rows > 0;
            reflected |= mesh.glossy.reflected_bands > 1;
            wavelet |= mesh.wavelet.face_size > 0;
        }
    }
    EXPECT_TRUE(clustered && quantised && glossy && reflected && wavelet);
}

}  // namespace
}  // namespace envbake::runtime
