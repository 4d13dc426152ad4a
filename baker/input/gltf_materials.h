// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/input/gltf_asset.h"
#include "baker/input/scene.h"

#include <string>
#include <vector>

namespace envbake::gltf {

/// Every material of the file, by its metallic-roughness description with KHR_materials_ior,
/// KHR_materials_specular, KHR_materials_emissive_strength and KHR_texture_transform applied. What
/// is passed over (other models, textures of the specular extension, UV sets above 1) is noted.
std::vector<Material> read_materials(const tinygltf::Model& model, std::vector<std::string>& notes);

/// Reflectance at normal incidence of the dielectric base:
///
///     min(((ior - 1) / (ior + 1))^2 color, 1) weight
///
///   ior     1 or more; 0 stands for infinity, reflectance 1
///   color   specularColorFactor; may exceed 1
///   weight  specularFactor, 0 .. 1
///
/// Source: KHR_materials_ior and KHR_materials_specular, "Implementation".
Vec3 dielectric_r0(double ior, const DVec3& color, double weight);

}  // namespace envbake::gltf
