// SPDX-License-Identifier: Apache-2.0
// Shards whose metadata or arrays somebody has changed, with all checksums made right: `merge` ends
// in one line and writes nothing, or makes a bundle that opens.
#include "baker/pipeline/bake.h"
#include "baker/pipeline/json_text.h"
#include "baker/pipeline/metadata.h"
#include "baker/pipeline/shard.h"
#include "tests/support/sanitized.h"
#include "tests/support/small_scene.h"

#include "envbake/format/reader.h"
#include "envbake/format/writer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace envbake {
namespace {

namespace fs = std::filesystem;

/// One of so many changes, of some 6,500: a merge takes milliseconds, with sanitizers ten times as
/// long.
constexpr std::size_t kStride = test::kAddressSanitizer ? 401 : 97;

/// A bundle in memory, to be changed and written again.
struct Arrays {
    struct Array {
        format::ArraySpec spec;
        std::vector<std::byte> bytes;
    };
    std::vector<Array> arrays;

    explicit Arrays(const fs::path& file) {
        const auto reader = format::Reader::open(file.c_str());
        EXPECT_TRUE(reader);
        for (std::size_t i = 0; i < reader->array_count(); ++i) {
            const format::ArrayInfo info = reader->array(i);
            std::vector<std::byte> bytes(info.size);
            EXPECT_TRUE(reader->read(info, bytes));
            arrays.push_back({{std::string(info.name),
                               info.type,
                               {info.shape.begin(), info.shape.begin() + info.rank},
                               format::Codec::None},
                              std::move(bytes)});
        }
    }
    Array& operator[](std::string_view name) {
        for (Array& array : arrays)
            if (array.spec.name == name) return array;
        throw std::out_of_range(std::string(name));
    }
    Json metadata() {
        const auto& bytes = (*this)[format::kMetadataName].bytes;
        return Json::parse(std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
    }
    void set_metadata(const Json& json) {
        const std::string text = json.dump();
        Array& array = (*this)[format::kMetadataName];
        array.spec.shape = {text.size()};
        array.bytes.resize(text.size());
        std::memcpy(array.bytes.data(), text.data(), text.size());
    }
    void write(const fs::path& file) const {
        auto writer = format::Writer::create(file.string());
        ASSERT_TRUE(writer);
        for (const Array& array : arrays) ASSERT_TRUE(writer->add(array.spec, array.bytes));
        ASSERT_TRUE(writer->finish());
    }
};

class ForgedShards : public ::testing::Test {
  protected:
    void SetUp() override {
        request_.scene = test::write_small_scene(folder_.path(), "scene", 18);  // 365 vertices
        request_.environment = test::write_small_sky(folder_ / "sky.hdr");
        request_.bands = 3;
        request_.mip_size = 8;
        request_.mip_count = 2;
        request_.table_size = 4;
        request_.rays_per_vertex = 16;
        request_.irradiance = request_.window = request_.unshadowed = true;
        request_.glossy_bands = 3;
    }

    fs::path file(int index) const { return folder_ / (std::to_string(index) + ".part.envb"); }

    void bake(int count) {
        for (int index = 1; index <= count; ++index) {
            request_.shard = Shard{index, count};
            request_.output = file(index);
            const auto inputs = load_inputs(request_);
            ASSERT_TRUE(inputs) << inputs.error();
            const auto plan = make_plan(request_, inputs->facts);
            ASSERT_TRUE(plan) << plan.error();
            Progress progress;
            const auto done = run_shard(request_, *inputs, *plan, progress);
            ASSERT_TRUE(done) << done.error();
            files_.push_back(file(index));
        }
    }

    /// Whether the parts become a bundle. If not, it is said in one line that names a part, and
    /// nothing is there.
    bool merges(const std::string& what) {
        const fs::path output = folder_ / "merged.envb";
        Progress progress;
        const auto merged = merge_shards(files_, request_.scene, output, progress);
        if (merged) {
            EXPECT_TRUE(format::Reader::open(output.c_str())) << what;
            fs::remove(output);
            return true;
        }
        const std::string& line = merged.error().message;
        EXPECT_EQ(line.find('\n'), std::string::npos) << what << ": " << line;
        // Light that the parts were not shown, brighter than what can be stored, is the map's
        // fault.
        // Files that the parts were not baked from are the scene's.
        const bool of_input = line.find("sky.hdr: too bright") != std::string::npos ||
                              line.find("scene.gltf: is not the scene") != std::string::npos;
        EXPECT_EQ(merged.error().code, of_input ? Errc::InvalidInput : Errc::InvalidBundle)
            << what << ": " << line;
        EXPECT_TRUE(of_input || line.find(".part.envb") != std::string::npos)
            << what << ": " << line;
        EXPECT_FALSE(fs::exists(output)) << what;
        return false;
    }

    /// Every value of the metadata in turn, and every object and list, becomes something else.
    /// The same in all parts: but for their results they must agree.
    void forge_metadata(std::size_t stride) {
        std::vector<Arrays> parts(files_.begin(), files_.end());
        std::vector<Json> metadata;
        for (Arrays& part : parts) metadata.push_back(part.metadata());
        std::vector<Json::json_pointer> places;
        const std::function<void(const Json&, const Json::json_pointer&)> walk =
            [&](const Json& json, const Json::json_pointer& at) {
                places.push_back(at);
                if (!json.is_structured()) return;
                for (const auto& [key, value] : json.items())
                    json.is_array() ? walk(value, at / std::stoul(key)) : walk(value, at / key);
            };
        for (const auto& [key, value] : metadata[0].items())
            walk(value, Json::json_pointer() / key);
        ASSERT_GT(places.size(), 300u);

        const std::vector<Json> forged{nullptr,
                                       "",
                                       "forged",
                                       -1,
                                       0,
                                       1,
                                       0.5,
                                       -1e300,
                                       1e300,
                                       (std::int64_t{1} << 31) - 1,
                                       std::int64_t{1} << 32,
                                       ~std::uint64_t{0},
                                       true,
                                       Json::array(),
                                       Json::object(),
                                       Json::array({Json::object()}),
                                       Json::array({1, 2, 3})};
        std::size_t step = 0, refused = 0, accepted = 0;
        for (const Json::json_pointer& at : places) {
            for (std::size_t k = 0; k <= forged.size(); ++k) {
                if (step++ % stride != 0) continue;
                const std::string what =
                    at.to_string() + (k == 0 ? " erased" : " = " + forged[k - 1].dump());
                SCOPED_TRACE(what);
                for (std::size_t i = 0; i < parts.size(); ++i) {
                    Json json = metadata[i];
                    if (!json.contains(at)) continue;
                    if (k != 0) {
                        json[at] = forged[k - 1];
                    } else if (json[at.parent_pointer()].is_array()) {
                        json[at.parent_pointer()].erase(std::stoul(at.back()));
                    } else {
                        json[at.parent_pointer()].erase(at.back());
                    }
                    Arrays changed = parts[i];
                    changed.set_metadata(json);
                    changed.write(files_[i]);
                }
                merges(what) ? ++accepted : ++refused;
                if (HasFatalFailure()) return;
            }
        }
        EXPECT_GT(refused, accepted);
        for (std::size_t i = 0; i < parts.size(); ++i) parts[i].write(files_[i]);
        EXPECT_TRUE(merges("as it was"));
    }

    /// Every array in turn, but for the metadata, is another one.
    void forge_arrays(std::size_t stride) {
        std::vector<Arrays> parts(files_.begin(), files_.end());
        std::size_t step = 0, refused = 0;
        for (std::size_t i = 0; i < parts.size(); ++i) {
            for (std::size_t a = 0; a < parts[i].arrays.size(); ++a) {
                const std::string name = parts[i].arrays[a].spec.name;
                if (!name.starts_with("shard/")) continue;
                // Of the hundred vertices that are looked at, two.
                if (name.starts_with("shard/environment/wavelet/") &&
                    !name.starts_with("shard/environment/wavelet/1/") &&
                    !name.starts_with("shard/environment/wavelet/2/"))
                    continue;
                const auto forge = [&](const std::string& how, const auto& change) {
                    if (step++ % stride != 0) return;
                    SCOPED_TRACE(name + " " + how);
                    Arrays changed = parts[i];
                    change(changed.arrays[a]);
                    changed.write(files_[i]);
                    if (!merges(name + " " + how)) ++refused;
                };
                forge("other", [](auto& array) {
                    std::uint32_t state = 12345;
                    for (std::byte& b : array.bytes)
                        b = static_cast<std::byte>((state = state * 1664525 + 1013904223) >> 24);
                });
                for (const auto byte : {std::byte{0}, std::byte{0x7f}, std::byte{0xff}})
                    forge("of one byte", [&](auto& array) {
                        std::fill(array.bytes.begin(), array.bytes.end(), byte);
                    });
                forge("longer", [](auto& array) {
                    array.bytes.resize(2 * array.bytes.size());
                    array.spec.shape[0] *= 2;
                });
                forge("shorter", [](auto& array) {
                    array.bytes.resize(array.bytes.size() / array.spec.shape[0]);
                    array.spec.shape[0] = 1;
                });
                forge("of bytes", [](auto& array) {
                    array.spec.type = format::ElementType::U8;
                    array.spec.shape = {array.bytes.size()};
                });
                forge("absent", [](auto& array) { array.spec.name = "shard/another"; });
            }
            parts[i].write(files_[i]);
        }
        EXPECT_GT(refused, 0u);
        EXPECT_TRUE(merges("as it was"));
    }

    test::TemporaryFolder folder_;
    BakeRequest request_;
    std::vector<fs::path> files_;
};

TEST_F(ForgedShards, MetadataOfLightAndGlossyTransport) {
    request_.glossy = GlossyChoice::All;
    request_.bounces = 2;
    ASSERT_NO_FATAL_FAILURE(bake(2));
    ASSERT_TRUE(merges("as baked"));
    forge_metadata(kStride);
}

TEST_F(ForgedShards, MetadataOfWaveletsAndEncodings) {
    request_.wavelet = WaveletUse::Always;
    request_.wavelet_size = 16;
    request_.encoding = Encoding::Unorm8;
    ASSERT_NO_FATAL_FAILURE(bake(2));
    ASSERT_TRUE(merges("as baked"));
    forge_metadata(2 * kStride + 1);
}

// Facts, description and plan agree on a mesh that the scene does not have.
TEST_F(ForgedShards, AMeshTooMany) {
    request_.bounces = 1;
    ASSERT_NO_FATAL_FAILURE(bake(1));
    ASSERT_TRUE(merges("as baked"));
    Arrays part(files_[0]);
    Json json = part.metadata();
    Json mesh = json["facts"]["meshes"][0];
    mesh["receives"] = false;
    json["facts"]["meshes"].push_back(mesh);
    json["meshes"].push_back(Json(json["meshes"][0]));
    const SharedState state = read_shared(json);
    const auto plan = make_plan(state.request, state.inputs.facts);
    ASSERT_TRUE(plan) << plan.error();
    json["plan"] = plan_json(*plan);
    part.set_metadata(json);
    part.write(files_[0]);
    Progress progress;
    const auto merged = merge_shards(files_, request_.scene, folder_ / "merged.envb", progress);
    ASSERT_FALSE(merged);
    EXPECT_EQ(merged.error().code, Errc::InvalidBundle);
    EXPECT_NE(merged.error().message.find("has other meshes"), std::string::npos) << merged.error();
}

TEST_F(ForgedShards, Arrays) {
    request_.glossy = GlossyChoice::All;
    request_.wavelet = WaveletUse::Always;
    request_.wavelet_size = 16;
    request_.encoding = Encoding::Clustered;
    request_.bounces = 2;
    ASSERT_NO_FATAL_FAILURE(bake(2));
    ASSERT_TRUE(merges("as baked"));
    forge_arrays((kStride + 6) / 7);
}

}  // namespace
}  // namespace envbake
