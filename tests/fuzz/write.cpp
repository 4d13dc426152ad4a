// SPDX-License-Identifier: Apache-2.0
// Any arrays, written, read, and written again: what the writer takes comes back, and gives the
// same bytes twice, by its elements and by its stored bytes.
#include "tests/fuzz/require.h"

#include "envbake/format/reader.h"
#include "envbake/format/writer.h"

#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace {

namespace format = envbake::format;
using envbake::fuzz::require;

/// The input, byte after byte; zeros at its end.
class Bytes {
  public:
    Bytes(const std::uint8_t* data, std::size_t size) : next_(data), end_(data + size) {}
    bool left() const { return next_ != end_; }
    std::uint8_t take() { return left() ? *next_++ : std::uint8_t{0}; }

  private:
    const std::uint8_t* next_;
    const std::uint8_t* end_;
};

struct Array {
    format::ArraySpec spec;
    std::vector<std::byte> bytes;
};

Array take_array(Bytes& input) {
    Array array;
    const std::uint8_t how = input.take();
    array.spec.type = static_cast<format::ElementType>(how % format::kElementTypeCount);
    array.spec.codec = how < 128 ? format::Codec::None : format::Codec::Zstd;
    for (int left = input.take(); left > 0 && input.left(); --left)
        array.spec.name += static_cast<char>(input.take());
    // A few more axes than there may be, and lengths whose product leaves 64 bits.
    std::uint64_t count = 1;
    for (int rank = input.take() % (format::kMaxRank + 2); rank > 0; --rank) {
        const std::uint8_t length = input.take();
        array.spec.shape.push_back(length < 250 ? length : std::uint64_t{1} << (length - 192));
        count = std::min(count, std::uint64_t{1} << 20) * std::min<std::uint64_t>(length, 256);
    }
    const int spoiled = input.take();  // how many bytes too many, now and then
    const std::uint8_t first = input.take(), step = input.take();
    array.bytes.resize(std::min<std::uint64_t>(count, 1 << 14) *
                           format::element_size(array.spec.type) +
                       static_cast<std::size_t>(std::max(0, spoiled - 240)));
    std::uint8_t value = first;
    for (std::byte& byte : array.bytes) {
        byte = std::byte{value};
        value = static_cast<std::uint8_t>(value + step);
    }
    return array;
}

/// The arrays that the writer takes.
std::vector<Array> write(const std::string& path, const std::vector<Array>& arrays) {
    auto writer = format::Writer::create(path);
    require(static_cast<bool>(writer), "a writer");
    std::vector<Array> taken;
    for (const Array& array : arrays) {
        // Begun and left off is not a bundle: what begin() takes, it must get.
        if (writer->add(array.spec, array.bytes)) {
            taken.push_back(array);
        } else {
            return {};
        }
    }
    require(static_cast<bool>(writer->finish()), "a bundle");
    return taken;
}

std::string content(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string path = "/dev/shm/envbake_fuzz_" + std::to_string(::getpid()) + ".envb";
    Bytes input(data, size);
    std::vector<Array> arrays;
    while (input.left()) {
        Array array = take_array(input);
        // One that is refused alone is refused among others.
        const bool taken = !write(path, {array}).empty();
        if (taken) arrays.push_back(std::move(array));
    }
    const std::vector<Array> written = write(path, arrays);
    if (written.empty()) {  // two of a name
        ::unlink(path.c_str());
        return 0;
    }
    const std::string first = content(path);
    {
        const auto reader = format::Reader::open(path.c_str());
        require(static_cast<bool>(reader), "the reader takes what was written");
        require(reader->array_count() == arrays.size(), "as many arrays");
        std::vector<Array> read;
        for (std::size_t i = 0; i < arrays.size(); ++i) {
            const format::ArraySpec& spec = arrays[i].spec;
            const auto found = reader->find(spec.name);
            require(found.has_value(), "an array of the same name");
            const format::ArrayInfo& info = *found;
            require(info.type == spec.type &&
                        std::equal(info.shape.begin(), info.shape.begin() + info.rank,
                                   spec.shape.begin(), spec.shape.end()),
                    "the same type and shape");
            std::vector<std::byte> bytes(info.size);
            require(static_cast<bool>(reader->verify(info)) &&
                        static_cast<bool>(reader->read(info, bytes)),
                    "an array that can be read");
            require(bytes == arrays[i].bytes, "the same elements");
            read.push_back({spec, std::move(bytes)});
        }
        const std::string again = path + ".again";
        write(again, read);
        require(content(again) == first, "the same bytes, of its elements");
        auto writer = format::Writer::create(again);
        require(static_cast<bool>(writer), "a writer");
        for (std::size_t i = 0; i < arrays.size(); ++i)
            require(static_cast<bool>(writer->copy(*reader, *reader->find(arrays[i].spec.name))),
                    "a copy");
        require(static_cast<bool>(writer->finish()), "a bundle of copies");
        require(content(again) == first, "the same bytes, of its stored bytes");
        ::unlink(again.c_str());
    }
    ::unlink(path.c_str());
    return 0;
}
