// SPDX-License-Identifier: Apache-2.0
// Opens a bundle and shades with it: all that an engine needs, on one page.
//
//     envbake-read-bundle OUT.envb
#include "envbake/runtime/bundle.h"
#include "envbake/runtime/shade.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <span>

namespace rt = envbake::runtime;

namespace {

void print(const char* what, const rt::Rgb& rgb) {
    std::printf("%-34s %10.4f %10.4f %10.4f\n", what, static_cast<double>(rgb[0]),
                static_cast<double>(rgb[1]), static_cast<double>(rgb[2]));
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: %s OUT.envb\n", argv[0]);
        return 2;
    }
    const auto opened = rt::Bundle::open(argv[1]);
    if (!opened) {
        std::fprintf(stderr, "%s: %s\n", argv[1],
                     envbake::format::to_string(opened.error()).c_str());
        return 4;
    }
    const rt::Bundle& bundle = *opened;
    const rt::Vec3 up{0, 1, 0}, down{0, -1, 0};

    if (bundle.lighting().bands > 0) {
        std::printf("lighting, %d bands; irradiance in W m^-2\n", bundle.lighting().bands);
        print("  facing up", rt::irradiance(bundle.lighting(), up));
        print("  facing down", rt::irradiance(bundle.lighting(), down));
    }

    if (bundle.mips().level_count > 0 && bundle.brdf().rows > 0) {
        std::printf("specular radiance of a floor seen at 60 degrees, R0 = 0.04\n");
        const rt::Vec3 view{0.866025404f, 0.5f, 0};
        const rt::Rgb r0{0.04f, 0.04f, 0.04f};
        for (const float roughness : {0.0f, 0.25f, 0.5f, 1.0f}) {
            std::array<char, 40> label{};
            std::snprintf(label.data(), label.size(), "  roughness %.2f",
                          static_cast<double>(roughness));
            print(label.data(), rt::specular(bundle, up, view, roughness, r0));
        }
    }

    for (std::size_t i = 0; i < bundle.meshes().size(); ++i) {
        const rt::Mesh& mesh = bundle.meshes()[i];
        std::printf("mesh %zu (node %u, primitive %u), %llu vertices", i, mesh.node, mesh.primitive,
                    static_cast<unsigned long long>(mesh.vertex_count));
        if (mesh.diffuse.bands == 0) {
            std::printf(", no diffuse transport\n");
            continue;
        }
        std::printf("; exit radiance for albedo 1\n");
        // A real engine shades the whole mesh at once: this is what the span is for.
        std::array<rt::Rgb, 3> exit;
        const std::size_t count =
            static_cast<std::size_t>(std::min<std::uint64_t>(exit.size(), mesh.vertex_count));
        rt::diffuse_exit(mesh.diffuse, bundle.lighting(), 0, std::span(exit.data(), count));
        for (std::size_t k = 0; k < count; ++k) {
            std::array<char, 40> label{};
            std::snprintf(label.data(), label.size(), "  vertex %zu", k);
            print(label.data(), exit[k]);
        }
    }
    return 0;
}
