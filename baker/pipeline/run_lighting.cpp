// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/pipeline/encode_mip.h"
#include "baker/pipeline/run.h"

#include "envbake/runtime/half.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace envbake {

Expected<void> Run::bake(const std::string& output, const PlannedLights&) {
    std::vector<float> rows;
    for (const DominantLight& light : inputs_.lights.lights) {
        for (int c = 0; c < 3; ++c) rows.push_back(static_cast<float>(light.direction[c]));
        for (int c = 0; c < 3; ++c) rows.push_back(static_cast<float>(light.irradiance[c]));
        for (const double x : {light.angular_radius, light.solid_angle, light.share})
            rows.push_back(static_cast<float>(x));
    }
    ENVBAKE_TRY_VOID(require_finite(rows));
    return add<float>(output, {rows.size() / 9, 9}, rows, format::Codec::None);
}

ShLighting Run::planned_lighting(const PlannedSh& sh) {
    ShLighting lighting = first_bands(*inputs_.sh, sh.bands);
    if (!sh.window) return lighting;
    if (!report_.window) report_.window = nonnegative_window(lighting);
    return windowed(lighting, *report_.window);
}

Expected<void> Run::bake(const std::string& output, const PlannedSh& sh) {
    ShLighting lighting = planned_lighting(sh);
    if (sh.irradiance) lighting = to_irradiance(lighting);
    std::vector<float> values;
    for (const DVec3& coeff : lighting.coeffs)
        for (int c = 0; c < sh.channels; ++c) values.push_back(static_cast<float>(coeff[c]));
    ENVBAKE_TRY_VOID(require_finite(values));
    if (!sh.irradiance) {
        stored_.bands = lighting.bands;
        for (std::size_t i = 0; i < 3 * lighting.coeffs.size(); ++i)
            stored_.sh.push_back(values[sh.channels == 1 ? i / 3 : i]);
    }
    report_.array_errors[output] = {0x1p-24, "rounding to f32, relative to each coefficient"};
    return add<float>(output, {lighting.coeffs.size(), static_cast<std::uint64_t>(sh.channels)},
                      values, format::Codec::None);
}

Expected<void> Run::bake(const std::string& output, const PlannedMips& mips) {
    report_.mip_count = stored_.mip_count = mips.level_count;
    ENVBAKE_TRY(std::vector<Mip> baked, stages_.mips(output, mips.job));
    for (Mip& mip : baked) {
        mip.error_estimate += mips.contrast;
        lobe_of(report_, mips.job.distribution)
            .mip_levels.push_back(
                {mip.level, mip.faces, mip.width, mip.height, mip.perceptual_roughness});
        ENVBAKE_TRY_VOID(store(concat(output, "/", mip.level), mip,
                               lobe_of(stored_, mips.job.distribution).mips));
    }
    return {};
}

Expected<void> Run::store(const std::string& name, const Mip& mip,
                          std::vector<StoredArrays::Mip>& stored_mips) {
    std::vector<std::uint64_t> shape;
    if (mip.faces == 6) shape.push_back(6);
    for (const int extent : {mip.height, mip.width, mip.channels})
        shape.push_back(static_cast<std::uint64_t>(extent));
    StoredArrays::Mip stored{mip.level, mip.faces, mip.width, mip.height, mip.channels, {}};
    double error = mip.error_estimate;
    // A tenth of the tolerance is what half floats may add.
    if (const auto half =
            encode_half(mip, inputs_.facts.environment->mean, request_.tolerance / 10)) {
        error += half->error;
        for (const format::Half& h : half->texels)
            stored.texels.push_back(runtime::half_to_float(h.bits));
        ENVBAKE_TRY_VOID(add<format::Half>(name, shape, half->texels, codec()));
    } else {
        stored.texels = mip.texels;
        ENVBAKE_TRY_VOID(add<float>(name, shape, stored.texels, codec()));
    }
    report_.array_errors[name] = {
        error, request_.certify
                   ? "proved: no |v - r| / (r + 1e-3 mean) of any texel and channel is larger"
                   : "worst |v - r| / (r + 1e-3 mean) over texels and channels"};
    stored_mips.push_back(std::move(stored));
    return {};
}

Expected<void> Run::bake(const std::string& output, const PlannedTable& planned) {
    ENVBAKE_TRY(BrdfTable table, stages_.table(output, planned.job));
    StoredArrays::Lobe& stored = lobe_of(stored_, planned.job.distribution);
    stored.table_size = planned.job.size;
    stored_.table_axes = planned.job.axes;
    const auto size = static_cast<std::uint64_t>(planned.job.size);
    report_.array_errors[output] = {
        table.lookup_error,
        concat("worst |bilinear look-up - true|, roughness from ", kSharpestRoughness)};
    if (planned.half) {
        std::vector<format::Half> halves;
        for (const std::uint16_t bits : half_texels(table)) {
            halves.push_back({bits});
            stored.table.push_back(runtime::half_to_float(bits));
        }
        report_.array_errors[output].value += 0x1p-11;
        ENVBAKE_TRY_VOID(add<format::Half>(output, {size, size, 2}, halves, format::Codec::None));
    } else {
        for (const Vec2& texel : table.texels)
            stored.table.insert(stored.table.end(), {texel.x, texel.y});
        ENVBAKE_TRY_VOID(add<float>(output, {size, size, 2}, stored.table, format::Codec::None));
    }
    ENVBAKE_TRY_VOID(
        add<float>(output + "_average_albedo", {size}, table.average_albedo, format::Codec::None));
    lobe_of(report_, planned.job.distribution).table = std::move(table);
    return {};
}

Expected<void> Run::bake(const std::string& output, const PlannedLobe& planned) {
    const LobeExpansionJob& job = planned.job;
    ENVBAKE_TRY(const LobeExpansion lobe, stages_.lobe(output, job));
    const auto rows = static_cast<std::uint64_t>(lobe.rows);
    const auto store = [&](const char* part, std::span<const float> values) {
        return add<float>(concat(output, part), {rows, 2, values.size() / (2 * rows)}, values,
                          format::Codec::None);
    };
    ENVBAKE_TRY_VOID(store("/unoccluded", lobe.unoccluded));
    ENVBAKE_TRY_VOID(store("/kernel", lobe.kernel));
    note(job, lobe);
    return {};
}

void Run::note(const LobeExpansionJob& job, const LobeExpansion& lobe) {
    const bool ggx = job.distribution == runtime::Distribution::Ggx;
    (ggx ? report_.ggx_lobe : report_.beckmann_lobe) = {job, lobe.rows};
    StoredArrays::Lobe& stored = lobe_of(stored_, job.distribution);
    stored.lobe_rows = lobe.rows;
    stored.unoccluded = lobe.unoccluded;
    stored.kernel = lobe.kernel;
    stored_.exit_bands = job.exit_bands;
    stored_.light_bands = job.light_bands;
    std::copy(std::begin(job.roughness), std::end(job.roughness), stored_.lobe_roughness);
}

}  // namespace envbake
