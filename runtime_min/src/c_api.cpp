// SPDX-License-Identifier: Apache-2.0
#include "envbake/envbake.h"

#include "envbake/runtime/bundle.h"
#include "envbake/runtime/shade.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

namespace format = envbake::format;
namespace runtime = envbake::runtime;

struct envbake_bundle {
    runtime::Bundle bundle;
};

namespace {

static_assert(ENVBAKE_F32 == static_cast<int>(format::ElementType::F32) &&
              ENVBAKE_F16 == static_cast<int>(format::ElementType::F16) &&
              ENVBAKE_U8 == static_cast<int>(format::ElementType::U8) &&
              ENVBAKE_U16 == static_cast<int>(format::ElementType::U16) &&
              ENVBAKE_U32 == static_cast<int>(format::ElementType::U32) &&
              ENVBAKE_I8 == static_cast<int>(format::ElementType::I8) &&
              ENVBAKE_I16 == static_cast<int>(format::ElementType::I16));

int fail(const format::Error& e, envbake_error* error) {
    const int code = static_cast<int>(e.code);
    if (error == nullptr) return code;
    *error = {};
    error->code = code;
    error->system_error = e.system_error;
    error->offset = e.offset;
    static_assert(sizeof error->array == sizeof e.array);
    std::copy(e.array.begin(), e.array.end(), error->array);
    error->array[sizeof error->array - 1] = '\0';
    const std::string_view text = format::describe(e.code);
    text.copy(error->message, sizeof error->message - 1);
    return code;
}

envbake_bundle* hand_over(format::Expected<runtime::Bundle> bundle, envbake_error* error) {
    if (!bundle) {
        fail(bundle.error(), error);
        return nullptr;
    }
    auto* handle = new (std::nothrow) envbake_bundle{*std::move(bundle)};
    if (handle == nullptr) {
        format::Error no_memory = format::Error::at(format::Errc::CannotRead);
        no_memory.system_error = ENOMEM;
        fail(no_memory, error);
    }
    return handle;
}

runtime::Vec3 load(const float* v) {
    return {v[0], v[1], v[2]};
}
void store(const runtime::Rgb& value, float* rgb) {
    std::copy(value.begin(), value.end(), rgb);
}

}  // namespace

envbake_bundle* envbake_open_file(const char* path, envbake_error* error) {
    return hand_over(runtime::Bundle::open(path), error);
}

envbake_bundle* envbake_open_memory(const void* bytes, size_t size, envbake_error* error) {
    return hand_over(runtime::Bundle::open({static_cast<const std::byte*>(bytes), size}), error);
}

void envbake_close(envbake_bundle* bundle) {
    delete bundle;
}

void envbake_irradiance(const envbake_bundle* bundle, const float normal[3], float rgb[3]) {
    store(runtime::irradiance(bundle->bundle.lighting(), load(normal)), rgb);
}

void envbake_specular(const envbake_bundle* bundle, const float normal[3], const float view[3],
                      float roughness, const float r0[3], float rgb[3]) {
    store(runtime::specular(bundle->bundle, load(normal), load(view), roughness, load(r0)), rgb);
}

void envbake_sample_mips(const envbake_bundle* bundle, const float direction[3], float roughness,
                         float rgb[3]) {
    store(runtime::sample_mips(bundle->bundle.mips(), load(direction), roughness), rgb);
}

void envbake_lookup_brdf(const envbake_bundle* bundle, float n_dot_v, float roughness,
                         float a_b[2]) {
    const runtime::SpecularAlbedo albedo =
        runtime::lookup_brdf(bundle->bundle.brdf(), n_dot_v, roughness);
    a_b[0] = albedo.a;
    a_b[1] = albedo.b;
}

size_t envbake_mesh_count(const envbake_bundle* bundle) {
    return bundle->bundle.meshes().size();
}

size_t envbake_mesh_vertex_count(const envbake_bundle* bundle, size_t mesh) {
    const std::span<const runtime::Mesh> meshes = bundle->bundle.meshes();
    return mesh < meshes.size() ? static_cast<size_t>(meshes[mesh].vertex_count) : 0;
}

int envbake_diffuse(const envbake_bundle* bundle, size_t mesh, size_t first, size_t count,
                    float* rgb, envbake_error* error) {
    const std::span<const runtime::Mesh> meshes = bundle->bundle.meshes();
    if (mesh >= meshes.size() || meshes[mesh].diffuse.bands == 0) {
        return fail(format::Error::at(format::Errc::ArrayMissing), error);
    }
    const runtime::TransportView& transport = meshes[mesh].diffuse;
    if (first > transport.vertex_count || count > transport.vertex_count - first) {
        return fail(format::Error::at(format::Errc::BufferSize), error);
    }
    // Blocks on the stack, for a float* of C is not an array of Rgb.
    std::array<runtime::Rgb, 64> block;
    for (size_t done = 0; done < count;) {
        const std::span<runtime::Rgb> out(block.data(), std::min(block.size(), count - done));
        runtime::diffuse_exit(transport, bundle->bundle.lighting(), first + done, out);
        for (const runtime::Rgb& value : out) store(value, rgb + 3 * done++);
    }
    return 0;
}

int envbake_find_array(const envbake_bundle* bundle, const char* name, envbake_array* array,
                       envbake_error* error) {
    const format::Reader& reader = bundle->bundle.reader();
    const std::optional<format::ArrayInfo> info = reader.find(name);
    if (!info) return fail(format::Error::at(format::Errc::ArrayMissing, 0, name), error);
    *array = {};
    if (info->codec == format::Codec::None) array->data = reader.stored_bytes(*info).data();
    array->size = info->size;
    std::copy(info->shape.begin(), info->shape.end(), array->shape);
    array->rank = info->rank;
    array->type = static_cast<int32_t>(info->type);
    return 0;
}

int envbake_read_array(const envbake_bundle* bundle, const char* name, void* memory, size_t size,
                       envbake_error* error) {
    const format::Reader& reader = bundle->bundle.reader();
    const std::optional<format::ArrayInfo> info = reader.find(name);
    if (!info) return fail(format::Error::at(format::Errc::ArrayMissing, 0, name), error);
    const format::Expected<void> read = reader.read(*info, {static_cast<std::byte*>(memory), size});
    return read ? 0 : fail(read.error(), error);
}

const char* envbake_metadata(const envbake_bundle* bundle, size_t* size) {
    const std::string_view text = bundle->bundle.reader().metadata();
    if (size != nullptr) *size = text.size();
    return text.empty() ? nullptr : text.data();
}
