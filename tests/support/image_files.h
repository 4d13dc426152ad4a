// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <ios>
#include <iterator>
#include <span>
#include <string>
#include <vector>

/// Image files made byte by byte, so that tests do not read what the same library has written.
namespace envbake::test {

/// A folder that is gone after the test.
class TemporaryFolder {
  public:
    TemporaryFolder() {
        static int count = 0;
        path_ = std::filesystem::temp_directory_path() /
                ("envbake-test-" + std::to_string(getpid()) + "-" + std::to_string(count++));
        std::filesystem::create_directories(path_);
    }
    ~TemporaryFolder() { std::filesystem::remove_all(path_); }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
    const std::filesystem::path& path() const { return path_; }

  private:
    std::filesystem::path path_;
};

inline void write_file(const std::filesystem::path& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

inline std::string read_file(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// A Radiance picture with flat scanlines. `rgb` holds whole numbers 0 .. 255, or 256 times those,
/// which the format holds exactly.
inline std::string radiance_bytes(int width, int height, std::span<const float> rgb) {
    std::string bytes = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " + std::to_string(height) +
                        " +X " + std::to_string(width) + "\n";
    for (std::size_t i = 0; i + 2 < rgb.size(); i += 3) {
        const bool bright = rgb[i] > 255 || rgb[i + 1] > 255 || rgb[i + 2] > 255;
        for (std::size_t k = 0; k < 3; ++k)
            bytes += static_cast<char>(static_cast<int>(bright ? rgb[i + k] / 256 : rgb[i + k]));
        bytes += static_cast<char>(bright ? 144 : 136);  // mantissa * 2^(e - 136)
    }
    return bytes;
}

namespace detail {

inline void put_big_endian(std::string& to, std::uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) to += static_cast<char>(value >> shift & 255);
}

inline std::uint32_t crc32(const std::string& bytes) {
    std::uint32_t crc = ~0u;
    for (const char c : bytes) {
        crc ^= static_cast<unsigned char>(c);
        for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0xedb88320u : 0u);
    }
    return ~crc;
}

inline void put_chunk(std::string& to, const std::string& type, const std::string& data) {
    put_big_endian(to, static_cast<std::uint32_t>(data.size()));
    to += type + data;
    put_big_endian(to, crc32(type + data));
}

}  // namespace detail

/// What a PNG header says of its pixels. Source: W3C PNG specification, section 11.2.2.
struct PngHeader {
    std::uint32_t width = 1;
    std::uint32_t height = 1;
    int bit_depth = 8;
    int color_type = 6;  ///< 0 grey, 2 RGB, 4 grey and alpha, 6 RGBA
};

/// A PNG of stored (uncompressed) deflate blocks. `rows` has the rows as they are, unfiltered,
/// without the filter bytes; whether they fit the header is up to the test.
inline std::string png_bytes(const PngHeader& header, const std::vector<std::string>& rows) {
    std::string raw;
    for (const std::string& row : rows) raw += '\0' + row;
    std::uint32_t a = 1, b = 0;
    for (const char c : raw) {
        a = (a + static_cast<unsigned char>(c)) % 65521;
        b = (b + a) % 65521;
    }
    std::string zlib = "\x78\x01";
    zlib += '\1';  // one final stored block: raw.size() < 65536
    const auto size = static_cast<std::uint32_t>(raw.size());
    for (const std::uint32_t v : {size, size >> 8, ~size, ~size >> 8}) zlib += static_cast<char>(v);
    zlib += raw;
    detail::put_big_endian(zlib, b << 16 | a);

    std::string ihdr;
    detail::put_big_endian(ihdr, header.width);
    detail::put_big_endian(ihdr, header.height);
    ihdr += static_cast<char>(header.bit_depth);
    ihdr += static_cast<char>(header.color_type);
    ihdr += std::string(3, '\0');
    std::string png = "\x89PNG\r\n\x1a\n";
    detail::put_chunk(png, "IHDR", ihdr);
    detail::put_chunk(png, "IDAT", zlib);
    detail::put_chunk(png, "IEND", "");
    return png;
}

}  // namespace envbake::test
