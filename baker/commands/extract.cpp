// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/core/text.h"
#include "baker/core/write_file.h"
#include "baker/input/image_worker.h"
#include "baker/pipeline/array_values.h"
#include "baker/pipeline/metadata.h"

#include <filesystem>
#include <memory>
#include <ostream>

namespace envbake {

namespace {

struct ExtractOptions {
    std::filesystem::path bundle, output;
    std::string name;
};

std::vector<std::uint64_t> shape_of(const format::ArrayInfo& info) {
    return {info.shape.begin(), info.shape.begin() + info.rank};
}

/// NumPy's .npy, version 1.0:
/// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
std::string npy_header(const format::ArrayInfo& info) {
    constexpr const char* kTypes[] = {"<f4", "<f2", "|u1", "<u2", "<u4", "|i1", "<i2"};
    std::string shape;
    for (const std::uint64_t extent : shape_of(info)) shape += std::to_string(extent) + ", ";
    std::string text = concat("{'descr': '", kTypes[static_cast<std::size_t>(info.type)],
                              "', 'fortran_order': False, 'shape': (", shape, "), }");
    constexpr std::size_t kPrefixSize = 10, kNpyAlignment = 64;
    while ((kPrefixSize + text.size() + 1) % kNpyAlignment != 0) text += ' ';
    text += '\n';
    const auto size = static_cast<unsigned>(text.size());
    return std::string("\x93NUMPY\x01\x00", 8) + static_cast<char>(size & 0xff) +
           static_cast<char>(size >> 8) + text;
}

Expected<void> write_npy(const ExtractOptions& options, const format::Reader& reader,
                         const format::ArrayInfo& info) {
    ENVBAKE_TRY(const std::vector<std::byte> bytes, read_bytes(reader, info));
    std::string content = npy_header(info);
    content.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    return write_file(options.output, content);
}

Expected<void> write_json(const ExtractOptions& options, const format::Reader& reader,
                          const format::ArrayInfo& info) {
    if (info.name == format::kMetadataName) {
        ENVBAKE_TRY(const std::vector<std::byte> bytes, read_bytes(reader, info));
        return write_file(options.output,
                          {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    }
    ENVBAKE_TRY(const std::vector<double> values, read_values(reader, info));
    const Json json = {{"name", info.name},
                       {"type", format::to_string(info.type)},
                       {"shape", shape_of(info)},
                       {"values", values}};
    return write_file(options.output, json.dump() + "\n");
}

/// Images only: [rows, columns, 1 to 3], or cube faces [6, s, s, 1 to 3] one below the other. One
/// channel becomes grey.
Expected<void> write_image(const ExtractOptions& options, const format::Reader& reader,
                           const format::ArrayInfo& info) {
    const auto shape = shape_of(info);
    const bool cube = shape.size() == 4 && shape[0] == 6;
    const bool image = (shape.size() == 3 || cube) && shape.back() >= 1 && shape.back() <= 3;
    if (!image)
        return Error{Errc::Usage,
                     concat("array ", info.name, " is not an image: extract it as .npy or .json")};
    const std::uint64_t channels = shape.back();
    const std::uint64_t width = shape[shape.size() - 2];
    const std::uint64_t height = cube ? 6 * shape[1] : shape[0];
    ENVBAKE_TRY(const std::vector<double> values, read_values(reader, info));
    std::vector<float> rgb;
    for (std::size_t i = 0; i < values.size(); i += channels)
        for (std::size_t c = 0; c < 3; ++c)
            rgb.push_back(c < channels    ? static_cast<float>(values[i + c])
                          : channels == 1 ? static_cast<float>(values[i])
                                          : 0.0f);
    return write_exr(options.output, static_cast<int>(width), static_cast<int>(height), rgb);
}

Expected<void> extract(const ExtractOptions& options) {
    ENVBAKE_TRY_VOID(check_output(options.output, {options.bundle}));
    ENVBAKE_TRY(const format::Reader reader, open_bundle(options.bundle));
    const auto info = reader.find(options.name);
    if (!info)
        return Error{Errc::Usage, concat(options.bundle.string(), ": has no array ",
                                         quoted(options.name), "; envbake dump lists them")};
    if (const auto checked = reader.verify(*info); !checked)
        return Error{Errc::InvalidBundle,
                     concat(options.bundle.string(), ": ", format::to_string(checked.error()))};
    const std::string extension = options.output.extension().string();
    if (extension == ".npy") return write_npy(options, reader, *info);
    if (extension == ".json") return write_json(options, reader, *info);
    if (extension == ".exr") return write_image(options, reader, *info);
    return Error{Errc::Usage,
                 concat(options.output.string(), ": the name must end in .npy, .exr or .json")};
}

}  // namespace

RunCommand declare_extract(CLI::App& app) {
    const auto options = std::make_shared<ExtractOptions>();
    app.add_option("bundle", options->bundle, "Bundle to read (.envb)")->required();
    app.add_option("name", options->name,
                   "Array to extract: environment/mips/1, mesh/0/diffuse, metadata ...")
        ->required();
    app.add_option(
           "-o,--output", options->output,
           "File to write: .npy or .json for any array, .exr for images (cube faces in a column)")
        ->required();
    return [options](std::ostream&, std::ostream& err) {
        const auto done = extract(*options);
        return done ? ExitCode::Done : report(done.error(), err);
    };
}

}  // namespace envbake
