// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/encode_transport.h"

#include <algorithm>
#include <cmath>

namespace envbake {

namespace {

RowEncoding row_encoding(Encoding encoding) {
    switch (encoding) {
        case Encoding::F16:
            return RowEncoding::F16;
        case Encoding::Unorm16:
            return RowEncoding::Unorm16;
        case Encoding::Unorm8:
            return RowEncoding::Unorm8;
        default:
            return RowEncoding::F32;
    }
}

EncodedPart encode_part(Encoding encoding, const TransportPart& part, std::size_t row_size) {
    EncodedPart encoded{
        encoding, make_row_code(row_encoding(encoding), part.rows, row_size), 0, {}};
    encoded.error = encoding_error(encoded.code, part.rows);
    return encoded;
}

EncodedPart smallest(const TransportPart& part, std::size_t row_size, double tolerance) {
    for (const Encoding encoding : {Encoding::Unorm8, Encoding::Unorm16}) {
        EncodedPart encoded = encode_part(encoding, part, row_size);
        if (encoded.error.rms <= tolerance) return encoded;
    }
    return encode_part(Encoding::F32, part, row_size);
}

RowError clustering_error(const ClusteredRows& clusters, std::size_t first_row,
                          std::span<const float> rows, std::size_t row_size) {
    RowError error;
    std::vector<float> read(row_size);
    double sum = 0;
    const std::size_t count = rows.size() / row_size;
    for (std::size_t v = 0; v < count; ++v) {
        clusters.decode(first_row + v, read);
        double square = 0;
        for (std::size_t i = 0; i < row_size; ++i) {
            const double difference = double{rows[v * row_size + i]} - double{read[i]};
            square += difference * difference;
        }
        sum += square;
        error.worst = std::max(error.worst, std::sqrt(square));
    }
    if (count > 0) error.rms = std::sqrt(sum / static_cast<double>(count));
    return error;
}

std::uint64_t bytes_of(std::span<const EncodedPart> encoded, std::span<const TransportPart> parts) {
    std::uint64_t bytes = 0;
    for (std::size_t i = 0; i < parts.size(); ++i)
        bytes += parts[i].rows.size() * element_bytes(encoded[i].code.encoding) +
                 encoded[i].code.range.size() * sizeof(float);
    return bytes;
}

}  // namespace

format::ElementType element_type(RowEncoding encoding) {
    switch (encoding) {
        case RowEncoding::F16:
            return format::ElementType::F16;
        case RowEncoding::Unorm16:
            return format::ElementType::U16;
        case RowEncoding::Unorm8:
            return format::ElementType::U8;
        case RowEncoding::F32:
            break;
    }
    return format::ElementType::F32;
}

std::optional<RowEncoding> row_encoding(format::ElementType type) {
    switch (type) {
        case format::ElementType::F32:
            return RowEncoding::F32;
        case format::ElementType::F16:
            return RowEncoding::F16;
        case format::ElementType::U16:
            return RowEncoding::Unorm16;
        case format::ElementType::U8:
            return RowEncoding::Unorm8;
        default:
            return {};
    }
}

EncodedTransport encode_transport(Encoding encoding, std::span<const TransportPart> parts,
                                  std::size_t row_size, double tolerance, double relative,
                                  std::uint64_t seed) {
    EncodedTransport result;
    if (encoding != Encoding::Clustered)
        for (const TransportPart& part : parts)
            result.parts.push_back(encoding == Encoding::Auto
                                       ? smallest(part, row_size, tolerance)
                                       : encode_part(encoding, part, row_size));
    if (encoding != Encoding::Clustered && encoding != Encoding::Auto) return result;

    // Rounding a basis to f16 adds some 3e-4.
    const ClusterJob job{row_size, tolerance, relative >= 1e-3, seed};
    std::vector<std::span<const float>> rows;
    for (const TransportPart& part : parts) rows.push_back(part.rows);
    ClusteredRows clusters = cluster_rows(job, rows);
    if (encoding == Encoding::Auto &&
        (clusters.error_rms > tolerance || clusters.bytes(job) >= bytes_of(result.parts, parts)))
        return result;

    result.parts.clear();
    std::size_t first_row = 0;
    for (const TransportPart& part : parts) {
        result.parts.push_back({Encoding::Clustered,
                                {},
                                first_row,
                                clustering_error(clusters, first_row, part.rows, row_size)});
        first_row += part.rows.size() / row_size;
    }
    result.clusters = std::move(clusters);
    return result;
}

}  // namespace envbake
