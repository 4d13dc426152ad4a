// SPDX-License-Identifier: Apache-2.0
// Every damaged file ends in exit status 3, one line that names it, and no output.
#include "tests/support/image_files.h"
#include "tests/support/run_program.h"
#include "tests/support/test_data.h"

#include <set>

namespace envbake::test {
namespace {

namespace fs = std::filesystem;

/// Files that lie among the malformed ones and can be read all the same.
const std::set<std::string> kReadable{
    "exr/scanline_with_deeptiled_type.exr",   // the pixels are whole, only the type attribute lies
    "exr/tiled_with_deepscanline_type.exr",   // likewise
    "exr/tiled_with_scanlineimage_type.exr",  // likewise
    "geometry/degenerate_triangles.glb",      // valid
    "nonfinite_pixels.exr",                   // repaired
};

std::vector<std::string> files_below(const fs::path& folder) {
    std::vector<std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
        const auto extension = entry.path().extension();
        if (extension == ".exr" || extension == ".hdr" || extension == ".glb" ||
            extension == ".gltf")
            files.push_back(fs::relative(entry.path(), folder).string());
    }
    std::sort(files.begin(), files.end());
    return files;
}

std::vector<std::string> bake_arguments(const fs::path& file, const fs::path& output) {
    const auto extension = file.extension();
    std::vector<std::string> arguments{"bake"};
    if (extension == ".exr" || extension == ".hdr") arguments.emplace_back("--env");
    arguments.insert(arguments.end(),
                     {file.string(), "-o", output.string(), "--quiet", "--mip-size", "16",
                      "--mip-count", "3", "--table-size", "8"});
    return arguments;
}

TEST(MalformedFiles, EndInOneLineAndNoOutput) {
    ENVBAKE_REQUIRE_DATA("malformed");
    const TemporaryFolder folder;
    const auto files = files_below(data("malformed"));
    ASSERT_GT(files.size(), 150u);
    for (const std::string& name : files) {
        SCOPED_TRACE(name);
        const fs::path output = folder / "out.envb";
        const Outcome outcome = envbake(bake_arguments(data("malformed") / name, output));
        EXPECT_LT(outcome.peak_kilobytes, 2'000'000);
        if (kReadable.count(name) != 0) {
            EXPECT_EQ(outcome.status, 0) << outcome.err;
            EXPECT_EQ(envbake({"validate", output.string()}).status, 0);
            fs::remove(output);
            continue;
        }
        EXPECT_EQ(outcome.status, 3) << outcome.err;
        EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
        EXPECT_NE(outcome.err.find(fs::path(name).filename().string()), std::string::npos)
            << outcome.err;
        EXPECT_EQ(outcome.out, "");
        EXPECT_FALSE(fs::exists(output));
        EXPECT_TRUE(fs::is_empty(folder.path())) << "something was left behind";
    }
}

TEST(MalformedFiles, StrictRefusesWhatIsRepairedOtherwise) {
    ENVBAKE_REQUIRE_DATA("malformed/nonfinite_pixels.exr");
    const TemporaryFolder folder;
    auto arguments = bake_arguments(data("malformed/nonfinite_pixels.exr"), folder / "out.envb");
    arguments.emplace_back("--strict");
    const Outcome outcome = envbake(arguments);
    EXPECT_EQ(outcome.status, 3);
    EXPECT_EQ(outcome.err_lines(), 1) << outcome.err;
    EXPECT_FALSE(fs::exists(folder / "out.envb"));
}

}  // namespace
}  // namespace envbake::test
