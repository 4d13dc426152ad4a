// SPDX-License-Identifier: Apache-2.0
// Writes the compressed meshes that the fuzzers of compression and of scenes start from:
//   make_meshes FOLDER      makes FOLDER/*.draco, FOLDER/*.worker and FOLDER/*.meshopt
// A .worker file is what the image worker leaves of a .draco file, after a byte for
// fuzz_compression; a .meshopt file is as it reads them, too: mode, filter, bytes a vertex, count,
// the stream.
#include "baker/input/image_worker/codec.h"

#include <draco/compression/expert_encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>
#include <meshoptimizer.h>

#include <array>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

constexpr unsigned kEdge = 4;  // quads along an edge of the bent sheet

struct Sheet {
    std::vector<std::array<float, 3>> positions;
    std::vector<std::array<float, 2>> uvs;
    std::vector<unsigned> indices;
};

/// With a hole in the middle: connectivity codecs have code of its own for those.
Sheet make_sheet() {
    Sheet sheet;
    for (unsigned y = 0; y <= kEdge; ++y)
        for (unsigned x = 0; x <= kEdge; ++x) {
            const float u = static_cast<float>(x) / kEdge, v = static_cast<float>(y) / kEdge;
            sheet.positions.push_back({u, v, u * v});
            sheet.uvs.push_back({u, v});
        }
    for (unsigned y = 0; y < kEdge; ++y)
        for (unsigned x = 0; x < kEdge; ++x) {
            if (x == 1 && y == 2) continue;
            const unsigned a = y * (kEdge + 1) + x, b = a + 1, c = a + kEdge + 1, d = c + 1;
            sheet.indices.insert(sheet.indices.end(), {a, b, c, b, d, c});
        }
    return sheet;
}

void write(const fs::path& file, const std::vector<char>& bytes) {
    std::ofstream out(file, std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (!out.flush()) std::exit(1);
}

struct DracoOptions {
    int method = draco::MESH_EDGEBREAKER_ENCODING;
    int connectivity = draco::MESH_EDGEBREAKER_STANDARD_ENCODING;
    int speed = 5;
    int position_bits = 11;  ///< 0: floats as they are
    bool packed = false;     ///< sequential: indices packed, too
    bool seam = false;       ///< a corner of each triangle has a place in the texture of its own
    int position_prediction = draco::PREDICTION_UNDEFINED;  ///< the encoder's choice
};

void write_draco(const fs::path& file, const Sheet& sheet, const DracoOptions& options) {
    using draco::GeometryAttribute;
    const int faces = static_cast<int>(sheet.indices.size() / 3);
    draco::TriangleSoupMeshBuilder builder;
    builder.Start(faces);
    const int position = builder.AddAttribute(GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
    const int normal = builder.AddAttribute(GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
    const int uv = builder.AddAttribute(GeometryAttribute::TEX_COORD, 2, draco::DT_FLOAT32);
    const int joints = builder.AddAttribute(GeometryAttribute::GENERIC, 4, draco::DT_UINT8);
    for (int f = 0; f < faces; ++f) {
        std::array<unsigned, 3> corners{};
        for (std::size_t k = 0; k < 3; ++k)
            corners[k] = sheet.indices[3 * static_cast<std::size_t>(f) + k];
        const draco::FaceIndex face(static_cast<std::uint32_t>(f));
        const auto set = [&](int attribute, const auto& a, const auto& b, const auto& c) {
            builder.SetAttributeValuesForFace(attribute, face, a.data(), b.data(), c.data());
        };
        const auto& p = sheet.positions;
        set(position, p[corners[0]], p[corners[1]], p[corners[2]]);
        const std::array<float, 3> up{0, 0, 1}, tilted{0.6f, 0, 0.8f};
        set(normal, up, up, f % 3 == 0 ? tilted : up);
        auto last = sheet.uvs[corners[2]];
        if (options.seam && f % 2 == 0) last[0] += 2;
        set(uv, sheet.uvs[corners[0]], sheet.uvs[corners[1]], last);
        const std::array<std::uint8_t, 4> bones{0, 1, 2, 3};
        set(joints, bones, bones, bones);
    }
    const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
    if (!mesh) std::exit(1);
    draco::ExpertEncoder encoder(*mesh);
    encoder.SetSpeedOptions(options.speed, options.speed);
    encoder.SetEncodingMethod(options.method);
    if (options.method == draco::MESH_EDGEBREAKER_ENCODING)
        encoder.SetEncodingSubmethod(options.connectivity);
    if (options.position_bits != 0)
        encoder.SetAttributeQuantization(position, options.position_bits);
    encoder.options().SetGlobalBool("compress_connectivity", options.packed);
    encoder.SetAttributeQuantization(normal, 8);
    encoder.SetAttributeQuantization(uv, 10);
    if (options.position_prediction != draco::PREDICTION_UNDEFINED &&
        !encoder.SetAttributePredictionScheme(position, options.position_prediction).ok())
        std::exit(1);
    draco::EncoderBuffer buffer;
    if (!encoder.EncodeToBuffer(&buffer).ok()) std::exit(1);
    write(file, *buffer.buffer());

    std::vector<char> decoded{3};
    const auto append = [&](envbake::worker::Bytes bytes) {
        const auto* const first = reinterpret_cast<const char*>(bytes.data());
        decoded.insert(decoded.end(), first, first + bytes.size());
    };
    envbake::worker::decode_draco(std::as_bytes(std::span(buffer.data(), buffer.size())), append);
    write(fs::path(file).replace_extension(".worker"), decoded);
}

/// modes and filters by their place in fuzz_compression
void write_meshopt(const fs::path& file, int mode, int filter, std::size_t stride,
                   std::size_t count, const std::vector<unsigned char>& stream) {
    std::vector<char> bytes{static_cast<char>(mode), static_cast<char>(filter),
                            static_cast<char>(stride), static_cast<char>(count & 255),
                            static_cast<char>(count >> 8)};
    bytes.insert(bytes.end(), stream.begin(), stream.end());
    write(file, bytes);
}

template <class Vertex>
std::vector<unsigned char> encode_vertices(const std::vector<Vertex>& vertices) {
    std::vector<unsigned char> stream(
        meshopt_encodeVertexBufferBound(vertices.size(), sizeof(Vertex)));
    stream.resize(meshopt_encodeVertexBuffer(stream.data(), stream.size(), vertices.data(),
                                             vertices.size(), sizeof(Vertex)));
    return stream;
}

void write_meshopts(const fs::path& folder, const Sheet& sheet) {
    const std::size_t vertices = sheet.positions.size(), indices = sheet.indices.size();
    write_meshopt(folder / "positions.meshopt", 0, 0, 12, vertices,
                  encode_vertices(sheet.positions));

    std::vector<std::array<float, 4>> directions;
    for (const auto& [u, v] : sheet.uvs) directions.push_back({u - 0.5f, v - 0.5f, 0.5f, 1});
    std::vector<std::array<std::int8_t, 4>> bytes(vertices);
    meshopt_encodeFilterOct(bytes.data(), vertices, 4, 8, directions[0].data());
    write_meshopt(folder / "octahedral.meshopt", 0, 1, 4, vertices, encode_vertices(bytes));
    std::vector<std::array<std::int16_t, 4>> shorts(vertices);
    meshopt_encodeFilterQuat(shorts.data(), vertices, 8, 12, directions[0].data());
    write_meshopt(folder / "quaternions.meshopt", 0, 2, 8, vertices, encode_vertices(shorts));
    std::vector<std::array<std::uint32_t, 3>> words(vertices);
    meshopt_encodeFilterExp(words.data(), vertices, 12, 15, sheet.positions[0].data());
    write_meshopt(folder / "exponential.meshopt", 0, 3, 12, vertices, encode_vertices(words));

    for (const int version : {0, 1}) {
        meshopt_encodeIndexVersion(version);
        std::vector<unsigned char> stream(meshopt_encodeIndexBufferBound(indices, vertices));
        stream.resize(
            meshopt_encodeIndexBuffer(stream.data(), stream.size(), sheet.indices.data(), indices));
        write_meshopt(folder / ("triangles" + std::to_string(version) + ".meshopt"), 1, 0, 2,
                      indices, stream);
        stream.resize(meshopt_encodeIndexSequenceBound(indices, vertices));
        stream.resize(meshopt_encodeIndexSequence(stream.data(), stream.size(),
                                                  sheet.indices.data(), indices));
        write_meshopt(folder / ("indices" + std::to_string(version) + ".meshopt"), 2, 0, 4, indices,
                      stream);
    }
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) return 2;
    const fs::path folder = argv[1];
    fs::create_directories(folder);
    const Sheet sheet = make_sheet();
    write_draco(folder / "edgebreaker.draco", sheet, {});
    write_draco(folder / "valence.draco", sheet,
                {.connectivity = draco::MESH_EDGEBREAKER_VALENCE_ENCODING, .speed = 0});
    write_draco(folder / "seams.draco", sheet, {.speed = 1, .seam = true});
    write_draco(folder / "sequential.draco", sheet, {.method = draco::MESH_SEQUENTIAL_ENCODING});
    write_draco(folder / "packed.draco", sheet,
                {.method = draco::MESH_SEQUENTIAL_ENCODING, .speed = 0, .packed = true});
    write_draco(folder / "floats.draco", sheet, {.speed = 10, .position_bits = 0});
    write_draco(folder / "parallelograms.draco", sheet,
                {.speed = 0,
                 .position_prediction = draco::MESH_PREDICTION_CONSTRAINED_MULTI_PARALLELOGRAM});
    write_meshopts(folder, sheet);
}
