// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/scene.h"

#include <cstddef>

namespace envbake {

/// A material at one surface point: textures and vertex colour multiplied in.
struct SurfaceMaterial {
    Vec3 base_color{1};  ///< linear
    float alpha = 1;
    float metallic = 0;
    float perceptual_roughness = 1;
    Vec3 r0{0.04f};  ///< mix(dielectric_r0, base_color, metallic)
    Vec3 emission{0};

    /// Albedo of the diffuse part: base_color (1 - metallic).
    Vec3 diffuse_albedo() const { return base_color * (1 - metallic); }
};

/// Bilinear, texel centres at (i + 1/2) / n, wrapped as the texture says; RGBA in [0, 1] as stored.
/// White where the image was not decoded. A coordinate that is not finite counts as 0.
Vec4 sample_texture(const Scene& scene, const Texture& texture, Vec2 uv);

/// The material of mesh `mesh` at barycentric (b0, b1, b2) of triangle `triangle`. Colour texels
/// are made linear before they are filtered. A UV set that the mesh lacks reads as (0, 0).
SurfaceMaterial surface_material(const Scene& scene, const Mesh& mesh, std::size_t triangle,
                                 const Vec3& barycentric);

/// Its alpha alone: what alpha mode MASK holds against the cut-off.
float surface_alpha(const Scene& scene, const Mesh& mesh, std::size_t triangle,
                    const Vec3& barycentric);

}  // namespace envbake
