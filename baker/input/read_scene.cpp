// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_scene.h"

#include "baker/input/gltf_accessor.h"
#include "baker/input/gltf_asset.h"
#include "baker/input/gltf_materials.h"
#include "baker/input/gltf_primitive.h"
#include "baker/input/gltf_uri.h"
#include "baker/input/image_worker.h"

#include <glm/gtc/quaternion.hpp>
#include <glm/mat4x4.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <map>
#include <new>
#include <set>
#include <utility>

namespace envbake {

namespace {

using gltf::Asset;
using gltf::Influence;
using gltf::Primitive;
using gltf::Repairs;
using DMat4 = glm::dmat4;

constexpr std::uint64_t kMaxIndices = 3 * kMaxVertices;

Error refuse(std::string message) {
    return {Errc::InvalidInput, std::move(message)};
}

DMat4 local_matrix(const tinygltf::Node& node) {
    DMat4 m(1);
    if (node.matrix.size() == 16) {
        for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = node.matrix[static_cast<std::size_t>(i)];
        return m;
    }
    if (const auto& q = node.rotation; q.size() == 4)
        m = glm::mat4_cast(glm::normalize(glm::dquat(q[3], q[0], q[1], q[2])));
    if (const auto& s = node.scale; s.size() == 3)
        for (int i = 0; i < 3; ++i) m[i] *= s[static_cast<std::size_t>(i)];
    if (const auto& t = node.translation; t.size() == 3) m[3] = glm::dvec4(t[0], t[1], t[2], 1);
    return m;
}

/// Nodes depth first, in file order, from the given roots. An explicit stack: depth is the file's
/// choice.
template <class Visit>
void depth_first(const tinygltf::Model& model, const std::vector<int>& roots, Visit visit) {
    std::vector<std::pair<int, int>> stack;  // node, parent
    for (auto it = roots.rbegin(); it != roots.rend(); ++it) stack.emplace_back(*it, -1);
    while (!stack.empty()) {
        const auto [node, parent] = stack.back();
        stack.pop_back();
        visit(node, parent);
        const auto& children = model.nodes[static_cast<std::size_t>(node)].children;
        for (auto it = children.rbegin(); it != children.rend(); ++it)
            stack.emplace_back(*it, node);
    }
}

std::vector<int> root_nodes(const tinygltf::Model& model) {
    std::vector<bool> is_child(model.nodes.size(), false);
    for (const auto& node : model.nodes)
        for (const int child : node.children) is_child[static_cast<std::size_t>(child)] = true;
    std::vector<int> roots;
    for (std::size_t i = 0; i < is_child.size(); ++i)
        if (!is_child[i]) roots.push_back(static_cast<int>(i));
    return roots;
}

/// The default scene; without one, the first; without any, everything.
std::vector<int> scene_roots(const tinygltf::Model& model) {
    if (model.scenes.empty()) return root_nodes(model);
    return model.scenes[static_cast<std::size_t>(std::max(model.defaultScene, 0))].nodes;
}

/// inverse(transpose(linear)) up to a positive factor, and defined for singular matrices too: there
/// the cofactors still give the normal of a flattened surface, and 0 where even that is lost.
DMat3 normal_matrix(const DMat3& linear) {
    const DMat3 cofactors(glm::cross(linear[1], linear[2]), glm::cross(linear[2], linear[0]),
                          glm::cross(linear[0], linear[1]));
    return glm::determinant(linear) < 0 ? -cofactors : cofactors;
}

Vec3 unit_or_zero(const DVec3& v) {
    // Scaled by the largest component first: neither 1e-30 nor 1e200 may over- or underflow.
    const double largest = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    if (!(largest > 0) || !std::isfinite(largest)) return Vec3(0);
    return Vec3(glm::normalize(v / largest));
}

DVec3 corner(const Mesh& mesh, std::size_t index) {
    return DVec3(mesh.positions[mesh.triangles[index]]);
}

/// Replaces the normals that are zero by the weighted mean of the triangles around the vertex.
void compute_missing_normals(Mesh& mesh, NormalWeighting weighting) {
    std::vector<DVec3> sums(mesh.vertex_count(), DVec3(0));
    for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
        const std::array<DVec3, 3> p{corner(mesh, t), corner(mesh, t + 1), corner(mesh, t + 2)};
        const DVec3 twice_area = glm::cross(p[1] - p[0], p[2] - p[0]);
        const double length = glm::length(twice_area);
        if (!(length > 0)) continue;
        for (std::size_t k = 0; k < 3; ++k) {
            DVec3& sum = sums[mesh.triangles[t + k]];
            if (weighting == NormalWeighting::Area) {
                sum += twice_area;
            } else {
                const DVec3 a = p[(k + 1) % 3] - p[k], b = p[(k + 2) % 3] - p[k];
                sum += twice_area / length * std::atan2(length, glm::dot(a, b));
            }
        }
    }
    for (std::size_t v = 0; v < sums.size(); ++v)
        if (mesh.normals[v] == Vec3(0)) mesh.normals[v] = unit_or_zero(sums[v]);
}

std::uint64_t degenerate_triangles(const Mesh& mesh) {
    std::uint64_t count = 0;
    for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
        const DVec3 p = corner(mesh, t);
        const DVec3 normal = glm::cross(corner(mesh, t + 1) - p, corner(mesh, t + 2) - p);
        count += normal == DVec3(0) ? 1 : 0;
    }
    return count;
}

/// Where the vertices of a primitive go: one matrix, or one a vertex when it is skinned.
class Placement {
  public:
    explicit Placement(const DMat4& world) : world_(world) {}

    static Expected<Placement> of_skin(Asset& asset, int skin_index,
                                       const std::vector<DMat4>& world) {
        const tinygltf::Skin& skin = asset.model().skins[static_cast<std::size_t>(skin_index)];
        Placement placement{DMat4(1)};
        for (const int joint : skin.joints)
            placement.joints_.push_back(world[static_cast<std::size_t>(joint)]);
        if (skin.inverseBindMatrices >= 0) {
            const auto read = gltf::read_numbers(asset, skin.inverseBindMatrices);
            if (!read)
                return refuse(
                    concat("skins[", skin_index, "].inverseBindMatrices: ", read.error()));
            for (std::size_t j = 0; j < placement.joints_.size(); ++j) {
                DMat4 inverse_bind(1);
                for (std::size_t i = 0; i < 16; ++i)
                    inverse_bind[static_cast<int>(i / 4)][static_cast<int>(i % 4)] =
                        double{read->values[16 * j + i]};
                placement.joints_[j] = placement.joints_[j] * inverse_bind;
            }
        }
        return placement;
    }

    bool skinned() const { return !joints_.empty(); }
    std::size_t joint_count() const { return joints_.size(); }

    /// Of vertex `v`. A skinned mesh ignores the transform of its own node [glTF 2.0, 3.7.3.3].
    DMat4 matrix(const Primitive& primitive, std::size_t v) const {
        if (!skinned()) return world_;
        DMat4 sum(0);
        const std::size_t width = primitive.influences_per_vertex;
        for (std::size_t k = 0; k < width; ++k) {
            const Influence& i = primitive.influences[v * width + k];
            if (i.weight > 0) sum += joints_[i.joint] * double{i.weight};
        }
        return sum;
    }

  private:
    DMat4 world_;
    std::vector<DMat4> joints_;
};

class SceneReader {
  public:
    SceneReader(Asset asset, const ReadSceneOptions& options)
        : asset_(std::move(asset)), model_(asset_.model()), options_(options) {}

    Expected<Scene> read() {
        if (options_.textures && asset_.image_count() > 0) start_image_worker();
        scene_.materials = gltf::read_materials(model_, scene_.notes);
        world_.assign(model_.nodes.size(), DMat4(1));
        depth_first(model_, root_nodes(model_), [&](int node, int parent) {
            const DMat4 local = local_matrix(model_.nodes[static_cast<std::size_t>(node)]);
            world_[static_cast<std::size_t>(node)] =
                parent < 0 ? local : world_[static_cast<std::size_t>(parent)] * local;
        });
        std::vector<int> nodes;  // that show a mesh
        depth_first(model_, scene_roots(model_), [&](int node, int) {
            if (model_.nodes[static_cast<std::size_t>(node)].mesh >= 0) nodes.push_back(node);
        });
        ENVBAKE_TRY_VOID(check_size(nodes));
        for (const int node : nodes) ENVBAKE_TRY_VOID(add_node(node));
        if (triangle_count_ == 0) return nothing_to_bake();

        assign_default_material();
        ENVBAKE_TRY_VOID(read_images());
        write_notes();
        scene_.files_read = asset_.files_read;
        scene_.file_name = asset_.files_read.front().filename().string();
        return std::move(scene_);
    }

  private:
    Error nothing_to_bake() const {
        std::string why =
            model_.nodes.empty() ? "the file has no nodes" : "the default scene has no triangles";
        if (!asset_.faults.empty()) why += concat(" (and ", asset_.faults.front(), ")");
        return refuse("nothing to bake: " + why);
    }

    const tinygltf::Mesh& mesh_of(const tinygltf::Node& node) const {
        return model_.meshes[static_cast<std::size_t>(node.mesh)];
    }

    /// Before anything is read: the document says how much there will be.
    Expected<void> check_size(const std::vector<int>& nodes) {
        std::uint64_t vertices = 0, indices = 0;
        const auto count = [&](int accessor) {
            return std::uint64_t{model_.accessors[static_cast<std::size_t>(accessor)].count};
        };
        for (const int n : nodes) {
            const tinygltf::Node& node = model_.nodes[static_cast<std::size_t>(n)];
            ++uses_[node.mesh];
            for (const auto& primitive : mesh_of(node).primitives) {
                const auto position = primitive.attributes.find("POSITION");
                if (position == primitive.attributes.end()) continue;
                vertices += count(position->second);
                indices +=
                    primitive.indices >= 0 ? count(primitive.indices) : count(position->second);
                if (vertices > kMaxVertices || indices > kMaxIndices)
                    return refuse(concat("nodes[", n, "]: with it the scene has ", vertices,
                                         " vertices and ", indices, " indices; at most ",
                                         kMaxVertices, " and ", kMaxIndices, " are read"));
            }
        }
        return {};
    }

    Expected<void> add_node(int node_index) {
        const tinygltf::Node& node = model_.nodes[static_cast<std::size_t>(node_index)];
        Placement placement(world_[static_cast<std::size_t>(node_index)]);
        if (node.skin >= 0) {
            ENVBAKE_TRY(placement, Placement::of_skin(asset_, node.skin, world_));
            ++skinned_nodes_;
        }
        const int count = static_cast<int>(mesh_of(node).primitives.size());
        for (int p = 0; p < count; ++p) {
            Primitive own;
            const Primitive* primitive = nullptr;
            ENVBAKE_TRY(primitive, find_primitive(node, p, own));
            ENVBAKE_TRY(Mesh mesh, place(*primitive, placement, node_index, p));
            triangle_count_ += mesh.triangle_count();
            scene_.meshes.push_back(std::move(mesh));
        }
        return {};
    }

    /// A primitive that several nodes show is read once; else it is read into `own`.
    Expected<const Primitive*> find_primitive(const tinygltf::Node& node, int p, Primitive& own) {
        const tinygltf::Mesh& mesh = mesh_of(node);
        const bool shared = uses_[node.mesh] > 1 && node.weights.empty();
        const auto known = shared_.find({node.mesh, p});
        if (shared && known != shared_.end()) return &std::as_const(known->second);
        const std::vector<double>& weights = node.weights.empty() ? mesh.weights : node.weights;
        ENVBAKE_TRY(own, gltf::read_primitive(asset_, node.mesh, p, weights, repairs_));
        if (own.positions.empty())
            scene_.notes.push_back(
                concat(gltf::primitive_path(node.mesh, p), ": has no POSITION, so no vertices"));
        if (!shared) return &std::as_const(own);
        return &std::as_const(shared_[{node.mesh, p}] = std::move(own));
    }

    Expected<Mesh> place(const Primitive& primitive, const Placement& placement, int node_index,
                         int p) {
        const tinygltf::Node& node = model_.nodes[static_cast<std::size_t>(node_index)];
        const tinygltf::Mesh& source = mesh_of(node);
        const std::string where =
            concat("nodes[", node_index, "], ", gltf::primitive_path(node.mesh, p));
        Mesh mesh;
        mesh.node = node_index;
        mesh.mesh = node.mesh;
        mesh.primitive = p;
        mesh.node_name = node.name;
        mesh.mesh_name = source.name;
        mesh.material = source.primitives[static_cast<std::size_t>(p)].material;
        ENVBAKE_TRY_VOID(read_marks(source.extras, concat("meshes[", node.mesh, "].extras"), mesh));
        ENVBAKE_TRY_VOID(read_marks(node.extras, concat("nodes[", node_index, "].extras"), mesh));
        mesh.uv0 = primitive.uv0;
        mesh.uv1 = primitive.uv1;
        mesh.colors = primitive.colors;
        mesh.triangles = primitive.triangles;

        const std::size_t n = primitive.positions.size();
        if (placement.skinned())
            for (std::size_t i = 0; i < primitive.influences.size(); ++i)
                if (const Influence& f = primitive.influences[i];
                    f.weight > 0 && f.joint >= placement.joint_count())
                    return refuse(concat(where, ": vertex ", i / primitive.influences_per_vertex,
                                         " refers to joint ", f.joint, ", skins[", node.skin,
                                         "] has ", placement.joint_count()));
        mesh.positions.resize(n);
        mesh.normals.assign(n, Vec3(0));
        mesh.normals_computed = primitive.normals.empty();
        double orientation = 0;  // of a skinned mesh: by the majority of its vertices
        DMat4 m = n > 0 ? placement.matrix(primitive, 0) : DMat4(1);
        DMat3 normals = normal_matrix(DMat3(m));
        for (std::size_t v = 0; v < n; ++v) {
            if (placement.skinned()) {
                m = placement.matrix(primitive, v);
                normals = normal_matrix(DMat3(m));
            }
            orientation += glm::determinant(DMat3(m)) < 0 ? -1 : 1;
            const Vec3 position(DVec3(m * glm::dvec4(DVec3(primitive.positions[v]), 1)));
            if (!std::isfinite(position.x) || !std::isfinite(position.y) ||
                !std::isfinite(position.z))
                return refuse(concat(where, ": the transform puts vertex ", v, " at (", position.x,
                                     ", ", position.y, ", ", position.z,
                                     "), positions must be finite"));
            mesh.positions[v] = position;
            if (mesh.normals_computed) continue;
            mesh.normals[v] = unit_or_zero(normals * DVec3(primitive.normals[v]));
            bad_normals_ += mesh.normals[v] == Vec3(0) ? 1 : 0;
        }
        if (orientation < 0)
            for (std::size_t t = 0; t < mesh.triangles.size(); t += 3)
                std::swap(mesh.triangles[t + 1], mesh.triangles[t + 2]);
        if (std::find(mesh.normals.begin(), mesh.normals.end(), Vec3(0)) != mesh.normals.end())
            compute_missing_normals(mesh, options_.computed_normals);
        if (mesh.normals_computed && !mesh.triangles.empty()) ++meshes_without_normals_;
        degenerate_triangles_ += degenerate_triangles(mesh);
        return mesh;
    }

    Expected<void> read_marks(const tinygltf::Value& extras, const std::string& where, Mesh& mesh) {
        if (!extras.IsObject() || !extras.Has("envbake")) return {};
        const tinygltf::Value& marks = extras.Get("envbake");
        if (!marks.IsObject()) return refuse(where + ".envbake: must be an object");
        for (const std::string& key : marks.Keys()) {
            bool Mesh::*const mark = key == "receives" ? &Mesh::receives
                                     : key == "casts"  ? &Mesh::casts
                                                       : nullptr;
            if (mark == nullptr) {
                unknown_marks_.insert(concat(where, ".envbake.", gltf::shown(key),
                                             " is not known: receives and casts are"));
                continue;
            }
            if (!marks.Get(key).IsBool())
                return refuse(concat(where, ".envbake.", key, ": must be true or false"));
            mesh.*mark = marks.Get(key).Get<bool>();
        }
        return {};
    }

    void assign_default_material() {
        const int index = static_cast<int>(scene_.materials.size());
        bool used = false;
        for (Mesh& mesh : scene_.meshes) {
            if (mesh.material >= 0) continue;
            mesh.material = index;
            used = true;
        }
        if (used) scene_.materials.emplace_back().name = "default";
    }

    /// Decodes what decides something: the textures of materials that cover triangles.
    Expected<void> read_images() {
        scene_.images.resize(asset_.image_count());
        for (std::size_t i = 0; i < scene_.images.size(); ++i)
            scene_.images[i].name = asset_.image_name(static_cast<int>(i));
        std::set<int> wanted;
        std::set<std::string> lacking;
        for (const Mesh& mesh : scene_.meshes) {
            if (mesh.triangles.empty()) continue;
            const Material& material = scene_.materials[static_cast<std::size_t>(mesh.material)];
            for (const auto* texture :
                 {&material.base_color_texture, &material.metallic_roughness_texture,
                  &material.emission_texture}) {
                if (!*texture) continue;
                wanted.insert((*texture)->image);
                if (((*texture)->uv_set == 1 ? mesh.uv1 : mesh.uv0).empty())
                    lacking.insert(concat(gltf::primitive_path(mesh.mesh, mesh.primitive),
                                          ": its material uses TEXCOORD_", (*texture)->uv_set,
                                          ", which it lacks: the texel at (0, 0) is used"));
            }
        }
        scene_.notes.insert(scene_.notes.end(), lacking.begin(), lacking.end());
        if (!options_.textures) return {};
        for (const int i : wanted) {
            Image& image = scene_.images[static_cast<std::size_t>(i)];
            ENVBAKE_TRY(const std::vector<std::byte> encoded, asset_.image_bytes(i));
            const std::string name = image.name;
            ENVBAKE_TRY(image,
                        decode_image(encoded, concat("images[", i, "] ", gltf::shown(name))));
            image.name = name;
        }
        return {};
    }

    void write_notes() {
        const auto note = [&](std::uint64_t count, const auto&... text) {
            if (count > 0) scene_.notes.push_back(concat(count, text...));
        };
        note(meshes_without_normals_,
             " meshes have no normals: computed, smooth over shared vertices");
        note(bad_normals_, " normals are zero or not finite: computed");
        note(degenerate_triangles_, " of ", triangle_count_, " triangles have no area");
        note(repairs_.leftover_indices,
             " indices at the end of triangle lists make no triangle: ignored");
        note(repairs_.clamped_colors, " vertex colour components are outside 0 .. 1: clamped");
        note(repairs_.zeroed_uvs, " texture coordinates are not finite: set to 0");
        note(repairs_.unweighted_vertices,
             " skinned vertices have no weights: bound to their first joint");
        note(skinned_nodes_, " nodes are skinned: taken in the pose of the file's nodes");
        scene_.notes.insert(scene_.notes.end(), unknown_marks_.begin(), unknown_marks_.end());
        std::string passed_over;
        for (const std::string& name : asset_.unread_extensions)
            passed_over += concat(passed_over.empty() ? "" : ", ", gltf::shown(name));
        if (!passed_over.empty()) scene_.notes.push_back("extensions passed over: " + passed_over);
        for (const std::string& fault : asset_.faults)
            scene_.notes.push_back("not valid glTF, but harmless: " + fault);
    }

    Asset asset_;
    const tinygltf::Model& model_;
    ReadSceneOptions options_;
    Scene scene_;
    std::vector<DMat4> world_;                         ///< of every node
    std::map<int, int> uses_;                          ///< nodes that show a mesh
    std::map<std::pair<int, int>, Primitive> shared_;  ///< by mesh and primitive
    std::set<std::string> unknown_marks_;
    Repairs repairs_;
    std::uint64_t triangle_count_ = 0;
    std::uint64_t degenerate_triangles_ = 0;
    std::uint64_t meshes_without_normals_ = 0;
    std::uint64_t bad_normals_ = 0;
    std::uint64_t skinned_nodes_ = 0;
};

Expected<Scene> read_unnamed(const std::filesystem::path& file, const ReadSceneOptions& options) {
    ENVBAKE_TRY(Asset asset, Asset::open(file));
    return SceneReader(std::move(asset), options).read();
}

}  // namespace

Expected<Scene> read_scene(const std::filesystem::path& file, const ReadSceneOptions& options) {
    try {
        auto scene = read_unnamed(file, options);
        if (scene) return scene;
        return Error{scene.error().code, concat(file.string(), ": ", scene.error().message)};
    } catch (const std::bad_alloc&) {
        return Error{Errc::Failed,
                     concat(file.string(), ": there is not enough memory for the scene")};
    } catch (const std::exception& e) {  // of the standard library: nothing else gets here
        return Error{Errc::Failed, concat(file.string(), ": ", gltf::shown(e.what()))};
    }
}

}  // namespace envbake
