// SPDX-License-Identifier: Apache-2.0
#include "baker/commands/command.h"
#include "baker/core/text.h"
#include "baker/pipeline/array_values.h"
#include "baker/pipeline/metadata.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <ostream>
#include <set>

namespace envbake {

namespace {

struct DiffOptions {
    std::filesystem::path a, b;
    bool json = false;
};

/// How two arrays of one name differ, in one line; `max` and `relative_rms` where they compare.
struct ArrayDifference {
    std::string name, what;
    double max = 0;           ///< largest |a - b|
    double relative_rms = 0;  ///< |a - b|_2 / |b|_2
    std::uint64_t count = 0;  ///< elements that differ
};

void measure(ArrayDifference& d, const std::vector<double>& a, const std::vector<double>& b) {
    double difference = 0, norm = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const bool same = a[i] == b[i] || (std::isnan(a[i]) && std::isnan(b[i]));
        double delta = same ? 0 : std::abs(a[i] - b[i]);
        if (std::isnan(delta)) delta = INFINITY;
        d.count += same ? 0 : 1;
        d.max = std::max(d.max, delta);
        difference += delta * delta;
        norm += b[i] * b[i];
    }
    d.relative_rms = norm > 0 ? std::sqrt(difference / norm) : std::sqrt(difference);
}

Expected<std::vector<ArrayDifference>> compare(const format::Reader& a, const format::Reader& b) {
    std::set<std::string> names;
    for (const format::Reader* reader : {&a, &b})
        for (std::size_t i = 0; i < reader->array_count(); ++i)
            names.emplace(reader->array(i).name);
    std::vector<ArrayDifference> differences;
    for (const std::string& name : names) {
        const auto in_a = a.find(name), in_b = b.find(name);
        if (!in_a || !in_b) {
            differences.push_back({name, in_a ? "only in the first" : "only in the second"});
            continue;
        }
        if (in_a->type != in_b->type || in_a->shape != in_b->shape) {
            differences.push_back({name, "another type or shape"});
            continue;
        }
        ENVBAKE_TRY(const std::vector<double> values_a, read_values(a, *in_a));
        ENVBAKE_TRY(const std::vector<double> values_b, read_values(b, *in_b));
        ArrayDifference d{name, "other values"};
        measure(d, values_a, values_b);
        if (d.count > 0) differences.push_back(std::move(d));
    }
    std::sort(differences.begin(), differences.end(),
              [](const auto& x, const auto& y) { return natural_less(x.name, y.name); });
    return differences;
}

/// The metadata's differences as paths: "/options/bands: 5 -> 4".
Json compare_metadata(const format::Reader& a, const format::Reader& b) {
    const Json metadata_a = parse_metadata(a.metadata());
    const Json metadata_b = parse_metadata(b.metadata());
    Json list = Json::array();
    if (metadata_a.is_discarded() || metadata_b.is_discarded()) return list;
    const Json flat_a = metadata_a.flatten(), flat_b = metadata_b.flatten();
    for (const auto& [path, value] : flat_a.items())
        if (!flat_b.contains(path) || flat_b[path] != value)
            list.push_back(
                {{"path", path}, {"first", value}, {"second", flat_b.value(path, Json())}});
    for (const auto& [path, value] : flat_b.items())
        if (!flat_a.contains(path))
            list.push_back({{"path", path}, {"first", Json()}, {"second", value}});
    return list;
}

Expected<ExitCode> diff(const DiffOptions& options, std::ostream& out) {
    ENVBAKE_TRY(const format::Reader a, open_bundle(options.a));
    ENVBAKE_TRY(const format::Reader b, open_bundle(options.b));
    ENVBAKE_TRY(const std::vector<ArrayDifference> arrays, compare(a, b));
    const Json metadata = compare_metadata(a, b);
    const bool same = arrays.empty() && metadata.empty();
    if (options.json) {
        Json list = Json::array();
        for (const ArrayDifference& d : arrays)
            list.push_back({{"name", d.name},
                            {"what", d.what},
                            {"elements", d.count},
                            {"max", d.max},
                            {"relative_rms", d.relative_rms}});
        out << to_text({{"same", same}, {"arrays", list}, {"metadata", metadata}}, 2) << '\n';
    } else {
        for (const ArrayDifference& d : arrays) {
            out << d.name << ": " << d.what;
            if (d.count > 0 && d.name != format::kMetadataName)
                out << ": " << format_count(d.count) << " elements, at most "
                    << format_number(d.max) << ", relative rms " << format_number(d.relative_rms);
            out << '\n';
        }
        for (const Json& change : metadata)
            out << "metadata " << change["path"].get<std::string>() << ": " << change["first"]
                << " -> " << change["second"] << '\n';
        if (same) out << "no difference\n";
    }
    return same ? ExitCode::Done : ExitCode::InvalidBundle;
}

}  // namespace

RunCommand declare_diff(CLI::App& app) {
    const auto options = std::make_shared<DiffOptions>();
    app.add_option("first", options->a, "Bundle (.envb)")->required();
    app.add_option("second", options->b, "Bundle to compare it with (.envb)")->required();
    app.add_flag("--json", options->json, "Machine-readable output");
    app.footer("Exit status 0 where nothing differs, 4 where something does.");
    return [options](std::ostream& out, std::ostream& err) {
        const auto done = diff(*options, out);
        return done ? *done : report(done.error(), err);
    };
}

}  // namespace envbake
