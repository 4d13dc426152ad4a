// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/math/vector.h"
#include "envbake/runtime/brdf.h"

#include <cstdint>
#include <vector>

namespace envbake {

/// The arrays as a reader of the bundle will see them, after every encoding.
struct StoredArrays {
    int bands = 0;
    std::vector<float> sh;  ///< [bands^2, 3], empty without an environment

    struct Mip {
        int level = 0;
        int faces = 6;              ///< 6, or 1: a lat-long image
        int width = 0, height = 0;  ///< of a face, or of the image
        int channels = 3;
        std::vector<float> texels;  ///< [faces, height, width, channels]
    };
    /// The specular side of one distribution.
    struct Lobe {
        std::vector<Mip> mips;  ///< ascending levels; empty where skipped
        int table_size = 0;
        std::vector<float> table;               ///< [roughness, n.v, 2]
        int lobe_rows = 0;                      ///< of the lobe in SH
        std::vector<float> unoccluded, kernel;  ///< [rows, 2, blocks]
    };
    Lobe ggx, beckmann;
    int mip_count = 0;
    runtime::TableAxes table_axes = runtime::TableAxes::RootsEndPoints;

    struct Vertex {
        std::uint32_t mesh = 0;
        std::uint32_t vertex = 0;
        std::vector<float> transport;  ///< [bands^2, channels]
        int channels = 1;
        DVec3 emitted{0};
    };
    std::vector<Vertex> vertices;  ///< a few, spread over the meshes

    struct GlossyVertex {
        std::uint32_t mesh = 0;
        std::uint32_t vertex = 0;
        std::vector<float> visibility;  ///< [(light_bands + 6)^2]
        Vec3 normal{0};                 ///< 0: the vertex has none
        std::vector<float> transport;   ///< of its diffuse transport; empty: it has none
        int channels = 1;
        DVec3 emitted{0};
        std::vector<float> reflected{};  ///< [bands^2 - 1, light_bands^2, channels]; or empty
    };
    std::vector<GlossyVertex> glossy_vertices;  ///< a few of each mesh
    int exit_bands = 0, light_bands = 0;
    double lobe_roughness[2]{0, 0};
    /// Lit by the stored wavelets, both sides as stored, in double.
    struct WaveletVertex {
        std::uint32_t mesh = 0;
        std::uint32_t vertex = 0;
        DVec3 exit_radiance{0};
    };
    std::vector<WaveletVertex> wavelet_vertices;
};

/// Questions and right answers that travel with a bundle, so that any reader can check itself:
/// the arrays under "selftest/".
struct SelfTest {
    static constexpr double kTolerance = 1e-3;  ///< of |answer| + 1e-3 of the group's largest
    static constexpr double kLargestTolerance = 1e-2;  ///< that a bundle may ask for

    std::vector<float> irradiance_normal;       ///< [k, 3]
    std::vector<float> irradiance_value;        ///< [k, 3]
    std::vector<std::uint32_t> diffuse_vertex;  ///< [k, 2]: mesh, vertex
    std::vector<float> diffuse_value;           ///< [k, 3]: exit radiance for albedo 1
    std::vector<std::uint32_t> wavelet_vertex;  ///< [k, 2]: mesh, vertex
    std::vector<float> wavelet_value;           ///< [k, 3]: the same by wavelets

    struct Specular {
        std::vector<float> input;  ///< [k, 8]: n, v, perceptual roughness, R0
        std::vector<float> value;  ///< [k, 3]
    };
    Specular ggx, beckmann;

    struct Glossy {
        std::vector<std::uint32_t> vertex;  ///< [k, 2]: mesh, vertex
        std::vector<float> input;           ///< [k, 5]: v, perceptual roughness, R0
        std::vector<float> value;           ///< [k, 3]
    };
    Glossy ggx_glossy, beckmann_glossy;
};

/// Works the answers out in double from the stored arrays, by the words of docs/format.md and
/// without the runtime that validate checks against them. Specular questions whose answer changes
/// by more than a part in 10^4 when the reflected direction turns by a microradian are not asked: a
/// float reader cannot be held to them.
SelfTest make_self_test(const StoredArrays& arrays);

}  // namespace envbake
