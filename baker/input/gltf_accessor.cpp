// SPDX-License-Identifier: Apache-2.0
#include "baker/input/gltf_accessor.h"

#include "baker/input/gltf_check.h"

#include <algorithm>
#include <cstring>
#include <type_traits>

namespace envbake::gltf {

namespace {

/// An accessor without a buffer view costs nothing in the file: its zeros need a limit of their
/// own.
constexpr std::size_t kMaxZeroElements = std::size_t{1} << 24;

Error refuse(int accessor, const std::string& why) {
    return {Errc::InvalidInput, concat("accessors[", accessor, "]: ", why)};
}

template <class T>
T load(const std::byte* at) {
    T value;
    std::memcpy(&value, at, sizeof value);
    return value;
}

template <class T>
float to_float(const std::byte* at, bool normalized) {
    const T c = load<T>(at);
    if (!normalized) return static_cast<float>(c);
    const float scaled = static_cast<float>(c) / static_cast<float>(std::numeric_limits<T>::max());
    return std::max(scaled, -1.0f);
}

float component(int component_type, const std::byte* at, bool normalized) {
    switch (component_type) {
        case TINYGLTF_COMPONENT_TYPE_BYTE:
            return to_float<std::int8_t>(at, normalized);
        case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
            return to_float<std::uint8_t>(at, normalized);
        case TINYGLTF_COMPONENT_TYPE_SHORT:
            return to_float<std::int16_t>(at, normalized);
        case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
            return to_float<std::uint16_t>(at, normalized);
        case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
            return static_cast<float>(load<std::uint32_t>(at));
        default:
            return load<float>(at);
    }
}

std::uint32_t unsigned_component(int component_type, const std::byte* at) {
    switch (component_type) {
        case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
            return load<std::uint8_t>(at);
        case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
            return load<std::uint16_t>(at);
        default:
            return load<std::uint32_t>(at);
    }
}

/// Elements in memory: `columns` groups of `rows` components; groups may be padded.
struct Layout {
    int component_type;
    int rows;
    int columns;
    std::size_t column_bytes;

    std::size_t bytes() const { return column_bytes * static_cast<std::size_t>(columns); }
};

Layout layout_of(const tinygltf::Accessor& a) {
    const auto size = static_cast<std::size_t>(component_bytes(a.componentType));
    const auto matrix = [&](int n) {
        return Layout{a.componentType, n, n, (static_cast<std::size_t>(n) * size + 3) / 4 * 4};
    };
    switch (a.type) {
        case TINYGLTF_TYPE_MAT2:
            return matrix(2);
        case TINYGLTF_TYPE_MAT3:
            return matrix(3);
        case TINYGLTF_TYPE_MAT4:
            return matrix(4);
        default: {
            const int n = tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(a.type));
            return {a.componentType, n, 1, static_cast<std::size_t>(n) * size};
        }
    }
}

/// `count` elements, `stride` bytes apart, inside `bytes`. check_document proved as much of the
/// document; this proves it of the bytes.
struct Elements {
    std::span<const std::byte> bytes;
    std::size_t stride = 0;
    std::size_t count = 0;

    const std::byte* at(std::size_t i) const { return bytes.data() + i * stride; }
};

Expected<Elements> elements(Asset& asset, int accessor, int view, std::size_t offset,
                            std::size_t count, std::size_t element_bytes, bool tight) {
    auto bytes = asset.buffer_view(view);
    if (!bytes) return refuse(accessor, bytes.error().message);
    const std::size_t view_stride =
        asset.model().bufferViews[static_cast<std::size_t>(view)].byteStride;
    const std::size_t stride = view_stride != 0 && !tight ? view_stride : element_bytes;
    if (offset > bytes->size() || offset + stride * (count - 1) + element_bytes > bytes->size())
        return refuse(accessor, concat("runs past the end of bufferViews[", view, "]"));
    return Elements{bytes->subspan(offset), stride, count};
}

/// Calls store(element, bytes) for each element that the file gives, base values first.
template <class Store>
Expected<std::size_t> visit(Asset& asset, int accessor, Store store) {
    const tinygltf::Accessor& a = asset.model().accessors[static_cast<std::size_t>(accessor)];
    const std::size_t element_bytes = layout_of(a).bytes();
    if (a.bufferView >= 0) {
        ENVBAKE_TRY(const Elements base, elements(asset, accessor, a.bufferView, a.byteOffset,
                                                  a.count, element_bytes, false));
        for (std::size_t i = 0; i < a.count; ++i) store(i, base.at(i));
    }
    if (a.sparse.isSparse) {
        const auto count = static_cast<std::size_t>(a.sparse.count);
        const int type = a.sparse.indices.componentType;
        ENVBAKE_TRY(const Elements indices,
                    elements(asset, accessor, a.sparse.indices.bufferView,
                             static_cast<std::size_t>(a.sparse.indices.byteOffset), count,
                             static_cast<std::size_t>(component_bytes(type)), true));
        ENVBAKE_TRY(const Elements values,
                    elements(asset, accessor, a.sparse.values.bufferView,
                             static_cast<std::size_t>(a.sparse.values.byteOffset), count,
                             element_bytes, true));
        std::int64_t previous = -1;
        for (std::size_t i = 0; i < count; ++i) {
            const std::uint32_t index = unsigned_component(type, indices.at(i));
            if (index >= a.count)
                return refuse(accessor, concat("sparse.indices[", i, "] is ", index,
                                               ", the accessor has ", a.count, " elements"));
            if (std::int64_t{index} <= previous)
                return refuse(accessor, concat("sparse.indices[", i, "] is ", index,
                                               ", not above the one before"));
            previous = index;
            store(index, values.at(i));
        }
    }
    return a.count;
}

Expected<std::size_t> affordable_count(Asset& asset, int accessor) {
    const tinygltf::Accessor& a = asset.model().accessors[static_cast<std::size_t>(accessor)];
    if (a.bufferView < 0 && a.count > kMaxZeroElements)
        return refuse(accessor, concat("has ", a.count, " elements and no bufferView; at most ",
                                       kMaxZeroElements, " are read"));
    if (a.bufferView >= 0) {  // the bytes must exist before their copy is allocated
        auto bytes = asset.buffer_view(a.bufferView);
        if (!bytes) return refuse(accessor, bytes.error().message);
    }
    return a.count;
}

}  // namespace

Expected<Numbers> read_numbers(Asset& asset, int accessor) {
    const tinygltf::Accessor& a = asset.model().accessors[static_cast<std::size_t>(accessor)];
    const Layout layout = layout_of(a);
    ENVBAKE_TRY(const std::size_t count, affordable_count(asset, accessor));
    Numbers numbers;
    numbers.components = layout.rows * layout.columns;
    numbers.values.assign(count * static_cast<std::size_t>(numbers.components), 0.0f);
    const auto size = static_cast<std::size_t>(component_bytes(layout.component_type));
    ENVBAKE_TRY_VOID(visit(asset, accessor, [&](std::size_t i, const std::byte* at) {
        float* out = numbers.values.data() + i * static_cast<std::size_t>(numbers.components);
        for (int column = 0; column < layout.columns; ++column, at += layout.column_bytes)
            for (int row = 0; row < layout.rows; ++row)
                *out++ = component(layout.component_type, at + static_cast<std::size_t>(row) * size,
                                   a.normalized);
    }));
    return numbers;
}

Expected<std::vector<std::uint32_t>> read_indices(Asset& asset, int accessor) {
    const int type = asset.model().accessors[static_cast<std::size_t>(accessor)].componentType;
    ENVBAKE_TRY(const std::size_t count, affordable_count(asset, accessor));
    std::vector<std::uint32_t> indices(count, 0);
    ENVBAKE_TRY_VOID(visit(asset, accessor, [&](std::size_t i, const std::byte* at) {
        indices[i] = unsigned_component(type, at);
    }));
    return indices;
}

Expected<Numbers> read_numbers(const Asset& asset, int accessor, const DracoAttribute& attribute) {
    const tinygltf::Accessor& a = asset.model().accessors[static_cast<std::size_t>(accessor)];
    const Layout layout = layout_of(a);
    if (layout.columns != 1 || layout.rows != attribute.component_count ||
        layout.component_type != attribute.component_type)
        return refuse(accessor,
                      concat("has ", layout.rows, " components of type ", layout.component_type,
                             ", the Draco attribute has ", attribute.component_count, " of type ",
                             attribute.component_type));
    const auto size = static_cast<std::size_t>(component_bytes(layout.component_type));
    Numbers numbers;
    numbers.components = layout.rows;
    numbers.values.resize(attribute.bytes.size() / size);
    for (std::size_t i = 0; i < numbers.values.size(); ++i)
        numbers.values[i] =
            component(layout.component_type, attribute.bytes.data() + i * size, a.normalized);
    return numbers;
}

}  // namespace envbake::gltf
