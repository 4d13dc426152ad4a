// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/older_bundle.h"

#include "baker/pipeline/array_values.h"
#include "baker/pipeline/encode_transport.h"

#include "envbake/runtime/bundle.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace envbake {

namespace {

using format::ElementType;

bool is_intact(const format::Reader& reader, const std::string& name) {
    const auto info = reader.find(name);
    return info && reader.verify(*info);
}

template <class To, class From>
std::vector<To> converted(std::span<const std::byte> bytes) {
    std::vector<From> from(bytes.size() / sizeof(From));
    if (!from.empty()) std::memcpy(from.data(), bytes.data(), from.size() * sizeof(From));
    return {from.begin(), from.end()};
}

}  // namespace

Error unexpected(std::string_view array) {
    return {Errc::InvalidBundle, concat(array, ": not what its stage leaves")};
}

std::optional<OlderBundle> OlderBundle::open(const std::filesystem::path& file) {
    auto reader = format::Reader::open(file.c_str());
    if (!reader || !is_intact(*reader, std::string(format::kMetadataName))) return {};
    Json metadata = parse_metadata(reader->metadata());
    return OlderBundle(std::move(*reader), std::move(metadata));
}

OlderBundle::OlderBundle(format::Reader reader, Json metadata)
    : reader_(std::move(reader)), metadata_(std::move(metadata)) {
    if (!metadata_.is_object() || !metadata_.contains("plan")) return;
    std::size_t at = 0;
    for (const Json& stage : metadata_["plan"]) {
        if (stage.is_object() && stage.contains("output") && stage["output"].is_string())
            stages_.try_emplace(stage["output"].get<std::string>(), at);
        ++at;
    }
}

std::optional<std::vector<std::string>> OlderBundle::arrays_of(const std::string& output,
                                                               const std::string& key) const try {
    const auto at = stages_.find(output);
    if (at == stages_.end()) return {};
    const Json& stage = metadata_.at("plan").at(at->second);
    if (!stage.contains("key") || stage.at("key") != key) return {};
    auto names = stage.at("arrays").get<std::vector<std::string>>();
    for (const std::string& name : names)
        if (!is_intact(reader_, name)) return {};
    return names;
} catch (const Json::exception&) {
    return {};  // another tool's
}

Expected<OlderBundle::Elements> OlderBundle::elements(const std::string& name) const {
    const auto info = reader_.find(name);
    if (!info) return unexpected(name);
    Elements elements{*info, {}, reader_.stored_bytes(*info)};
    if (info->codec != format::Codec::None) {
        ENVBAKE_TRY(elements.decoded, read_bytes(reader_, *info));
        elements.bytes = elements.decoded;
    }
    return elements;
}

Expected<std::vector<float>> OlderBundle::floats(const std::string& name,
                                                 std::uint64_t count) const {
    ENVBAKE_TRY(const Elements read, elements(name));
    if (read.info.element_count() != count) return unexpected(name);
    std::vector<float> values(count);
    if (read.info.type == ElementType::F32)
        decode_rows({RowEncoding::F32, count, {}}, read.bytes, values);
    else if (read.info.type == ElementType::F16)
        decode_rows({RowEncoding::F16, count, {}}, read.bytes, values);
    else
        return unexpected(name);
    return values;
}

Expected<OlderRows> OlderRows::open(const OlderBundle& older, const std::string& name,
                                    std::uint64_t vertex_count, std::size_t row_size) {
    OlderRows rows;
    rows.code_.row_size = row_size;
    if (older.reader().find(name + "_weights")) {
        ENVBAKE_TRY_VOID(rows.read_clusters(older, name, vertex_count));
        return rows;
    }
    ENVBAKE_TRY(rows.rows_, older.elements(name));
    const auto encoding = row_encoding(rows.rows_.info.type);
    if (!encoding || rows.rows_.info.element_count() != vertex_count * row_size)
        return unexpected(name);
    rows.code_.encoding = *encoding;
    if (*encoding == RowEncoding::Unorm16 || *encoding == RowEncoding::Unorm8) {
        ENVBAKE_TRY(rows.code_.range, older.floats(name + "_range", 2 * row_size));
    }
    return rows;
}

Expected<void> OlderRows::read_clusters(const OlderBundle& older, const std::string& name,
                                        std::uint64_t vertex_count) {
    ENVBAKE_TRY(const auto weights, older.elements(name + "_weights"));
    ENVBAKE_TRY(const auto numbers, older.elements(name + "_cluster"));
    const bool wide = numbers.info.type == ElementType::U16;
    const auto basis_info = older.reader().find("mesh/diffuse_basis");
    if (!basis_info || weights.info.type != ElementType::U8 || weights.info.rank != 2 ||
        weights.info.shape[0] != vertex_count ||
        weights.info.shape[1] > runtime::kMaxClusterWeights ||
        !(wide || numbers.info.type == ElementType::U8) ||
        numbers.info.element_count() != vertex_count)
        return unexpected(name + "_weights");
    ClusteredRows& c = clusters_.emplace();
    c.weight_count = weights.info.shape[1];
    c.weights = converted<std::uint8_t, std::uint8_t>(weights.bytes);
    c.clusters = wide ? converted<std::uint16_t, std::uint16_t>(numbers.bytes)
                      : converted<std::uint16_t, std::uint8_t>(numbers.bytes);
    ENVBAKE_TRY(c.basis, older.floats("mesh/diffuse_basis", basis_info->element_count()));
    const std::size_t count = c.cluster_count(code_.row_size);
    for (const std::uint16_t number : c.clusters)
        if (number >= count) return unexpected(name + "_cluster");
    return {};
}

std::vector<float> OlderRows::row(std::uint64_t vertex) const {
    std::vector<float> values(code_.row_size);
    if (clusters_) {
        clusters_->decode(vertex, values);
    } else {
        const std::size_t size = code_.row_size * element_bytes(code_.encoding);
        decode_rows(code_, rows_.bytes.subspan(vertex * size, size), values);
    }
    return values;
}

}  // namespace envbake
