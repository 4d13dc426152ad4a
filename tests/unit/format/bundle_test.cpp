// SPDX-License-Identifier: Apache-2.0
#include "envbake/format/reader.h"
#include "envbake/format/writer.h"
#include "tests/support/bundle_bytes.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <numeric>
#include <string>

namespace envbake::format {
namespace {

namespace fs = std::filesystem;

/// Memory of exactly the size asked for, so that a sanitizer sees one byte too many.
struct Bytes {
    explicit Bytes(std::size_t count)
        : size(count), data(static_cast<std::byte*>(::operator new(count, std::align_val_t(64)))) {}
    Bytes(const Bytes& other) : Bytes(other.size) { std::memcpy(data, other.data, size); }
    ~Bytes() { ::operator delete(data, std::align_val_t(64)); }
    Bytes& operator=(const Bytes&) = delete;
    std::span<const std::byte> span() const { return {data, size}; }
    template <class T>
    void put(std::size_t at, T value) {
        test::put(std::span(data, size), at, value);
    }
    template <class T>
    T get(std::size_t at) const {
        return test::get<T>(span(), at);
    }
    std::size_t size;
    std::byte* data;
};

class Bundle : public ::testing::Test {
  protected:
    void SetUp() override {
        folder_ = fs::temp_directory_path() /
                  ("envbake_bundle_test_" + std::to_string(::getpid()) + "_" +
                   ::testing::UnitTest::GetInstance()->current_test_info()->name());
        fs::create_directories(folder_);
        path_ = (folder_ / "x.envb").string();
    }
    void TearDown() override { fs::remove_all(folder_); }

    void write_sample(Codec codec = Codec::None) {
        auto writer = Writer::create(path_);
        ASSERT_TRUE(writer) << to_string(writer.error());
        const std::vector<float> sh{1, 2, 3, 4, 5, 6};
        const std::vector<std::uint16_t> rows(300, 7);
        const std::string metadata = R"({"hello":"world"})";
        ASSERT_TRUE(writer->add<float>("environment/sh", {2, 3}, sh, codec));
        ASSERT_TRUE(writer->add<std::uint16_t>("mesh/0/diffuse", {100, 3}, rows, codec));
        ASSERT_TRUE(writer->add<std::uint32_t>("empty", {0, 4}, {}));
        ASSERT_TRUE(writer->add<std::uint8_t>(
            "metadata", {metadata.size()},
            {reinterpret_cast<const std::uint8_t*>(metadata.data()), metadata.size()}));
        ASSERT_TRUE(writer->finish());
    }

    Bytes load() const {
        std::ifstream in(path_, std::ios::binary);
        Bytes bytes(fs::file_size(path_));
        in.read(reinterpret_cast<char*>(bytes.data), static_cast<std::streamsize>(bytes.size));
        return bytes;
    }

    /// A bundle whose table was edited, with both checksums made right again: what only the rules
    /// behind the checksums can refuse.
    static void reseal(Bytes& bytes) {
        const auto table_offset = bytes.get<std::uint64_t>(24);
        if (table_offset <= bytes.size)
            test::seal({bytes.data, bytes.size}, table_offset);
        else
            test::seal_header({bytes.data, bytes.size});
    }

    fs::path folder_;
    std::string path_;
};

TEST_F(Bundle, RoundTripsThroughTheFile) {
    write_sample();
    const auto reader = Reader::open(path_.c_str());
    ASSERT_TRUE(reader) << to_string(reader.error());
    EXPECT_EQ(reader->major(), 1);
    EXPECT_EQ(reader->minor(), 0);
    ASSERT_EQ(reader->array_count(), 4u);
    EXPECT_EQ(reader->array(0).name, "empty");
    EXPECT_EQ(reader->array(3).name, "metadata");
    const auto sh = reader->view<float>("environment/sh");
    ASSERT_TRUE(sh);
    EXPECT_EQ(std::vector<float>(sh->begin(), sh->end()), (std::vector<float>{1, 2, 3, 4, 5, 6}));
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(sh->data()) % kAlignment, 0u);
    const auto info = reader->find("mesh/0/diffuse");
    ASSERT_TRUE(info);
    EXPECT_EQ(info->rank, 2);
    EXPECT_EQ(info->shape[0], 100u);
    EXPECT_EQ(info->shape[1], 3u);
    EXPECT_EQ(info->shape[2], 0u);
    EXPECT_EQ(reader->metadata(), R"({"hello":"world"})");
    for (std::size_t i = 0; i < reader->array_count(); ++i)
        EXPECT_TRUE(reader->verify(reader->array(i)));
}

TEST_F(Bundle, CompressedArraysDecodeToTheSameBytesAndAreNoViews) {
    write_sample(Codec::Zstd);
    const auto reader = Reader::open(path_.c_str());
    ASSERT_TRUE(reader);
    EXPECT_EQ(reader->view<std::uint16_t>("mesh/0/diffuse").error().code, Errc::ArrayCodec);
    const auto info = reader->find("mesh/0/diffuse");
    ASSERT_TRUE(info);
    EXPECT_LT(info->stored_size, info->size);
    std::vector<std::uint16_t> rows(300);
    ASSERT_TRUE(reader->read(*info, std::as_writable_bytes(std::span(rows))));
    EXPECT_EQ(rows, std::vector<std::uint16_t>(300, 7));
    rows.resize(299);
    EXPECT_EQ(reader->read(*info, std::as_writable_bytes(std::span(rows))).error().code,
              Errc::BufferSize);
}

// What compresses a thousand times makes the file as long as it must be to ask for it back.
TEST_F(Bundle, ASmallFileAsksForLittleMemory) {
    const std::vector<float> zeros(10u << 20, 0.0f);
    {
        auto writer = Writer::create(path_);
        ASSERT_TRUE(writer);
        ASSERT_TRUE(writer->add<float>("a", {zeros.size()}, zeros, Codec::Zstd));
        ASSERT_TRUE(writer->add<float>("b", {zeros.size()}, zeros, Codec::Zstd));
        ASSERT_TRUE(writer->finish());
    }
    const auto reader = Reader::open(path_.c_str());
    ASSERT_TRUE(reader);
    EXPECT_LT(reader->find("a")->stored_size + reader->find("b")->stored_size, 100'000u);
    EXPECT_GE(reader->file().size() * 16, zeros.size() * 8);
    EXPECT_LT(reader->file().size() * 16, zeros.size() * 8 + 4096);
    std::vector<float> back(zeros.size(), 1.0f);
    ASSERT_TRUE(reader->read(*reader->find("b"), std::as_writable_bytes(std::span(back))));
    EXPECT_EQ(back, zeros);
}

TEST_F(Bundle, StreamedAndWholeArraysGiveTheSameBytes) {
    std::vector<float> values(5000);
    std::iota(values.begin(), values.end(), 0.0f);
    const auto bytes = std::as_bytes(std::span(values));
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        auto whole = Writer::create(path_);
        ASSERT_TRUE(whole->add<float>("a", {5000}, values, codec));
        ASSERT_TRUE(whole->finish());
        const Bytes expected = load();
        auto streamed = Writer::create(path_);
        ASSERT_TRUE(streamed->begin({"a", ElementType::F32, {5000}, codec}));
        for (std::size_t at = 0; at < bytes.size(); at += 777)
            ASSERT_TRUE(
                streamed->append(bytes.subspan(at, std::min<std::size_t>(777, bytes.size() - at))));
        ASSERT_TRUE(streamed->end());
        ASSERT_TRUE(streamed->finish());
        const auto reader = Reader::open(path_.c_str());
        ASSERT_TRUE(reader);
        std::vector<float> decoded(5000);
        ASSERT_TRUE(reader->read(*reader->find("a"), std::as_writable_bytes(std::span(decoded))));
        EXPECT_EQ(decoded, values);
        if (codec == Codec::None) {
            const Bytes actual = load();
            ASSERT_EQ(actual.size, expected.size);
            EXPECT_EQ(std::memcmp(actual.data, expected.data, actual.size), 0);
        }
    }
}

TEST_F(Bundle, CopiedArraysGiveTheSameFile) {
    for (const Codec codec : {Codec::None, Codec::Zstd}) {
        write_sample(codec);
        const Bytes original = load();
        const auto older = Reader::open(path_.c_str());
        ASSERT_TRUE(older);
        auto writer = Writer::create(path_);
        ASSERT_TRUE(writer);
        for (const char* name : {"environment/sh", "mesh/0/diffuse", "empty", "metadata"})
            ASSERT_TRUE(writer->copy(*older, *older->find(name))) << name;
        ASSERT_TRUE(writer->finish());
        const Bytes copy = load();
        ASSERT_EQ(copy.size, original.size);
        EXPECT_EQ(std::memcmp(copy.data, original.data, copy.size), 0);
    }
}

TEST_F(Bundle, ADamagedArrayIsNotCopied) {
    write_sample();
    Bytes bytes = load();
    bytes.data[kHeaderSize] ^= std::byte{1};
    const auto damaged = Reader::open(bytes.span());
    ASSERT_TRUE(damaged);
    auto writer = Writer::create(path_);
    const auto copied = writer->copy(*damaged, *damaged->find("environment/sh"));
    ASSERT_FALSE(copied);
    EXPECT_EQ(copied.error().code, Errc::ArrayChecksum);
}

TEST_F(Bundle, AnOpenEndedArrayIsAsLongAsWhatWasAppended) {
    auto writer = Writer::create(path_);
    ASSERT_TRUE(writer);
    const std::vector<std::uint16_t> values{1, 2, 3, 4, 5, 6};
    const auto bytes = std::as_bytes(std::span(values));
    ASSERT_TRUE(writer->begin({"rows", ElementType::U16, {kOpenEnded, 2}, Codec::None}));
    ASSERT_TRUE(writer->append(bytes.first(5)));
    ASSERT_TRUE(writer->append(bytes.subspan(5)));
    ASSERT_TRUE(writer->end());
    ASSERT_TRUE(writer->begin({"none", ElementType::F32, {kOpenEnded}, Codec::None}));
    ASSERT_TRUE(writer->end());
    EXPECT_EQ(writer->begin({"zstd", ElementType::F32, {kOpenEnded}, Codec::Zstd}).error().code,
              Errc::ArrayCodec);
    ASSERT_TRUE(writer->begin({"half", ElementType::U16, {kOpenEnded, 2}, Codec::None}));
    ASSERT_TRUE(writer->append(bytes.first(6)));
    EXPECT_EQ(writer->end().error().code, Errc::WrongByteCount);

    auto whole = Writer::create(path_);
    ASSERT_TRUE(whole);
    ASSERT_TRUE(whole->begin({"rows", ElementType::U16, {kOpenEnded, 2}, Codec::None}));
    ASSERT_TRUE(whole->append(bytes));
    ASSERT_TRUE(whole->end());
    ASSERT_TRUE(whole->finish());
    const auto reader = Reader::open(path_.c_str());
    ASSERT_TRUE(reader);
    const auto info = reader->find("rows");
    ASSERT_TRUE(info);
    EXPECT_EQ(info->shape[0], 3u);
    EXPECT_EQ(info->shape[1], 2u);
    EXPECT_TRUE(reader->verify(*info));
    const auto read = reader->view<std::uint16_t>("rows");
    ASSERT_TRUE(read);
    EXPECT_TRUE(std::equal(read->begin(), read->end(), values.begin(), values.end()));
}

TEST_F(Bundle, WriterRefusesWhatNoReaderWouldAccept) {
    auto writer = Writer::create(path_);
    ASSERT_TRUE(writer);
    const std::vector<float> two{1, 2};
    for (const char* name : {"", "/a", "a/", "a//b", "A", "a b", "\xc3\xa9"})
        EXPECT_EQ(writer->add<float>(name, {2}, two).error().code, Errc::BadName) << name;
    EXPECT_EQ(writer->add<float>("a", {}, two).error().code, Errc::EntryRank);
    EXPECT_EQ(writer->add<float>("a", {1, 1, 1, 1, 1, 1, 2}, two).error().code, Errc::EntryRank);
    EXPECT_EQ(writer->add<float>("a", {1ull << 40, 1ull << 40}, two).error().code,
              Errc::EntryShape);
    ASSERT_TRUE(writer->add<float>("a", {2}, two));
    EXPECT_EQ(writer->add<float>("a", {2}, two).error().code, Errc::DuplicateName);
    EXPECT_EQ(writer->add<float>("b", {3}, two).error().code, Errc::WrongByteCount);
    EXPECT_EQ(writer->add<float>("c", {1}, two).error().code, Errc::WrongByteCount);
}

TEST_F(Bundle, AnOlderFileStaysWholeUntilTheNewOneIsComplete) {
    write_sample();
    const Bytes before = load();
    {
        auto writer = Writer::create(path_);
        ASSERT_TRUE(writer);
        ASSERT_TRUE(writer->add<float>("a", {1}, std::vector<float>{1}));
        const Bytes during = load();
        ASSERT_EQ(during.size, before.size);
        EXPECT_EQ(std::memcmp(during.data, before.data, before.size), 0);
    }  // given up
    const Bytes after = load();
    ASSERT_EQ(after.size, before.size);
    EXPECT_EQ(std::memcmp(after.data, before.data, before.size), 0);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1)
        << "a temporary file was left behind";
}

TEST_F(Bundle, AFolderThatIsNotThereIsAnError) {
    const auto writer = Writer::create((folder_ / "nowhere" / "x.envb").string());
    ASSERT_FALSE(writer);
    EXPECT_EQ(writer.error().code, Errc::CannotOpen);
    EXPECT_EQ(writer.error().system_error, ENOENT);
    EXPECT_EQ(Reader::open((folder_ / "absent.envb").c_str()).error().code, Errc::CannotOpen);
    EXPECT_EQ(Reader::open(folder_.c_str()).error().code, Errc::CannotRead);
}

TEST_F(Bundle, EveryTruncationIsRefused) {
    write_sample();
    const Bytes whole = load();
    for (std::size_t size = 0; size < whole.size; ++size) {
        Bytes cut(size);
        std::memcpy(cut.data, whole.data, size);
        EXPECT_FALSE(Reader::open(cut.span())) << "cut to " << size << " bytes";
    }
}

TEST_F(Bundle, EveryFlippedBitOfHeaderAndTableIsRefusedAndOfAnArrayIsFound) {
    write_sample();
    Bytes bytes = load();
    const auto table_offset = bytes.get<std::uint64_t>(24);
    for (std::size_t at = 0; at < bytes.size; ++at) {
        for (const unsigned mask : {0x01u, 0x80u, 0xffu}) {
            bytes.data[at] ^= static_cast<std::byte>(mask);
            const auto reader = Reader::open(bytes.span());
            if (at < kHeaderSize || at >= table_offset) {
                EXPECT_FALSE(reader) << "byte " << at;
            } else {
                ASSERT_TRUE(reader);
                bool inside = false, found = false;
                for (std::size_t i = 0; i < reader->array_count(); ++i) {
                    const ArrayInfo info = reader->array(i);
                    inside |= at >= info.offset && at < info.offset + info.stored_size;
                    found |= !reader->verify(info);
                }
                EXPECT_EQ(inside, found) << "byte " << at;
            }
            bytes.data[at] ^= static_cast<std::byte>(mask);
        }
    }
}

TEST_F(Bundle, EveryFieldHasItsOwnRefusal) {
    write_sample();
    const Bytes good = load();
    const auto table = good.get<std::uint64_t>(24);
    ASSERT_TRUE(Reader::open(good.span()));
    struct Fault {
        Errc expected;
        std::function<void(Bytes&)> apply;
    };
    const std::uint64_t huge = ~0ull;
    const std::vector<Fault> faults{
        {Errc::BadMagic, [](Bytes& b) { b.put<std::uint8_t>(0, 0); }},
        {Errc::BadMagic, [](Bytes& b) { b.put<std::uint8_t>(5, '\n'); }},
        {Errc::NewerMajor, [](Bytes& b) { b.put<std::uint16_t>(8, 2); }},
        {Errc::HeaderReserved, [](Bytes& b) { b.put<std::uint64_t>(48, 1); }},
        {Errc::FileSize, [&](Bytes& b) { b.put(16, b.size + 1); }},
        {Errc::TableBounds, [&](Bytes& b) { b.put(24, huge - 63); }},
        {Errc::TableBounds, [&](Bytes& b) { b.put(24, table + 64); }},
        {Errc::TableBounds, [&](Bytes& b) { b.put<std::uint64_t>(24, 0); }},
        {Errc::TableBounds, [&](Bytes& b) { b.put(32, huge); }},
        {Errc::TableBounds, [&](Bytes& b) { b.put<std::uint32_t>(12, 0xffffffff); }},
        {Errc::EntryName, [&](Bytes& b) { b.put<std::uint32_t>(table + 0, 0xffffffff); }},
        {Errc::EntryName, [&](Bytes& b) { b.put<std::uint16_t>(table + 4, 0xffff); }},
        {Errc::EntryName, [&](Bytes& b) { b.put<std::uint16_t>(table + 4, 0); }},
        {Errc::EntryType, [&](Bytes& b) { b.put<std::uint8_t>(table + 6, 7); }},
        {Errc::EntryCodec, [&](Bytes& b) { b.put<std::uint8_t>(table + 7, 2); }},
        {Errc::EntryRank, [&](Bytes& b) { b.put<std::uint8_t>(table + 8, 0); }},
        {Errc::EntryRank, [&](Bytes& b) { b.put<std::uint8_t>(table + 8, 7); }},
        {Errc::EntryReserved, [&](Bytes& b) { b.put<std::uint8_t>(table + 15, 1); }},
        {Errc::EntryShape, [&](Bytes& b) { b.put<std::uint64_t>(table + 96 + 16 + 16, 1); }},
        {Errc::EntryShape, [&](Bytes& b) { b.put(table + 96 + 16, huge); }},
        {Errc::EntrySize, [&](Bytes& b) { b.put<std::uint64_t>(table + 96 + 16, 3); }},
        {Errc::EntrySize, [&](Bytes& b) { b.put<std::uint64_t>(table + 96 + 72, 8); }},
        {Errc::EntrySize, [&](Bytes& b) { b.put<std::uint64_t>(table + 96 + 80, 8); }},
        {Errc::EntryBounds, [&](Bytes& b) { b.put<std::uint64_t>(table + 96 + 64, 65); }},
        {Errc::EntryBounds, [&](Bytes& b) { b.put<std::uint64_t>(table + 96 + 64, 0); }},
        {Errc::EntryBounds, [&](Bytes& b) { b.put<std::uint64_t>(table + 96 + 64, table); }},
        {Errc::EntryBounds, [&](Bytes& b) { b.put(table + 96 + 64, huge - 63); }},
        {Errc::DecodedSize,
         [&](Bytes& b) {
             const std::uint64_t too_much = (8u << 20) + 1;
             b.put<std::uint8_t>(table + 96 + 6, 2);
             b.put<std::uint8_t>(table + 96 + 7, 1);
             b.put<std::uint8_t>(table + 96 + 8, 1);
             b.put(table + 96 + 16, too_much);
             for (std::size_t axis = 1; axis < 6; ++axis) b.put(table + 96 + 16 + 8 * axis, 0ull);
             b.put(table + 96 + 80, too_much);
         }},
        {Errc::NameOrder,
         [&](Bytes& b) {
             b.put<std::uint32_t>(table + 96, b.get<std::uint32_t>(table));
             b.put<std::uint16_t>(table + 100, b.get<std::uint16_t>(table + 4));
         }},
    };
    for (std::size_t i = 0; i < faults.size(); ++i) {
        Bytes bytes(good);
        faults[i].apply(bytes);
        reseal(bytes);
        const auto reader = Reader::open(bytes.span());
        ASSERT_FALSE(reader) << "fault " << i;
        EXPECT_EQ(reader.error().code, faults[i].expected)
            << "fault " << i << ": " << to_string(reader.error());
    }
    Bytes unsealed(good);
    unsealed.put<std::uint64_t>(48, 1);
    EXPECT_EQ(Reader::open(unsealed.span()).error().code, Errc::HeaderChecksum);
    Bytes table_unsealed(good);
    table_unsealed.put<std::uint8_t>(table + 6, 1);
    EXPECT_EQ(Reader::open(table_unsealed.span()).error().code, Errc::TableChecksum);
}

TEST_F(Bundle, MisalignedMemoryIsRefused) {
    write_sample();
    const Bytes good = load();
    Bytes shifted(good.size + 1);
    std::memcpy(shifted.data + 1, good.data, good.size);
    EXPECT_EQ(Reader::open({shifted.data + 1, good.size}).error().code, Errc::Misaligned);
}

TEST(FormatError, NamesArrayPlaceAndCode) {
    EXPECT_EQ(to_string(Error::at(Errc::ArrayChecksum, 4096, "mesh/0/diffuse")),
              "array mesh/0/diffuse: byte 4096: the stored bytes do not match their checksum "
              "(ArrayChecksum)");
}

}  // namespace
}  // namespace envbake::format
