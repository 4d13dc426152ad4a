#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the CSVs of report.sh into the tables of the pages, so that no measured figure is typed.

    write_tables.py FOLDER PAGE...

A table stands between <!-- table: NAME --> and <!-- end -->. <!-- machine --> ... <!-- end -->
becomes what the page was measured on; where its tables are not all of one run, which is of which. A
table whose CSV is missing stays as it is, and the exit status is 1. Standard library only.
"""
import csv
import math
import re
import sys
from pathlib import Path


def si(value, digits=2):
    """1.2e-3: an error."""
    value = float(value)
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def seconds(value):
    value = float(value)
    for unit, scale in (("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
        if value * scale >= 1 or unit == "ns":
            return f"{short(value * scale)} {unit}"
    return ""


def short(value):
    """Three digits or so, thousands set apart."""
    value = float(value)
    if abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def name(text):
    return text.removesuffix("_1k").replace("_", " ")


# ---- tables: rows of a CSV to a header and rows of text ----


def lighting(rows):
    header = ["stage, map", "method", "setting", "CPU time", "worst", "rms", "energy"]
    out = []
    for stage in ("sh", "mips", "brdf"):
        for input_ in dict.fromkeys(r["input"] for r in rows if r["stage"] == stage):
            chosen = [r for r in rows if r["stage"] == stage and r["input"] == input_]
            best = [min((r for r in chosen if r["method"] == m), key=lambda r: float(r["rms"]))
                    for m in dict.fromkeys(r["method"] for r in chosen) if m != "envbake"]
            for r in [r for r in chosen if r["method"] == "envbake"] + best:
                kind = ("tolerance" if stage == "mips" else "bands" if stage == "sh" else "texels") \
                    if r["method"] == "envbake" else "rows" if stage == "sh" else "samples"
                out.append([f"{stage}, {name(input_)}", r["method"], f"{kind} {float(r['setting']):g}",
                            seconds(r["cpu_s"]), si(r["worst"]), si(r["rms"]),
                            si(r["energy"]) if stage == "mips" else ""])
    return header, out


def time_for(error, points):
    """CPU seconds that a ladder of (seconds, error) needs, along straight lines of logarithms."""
    points = sorted(points)
    logs = [(math.log(s), math.log(e)) for s, e in points]
    target = math.log(error)
    for (s0, e0), (s1, e1) in zip(logs, logs[1:]):
        last = (s1, e1) == logs[-1]
        if e1 <= target or last:
            return math.exp(s0 + (target - e0) * (s1 - s0) / (e1 - e0))
    return math.nan


def transport_ratio(rows):
    header = ["scene", "tolerance", "true rms", "CPU time", "jittered grid / envbake", "independent rays / envbake"]
    out = []
    for scene in dict.fromkeys(r["input"] for r in rows):
        chosen = [r for r in rows if r["input"] == scene]

        def ladder(method):
            return [(float(r["cpu_s"]), float(r["rms"])) for r in chosen if r["method"] == method]
        for r in (r for r in chosen if r["method"] == "envbake"):
            ratios = [time_for(float(r["rms"]), ladder(m)) / float(r["cpu_s"])
                      for m in ("jittered grid", "independent rays")]
            out.append([name(scene), f"{float(r['setting']):g}", si(r["rms"]), seconds(r["cpu_s"]),
                        *(f"{float(f'{x:.2g}'):,g}" for x in ratios)])
    return header, out


def transport_check(rows):
    header = ["scene", "tolerance", "rays + check", "solved", "CPU a vertex", "true rms", "stated rms",
              "true p99.9", "stated p99.9"]
    return header, [[name(r["scene"]), f"{float(r['tolerance']):g}",
                     f"{float(r['rays']):,.0f} + {float(r['check_rays']):,.0f}",
                     f"{100 * float(r['solved']):.0f} %", f"{short(r['cpu_us'])} us", si(r["true_rms"]),
                     si(r["stated_rms"]), si(r["true_p999"]), si(r["stated_p999"])] for r in rows]


def encodings(rows):
    header = ["scene", "encoding", "bytes a vertex", "rms", "worst", "with the bake's"]
    return header, [[name(r["mesh"]), r["encoding"], f"{float(r['bytes_a_vertex']):g}", si(r["encoding_rms"]),
                     si(r["encoding_worst"]), si(r["whole_rms"])] for r in rows]


def bounces(rows):
    header = ["scene", "tolerance", "channels", "points a vertex", "bounces", "stated rms of what they add",
              "true rms of all"]
    return header, [[name(r["input"]), r["tolerance"], r["channels"], short(r["points"]), r["bounces"],
                     si(r["stated_rms"]), si(r["true_rms"])] for r in rows]


def bounces_time(rows):
    header = ["scene", "tolerance", "channels", "direct bake", "to 0.9 of the tolerance", "bounces",
              "both / direct bake"]
    return header, [[name(r["input"]), r["tolerance"], r["channels"], seconds(r["direct_s"]),
                     seconds(r["direct_tighter_s"]), seconds(r["bounces_s"]), f"{float(r['ratio']):.2f}"]
                    for r in rows]


def brdf_tables(rows):
    header = ["lobe", "axes", "size", "texels", "looked up, worst", "looked up, rms"]
    axes = {"roots": "(n.v)^(1/4), r^(1/2), end points (the default)", "linear": "n.v, r, centres (`linear`)"}
    return header, [[r["distribution"], axes[r["axes"]], f"{r['size']} x {r['size']}", si(r["texel_error"]),
                     si(r["lookup_error"]), si(r["lookup_rms"])] for r in rows]


def glossy_pictures(rows):
    header = ["scene, light", "material", "r", "glossy transport", "split sum", "noise"]
    return header, [[f"{name(r['scene'])}, {name(r['environment'])}",
                     "metal" if r["metallic"] == "1" else "dielectric", r["roughness"],
                     *(f"{float(r[k]):.2g} %" for k in ("glossy_percent", "split_sum_percent", "noise_percent"))]
                    for r in rows]


def glossy_check(rows):
    header = ["scene", "r", "R0", "rays", "true rms of T", "true rms of t", "stated"]
    return header, [[name(r["scene"]), r["roughness"], r["r0"], f"{float(r['rays']):,.0f}", si(r["transport_rms"]),
                     si(r["true_rms"]), si(r["stated_rms"])] for r in rows]


def glossy_bounces(rows):
    header = ["scene", "r", "with bounces", "their mean alone", "without, on both sides", "left out",
              "noise of the truth"]
    keys = ("with_bounces", "with_their_mean", "without_on_both_sides", "left_out", "noise")
    return header, [[name(r["scene"].removesuffix(".glb")), f"{float(r['roughness']):g}",
                     *(f"{float(r[k]):.2g} %" for k in keys)] for r in rows]


def glossy_bounces_matrices(rows):
    header = ["scene", "r", "true rms of t", "with the mean alone", "stated", "bytes beyond the mean"]
    return header, [[name(r["scene"].removesuffix(".glb")), f"{float(r['roughness']):g}", si(r["true_rms"]),
                     si(r["true_rms_of_mean"]), si(r["stated_rms"]), f"{int(r['bytes']):,}"] for r in rows]


def glossy_cost(rows):
    header = ["scene", "without", "with", "ratio", "bounces, without", "bounces, with", "ratio"]
    return header, [[name(r["scene"]), seconds(r["without_cpu_s"]), seconds(r["with_cpu_s"]), r["ratio"],
                     seconds(r["bounces_without_cpu_s"]), seconds(r["bounces_with_cpu_s"]), r["bounces_ratio"]]
                    for r in rows]


def wavelet_parts(lines):
    """The three kinds of lines of wavelet_check."""
    costs, errors, curves = [], [], []
    for line in lines:
        if line[0] == "curve":
            curves.append(dict(zip(("scene", "face_size", "map", "kept", "number", "bytes", "error"), line[1:])))
        elif line[1].isdigit() and line[2].isdigit():
            costs.append(line)
        elif line[1].isdigit():
            errors.append(line)
    return costs, errors, [c for c in curves if c["scene"] != "scene"]


def wavelet_cost(lines):
    header = ["scene", "faces", "rays", "every texel", "time", "every texel", "diffuse", "bytes"]
    return header, [[name(c[0]), c[1], short(c[3]), short(c[4]), f"{short(c[5])} us", f"{short(c[6])} us",
                     f"{short(c[8])} us", short(c[7])] for c in wavelet_parts(lines)[0]]


def wavelet_error(lines):
    header = ["map, scene", "faces", "outlines for every texel", "rounding", "terms", "whole",
              "a texel for what is in it"]

    def percent(x):
        return f"{100 * float(x):.2g}"
    return header, [[f"{name(e[2])}, {name(e[0])}", e[1], percent(e[3]), percent(e[4]), e[6], percent(e[7]),
                     percent(e[5])] for e in wavelet_parts(lines)[1]]


def wavelet_terms(lines):
    curves = wavelet_parts(lines)[2]
    numbers, bands = (16, 32, 64, 128, 256), (2, 3, 5, 7, 10)
    header = ["map, scene, faces"] + [f"{n} terms" for n in numbers] + [f"SH {n} bands" for n in bands]
    out = []
    for key in dict.fromkeys((c["map"], c["scene"], c["face_size"]) for c in curves):
        error = {(c["kept"], int(c["number"])): f"{100 * float(c['error']):.2g}" for c in curves
                 if (c["map"], c["scene"], c["face_size"]) == key}
        out.append([f"{name(key[0])}, {name(key[1])}, {key[2]}"] +
                   [f"{error.get(('weighted', n), '')} / {error.get(('size', n), '')}" for n in numbers] +
                   [error.get(("sh", n), "") for n in bands])
    return header, out


def pictures(rows):
    header = ["scene", "environment", "against the truth", "against the same light in 5 bands"]
    sky = {"potsdamer_platz_1k": "overcast", "kloppenheim_05_1k": "sun"}
    names = {"scene": "sample scene"}
    return header, [[names.get(r["scene"], name(r["scene"])), sky[r["environment"]],
                     f"{r['rmse']} % ({r['noise']})", f"{r['rmse_in_bands']} % ({r['noise_in_bands']})"] for r in rows]


def bare(rows):
    header = ["scene", "tolerance", "bare", "traced", "bare / traced", "whole bake", "bare / whole"]
    return header, [[name(r["input"]), r["tolerance"], f"{short(r['bare_ns'])} ns", f"{short(r['traced_ns'])} ns",
                     f"{float(r['speed']):.2f}", f"{short(r['whole_ns'])} ns", f"{float(r['share']):.2f}"]
                    for r in rows]


def scaling(rows):
    header = ["vertices", "threads", "CPU a vertex", "bare loop", "wall", "one thread / wall"]
    one = {r["vertices"]: float(r["wall_s"]) for r in rows if r["threads"] == "1"}
    return header, [[f"{int(r['vertices']):,}", r["threads"], f"{short(r['cpu_us'])} us", f"{short(r['bare_us'])} us",
                     seconds(r["wall_s"]), f"{one[r['vertices']] / float(r['wall_s']):.2f}"] for r in rows]


def runtime(rows):
    header = ["encoding", "bytes a vertex", "built for", "shaded", "plain read", "read / shaded"]
    time = {(*r["name"].strip('"').split("/")[:2], r["build"]): r for r in rows}
    out = []
    for _, encoding, build in (k for k in time if k[0] == "shade"):
        shade, read = time["shade", encoding, build], time["read", encoding, build]
        a, b = 1e9 * float(shade["per_vertex"]), 1e9 * float(read["per_vertex"])
        out.append([encoding, f"{float(shade['bytes_per_vertex']):g}", build, f"{a:.2g} ns", f"{b:.2g} ns",
                    f"{b / a:.2f}"])
    return header, out


def glossy_runtime(rows):
    header = ["what", "built for", "CPU time", "multiply-adds a second"]
    words = {"peak": "multiply-adds of a plain loop, 256,000 of them", "prepare_light": "a new light, once",
             "transfer": "what reaches a vertex",
             "transfer_with_bounces": "the same with four bands of light between surfaces, RGB", "reflect_lobe": "a lobe of it", "radiance": "a view of that",
             "matrices": "the matrices a and b themselves, instead"}
    return header, [[words[r["name"].strip('"')], r["build"], seconds(1e-9 * float(r["cpu_time"])),
                     f"{float(r['multiply_adds']) / 1e9:.1f} G" if r["multiply_adds"] else ""] for r in rows]


def memory_map(rows):
    header = ["map", "its texels, f32", "peak", "wall", "CPU"]
    return header, [[f"{r['width']} x {r['height']}", f"{short(r['texels_mb'])} MB", f"{short(r['peak_mb'])} MB",
                     seconds(r["wall_s"]), seconds(r["cpu_s"])] for r in rows]


def memory_vertices(rows):
    header = ["vertices", "output", "peak", "peak a vertex", "wall", "CPU a vertex"]
    return header, [[f"{int(r['vertices']):,}", f"{short(r['output_mb'])} MB", f"{short(r['peak_mb'])} MB",
                     f"{1e6 * float(r['peak_mb']) / int(r['vertices']):,.0f} B", seconds(r["wall_s"]),
                     seconds(float(r["cpu_s"]) / int(r["vertices"]))] for r in rows]


def usage(first):
    def table(rows):
        return [first, "wall", "CPU", "peak"], [
            [f"`{r[first]}`" if first == "command" or r[first].startswith("--") else r[first], seconds(r["wall_s"]),
             seconds(r["cpu_s"]), f"{short(r['peak_mb'])} MB" if float(r["peak_mb"]) else "too short to see"]
            for r in rows]
    return table


TABLES = {  # name: CSV, function
    "lighting": ("lighting", lighting),
    "brdf_tables": ("brdf_tables", brdf_tables),
    "transport_ratio": ("transport", transport_ratio),
    "transport_check": ("transport_check", transport_check),
    "encodings": ("encodings", encodings),
    "bounces": ("bounces", bounces),
    "bounces_time": ("bounces", bounces_time),
    "glossy_pictures": ("glossy_pictures", glossy_pictures),
    "glossy_check": ("glossy_check", glossy_check),
    "glossy_bounces": ("glossy_bounces", glossy_bounces),
    "glossy_bounces_matrices": ("glossy_bounces", glossy_bounces_matrices),
    "glossy_cost": ("glossy_cost", glossy_cost),
    "wavelet_terms": ("wavelets", wavelet_terms),
    "wavelet_cost": ("wavelets", wavelet_cost),
    "wavelet_error": ("wavelets", wavelet_error),
    "pictures": ("pictures", pictures),
    "bare": ("bare", bare),
    "scaling": ("scaling", scaling),
    "runtime": ("runtime", runtime),
    "glossy_runtime": ("glossy_runtime", glossy_runtime),
    "memory_map": ("memory_map", memory_map),
    "memory_vertices": ("memory_vertices", memory_vertices),
    "start_up": ("start_up", usage("command")),
    "rebuilds": ("rebuilds", usage("change")),
}


def read(path, by_line):
    with open(path, newline="", encoding="utf-8") as file:
        return [line for line in csv.reader(file) if line] if by_line else list(csv.DictReader(file))


def markdown(header, rows):
    def numeric(i):
        return all(re.match(r"[-0-9.,]*[0-9]|$", r[i]) for r in rows)
    lines = [header, ["---:" if i and numeric(i) else "---" for i in range(len(header))]] + rows
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def machine(folder, csvs):
    runs = {}
    for step in dict.fromkeys(csvs):
        if (folder / f"{step}.run").exists():
            line = (folder / f"{step}.run").read_text(encoding="utf-8").strip()
            what, load = line.rsplit("; load ", 1)
            runs.setdefault(what, []).append((step, float(load)))
    out = []
    for what, steps in sorted(runs.items(), key=lambda r: -len(r[1])):
        loads = [load for _, load in steps]
        only = "" if len(runs) == 1 else f" Of this run: {', '.join(s for s, _ in steps)}."
        out.append(f"Measured on {what}; {min(loads):g} to {max(loads):g} threads were at "
                   f"work meanwhile, the benchmarks' own among them.{only}")
    return "\n\n".join(out)


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    folder, missing = Path(sys.argv[1]), []
    for page in map(Path, sys.argv[2:]):
        text = page.read_text(encoding="utf-8")
        names = re.findall(r"<!-- table: (\w+) -->", text)
        for table in names:
            step, function = TABLES[table]
            if not (folder / f"{step}.csv").exists():
                missing.append(f"{page}: {table} stays as it was, for there is no {step}.csv")
                continue
            try:
                body = markdown(*function(read(folder / f"{step}.csv", step == "wavelets")))
            except (KeyError, ValueError, IndexError, ZeroDivisionError) as error:
                missing.append(f"{page}: {table} stays as it was, for {step}.csv is not as expected: {error!r}")
                continue
            text = re.sub(rf"(<!-- table: {table} -->\n).*?(<!-- end -->)",
                          lambda m, b=body: m.group(1) + b + "\n" + m.group(2), text, flags=re.S)
        text = re.sub(r"(<!-- machine -->\n).*?(<!-- end -->)",
                      lambda m, b=machine(folder, [TABLES[t][0] for t in names]): m.group(1) + b + "\n" + m.group(2),
                      text, flags=re.S)
        page.write_text(text, encoding="utf-8")
    for line in missing:
        print(line, file=sys.stderr)
    sys.exit(1 if missing else 0)


main()
