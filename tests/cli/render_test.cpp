// SPDX-License-Identifier: Apache-2.0
// What the render command refuses, and that it writes nothing when it does.
#include "tests/support/run_program.h"
#include "tests/support/small_scene.h"

#include "envbake/format/reader.h"
#include "envbake/format/writer.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cstddef>
#include <fstream>
#include <functional>
#include <iterator>
#include <span>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Copies a bundle with other metadata.
void copy_with_metadata(const std::string& from, const std::string& to,
                        const std::string& metadata) {
    const auto reader = format::Reader::open(from.c_str());
    ASSERT_TRUE(reader);
    auto writer = format::Writer::create(to);
    ASSERT_TRUE(writer);
    for (std::size_t i = 0; i < reader->array_count(); ++i) {
        const format::ArrayInfo info = reader->array(i);
        if (info.name == format::kMetadataName) continue;
        std::vector<std::uint64_t> shape;
        for (const auto extent : info.shape)
            if (shape.size() < info.rank) shape.push_back(extent);
        ASSERT_TRUE(writer->add({std::string(info.name), info.type, shape, info.codec},
                                reader->stored_bytes(info)));
    }
    ASSERT_TRUE(writer->add({std::string(format::kMetadataName),
                             format::ElementType::U8,
                             {metadata.size()},
                             format::Codec::None},
                            std::as_bytes(std::span(metadata))));
    ASSERT_TRUE(writer->finish());
}

std::string metadata_of(const std::string& bundle) {
    const auto reader = format::Reader::open(bundle.c_str());
    EXPECT_TRUE(reader);
    return std::string(reader->metadata());
}

class Render : public ::testing::Test {
  protected:
    void SetUp() override {
        scene_ = write_small_scene(folder_.path()).string();
        sky_ = write_small_sky(folder_ / "sky.hdr").string();
        bundle_ = (folder_ / "scene.envb").string();
        picture_ = (folder_ / "x.png").string();
        bake();
    }

    void bake() const {
        const Outcome outcome =
            envbake({"bake", scene_, "--env", sky_, "-o", bundle_, "--mip-size", "16",
                     "--mip-count", "3", "--table-size", "16", "--quiet", "--force"});
        ASSERT_EQ(outcome.status, 0) << outcome.err;
    }

    Outcome render(std::vector<std::string> more = {}) const { return render(picture_, more); }
    Outcome render(const std::string& output, const std::vector<std::string>& more) const {
        std::vector<std::string> arguments{"render", bundle_,  scene_,  "-o",
                                           output,   "--size", "24x16", "--quiet"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return envbake(arguments);
    }

    /// The error is one line that says `what`; no picture is there.
    void expect_refused(const Outcome& outcome, int status, const std::string& what) const {
        EXPECT_EQ(outcome.status, status) << outcome.err;
        EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
        EXPECT_NE(outcome.err.find(what), std::string::npos) << outcome.err;
        EXPECT_EQ(outcome.out, "");
        for (const char* name : {"x.png", "x.reference.png", "x.difference.png"})
            EXPECT_FALSE(fs::exists(folder_ / name)) << name;
    }

    TemporaryFolder folder_;
    std::string scene_, sky_, bundle_, picture_;
};

TEST_F(Render, MetadataMayHoldAnything) {
    const Json whole = Json::parse(metadata_of(bundle_));
    const std::vector<std::function<void(Json&)>> damages{
        [](Json& m) { m.erase("inputs"); },
        [](Json& m) { m["inputs"] = 7; },
        [](Json& m) { m["inputs"] = nullptr; },
        [](Json& m) { m["inputs"] = m["inputs"][0]; },
        [](Json& m) { m["inputs"][0] = "scene"; },
        [](Json& m) { m["inputs"][0] = nullptr; },
        [](Json& m) { m["inputs"][0]["role"] = 1; },
        [](Json& m) { m["inputs"][0]["xxh3"] = Json::array(); },
        [](Json& m) { m["inputs"][1]["name"] = Json::object(); },
        [](Json& m) { m["inputs"][1].erase("name"); },
    };
    const std::string intact = bundle_;
    bundle_ = (folder_ / "other.envb").string();
    copy_with_metadata(intact, bundle_, whole.dump());
    ASSERT_EQ(render((folder_ / "intact.png").string(), {}).status, 0);
    for (const auto& damage : damages) {
        Json metadata = whole;
        damage(metadata);
        SCOPED_TRACE(metadata.contains("inputs") ? metadata["inputs"].dump() : "none");
        copy_with_metadata(intact, bundle_, metadata.dump());
        expect_refused(render(), 4, "other.envb: the metadata has no valid list of inputs");
    }
    for (const char* metadata : {"[]", "7", "null", "\"inputs\"", "no JSON"}) {
        SCOPED_TRACE(metadata);
        copy_with_metadata(intact, bundle_, metadata);
        expect_refused(render(), 4, "other.envb: ");
    }
}

TEST_F(Render, CameraOptionsAreChecked) {
    for (const char* point : {"nan,0,0", "0,inf,0", "0,0,-inf", "1e31,0,0", "0,-1e300,0"}) {
        SCOPED_TRACE(point);
        expect_refused(render({std::string("--camera=") + point, "--look-at=0,0,0"}), 2,
                       "--camera");
        expect_refused(render({"--camera=3,3,3", std::string("--look-at=") + point}), 2,
                       "--look-at");
    }
    expect_refused(render({"--camera=1,2,3", "--look-at=1,2,3"}), 2, "--camera");
    for (const char* stops : {"nan", "inf", "-inf", "101", "-1e9"})
        expect_refused(render({std::string("--exposure=") + stops}), 2, "--exposure");
    for (const char* degrees : {"nan", "inf", "0", "-35", "180"})
        expect_refused(render({std::string("--fov=") + degrees}), 2, "--fov");
    EXPECT_EQ(render({"--camera=3,3,1e6", "--look-at=0,0,0", "--exposure=-100", "--fov=1"}).status,
              0);
}

TEST_F(Render, ATurntableEndsWhereItBegan) {
    const auto bytes = [&](const std::string& name) {
        std::ifstream file(folder_ / name, std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(file), {});
    };
    ASSERT_EQ(render({"--exposure=0"}).status, 0);
    const Outcome outcome = render({"--exposure=0", "--turntable=3"});
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(bytes("x.0000.png"), bytes("x.png"));
    EXPECT_NE(bytes("x.0001.png"), bytes("x.png"));
    EXPECT_TRUE(fs::exists(folder_ / "x.0002.png"));
    EXPECT_FALSE(fs::exists(folder_ / "x.0003.png"));
    ASSERT_EQ(render({"--exposure=0", "--rotate-light=360"}).status, 0);
    EXPECT_EQ(bytes("x.png"), bytes("x.0000.png"));
}

TEST_F(Render, ATurntableMovesInAGif) {
    const fs::path gif = folder_ / "turn.gif";
    const Outcome outcome = render(gif.string(), {"--turntable=3"});
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    std::ifstream file(gif, std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(file), {});
    EXPECT_EQ(bytes.substr(0, 10), std::string("GIF89a\x18\0\x10\0", 10));
    EXPECT_NE(bytes.find("NETSCAPE2.0"), std::string::npos);  // runs for ever
    const std::string control("\x21\xf9\x04", 3);             // before every frame
    std::size_t frames = 0;
    for (std::size_t at = bytes.find(control); at != std::string::npos;
         at = bytes.find(control, at + 1))
        ++frames;
    EXPECT_EQ(frames, 3u);
    expect_refused(render(gif.string(), {}), 2, ".gif");
}

TEST_F(Render, TurningOptionsAreChecked) {
    for (const char* degrees : {"nan", "inf", "361", "-1e9"})
        expect_refused(render({std::string("--rotate-light=") + degrees}), 2, "--rotate-light");
    expect_refused(render({"--turntable=0"}), 2, "--turntable");
    expect_refused(render({"--turntable=2", "--reference", "--env", sky_}), 2, "--turntable");
}

TEST_F(Render, FieldOfViewCountsWithoutACameraToo) {
    const auto picture = [&](const std::vector<std::string>& more) {
        EXPECT_EQ(render(picture_, more).status, 0);
        return read_file(picture_);
    };
    const std::string usual = picture({});
    EXPECT_TRUE(picture({"--fov", "35"}) == usual);
    EXPECT_TRUE(picture({"--fov", "80"}) != usual);
    const std::vector<std::string> camera{"--camera=3,3,3", "--look-at=0,0,0"};
    const std::string from_there = picture(camera);
    EXPECT_TRUE(picture({camera[0], camera[1], "--fov", "35"}) == from_there);
    EXPECT_TRUE(picture({camera[0], camera[1], "--fov", "80"}) != from_there);
}

TEST_F(Render, AFloorThatFacesDownIsNoRoom) {
    const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 0, 1};
    std::string bytes(sizeof positions, '\0');
    std::memcpy(bytes.data(), positions, sizeof positions);
    write_file(folder_ / "down.bin", bytes);
    scene_ = (folder_ / "down.gltf").string();
    write_file(scene_, R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":3,
"min":[0,0,0],"max":[1,0,1]}],"bufferViews":[{"buffer":0,"byteLength":36}],
"buffers":[{"uri":"down.bin","byteLength":36}]})");
    bake();
    const Outcome outcome = render();
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(read_file(picture_).substr(1, 3), "PNG");
}

TEST_F(Render, TheEnvironmentIsCheckedBeforeAnythingIsWritten) {
    const std::string absent = (folder_ / "absent.hdr").string();
    expect_refused(render({"--reference", "--env", absent}), 1, "absent.hdr");
    const std::string other = write_small_sky(folder_ / "other.hdr", 3).string();
    expect_refused(render({"--reference", "--env", other}), 4, "another environment");
    expect_refused(render({"--env", other}), 4, "another environment");
}

TEST_F(Render, ResourcesAreThoseOfTheBake) {
    std::string bytes = read_file(folder_ / "scene.bin");
    const float height = 0.5f;  // of the roof's first vertex, the 26th, instead of 1 m
    std::memcpy(bytes.data() + (25 * 3 + 1) * sizeof(float), &height, sizeof height);
    write_file(folder_ / "scene.bin", bytes);
    expect_refused(render(), 4, "another resource than " + (folder_ / "scene.bin").string());
    bake();
    EXPECT_EQ(render().status, 0);
}

TEST_F(Render, AMovedSceneIsTheSame) {
    fs::create_directory(folder_ / "moved");
    for (const char* name : {"scene.gltf", "scene.bin"})
        fs::rename(folder_ / name, folder_ / "moved" / name);
    scene_ = (folder_ / "moved" / "scene.gltf").string();
    const Outcome outcome = render();
    EXPECT_EQ(outcome.status, 0) << outcome.err;
}

TEST_F(Render, NoInputIsOverwritten) {
    const std::string alias = (folder_ / "alias.png").string();
    for (const std::string& input : {bundle_, scene_, sky_, (folder_ / "scene.bin").string()}) {
        SCOPED_TRACE(input);
        const std::string before = read_file(input);
        fs::remove(alias);
        fs::create_hard_link(input, alias);
        expect_refused(render(alias, {"--env", sky_}), 2, "alias.png");
        fs::remove(alias);
        fs::create_symlink(input, alias);
        expect_refused(render(alias, {"--env", sky_}), 2, "alias.png");
        EXPECT_TRUE(read_file(input) == before);
    }
    // The names that --reference adds are outputs too.
    const std::string sky = (folder_ / "y.reference.png").string();
    fs::rename(sky_, sky);
    expect_refused(render((folder_ / "y.png").string(), {"--reference", "--env", sky}), 2,
                   "y.reference.png");
    EXPECT_FALSE(fs::exists(folder_ / "y.png"));
}

TEST_F(Render, AnOutputIsAFile) {
    fs::create_directory(folder_ / "folder.png");
    expect_refused(render((folder_ / "folder.png").string(), {}), 2, "not a regular file");
    fs::create_directory(folder_ / "x.difference.exr");
    expect_refused(render((folder_ / "x.exr").string(), {"--reference", "--env", sky_}), 2,
                   "x.difference.exr: not a regular file");
    EXPECT_FALSE(fs::exists(folder_ / "x.exr"));
    ASSERT_EQ(render().status, 0);
    EXPECT_EQ(render().status, 0) << "a picture may be overwritten";
}

}  // namespace
}  // namespace envbake::test
