// SPDX-License-Identifier: Apache-2.0
#include "baker/core/text.h"
#include "baker/pipeline/run.h"

#include "envbake/runtime/half.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace envbake {

Expected<void> Run::keep_on_disk(const std::string& output, const PlannedDiffuse& diffuse) {
    if (!store_) {
        ENVBAKE_TRY(RowStore store, RowStore::create(request_.output.parent_path()));
        store_.emplace(std::move(store));
    }
    const std::size_t begin = store_->size();
    const auto sink = [&](std::span<const float> rows) { return store_->append(rows); };
    ENVBAKE_TRY(DiffuseReport report, stages_.rows(output, in_time(diffuse.job, diffuse.mesh),
                                                   diffuse.mesh, false, sink));
    report_.array_errors[output] = error_of_transport(report.error_rms);
    report_.diffuse[diffuse.mesh] = report;
    on_disk_.push_back({diffuse.mesh, begin, store_->size() - begin});
    return {};
}

Expected<std::vector<TransportPart>> Run::waiting_parts() {
    std::vector<TransportPart> parts;
    if (store_) {
        ENVBAKE_TRY(const std::span<const float> all, store_->map());
        for (const OnDisk& part : on_disk_)
            parts.push_back({part.mesh, all.subspan(part.begin, part.size)});
    }
    for (std::size_t m = 0; m < transport_.size(); ++m)
        if (!transport_[m].rows.empty()) parts.push_back({m, transport_[m].rows});
    return parts;
}

Expected<void> Run::bake(const std::string&, const PlannedEncoding& planned) {
    ENVBAKE_TRY(const std::vector<TransportPart> parts, waiting_parts());
    const auto channels = static_cast<std::size_t>(bounce_channels_);
    const auto coeffs = static_cast<std::size_t>(planned.bands * planned.bands);
    // Of rows: |T_unoccluded|_2 of every channel, so that errors are their rms over channels.
    const double norm = unoccluded_norm(planned.bands) * std::sqrt(static_cast<double>(channels));
    const EncodedTransport encoded =
        encode_transport(planned.encoding, parts, coeffs * channels, planned.tolerance * norm,
                         planned.tolerance, request_.seed);
    if (!encoded.clusters.clusters.empty()) ENVBAKE_TRY_VOID(write_basis(encoded.clusters, coeffs));
    report_.encodings.resize(inputs_.facts.meshes.size());
    for (std::size_t i = 0; i < parts.size(); ++i) {
        const EncodedPart& part = encoded.parts[i];
        ENVBAKE_TRY_VOID(write(parts[i], part, encoded.clusters, coeffs));
        const double rms = part.error.rms / norm, worst = part.error.worst / norm;
        DiffuseReport& of_mesh = *report_.diffuse[parts[i].mesh];
        of_mesh.error_rms = std::hypot(of_mesh.error_rms, rms);
        of_mesh.error_p999 = std::hypot(of_mesh.error_p999, worst);
        report_.encodings[parts[i].mesh] = {encoding_name(part.encoding), rms, worst};
        const std::string output = concat("mesh/", parts[i].mesh, "/diffuse");
        BakeReport::ArrayError error = report_.array_errors[output];
        report_.array_errors.erase(output);
        error.value = of_mesh.error_rms;
        report_.array_errors[part.clustered() ? output + "_weights" : output] = error;
    }
    return {};
}

std::vector<std::uint64_t> Run::coefficient_axes(std::size_t coeffs) const {
    std::vector<std::uint64_t> axes{coeffs};
    if (bounce_channels_ > 1) axes.push_back(static_cast<std::uint64_t>(bounce_channels_));
    return axes;
}

Expected<void> Run::write_basis(const ClusteredRows& clusters, std::size_t coeffs) {
    std::vector<std::uint64_t> shape{
        clusters.cluster_count(coeffs * static_cast<std::size_t>(bounce_channels_)),
        clusters.weight_count + 1};
    for (const std::uint64_t axis : coefficient_axes(coeffs)) shape.push_back(axis);
    if (!clusters.half_basis)
        return add<float>("mesh/diffuse_basis", shape, clusters.basis, format::Codec::None);
    std::vector<format::Half> halves;
    for (const float value : clusters.basis) halves.push_back({runtime::float_to_half(value)});
    return add<format::Half>("mesh/diffuse_basis", shape, halves, format::Codec::None);
}

Expected<void> Run::write(const TransportPart& part, const EncodedPart& encoded,
                          const ClusteredRows& clusters, std::size_t coeffs) {
    const std::size_t row_size = coeffs * static_cast<std::size_t>(bounce_channels_);
    const std::uint64_t vertices = part.rows.size() / row_size;
    const std::string output = concat("mesh/", part.mesh, "/diffuse");
    const std::span<const float> emitted =
        part.mesh < transport_.size() ? std::span<const float>(transport_[part.mesh].emitted)
                                      : std::span<const float>();
    std::vector<float> as_read(row_size);
    const auto keep = [&](const auto& asked) {
        if (asked.mesh != part.mesh) return;
        if (encoded.clustered())
            clusters.decode(encoded.first_row + asked.vertex, as_read);
        else
            round_trip(encoded.code, part.rows.subspan(asked.vertex * row_size, row_size), as_read);
        keep_self_test_rows(part.mesh, asked.vertex, as_read, row_size,
                            emitted.empty() ? emitted : emitted.subspan(3 * asked.vertex, 3));
    };
    std::for_each(stored_.vertices.begin(), stored_.vertices.end(), keep);
    std::for_each(stored_.glossy_vertices.begin(), stored_.glossy_vertices.end(), keep);
    if (encoded.clustered()) {
        const std::size_t n = clusters.weight_count;
        ENVBAKE_TRY_VOID(add<std::uint8_t>(
            output + "_weights", {vertices, n},
            std::span(clusters.weights).subspan(encoded.first_row * n, vertices * n), codec()));
        const auto numbers = std::span(clusters.clusters).subspan(encoded.first_row, vertices);
        if (clusters.cluster_count(row_size) > 256)
            return add<std::uint16_t>(output + "_cluster", {vertices}, numbers, codec());
        const std::vector<std::uint8_t> bytes(numbers.begin(), numbers.end());
        return add<std::uint8_t>(output + "_cluster", {vertices}, bytes, codec());
    }
    std::vector<std::uint64_t> shape = coefficient_axes(coeffs);
    if (!encoded.code.range.empty()) {
        shape.push_back(2);
        ENVBAKE_TRY_VOID(
            add<float>(output + "_range", shape, encoded.code.range, format::Codec::None));
        shape.pop_back();
    }
    shape.insert(shape.begin(), vertices);
    ENVBAKE_TRY_VOID(begin({output, element_type(encoded.code.encoding), shape, codec()}));
    constexpr std::size_t kRowsAtOnce = 4096;
    for (std::size_t at = 0; at < part.rows.size(); at += kRowsAtOnce * row_size) {
        const auto rows =
            part.rows.subspan(at, std::min(kRowsAtOnce * row_size, part.rows.size() - at));
        ENVBAKE_TRY_VOID(append(encode_rows(encoded.code, rows)));
    }
    ENVBAKE_TRY_VOID(end());
    return {};
}

}  // namespace envbake
