// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace envbake::test {

constexpr int kByte = 5120, kUByte = 5121, kShort = 5122, kUShort = 5123, kUInt = 5125,
              kFloat = 5126;

/// A glTF file in the making: accessors with their own buffer views in one buffer, and whatever
/// else a test puts into `document`. Numbers are written as the machine has them: little-endian.
struct GltfText {
    nlohmann::json document = {{"asset", {{"version", "2.0"}}}};
    std::vector<std::uint8_t> bytes;

    int view(const void* data, std::size_t size, int stride = 0) {
        bytes.resize((bytes.size() + 3) / 4 * 4);
        nlohmann::json v = {{"buffer", 0}, {"byteOffset", bytes.size()}, {"byteLength", size}};
        if (stride > 0) v["byteStride"] = stride;
        const std::size_t begin = bytes.size();
        bytes.resize(begin + size);
        std::memcpy(bytes.data() + begin, data, size);
        return push("bufferViews", v);
    }

    template <class T>
    int accessor(const char* type, int component_type, const std::vector<T>& values,
                 std::size_t count, bool normalized = false) {
        const int v = view(values.data(), values.size() * sizeof(T));
        return push("accessors", {{"bufferView", v},
                                  {"type", type},
                                  {"componentType", component_type},
                                  {"count", count},
                                  {"normalized", normalized}});
    }
    int vec3(const std::vector<float>& v) { return accessor("VEC3", kFloat, v, v.size() / 3); }
    int vec2(const std::vector<float>& v) { return accessor("VEC2", kFloat, v, v.size() / 2); }
    int indices(const std::vector<std::uint16_t>& v) {
        return accessor("SCALAR", kUShort, v, v.size());
    }

    int push(const char* collection, const nlohmann::json& element) {
        document[collection].push_back(element);
        return static_cast<int>(document[collection].size()) - 1;
    }

    /// A mesh of one primitive.
    int mesh(const nlohmann::json& primitive) {
        return push("meshes", {{"primitives", nlohmann::json::array({primitive})}});
    }

    /// The document with its buffer as a data URI.
    std::string text() const {
        nlohmann::json out = document;
        if (!bytes.empty())
            out["buffers"] = {{{"byteLength", bytes.size()},
                               {"uri", "data:application/octet-stream;base64," + base64(bytes)}}};
        return out.dump();
    }

    /// The same as a GLB.
    std::string glb() const {
        nlohmann::json out = document;
        out["buffers"] = {{{"byteLength", bytes.size()}}};
        std::string json = out.dump();
        json.resize((json.size() + 3) / 4 * 4, ' ');
        std::string bin(bytes.begin(), bytes.end());
        bin.resize((bin.size() + 3) / 4 * 4, '\0');
        const auto u32 = [](std::size_t n) {
            std::string s(4, '\0');
            for (std::size_t i = 0; i < 4; ++i) s[i] = static_cast<char>(n >> (8 * i) & 0xff);
            return s;
        };
        return "glTF" + u32(2) + u32(28 + json.size() + bin.size()) + u32(json.size()) + "JSON" +
               json + u32(bin.size()) + std::string("BIN\0", 4) + bin;
    }

    static std::string base64(const std::vector<std::uint8_t>& data) {
        const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        std::string out;
        for (std::size_t i = 0; i < data.size(); i += 3) {
            const auto at = [&](std::size_t k) {
                return k < data.size() ? std::uint32_t{data[k]} : std::uint32_t{0};
            };
            const std::uint32_t bits = at(i) << 16 | at(i + 1) << 8 | at(i + 2);
            for (std::size_t k = 0; k < 4; ++k)
                out += i + k > data.size() ? '=' : digits[bits >> (18 - 6 * k) & 63];
        }
        return out;
    }
};

/// A folder of this test's own, removed with it.
class TempFolder {
  public:
    TempFolder() {
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        path_ = std::filesystem::path(testing::TempDir()) /
                (std::string("envbake_") + info->test_suite_name() + "_" + info->name());
        std::filesystem::remove_all(path_);
        std::filesystem::create_directories(path_);
    }
    ~TempFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    TempFolder(const TempFolder&) = delete;
    TempFolder& operator=(const TempFolder&) = delete;

    const std::filesystem::path& path() const { return path_; }

    std::filesystem::path write(const std::string& name, const std::string& content) const {
        const std::filesystem::path file = path_ / name;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file, std::ios::binary) << content;
        return file;
    }

  private:
    std::filesystem::path path_;
};

}  // namespace envbake::test
