// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "shapes.h"

#include <string>
#include <vector>

namespace envbake::sample {

struct Material {
    std::string name;
    Vec3 base_color{1, 1, 1};  ///< linear Rec. 709
    double metallic = 0;
    double perceptual_roughness = 1;
};

struct NamedMesh {
    std::string name;
    int material = 0;
    Mesh mesh;
};

/// Places a mesh: turned by `yaw_deg` about +Y, then moved.
struct Node {
    std::string name;
    int mesh = 0;
    Vec3 translation{};
    double yaw_deg = 0;
};

struct Scene {
    std::vector<Material> materials;
    std::vector<NamedMesh> meshes;
    std::vector<Node> nodes;
};

/// A round terrace, two steps up: a colonnade at the back, a golden trefoil knot on a pedestal, a
/// row of copper spheres from mirror to matt, lacquered boxes, a clay vase, a glazed ring. About
/// 60,000 vertices, closest together where shadows have edges. Made to be seen from the front
/// right, azimuth 55 degrees, and a little above.
Scene make_terrace();

/// The scene as a binary glTF 2.0 file.
std::string encode_glb(const Scene& scene);

}  // namespace envbake::sample
