// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "envbake/format/reader.h"
#include "envbake/runtime/brdf.h"
#include "envbake/runtime/half.h"
#include "envbake/runtime/lobe.h"
#include "envbake/runtime/mip_layout.h"
#include "envbake/runtime/wavelet.h"

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>

namespace envbake::runtime {

/// Directions and positions in glTF world space: right-handed, +Y up, metres.
using Vec3 = std::array<float, 3>;
/// Linear, Rec. 709 primaries.
using Rgb = std::array<float, 3>;

inline constexpr int kMaxMipLevels = 16;
inline constexpr int kMaxClusterWeights = 32;

/// Elements of f32 or f16 where they lie: in the file, or in the bundle's decoded block.
struct FloatView {
    const void* data = nullptr;
    std::uint64_t count = 0;
    bool is_half = false;

    float operator[](std::uint64_t i) const {
        return is_half ? half_to_float(static_cast<const std::uint16_t*>(data)[i])
                       : static_cast<const float*>(data)[i];
    }
};

/// "environment/sh": l_i = integral of L(w) Y_i(w) dw, basis of sh.h.
struct ShLightingView {
    int bands = 0;                  ///< 1 .. 10; 0: the bundle has none
    std::span<const float> coeffs;  ///< [bands^2, 3]: slot sh::index(l, m), RGB; W m^-2. A grey
                                    ///< environment's one channel is stored thrice by open()
};

/// A row of "environment/lights": a small bright source, to be given a shadow map.
struct DominantLight {
    Vec3 direction{};          ///< unit, towards the light
    Rgb irradiance{};          ///< of a surface that faces it, W m^-2; above what surrounds it
    float angular_radius = 0;  ///< radians
    float solid_angle = 0;     ///< sr
    float share = 0;           ///< of the environment's energy, 0 .. 1
};
static_assert(sizeof(DominantLight) == 9 * sizeof(float));

/// One level of prefiltered radiance, W sr^-1 m^-2.
struct MipLevel {
    int width = 0;  ///< texels, of a face or of the image; 0: this level was not baked
    int height = 0;
    int channels = 3;  ///< 1: grey, the same for red, green, blue
    FloatView texels;  ///< [6 faces, height, width, channels], or [height, width, channels]
};

/// "environment/mips/K" and "environment/mips_beckmann/K". Level k holds perceptual roughness
/// k / (level_count - 1). Levels first .. last are present: a scene whose materials are all rough
/// needs no mirror.
struct MipsView {
    int level_count = 0;  ///< 0: the bundle has none
    int first = 0;
    int last = 0;
    MipLayout layout = MipLayout::CubeFaces;
    std::array<MipLevel, kMaxMipLevels> levels{};
};

/// "brdf/ggx" and "brdf/beckmann": texel [row of roughness, column of n.v, A and B].
struct BrdfTableView {
    int rows = 0;  ///< 0: the bundle has none
    int columns = 0;
    TableAxes axes = TableAxes::RootsEndPoints;
    FloatView texels;
    FloatView average_albedo;  ///< [rows]: 2 integral of (A + B) n.v d(n.v); count 0: none
};

/// How transport is stored; T is a row of bands^2 * channels numbers a vertex.
enum class TransportEncoding {
    Float,     ///< f32 or f16
    Unorm16,   ///< T_i = low_i + step_i q_i, q_i of 16 bits
    Unorm8,    ///< ... of 8 bits
    Clustered  ///< T = basis_c0 + sum_k q_k basis_ck, q_k of 8 bits, c the vertex' cluster
};

/// "mesh/diffuse_basis": what the clustered transport of all meshes is made of.
struct ClusterBasisView {
    std::uint32_t cluster_count = 0;  ///< 0: the bundle has none
    int weight_count = 0;             ///< n
    int bands = 0;
    int channels = 1;
    FloatView rows;  ///< [cluster_count, 1 + weight_count, bands^2 * channels]
};

/// "mesh/I/diffuse" or "mesh/I/diffuse_weights": transport of each vertex; and "mesh/I/emitted".
struct TransportView {
    std::uint64_t vertex_count = 0;
    int bands = 0;     ///< 1 .. 10; 0: this mesh has none
    int channels = 1;  ///< 1: the same for red, green, blue; 3: [bands^2, 3] a vertex
    TransportEncoding encoding = TransportEncoding::Float;
    FloatView values;                ///< Float: [vertex_count, bands^2, channels]
    const void* codes = nullptr;     ///< q: [vertex_count, bands^2, channels], or [vertex_count, n]
    const float* range = nullptr;    ///< Unorm: low and step, [bands^2, channels, 2]
    const void* clusters = nullptr;  ///< Clustered: c of each vertex, of 8 or 16 bits
    bool clusters_are_16_bit = false;
    ClusterBasisView basis;  ///< Clustered: the bundle's
    FloatView
        emitted;  ///< [vertex_count, 3]: what shining surfaces send, W sr^-1 m^-2; count 0: none
};

/// "mesh/I/glossy", "mesh/I/normal" and "mesh/I/reflected": what glossy.h makes transport matrices
/// from.
struct GlossyView {
    std::uint64_t vertex_count = 0;
    int light_bands = 0;         ///< 1 .. 5; 0: this mesh has none
    FloatView visibility;        ///< [vertex_count, (light_bands + kExtraVisibilityBands)^2]
    FloatView normals;           ///< [vertex_count, 3], unit, or 0 of a vertex without one
    int reflected_bands = 1;     ///< 1: surfaces send their mean to all their directions
    int reflected_channels = 1;  ///< 1: the same for red, green, blue
    FloatView reflected{};       ///< [vertex_count, reflected_bands^2 - 1, light_bands^2, channels]
};

/// "brdf/ggx_lobe/..." and "brdf/beckmann_lobe/...": the lobe in SH, by roughness (lobe.h).
struct LobeView {
    int rows = 0;                                ///< 0: the bundle has none
    int exit_bands = 0, light_bands = 0;         ///< 1 .. 5
    float min_roughness = 0, max_roughness = 0;  ///< perceptual, of the first and the last row
    FloatView unoccluded;  ///< [rows, 2, lobe_size(exit_bands, light_bands)]; a and b
    FloatView kernel;      ///< [rows, 2, lobe_size(exit_bands, kLobeBands)]
};

/// "mesh/I/wavelet/blocks" and "/offsets": transport in the basis of wavelet.h, by blocks of 256
/// vertices and in each by coefficient, so that a few lighting terms touch little of it.
struct WaveletTransportView {
    std::uint64_t vertex_count = 0;
    int face_size = 0;                       ///< of the basis; 0: this mesh has none
    float step = 0;                          ///< what one unit of a stored value is worth
    std::span<const std::uint32_t> offsets;  ///< [blocks + 1], in words
    std::span<const std::uint32_t> words;    ///< the blocks, 4 bytes a word
};

/// A (node, primitive) pair of the default scene, depth first, in file order.
struct Mesh {
    std::uint32_t node = 0;  ///< glTF indices
    std::uint32_t mesh = 0;
    std::uint32_t primitive = 0;
    std::uint64_t vertex_count = 0;
    TransportView diffuse;
    GlossyView glossy;
    WaveletTransportView wavelet;
};

/// "environment/wavelet/index" and "/value", "wavelet/weight".
struct WaveletLightingView {
    int face_size = 0;                     ///< of the basis; 0: the bundle has none
    std::span<const wavelet::Term> terms;  ///< of the map it was baked for, ascending by index
    /// [coeff_count]: rms over all vertices of the transport of each coefficient, for
    /// wavelet::select_terms() of another map. Empty: the bundle has none.
    std::span<const float> weights;
};

/// An array of any name.
struct ArrayView {
    format::ArrayInfo info;
    const void* data = nullptr;
};

/// A bundle ready to shade with (shade.h). open() checks everything that is used afterwards: the
/// types, the shapes, and the facts of the metadata. What is absent is empty, not an error; arrays
/// and metadata fields of other names are skipped.
///
/// Uncompressed arrays are used in place. Compressed ones that shade.h needs are decoded by open()
/// into one block, the only allocation; nothing allocates later. Move-only; views live as long as
/// the bundle that handed them out, wherever it is moved to.
///
/// Threads: all const members may run on any number of threads at once.
class Bundle {
  public:
    /// Maps a file.
    ///
    /// Errors:  all of format::Reader::open
    ///          ArrayType, ArrayShape   an array is not as docs/format.md has it
    ///          ArrayMissing            the mips that are present are not consecutive
    ///          ArrayDecode, ArrayCodec a compressed array is damaged, or this build lacks zstd
    ///          Metadata                a fact that an array needs is absent or out of range
    ///          CannotRead              no memory for the decoded arrays (system_error ENOMEM)
    [[nodiscard]] static format::Expected<Bundle> open(const char* path) noexcept;

    /// Borrows memory that outlives the bundle; 8-byte aligned.
    [[nodiscard]] static format::Expected<Bundle> open(std::span<const std::byte> bytes) noexcept;

    const format::Reader& reader() const noexcept { return reader_; }

    const ShLightingView& lighting() const noexcept { return lighting_; }

    /// Strongest first.
    std::span<const DominantLight> lights() const noexcept { return lights_; }
    /// True: no other array holds the lights, a renderer adds them (shade.h, reflect_light). False:
    /// all the others hold them too.
    bool lights_extracted() const noexcept { return lights_extracted_; }

    /// The distribution that the bundle was baked for; GGX where it holds both, or neither.
    Distribution distribution() const noexcept;
    const MipsView& mips() const noexcept { return mips(distribution()); }
    const MipsView& mips(Distribution d) const noexcept { return lobe(d).mips; }
    const BrdfTableView& brdf() const noexcept { return brdf(distribution()); }
    const BrdfTableView& brdf(Distribution d) const noexcept { return lobe(d).brdf; }
    /// For glossy.h.
    const LobeView& glossy_lobe() const noexcept { return glossy_lobe(distribution()); }
    const LobeView& glossy_lobe(Distribution d) const noexcept { return lobe(d).glossy; }

    std::span<const Mesh> meshes() const noexcept { return meshes_; }

    const WaveletLightingView& wavelet_lighting() const noexcept { return wavelet_lighting_; }
    /// Of all meshes whose transport is clustered; empty where none is.
    const ClusterBasisView& cluster_basis() const noexcept { return cluster_basis_; }

    /// An array in place; for those that shade.h does not use.
    ///
    /// Errors:  ArrayMissing
    ///          ArrayCodec     compressed: decode it with reader().read(info, memory)
    [[nodiscard]] format::Expected<ArrayView> array(std::string_view name) const noexcept;

  private:
    struct Free {
        void operator()(std::byte* block) const noexcept;
    };
    class Arena;
    struct Lobe {
        MipsView mips;
        BrdfTableView brdf;
        LobeView glossy;
    };
    struct LobeNames;

    const Lobe& lobe(Distribution d) const noexcept {
        return d == Distribution::Ggx ? ggx_ : beckmann_;
    }

    explicit Bundle(format::Reader reader) noexcept : reader_(std::move(reader)) {}
    static format::Expected<Bundle> load(format::Expected<format::Reader> reader) noexcept;

    format::Expected<void> resolve(Arena& arena) noexcept;
    format::Expected<void> resolve_lighting(Arena& arena) noexcept;
    format::Expected<void> resolve_lights(Arena& arena) noexcept;
    format::Expected<void> resolve_mips(const LobeNames& names, MipsView& mips,
                                        Arena& arena) noexcept;
    format::Expected<void> resolve_brdf(const LobeNames& names, BrdfTableView& brdf,
                                        Arena& arena) noexcept;
    format::Expected<void> resolve_glossy_lobe(const LobeNames& names, LobeView& lobe,
                                               Arena& arena) noexcept;
    format::Expected<void> resolve_glossy(std::uint64_t mesh, GlossyView& glossy,
                                          Arena& arena) const noexcept;
    format::Expected<void> resolve_meshes(Arena& arena) noexcept;
    format::Expected<void> resolve_wavelet_lighting(Arena& arena) noexcept;
    format::Expected<void> resolve_wavelet(std::uint64_t mesh_index, Mesh& mesh) const noexcept;
    format::Expected<void> resolve_cluster_basis(Arena& arena) noexcept;
    format::Expected<void> resolve_transport(std::uint64_t index, TransportView& transport,
                                             Arena& arena) noexcept;
    format::Expected<void> resolve_clustered(std::uint64_t index, const format::ArrayInfo& weights,
                                             TransportView& transport, Arena& arena) noexcept;
    format::Expected<const void*> place_bytes(const format::ArrayInfo& info,
                                              Arena& arena) const noexcept;
    format::Expected<FloatView> place(const format::ArrayInfo& info, Arena& arena) const noexcept;
    format::Error metadata_error() const noexcept;

    format::Reader reader_;
    std::unique_ptr<std::byte, Free> block_;
    ShLightingView lighting_;
    std::span<const DominantLight> lights_;
    bool lights_extracted_ = false;
    Lobe ggx_, beckmann_;
    ClusterBasisView cluster_basis_;
    std::span<const Mesh> meshes_;
    WaveletLightingView wavelet_lighting_;
    float wavelet_step_ = 0;
};

}  // namespace envbake::runtime
