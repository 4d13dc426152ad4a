// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/commands/numbered_names.h"
#include "baker/commands/stage_list.h"
#include "baker/core/text.h"
#include "baker/pipeline/array_values.h"
#include "baker/pipeline/metadata.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <ostream>

namespace envbake {

namespace {

struct DumpOptions {
    std::filesystem::path bundle;
    bool json = false;
};

struct DumpedArray {
    format::ArrayInfo info;
    ArrayStatistics statistics;
    bool intact = true;
};

/// Arrays of one kind, shown as one line: mesh/0..12/diffuse.
struct Group {
    std::vector<NumberedName> names;
    std::vector<const DumpedArray*> arrays;
};

std::vector<Group> group(const std::vector<DumpedArray>& arrays) {
    std::vector<Group> groups;
    for (const DumpedArray& array : arrays) {
        const NumberedName name = split_at_number(array.info.name);
        const auto same = std::find_if(groups.begin(), groups.end(), [&](const Group& g) {
            return name.number >= 0 && g.names[0].same_kind(name) &&
                   g.arrays[0]->info.type == array.info.type &&
                   g.arrays[0]->info.codec == array.info.codec;
        });
        Group& target = same == groups.end() ? groups.emplace_back() : *same;
        target.names.push_back(name);
        target.arrays.push_back(&array);
    }
    return groups;
}

/// Vertices add up over meshes; other axes show their range.
std::string shape_of(const Group& g) {
    std::string text;
    for (std::size_t axis = 0; axis < g.arrays[0]->info.rank; ++axis) {
        const std::uint64_t first = g.arrays.front()->info.shape[axis];
        const std::uint64_t last = g.arrays.back()->info.shape[axis];
        std::uint64_t sum = 0;
        for (const DumpedArray* array : g.arrays) sum += array->info.shape[axis];
        if (!text.empty()) text += " x ";
        if (axis == 0 && g.names[0].prefix == "mesh/")
            text += format_count(sum);
        else
            text += first == last ? format_count(first) : concat(first, "..", last);
    }
    return text;
}

std::string error_of(const Group& g, const Json& errors) {
    std::optional<double> worst;
    for (const DumpedArray* array : g.arrays) {
        const auto found = errors.find(std::string(array->info.name));
        if (found == errors.end() || !found->is_object()) continue;
        const auto value = found->find("error");
        if (value == found->end() || !value->is_number()) continue;
        worst = std::max(worst.value_or(0), value->get<double>());
    }
    return worst ? format_number(*worst) : "";
}

struct Row {
    std::string name, shape, bytes, as, range, error;
};

void print_table(const std::vector<Row>& rows, std::ostream& out) {
    const auto width = [&](std::string Row::*column) {
        std::size_t widest = 0;
        for (const Row& row : rows) widest = std::max(widest, (row.*column).size());
        return widest;
    };
    const std::size_t name = width(&Row::name), shape = width(&Row::shape),
                      bytes = width(&Row::bytes), as = width(&Row::as), range = width(&Row::range);
    const auto padded = [](const std::string& text, std::size_t size) {
        return text + std::string(size - text.size(), ' ');
    };
    for (const Row& row : rows) {
        std::string line = padded(row.name, name) + "   " + padded(row.shape, shape) + "   " +
                           std::string(bytes - row.bytes.size(), ' ') + row.bytes + "   " +
                           padded(row.as, as) + "   " + padded(row.range, range) + "   " +
                           row.error;
        line.erase(line.find_last_not_of(' ') + 1);
        out << line << '\n';
    }
}

void print_arrays(const std::vector<DumpedArray>& arrays, const Json& errors, std::ostream& out) {
    std::vector<Row> rows{{"array", "shape", "bytes", "as", "range", "error"}};
    for (const Group& g : group(arrays)) {
        std::uint64_t bytes = 0;
        double low = INFINITY, high = -INFINITY;
        std::uint64_t non_finite = 0;
        for (const DumpedArray* array : g.arrays) {
            bytes += array->info.stored_size;
            low = std::min(low, array->statistics.min);
            high = std::max(high, array->statistics.max);
            non_finite += array->statistics.non_finite_count;
        }
        const format::ArrayInfo& info = g.arrays[0]->info;
        std::string as(format::to_string(info.type));
        if (info.codec != format::Codec::None) as += concat("+", format::to_string(info.codec));
        std::string range = concat(format_number(low), " .. ", format_number(high));
        if (non_finite > 0) range += concat(", ", format_count(non_finite), " not finite");
        if (info.name == format::kMetadataName) {
            as = "json";
            range.clear();
        }
        rows.push_back({joined_name(g.names), shape_of(g), format_bytes(bytes), as, range,
                        error_of(g, errors)});
    }
    print_table(rows, out);
}

/// What the numbers of the error column are: every norm once, with the arrays it belongs to.
void print_norms(const Json& errors, std::ostream& out) {
    std::vector<std::pair<std::string, std::string>> norms;  // norm, arrays
    for (const auto& [name, error] : errors.items()) {
        const std::string norm = error.at("norm");
        const bool known = std::any_of(norms.begin(), norms.end(),
                                       [&](const auto& entry) { return entry.first == norm; });
        const NumberedName numbered = split_at_number(name);
        if (!known)
            norms.emplace_back(
                norm, numbered.prefix + (numbered.number >= 0 ? "*" : "") + numbered.suffix);
    }
    if (norms.empty()) return;
    out << "\nerrors\n";
    std::size_t width = 0;
    for (const auto& [norm, name] : norms) width = std::max(width, printable(name).size());
    for (const auto& [norm, name] : norms)
        out << printable(name) << std::string(width - printable(name).size() + 3, ' ')
            << printable(norm) << '\n';
}

std::string percent(double fraction) {
    return format_number(100 * fraction) + " %";
}

/// Sums of the reports of all meshes.
struct TransportTotals {
    std::uint64_t vertices = 0, triangles = 0, rays = 0, without_rays = 0, baked = 0;
    double squared_error = 0, p999 = 0;
};

TransportTotals transport_totals(const Json& metadata) {
    TransportTotals t;
    for (const Json& mesh : metadata.value("meshes", Json::array())) {
        const auto count = mesh.at("vertex_count").get<std::uint64_t>();
        t.vertices += count;
        t.triangles += mesh.at("triangle_count").get<std::uint64_t>();
        if (!mesh.contains("diffuse")) continue;
        const Json& diffuse = mesh["diffuse"];
        t.baked += count;
        t.rays += diffuse.at("rays").get<std::uint64_t>();
        t.without_rays += count - diffuse.at("traced").get<std::uint64_t>();
        const double rms = diffuse.at("error_rms");
        t.squared_error += rms * rms * static_cast<double>(count);
        t.p999 = std::max(t.p999, diffuse.at("error_p999").get<double>());
    }
    return t;
}

double worst_mip_error(const Json& errors) {
    double worst = 0;
    for (const auto& [name, error] : errors.items())
        if (name.rfind("environment/mips", 0) == 0)
            worst = std::max(worst, error.at("error").get<double>());
    return worst;
}

void print_inputs(const Json& metadata, std::ostream& out) {
    const char* label = "from           ";
    const TransportTotals totals = transport_totals(metadata);
    for (const Json& input : metadata.at("inputs")) {
        const std::string role = input.at("role");
        out << label << printable(input.at("name").get<std::string>()) << "  "
            << printable(input.at("xxh3").get<std::string>());
        label = "               ";
        if (role == "scene")
            out << "  " << format_count(totals.vertices) << " vertices, "
                << format_count(totals.triangles) << " triangles, "
                << metadata.at("scene").at("materials") << " materials";
        if (role == "environment") {
            const Json& environment = metadata.at("environment");
            if (environment.contains("width"))
                out << "  " << environment.at("width") << " x " << environment.at("height");
            else
                out << "  cube of " << environment.at("face_size") << " x "
                    << environment.at("face_size");
            out << ", mean " << format_number(environment.at("mean")) << ", peak "
                << format_number(environment.at("peak"));
            std::uint64_t repaired = 0;
            for (const auto& [kind, count] : environment.at("repaired").items())
                repaired += count.get<std::uint64_t>();
            if (repaired > 0) out << ", " << format_count(repaired) << " values repaired";
        }
        out << '\n';
    }
}

void print_errors(const Json& metadata, std::ostream& out) {
    const Json& options = metadata.at("options");
    out << "asked          error " << format_number(options.at("tolerance")) << ", "
        << options.at("bands") << " bands\n";
    const TransportTotals t = transport_totals(metadata);
    const double mips = worst_mip_error(metadata.at("arrays"));
    std::string got;
    if (t.baked > 0)
        got =
            concat("transport ", percent(std::sqrt(t.squared_error / static_cast<double>(t.baked))),
                   " rms, ", percent(t.p999), " at the 99.9th percentile");
    if (mips > 0)
        got += concat(got.empty() ? "" : ";  ", "mips ", percent(mips), " in the worst texel");
    if (!got.empty()) out << "got            " << got << '\n';
    if (t.baked > 0)
        out << "               "
            << format_number(static_cast<double>(t.rays) / static_cast<double>(t.baked))
            << " rays a vertex; "
            << percent(static_cast<double>(t.without_rays) / static_cast<double>(t.baked))
            << " of the vertices needed none\n";
}

/// One line a light; nothing where the array is not as docs/format.md has it.
void print_lights(const format::Reader& reader, const Json& metadata, std::ostream& out) {
    const auto info = reader.find("environment/lights");
    if (!info || info->rank != 2 || info->shape[1] != 9) return;
    const auto rows = read_values(reader, *info);
    if (!rows) return;
    const char* label = "lights         ";
    for (std::size_t at = 0; at < rows->size(); at += 9) {
        const auto number = [&](std::size_t i) { return format_number((*rows)[at + i]); };
        const double degrees = (*rows)[at + 6] * 180 / std::numbers::pi;
        out << label << "towards (" << number(0) << ", " << number(1) << ", " << number(2) << "), "
            << number(3) << " " << number(4) << " " << number(5) << " W/m2, radius "
            << format_number(degrees) << " degrees, " << percent((*rows)[at + 8])
            << " of the energy\n";
        label = "               ";
    }
    const Json lights =
        metadata.value("environment", Json::object()).value("lights", Json::object());
    if (lights.value("extracted", false)) out << label << "left out of all other lighting arrays\n";
}

/// What the window of SH lighting costs.
void print_window(const Json& metadata, std::ostream& out) {
    const Json environment = metadata.value("environment", Json::object());
    if (!environment.contains("window")) return;
    const Json& window = environment["window"];
    out << "window         ";
    if (window.at("lambda") == 0)
        out << "none needed: irradiance is nowhere negative\n";
    else
        out << "irradiance is nowhere negative; it keeps "
            << percent(window.at("irradiance_peak_kept")) << " of its peak and changes by "
            << percent(window.at("irradiance_rms_loss")) << " rms\n";
}

/// What wavelets the bundle has, and what they are for.
void print_wavelets(const Json& metadata, std::ostream& out) {
    const Json wavelet = metadata.value("wavelet", Json::object());
    if (wavelet.empty()) return;
    out << "wavelets       faces of " << wavelet.at("face_size") << " texels";
    if (wavelet.contains("light")) {
        const Json& light = wavelet["light"];
        out << ", " << light.at("terms") << " of " << light.at("of") << " terms of the light; "
            << metadata.at("options").at("bands") << " bands of SH lose "
            << percent(metadata.at("environment").at("sh_shadow_loss"))
            << " rms beside a hard shadow";
    }
    std::uint64_t coefficients = 0, vertices = 0;
    for (const Json& mesh : metadata.value("meshes", Json::array())) {
        if (!mesh.contains("wavelet")) continue;
        coefficients += mesh["wavelet"].at("coefficients").get<std::uint64_t>();
        vertices += mesh.at("vertex_count").get<std::uint64_t>();
    }
    if (vertices > 0)
        out << "\n               "
            << format_number(static_cast<double>(coefficients) / static_cast<double>(vertices))
            << " coefficients a vertex";
    out << '\n';
}

void print_notes(const Json& metadata, std::ostream& out) {
    const Json notes = metadata.value("scene", Json::object()).value("notes", Json::array());
    if (notes.empty()) return;
    out << "\nnotes\n";
    for (const Json& note : notes) out << printable(note.get<std::string>()) << '\n';
}

/// "part 2 of 3, "; of a whole bundle nothing.
std::string part_of(const format::Reader& reader) {
    const auto part = reader.view<std::uint32_t>(format::kShardName);
    return part && part->size() == 2 ? concat("part ", (*part)[0], " of ", (*part)[1], ", ") : "";
}

void print_text(const std::filesystem::path& file, const format::Reader& reader,
                const std::vector<DumpedArray>& arrays, const Json& metadata, std::ostream& out) {
    const auto damaged =
        std::find_if(arrays.begin(), arrays.end(), [](const DumpedArray& a) { return !a.intact; });
    const bool shard = reader.find(format::kShardName).has_value();
    out << printable(file.filename().string()) << "    envbake bundle " << reader.major() << '.'
        << reader.minor() << ", " << part_of(reader) << format_bytes(reader.file().size()) << ", "
        << arrays.size() << " arrays, "
        << (damaged == arrays.end() ? std::string("intact")
                                    : concat("DAMAGED: ", damaged->info.name))
        << '\n';
    try {
        print_inputs(metadata, out);
        if (!shard) print_errors(metadata, out);
        print_lights(reader, metadata, out);
        print_window(metadata, out);
        print_wavelets(metadata, out);
    } catch (const Json::exception&) {
        out << "               (metadata of another tool: see --json)\n";
    }
    out << '\n';
    print_arrays(arrays,
                 metadata.is_object() ? metadata.value("arrays", Json::object()) : Json::object(),
                 out);
    try {
        if (!shard) print_norms(metadata.at("arrays"), out);
        print_skipped_stages(metadata.at("plan"), out);
        print_notes(metadata, out);
    } catch (const Json::exception&) {
        out << "(no plan in the metadata)\n";
    }
}

Json dump_json(const format::Reader& reader, const std::vector<DumpedArray>& arrays,
               const Json& metadata) {
    Json list = Json::array();
    for (const DumpedArray& array : arrays) {
        const format::ArrayInfo& info = array.info;
        list.push_back({{"name", info.name},
                        {"type", format::to_string(info.type)},
                        {"shape", std::vector(info.shape.begin(), info.shape.begin() + info.rank)},
                        {"codec", format::to_string(info.codec)},
                        {"offset", info.offset},
                        {"stored_bytes", info.stored_size},
                        {"bytes", info.size},
                        {"min", array.statistics.min},
                        {"max", array.statistics.max},
                        {"mean", array.statistics.mean},
                        {"non_finite", array.statistics.non_finite_count},
                        {"intact", array.intact}});
    }
    return {{"format", concat(reader.major(), ".", reader.minor())},
            {"bytes", reader.file().size()},
            {"arrays", std::move(list)},
            {"metadata", metadata}};
}

Expected<ExitCode> dump(const DumpOptions& options, std::ostream& out) {
    ENVBAKE_TRY(const format::Reader reader, open_bundle(options.bundle));
    std::vector<DumpedArray> arrays;
    bool intact = true;
    for (std::size_t i = 0; i < reader.array_count(); ++i) {
        DumpedArray array{reader.array(i), {}, true};
        const auto measured = statistics(reader, array.info);
        array.intact = measured.has_value() && reader.verify(array.info).has_value();
        if (measured) array.statistics = *measured;
        intact = intact && array.intact;
        arrays.push_back(array);
    }
    std::stable_sort(arrays.begin(), arrays.end(), [](const DumpedArray& a, const DumpedArray& b) {
        return natural_less(a.info.name, b.info.name);
    });
    const Json metadata = parse_metadata(reader.metadata());
    if (options.json)
        out << to_text(dump_json(reader, arrays, metadata.is_discarded() ? Json() : metadata), 2)
            << '\n';
    else
        print_text(options.bundle, reader, arrays, metadata, out);
    return intact ? ExitCode::Done : ExitCode::InvalidBundle;
}

}  // namespace

RunCommand declare_dump(CLI::App& app) {
    const auto options = std::make_shared<DumpOptions>();
    app.add_option("bundle", options->bundle, "Bundle to describe (.envb)")->required();
    app.add_flag("--json", options->json, "Machine-readable output");
    return [options](std::ostream& out, std::ostream& err) {
        const auto done = dump(*options, out);
        return done ? *done : report(done.error(), err);
    };
}

}  // namespace envbake
