// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_materials.h"

#include <glm/common.hpp>

#include <cmath>

namespace envbake::gltf {

namespace {

using Extensions = tinygltf::ExtensionMap;

const tinygltf::Value* find(const Extensions& extensions, const char* name) {
    const auto it = extensions.find(name);
    return it == extensions.end() ? nullptr : &it->second;
}

double number(const tinygltf::Value& object, const char* key, double fallback) {
    return object.Has(key) ? object.Get(key).GetNumberAsDouble() : fallback;
}

double element(const tinygltf::Value& object, const char* key, int i, double fallback) {
    return object.Has(key) ? object.Get(key).Get(i).GetNumberAsDouble() : fallback;
}

Wrap wrap(int mode) {
    if (mode == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return Wrap::ClampToEdge;
    if (mode == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT) return Wrap::MirroredRepeat;
    return Wrap::Repeat;
}

/// translation * rotation * scale of KHR_texture_transform. A positive angle turns UVs
/// counter-clockwise as seen in the image, where v points down: (u, v) -> (c u + s v, c v - s u).
/// That is what the text of the extension says and what viewers do; its sample code has the other
/// sign.
std::array<float, 6> uv_matrix(const tinygltf::Value& transform) {
    const double angle = number(transform, "rotation", 0);
    const double c = std::cos(angle), s = std::sin(angle);
    const double scale_u = element(transform, "scale", 0, 1),
                 scale_v = element(transform, "scale", 1, 1);
    const auto f = [](double x) { return static_cast<float>(x); };
    return {f(c * scale_u),  f(s * scale_v), f(element(transform, "offset", 0, 0)),
            f(-s * scale_u), f(c * scale_v), f(element(transform, "offset", 1, 0))};
}

/// A texture as a material refers to it; empty when there is none that can be read.
std::optional<Texture> texture(const tinygltf::Model& model, int index, int uv_set,
                               const Extensions& extensions, const std::string& where,
                               std::vector<std::string>& notes) {
    if (index < 0) return std::nullopt;
    const tinygltf::Texture& source = model.textures[static_cast<std::size_t>(index)];
    if (source.source < 0) {
        notes.push_back(
            concat(where, ": textures[", index, "] has no PNG or JPEG source: ignored"));
        return std::nullopt;
    }
    Texture out;
    out.image = source.source;
    out.uv_set = uv_set;
    if (source.sampler >= 0) {
        const tinygltf::Sampler& sampler = model.samplers[static_cast<std::size_t>(source.sampler)];
        out.wrap_u = wrap(sampler.wrapS);
        out.wrap_v = wrap(sampler.wrapT);
    }
    if (const tinygltf::Value* transform = find(extensions, "KHR_texture_transform")) {
        out.uv_matrix = uv_matrix(*transform);
        out.uv_set = static_cast<int>(number(*transform, "texCoord", uv_set));
    }
    if (out.uv_set > 1) {
        notes.push_back(
            concat(where, ": uses TEXCOORD_", out.uv_set, ", only 0 and 1 are read: ignored"));
        return std::nullopt;
    }
    return out;
}

}  // namespace

Vec3 dielectric_r0(double ior, const DVec3& color, double weight) {
    const double root = (ior - 1) / (ior + 1);  // ior 0 gives -1: reflectance 1, as the text asks
    return Vec3(glm::min(root * root * color, DVec3(1)) * weight);
}

std::vector<Material> read_materials(const tinygltf::Model& model,
                                     std::vector<std::string>& notes) {
    std::vector<Material> materials;
    for (const tinygltf::Material& source : model.materials) {
        const std::string where = concat("materials[", materials.size(), "]");
        const auto f = [](double x) { return static_cast<float>(x); };
        Material m;
        m.name = source.name;

        const tinygltf::PbrMetallicRoughness& pbr = source.pbrMetallicRoughness;
        if (pbr.baseColorFactor.size() == 4) {
            m.base_color = {pbr.baseColorFactor[0], pbr.baseColorFactor[1], pbr.baseColorFactor[2]};
            m.alpha = f(pbr.baseColorFactor[3]);
        }
        m.metallic = f(pbr.metallicFactor);
        m.perceptual_roughness = f(pbr.roughnessFactor);
        m.base_color_texture =
            texture(model, pbr.baseColorTexture.index, pbr.baseColorTexture.texCoord,
                    pbr.baseColorTexture.extensions, where + ".baseColorTexture", notes);
        m.metallic_roughness_texture = texture(
            model, pbr.metallicRoughnessTexture.index, pbr.metallicRoughnessTexture.texCoord,
            pbr.metallicRoughnessTexture.extensions, where + ".metallicRoughnessTexture", notes);
        m.emission_texture =
            texture(model, source.emissiveTexture.index, source.emissiveTexture.texCoord,
                    source.emissiveTexture.extensions, where + ".emissiveTexture", notes);

        if (source.emissiveFactor.size() == 3)
            m.emission = {source.emissiveFactor[0], source.emissiveFactor[1],
                          source.emissiveFactor[2]};
        if (source.alphaMode == "MASK") m.alpha_mode = AlphaMode::Mask;
        if (source.alphaMode == "BLEND") m.alpha_mode = AlphaMode::Blend;
        m.alpha_cutoff = f(source.alphaCutoff);
        m.double_sided = source.doubleSided;

        if (const tinygltf::Value* e = find(source.extensions, "KHR_materials_emissive_strength"))
            m.emission *= f(number(*e, "emissiveStrength", 1));
        double ior = 1.5;
        DVec3 specular_color(1);
        double specular = 1;
        if (const tinygltf::Value* e = find(source.extensions, "KHR_materials_ior"))
            ior = number(*e, "ior", 1.5);
        if (const tinygltf::Value* e = find(source.extensions, "KHR_materials_specular")) {
            specular = number(*e, "specularFactor", 1);
            for (int i = 0; i < 3; ++i)
                specular_color[i] = element(*e, "specularColorFactor", i, 1);
            if (e->Has("specularTexture") || e->Has("specularColorTexture"))
                notes.push_back(
                    concat(where, ": the textures of KHR_materials_specular are not read"));
        }
        m.dielectric_r0 = dielectric_r0(ior, specular_color, specular);
        materials.push_back(std::move(m));
    }
    return materials;
}

}  // namespace envbake::gltf
