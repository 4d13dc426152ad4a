// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_environment.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"
#include "baker/input/image_worker.h"
#include "tests/support/image_files.h"
#include "tests/support/test_data.h"

#include <ImfChannelList.h>
#include <ImfChromaticities.h>
#include <ImfDeepFrameBuffer.h>
#include <ImfDeepScanLineOutputFile.h>
#include <ImfEnvmap.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfTiledOutputFile.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

namespace envbake {
namespace {

namespace fs = std::filesystem;
constexpr double kPi = std::numbers::pi;

/// A test image: three floats a texel, rows from the top.
struct Picture {
    int width = 0;
    int height = 0;
    std::vector<float> rgb;

    Picture(int w, int h, float value = 0)
        : width(w),
          height(h),
          rgb(3 * static_cast<std::size_t>(w) * static_cast<std::size_t>(h), value) {}

    float* at(int row, int column) {
        return &rgb[3 * static_cast<std::size_t>(row * width + column)];
    }
    void set(int row, int column, float value) { std::fill_n(at(row, column), 3, value); }
};

/// Texels hold 1, 2, 3, ...: 0 stays free for "nothing here".
Picture numbered(int width, int height) {
    Picture picture(width, height);
    for (int row = 0; row < height; ++row)
        for (int column = 0; column < width; ++column)
            picture.set(row, column, static_cast<float>(row * width + column + 1));
    return picture;
}

/// Writes with OpenEXR itself, under any header and channel names (empty: no such channel).
void write_with_openexr(const fs::path& file, Imf::Header header, Picture& picture,
                        std::array<const char*, 3> names = {"R", "G", "B"}) {
    Imf::FrameBuffer buffer;
    for (std::size_t i = 0; i < 3; ++i) {
        if (!*names[i]) continue;
        header.channels().insert(names[i], Imf::Channel(Imf::FLOAT));
        buffer.insert(names[i], Imf::Slice::Make(
                                    Imf::FLOAT, picture.rgb.data() + i, header.dataWindow(),
                                    3 * sizeof(float),
                                    3 * sizeof(float) * static_cast<std::size_t>(picture.width)));
    }
    Imf::OutputFile output(file.c_str(), header);
    output.setFrameBuffer(buffer);
    output.writePixels(picture.height);
}

Imf::Header header_of(const Picture& picture) {
    return Imf::Header(picture.width, picture.height);
}

Expected<Environment> read_picture(const Picture& picture, ReadEnvironmentOptions options = {}) {
    const test::TemporaryFolder folder;
    const auto written = write_exr(folder / "a.exr", picture.width, picture.height, picture.rgb);
    if (!written) return written.error();
    return read_environment(folder / "a.exr", options);
}

void expect_invalid(const Expected<Environment>& environment, const std::string& part) {
    ASSERT_FALSE(environment);
    EXPECT_EQ(environment.error().code, Errc::InvalidInput);
    const std::string& message = environment.error().message;
    EXPECT_NE(message.find(part), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
}

DVec3 to_dvec3(const Imath::V3f& v) {
    return {v.x, v.y, v.z};
}

// --- equirectangular
// ------------------------------------------------------------------------------

// u = atan2(z, x) / 2 pi + 1/2, v = acos(y) / pi: written out, sharing nothing with the reader.
TEST(ReadEnvironment, EquirectangularOfAnySize) {
    const test::TemporaryFolder folder;
    const std::pair<int, int> sizes[] = {{1, 1}, {3, 5}, {8, 4}, {9, 2}, {40, 20}, {4096, 2}};
    for (const auto& [width, height] : sizes) {
        Picture picture(width, height);
        for (int i = 0; i < width * height; ++i)
            picture.set(i / width, i % width, static_cast<float>(i % 251));
        test::write_file(folder / "a.hdr", test::radiance_bytes(width, height, picture.rgb));
        const auto environment = read_environment(folder / "a.hdr");
        ASSERT_TRUE(environment) << environment.error();
        ASSERT_TRUE(std::holds_alternative<LatLongGrid>(environment->grid));
        for (int row = 0; row < height; ++row) {
            for (int column = 0; column < width; ++column) {
                const double phi = 2 * kPi * ((column + 0.5) / width - 0.5);
                const double theta = kPi * (row + 0.5) / height;
                const DVec3 w{std::sin(theta) * std::cos(phi), std::cos(theta),
                              std::sin(theta) * std::sin(phi)};
                ASSERT_EQ(radiance_towards(*environment, w).y, picture.at(row, column)[0])
                    << width << " x " << height << ": " << row << ", " << column;
            }
        }
    }
}

TEST(ReadEnvironment, ColoursAndPeaksOfRadianceFilesAreExact) {
    const test::TemporaryFolder folder;
    Picture picture(2, 1);
    const float colours[] = {1, 2, 200, 256 * 255, 256 * 3, 0};
    std::copy(std::begin(colours), std::end(colours), picture.rgb.begin());
    test::write_file(folder / "a.hdr", test::radiance_bytes(2, 1, picture.rgb));
    const auto environment = read_environment(folder / "a.hdr");
    ASSERT_TRUE(environment) << environment.error();
    EXPECT_EQ(environment->file_name, "a.hdr");
    EXPECT_EQ(environment->radiance[0], Vec3(1, 2, 200));
    EXPECT_EQ(environment->radiance[1], Vec3(65280, 768, 0));
}

TEST(ReadEnvironment, ContentDecidesAndNotTheName) {
    const test::TemporaryFolder folder;
    Picture picture = numbered(2, 1);
    test::write_file(folder / "radiance.exr", test::radiance_bytes(2, 1, picture.rgb));
    ASSERT_TRUE(write_exr(folder / "openexr.hdr", 2, 1, picture.rgb));
    for (const char* name : {"radiance.exr", "openexr.hdr"}) {
        const auto environment = read_environment(folder / name);
        ASSERT_TRUE(environment) << environment.error();
        EXPECT_EQ(environment->radiance[1], Vec3(2));
    }
}

TEST(ReadEnvironment, RefusesWhatRadianceFilesCanSayButWeDoNotRead) {
    const test::TemporaryFolder folder;
    const std::string good = test::radiance_bytes(2, 1, numbered(2, 1).rgb);
    const auto replaced = [&](const std::string& from, const std::string& to) {
        std::string bytes = good;
        bytes.replace(bytes.find(from), from.size(), to);
        return bytes;
    };
    const std::pair<std::string, const char*> cases[] = {
        {replaced("rgbe", "xyze"), "FORMAT=32-bit_rle_xyze"},
        {replaced("-Y 1 +X 2", "+Y 1 +X 2"), "only -Y +X"},
        {replaced("-Y 1 +X 2", "+X 2 -Y 1"), "resolution line"},
        {replaced("-Y 1", "-Y 3"), "too short"},
    };
    for (const auto& [bytes, part] : cases) {
        test::write_file(folder / "a.hdr", bytes);
        expect_invalid(read_environment(folder / "a.hdr"), part);
    }
}

/// The four planes of a scanline, run-length encoded: every repetition a run, all else literals.
std::string encoded_scanline(int width, const std::string& planes) {
    std::string bytes{2, 2, static_cast<char>(width >> 8), static_cast<char>(width & 255)};
    for (std::size_t plane = 0; plane < 4; ++plane) {
        const std::string values =
            planes.substr(plane * static_cast<std::size_t>(width), static_cast<std::size_t>(width));
        for (std::size_t i = 0; i < values.size();) {
            std::size_t same = 1;
            while (i + same < values.size() && values[i + same] == values[i]) ++same;
            if (same > 1) {
                same = std::min<std::size_t>(same, 127);
                bytes += static_cast<char>(128 + same);
                bytes += values[i];
                i += same;
                continue;
            }
            std::size_t end = i + 1;
            while (end < values.size() && end - i < 128 &&
                   (end + 1 == values.size() || values[end] != values[end + 1])) {
                ++end;
            }
            bytes += static_cast<char>(end - i);
            bytes += values.substr(i, end - i);
            i = end;
        }
    }
    return bytes;
}

/// Scanlines of noise and of one value alternate, with flat ones among them: the longest literals
/// and the longest runs, and mantissas and exponents of every size.
std::string radiance_mixture(int width, int height, std::vector<float>& rgb) {
    std::string bytes = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " + std::to_string(height) +
                        " +X " + std::to_string(width) + "\n";
    RandomStream random(5, 0, 0);
    const auto texels = static_cast<std::size_t>(width);
    for (int row = 0; row < height; ++row) {
        std::string planes(4 * texels, '\0');
        for (char& byte : planes) byte = static_cast<char>(random.next_bits() >> 56);
        if (row % 2 == 1) std::fill(planes.begin(), planes.end(), static_cast<char>(130 + row));
        for (std::size_t i = 0; i < texels; ++i) {
            const auto value = [&](std::size_t plane) {
                return static_cast<unsigned char>(planes[plane * texels + i]);
            };
            for (std::size_t k = 0; k < 3; ++k)
                rgb.push_back(
                    value(3) == 0 ? 0 : std::ldexp(static_cast<float>(value(k)), value(3) - 136));
        }
        if (row % 4 < 2) {
            bytes += encoded_scanline(width, planes);
        } else {
            for (std::size_t i = 0; i < texels; ++i)
                for (std::size_t plane = 0; plane < 4; ++plane) bytes += planes[plane * texels + i];
        }
    }
    return bytes;
}

TEST(ReadEnvironment, RunLengthsOfRadianceFilesAreExact) {
    const test::TemporaryFolder folder;
    for (const auto& [width, height] : {std::pair{8, 5}, {129, 40}, {700, 70}}) {
        std::vector<float> rgb;
        test::write_file(folder / "a.hdr", radiance_mixture(width, height, rgb));
        for (const int threads : {1, 4}) {
            const ThreadLimit limit(threads);
            const auto image = decode_float_image(folder / "a.hdr");
            ASSERT_TRUE(image) << image.error();
            for (int row = 0; row < height; ++row) {
                const auto values = image->row(row);
                ASSERT_TRUE(std::equal(values.begin(), values.end(),
                                       rgb.begin() + 3 * row * std::ptrdiff_t{width}))
                    << width << " x " << height << ", row " << row << ", threads " << threads;
            }
        }
    }
}

TEST(ReadEnvironment, DamagedRunsOfRadianceFilesAreRefused) {
    const test::TemporaryFolder folder;
    constexpr int kWidth = 16;
    const std::string planes(std::size_t{4} * kWidth, '\x80');
    const std::string good = encoded_scanline(kWidth, planes);
    ASSERT_EQ(good.size(), 12u) << "four runs of 16";
    const auto changed = [&](std::size_t at, int value) {
        std::string bytes = good;
        bytes[at] = static_cast<char>(value);
        return bytes;
    };
    const std::pair<std::string, const char*> cases[] = {
        {changed(3, kWidth + 1), "another width"},
        {changed(4, 128 + kWidth + 1), "damaged runs"},  // over the end of a plane
        {changed(10, 128 + kWidth + 1), "damaged runs"},
        {changed(6, 0), "damaged runs"},
        {changed(6, 128), "damaged runs"},  // a literal that is longer than the plane
        {good.substr(0, 11), "ends early"},
        {good.substr(0, 10) + std::string("\x10\x80", 2), "ends early"},  // within a literal
    };
    const std::string header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40 +X 16\n";
    // The first row is flat: the file as a whole is then never too short to be begun with.
    std::string before(std::size_t{4} * kWidth, '\x80');
    for (int row = 1; row < 39; ++row) before += good;
    test::write_file(folder / "a.hdr", header + before + good);
    ASSERT_TRUE(read_environment(folder / "a.hdr"));
    for (const auto& [scanline, part] : cases) {
        // In the last row, which may be another thread's than the first.
        test::write_file(folder / "a.hdr", header + before + scanline);
        for (const int threads : {1, 4}) {
            const ThreadLimit limit(threads);
            const auto environment = read_environment(folder / "a.hdr");
            expect_invalid(environment, part);
        }
    }
}

// --- OpenEXR's environment maps, against OpenEXR's own functions
// ------------------------------------

TEST(ReadEnvironment, OpenExrLatLong) {
    const test::TemporaryFolder folder;
    const std::pair<int, int> sizes[] = {{8, 4}, {7, 5}, {2, 2}, {16, 1}};
    for (const auto& [width, height] : sizes) {
        Picture picture = numbered(width, height);
        // A data window that starts anywhere must not matter.
        const Imath::Box2i window({-3, 5}, {width - 4, height + 4});
        Imf::Header header(window, window);
        Imf::addEnvmap(header, Imf::ENVMAP_LATLONG);
        write_with_openexr(folder / "a.exr", header, picture);
        const auto environment = read_environment(folder / "a.exr");
        ASSERT_TRUE(environment) << environment.error();

        RandomStream random(7, static_cast<std::uint64_t>(width), 0);
        const auto jittered = [&](int i, int count) {  // inside texel i, and inside the image
            const double x = i + 0.9 * (random.next() - 0.5);
            return count == 1 ? 0 : static_cast<float>(std::clamp(x, 1e-4, count - 1 - 1e-4));
        };
        for (int i = 0; i < 4000; ++i) {
            const int row = static_cast<int>(random.next() * height);
            const int column = static_cast<int>(random.next() * width);
            const Imath::V2f at(static_cast<float>(window.min.x) + jittered(column, width),
                                static_cast<float>(window.min.y) + jittered(row, height));
            const DVec3 w = to_dvec3(Imf::LatLongMap::direction(window, at));
            ASSERT_EQ(radiance_towards(*environment, glm::normalize(w)).x,
                      picture.at(row, column)[0])
                << width << " x " << height << ": " << row << ", " << column;
        }
    }
}

TEST(ReadEnvironment, OpenExrCube) {
    const test::TemporaryFolder folder;
    for (const int size : {1, 2, 5}) {
        Picture picture = numbered(size, 6 * size);
        Imf::Header header = header_of(picture);
        Imf::addEnvmap(header, Imf::ENVMAP_CUBE);
        write_with_openexr(folder / "a.exr", header, picture);
        const auto environment = read_environment(folder / "a.exr");
        ASSERT_TRUE(environment) << environment.error();
        ASSERT_TRUE(std::holds_alternative<CubeGrid>(environment->grid));

        RandomStream random(8, static_cast<std::uint64_t>(size), 0);
        const auto jittered = [&](int i) {
            const double x = i + 0.9 * (random.next() - 0.5);
            return size == 1 ? 0 : static_cast<float>(std::clamp(x, 1e-3, size - 1 - 1e-3));
        };
        for (int i = 0; i < 4000; ++i) {
            const auto face = static_cast<Imf::CubeMapFace>(static_cast<int>(6 * random.next()));
            const Imath::V2f in_face(jittered(static_cast<int>(random.next() * size)),
                                     jittered(static_cast<int>(random.next() * size)));
            const Imath::V2f at = Imf::CubeMap::pixelPosition(face, header.dataWindow(), in_face);
            const int row = static_cast<int>(std::lround(at.y));
            const int column = static_cast<int>(std::lround(at.x));
            const DVec3 w = to_dvec3(Imf::CubeMap::direction(face, header.dataWindow(), in_face));
            ASSERT_EQ(radiance_towards(*environment, glm::normalize(w)).x,
                      picture.at(row, column)[0])
                << "size " << size << ", face " << face << ": " << row << ", " << column;
        }
    }
}

TEST(ReadEnvironment, OpenExrCubeMustBeSixFacesHigh) {
    const test::TemporaryFolder folder;
    Picture picture = numbered(4, 20);
    Imf::Header header = header_of(picture);
    Imf::addEnvmap(header, Imf::ENVMAP_CUBE);
    write_with_openexr(folder / "a.exr", header, picture);
    expect_invalid(read_environment(folder / "a.exr"), "4 x 20");
}

// --- strips and crosses
// ---------------------------------------------------------------------------

/// A face as it lies in an image: where it looks, and where its columns and rows go.
struct Tile {
    int row, column;  ///< in faces
    DVec3 axis, right, down;
};

// Axes from the table of OpenGL 4.6, section 8.13; the last tile of the vertical cross is turned.
const DVec3 X{1, 0, 0}, Y{0, 1, 0}, Z{0, 0, 1};
const std::vector<Tile> kHorizontalStrip{{0, 0, X, -Z, -Y}, {0, 1, -X, Z, -Y}, {0, 2, Y, X, Z},
                                         {0, 3, -Y, X, -Z}, {0, 4, Z, X, -Y},  {0, 5, -Z, -X, -Y}};
const std::vector<Tile> kVerticalStrip{{0, 0, X, -Z, -Y}, {1, 0, -X, Z, -Y}, {2, 0, Y, X, Z},
                                       {3, 0, -Y, X, -Z}, {4, 0, Z, X, -Y},  {5, 0, -Z, -X, -Y}};
const std::vector<Tile> kHorizontalCross{{0, 1, Y, X, Z},   {1, 0, -X, Z, -Y},  {1, 1, Z, X, -Y},
                                         {1, 2, X, -Z, -Y}, {1, 3, -Z, -X, -Y}, {2, 1, -Y, X, -Z}};
const std::vector<Tile> kVerticalCross{{0, 1, Y, X, Z},   {1, 0, -X, Z, -Y}, {1, 1, Z, X, -Y},
                                       {1, 2, X, -Z, -Y}, {2, 1, -Y, X, -Z}, {3, 1, -Z, X, Y}};

void expect_tiles(const std::vector<Tile>& tiles, int faces_across, int faces_down) {
    for (const int size : {1, 3}) {
        Picture picture(faces_across * size, faces_down * size);
        const auto each_texel = [&](const auto& body) {
            for (const Tile& tile : tiles)
                for (int r = 0; r < size; ++r)
                    for (int c = 0; c < size; ++c)
                        body(tile, r, c, tile.row * size + r, tile.column * size + c);
        };
        float next = 1;
        each_texel(
            [&](const Tile&, int, int, int row, int column) { picture.set(row, column, next++); });
        const auto environment = read_picture(picture);
        ASSERT_TRUE(environment) << environment.error();
        ASSERT_TRUE(std::holds_alternative<CubeGrid>(environment->grid));
        each_texel([&](const Tile& tile, int r, int c, int row, int column) {
            const double u = (2 * c + 1.0) / size - 1, v = (2 * r + 1.0) / size - 1;
            const DVec3 w = glm::normalize(tile.axis + u * tile.right + v * tile.down);
            EXPECT_EQ(radiance_towards(*environment, w).x, picture.at(row, column)[0])
                << "size " << size << ": " << row << ", " << column;
        });
    }
}

TEST(ReadEnvironment, HorizontalStrip) {
    expect_tiles(kHorizontalStrip, 6, 1);
}
TEST(ReadEnvironment, VerticalStrip) {
    expect_tiles(kVerticalStrip, 1, 6);
}
TEST(ReadEnvironment, HorizontalCross) {
    expect_tiles(kHorizontalCross, 4, 3);
}
TEST(ReadEnvironment, VerticalCross) {
    expect_tiles(kVerticalCross, 3, 4);
}

// What makes the layouts of the crosses right: tiles that touch in the image touch on the cube.
TEST(ReadEnvironment, NeighboursInACrossAreNeighboursOnTheCube) {
    for (const auto& tiles : {kHorizontalCross, kVerticalCross}) {
        int seams = 0;
        for (const Tile& a : tiles) {
            for (const Tile& b : tiles) {
                const bool beside = a.row == b.row && a.column + 1 == b.column;
                const bool below = a.column == b.column && a.row + 1 == b.row;
                if (!beside && !below) continue;
                ++seams;
                for (const double t : {-0.5, 0.7}) {
                    const DVec3 on_a =
                        beside ? a.axis + a.right + t * a.down : a.axis + t * a.right + a.down;
                    const DVec3 on_b =
                        beside ? b.axis - b.right + t * b.down : b.axis + t * b.right - b.down;
                    EXPECT_EQ(on_a, on_b);
                }
            }
        }
        EXPECT_EQ(seams, 5);
    }
}

TEST(ReadEnvironment, FourToThreeWithoutEmptyCellsIsEquirectangular) {
    for (const auto& [width, height] : {std::pair{4, 3}, {3, 4}, {8, 6}}) {
        Picture cross(width, height);
        EXPECT_TRUE(std::holds_alternative<CubeGrid>(read_picture(cross)->grid));
        cross.set(height - 1, width - 1, 1e-30f);  // an unused cell of either cross
        EXPECT_TRUE(std::holds_alternative<LatLongGrid>(read_picture(cross)->grid));
    }
}

// --- what an OpenEXR file may hold
// ------------------------------------------------------------------

TEST(ReadEnvironment, ChannelsOfOpenExr) {
    const test::TemporaryFolder folder;
    Picture picture(2, 1);
    for (std::size_t i = 0; i < 6; ++i) picture.rgb[i] = static_cast<float>(i + 1);
    const auto read = [&](std::array<const char*, 3> names) {
        write_with_openexr(folder / "a.exr", header_of(picture), picture, names);
        return read_environment(folder / "a.exr");
    };
    EXPECT_EQ(read({"R", "G", "B"})->radiance[1], Vec3(4, 5, 6));
    EXPECT_EQ(read({"Y", "", "A"})->radiance[1], Vec3(4));
    EXPECT_EQ(read({"view.R", "view.G", "view.B"})->radiance[1], Vec3(4, 5, 6));
    expect_invalid(read({"Y", "RY", "BY"}), "luminance-chroma");
    expect_invalid(read({"R", "G", ""}), "no R, G, B or Y");
    expect_invalid(read({"Z", "", ""}), "no R, G, B or Y");
}

TEST(ReadEnvironment, TheFirstPartWithAPictureIsRead) {
    const test::TemporaryFolder folder;
    Picture picture = numbered(3, 2);
    {
        std::vector<Imf::Header> headers;
        for (const char* name : {"depth", "beauty"}) {
            Imf::Header header(3, 2);
            header.setName(name);
            header.setType(Imf::SCANLINEIMAGE);
            headers.push_back(header);
        }
        headers[0].channels().insert("Z", Imf::Channel(Imf::FLOAT));
        for (const char* c : {"R", "G", "B"}) {
            headers[1].channels().insert(c, Imf::Channel(Imf::HALF));
        }
        Imf::MultiPartOutputFile output((folder / "a.exr").c_str(), headers.data(), 2);
        for (int part = 0; part < 2; ++part) {
            Imf::FrameBuffer buffer;
            std::vector<Imath::half> halves;
            for (const float v : picture.rgb) halves.emplace_back(v);
            if (part == 0) {
                buffer.insert("Z", Imf::Slice::Make(Imf::FLOAT, picture.rgb.data(),
                                                    headers[0].dataWindow(), 12, 36));
            } else {
                const char* const names[] = {"R", "G", "B"};
                for (std::size_t i = 0; i < 3; ++i) {
                    buffer.insert(names[i], Imf::Slice::Make(Imf::HALF, halves.data() + i,
                                                             headers[1].dataWindow(), 6, 18));
                }
            }
            Imf::OutputPart out(output, part);
            out.setFrameBuffer(buffer);
            out.writePixels(2);
        }
    }
    const auto environment = read_environment(folder / "a.exr");
    ASSERT_TRUE(environment) << environment.error();
    ASSERT_EQ(environment->radiance.size(), 6u);
    EXPECT_EQ(environment->radiance[5], Vec3(6));
}

TEST(ReadEnvironment, OfAPyramidOnlyTheFinestLevelIsRead) {
    const test::TemporaryFolder folder;
    Picture picture = numbered(20, 10);
    {
        Imf::Header header = header_of(picture);
        header.setTileDescription(Imf::TileDescription(8, 8, Imf::MIPMAP_LEVELS));
        for (const char* c : {"R", "G", "B"}) header.channels().insert(c, Imf::Channel(Imf::FLOAT));
        Imf::TiledOutputFile output((folder / "a.exr").c_str(), header);
        for (int level = 0; level < output.numLevels(); ++level) {
            Picture flat(picture.width, picture.height, -1);
            Picture& source = level == 0 ? picture : flat;
            Imf::FrameBuffer buffer;
            const char* const names[] = {"R", "G", "B"};
            for (std::size_t i = 0; i < 3; ++i) {
                buffer.insert(names[i], Imf::Slice::Make(Imf::FLOAT, source.rgb.data() + i,
                                                         header.dataWindow(), 12, 12 * 20));
            }
            output.setFrameBuffer(buffer);
            output.writeTiles(0, output.numXTiles(level) - 1, 0, output.numYTiles(level) - 1,
                              level);
        }
    }
    const auto environment = read_environment(folder / "a.exr", {.strict = true});
    ASSERT_TRUE(environment) << environment.error();
    ASSERT_EQ(environment->radiance.size(), 200u);
    for (std::size_t i = 0; i < 200; ++i)
        EXPECT_EQ(environment->radiance[i].x, static_cast<float>(i + 1));
}

TEST(ReadEnvironment, DeepDataIsRefused) {
    const test::TemporaryFolder folder;
    {
        Imf::Header header(1, 1);
        header.setType(Imf::DEEPSCANLINE);
        header.compression() = Imf::ZIPS_COMPRESSION;
        for (const char* c : {"R", "G", "B"}) header.channels().insert(c, Imf::Channel(Imf::FLOAT));
        Imf::DeepScanLineOutputFile output((folder / "a.exr").c_str(), header);
        unsigned int count = 1;
        float value = 1;
        float* sample = &value;
        Imf::DeepFrameBuffer buffer;
        buffer.insertSampleCountSlice(
            Imf::Slice(Imf::UINT, reinterpret_cast<char*>(&count), sizeof count, sizeof count));
        for (const char* c : {"R", "G", "B"}) {
            buffer.insert(c, Imf::DeepSlice(Imf::FLOAT, reinterpret_cast<char*>(&sample),
                                            sizeof sample, sizeof sample, sizeof value));
        }
        output.setFrameBuffer(buffer);
        output.writePixels(1);
    }
    expect_invalid(read_environment(folder / "a.exr"), "deep data");
}

TEST(ReadEnvironment, ACroppedImageIsRefused) {
    const test::TemporaryFolder folder;
    Picture picture = numbered(4, 2);
    const Imath::Box2i data({1, 0}, {4, 1}), display({0, 0}, {5, 2});
    write_with_openexr(folder / "a.exr", Imf::Header(display, data), picture);
    expect_invalid(read_environment(folder / "a.exr"), "data window (1, 0) - (4, 1)");
}

TEST(ReadEnvironment, OtherPrimariesBecomeRec709) {
    const test::TemporaryFolder folder;
    Picture picture(4, 1);
    for (int i = 0; i < 3; ++i) picture.at(0, i)[i] = 1;
    picture.set(0, 3, 0.5f);
    for (int i = 0; i < 3; ++i)  // in gamut, so that nothing is clamped
        for (int k = 0; k < 3; ++k) picture.at(0, i)[k] += 2;
    Imf::Header header = header_of(picture);
    const Imf::Chromaticities aces_ap0({0.7347f, 0.2653f}, {0, 1}, {0.0001f, -0.077f},
                                       {0.32168f, 0.33767f});
    Imf::addChromaticities(header, aces_ap0);
    write_with_openexr(folder / "a.exr", header, picture);
    const auto environment = read_environment(folder / "a.exr", {.strict = true});
    ASSERT_TRUE(environment) << environment.error();
    // AP0 to Rec. 709 as the ACES project publishes it (D60 adapted to D65 by Bradford's matrix),
    // by columns, to the digits given there.
    const Vec3 columns[] = {{2.52169f, -0.27648f, -0.01538f},
                            {-1.13413f, 1.37272f, -0.15298f},
                            {-0.38756f, -0.09624f, 1.16835f}};
    const Vec3 white = columns[0] + columns[1] + columns[2];
    for (std::size_t i = 0; i < 3; ++i) {
        const Vec3 expected = columns[i] + 2.0f * white;
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(environment->radiance[i][k], expected[k], 1e-4f);
    }
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(environment->radiance[3][k], 0.5f, 1e-6f);

    // A red that is too large for a float once converted, and out of gamut in green and blue.
    Picture extreme(1, 1);
    extreme.at(0, 0)[0] = std::numeric_limits<float>::max();
    header = header_of(extreme);
    Imf::addChromaticities(header, aces_ap0);
    write_with_openexr(folder / "d.exr", header, extreme);
    const auto clamped = read_environment(folder / "d.exr");
    ASSERT_TRUE(clamped) << clamped.error();
    EXPECT_EQ(clamped->radiance[0], Vec3(std::numeric_limits<float>::max(), 0, 0));
    EXPECT_EQ(clamped->repairs.infinite_count, 1u);
    EXPECT_EQ(clamped->repairs.negative_count, 2u);

    // Rec. 709 in as many digits as people write changes nothing.
    header = header_of(picture);
    Imf::addChromaticities(header,
                           {{0.64f, 0.33f}, {0.3f, 0.6f}, {0.15f, 0.06f}, {0.3127f, 0.329f}});
    write_with_openexr(folder / "b.exr", header, picture);
    EXPECT_EQ(read_environment(folder / "b.exr")->radiance[0], Vec3(3, 2, 2));

    header = header_of(picture);
    Imf::addChromaticities(header, {{0.3f, 0.3f}, {0.3f, 0.3f}, {0.3f, 0.3f}, {0.3f, 0}});
    write_with_openexr(folder / "c.exr", header, picture);
    expect_invalid(read_environment(folder / "c.exr"), "chromaticities");
}

// --- repairs
// ----------------------------------------------------------------------------------------

TEST(ReadEnvironment, RepairsAreCountedAndStrictRefuses) {
    using Limits = std::numeric_limits<float>;
    Picture picture = numbered(5, 4);
    picture.at(1, 3)[1] = Limits::quiet_NaN();
    picture.at(2, 0)[0] = Limits::infinity();
    picture.at(2, 0)[2] = -Limits::infinity();
    picture.at(3, 4)[0] = -1e-20f;
    picture.at(3, 4)[1] = -0.0f;  // not wrong
    const auto environment = read_picture(picture);
    ASSERT_TRUE(environment) << environment.error();
    EXPECT_EQ(environment->repairs.nan_count, 1u);
    EXPECT_EQ(environment->repairs.infinite_count, 1u);
    EXPECT_EQ(environment->repairs.negative_count, 2u);
    EXPECT_EQ(environment->radiance[8], Vec3(9, 0, 9));
    EXPECT_EQ(environment->radiance[10], Vec3(Limits::max(), 11, 0));
    EXPECT_EQ(environment->radiance[19], Vec3(0, 0, 20));

    const auto refused = read_picture(picture, {.strict = true});
    expect_invalid(refused, "1 NaN, 1 infinite and 2 negative");
    expect_invalid(refused, "row 1, column 3");
    EXPECT_TRUE(read_picture(numbered(5, 4), {.strict = true}));
}

// --- damage
// -----------------------------------------------------------------------------------------

TEST(ReadEnvironment, EveryTruncationIsRefused) {
    const test::TemporaryFolder folder;
    const Picture picture = numbered(4, 2);
    ASSERT_TRUE(write_exr(folder / "whole.exr", 4, 2, picture.rgb));
    test::write_file(folder / "whole.hdr", test::radiance_bytes(4, 2, picture.rgb));
    for (const char* name : {"whole.exr", "whole.hdr"}) {
        const std::string whole = test::read_file(folder / name);
        ASSERT_TRUE(read_environment(folder / name));
        for (std::size_t size = 0; size < whole.size(); size += 7) {
            test::write_file(folder / "cut", whole.substr(0, size));
            const auto environment = read_environment(folder / "cut");
            ASSERT_FALSE(environment) << name << " cut to " << size;
            EXPECT_EQ(environment.error().code, Errc::InvalidInput);
        }
    }
}

TEST(ReadEnvironment, MissingFilesFail) {
    const auto environment = read_environment("/nonexistent/sky.hdr");
    ASSERT_FALSE(environment);
    EXPECT_EQ(environment.error().code, Errc::Failed);
    EXPECT_TRUE(environment.error().message.starts_with("/nonexistent/sky.hdr: "));
}

// --- real files
// -------------------------------------------------------------------------------------

struct Statistics {
    DVec3 mean{0};
    float peak = 0;
};

Statistics statistics(const Environment& environment) {
    Statistics s;
    for (const Vec3& texel : environment.radiance) {
        s.mean += DVec3(texel) / static_cast<double>(environment.radiance.size());
        s.peak = std::max({s.peak, texel.x, texel.y, texel.z});
    }
    return s;
}

// Plain averages and peaks as the data's own README gives them, to its three decimals.
TEST(ReadEnvironment, RealMapsHaveTheirPublishedMeansAndPeaks) {
    struct Case {
        const char* file;
        float peak;
        DVec3 mean;
    };
    const Case cases[] = {
        {"environments/kloppenheim_05_1k.hdr", 83456, {1.645, 1.581, 1.575}},
        {"environments/potsdamer_platz_1k.hdr", 11.8125f, {0.682, 0.672, 0.788}},
        {"environments/studio_small_03_1k.hdr", 3568, {1.636, 1.882, 2.127}},
        {"environments/dikhololo_night_1k.hdr", 115, {0.073, 0.065, 0.055}},
        {"environments/lebombo_1k.hdr", 41.25f, {0.757, 0.624, 0.536}},
        {"environments/courtyard_1k.exr", 55.5625f, {0.637, 0.511, 0.526}},
    };
    for (const Case& c : cases) {
        ENVBAKE_REQUIRE_DATA(c.file);
        const auto environment = read_environment(test::data(c.file));
        ASSERT_TRUE(environment) << environment.error();
        const auto& grid = std::get<LatLongGrid>(environment->grid);
        EXPECT_EQ(grid.width, 1024);
        EXPECT_EQ(grid.height, 512);
        const Statistics s = statistics(*environment);
        EXPECT_EQ(s.peak, c.peak) << c.file;
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(s.mean[k], c.mean[k], 5.1e-4) << c.file;
    }
}

// One picture in four ways: PIZ and ZIPS agree exactly, DWAA is lossy, tiles keep full floats.
TEST(ReadEnvironment, CompressionsOfOnePictureAgree) {
    ENVBAKE_REQUIRE_DATA("environments/exr_variants/half_piz.exr");
    const auto read = [](const std::string& name) {
        return read_environment(test::data(("environments/exr_variants/" + name + ".exr").c_str()));
    };
    const auto piz = read("half_piz"), zips = read("half_zips"), dwaa = read("half_dwaa"),
               tiled = read("float_rgba_tiled32");
    ASSERT_TRUE(piz && zips && dwaa && tiled);
    EXPECT_EQ(piz->radiance, zips->radiance);
    ASSERT_EQ(piz->radiance.size(), 256u * 128);
    const Statistics expected = statistics(*tiled);
    for (std::size_t i = 0; i < piz->radiance.size(); ++i) {
        for (int k = 0; k < 3; ++k) {
            const float whole = tiled->radiance[i][k];  // half: 11 bits, or steps of 2^-24
            ASSERT_NEAR(piz->radiance[i][k], whole, whole * 0x1p-11f + 0x1p-25f);
        }
    }
    for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(statistics(*dwaa).mean[k], expected.mean[k], 0.01 * expected.mean[k]);
}

TEST(ReadEnvironment, RealVariants) {
    ENVBAKE_REQUIRE_DATA("environments/exr_variants/latlong_attribute.exr");
    ENVBAKE_REQUIRE_DATA("environments/hdr_variants/flat_no_rle.hdr");
    const auto tagged =
        read_environment(test::data("environments/exr_variants/latlong_attribute.exr"));
    ASSERT_TRUE(tagged) << tagged.error();
    const auto& grid = std::get<LatLongGrid>(tagged->grid);
    EXPECT_EQ(grid.width, 1024);
    EXPECT_NEAR(grid.phi_edges.front(), -kPi / 2, 1e-15);
    const auto flat = read_environment(test::data("environments/hdr_variants/flat_no_rle.hdr"));
    const auto tiny = read_environment(test::data("environments/hdr_variants/tiny_6x3.hdr"));
    ASSERT_TRUE(flat && tiny);
    EXPECT_EQ(flat->radiance.size(), 128u * 64);
    EXPECT_EQ(tiny->radiance.size(), 18u);
    // The small one is the large one averaged: the same means.
    for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(statistics(*tiny).mean[k], statistics(*flat).mean[k], 0.01);
}

TEST(ReadEnvironment, NonFinitePixelsOfARealFile) {
    ENVBAKE_REQUIRE_DATA("malformed/nonfinite_pixels.exr");
    const fs::path file = test::data("malformed/nonfinite_pixels.exr");
    const auto image = decode_float_image(file);
    ASSERT_TRUE(image) << image.error();
    RadianceRepairs expected;
    for (int y = 0; y < image->height; ++y) {
        for (const float v : image->row(y)) {
            expected.nan_count += std::isnan(v);
            expected.infinite_count += std::isinf(v) && v > 0;
            expected.negative_count += v < 0;
        }
    }
    const auto environment = read_environment(file);
    ASSERT_TRUE(environment) << environment.error();
    EXPECT_GT(environment->repairs.nan_count, 0u);
    EXPECT_GT(environment->repairs.infinite_count, 0u);
    EXPECT_EQ(environment->repairs.nan_count, expected.nan_count);
    EXPECT_EQ(environment->repairs.infinite_count, expected.infinite_count);
    EXPECT_EQ(environment->repairs.negative_count, expected.negative_count);
    for (const Vec3& texel : environment->radiance) {
        for (int k = 0; k < 3; ++k) {
            EXPECT_TRUE(std::isfinite(texel[k]));
            EXPECT_GE(texel[k], 0);
        }
    }
    expect_invalid(read_environment(file, {.strict = true}), "NaN");
}

TEST(ReadEnvironment, DamagedFilesAreOneLine) {
    ENVBAKE_REQUIRE_DATA("malformed/exr");
    ENVBAKE_REQUIRE_DATA("malformed/hdr");
    // Wrong part types in otherwise whole files: the version field says what they are.
    const std::vector<std::string> readable{"scanline_with_deeptiled_type.exr",
                                            "tiled_with_deepscanline_type.exr",
                                            "tiled_with_scanlineimage_type.exr"};
    int files = 0;
    for (const char* folder : {"malformed/exr", "malformed/hdr"}) {
        for (const auto& entry : fs::directory_iterator(test::data(folder))) {
            ++files;
            const fs::path& file = entry.path();
            const auto environment = read_environment(file);
            if (std::count(readable.begin(), readable.end(), file.filename().string()) > 0) {
                EXPECT_TRUE(environment) << environment.error();
                continue;
            }
            ASSERT_FALSE(environment) << file;
            EXPECT_EQ(environment.error().code, Errc::InvalidInput) << environment.error();
            const std::string& message = environment.error().message;
            EXPECT_TRUE(message.starts_with(file.string() + ": not a readable image (")) << message;
            EXPECT_TRUE(std::all_of(message.begin(), message.end(), [](char c) {
                return c >= ' ' && c <= '~';
            })) << message;
        }
    }
    EXPECT_GT(files, 50);
}

}  // namespace
}  // namespace envbake
