// SPDX-License-Identifier: Apache-2.0
// The command line as its users have it: processes, files, exit statuses.
#include "tests/support/run_program.h"
#include "tests/support/small_scene.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdlib>
#include <set>
#include <sstream>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class Commands : public ::testing::Test {
  protected:
    void SetUp() override {
        scene_ = write_small_scene(folder_.path()).string();
        sky_ = write_small_sky(folder_ / "sky.hdr").string();
        bundle_ = (folder_ / "scene.envb").string();
    }

    std::vector<std::string> bake_arguments(std::vector<std::string> more = {}) const {
        std::vector<std::string> arguments{"bake",        scene_,  "--env",        sky_,
                                           "-o",          bundle_, "--mip-size",   "16",
                                           "--mip-count", "3",     "--table-size", "16"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return arguments;
    }

    void bake(std::vector<std::string> more = {}) const {
        const Outcome outcome = envbake(bake_arguments(std::move(more)));
        ASSERT_EQ(outcome.status, 0) << outcome.err;
        ASSERT_EQ(outcome.out, "");
    }

    json dump() const {
        const Outcome outcome = envbake({"dump", bundle_, "--json"});
        EXPECT_EQ(outcome.status, 0) << outcome.err;
        return json::parse(outcome.out);
    }

    TemporaryFolder folder_;
    std::string scene_, sky_, bundle_;
};

TEST_F(Commands, HelpAndVersionGoToStdout) {
    const Outcome help = envbake({"--help"});
    EXPECT_EQ(help.status, 0);
    for (const char* command :
         {"bake", "plan", "dump", "validate", "extract", "diff", "render", "version"})
        EXPECT_NE(help.out.find(command), std::string::npos) << command;
    EXPECT_EQ(envbake({"bake", "--help"}).status, 0);
    EXPECT_EQ(envbake({"version"}).out.rfind("envbake 1.", 0), 0u);
}

TEST_F(Commands, WrongUsageIsTwoAndOneLine) {
    for (const std::vector<std::string>& arguments :
         {std::vector<std::string>{},
          {"bakes"},
          {"bake"},
          {"bake", "-o", bundle_},
          {"dump"},
          {"bake", scene_, "-o", bundle_, "--bands", "11"},
          {"bake", scene_, "-o", bundle_, "--bands", "x"},
          {"bake", scene_, "-o", bundle_, "--preset", "best"},
          {"bake", scene_, "-o", bundle_, "--preset", "preview", "--tolerance", "0.1"}}) {
        const Outcome outcome = envbake(arguments);
        EXPECT_EQ(outcome.status, 2) << outcome.err;
        EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
        EXPECT_FALSE(fs::exists(bundle_));
    }
}

TEST_F(Commands, BakeDumpValidate) {
    bake();
    const Outcome text = envbake({"dump", bundle_});
    EXPECT_EQ(text.status, 0);
    for (const char* expected :
         {"intact", "scene.gltf", "sky.hdr", "environment/sh", "mesh/0/diffuse", "25 x 3"})
        EXPECT_NE(text.out.find(expected), std::string::npos) << expected << "\n" << text.out;
    const Outcome valid = envbake({"validate", bundle_, "--json"});
    EXPECT_EQ(valid.status, 0);
    EXPECT_EQ(json::parse(valid.out)["valid"], true);
    const json d = dump();
    EXPECT_EQ(d["metadata"]["meshes"][0]["node_name"], "floor and roof");
    EXPECT_EQ(d["metadata"]["meshes"][0]["vertex_count"], 29);
    std::set<std::string> inputs;
    for (const json& input : d["metadata"]["inputs"])
        inputs.insert(input["name"].get<std::string>());
    EXPECT_EQ(inputs, (std::set<std::string>{"scene.gltf", "scene.bin", "sky.hdr"}));
}

TEST_F(Commands, BundlesNameNoFolderAndNoTime) {
    bake();
    const std::string content = read_file(bundle_);
    EXPECT_EQ(content.find(folder_.path().string()), std::string::npos);
    const std::string again = (folder_ / "again.envb").string();
    auto arguments = bake_arguments({"--force"});
    arguments[5] = again;
    ASSERT_EQ(envbake(arguments).status, 0);
    EXPECT_TRUE(read_file(again) == content);
}

TEST_F(Commands, ThreadCountDoesNotChangeAByte) {
    bake({"--threads", "1"});
    const std::string one = read_file(bundle_);
    for (const char* threads : {"2", "7"}) {
        bake({"--threads", threads, "--force"});
        EXPECT_TRUE(read_file(bundle_) == one) << threads;
    }
}

// Rays may go another way where they graze an edge, so it is another bake.
TEST_F(Commands, InstructionsOfTheRaysArePinned) {
    bake();
    const std::string best = (folder_ / "best.envb").string();
    std::filesystem::rename(bundle_, best);
    bake({"--isa", "sse4.2"});
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    EXPECT_EQ(dump()["metadata"]["options"]["isa"], "sse4.2");
    const json difference = json::parse(envbake({"diff", best, bundle_, "--json"}).out);
    EXPECT_GE(difference["metadata"].size(), 2u) << difference;  // the option and a key
    bool option = false, key = false;
    for (const json& entry : difference["metadata"]) {
        const auto path = entry["path"].get<std::string>();
        option |= path == "/options/isa";
        key |= path.starts_with("/plan/") && path.ends_with("/key");
    }
    EXPECT_TRUE(option && key) << difference;
    for (const json& array : difference["arrays"]) EXPECT_LT(array["relative_rms"], 1e-2) << array;
    const Outcome wrong = envbake(bake_arguments({"--isa", "sse9"}));
    EXPECT_EQ(wrong.status, 2);
    EXPECT_NE(wrong.err.find("avx2"), std::string::npos) << wrong.err;
}

TEST_F(Commands, MemoryDoesNotChangeAByte) {
    bake({"--memory", "1GB"});
    const std::string rich = read_file(bundle_);
    bake({"--memory", "1kb", "--force"});
    EXPECT_TRUE(read_file(bundle_) == rich);
    EXPECT_EQ(envbake(bake_arguments({"--memory", "much"})).status, 2);
    EXPECT_EQ(envbake(bake_arguments({"--memory", "-1"})).status, 2);
}

TEST_F(Commands, BouncesAddLightAndAreTheSameOnAnyNumberOfThreads) {
    bake({"--bounces", "all", "--threads", "1"});
    const std::string all = read_file(bundle_);
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    json d = dump();
    EXPECT_GE(d["metadata"]["bounces"]["count"], 1);
    EXPECT_GT(d["metadata"]["bounces"]["points"], 0);
    EXPECT_EQ(d["metadata"]["options"]["bounces"], "all");
    bake({"--bounces", "all", "--threads", "2", "--force"});
    EXPECT_TRUE(read_file(bundle_) == all);
    const auto mean = [](const json& bundle) {
        for (const json& array : bundle["arrays"])
            if (array["name"] == "selftest/diffuse/value") return array["mean"].get<double>();
        return 0.0;
    };
    bake();
    const double direct = mean(dump());
    EXPECT_GT(mean(d), 1.001 * direct);
    EXPECT_FALSE(dump()["metadata"].contains("bounces"));
    bake({"--bounces", "1"});
    EXPECT_EQ(dump()["metadata"]["bounces"]["count"], 1);
    EXPECT_GT(mean(dump()), 1.001 * direct);
    EXPECT_LE(mean(dump()), 1.001 * mean(d));
    for (const char* bad : {"-1", "some", "1.5", ""})
        EXPECT_EQ(envbake(bake_arguments({"--bounces", bad})).status, 2) << bad;
    const Outcome plan = envbake({"plan", scene_, "--bounces", "all"});
    EXPECT_NE(plan.out.find("all of them"), std::string::npos) << plan.out;
}

TEST_F(Commands, GlossyTransportComesWithTheSameRays) {
    bake();
    const std::string without = (folder_ / "without.envb").string();
    fs::copy_file(bundle_, without);
    bake({"--glossy", "auto", "--threads", "1"});
    const std::string one = read_file(bundle_);
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    bake({"--glossy", "auto", "--threads", "2", "--memory", "1kb", "--force"});
    EXPECT_TRUE(read_file(bundle_) == one);

    const json d = dump();
    json mesh = d["metadata"]["meshes"][0];
    EXPECT_EQ(mesh["glossy"]["rays"], mesh["diffuse"]["rays"]);
    EXPECT_LT(mesh["glossy"]["error_rms"], 1e-2);
    EXPECT_EQ(d["metadata"]["brdf"]["ggx_lobe"]["exit_bands"], 5);
    const Outcome diff = envbake({"diff", without, bundle_});
    EXPECT_EQ(diff.out.find("mesh/0/diffuse:"), std::string::npos) << diff.out;
    EXPECT_NE(diff.out.find("mesh/0/glossy: only in the second"), std::string::npos);
    EXPECT_NE(diff.out.find("selftest/glossy/value: only in the second"), std::string::npos);

    const auto render = [&](const char* name, std::vector<std::string> more) {
        std::vector<std::string> arguments{
            "render", bundle_, scene_, "-o", (folder_ / name).string(), "--size", "32x24"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        EXPECT_EQ(envbake(arguments).status, 0);
        return read_file(folder_ / name);
    };
    EXPECT_TRUE(render("a.exr", {}) != render("b.exr", {"--split-sum"}));

    bake({"--glossy", "all", "--glossy-bands", "3", "--bands", "4", "--distribution", "both",
          "--bounces", "1", "--compress", "--encoding", "unorm8"});
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    for (const char* name : {"brdf/ggx_lobe/kernel", "brdf/beckmann_lobe/unoccluded",
                             "mesh/0/glossy", "selftest/glossy_beckmann/value"})
        EXPECT_EQ(envbake({"extract", bundle_, name, "-o", (folder_ / "x.npy").string()}).status, 0)
            << name;
    EXPECT_EQ(envbake(bake_arguments({"--glossy", "some"})).status, 2);
    EXPECT_EQ(envbake(bake_arguments({"--glossy-bands", "6"})).status, 2);
}

TEST_F(Commands, SurfacesSendLightIntoMetalByDirection) {
    scene_ = write_metal_below_clay(folder_.path(), "metal", 4).string();
    const auto bake_on = [&](const char* threads) {
        bake({"--glossy", "all", "--bounces", "all", "--threads", threads, "--force"});
        return read_file(bundle_);
    };
    const std::string one = bake_on("1");
    const Outcome valid = envbake({"validate", bundle_});  // by the self-test, too
    EXPECT_EQ(valid.status, 0) << valid.out;
    for (const char* threads : {"2", "7"}) EXPECT_TRUE(bake_on(threads) == one) << threads;

    const json d = dump();
    const json light = d["metadata"]["meshes"][1]["glossy"]["reflected"];
    const int bands = light["bands"];
    EXPECT_GE(bands, 2);
    EXPECT_LE(light["error_rms"], 1e-2);
    EXPECT_LE(light["error_rms"], d["metadata"]["meshes"][1]["glossy"]["error_rms"]);
    const json shape{29, bands * bands - 1, 25, 3};
    const json& arrays = d["arrays"];
    const auto array = std::find_if(arrays.begin(), arrays.end(), [](const json& entry) {
        return entry["name"] == "mesh/1/reflected";
    });
    ASSERT_NE(array, arrays.end());
    EXPECT_EQ((*array)["type"], "f16");
    EXPECT_EQ((*array)["shape"], shape);
    EXPECT_GT((*array)["max"], 0.1);
    EXPECT_NE(envbake({"dump", bundle_}).out.find("/reflected"), std::string::npos);

    const std::string npy = (folder_ / "x.npy").string();
    ASSERT_EQ(envbake({"extract", bundle_, "mesh/1/reflected", "-o", npy}).status, 0);
    const std::string bytes = read_file(npy);
    const std::string head = "'descr': '<f2', 'fortran_order': False, 'shape': (29, " +
                             std::to_string(bands * bands - 1) + ", 25, 3, )";
    EXPECT_NE(bytes.find(head), std::string::npos) << bytes.substr(0, 128);

    // Of one bounce, in fewer bands, of another lobe, compressed: the self-test still agrees.
    bake({"--glossy", "all", "--bounces", "1", "--glossy-bands", "3", "--bands", "3",
          "--distribution", "both", "--compress", "--encoding", "unorm8"});
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    EXPECT_EQ(envbake({"extract", bundle_, "mesh/1/reflected", "-o", npy}).status, 0);
    EXPECT_NE(read_file(npy).find(", 9, 3, )"), std::string::npos);

    // Of few rays the error is stated, too: here some 0.5 %.
    bake({"--glossy", "all", "--bounces", "all", "--rays", "64"});
    const json few = dump()["metadata"]["meshes"][1]["glossy"]["reflected"];
    EXPECT_GT(few["error_rms"], 1e-3);
    EXPECT_LT(few["error_rms"], few["error_p999"]);

    // Without bounces surfaces send nothing.
    bake({"--glossy", "all"});
    EXPECT_EQ(envbake({"extract", bundle_, "mesh/1/reflected", "-o", npy}).status, 2);
}

TEST_F(Commands, WaveletsAreBakedAskedAboutAndShownWithHardShadows) {
    write_small_scene(folder_.path(), "scene", 24);
    bake({"--wavelet", "32", "--roughness-range", "0", "1", "--threads", "1"});
    const Outcome validated = envbake({"validate", bundle_});
    EXPECT_EQ(validated.status, 0) << validated.out;
    const std::string first = read_file(bundle_);
    const json dumped = dump();
    EXPECT_EQ(dumped["metadata"]["wavelet"]["face_size"], 32);
    EXPECT_GT(dumped["metadata"]["wavelet"]["light"]["terms"], 6);
    EXPECT_GT(dumped["metadata"]["environment"]["sh_shadow_loss"], 0.05);
    EXPECT_LE(dumped["metadata"]["arrays"]["environment/wavelet/value"]["error"], 2e-2);
    std::set<std::string> names;
    for (const json& array : dumped["arrays"]) names.insert(array["name"].get<std::string>());
    for (const char* name :
         {"environment/wavelet/index", "environment/wavelet/value", "wavelet/weight",
          "mesh/0/wavelet/blocks", "mesh/0/wavelet/offsets", "selftest/wavelet/value"})
        EXPECT_TRUE(names.contains(name)) << name;
    bake({"--wavelet", "32", "--roughness-range", "0", "1", "--threads", "2", "--memory", "1",
          "--force"});
    EXPECT_EQ(read_file(bundle_), first);

    for (const auto& more : {std::vector<std::string>{}, {"--rotate-light", "90"}}) {
        std::vector<double> errors;
        for (const char* basis : {"sh", "wavelet"}) {
            std::vector<std::string> arguments{
                "render", bundle_,   scene_,    "-o",          (folder_ / "x.exr").string(),
                "--size", "64x48",   "--white", "--reference", "--env",
                sky_,     "--basis", basis,     "--quiet",     "--reference-samples",
                "128"};
            arguments.insert(arguments.end(), more.begin(), more.end());
            const Outcome outcome = envbake(arguments);
            ASSERT_EQ(outcome.status, 0) << outcome.err;
            const std::string text = "relative RMSE ";
            errors.push_back(std::stod(outcome.out.substr(outcome.out.find(text) + text.size())));
        }
        EXPECT_LT(errors[1], 0.75 * errors[0]);
    }
}

TEST_F(Commands, WaveletsThatAreNotThereAreRefused) {
    bake();
    const Outcome outcome = envbake({"render", bundle_, scene_, "-o", (folder_ / "x.png").string(),
                                     "--basis", "wavelet", "--quiet"});
    EXPECT_EQ(outcome.status, 4);
    EXPECT_NE(outcome.err.find("--wavelet"), std::string::npos) << outcome.err;
    EXPECT_EQ(envbake(bake_arguments({"--wavelet", "48"})).status, 2);
}

TEST_F(Commands, WhatIsUpToDateIsLeftAlone) {
    bake();
    const auto time = fs::last_write_time(bundle_);
    const Outcome again = envbake(bake_arguments());
    EXPECT_EQ(again.status, 0);
    EXPECT_NE(again.err.find("up to date"), std::string::npos);
    EXPECT_EQ(fs::last_write_time(bundle_), time);
    const Outcome plan = envbake({"plan", scene_, "--env", sky_, "-o", bundle_, "--mip-size", "16",
                                  "--mip-count", "3", "--table-size", "16", "--json"});
    EXPECT_EQ(json::parse(plan.out)["up_to_date"], true);
}

TEST_F(Commands, AChangedInputOrOptionIsBakedAgain) {
    bake();
    const std::string before = read_file(bundle_);
    write_small_sky(sky_, 3);
    bake();
    const std::string other_sky = read_file(bundle_);
    EXPECT_TRUE(other_sky != before);
    bake({"--bands", "3"});
    EXPECT_TRUE(read_file(bundle_) != other_sky);
    EXPECT_EQ(dump()["metadata"]["options"]["bands"], 3);
    write_small_scene(folder_.path(), "scene", 5);  // the .bin changes as well
    bake({"--bands", "3"});
    EXPECT_EQ(dump()["metadata"]["meshes"][0]["vertex_count"], 40);
}

TEST_F(Commands, MeshesMayBeMarked) {
    bake({"--no-cast", "floor and roof"});
    json d = dump();
    EXPECT_EQ(d["metadata"]["meshes"][0]["casts"], false);
    EXPECT_EQ(d["metadata"]["meshes"][0]["diffuse"]["free"], 29) << "the roof shades nothing";
    bake({"--no-receive", "box", "--no-receive", "mesh/0"});
    d = dump();
    EXPECT_EQ(d["metadata"]["meshes"][0]["receives"], false);
    EXPECT_FALSE(d["metadata"]["meshes"][0].contains("diffuse"));
    for (const json& array : d["arrays"]) EXPECT_NE(array["name"], "mesh/0/diffuse");
    const Outcome plan = envbake({"plan", scene_, "--no-receive", "box"});
    EXPECT_NE(plan.out.find("marked as receiving nothing"), std::string::npos) << plan.out;
    bake();
    d = dump();
    EXPECT_LT(d["metadata"]["meshes"][0]["diffuse"]["free"], 29);
    EXPECT_FALSE(d["metadata"]["meshes"][0].contains("casts"));
    for (const char* option : {"--no-cast", "--no-receive"}) {
        const Outcome unknown = envbake(bake_arguments({"--force", option, "roof"}));
        EXPECT_EQ(unknown.status, 2);
        EXPECT_NE(unknown.err.find("\"roof\""), std::string::npos) << unknown.err;
        EXPECT_EQ(envbake({"bake", "--env", sky_, "-o", bundle_, option, "box"}).status, 2);
    }
}

TEST_F(Commands, PartsOfTheInputMayBeMissing) {
    ASSERT_EQ(envbake({"bake", "--env", sky_, "-o", bundle_, "--mip-size", "16"}).status, 0);
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    ASSERT_EQ(envbake({"bake", scene_, "-o", bundle_}).status, 0);
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    const json d = dump();
    for (const json& array : d["arrays"]) EXPECT_NE(array["name"], "environment/sh");
}

TEST_F(Commands, AFailedBakeLeavesTheOldFile) {
    bake();
    const std::string before = read_file(bundle_);
    write_file(sky_, "#?RADIANCE\nno picture\n");
    const Outcome outcome = envbake(bake_arguments());
    EXPECT_EQ(outcome.status, 3);
    EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
    EXPECT_NE(outcome.err.find("sky.hdr"), std::string::npos);
    EXPECT_TRUE(read_file(bundle_) == before);
}

TEST_F(Commands, AnOutputIsNeverAnInputOrADevice) {
    const std::vector<std::string> inputs{scene_, sky_, (folder_ / "scene.bin").string()};
    for (const std::string& input : inputs) {
        const std::string before = read_file(input);
        auto arguments = bake_arguments();
        arguments[5] = input;
        const Outcome outcome = envbake(arguments);
        EXPECT_EQ(outcome.status, 2) << outcome.err;
        EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
        EXPECT_TRUE(read_file(input) == before) << input;
    }
    auto arguments = bake_arguments();
    arguments[5] = "/dev/null";
    EXPECT_EQ(envbake(arguments).status, 2);
    EXPECT_TRUE(fs::is_character_file("/dev/null"));
    arguments[5] = folder_.path().string();
    EXPECT_EQ(envbake(arguments).status, 2);
}

TEST_F(Commands, ALinkedOutputReplacesTheFileBehindTheLink) {
    fs::create_directory(folder_ / "elsewhere");
    const fs::path target = folder_ / "elsewhere" / "real.envb";
    write_file(target, "old");
    fs::create_symlink(target, bundle_);
    bake();
    EXPECT_TRUE(fs::is_symlink(bundle_));
    EXPECT_EQ(envbake({"validate", target.string()}).status, 0);
}

TEST_F(Commands, ADamagedBundleIsNotUpToDate) {
    bake();
    const std::string good = read_file(bundle_);
    std::string damaged = good;
    damaged[100] = static_cast<char>(damaged[100] ^ 1);
    write_file(bundle_, damaged);
    bake();
    EXPECT_TRUE(read_file(bundle_) == good);
}

TEST_F(Commands, LightBeyondTheRangeOfFloatsIsRefused) {
    std::string picture = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 4\n";
    for (int i = 0; i < 4; ++i) picture += "\xff\xff\xff\xff";
    write_file(sky_, picture);
    const Outcome outcome = envbake(bake_arguments());
    EXPECT_EQ(outcome.status, 3);
    EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
    EXPECT_FALSE(fs::exists(bundle_));
}

TEST_F(Commands, AnImageInPlaceOfAScenePointsToTheOption) {
    const Outcome outcome = envbake({"bake", sky_, "-o", bundle_});
    EXPECT_EQ(outcome.status, 2);
    EXPECT_NE(outcome.err.find("--env"), std::string::npos) << outcome.err;
}

TEST_F(Commands, OutputThatGoesNowhereIsAFailure) {
    bake();
    const auto shell = [&](const std::string& redirection) {
        return std::system(("'" + fs::read_symlink("/proc/self/exe").parent_path().string() +
                            "/envbake' dump '" + bundle_ + "' " + redirection)
                               .c_str());
    };
    EXPECT_EQ(shell("> /dev/null"), 0);
    EXPECT_NE(shell("> /dev/full 2> /dev/null"), 0);
}

TEST_F(Commands, FileNamesMayBeNoUtf8) {
    const std::string odd = (folder_ / "sky\xff.hdr").string();
    fs::rename(sky_, odd);
    sky_ = odd;
    bake();
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    EXPECT_EQ(dump()["metadata"]["inputs"][2]["name"], "sky\xef\xbf\xbd.hdr");
    EXPECT_NE(envbake(bake_arguments()).err.find("up to date"), std::string::npos);
}

TEST_F(Commands, AFolderThatCannotBeWrittenToIsOne) {
    auto arguments = bake_arguments();
    arguments[5] = (folder_ / "absent" / "x.envb").string();
    const Outcome outcome = envbake(arguments);
    EXPECT_EQ(outcome.status, 1);
    EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
    EXPECT_EQ(envbake({"dump", (folder_ / "absent.envb").string()}).status, 1);
}

/// The part of JSON Schema that docs/validate.schema.json uses: type, properties, required, items.
bool fits(const nlohmann::json& value, const nlohmann::json& schema) {
    const std::string type = schema.at("type");
    if (type == "boolean") return value.is_boolean();
    if (type == "integer") return value.is_number_integer();
    if (type == "string") return value.is_string();
    if (type == "array")
        return value.is_array() && std::all_of(value.begin(), value.end(), [&](const auto& item) {
                   return fits(item, schema.at("items"));
               });
    if (type != "object" || !value.is_object()) return false;
    for (const auto& key : schema.at("required"))
        if (!value.contains(key.get<std::string>())) return false;
    for (const auto& [key, member] : value.items())
        if (!schema.at("properties").contains(key) ||
            !fits(member, schema.at("properties").at(key)))
            return false;
    return true;
}

TEST_F(Commands, ProgressAsJsonIsOneObjectALine) {
    const Outcome outcome = envbake(bake_arguments({"--progress", "json"}));
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    std::istringstream lines(outcome.err);
    json last;
    for (std::string line; std::getline(lines, line);)
        if (line.starts_with('{')) last = json::parse(line);
    ASSERT_FALSE(last.is_null()) << outcome.err;
    EXPECT_EQ(last["stage"], "diffuse transport");
    EXPECT_EQ(last["unit"], "vertices");
    EXPECT_EQ(last["total"], 29);
    EXPECT_EQ(last["done"], last["total"]);
    EXPECT_EQ(last["rays"], dump()["metadata"]["meshes"][0]["diffuse"]["rays"]);
    // The bundle states the same, with two standard errors more.
    const double stated = dump()["metadata"]["meshes"][0]["diffuse"]["error_rms"];
    EXPECT_LT(last["error"], stated);
    EXPECT_GT(last["error"], stated / 4);
    EXPECT_GT(last["seconds"], 0);
    EXPECT_EQ(last["seconds_left"], 0);
    EXPECT_EQ(envbake(bake_arguments({"--force", "--quiet", "--progress", "json"})).err, "");
    EXPECT_EQ(envbake(bake_arguments({"--progress", "bar"})).status, 2);
}

// That the time is met is a matter of the machine; that it is traded for error is not.
TEST_F(Commands, ATimeBudgetEndsInAValidBundleThatStatesItsError) {
    const Outcome outcome =
        envbake(bake_arguments({"--tolerance", "1e-5", "--time-budget", "1e-6"}));
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_NE(outcome.err.find("mesh/*/diffuse: error "), std::string::npos) << outcome.err;
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    const json hurried = dump()["metadata"];
    EXPECT_EQ(hurried["options"]["time_budget"], 1e-6);
    const json of_mesh = hurried["meshes"][0]["diffuse"];
    EXPECT_LT(of_mesh["rays_per_vertex"], 256) << "fewer than the first look";
    EXPECT_GT(of_mesh["error_rms"], 1e-3);

    // Whatever transport waits for: it gets the fewest rays a vertex that a budget leaves.
    const auto rays = [&](std::vector<std::string> more) {
        more.insert(more.end(), {"--tolerance", "1e-4", "--time-budget", "1e-6", "--force"});
        EXPECT_EQ(envbake(bake_arguments(more)).status, 0);
        return dump()["metadata"]["meshes"][0]["diffuse"]["rays_per_vertex"].get<int>();
    };
    EXPECT_EQ(rays({"--encoding", "unorm8"}), rays({}));
    bake({"--time-budget", "100000"});
    EXPECT_LE(dump()["metadata"]["meshes"][0]["diffuse"]["error_rms"], 1e-2);
    EXPECT_EQ(envbake(bake_arguments({"--time-budget", "1", "--rays", "64"})).status, 2);
    EXPECT_EQ(envbake(bake_arguments({"--time-budget", "-1"})).status, 2);
}

TEST_F(Commands, ValidateSpeaksByItsSchema) {
    const auto schema = nlohmann::json::parse(read_file(ENVBAKE_VALIDATE_SCHEMA));
    bake();
    const auto good = nlohmann::json::parse(envbake({"validate", bundle_, "--json"}).out);
    EXPECT_TRUE(fits(good, schema)) << good;
    EXPECT_EQ(good.at("valid"), true);
    std::string content = read_file(bundle_);
    content[64] = static_cast<char>(content[64] ^ 1);
    write_file(bundle_, content);
    auto bad = nlohmann::json::parse(envbake({"validate", bundle_, "--json"}).out);
    EXPECT_TRUE(fits(bad, schema)) << bad;
    EXPECT_EQ(bad.at("valid"), false);
    ASSERT_EQ(bad.at("findings").size(), 1u);
    EXPECT_EQ(bad.at("findings")[0].at("code"), 30);
    bad.at("findings")[0].erase("code");
    EXPECT_FALSE(fits(bad, schema));
}

TEST_F(Commands, DamagedBundlesAreFour) {
    bake();
    std::string content = read_file(bundle_);
    content[64] = static_cast<char>(content[64] ^ 1);  // of the first array
    write_file(bundle_, content);
    EXPECT_EQ(envbake({"validate", bundle_}).status, 4);
    EXPECT_EQ(envbake({"dump", bundle_}).status, 4);
    write_file(bundle_, content.substr(0, 100));
    for (const char* command : {"validate", "dump"}) {
        const Outcome outcome = envbake({command, bundle_});
        EXPECT_EQ(outcome.status, 4) << command;
        EXPECT_EQ(outcome.err_lines() + std::count(outcome.out.begin(), outcome.out.end(), '\n'),
                  1);
    }
    write_file(bundle_, "no bundle");
    EXPECT_EQ(envbake({"render", bundle_, scene_, "-o", (folder_ / "x.png").string()}).status, 4);
}

TEST_F(Commands, CompressionChangesTheSizeAndNoValue) {
    bake();
    const std::string plain = bundle_;
    bundle_ = (folder_ / "packed.envb").string();
    bake({"--compress"});
    EXPECT_LT(fs::file_size(bundle_), fs::file_size(plain));
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    const json difference = json::parse(envbake({"diff", plain, bundle_, "--json"}).out);
    for (const json& array : difference["arrays"]) EXPECT_EQ(array["name"], "metadata");
}

TEST_F(Commands, AConstantGreySkyIsAFewNumbers) {
    write_file(sky_, radiance_bytes(32, 16, std::vector<float>(32 * 16 * 3, 3.0f)));
    bake();
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    const json d = dump();
    for (const json& array : d["arrays"]) {
        const std::string name = array["name"];
        if (name == "environment/sh") {
            EXPECT_EQ(array["shape"], json({1, 1}));
        } else if (name.rfind("environment/mips/", 0) == 0) {
            EXPECT_EQ(array["shape"], json({6, 1, 1, 1}));
            EXPECT_EQ(array["min"], 3);
            EXPECT_EQ(array["max"], 3);
        }
        EXPECT_NE(name, "environment/lights");
    }
    const Outcome plan = envbake({"plan", "--env", sky_});
    for (const char* reason : {"1 of 5 bands", "grey: one channel", "one texel a level",
                               "no light is small and stands out"})
        EXPECT_NE(plan.out.find(reason), std::string::npos) << reason << "\n" << plan.out;
}

TEST_F(Commands, ACertifiedBakeStatesProvedErrorsBelowTheTolerance) {
    bake({"--certify", "--tolerance", "0.02"});
    EXPECT_EQ(envbake({"validate", bundle_}).status, 0);
    const json d = dump();
    int mips = 0;
    for (const auto& [name, array] : d["metadata"]["arrays"].items()) {
        if (name.rfind("environment/mips/", 0) != 0) continue;
        EXPECT_LE(array["error"], 0.02) << name;
        EXPECT_EQ(std::string(array["norm"]).rfind("proved", 0), 0u) << name;
        ++mips;
    }
    EXPECT_GE(mips, 1);
}

TEST_F(Commands, EveryLightingOptionMakesAValidBundle) {
    const std::vector<std::vector<std::string>> options{
        {"--distribution", "beckmann"},
        {"--distribution", "both", "--half-tables", "--table-axes", "linear"},
        {"--mip-layout", "lat-long", "--compress"},
        {"--irradiance", "--window", "--extract-lights"},
        {"--roughness-range", "0.1", "0.4"}};
    for (const auto& more : options) {
        bake(more);
        const Outcome valid = envbake({"validate", bundle_});
        EXPECT_EQ(valid.status, 0) << more[0] << " " << valid.out;
        EXPECT_EQ(envbake({"dump", bundle_}).status, 0) << more[0];
        EXPECT_NE(envbake(bake_arguments(more)).err.find("up to date"), std::string::npos);
    }
    EXPECT_EQ(envbake(bake_arguments({"--distribution", "phong"})).status, 2);
    EXPECT_EQ(envbake(bake_arguments({"--roughness-range", "0.5", "0.4"})).status, 2);
    EXPECT_EQ(envbake(bake_arguments({"--roughness-range", "0.5"})).status, 2);
}

// Lights and remainder are the environment: SH loses E Y(w) of the light, by band 0 exactly.
TEST_F(Commands, ExtractedLightsAndTheRestAreTheEnvironment) {
    // A blue sky that no band of SH is without.
    std::vector<float> rgb;
    for (std::size_t texel = 0; texel < 128 * 64; ++texel) {
        const float level = texel < 20 * 128 ? 4.0f : 1.0f;
        rgb.insert(rgb.end(), {level, level, 2 * level});
    }
    for (const std::size_t texel : {20u * 128 + 70, 20u * 128 + 71, 21u * 128 + 70})
        for (std::size_t c = 0; c < 3; ++c) rgb[texel * 3 + c] = 256 * (c < 2 ? 200 : 180);
    write_file(sky_, radiance_bytes(128, 64, rgb));
    const auto values = [&](const char* name) {
        const std::string file = (folder_ / "values.json").string();
        EXPECT_EQ(envbake({"extract", bundle_, name, "-o", file}).status, 0);
        return json::parse(read_file(file))["values"].get<std::vector<double>>();
    };
    bake();
    const auto whole = values("environment/sh"), light = values("environment/lights");
    EXPECT_EQ(dump()["metadata"]["environment"]["lights"]["extracted"], false);
    bake({"--extract-lights"});
    const auto rest = values("environment/sh");
    EXPECT_EQ(dump()["metadata"]["environment"]["lights"]["extracted"], true);
    EXPECT_EQ(values("environment/lights"), light);
    ASSERT_EQ(light.size(), 9u);
    ASSERT_EQ(rest.size(), whole.size());
    for (std::size_t c = 0; c < 3; ++c) {
        const double y00 = 0.28209479177, y1 = 0.48860251190;
        EXPECT_NEAR((whole[c] - rest[c]) / (light[3 + c] * y00), 1, 1e-6);
        for (const auto& [slot, axis] : {std::pair{1, 1}, {2, 2}, {3, 0}}) {  // (y, z, x)
            const auto i = static_cast<std::size_t>(3 * slot) + c;
            EXPECT_NEAR(whole[i] - rest[i],
                        light[3 + c] * y1 * light[static_cast<std::size_t>(axis)],
                        2e-3 * light[3 + c]);
        }
    }
}

TEST_F(Commands, DiffSaysWhatAndHowMuch) {
    bake();
    const std::string other = (folder_ / "other.envb").string();
    fs::copy_file(bundle_, other);
    const Outcome same = envbake({"diff", bundle_, other});
    EXPECT_EQ(same.status, 0);
    EXPECT_EQ(same.out, "no difference\n");
    write_small_sky(sky_, 3);
    bake();
    const Outcome differs = envbake({"diff", bundle_, other, "--json"});
    EXPECT_EQ(differs.status, 4);
    const json d = json::parse(differs.out);
    EXPECT_EQ(d["same"], false);
    bool sh = false;
    for (const json& array : d["arrays"]) {
        EXPECT_NE(array["name"], "mesh/0/diffuse")
            << "transport does not depend on the environment";
        sh |= array["name"] == "environment/sh" && array["max"] > 1;
    }
    EXPECT_TRUE(sh) << d.dump(1);
}

TEST_F(Commands, ExtractWritesEveryKind) {
    bake();
    const auto extract = [&](const char* name, const char* file) {
        return envbake({"extract", bundle_, name, "-o", (folder_ / file).string()});
    };
    ASSERT_EQ(extract("environment/sh", "sh.npy").status, 0);
    const std::string npy = read_file(folder_ / "sh.npy");
    EXPECT_EQ(npy.substr(1, 5), "NUMPY");
    EXPECT_NE(npy.find("'descr': '<f4', 'fortran_order': False, 'shape': (25, 3, )"),
              std::string::npos);
    EXPECT_EQ(npy.size() % 64, 300u % 64);
    ASSERT_EQ(extract("environment/sh", "sh.json").status, 0);
    const json sh = json::parse(read_file(folder_ / "sh.json"));
    EXPECT_EQ(sh["shape"], json({25, 3}));
    float first = 0;
    std::memcpy(&first, npy.data() + npy.size() - 300, 4);
    EXPECT_FLOAT_EQ(sh["values"][0].get<float>(), first);
    ASSERT_EQ(extract("metadata", "m.json").status, 0);
    EXPECT_EQ(json::parse(read_file(folder_ / "m.json"))["tool"]["name"], "envbake");
    ASSERT_EQ(extract("environment/mips/1", "mip.exr").status, 0);
    EXPECT_EQ(read_file(folder_ / "mip.exr").substr(0, 4), "\x76\x2f\x31\x01");
    EXPECT_EQ(extract("environment/sh", "sh.exr").status, 2) << "no image";
    EXPECT_EQ(extract("environment/nothing", "x.npy").status, 2);
    EXPECT_EQ(extract("environment/sh", "sh.txt").status, 2);
}

TEST_F(Commands, ExtractDoesNotReplaceItsBundle) {
    bake();
    const std::string json_named = (folder_ / "bundle.json").string();
    fs::rename(bundle_, json_named);
    const std::string before = read_file(json_named);
    EXPECT_EQ(envbake({"extract", json_named, "metadata", "-o", json_named}).status, 2);
    EXPECT_TRUE(read_file(json_named) == before);
}

TEST_F(Commands, AnExtractedMipIsAnEnvironmentAgain) {
    bake();
    const std::string mip = (folder_ / "mip.exr").string(),
                      second = (folder_ / "second.envb").string();
    ASSERT_EQ(envbake({"extract", bundle_, "environment/mips/1", "-o", mip}).status, 0);
    ASSERT_EQ(
        envbake({"bake", "--env", mip, "-o", second, "--mip-size", "4", "--mip-count", "2"}).status,
        0);
    const json d = json::parse(envbake({"dump", second, "--json"}).out);
    EXPECT_EQ(d["metadata"]["environment"]["mapping"], "cube");
}

/// The sun stands towards +X, 39 degrees from straight up, so the roof at 1 m throws its shadow
/// towards -X: there the floor is darker than at the same distance on the other side.
TEST_F(Commands, ShadowsFallAwayFromTheSun) {
    write_small_scene(folder_.path(), "scene", 8);
    bake();
    const auto values = [&](const char* name) {
        const std::string file = (folder_ / "values.json").string();
        EXPECT_EQ(envbake({"extract", bundle_, name, "-o", file}).status, 0);
        return json::parse(read_file(file))["values"].get<std::vector<double>>();
    };
    const auto sh = values("environment/sh"), transport = values("mesh/0/diffuse");
    const auto exit_radiance = [&](double x, double z) {  // of the floor's vertex there, green
        const auto vertex = static_cast<std::size_t>((z + 2) / 0.5 * 9 + (x + 2) / 0.5);
        double sum = 0;
        for (std::size_t i = 0; i < 25; ++i) sum += transport[25 * vertex + i] * sh[3 * i + 1];
        return sum;
    };
    EXPECT_LT(exit_radiance(-1, 0), 0.6 * exit_radiance(1, 0));
    EXPECT_NEAR(exit_radiance(0.5, -1), exit_radiance(0.5, 1), 0.15 * exit_radiance(0.5, 1))
        << "nearly alike on the sun's left and right";
}

TEST_F(Commands, RenderWritesThePictureAndItsComparison) {
    bake();
    const std::string picture = (folder_ / "x.png").string();
    const Outcome outcome =
        envbake({"render", bundle_, scene_, "-o", picture, "--size", "48x32", "--reference",
                 "--env", sky_, "--reference-samples", "16", "--white"});
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    for (const char* name : {"x.png", "x.reference.png", "x.difference.png"})
        EXPECT_EQ(read_file(folder_ / name).substr(1, 3), "PNG") << name;
    EXPECT_NE(outcome.out.find("relative RMSE"), std::string::npos);
    EXPECT_NE(outcome.out.find("in 5 bands"), std::string::npos);
    ASSERT_EQ(envbake({"render", bundle_, scene_, "-o", (folder_ / "x.exr").string(), "--size",
                       "16x16", "--camera", "3,3,3", "--look-at", "0,0,0", "--fov", "50"})
                  .status,
              0);
    EXPECT_EQ(envbake({"render", bundle_, scene_, "-o", picture, "--reference"}).status, 2);
    EXPECT_EQ(envbake({"render", bundle_, scene_, "-o", (folder_ / "x.bmp").string()}).status, 2);
}

TEST_F(Commands, RenderRefusesAnotherScene) {
    bake();
    const std::string other = write_small_scene(folder_.path(), "other", 5).string();
    const Outcome outcome = envbake({"render", bundle_, other, "-o", (folder_ / "x.png").string()});
    EXPECT_EQ(outcome.status, 4);
    EXPECT_NE(outcome.err.find("another scene"), std::string::npos);
}

}  // namespace
}  // namespace envbake::test
