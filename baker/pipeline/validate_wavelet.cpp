// SPDX-License-Identifier: Apache-2.0
#include "baker/pipeline/validate_wavelet.h"

#include "baker/core/error.h"
#include "baker/core/text.h"
#include "envbake/runtime/wavelet.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <span>
#include <vector>

namespace envbake {

namespace {

constexpr std::string_view kIndex = "environment/wavelet/index";
constexpr std::string_view kValue = "environment/wavelet/value";
constexpr std::string_view kWeight = "wavelet/weight";
constexpr std::string_view kBlocks = "/wavelet/blocks", kOffsets = "/wavelet/offsets";
constexpr std::uint64_t kBlockSize = 256;  ///< vertices
constexpr std::uint32_t kUpper = 0x80000000;

bool ends_with(std::string_view text, std::string_view end) {
    return text.size() >= end.size() && text.substr(text.size() - end.size()) == end;
}

/// What is wrong with a block of `vertices` vertices; null where nothing is.
const char* fault_of(std::span<const std::uint32_t> words, std::uint64_t vertices,
                     std::uint64_t coeffs) {
    if (words.empty()) return "it has no words";
    const std::uint64_t run_count = words[0], head = 2 * run_count + 2;
    if (head > words.size()) return "its runs do not fit";
    const auto runs = words.subspan(1, run_count),
               first = words.subspan(1 + run_count, run_count + 1);
    const std::uint64_t count = first.back();
    if (head + (2 * count + 3) / 4 != words.size()) return "its entries do not fill it";
    const auto* entries = reinterpret_cast<const std::uint8_t*>(words.data() + head);
    for (std::uint64_t at = 2 * count; at < 4 * (words.size() - head); ++at)
        if (entries[at] != 0) return "what fills its last word is not 0";
    if (first[0] != 0) return "its first run does not begin with entry 0";
    for (std::size_t r = 0; r < runs.size(); ++r) {
        const auto key = [&](std::size_t i) {
            return 2 * std::uint64_t{runs[i] & ~kUpper} + (runs[i] >> 31);
        };
        if ((runs[r] & ~kUpper) >= coeffs) return "a run is of a coefficient that is none";
        if (r > 0 && key(r) <= key(r - 1)) return "its runs do not ascend";
        if (first[r] >= first[r + 1]) return "a run has no entries";
        if (first[r + 1] > count) return "a run goes beyond the entries";
        for (std::uint64_t e = first[r]; e < first[r + 1]; ++e) {
            if (entries[e] >= vertices) return "an entry is of a vertex that is none";
            if (e > first[r] && entries[e] <= entries[e - 1])
                return "the vertices of a run do not ascend";
            if (entries[count + e] == 0) return "an entry is 0";
        }
    }
    return nullptr;
}

class WaveletCheck {
  public:
    WaveletCheck(const format::Reader& reader, const Json& metadata,
                 const std::function<void(const FormatRule&, std::string)>& add)
        : reader_(reader), metadata_(metadata), add_(add) {}

    void run() {
        bool any = false, transport = false;
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            if (!is_wavelet_name(info.name)) continue;
            any = true;
            transport = transport || mesh_of_wavelet(info.name);
            check_type(info);
        }
        if (any) check_basis(transport);
        if (!good_) return;
        check_lighting();
        for (std::size_t i = 0; i < reader_.array_count(); ++i) {
            const format::ArrayInfo info = reader_.array(i);
            if (mesh_of_wavelet(info.name)) check_mesh(info);
        }
        check_vertices_asked_for();
    }

  private:
    void fail(const FormatRule& broken, std::string message) {
        good_ = false;
        add_(broken, std::move(message));
    }

    void check_type(const format::ArrayInfo& info) {
        using format::ElementType;
        const ElementType type =
            info.name == kValue || info.name == kWeight ? ElementType::F32 : ElementType::U32;
        if (info.type != type)
            fail(rule::kWaveletType,
                 concat("array ", info.name, ": is ", format::to_string(info.type), ", ",
                        format::to_string(type), " is accepted"));
        const bool table = info.name == kValue;
        if (info.rank != (table ? 2 : 1) || (table && info.shape[1] != 3 && info.shape[1] != 1))
            fail(rule::kWaveletShape, concat("array ", info.name, ": its shape is not ",
                                             table ? "[K, 3] or [K, 1]" : "of one axis"));
        if (info.codec != format::Codec::None)
            fail(rule::kWaveletStored, concat("array ", info.name, ": is compressed"));
    }

    void check_basis(bool transport) {
        const Json basis = metadata_.value("wavelet", Json::object());
        const Json size = basis.is_object() ? basis.value("face_size", Json()) : Json();
        if (size.is_number_unsigned() && wavelet::is_face_size(size.get<std::uint64_t>()))
            coeffs_ = wavelet::coeff_count(size.get<int>());
        else
            fail(rule::kWaveletFaceSize, "wavelet.face_size is none of 16, 32, 64 and 128");
        const Json step = basis.is_object() ? basis.value("step", Json()) : Json();
        if (transport && !(step.is_number() && step.get<double>() > 0 && step.get<double>() <= 1))
            fail(rule::kWaveletStep, "wavelet.step is no number in (0, 1]");
    }

    void check_lighting() {
        const auto index = reader_.find(kIndex), value = reader_.find(kValue),
                   weight = reader_.find(kWeight);
        if (index.has_value() != value.has_value())
            fail(rule::kWaveletPair, concat("array ", index ? kValue : kIndex, " is missing"));
        else if (index && index->shape[0] != value->shape[0])
            fail(rule::kWaveletShape, concat("array ", kValue, ": not one value for each index"));
        if (weight && weight->shape[0] != coeffs_)
            fail(rule::kWaveletShape,
                 concat("array ", kWeight, ": not one for each of ", coeffs_, " coefficients"));
        if (!index) return;
        const auto indices = *reader_.view<std::uint32_t>(kIndex);
        for (std::size_t i = 0; i < indices.size(); ++i) {
            if (indices[i] < coeffs_ && (i == 0 || indices[i] > indices[i - 1])) continue;
            fail(rule::kWaveletIndex, concat("array ", kIndex, ": element ", i, " is ", indices[i],
                                             ", not above the one before and below ", coeffs_));
            return;
        }
    }

    void check_mesh(const format::ArrayInfo& info) {
        const std::uint64_t mesh = *mesh_of_wavelet(info.name);
        const std::string prefix = concat("mesh/", mesh);
        const bool is_offsets = ends_with(info.name, kOffsets);
        const std::string other = concat(prefix, is_offsets ? kBlocks : kOffsets);
        if (!reader_.find(other)) {
            fail(rule::kWaveletPair, concat("array ", other, " is missing"));
            return;
        }
        if (is_offsets) return;
        const auto words = *reader_.view<std::uint32_t>(info.name);
        const auto offsets = *reader_.view<std::uint32_t>(other);
        const Json meshes = metadata_.value("meshes", Json::array());
        if (mesh >= meshes.size()) return;  // another rule's
        const Json count = meshes[static_cast<std::size_t>(mesh)].value("vertex_count", Json());
        if (!count.is_number_unsigned()) return;
        const auto vertices = count.get<std::uint64_t>();
        const std::uint64_t blocks = (vertices + kBlockSize - 1) / kBlockSize;
        if (offsets.size() != blocks + 1 || offsets.front() != 0 ||
            offsets.back() != words.size() || !std::is_sorted(offsets.begin(), offsets.end())) {
            fail(rule::kWaveletOffsets, concat("array ", other, ": not ", blocks + 1,
                                               " numbers that rise from 0 to ", words.size()));
            return;
        }
        for (std::uint64_t b = 0; b < blocks; ++b) {
            const auto block = words.subspan(offsets[b], offsets[b + 1] - offsets[b]);
            const char* fault =
                fault_of(block, std::min(kBlockSize, vertices - b * kBlockSize), coeffs_);
            if (fault == nullptr) continue;
            fail(rule::kWaveletBlock, concat("array ", info.name, ": block ", b, ": ", fault));
            return;
        }
    }

    /// A question about a vertex has one that is stored.
    void check_vertices_asked_for() {
        const auto vertices = reader_.view<std::uint32_t>("selftest/wavelet/vertex");
        if (!vertices) return;
        const Json meshes = metadata_.value("meshes", Json::array());
        for (std::size_t i = 0; i + 1 < vertices->size(); i += 2) {
            const std::uint32_t mesh = (*vertices)[i], vertex = (*vertices)[i + 1];
            if (mesh < meshes.size() && reader_.find(concat("mesh/", mesh, kBlocks)) &&
                meshes[mesh].value("vertex_count", Json()) > vertex)
                continue;
            fail(rule::kWaveletVertexAbsent,
                 concat("array selftest/wavelet/vertex: row ", i / 2, " asks for vertex ", vertex,
                        " of mesh/", mesh, "/wavelet, which is not stored"));
            return;
        }
    }

    const format::Reader& reader_;
    const Json& metadata_;
    const std::function<void(const FormatRule&, std::string)>& add_;
    std::uint64_t coeffs_ = 0;
    bool good_ = true;
};

}  // namespace

std::optional<std::uint64_t> mesh_of_wavelet(std::string_view name) {
    constexpr std::string_view kMesh = "mesh/";
    if (name.substr(0, kMesh.size()) != kMesh) return std::nullopt;
    name.remove_prefix(kMesh.size());
    const std::size_t size = name.find('/');
    const std::string_view digits = name.substr(0, size);
    if (size == std::string_view::npos || digits.empty() ||
        (digits.size() > 1 && digits[0] == '0') ||
        digits.find_first_not_of("0123456789") != std::string_view::npos)
        return std::nullopt;
    if (name.substr(size) != kBlocks && name.substr(size) != kOffsets) return std::nullopt;
    std::uint64_t mesh = 0;
    if (std::from_chars(digits.data(), digits.data() + size, mesh).ec != std::errc())
        mesh = std::numeric_limits<std::uint64_t>::max();
    return mesh;
}

bool is_wavelet_name(std::string_view name) {
    return name == kIndex || name == kValue || name == kWeight || mesh_of_wavelet(name).has_value();
}

void check_wavelets(const format::Reader& reader, const Json& metadata,
                    const std::function<void(const FormatRule&, std::string)>& add) {
    WaveletCheck(reader, metadata, add).run();
}

}  // namespace envbake
