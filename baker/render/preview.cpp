// SPDX-License-Identifier: Apache-2.0
#include "baker/render/preview.h"

#include "baker/core/parallel.h"
#include "baker/render/sight.h"
#include "envbake/runtime/cube.h"
#include "envbake/runtime/glossy.h"
#include "envbake/runtime/sh.h"
#include "envbake/runtime/shade.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

namespace envbake {
namespace {

runtime::Vec3 to_runtime(const DVec3& v) {
    return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

Vec3 from_runtime(const runtime::Rgb& c) {
    return {c[0], c[1], c[2]};
}

Expected<void> check_same_scene(const Scene& scene, const runtime::Bundle& bundle) {
    const auto baked = bundle.meshes();
    if (baked.size() != scene.meshes.size()) {
        return Error{Errc::InvalidBundle,
                     concat(scene.file_name, " has ", scene.meshes.size(),
                            " meshes, the bundle was baked from a scene with ", baked.size())};
    }
    for (std::size_t i = 0; i < baked.size(); ++i) {
        if (baked[i].vertex_count != scene.meshes[i].vertex_count()) {
            return Error{Errc::InvalidBundle,
                         concat(scene.file_name, ": mesh/", i, " has ",
                                scene.meshes[i].vertex_count(), " vertices, in the bundle it has ",
                                baked[i].vertex_count, ": it was baked from another scene")};
        }
    }
    if (bundle.lighting().bands == 0 && bundle.mips().level_count == 0) {
        return Error{
            Errc::InvalidBundle,
            "the bundle holds no light (neither environment/sh nor environment/mips): bake "
            "it with --env"};
    }
    return {};
}

/// Exit radiance of every vertex at albedo 1.
std::vector<Vec3> vertex_light(const Mesh& mesh, const runtime::TransportView& transport,
                               const runtime::ShLightingView& lighting) {
    std::vector<Vec3> light(mesh.vertex_count());
    if (transport.bands > 0) {
        std::vector<runtime::Rgb> out(mesh.vertex_count());
        runtime::diffuse_exit(transport, lighting, 0, out);
        for (std::size_t i = 0; i < out.size(); ++i) light[i] = from_runtime(out[i]);
    } else {
        for (std::size_t i = 0; i < light.size(); ++i) {
            light[i] =
                from_runtime(runtime::irradiance(lighting, to_runtime(DVec3(mesh.normals[i])))) *
                std::numbers::inv_pi_v<float>;
        }
    }
    return light;
}

/// What reaches every vertex for its glossy side; empty where that is not baked.
std::vector<runtime::TransferredLight> glossy_light(const runtime::Bundle& bundle,
                                                    const runtime::Mesh& mesh,
                                                    const runtime::GlossyLight& light) {
    if (mesh.glossy.light_bands == 0 || bundle.glossy_lobe().rows == 0) return {};
    std::vector<runtime::TransferredLight> transferred(mesh.vertex_count);
    parallel_for(transferred.size(),
                 [&](std::size_t v) { transferred[v] = light.transfer(mesh, v); });
    return transferred;
}

/// Radiance of the specular lobe from glossy transport.
Vec3 glossy_reflected(const runtime::LobeView& lobe,
                      std::span<const runtime::TransferredLight> vertices,
                      const std::uint32_t* corner, const SurfacePoint& point,
                      const SurfaceMaterial& material) {
    Vec3 sum(0);
    for (int i = 0; i < 3; ++i) {
        const runtime::GlossyExit exit =
            runtime::reflect(lobe, vertices[corner[i]], material.perceptual_roughness,
                             {material.r0.x, material.r0.y, material.r0.z});
        sum += point.barycentric[i] * from_runtime(exit.radiance(to_runtime(point.to_viewer)));
    }
    return sum;
}

/// The same by wavelets; a mesh without them has no part in it.
std::vector<Vec3> wavelet_light(const Mesh& mesh, const runtime::WaveletTransportView& transport,
                                std::span<const wavelet::Term> terms) {
    std::vector<runtime::Rgb> out(mesh.vertex_count());
    runtime::diffuse_exit(transport, terms, 0, out);
    std::vector<Vec3> light;
    for (const runtime::Rgb& rgb : out) light.push_back(from_runtime(rgb));
    return light;
}

/// Terms of the light as it is turned now. Another map has other terms: as many of them.
Expected<std::vector<wavelet::Term>> wavelet_terms(const runtime::Bundle& bundle,
                                                   const LightTurn& turn) {
    const runtime::WaveletLightingView& lighting = bundle.wavelet_lighting();
    if (lighting.terms.empty())
        return Error{Errc::InvalidBundle,
                     "the bundle holds no wavelets (environment/wavelet): bake it with --wavelet"};
    if (turn.radians() == 0)
        return std::vector<wavelet::Term>(lighting.terms.begin(), lighting.terms.end());
    const runtime::MipsView& mips = bundle.mips();
    if (mips.level_count == 0 || mips.first != 0)
        return Error{Errc::InvalidBundle,
                     "a turned light is decomposed again from environment/mips/0, which the bundle "
                     "does not hold: bake it with --roughness-range 0 1"};
    const int n = lighting.face_size, size = 4 * n;
    std::vector<wavelet::Rgb> map(wavelet::coeff_count(size)), coeffs(wavelet::coeff_count(n));
    parallel_for(static_cast<std::size_t>(cube::kFaceCount * size), [&](std::size_t line) {
        const int face = static_cast<int>(line) / size, row = static_cast<int>(line) % size;
        for (int column = 0; column < size; ++column) {
            const auto w =
                cube::texel_direction<double>(static_cast<cube::Face>(face), row, column, size);
            map[line * static_cast<std::size_t>(size) + static_cast<std::size_t>(column)] =
                runtime::sample_mips(mips, to_runtime(turn.back(DVec3(w[0], w[1], w[2]))), 0);
        }
    });
    std::vector<double> scratch(wavelet::light_scratch_size(n));
    wavelet::light_coefficients(size, map, n, coeffs, scratch);
    std::vector<wavelet::Term> terms;
    for (std::uint32_t i = 0; i < coeffs.size(); ++i) terms.push_back({i, coeffs[i]});
    terms.resize(wavelet::select_terms(terms, lighting.weights, lighting.terms.size()));
    return terms;
}

/// The lights that the environment was extracted of, where they shine now.
std::vector<runtime::DominantLight> extracted_lights(const runtime::Bundle& bundle,
                                                     const LightTurn& turn) {
    if (!bundle.lights_extracted()) return {};
    std::vector<runtime::DominantLight> lights(bundle.lights().begin(), bundle.lights().end());
    for (runtime::DominantLight& light : lights) {
        light.direction = to_runtime(
            turn.turned(DVec3(light.direction[0], light.direction[1], light.direction[2])));
    }
    return lights;
}

/// What lights add to a surface point.
Vec3 light_reflected(std::span<const runtime::DominantLight> lights,
                     runtime::Distribution distribution, const Tracer& tracer,
                     const SurfacePoint& point, const SurfaceMaterial& material) {
    Vec3 sum(0);
    const Vec3 albedo = material.diffuse_albedo();
    const runtime::Surface surface{.normal = to_runtime(point.normal),
                                   .albedo = {albedo.x, albedo.y, albedo.z},
                                   .r0 = {material.r0.x, material.r0.y, material.r0.z},
                                   .perceptual_roughness = material.perceptual_roughness,
                                   .distribution = distribution};
    for (const runtime::DominantLight& light : lights) {
        const DVec3 towards(light.direction[0], light.direction[1], light.direction[2]);
        if (tracer.occluded(point.light_origin, towards)) continue;
        sum += from_runtime(runtime::reflect_light(light, surface, to_runtime(point.to_viewer)));
    }
    return sum;
}

/// Radiance of the lights themselves.
Vec3 lights_towards(std::span<const runtime::DominantLight> lights, const DVec3& direction) {
    Vec3 sum(0);
    for (const runtime::DominantLight& light : lights) {
        const DVec3 towards(light.direction[0], light.direction[1], light.direction[2]);
        if (glm::length(direction - towards) < static_cast<double>(light.angular_radius))
            sum += from_runtime(light.irradiance) / light.solid_angle;
    }
    return sum;
}

/// What stands behind the scene, in a direction of the bake.
Vec3 background_towards(const runtime::Bundle& bundle, const DVec3& direction) {
    const runtime::MipsView& mips = bundle.mips();
    if (mips.level_count > 0) {
        const float roughness = mips.level_count > 1 ? static_cast<float>(mips.first) /
                                                           static_cast<float>(mips.level_count - 1)
                                                     : 0.0f;
        return from_runtime(runtime::sample_mips(mips, to_runtime(direction), roughness));
    }
    const runtime::ShLightingView& lighting = bundle.lighting();
    std::array<double, sh::coeff_count(sh::kMaxBundleBands)> basis{};
    sh::evaluate(lighting.bands, direction.x, direction.y, direction.z, basis.data());
    DVec3 sum(0);
    for (std::size_t i = 0; i < lighting.coeffs.size() / 3; ++i) {
        for (std::size_t c = 0; c < 3; ++c) {
            sum[static_cast<int>(c)] += basis[i] * static_cast<double>(lighting.coeffs[3 * i + c]);
        }
    }
    return Vec3(glm::max(sum, DVec3(0)));
}

}  // namespace

Expected<Picture> render_preview(const Scene& scene, const Tracer& tracer,
                                 const runtime::Bundle& bundle, const Camera& camera,
                                 const PreviewOptions& options, Progress& progress) {
    ENVBAKE_TRY_VOID(check_same_scene(scene, bundle));
    const LightTurn& turn = options.light_turn;
    const std::vector<float> coeffs = turn.turned(bundle.lighting());
    const runtime::ShLightingView lighting{bundle.lighting().bands, coeffs};
    const std::vector<runtime::DominantLight> lights = extracted_lights(bundle, turn);
    std::vector<wavelet::Term> terms;
    if (options.wavelets) {
        ENVBAKE_TRY(terms, wavelet_terms(bundle, turn));
    }
    std::vector<std::vector<Vec3>> light(scene.meshes.size());
    parallel_for(scene.meshes.size(), [&](std::size_t i) {
        const runtime::WaveletTransportView& wavelets = bundle.meshes()[i].wavelet;
        if (options.wavelets && wavelets.face_size > 0)
            light[i] = wavelet_light(scene.meshes[i], wavelets, terms);
        else
            light[i] = vertex_light(scene.meshes[i], bundle.meshes()[i].diffuse, lighting);
    });
    const runtime::LobeView& lobe = bundle.glossy_lobe();
    const auto glossy_lighting = std::make_unique<runtime::GlossyLight>(lighting, lobe.light_bands);
    std::vector<std::vector<runtime::TransferredLight>> glossy(scene.meshes.size());
    for (std::size_t i = 0; i < glossy.size() && !options.split_sum; ++i)
        glossy[i] = glossy_light(bundle, bundle.meshes()[i], *glossy_lighting);

    const auto shade = [&](const SurfacePoint& point) {
        const SurfaceMaterial material =
            options.white_lambert ? white_material(point.material) : point.material;
        const std::uint32_t* corner = &scene.meshes[point.mesh].triangles[3 * point.triangle];
        const std::vector<Vec3>& at = light[point.mesh];
        Vec3 sum = material.diffuse_albedo() *
                   (point.barycentric.x * at[corner[0]] + point.barycentric.y * at[corner[1]] +
                    point.barycentric.z * at[corner[2]]);
        sum += light_reflected(lights, bundle.distribution(), tracer, point, material);
        if (options.white_lambert) return sum;
        if (material.r0 == Vec3(0)) {
            // No lobe.
        } else if (!glossy[point.mesh].empty() &&
                   material.perceptual_roughness > lobe.min_roughness - 1e-3f) {
            sum += glossy_reflected(lobe, glossy[point.mesh], corner, point, material);
        } else {
            sum += from_runtime(runtime::specular(
                bundle, to_runtime(turn.back(point.specular_normal)),
                to_runtime(turn.back(point.to_viewer)), material.perceptual_roughness,
                {material.r0.x, material.r0.y, material.r0.z}));
        }
        return glm::max(sum, Vec3(0)) + material.emission;
    };

    const auto width = static_cast<std::size_t>(camera.width);
    const auto height = static_cast<std::size_t>(camera.height);
    Picture picture{camera.width, camera.height, std::vector<Vec3>(width * height),
                    std::vector<float>(width * height)};
    const CameraRays rays(camera);
    const double per_sight = 1.0 / (options.sights_per_axis * options.sights_per_axis);
    progress.begin("preview", "rows", height);
    parallel_for(height, [&](std::size_t row) {
        std::vector<DVec2> points;
        Sight sight;
        for (int x = 0; x < camera.width; ++x) {
            DVec3 sum(0);
            double surface = 0;
            pixel_points(camera, x, static_cast<int>(row), options.sights_per_axis, points);
            for (const DVec2& at : points) {
                const DVec3 direction = rays.towards(at.x, at.y);
                look_along(scene, tracer, camera.position, direction, sight);
                for (const Layer& layer : sight.layers) {
                    sum += DVec3(layer.weight * shade(layer.point));
                    const bool measured = !options.white_lambert ||
                                          bundle.meshes()[layer.point.mesh].diffuse.bands > 0;
                    if (measured) surface += static_cast<double>(layer.weight);
                }
                if (sight.background > 0)
                    sum +=
                        DVec3(sight.background * (background_towards(bundle, turn.back(direction)) +
                                                  lights_towards(lights, direction)));
            }
            const std::size_t pixel = row * width + static_cast<std::size_t>(x);
            picture.radiance[pixel] = Vec3(sum * per_sight);
            picture.surface[pixel] = static_cast<float>(surface * per_sight);
        }
        progress.add(1);
    });
    return picture;
}

}  // namespace envbake
