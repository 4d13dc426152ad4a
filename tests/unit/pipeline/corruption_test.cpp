// SPDX-License-Identifier: Apache-2.0
// Bundles of every released minor version, kept in tests/golden for ever, whole and damaged: what
// is damaged is found, and harms neither the validator nor the runtime.
#include "baker/pipeline/validate.h"
#include "tests/support/bundle_bytes.h"
#include "tests/support/counted_new.h"
#include "tests/support/sanitized.h"

#include "envbake/format/writer.h"
#include "envbake/runtime/bundle.h"
#include "envbake/runtime/shade.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <new>
#include <set>
#include <string>
#include <vector>

namespace envbake {
namespace {

namespace fs = std::filesystem;

/// Every byte of an array is damaged; where a sanitizer makes each try some fifty times as long,
/// every 13th, and all of header and table.
constexpr std::size_t kArrayStride = test::kAddressSanitizer ? 13 : 1;

/// Memory of exactly the file's size, so that a sanitizer sees one byte too many.
class Memory {
  public:
    explicit Memory(const std::string& bytes)
        : size_(bytes.size()), data_(new (std::align_val_t(64)) std::byte[size_]) {
        std::memcpy(data_, bytes.data(), size_);
    }
    ~Memory() { ::operator delete[](data_, std::align_val_t(64)); }
    Memory(const Memory&) = delete;
    Memory& operator=(const Memory&) = delete;
    std::span<std::byte> span() { return {data_, size_}; }
    std::span<const std::byte> span() const { return {data_, size_}; }
    std::byte& operator[](std::size_t at) { return data_[at]; }

  private:
    std::size_t size_;
    std::byte* data_;
};

/// The names of what is wrong with these bytes. The runtime shades from them where it takes them.
std::vector<std::string> faults(std::span<const std::byte> bytes) {
    const std::size_t before = test::allocated_bytes();
    const auto bundle = runtime::Bundle::open(bytes);
    EXPECT_LE(test::allocated_bytes() - before, 16u << 20);  // of a file under 1 MiB
    if (bundle) {
        runtime::Rgb radiance = runtime::irradiance(bundle->lighting(), {0, 1, 0});
        for (const runtime::Mesh& mesh : bundle->meshes())
            runtime::diffuse_exit(mesh.diffuse, bundle->lighting(), 0, {&radiance, 1});
        radiance = runtime::specular(*bundle, {0, 1, 0}, {0, 1, 0}, 0.5f, {1, 1, 1});
        static_cast<void>(radiance);
    }
    const auto reader = format::Reader::open(bytes);
    if (!reader) return {std::string(format::to_string(reader.error().code))};
    std::vector<std::string> names;
    for (const Finding& finding : validate_bundle(*reader)) names.push_back(finding.name);
    return names;
}

class Golden : public ::testing::TestWithParam<const char*> {
  protected:
    void SetUp() override {
        std::ifstream in(fs::path(ENVBAKE_GOLDEN_BUNDLES) / GetParam(), std::ios::binary);
        bytes_.assign(std::istreambuf_iterator<char>(in), {});
        ASSERT_GT(bytes_.size(), 1000u);
    }
    std::string bytes_;
};

TEST_P(Golden, IsReadForEver) {
    EXPECT_EQ(faults(Memory(bytes_).span()), std::vector<std::string>{});
}

TEST_P(Golden, EveryDamagedByteIsFound) {
    std::uint64_t table = 0;
    std::memcpy(&table, bytes_.data() + 24, 8);
    Memory memory(bytes_);
    for (std::size_t at = 0; at < bytes_.size(); ++at) {
        if (at >= format::kHeaderSize && at < table && at % kArrayStride != 0) continue;
        for (const unsigned mask : {0x01u, 0x80u, 0xffu}) {
            memory[at] ^= static_cast<std::byte>(mask);
            EXPECT_FALSE(faults(memory.span()).empty()) << "byte " << at << " ^ " << mask;
            memory[at] ^= static_cast<std::byte>(mask);
        }
    }
}

TEST_P(Golden, EveryTruncationAndWhatIsAppendedIsRefused) {
    for (std::size_t size = 0; size < bytes_.size(); ++size)
        EXPECT_FALSE(format::Reader::open(Memory(bytes_.substr(0, size)).span())) << size;
    for (const std::size_t more : {1u, 7u, 64u, 4096u})
        for (const char byte : {'\0', '\xff'})
            EXPECT_EQ(faults(Memory(bytes_ + std::string(more, byte)).span()),
                      std::vector<std::string>{"FileSize"});
}

// Both checksums made right again: only the rules behind them are left to refuse.
TEST_P(Golden, EveryIntegerAtItsBoundariesIsANamedError) {
    std::uint64_t table = 0;
    std::memcpy(&table, bytes_.data() + 24, 8);
    std::uint32_t count = 0;
    std::memcpy(&count, bytes_.data() + 12, 4);
    struct Field {
        std::size_t at, size;
    };
    // Not the minor version, which may be any, nor the checksums.
    std::vector<Field> fields{{8, 2}, {12, 4}, {16, 8}, {24, 8}, {32, 8}, {48, 8}};
    for (std::size_t i = 0; i < count; ++i) {
        const std::size_t entry = table + 96 * i;
        for (const Field& f :
             {Field{0, 4}, {4, 2}, {6, 1}, {7, 1}, {8, 1}, {64, 8}, {72, 8}, {80, 8}})
            fields.push_back({entry + f.at, f.size});
        for (std::size_t byte = 9; byte < 16; ++byte) fields.push_back({entry + byte, 1});
        for (std::size_t axis = 0; axis < 6; ++axis) fields.push_back({entry + 16 + 8 * axis, 8});
    }
    std::size_t tried = 0;
    for (const Field& field : fields) {
        std::uint64_t old = 0;
        std::memcpy(&old, bytes_.data() + field.at, field.size);
        const std::uint64_t largest = ~std::uint64_t{0} >> (64 - 8 * field.size);
        std::set<std::uint64_t> values;
        for (const std::uint64_t value :
             {std::uint64_t{0}, std::uint64_t{1}, old - 1, old + 1, old - 64, old + 64, largest,
              largest - 1, largest - 63, largest / 2, largest / 2 + 1, std::uint64_t{bytes_.size()},
              std::uint64_t{bytes_.size() + 1}, table, table + 64})
            values.insert(value & largest);
        values.erase(old);
        for (const std::uint64_t value : values) {
            Memory memory(bytes_);
            std::memcpy(&memory[field.at], &value, field.size);
            test::seal(memory.span(), table);
            const auto names = faults(memory.span());
            EXPECT_FALSE(names.empty()) << "byte " << field.at << ": " << old << " -> " << value;
            for (const std::string& name : names) EXPECT_NE(name, "None");
            ++tried;
        }
    }
    EXPECT_GT(tried, 500u);
}

// Zeros that decode to as much as may be: a little file, and the reader's largest request.
TEST(Readers, AskForNoMoreThanTheyMay) {
    constexpr std::uint64_t kRow = 25 * sizeof(float), kVertices = (8u << 20) / kRow;
    const fs::path file = fs::path(::testing::TempDir()) / "zeros.envb";
    auto writer = format::Writer::create(file.string());
    ASSERT_TRUE(writer);
    const std::vector<float> zeros(kVertices * 25);
    ASSERT_TRUE(writer->add<float>("mesh/0/diffuse", {kVertices, 25}, zeros, format::Codec::Zstd));
    const std::string metadata =
        R"({"meshes":[{"node":0,"node_name":"","mesh":0,"mesh_name":"","primitive":0,"vertex_count":)" +
        std::to_string(kVertices) + "}]}";
    ASSERT_TRUE(writer->add<std::uint8_t>(
        std::string(format::kMetadataName), {metadata.size()},
        {reinterpret_cast<const std::uint8_t*>(metadata.data()), metadata.size()},
        format::Codec::None));
    ASSERT_TRUE(writer->finish());
    EXPECT_LT(fs::file_size(file), 1u << 20);
    const std::size_t before = test::allocated_bytes();
    const auto bundle = runtime::Bundle::open(file.c_str());
    ASSERT_TRUE(bundle) << format::to_string(bundle.error());
    EXPECT_GT(test::allocated_bytes() - before, 7u << 20);
    EXPECT_LE(test::allocated_bytes() - before, 16u << 20);
    fs::remove(file);
}

INSTANTIATE_TEST_SUITE_P(Bundles, Golden,
                         ::testing::Values("1.0-sky.envb", "1.0-scene.envb", "1.0-grey.envb"));

}  // namespace
}  // namespace envbake
