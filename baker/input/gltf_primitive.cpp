// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_primitive.h"

#include "baker/input/gltf_accessor.h"
#include "baker/input/gltf_compression.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace envbake::gltf {

namespace {

Error refuse(const std::string& where, const std::string& why) {
    return {Errc::InvalidInput, concat(where, ": ", why)};
}

bool finite(const Vec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

std::vector<Vec3> vec3s(const Numbers& n) {
    std::vector<Vec3> out(n.count());
    for (std::size_t i = 0; i < out.size(); ++i)
        out[i] = {n.values[3 * i], n.values[3 * i + 1], n.values[3 * i + 2]};
    return out;
}

std::vector<Vec2> uvs(const Numbers& n, Repairs& repairs) {
    const auto repaired = [&](float x) {
        if (std::isfinite(x)) return x;
        ++repairs.zeroed_uvs;
        return 0.0f;
    };
    std::vector<Vec2> out(n.count());
    for (std::size_t i = 0; i < out.size(); ++i)
        out[i] = {repaired(n.values[2 * i]), repaired(n.values[2 * i + 1])};
    return out;
}

std::vector<Vec4> colors(const Numbers& n, Repairs& repairs) {
    const auto clamped = [&](float x) {
        if (x >= 0 && x <= 1) return x;
        ++repairs.clamped_colors;
        return x > 1 ? 1.0f : 0.0f;  // NaN to 0
    };
    std::vector<Vec4> out(n.count(), Vec4(1));
    const auto width = static_cast<std::size_t>(n.components);
    for (std::size_t i = 0; i < out.size(); ++i)
        for (std::size_t c = 0; c < width; ++c)
            out[i][static_cast<int>(c)] = clamped(n.values[width * i + c]);
    return out;
}

/// Vertex numbers of the triangles of an index list.
std::vector<std::uint32_t> triangles(int mode, std::vector<std::uint32_t> indices,
                                     Repairs& repairs) {
    const std::size_t n = indices.size();
    if (mode == TINYGLTF_MODE_TRIANGLES) {
        repairs.leftover_indices += n % 3;
        indices.resize(n - n % 3);
        return indices;
    }
    std::vector<std::uint32_t> out;
    const bool strip = mode == TINYGLTF_MODE_TRIANGLE_STRIP;
    if ((!strip && mode != TINYGLTF_MODE_TRIANGLE_FAN) || n < 3) return out;
    out.reserve(3 * (n - 2));
    for (std::size_t i = 0; i + 2 < n; ++i) {
        if (strip)
            out.insert(out.end(), {indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]});
        else
            out.insert(out.end(), {indices[i + 1], indices[i + 2], indices[0]});
    }
    return out;
}

/// Reads the attributes of one primitive, from its Draco stream where it has one.
class Reader {
  public:
    Reader(Asset& asset, int mesh, int primitive, Repairs& repairs)
        : asset_(asset),
          source_(asset.model()
                      .meshes[static_cast<std::size_t>(mesh)]
                      .primitives[static_cast<std::size_t>(primitive)]),
          where_(primitive_path(mesh, primitive)),
          repairs_(repairs) {}

    Expected<Primitive> read(std::span<const double> weights) {
        ENVBAKE_TRY_VOID(decompress());
        Primitive out;
        ENVBAKE_TRY(const auto positions, attribute("POSITION"));
        if (!positions) return out;
        out.positions = vec3s(*positions);
        ENVBAKE_TRY(const auto normals, attribute("NORMAL"));
        if (normals) out.normals = vec3s(*normals);
        ENVBAKE_TRY_VOID(add_morph_targets(out, weights));
        for (std::size_t v = 0; v < out.positions.size(); ++v) {
            const Vec3& p = out.positions[v];
            if (!finite(p))
                return refuse(where_ + ".attributes.POSITION",
                              concat("vertex ", v, " is (", p.x, ", ", p.y, ", ", p.z,
                                     "), positions must be finite"));
        }
        ENVBAKE_TRY(const auto uv0, attribute("TEXCOORD_0"));
        if (uv0) out.uv0 = uvs(*uv0, repairs_);
        ENVBAKE_TRY(const auto uv1, attribute("TEXCOORD_1"));
        if (uv1) out.uv1 = uvs(*uv1, repairs_);
        ENVBAKE_TRY(const auto color, attribute("COLOR_0"));
        if (color) out.colors = colors(*color, repairs_);
        ENVBAKE_TRY_VOID(read_influences(out));
        ENVBAKE_TRY_VOID(read_triangles(out));
        return out;
    }

  private:
    Expected<void> decompress() {
        const auto extension = source_.extensions.find("KHR_draco_mesh_compression");
        if (extension == source_.extensions.end()) return {};
        const std::string where = where_ + ".extensions.KHR_draco_mesh_compression";
        if (source_.mode != TINYGLTF_MODE_TRIANGLES && source_.mode != TINYGLTF_MODE_TRIANGLE_STRIP)
            return refuse(where, concat("the primitive is of mode ", source_.mode,
                                        ", Draco holds triangles"));
        const tinygltf::Value& ids = extension->second.Get("attributes");
        std::map<std::string, int> wanted;
        for (const std::string& semantic : ids.Keys())
            wanted[semantic] = ids.Get(semantic).GetNumberAsInt();
        auto bytes = asset_.buffer_view(extension->second.Get("bufferView").GetNumberAsInt());
        if (!bytes) return refuse(where, bytes.error().message);
        auto decoded = decode_draco(*bytes, wanted);
        if (!decoded)
            return Error{decoded.error().code, concat(where, ": ", decoded.error().message)};
        draco_ = *std::move(decoded);
        for (const auto& [semantic, accessor] : source_.attributes)
            if (const std::size_t n = accessor_count(accessor); n != draco_->vertex_count)
                return refuse(where, concat("decodes to ", draco_->vertex_count,
                                            " vertices, accessors[", accessor, "] has ", n));
        if (source_.indices >= 0 && accessor_count(source_.indices) != draco_->indices.size())
            return refuse(where,
                          concat("decodes to ", draco_->indices.size(), " indices, accessors[",
                                 source_.indices, "] has ", accessor_count(source_.indices)));
        return {};
    }

    std::size_t accessor_count(int accessor) const {
        return asset_.model().accessors[static_cast<std::size_t>(accessor)].count;
    }

    Expected<std::optional<Numbers>> attribute(const std::string& semantic) {
        const auto it = source_.attributes.find(semantic);
        if (it == source_.attributes.end()) return std::optional<Numbers>();
        const bool compressed = draco_ && draco_->attributes.count(semantic) != 0;
        auto numbers = compressed ? read_numbers(std::as_const(asset_), it->second,
                                                 draco_->attributes.at(semantic))
                                  : read_numbers(asset_, it->second);
        if (!numbers) return refuse(where_ + ".attributes." + semantic, numbers.error().message);
        return std::optional<Numbers>(*std::move(numbers));
    }

    Expected<void> add_morph_targets(Primitive& out, std::span<const double> weights) {
        for (std::size_t k = 0; k < std::min(weights.size(), source_.targets.size()); ++k) {
            if (weights[k] == 0) continue;
            const auto add = [&](const char* semantic,
                                 std::vector<Vec3>& values) -> Expected<void> {
                const auto it = source_.targets[k].find(semantic);
                if (it == source_.targets[k].end() || values.empty()) return {};
                const auto numbers = read_numbers(asset_, it->second);
                if (!numbers)
                    return refuse(concat(where_, ".targets[", k, "].", semantic),
                                  numbers.error().message);
                const std::vector<Vec3> offsets = vec3s(*numbers);
                for (std::size_t v = 0; v < values.size(); ++v)
                    values[v] += static_cast<float>(weights[k]) * offsets[v];
                return {};
            };
            ENVBAKE_TRY_VOID(add("POSITION", out.positions));
            ENVBAKE_TRY_VOID(add("NORMAL", out.normals));
        }
        return {};
    }

    Expected<void> read_influences(Primitive& out) {
        for (int set = 0;; ++set) {
            ENVBAKE_TRY(const auto joints, attribute(concat("JOINTS_", set)));
            ENVBAKE_TRY(const auto weights, attribute(concat("WEIGHTS_", set)));
            if (!joints || !weights) break;
            const std::size_t old_width = out.influences_per_vertex, width = old_width + 4;
            std::vector<Influence> wider(out.positions.size() * width);
            for (std::size_t v = 0; v < out.positions.size(); ++v) {
                std::copy_n(out.influences.begin() + static_cast<long>(v * old_width), old_width,
                            wider.begin() + static_cast<long>(v * width));
                for (std::size_t k = 0; k < 4; ++k) {
                    const float weight = weights->values[4 * v + k];
                    if (!(weight >= 0) || !std::isfinite(weight))
                        return refuse(concat(where_, ".attributes.WEIGHTS_", set),
                                      concat("vertex ", v, " has the weight ", weight));
                    wider[v * width + old_width + k] = {
                        static_cast<std::uint32_t>(joints->values[4 * v + k]), weight};
                }
            }
            out.influences = std::move(wider);
            out.influences_per_vertex = width;
        }
        const std::size_t width = out.influences_per_vertex;
        for (std::size_t v = 0; width != 0 && v < out.positions.size(); ++v) {
            const std::span<Influence> own(out.influences.data() + v * width, width);
            double sum = 0;
            for (const Influence& i : own) sum += i.weight;
            if (sum == 0) {
                ++repairs_.unweighted_vertices;
                own[0].weight = 1;
                continue;
            }
            for (Influence& i : own) i.weight = static_cast<float>(i.weight / sum);
        }
        return {};
    }

    Expected<void> read_triangles(Primitive& out) {
        const std::size_t vertex_count = out.positions.size();
        std::vector<std::uint32_t> indices;
        if (draco_) {
            indices = std::move(draco_->indices);
        } else if (source_.indices >= 0) {
            auto read = read_indices(asset_, source_.indices);
            if (!read) return refuse(where_ + ".indices", read.error().message);
            indices = *std::move(read);
        } else {
            indices.resize(vertex_count);
            for (std::size_t i = 0; i < vertex_count; ++i)
                indices[i] = static_cast<std::uint32_t>(i);
        }
        const std::uint32_t restart = restart_index();
        for (std::size_t i = 0; i < indices.size(); ++i) {
            if (indices[i] == restart)
                return refuse(where_ + ".indices",
                              concat("index ", i, " is ", restart,
                                     ", the primitive restart value, which glTF forbids"));
            if (indices[i] >= vertex_count)
                return refuse(where_ + ".indices",
                              concat("index ", i, " is ", indices[i], ", the primitive has ",
                                     vertex_count, " vertices"));
        }
        out.triangles = triangles(draco_ ? TINYGLTF_MODE_TRIANGLES : source_.mode,
                                  std::move(indices), repairs_);
        return {};
    }

    std::uint32_t restart_index() const {
        if (source_.indices < 0 || draco_) return std::numeric_limits<std::uint32_t>::max();
        switch (asset_.model().accessors[static_cast<std::size_t>(source_.indices)].componentType) {
            case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
                return 0xff;
            case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
                return 0xffff;
            default:
                return 0xffffffff;
        }
    }

    Asset& asset_;
    const tinygltf::Primitive& source_;
    std::string where_;
    Repairs& repairs_;
    std::optional<DracoMesh> draco_;
};

}  // namespace

std::string primitive_path(int mesh, int primitive) {
    return concat("meshes[", mesh, "].primitives[", primitive, "]");
}

Expected<Primitive> read_primitive(Asset& asset, int mesh, int primitive,
                                   std::span<const double> weights, Repairs& repairs) {
    return Reader(asset, mesh, primitive, repairs).read(weights);
}

}  // namespace envbake::gltf
