// SPDX-License-Identifier: Apache-2.0
//
// envbake-sample OUT_DIR [--overcast] [--size WxH] [--sun-elevation DEG] [--sun-azimuth DEG]
// writes OUT_DIR/sky.hdr and OUT_DIR/scene.glb: something to bake before anything was downloaded.
#include "rgbe.h"
#include "scene.h"
#include "sky.h"

#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string_view>
#include <system_error>

namespace {

constexpr std::string_view kUsage =
    "usage: envbake-sample OUT_DIR [options]\n"
    "Writes OUT_DIR/sky.hdr and OUT_DIR/scene.glb.\n"
    "  --overcast            the CIE overcast sky instead of a clear one with a sun\n"
    "  --size WxH            size of the sky, texels (default 1024x512)\n"
    "  --sun-elevation DEG   above the horizon, 1 to 90 (default 36)\n"
    "  --sun-azimuth DEG     about +Y, 0 at +X, 90 at +Z (default 140)\n";

constexpr int kFailed = 1, kWrongUsage = 2;

template <class Number>
bool parse(std::string_view text, Number& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc{} && end == text.data() + text.size();
}

bool write(const std::filesystem::path& file, const std::string& bytes) {
    std::ofstream out(file, std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.close();
    if (out) return true;
    std::cerr << "envbake-sample: " << file.string() << ": cannot be written\n";
    return false;
}

}  // namespace

int main(int argc, char** argv) {
    namespace sample = envbake::sample;
    sample::SkyOptions sky;
    std::filesystem::path folder;
    for (int i = 1; i < argc; ++i) {
        const std::string_view argument = argv[i];
        const std::string_view value = i + 1 < argc ? argv[i + 1] : "";
        const auto refuse = [&](std::string_view wanted) {
            std::cerr << "envbake-sample: " << argument << " '" << value << "': expected " << wanted
                      << "\n";
            return kWrongUsage;
        };
        if (argument == "--help" || argument == "-h") {
            std::cout << kUsage;
            return EXIT_SUCCESS;
        } else if (argument == "--overcast") {
            sky.overcast = true;
        } else if (argument == "--size") {
            const std::size_t x = value.find('x');
            if (x == std::string_view::npos || !parse(value.substr(0, x), sky.width) ||
                !parse(value.substr(x + 1), sky.height) || sky.width < 1 || sky.height < 1 ||
                sky.width > 16384 || sky.height > 8192)
                return refuse("WIDTHxHEIGHT, 1x1 to 16384x8192");
            ++i;
        } else if (argument == "--sun-elevation") {
            if (!parse(value, sky.sun_elevation_deg) || !(sky.sun_elevation_deg >= 1) ||
                !(sky.sun_elevation_deg <= 90))
                return refuse("degrees from 1 to 90");
            ++i;
        } else if (argument == "--sun-azimuth") {
            if (!parse(value, sky.sun_azimuth_deg) || !(std::abs(sky.sun_azimuth_deg) <= 360))
                return refuse("degrees from -360 to 360");
            ++i;
        } else if (!argument.starts_with("-") && folder.empty()) {
            folder = argument;
        } else {
            std::cerr << "envbake-sample: '" << argument << "' is not understood\n" << kUsage;
            return kWrongUsage;
        }
    }
    if (folder.empty()) {
        std::cerr << kUsage;
        return kWrongUsage;
    }

    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) {
        std::cerr << "envbake-sample: " << folder.string() << ": " << error.message() << "\n";
        return kFailed;
    }
    const sample::Scene scene = sample::make_terrace();
    if (!write(folder / "sky.hdr", sample::encode_hdr(sample::make_sky(sky)))) return kFailed;
    if (!write(folder / "scene.glb", sample::encode_glb(scene))) return kFailed;

    std::size_t vertex_count = 0, triangle_count = 0;
    for (const sample::Node& node : scene.nodes) {
        const sample::Mesh& mesh = scene.meshes[static_cast<std::size_t>(node.mesh)].mesh;
        vertex_count += mesh.positions.size();
        triangle_count += mesh.triangles.size() / 3;
    }
    const sample::Vec3 sun = sample::sun_direction(sky);
    std::cout << (folder / "scene.glb").string() << "  " << vertex_count << " vertices, "
              << triangle_count << " triangles, " << scene.materials.size() << " materials\n"
              << (folder / "sky.hdr").string() << "  " << sky.width << " x " << sky.height;
    if (sky.overcast)
        std::cout << ", overcast\n";
    else
        std::cout << ", sun towards (" << sun.x << ", " << sun.y << ", " << sun.z << "), radiance "
                  << sample::sun_radiance(sky).y << "\n";
    return EXIT_SUCCESS;
}
