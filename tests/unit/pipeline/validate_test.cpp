// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/validate.h"
#include "baker/core/text.h"
#include "tests/support/bundle_bytes.h"

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
#include <iterator>
#include <map>
#include <regex>
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
        std::vector<std::byte> file = load();
        std::size_t table = 0, entry = 0;
        {
            const auto reader = format::Reader::open(path_.c_str());
            ASSERT_TRUE(reader);
            table = reader->table_offset();
            while (reader->array(entry).name != "other") ++entry;
        }
        const std::size_t at = table + entry * format::kEntrySize;
        file[at + 7] = std::byte{1};     // codec
        test::put(file, at + 16, size);  // shape
        test::put(file, at + 80, size);
        test::seal(file, table);
        store(file);
    }

    std::vector<std::byte> load() const {
        std::vector<std::byte> file(std::filesystem::file_size(path_));
        std::ifstream(path_, std::ios::binary)
            .read(reinterpret_cast<char*>(file.data()), static_cast<std::streamsize>(file.size()));
        return file;
    }
    void store(const std::vector<std::byte>& file) const {
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

using test::put;
using test::seal;
using test::seal_header;

std::size_t table_of(const std::vector<std::byte>& file) {
    return static_cast<std::size_t>(test::get<std::uint64_t>(file, 24));
}

/// The rows `| code | name | must |` of docs/format.md.
std::map<int, std::string> documented_rules() {
    std::map<int, std::string> rules;
    std::ifstream document(ENVBAKE_FORMAT_DOCUMENT);
    const std::regex row(R"(\| (\d+) \| ([A-Z]\w+) \| .*must.* \|)");
    std::smatch match;
    for (std::string line; std::getline(document, line);)
        if (std::regex_match(line, match, row)) {
            EXPECT_TRUE(rules.emplace(std::stoi(match[1]), match[2]).second) << line;
        }
    return rules;
}

void add_zeros(Writer& w, const std::string& name, std::vector<std::uint64_t> shape) {
    std::uint64_t count = 1;
    for (const std::uint64_t axis : shape) count *= axis;
    EXPECT_TRUE(w.add<std::uint32_t>(name, std::move(shape), std::vector<std::uint32_t>(count, 0)));
}

/// Wavelets of 16 texels a face for the two vertices of mesh/0; coefficient 5 is 3 and -1 units.
struct Wavelets {
    std::string basis = R"("face_size":16,"step":0.01)";
    std::vector<std::uint32_t> index{5, 7};
    std::vector<float> value{2, 1, 1, 1, 1, 1};
    std::vector<std::uint64_t> value_shape{2, 3};
    std::uint64_t weight_count = 1536;
    bool whole_weights = false;
    std::vector<std::uint32_t> blocks{1, 5, 0, 2, 0xff030100};
    std::vector<std::uint32_t> offsets{0, 5};
    std::vector<std::uint32_t> vertex{0, 0};
    format::Codec codec = format::Codec::None;
    std::string without;

    void add_to(Writer& w) const {
        const auto u32 = [&](const char* name, const std::vector<std::uint32_t>& values,
                             format::Codec c = format::Codec::None) {
            if (name == without) return;
            EXPECT_TRUE(w.add<std::uint32_t>(name, {values.size()}, values, c));
        };
        u32("environment/wavelet/index", index);
        if (without != "environment/wavelet/value") {
            EXPECT_TRUE(w.add<float>("environment/wavelet/value", value_shape, value));
        }
        if (whole_weights)
            add_zeros(w, "wavelet/weight", {weight_count});
        else
            add_ones(w, "wavelet/weight", {weight_count});
        u32("mesh/0/wavelet/blocks", blocks, codec);
        u32("mesh/0/wavelet/offsets", offsets);
        EXPECT_TRUE(w.add<std::uint32_t>("selftest/wavelet/vertex", {1, 2}, vertex));
        EXPECT_TRUE(w.add<float>("selftest/wavelet/value", {1, 3},
                                 std::vector<float>{0.06f, 0.03f, 0.03f}));
    }
    static void add_ones(Writer& w, const std::string& name, std::vector<std::uint64_t> shape) {
        EXPECT_TRUE(w.add<float>(name, shape, std::vector<float>(shape[0], 1.0f)));
    }
};

template <class T>
void add_all(Writer& w, const std::string& name, std::vector<std::uint64_t> shape, T value) {
    std::uint64_t count = 1;
    for (const std::uint64_t axis : shape) count *= axis;
    EXPECT_TRUE(w.add<T>(name, std::move(shape), std::vector<T>(count, value)));
}

/// Transport of 2 vertices of mesh 1 by 3 clusters with one weight each; what is spoiled differs.
struct Clustered {
    std::vector<std::uint64_t> basis{3, 2, 4}, weights{2, 1}, cluster{2};
    std::uint8_t number = 2;
    bool with_basis = true, with_weights = true, with_cluster = true, with_rows = false;

    void operator()(Writer& w) const {
        if (with_basis) add_all<float>(w, "mesh/diffuse_basis", basis, 0.25f);
        if (with_weights) add_all<std::uint8_t>(w, "mesh/1/diffuse_weights", weights, 1);
        if (with_cluster) add_all<std::uint8_t>(w, "mesh/1/diffuse_cluster", cluster, number);
        if (with_rows) add_all<float>(w, "mesh/1/diffuse", {2, 4}, 0.5f);
    }
};

// One fault or more for every rule; each gives its code and no other. The good bundle that all of
// them start from gives none.
TEST_F(Validate, EveryRuleOfTheDocumentHasAFileThatBreaksIt) {
    using Fault = std::function<void(Content&)>;
    const auto also = [](std::function<void(Writer&)> add) -> Fault {
        return [add](Content& c) { c.also = add; };
    };
    const auto add_lobe = [](Writer& w, std::vector<std::uint64_t> unoccluded,
                             std::vector<std::uint64_t> kernel) {
        add_ones(w, "brdf/ggx_lobe/unoccluded", std::move(unoccluded));
        add_ones(w, "brdf/ggx_lobe/kernel", std::move(kernel));
    };
    const auto lobe = [&](const char* facts, std::vector<std::uint64_t> unoccluded,
                          std::vector<std::uint64_t> kernel) -> Fault {
        return [=](Content& c) {
            c.replace("\"ggx\":", concat("\"ggx_lobe\":", facts, ",\"ggx\":"));
            c.also = [=](Writer& w) { add_lobe(w, unoccluded, kernel); };
        };
    };
    // With glossy transport of so many lighting bands, 0: without.
    const auto add_reflected = [](Writer& w, int mesh, std::vector<std::uint64_t> shape,
                                  std::uint64_t light_bands) {
        const std::string prefix = concat("mesh/", mesh);
        add_all(w, prefix + "/reflected", std::move(shape), format::Half{0x3c00});
        if (light_bands == 0) return;
        add_ones(w, prefix + "/glossy", {2, (light_bands + 6) * (light_bands + 6)});
        add_all(w, prefix + "/normal", {2, 3}, 0.0f);
    };
    const auto reflected = [&](std::vector<std::uint64_t> shape, std::uint64_t light_bands = 2) {
        return also([=](Writer& w) { add_reflected(w, 0, shape, light_bands); });
    };
    const auto text = [](const char* from, const char* to) -> Fault {
        return [from, to](Content& c) { c.replace(from, to); };
    };
    const auto wavelets = [](std::function<void(Wavelets&)> change) -> Fault {
        return [change](Content& c) {
            Wavelets w;
            change(w);
            c.replace("\"self_test\"", "\"wavelet\":{" + w.basis + "},\"self_test\"");
            c.also = [w](Writer& writer) { w.add_to(writer); };
        };
    };
    Content good;
    wavelets([](Wavelets&) {})(good);
    EXPECT_EQ(codes(good), Codes{});
    const auto second_mesh = [](std::function<void(Writer&)> add) -> Fault {
        return [add](Content& c) {
            c.replace("\"vertex_count\":2}]", R"("vertex_count":2},
                      {"node":1,"mesh":1,"primitive":0,"vertex_count":2}])");
            c.also = add;
        };
    };
    const auto clustered = [&](auto spoil) {
        Clustered arrays;
        spoil(arrays);
        return second_mesh(arrays);
    };
    const auto shard = [&](std::vector<std::uint32_t> part) {
        return also(
            [part](Writer& w) { EXPECT_TRUE(w.add<std::uint32_t>("shard", {part.size()}, part)); });
    };
    Content part_of_a_bake;
    shard({2, 3})(part_of_a_bake);
    EXPECT_EQ(codes(part_of_a_bake), Codes{});
    const std::vector<std::pair<int, Fault>> contents{
        {230, shard({0, 3})},
        {230, shard({4, 3})},
        {230, shard({1, 2, 3})},
        {230, also([](Writer& w) { add_ones(w, "shard", {2}); })},
        {220, second_mesh([](Writer& w) {
             add_all<std::uint8_t>(w, "mesh/1/diffuse", {2, 4}, 1);
         })},
        {220, also([](Writer& w) {
             add_ones(w, "mesh/0/diffuse_range", {4, 2});
         })},
        {221, second_mesh([](Writer& w) {
             add_all<std::uint8_t>(w, "mesh/1/diffuse", {2, 4}, 1);
             add_zeros(w, "mesh/1/diffuse_range", {4, 2});
         })},
        {222, second_mesh([](Writer& w) {
             add_all<std::uint16_t>(w, "mesh/1/diffuse", {2, 4}, 1);
             add_ones(w, "mesh/1/diffuse_range", {4, 3});
         })},
        {222, second_mesh([](Writer& w) {
             add_all<std::uint16_t>(w, "mesh/1/diffuse", {2, 4}, 1);
             add_ones(w, "mesh/1/diffuse_range", {4, 3, 2});
         })},
        {222, second_mesh([](Writer& w) {
             add_all<std::uint16_t>(w, "mesh/1/diffuse", {2, 4}, 1);
             add_ones(w, "mesh/1/diffuse_range", {9, 2});
         })},
        {223, clustered([](Clustered& c) { c.with_basis = false; })},
        {223, clustered([](Clustered& c) { c.with_cluster = false; })},
        {223, clustered([](Clustered& c) { c.with_weights = false; })},
        {223, clustered([](Clustered& c) { c.with_rows = true; })},
        {224, second_mesh([](Writer& w) {
             Clustered{.with_weights = false}(w);
             add_ones(w, "mesh/1/diffuse_weights", {2, 1});
         })},
        {224, second_mesh([](Writer& w) {
             Clustered{.with_cluster = false}(w);
             add_ones(w, "mesh/1/diffuse_cluster", {2});
         })},
        {224, second_mesh([](Writer& w) {
             Clustered{.with_basis = false}(w);
             add_zeros(w, "mesh/diffuse_basis", {3, 2, 4});
         })},
        {225, clustered([](Clustered& c) {
             c.weights = {2, 2};
         })},
        {225, clustered([](Clustered& c) { c.weights = {2}; })},
        {225, clustered([](Clustered& c) {
             c.cluster = {2, 1};
         })},
        {225, clustered([](Clustered& c) {
             c.basis = {3, 2, 5};
         })},
        {225, clustered([](Clustered& c) {
             c.basis = {3, 1, 4};
         })},
        {225, clustered([](Clustered& c) {
             c.basis = {65537, 2, 1};
         })},
        {142, clustered([](Clustered& c) { c.cluster = {3}; })},
        {226, clustered([](Clustered& c) { c.number = 3; })},
        {34, [](Content& c) { c.with_metadata = false; }},
        {100, [](Content& c) { c.metadata = "[1"; }},
        {100, [](Content& c) { c.metadata = "{\"a\":" + std::string(100000, '['); }},
        {100,
         [](Content& c) {
             c.metadata = "{\"a\":" + std::string(65, '[') + std::string(65, ']') + "}";
         }},
        {100, [](Content& c) { c.metadata = "{\"\xff\":1}"; }},
        {104, [](Content& c) { c.diffuse[3] = NAN; }},
        {104, [](Content& c) { c.sh[0] = INFINITY; }},
        {105, [](Content& c) { c.mip[2] = -1e-6f; }},
        {110, [](Content& c) { c.irradiance *= 1.02f; }},
        {120, [](Content& c) { c.metadata = "[]"; }},
        {121,
         [](Content& c) {
             c.with_metadata = false;
             c.also = [](Writer& w) { add_zeros(w, "metadata", {2}); };
         }},
        {121,
         [](Content& c) {
             const std::vector<std::uint8_t> bytes(c.metadata.begin(), c.metadata.end());
             c.with_metadata = false;
             c.also = [bytes](Writer& w) {
                 EXPECT_TRUE(
                     w.add<std::uint8_t>("metadata", {bytes.size()}, bytes, format::Codec::Zstd));
             };
         }},
        {130, also([](Writer& w) {
             add_ones(w, "environment/lights", {1, 9});
         })},
        {131, text("\"count\":1", "\"count\":0")},
        {131, text("\"count\":1", "\"count\":17")},
        {131, text("\"count\":1", "\"count\":1.5")},
        {131, also([](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {6, 1, 1, 3});
         })},
        {132, text("\"levels\":[", "\"levels\":[1,")},
        {133,
         [](Content& c) {
             c.replace("\"count\":1", "\"count\":3");
             c.replace("\"roughness\":0}",
                       "\"roughness\":0},{\"level\":2,\"face_size\":1,\"roughness\":1}");
             c.also = [](Writer& w) { add_ones(w, "environment/mips/2", {6, 1, 1, 3}); };
         }},
        {134,
         [](Content& c) {
             c.replace("\"roughness\":0}",
                       "\"roughness\":0},{\"level\":1,\"face_size\":1,\"roughness\":1}");
             c.also = [](Writer& w) { add_ones(w, "environment/mips/1", {6, 1, 1, 3}); };
         }},
        {135, text("\"level\":0", "\"level\":1")},
        {136, text("\"face_size\":1", "\"face_size\":2")},
        {137, text("\"roughness\":0", "\"roughness\":2e-6")},
        {137, text("\"roughness\":0", "\"rawness\":0")},
        {138, text("roots", "cubic")},
        {138, also([](Writer& w) {
             add_ones(w, "brdf/beckmann", {4, 4, 2});
         })},
        {139, text("\"meshes\":[", "\"meshes\":7,\"other\":[")},
        {140, text("\"node\":0", "\"node\":-1")},
        {140, text("\"mesh\":0", "\"mesh\":\"0\"")},
        {140, text("\"primitive\":0", "\"primitive\":0.5")},
        {140, text("\"node\":0,", "")},
        {141, text("\"meshes\"", "\"mashes\"")},
        {141, also([](Writer& w) {
             add_ones(w, "mesh/7/unshadowed", {2, 4});
         })},
        {142, text("\"vertex_count\":2", "\"vertex_count\":3")},
        {143,
         [](Content& c) {
             c.without = {"irradiance/normal", "irradiance/value"};
         }},
        {144,
         [](Content& c) {
             c.without = {"diffuse/vertex", "diffuse/value"};
         }},
        {145, [](Content& c) { c.without = {"irradiance/value"}; }},
        {145, [](Content& c) { c.without = {"specular/value"}; }},
        {145, also([](Writer& w) {
             add_ones(w, "selftest/specular_beckmann/input", {1, 8});
         })},
        {146, [](Content& c) { c.without = {"specular/input"}; }},
        {147, text("\"self_test\"", "\"shelf_test\"")},
        {147, text("tolerance", "patience")},
        {147, text("1e-3", "\"1e-3\"")},
        {148, text("1e-3", "1e30")},
        {148, text("1e-3", "0.011")},
        {148, text("1e-3", "0")},
        {148, text("1e-3", "-1e-3")},
        {149,
         [](Content& c) {
             c.without = {"specular/value"};
             c.also = [](Writer& w) { add_ones(w, "selftest/specular/value", {2, 3}); };
         }},
        {150,
         [](Content& c) {
             c.without = {"diffuse/vertex"};
             c.also = [](Writer& w) {
                 EXPECT_TRUE(w.add<std::uint32_t>("selftest/diffuse/vertex", {1, 2},
                                                  std::vector<std::uint32_t>{0, 2}));
             };
         }},
        {150, also([](Writer& w) {
             for (const char* name : {"vertex", "input", "value"}) {
                 const std::uint64_t columns = name[0] == 'i' ? 5 : name[2] == 'l' ? 3 : 2;
                 const std::string path = std::string("selftest/glossy/") + name;
                 if (name[1] == 'e')
                     add_zeros(w, path, {1, columns});
                 else
                     add_ones(w, path, {1, columns});
             }
         })},
        {151,
         [](Content& c) {
             c.without = {"specular/value"};
             c.also = [](Writer& w) {
                 EXPECT_TRUE(w.add<float>("selftest/specular/value", {1, 3},
                                          std::vector<float>(3, 1), format::Codec::Zstd));
             };
         }},
        {160, also([](Writer& w) {
             add_zeros(w, "environment/lights", {1, 9});
         })},
        {161, also([](Writer& w) {
             add_zeros(w, "environment/irradiance", {4, 3});
         })},
        {162, also([](Writer& w) {
             add_zeros(w, "environment/mips/1", {6, 1, 1, 3});
         })},
        {163, also([](Writer& w) {
             add_zeros(w, "brdf/beckmann", {2, 2, 2});
         })},
        {164, also([](Writer& w) { add_zeros(w, "brdf/ggx_average_albedo", {2}); })},
        {165, [](Content& c) { c.diffuse_as_u32 = true; }},
        {166, also([](Writer& w) {
             add_zeros(w, "selftest/specular_beckmann/input", {1, 8});
         })},
        {167, also([](Writer& w) {
             add_zeros(w, "selftest/specular_beckmann/value", {1, 3});
         })},
        {168, also([](Writer& w) {
             add_zeros(w, "mesh/0/emitted", {2, 3});
         })},
        {183, also([](Writer& w) {
             add_ones(w, "mesh/0/emitted", {2, 4});
         })},
        {152, also([](Writer& w) {
             add_ones(w, "mesh/0/glossy", {2, 49});
         })},
        {153, also([=](Writer& w) {
             add_lobe(w, {1, 2, 3}, {1, 2, 7});
         })},
        {153, lobe(R"({"exit_bands":0,"light_bands":1,"roughness":[1,1]})", {1, 2, 1}, {1, 2, 7})},
        {153, lobe(R"({"exit_bands":1,"light_bands":6,"roughness":[1,1]})", {1, 2, 6}, {1, 2, 7})},
        {153, lobe(R"({"exit_bands":1,"light_bands":1,"roughness":[1]})", {1, 2, 1}, {1, 2, 7})},
        {153, lobe(R"({"exit_bands":1,"light_bands":1,"roughness":[1,0]})", {2, 2, 1}, {2, 2, 7})},
        {153, lobe(R"({"exit_bands":1,"light_bands":1,"roughness":[0,2]})", {2, 2, 1}, {2, 2, 7})},
        {154, also([](Writer& w) {
             add_ones(w, "brdf/beckmann_lobe/kernel", {1, 2, 7});
         })},
        {155,
         [&](Content& c) {
             lobe(R"({"exit_bands":1,"light_bands":1,"roughness":[1,1]})", {1, 2, 1}, {1, 2, 7})(c);
             c.also = [add = c.also](Writer& w) {
                 add(w);
                 add_ones(w, "mesh/0/glossy", {2, 64});
                 EXPECT_TRUE(w.add<float>("mesh/0/normal", {2, 3},
                                          std::vector<float>{0, 0, 0, 0.6f, 0, 0.8f}));
             };
         }},
        {156, also([](Writer& w) {
             add_ones(w, "mesh/0/normal", {2, 3});
         })},
        {142, reflected({3, 3, 4})},
        {157, reflected({2, 3, 4}, 0)},
        {157, reflected({2, 3, 4}, 3)},
        {157, reflected({2, 8, 9, 3}, 2)},
        {157, second_mesh([=](Writer& w) {
             add_reflected(w, 1, {2, 3, 4}, 2);
         })},
        {158, also([](Writer& w) {
             add_ones(w, "mesh/0/reflected", {2, 3, 4});
         })},
        {159, reflected({2, 12})},
        {159, reflected({2, 3, 4, 1})},
        {159, reflected({2, 3, 4, 2})},
        {159, reflected({2, 3, 4, 3, 1})},
        {159, reflected({2, 0, 4})},
        {159, reflected({2, 4, 4})},
        {159, reflected({2, 8, 4})},
        {159, reflected({2, 3, 5})},
        {159, reflected({2, 24, 25})},
        {159, reflected({2, 3, 36})},
        {169, also([](Writer& w) {
             add_zeros(w, "mesh/0/glossy", {2, 49});
         })},
        {184, also([](Writer& w) {
             add_ones(w, "mesh/0/glossy", {2, 48});
         })},
        {184, also([](Writer& w) {
             add_ones(w, "mesh/0/glossy", {2, 144});
         })},
        {185, also([](Writer& w) {
             add_ones(w, "mesh/0/normal", {2, 2});
         })},
        {186, also([](Writer& w) {
             add_ones(w, "brdf/ggx_lobe/kernel", {1, 14});
         })},
        {186, lobe(R"({"exit_bands":2,"light_bands":1,"roughness":[1,1]})", {1, 2, 2}, {1, 2, 19})},
        {186, lobe(R"({"exit_bands":1,"light_bands":1,"roughness":[0,1]})", {3, 2, 1}, {2, 2, 7})},
        {186, lobe(R"({"exit_bands":1,"light_bands":1,"roughness":[1,1]})", {2, 2, 1}, {2, 2, 7})},
        {187, also([](Writer& w) {
             add_zeros(w, "mesh/0/normal", {2, 3});
         })},
        {188, also([](Writer& w) {
             add_zeros(w, "brdf/ggx_lobe/kernel", {1, 2, 7});
         })},
        {170, also([](Writer& w) {
             add_ones(w, "environment/lights", {1, 8});
         })},
        {170, also([](Writer& w) { add_ones(w, "environment/lights", {9}); })},
        {171,
         [](Content& c) {
             c.sh_shape = {3, 4};
         }},
        {171, [](Content& c) { c.sh_shape = {12}; }},
        {171, also([](Writer& w) {
             add_ones(w, "environment/irradiance", {121, 3});
         })},
        {172, also([](Writer& w) {
             add_ones(w, "environment/irradiance", {4, 2});
         })},
        {173,
         [](Content& c) {
             c.mip_shape = {6, 3};
         }},
        {173, also([](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {6, 1, 1, 2});
         })},
        {173, also([](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {3, 6, 3});
         })},
        {173, also([](Writer& w) {
             add_ones(w, "environment/mips_beckmann/0", {4, 6, 3});
         })},
        {174, also([](Writer& w) {
             add_ones(w, "brdf/beckmann", {4, 3, 2});
         })},
        {175, also([](Writer& w) {
             add_ones(w, "brdf/ggx_average_albedo", {2, 1});
         })},
        {176, also([](Writer& w) {
             add_ones(w, "mesh/0/unshadowed", {2, 3});
         })},
        {177, also([](Writer& w) {
             add_ones(w, "selftest/specular_beckmann/input", {1, 7});
         })},
        {178, also([](Writer& w) {
             add_ones(w, "selftest/specular_beckmann/value", {1, 4});
         })},
        {179, [](Content& c) { c.normal.clear(); }},
        {180, also([](Writer& w) {
             add_ones(w, "environment/mips/1", {6, 1, 1, 1});
         })},
        {180, also([](Writer& w) {
             add_ones(w, "environment/mips/1", {2, 4, 3});
         })},
        {181, also([](Writer& w) {
             add_ones(w, "environment/mips/1", {6, 2, 2, 3});
         })},
        {182, also([](Writer& w) { add_ones(w, "brdf/ggx_average_albedo", {3}); })},
        {182, also([](Writer& w) { add_ones(w, "brdf/beckmann_average_albedo", {4}); })},
        {141, also([](Writer& w) { add_zeros(w, "mesh/1/wavelet/blocks", {2}); })},
        {110, wavelets([](Wavelets& w) { w.blocks[4] = 0xff040100; })},
        {190, wavelets([](Wavelets& w) { w.basis = R"("step":0.01)"; })},
        {190, wavelets([](Wavelets& w) { w.basis = R"("face_size":24,"step":0.01)"; })},
        {191, wavelets([](Wavelets& w) { w.basis = R"("face_size":16)"; })},
        {191, wavelets([](Wavelets& w) { w.basis = R"("face_size":16,"step":0)"; })},
        {192, wavelets([](Wavelets& w) { w.whole_weights = true; })},
        {193, wavelets([](Wavelets& w) { w.weight_count = 1535; })},
        {193, wavelets([](Wavelets& w) {
             w.value_shape = {3, 2};
         })},
        {193, wavelets([](Wavelets& w) {
             w.value_shape = {6, 1};
         })},
        {194, wavelets([](Wavelets& w) { w.codec = format::Codec::Zstd; })},
        {195, wavelets([](Wavelets& w) { w.without = "mesh/0/wavelet/offsets"; })},
        {195, wavelets([](Wavelets& w) { w.without = "environment/wavelet/value"; })},
        {196, wavelets([](Wavelets& w) {
             w.index = {5, 5};
         })},
        {196, wavelets([](Wavelets& w) {
             w.index = {5, 1536};
         })},
        {197, wavelets([](Wavelets& w) {
             w.offsets = {0, 4};
         })},
        {197, wavelets([](Wavelets& w) {
             w.offsets = {1, 5};
         })},
        {197, wavelets([](Wavelets& w) {
             w.offsets = {0, 5, 5};
         })},
        {198, wavelets([](Wavelets& w) { w.blocks[0] = 2; })},
        {198, wavelets([](Wavelets& w) { w.blocks[0] = 0xffffffff; })},
        {198, wavelets([](Wavelets& w) { w.blocks[1] = 1536; })},
        {198, wavelets([](Wavelets& w) { w.blocks[2] = 1; })},
        {198, wavelets([](Wavelets& w) { w.blocks[3] = 3; })},
        {198, wavelets([](Wavelets& w) { w.blocks[4] = 0xff030200; })},
        {198, wavelets([](Wavelets& w) { w.blocks[4] = 0xff030000; })},
        {198, wavelets([](Wavelets& w) { w.blocks[4] = 0x00030100; })},
        {198, wavelets([](Wavelets& w) {
             w.blocks = {2, 5, 5, 0, 1, 2, 0xff030100};
             w.offsets = {0, 7};
         })},
        {198, wavelets([](Wavelets& w) {
             w.blocks = {1, 5, 0, 1, 0x00010300};
         })},
        {199, wavelets([](Wavelets& w) {
             w.vertex = {0, 2};
         })},
        {199, wavelets([](Wavelets& w) {
             w.vertex = {1, 0};
         })},
    };
    std::map<int, std::string> broken;
    const auto judge = [&](int code) {
        const auto findings = validate_bundle(path_);
        ASSERT_TRUE(findings);
        ASSERT_FALSE(findings->empty()) << code;
        for (const Finding& finding : *findings) {
            EXPECT_EQ(finding.code, code) << finding.message;
            broken[finding.code] = finding.name;
        }
    };
    for (std::size_t i = 0; i < contents.size(); ++i) {
        SCOPED_TRACE(i);
        Content content;
        contents[i].second(content);
        codes(content);
        judge(contents[i].first);
    }

    // The table's first entry is that of brdf/ggx, 32 bytes.
    using Bytes = std::vector<std::byte>;
    const std::vector<std::pair<int, std::function<void(Bytes&, std::size_t)>>> bytes{
        {10, [](Bytes& b, std::size_t) { b.resize(63); }},
        {11, [](Bytes& b, std::size_t) { b[0] = std::byte{7}; }},
        {12, [](Bytes& b, std::size_t) { put<std::uint16_t>(b, 8, 2); }},
        {13, [](Bytes& b, std::size_t) { put<std::uint64_t>(b, 48, 1); }},
        {14,
         [](Bytes& b, std::size_t) {
             put<std::uint64_t>(b, 48, 1);
             seal_header(b);
         }},
        {15, [](Bytes& b, std::size_t) { b.push_back(std::byte{0}); }},
        {16,
         [](Bytes& b, std::size_t) {
             put<std::uint64_t>(b, 24, 0);
             seal_header(b);
         }},
        {17, [](Bytes& b, std::size_t table) { b[table + 9] = std::byte{1}; }},
        {30, [](Bytes& b, std::size_t) { b[64] = std::byte{7}; }},
        {32, [](Bytes& b, std::size_t) { b[64 + 48 + 1] = std::byte{7}; }},
        {20, [](Bytes& b, std::size_t table) { b[table + 9] = std::byte{1}, seal(b, table); }},
        {21,
         [](Bytes& b, std::size_t table) {
             put<std::uint16_t>(b, table + 4, 0);
             seal(b, table);
         }},
        {22,
         [](Bytes& b, std::size_t table) {
             std::memcpy(&b[table + 96], &b[table], 6);
             seal(b, table);
         }},
        {23, [](Bytes& b, std::size_t table) { b[table + 6] = std::byte{7}, seal(b, table); }},
        {24, [](Bytes& b, std::size_t table) { b[table + 7] = std::byte{2}, seal(b, table); }},
        {25, [](Bytes& b, std::size_t table) { b[table + 8] = std::byte{7}, seal(b, table); }},
        {26,
         [](Bytes& b, std::size_t table) {
             put(b, table + 16, ~std::uint64_t{0});
             seal(b, table);
         }},
        {27,
         [](Bytes& b, std::size_t table) {
             put<std::uint64_t>(b, table + 16, 3);
             seal(b, table);
         }},
        {28,
         [](Bytes& b, std::size_t table) {
             put<std::uint64_t>(b, table + 64, 65);
             seal(b, table);
         }},
    };
    for (const auto& [code, damage] : bytes) {
        ASSERT_EQ(codes({}), Codes{});
        Bytes file = load();
        damage(file, table_of(file));
        store(file);
        judge(code);
    }
    write_zstd("abc", 4);
    judge(31);
    write_zstd("abc", (8u << 20) + 1);
    judge(29);
    Content twins;
    twins.also = [](Writer& w) {
        add_zeros(w, "a/0", {4});
        add_zeros(w, "a/1", {4});
    };
    ASSERT_EQ(codes(twins), Codes{});
    Bytes file = load();
    const std::size_t table = table_of(file);
    std::memcpy(&file[table + 96 + 64], &file[table + 64], 8);  // a/1 where a/0 is
    seal(file, table);
    store(file);
    judge(33);

    Content longer;
    longer.also = [](Writer& w) { add_zeros(w, "aab", {4}); };
    ASSERT_EQ(codes(longer), Codes{});
    file = load();
    put<std::uint16_t>(file, table_of(file) + 4, 2);  // "aa"
    seal(file, table_of(file));
    store(file);
    judge(122);

    EXPECT_EQ(broken, documented_rules());
    EXPECT_GE(broken.size(), 60u);
}

// "[133 MipsGap]" in the text names a rule of the table.
TEST_F(Validate, TheDocumentsTextNamesItsRulesRightly) {
    const auto rules = documented_rules();
    std::ifstream document(ENVBAKE_FORMAT_DOCUMENT);
    const std::string text{std::istreambuf_iterator<char>(document), {}};
    const std::regex reference(R"([\[ ](\d+) ([A-Z][A-Za-z]+)[,\]])");
    std::size_t count = 0;
    for (std::sregex_iterator at(text.begin(), text.end(), reference), end; at != end; ++at) {
        const auto known = rules.find(std::stoi((*at)[1]));
        ASSERT_NE(known, rules.end()) << at->str();
        EXPECT_EQ(known->second, (*at)[2].str());
        ++count;
    }
    EXPECT_GT(count, 30u);
}

TEST_F(Validate, EveryEncodingOfTransportIsGood) {
    Content content;
    content.replace("\"vertex_count\":2}]", R"("vertex_count":2},
                    {"node":1,"mesh":1,"primitive":0,"vertex_count":2},
                    {"node":1,"mesh":2,"primitive":0,"vertex_count":3},
                    {"node":1,"mesh":3,"primitive":0,"vertex_count":3},
                    {"node":1,"mesh":4,"primitive":0,"vertex_count":3}])");
    content.also = [](Writer& w) {
        Clustered{}(w);
        add_all<std::uint8_t>(w, "mesh/2/diffuse", {3, 4}, 1);
        add_ones(w, "mesh/2/diffuse_range", {4, 2});
        add_all<std::uint16_t>(w, "mesh/3/diffuse", {3, 4, 3}, 1);
        add_ones(w, "mesh/3/diffuse_range", {4, 3, 2});
        EXPECT_TRUE(w.add<format::Half>("mesh/4/diffuse", {3, 4}, std::vector<format::Half>(12)));
    };
    EXPECT_EQ(codes(content), Codes{});
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
        {{{1, 5}}, "4", level_0 + R"({"level":1,"face_size":5,"roughness":0.3333333})", {181}},
        {{{1, 12}}, "4", level_0 + R"({"level":1,"face_size":12,"roughness":0.3333333})", {181}},
        {{{1, 6}, {2, 3}}, "3", level_0 + level_1 + "," + level_2, {137, 137}},
        {{{1, 6}, {2, 3}}, "2", level_0 + level_1 + "," + level_2, {137, 134}},
        {{{1, 6}, {2, 3}}, "4", level_0 + level_2 + "," + level_1, {135, 135}},
        {{{1, 6}, {2, 3}}, "4", level_0 + level_1, {132}},
        {{{1, 6}}, "4", level_0 + level_1 + "," + level_2, {132}},
        {{{2, 3}}, "4", level_0 + level_2, {133}},
        {{{1, 6}}, "4", level_0 + R"({"level":1,"face_size":6,"roughness":0.333331})", {137}},
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

TEST_F(Validate, GlossyTransportOfTwoLobesIsGood) {
    Content content;
    const std::string facts = R"({"exit_bands":3,"light_bands":2,"roughness":[0.25,0.75]})";
    content.replace("\"ggx\":",
                    "\"ggx_lobe\":" + facts + ",\"beckmann_lobe\":" + facts + ",\"ggx\":");
    content.also = [](Writer& writer) {
        for (const std::string lobe : {"brdf/ggx_lobe/", "brdf/beckmann_lobe/"}) {
            add_ones(writer, lobe + "unoccluded", {17, 2, 3 * 2 + 2 * 1});
            add_ones(writer, lobe + "kernel", {17, 2, 3 * 7 + 2 * 6 + 1 * 5});
        }
        add_ones(writer, "mesh/0/glossy", {2, 64});
        EXPECT_TRUE(
            writer.add<float>("mesh/0/normal", {2, 3}, std::vector<float>{0, 0, 0, 0, 1, 0}));
    };
    EXPECT_EQ(codes(content), Codes{});
}

TEST_F(Validate, LightThatSurfacesSendByDirectionIsGood) {
    struct Case {
        std::uint64_t light_bands;
        std::vector<std::uint64_t> shape;
        bool clustered = false;
    };
    for (const auto& [n, shape, is_clustered] :
         {Case{2, {2, 3, 4}}, Case{2, {2, 3, 4, 3}, true}, Case{3, {2, 8, 9}},
          Case{5, {2, 3, 25}, true}, Case{5, {2, 15, 25, 3}}}) {
        SCOPED_TRACE(n);
        Content content;
        content.replace("\"vertex_count\":2}]", R"("vertex_count":2},
                        {"node":1,"mesh":1,"primitive":0,"vertex_count":2}])");
        content.also = [=, n = n, shape = shape, is_clustered = is_clustered](Writer& writer) {
            const std::string mesh = is_clustered ? "mesh/1" : "mesh/0";
            add_all(writer, mesh + "/reflected", shape, format::Half{0x3c00});
            add_ones(writer, mesh + "/glossy", {2, (n + 6) * (n + 6)});
            add_all(writer, mesh + "/normal", {2, 3}, 0.0f);
            if (is_clustered) Clustered{}(writer);
        };
        EXPECT_EQ(codes(content), Codes{});
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
    EXPECT_EQ(codes(content), Codes{141});
    content.also = [](Writer& writer) {
        add_ones(writer, "mesh/99999999999999999999/diffuse", {2, 4});
    };
    EXPECT_EQ(codes(content), Codes{141});
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
    EXPECT_EQ(judge(frame("abcd"), std::uint64_t{1} << 23, false), Codes{31});
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
