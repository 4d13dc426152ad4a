// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/run.h"

#include <algorithm>
#include <type_traits>
#include <utility>

namespace envbake {

void Run::choose_self_test_vertices() {
    constexpr std::uint64_t kCount = 32;
    std::uint64_t total = 0;
    std::vector<std::pair<std::size_t, std::uint64_t>> baked;  // mesh, vertices
    for (const PlannedStage& stage : plan_.stages) {
        const auto* diffuse = stage.job ? std::get_if<PlannedDiffuse>(&*stage.job) : nullptr;
        if (diffuse == nullptr || !diffuse->job.shadowed) continue;
        baked.emplace_back(diffuse->mesh, vertex_count(diffuse->mesh));
        total += baked.back().second;
    }
    if (total == 0) return;
    const std::uint64_t count = std::min(kCount, total);
    std::uint64_t before = 0;
    std::size_t at = 0;
    for (std::uint64_t k = 0; k < count; ++k) {
        const std::uint64_t wanted = (3 * k + 2) * total / (3 * count);
        while (wanted - before >= baked[at].second) before += baked[at++].second;
        stored_.vertices.push_back({static_cast<std::uint32_t>(baked[at].first),
                                    static_cast<std::uint32_t>(wanted - before),
                                    {}});
    }
}

void Run::choose_glossy_vertices(std::size_t mesh) {
    constexpr std::uint64_t kEach = 6, kMost = 12;
    const std::uint64_t count = vertex_count(mesh);
    for (std::uint64_t k = 0; k < std::min(kEach, count); ++k)
        if (stored_.glossy_vertices.size() < kMost)
            stored_.glossy_vertices.push_back(
                {.mesh = static_cast<std::uint32_t>(mesh),
                 .vertex = static_cast<std::uint32_t>((3 * k + 2) * count / (3 * kEach) % count),
                 .visibility = {},
                 .transport = {}});
}

void Run::keep_self_test_normals(std::size_t mesh, std::span<const float> normals) {
    for (StoredArrays::GlossyVertex& vertex : stored_.glossy_vertices)
        if (vertex.mesh == mesh)
            for (std::size_t c = 0; c < 3; ++c)
                vertex.normal[static_cast<int>(c)] = normals[3 * std::size_t{vertex.vertex} + c];
}

void Run::keep_self_test_rows(std::size_t mesh, std::uint64_t first_vertex,
                              std::span<const float> rows, std::uint64_t row_size,
                              std::span<const float> emitted) {
    const auto keep = [&](auto& vertex) {
        if (vertex.mesh != mesh || vertex.vertex < first_vertex) return;
        const std::uint64_t row = vertex.vertex - first_vertex;
        if (row >= rows.size() / row_size) return;
        const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(row * row_size);
        vertex.transport.assign(begin, begin + static_cast<std::ptrdiff_t>(row_size));
        vertex.channels = bounce_channels_;
        for (std::size_t c = 0; c < 3 && !emitted.empty(); ++c)
            vertex.emitted[static_cast<int>(c)] = static_cast<double>(emitted[3 * row + c]);
    };
    std::for_each(stored_.vertices.begin(), stored_.vertices.end(), keep);
    std::for_each(stored_.glossy_vertices.begin(), stored_.glossy_vertices.end(), keep);
}

Expected<void> Run::write_self_test() {
    const SelfTest test = make_self_test(stored_);
    for (const auto* values :
         {&test.irradiance_value, &test.diffuse_value, &test.wavelet_value, &test.ggx.value,
          &test.beckmann.value, &test.ggx_glossy.value, &test.beckmann_glossy.value})
        ENVBAKE_TRY_VOID(require_finite(*values));
    report_.self_test_tolerance = SelfTest::kTolerance;
    const auto add_rows = [&](const char* name, std::uint64_t columns,
                              const auto& values) -> Expected<void> {
        using T = typename std::decay_t<decltype(values)>::value_type;
        if (values.empty()) return {};
        return add<T>(name, {values.size() / columns, columns}, values, format::Codec::None);
    };
    ENVBAKE_TRY_VOID(add_rows("selftest/irradiance/normal", 3, test.irradiance_normal));
    ENVBAKE_TRY_VOID(add_rows("selftest/irradiance/value", 3, test.irradiance_value));
    ENVBAKE_TRY_VOID(add_rows("selftest/diffuse/vertex", 2, test.diffuse_vertex));
    ENVBAKE_TRY_VOID(add_rows("selftest/diffuse/value", 3, test.diffuse_value));
    ENVBAKE_TRY_VOID(add_rows("selftest/wavelet/vertex", 2, test.wavelet_vertex));
    ENVBAKE_TRY_VOID(add_rows("selftest/wavelet/value", 3, test.wavelet_value));
    ENVBAKE_TRY_VOID(add_rows("selftest/specular/input", 8, test.ggx.input));
    ENVBAKE_TRY_VOID(add_rows("selftest/specular/value", 3, test.ggx.value));
    ENVBAKE_TRY_VOID(add_rows("selftest/specular_beckmann/input", 8, test.beckmann.input));
    ENVBAKE_TRY_VOID(add_rows("selftest/specular_beckmann/value", 3, test.beckmann.value));
    const auto add_glossy = [&](const std::string& group,
                                const SelfTest::Glossy& glossy) -> Expected<void> {
        ENVBAKE_TRY_VOID(add_rows((group + "vertex").c_str(), 2, glossy.vertex));
        ENVBAKE_TRY_VOID(add_rows((group + "input").c_str(), 5, glossy.input));
        return add_rows((group + "value").c_str(), 3, glossy.value);
    };
    ENVBAKE_TRY_VOID(add_glossy("selftest/glossy/", test.ggx_glossy));
    return add_glossy("selftest/glossy_beckmann/", test.beckmann_glossy);
}

}  // namespace envbake
