// SPDX-License-Identifier: Apache-2.0
#include "baker/input/read_environment.h"

#include "baker/core/parallel.h"
#include "baker/input/image_worker.h"
#include "envbake/runtime/cube.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

namespace envbake {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr float kLargest = std::numeric_limits<float>::max();

// --- shapes
// ---------------------------------------------------------------------------------------

/// A rectangle of the image, and where its texels go: rows and columns of an array of its own size,
/// turned about as told.
struct Cell {
    int row = 0;  ///< of its upper left corner in the image
    int column = 0;
    int height = 0;
    int width = 0;
    std::size_t first_texel = 0;  ///< in Environment::radiance
    bool flip_rows = false;
    bool flip_columns = false;
};

struct Shape {
    std::variant<LatLongGrid, CubeGrid> grid;
    std::vector<Cell> cells;
};

/// Edges for texel centres at the ends of [first, last] and evenly between: midway between the
/// centres, so the texels at the ends have half the size. One texel has all of it.
std::vector<double> edges_between_centres(int count, double first, double last) {
    std::vector<double> edges{first};
    for (int i = 1; i < count; ++i) {
        const double t = (i - 0.5) / (count - 1);
        edges.push_back(first * (1 - t) + last * t);
    }
    edges.push_back(last);
    return edges;
}

Cell face_cell(cube::Face face, int size, int cell_row, int cell_column) {
    const auto texels = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
    return {.row = cell_row * size,
            .column = cell_column * size,
            .height = size,
            .width = size,
            .first_texel = static_cast<std::size_t>(face) * texels};
}

Shape equirectangular(int width, int height) {
    return {make_lat_long_grid(width, height), {{.height = height, .width = width}}};
}

/// OpenEXR, ImfEnvmap.h, "Latitude-Longitude Map": longitude falls from pi to -pi, left to right,
/// and +X lies at longitude pi/2, so phi = pi/2 - longitude rises from -pi/2.
Shape openexr_lat_long(int width, int height) {
    LatLongGrid grid{.width = width,
                     .height = height,
                     .theta_edges = edges_between_centres(height, 0, kPi),
                     .phi_edges = edges_between_centres(width, -kPi / 2, 3 * kPi / 2)};
    return {std::move(grid), {{.height = height, .width = width}}};
}

/// OpenEXR, ImfEnvmap.h, "Cube Map". Its faces are seen from inside, OpenGL's from outside: they
/// are mirrored, upside down for +Y and -Y, left to right for the others.
Shape openexr_cube(int size) {
    Shape shape{CubeGrid{.size = size, .edges = edges_between_centres(size, -1, 1)}, {}};
    for (int f = 0; f < cube::kFaceCount; ++f) {
        const auto face = static_cast<cube::Face>(f);
        Cell cell = face_cell(face, size, f, 0);
        const bool polar = face == cube::Face::PositiveY || face == cube::Face::NegativeY;
        cell.flip_rows = polar;
        cell.flip_columns = !polar;
        shape.cells.push_back(cell);
    }
    return shape;
}

Shape strip(int size, bool horizontal) {
    Shape shape{make_cube_grid(size), {}};
    for (int f = 0; f < cube::kFaceCount; ++f) {
        shape.cells.push_back(
            face_cell(static_cast<cube::Face>(f), size, horizontal ? 0 : f, horizontal ? f : 0));
    }
    return shape;
}

Shape cross(int size, bool horizontal) {
    using cube::Face;
    Cell back = horizontal ? face_cell(Face::NegativeZ, size, 1, 3)
                           : face_cell(Face::NegativeZ, size, 3, 1);
    back.flip_rows = back.flip_columns = !horizontal;
    return {make_cube_grid(size),
            {face_cell(Face::PositiveY, size, 0, 1), face_cell(Face::NegativeX, size, 1, 0),
             face_cell(Face::PositiveZ, size, 1, 1), face_cell(Face::PositiveX, size, 1, 2),
             face_cell(Face::NegativeY, size, 2, 1), back}};
}

/// True if every texel outside the cells is 0.
bool rest_is_zero(const FloatImage& image, const Shape& shape) {
    for (int row = 0; row < image.height; ++row) {
        const std::span<const float> values = image.row(row);
        std::vector<bool> used(static_cast<std::size_t>(image.width), false);
        for (const Cell& cell : shape.cells) {
            if (row < cell.row || row >= cell.row + cell.height) continue;
            std::fill_n(used.begin() + cell.column, cell.width, true);
        }
        for (std::size_t i = 0; i < values.size(); ++i)
            if (!used[i / 3] && values[i] != 0) return false;
    }
    return true;
}

Expected<Shape> shape_of(const FloatImage& image, const std::string& name) {
    const int width = image.width, height = image.height;
    switch (image.envmap) {
        case Envmap::LatLong:
            return openexr_lat_long(width, height);
        case Envmap::Cube:
            if (height != 6 * width) {
                return Error{Errc::InvalidInput,
                             concat(name,
                                    ": its envmap attribute says cube, so it must be N x 6N, "
                                    "but it is ",
                                    width, " x ", height)};
            }
            return openexr_cube(width);
        case Envmap::None:
            break;
    }
    if (image.data_window != image.display_window) {
        const auto text = [](const TexelWindow& w) {
            return concat("(", w.min_x, ", ", w.min_y, ") - (", w.max_x, ", ", w.max_y, ")");
        };
        return Error{Errc::InvalidInput,
                     concat(name, ": its data window ", text(image.data_window),
                            " is not its display window ", text(image.display_window),
                            ": a cropped image is not a whole environment")};
    }
    if (width == 6 * height) return strip(height, true);
    if (height == 6 * width) return strip(width, false);
    for (const bool horizontal : {true, false}) {
        const int across = horizontal ? 4 : 3, down = horizontal ? 3 : 4;
        if (width % across != 0 || width / across * down != height) continue;
        Shape shape = cross(width / across, horizontal);
        if (rest_is_zero(image, shape)) return shape;
    }
    return equirectangular(width, height);
}

// --- colour
// ---------------------------------------------------------------------------------------

/// x, y of red, green, blue, white. Source: ITU-R BT.709-6, items 1.3 and 1.4.
constexpr std::array<float, 8> kRec709{0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};

/// XYZ of a colour of luminance 1.
DVec3 xyz_of(double x, double y) {
    return {x / y, 1, (1 - x - y) / y};
}

/// Linear RGB of these primaries to XYZ: white (1, 1, 1) has luminance 1.
DMat3 rgb_to_xyz(const std::array<float, 8>& c) {
    const DMat3 primaries(xyz_of(c[0], c[1]), xyz_of(c[2], c[3]), xyz_of(c[4], c[5]));
    const DVec3 weights = glm::inverse(primaries) * xyz_of(c[6], c[7]);
    return DMat3(primaries[0] * weights[0], primaries[1] * weights[1], primaries[2] * weights[2]);
}

/// Von Kries adaptation in the Bradford cone space. Source: [Lam85], as in ICC.1:2022 annex E.
DMat3 bradford(const DVec3& from_white, const DVec3& to_white) {
    const DMat3 cones = glm::transpose(DMat3(0.8951, 0.2664, -0.1614,  //
                                             -0.7502, 1.7135, 0.0367,  //
                                             0.0389, -0.0685, 1.0296));
    const DVec3 gain = (cones * to_white) / (cones * from_white);
    return glm::inverse(cones) * DMat3(gain.x, 0, 0, 0, gain.y, 0, 0, 0, gain.z) * cones;
}

bool finite(const DMat3& m) {
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            if (!std::isfinite(m[i][j])) return false;
    return true;
}

/// What turns the image's colours into Rec. 709; nothing where they are that already.
Expected<std::optional<DMat3>> conversion_of(const FloatImage& image, const std::string& name) {
    constexpr float kSame = 1e-3f;  // files write 0.3127 or 0.31271 or 0.313
    std::optional<DMat3> none;
    if (!image.chromaticities) return none;
    const std::array<float, 8>& c = *image.chromaticities;
    bool same = true;
    for (std::size_t i = 0; i < c.size(); ++i) same &= std::abs(c[i] - kRec709[i]) <= kSame;
    if (same) return none;
    const DMat3 adapt = bradford(xyz_of(c[6], c[7]), xyz_of(kRec709[6], kRec709[7]));
    const DMat3 convert = glm::inverse(rgb_to_xyz(kRec709)) * adapt * rgb_to_xyz(c);
    if (!finite(convert)) {
        return Error{Errc::InvalidInput,
                     concat(name, ": its chromaticities (red ", c[0], " ", c[1], ", green ", c[2],
                            " ", c[3], ", blue ", c[4], " ", c[5], ", white ", c[6], " ", c[7],
                            ") make no colour space")};
    }
    return std::optional<DMat3>(convert);
}

// --- texels
// ---------------------------------------------------------------------------------------

/// Repairs values and keeps count; remembers where the first bad one was.
class Repairer {
  public:
    float operator()(double value, int row, int column) {
        if (value >= 0 && value <= kLargest) return static_cast<float>(value);
        if (repairs.total() == 0) first_row = row, first_column = column;
        if (std::isnan(value)) {
            ++repairs.nan_count;
            return 0;
        }
        if (value > 0) {
            ++repairs.infinite_count;
            return kLargest;
        }
        ++repairs.negative_count;
        return 0;
    }

    /// Adds what was found further down.
    void append(const Repairer& below) {
        if (repairs.total() == 0) first_row = below.first_row, first_column = below.first_column;
        repairs.nan_count += below.repairs.nan_count;
        repairs.infinite_count += below.repairs.infinite_count;
        repairs.negative_count += below.repairs.negative_count;
    }

    RadianceRepairs repairs;
    int first_row = 0;
    int first_column = 0;
};

void place_row(std::span<const float> values, int row, const Cell& cell,
               const std::optional<DMat3>& convert, Repairer& repair, std::vector<Vec3>& to) {
    const int cell_row = cell.flip_rows ? cell.row + cell.height - 1 - row : row - cell.row;
    Vec3* const target = to.data() + cell.first_texel +
                         static_cast<std::size_t>(cell_row) * static_cast<std::size_t>(cell.width);
    for (int i = 0; i < cell.width; ++i) {
        const int column = cell.column + i;
        const float* const p = values.data() + 3 * static_cast<std::size_t>(column);
        Vec3 texel(repair(p[0], row, column), repair(p[1], row, column), repair(p[2], row, column));
        if (convert) {
            const DVec3 converted = *convert * DVec3(texel);
            texel = Vec3(repair(converted.x, row, column), repair(converted.y, row, column),
                         repair(converted.z, row, column));
        }
        target[cell.flip_columns ? cell.width - 1 - i : i] = texel;
    }
}

Error refused(const std::string& name, const Repairer& repair) {
    const RadianceRepairs& r = repair.repairs;
    return {Errc::InvalidInput,
            concat(name, ": ", r.nan_count, " NaN, ", r.infinite_count, " infinite and ",
                   r.negative_count, " negative values, the first in row ", repair.first_row,
                   ", column ", repair.first_column,
                   "; radiance is finite and not negative (without --strict they are repaired)")};
}

}  // namespace

Expected<Environment> read_environment(const std::filesystem::path& file,
                                       const ReadEnvironmentOptions& options) {
    const std::string name = file.string();
    ENVBAKE_TRY(FloatImage image, decode_float_image(file));
    ENVBAKE_TRY(Shape shape, shape_of(image, name));
    ENVBAKE_TRY(const std::optional<DMat3> convert, conversion_of(image, name));

    Environment environment;
    environment.file_name = file.filename().string();
    std::size_t texels = 0;
    for (const Cell& cell : shape.cells)
        texels += static_cast<std::size_t>(cell.width) * static_cast<std::size_t>(cell.height);
    environment.radiance.reserve(texels);

    // From the top down, freeing what has been read; with a single cell, whose rows come in order,
    // the array grows along, and the image is never in memory twice.
    constexpr int kBlockRows = 64;
    const bool grows = shape.cells.size() == 1;
    if (!grows) environment.radiance.resize(texels);
    Repairer repair;
    for (int top = 0; top < image.height; top += kBlockRows) {
        const int rows = std::min(kBlockRows, image.height - top);
        image.release_rows_before(top);
        if (grows) {
            environment.radiance.resize(environment.radiance.size() +
                                        static_cast<std::size_t>(rows) *
                                            static_cast<std::size_t>(image.width));
        }
        std::array<Repairer, kBlockRows> row_repairs;
        parallel_for(static_cast<std::size_t>(rows), [&](std::size_t i) {
            const int row = top + static_cast<int>(i);
            for (const Cell& cell : shape.cells) {
                if (row < cell.row || row >= cell.row + cell.height) continue;
                place_row(image.row(row), row, cell, convert, row_repairs[i], environment.radiance);
            }
        });
        for (const Repairer& found : row_repairs) repair.append(found);
    }
    if (options.strict && repair.repairs.total() > 0) return refused(name, repair);
    environment.repairs = repair.repairs;
    environment.grid = std::move(shape.grid);
    return environment;
}

}  // namespace envbake
