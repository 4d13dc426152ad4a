// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/support/image_files.h"

#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

namespace envbake::test {

/// Writes `name`.gltf and `name`.bin: a 4 x 4 m floor of n x n squares facing up, and one square
/// metre of roof above its middle; a dielectric of perceptual roughness 0.5.
inline std::filesystem::path write_small_scene(const std::filesystem::path& folder,
                                               const std::string& name = "scene", int n = 4) {
    std::vector<float> positions;
    std::vector<std::uint32_t> indices;
    for (int z = 0; z <= n; ++z)
        for (int x = 0; x <= n; ++x)
            positions.insert(positions.end(),
                             {4.0f * static_cast<float>(x) / static_cast<float>(n) - 2, 0,
                              4.0f * static_cast<float>(z) / static_cast<float>(n) - 2});
    const auto add_square = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c,
                                std::uint32_t d) {
        indices.insert(indices.end(), {a, b, c, b, d, c});
    };
    for (int z = 0; z < n; ++z)
        for (int x = 0; x < n; ++x) {
            const auto a = static_cast<std::uint32_t>(z * (n + 1) + x);
            const auto row = static_cast<std::uint32_t>(n + 1);
            add_square(a, a + row, a + 1, a + row + 1);
        }
    const auto roof = static_cast<std::uint32_t>(positions.size() / 3);
    for (const float z : {-0.5f, 0.5f})
        for (const float x : {-0.5f, 0.5f}) positions.insert(positions.end(), {x, 1, z});
    add_square(roof, roof + 2, roof + 1, roof + 3);

    std::string bytes(positions.size() * 4 + indices.size() * 4, '\0');
    std::memcpy(bytes.data(), positions.data(), positions.size() * 4);
    std::memcpy(bytes.data() + positions.size() * 4, indices.data(), indices.size() * 4);
    write_file(folder / (name + ".bin"), bytes);
    const auto text = [](std::size_t number) { return std::to_string(number); };
    write_file(folder / (name + ".gltf"),
               R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"name":"floor and roof","mesh":0}],
"materials":[{"name":"clay","pbrMetallicRoughness":{"metallicFactor":0,"roughnessFactor":0.5}}],
"meshes":[{"name":"box","primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]}],
"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":)" +
                   text(positions.size() / 3) + R"(,"min":[-2,0,-2],"max":[2,1,2]},
{"bufferView":1,"componentType":5125,"type":"SCALAR","count":)" +
                   text(indices.size()) + R"(}],
"bufferViews":[{"buffer":0,"byteLength":)" +
                   text(positions.size() * 4) + R"(},{"buffer":0,"byteOffset":)" +
                   text(positions.size() * 4) + R"(,"byteLength":)" + text(indices.size() * 4) +
                   R"(}],
"buffers":[{"uri":")" +
                   name + R"(.bin","byteLength":)" + text(bytes.size()) + "}]}");
    return folder / (name + ".gltf");
}

/// The small scene, and itself once more above it.
///   material  members of the material: R"("doubleSided":true,)"
inline std::filesystem::path write_two_meshes(const std::filesystem::path& folder,
                                              const std::string& name, int n,
                                              const std::string& material) {
    const std::filesystem::path file = write_small_scene(folder, name, n);
    std::string text = read_file(file);
    const auto replace = [&](const std::string& from, const std::string& to) {
        text.replace(text.find(from), from.size(), to);
    };
    replace(R"("scenes":[{"nodes":[0]}])", R"("scenes":[{"nodes":[0,1]}])");
    replace(R"("nodes":[{)", R"("nodes":[{"mesh":0,"name":"above","translation":[0.5,2,0]},{)");
    replace(R"({"name":"clay",)", R"({"name":"clay",)" + material);
    write_file(file, text);
    return file;
}

/// The small scene of metal, mesh 1 of the bake, and above it itself once more of bright yellow
/// clay, mesh 0: what surfaces send into the metal differs by direction.
inline std::filesystem::path write_metal_below_clay(const std::filesystem::path& folder,
                                                    const std::string& name, int n) {
    const std::string colour = R"("pbrMetallicRoughness":{"baseColorFactor":[0.9,0.6,0.3,1],)";
    const std::filesystem::path file = write_two_meshes(folder, name, n, R"("doubleSided":true,)");
    std::string text = read_file(file);
    const auto replace = [&](const std::string& from, const std::string& to) {
        text.replace(text.find(from), from.size(), to);
    };
    replace(R"("nodes":[{"mesh":0,)", R"("nodes":[{"mesh":1,)");
    replace(R"("pbrMetallicRoughness":{)", colour);
    replace(R"("materials":[)", R"("materials":[{"name":"metal","doubleSided":true,
"pbrMetallicRoughness":{"metallicFactor":1,"roughnessFactor":0.5}},)");
    replace(R"("material":0}]})", R"("material":0}]},
{"name":"clay box","primitives":[{"attributes":{"POSITION":0},"indices":1,"material":1}]})");
    write_file(file, text);
    return file;
}

/// Writes a 32 x 16 grey sky with a bright, yellowish texel high in the +X half. `level` is a whole
/// number of 1 to 255, but not 2: a row that begins with 2, 2 would be read as run-length encoded.
inline std::filesystem::path write_small_sky(const std::filesystem::path& file, float level = 1) {
    std::vector<float> rgb(32 * 16 * 3, level);
    for (std::size_t c = 0; c < 3; ++c) rgb[(3 * 32 + 16) * 3 + c] = 256 * (c < 2 ? 200 : 180);
    write_file(file, radiance_bytes(32, 16, rgb));
    return file;
}

}  // namespace envbake::test
