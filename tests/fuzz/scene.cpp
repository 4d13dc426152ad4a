// SPDX-License-Identifier: Apache-2.0
// Any bytes as a .glb or .gltf file: read, and what was read is whole: indices, materials,
// textures, numbers. Images are decoded by the worker, as in a bake.
#include "baker/input/read_scene.h"
#include "baker/input/sample_texture.h"
#include "tests/fuzz/file_in_memory.h"
#include "tests/fuzz/require.h"

#include <algorithm>
#include <cmath>

namespace {

using namespace envbake;
using envbake::fuzz::require;

void check(const Scene& scene, const Mesh& mesh) {
    const std::size_t count = mesh.vertex_count();
    require(mesh.normals.size() == count, "a normal for every vertex");
    require(mesh.uv0.empty() || mesh.uv0.size() == count, "a place in texture 0 for every vertex");
    require(mesh.uv1.empty() || mesh.uv1.size() == count, "a place in texture 1 for every vertex");
    require(mesh.colors.empty() || mesh.colors.size() == count, "a colour for every vertex");
    require(mesh.triangles.size() % 3 == 0, "three indices a triangle");
    for (const std::uint32_t index : mesh.triangles) require(index < count, "an index is a vertex");
    for (const Vec3& p : mesh.positions)
        require(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z), "finite positions");
    for (const Vec3& n : mesh.normals) {
        const float length = glm::length(n);
        require(length == 0 || std::abs(length - 1) < 1e-5f, "unit normals");
    }
    require(mesh.material >= 0 && static_cast<std::size_t>(mesh.material) < scene.materials.size(),
            "a material that exists");
    for (std::size_t t = 0; t < std::min<std::size_t>(mesh.triangle_count(), 8); ++t) {
        const SurfaceMaterial material = surface_material(scene, mesh, t, Vec3(0.25f, 0.25f, 0.5f));
        const Vec3 albedo = material.diffuse_albedo();
        for (int c = 0; c < 3; ++c)
            require(albedo[c] >= 0 && albedo[c] <= 1 && material.emission[c] >= 0,
                    "albedo within 0 .. 1, no negative light");
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const envbake::fuzz::FileInMemory file(data, size);
    const auto scene = read_scene(file.path());
    if (!scene) {
        require(scene.error().code != Errc::Failed, "an input that is at fault");
        require(scene.error().message.find('\n') == std::string::npos, "one line");
        return 0;
    }
    for (const Mesh& mesh : scene->meshes) check(*scene, mesh);
    return 0;
}
