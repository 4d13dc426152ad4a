#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws what report.sh measured and plot.py does not: error by what is kept of the light, size
against time and memory, the runtime beside a plain read. Readable on white and on black.

    plot_curves.py FOLDER PICTURES
"""
import csv
import math
import sys
from pathlib import Path

WIDTH, HEIGHT, LEFT, TOP, GAP, LEGEND = 290, 240, 66, 60, 70, 20
GREEN, ORANGE, BLUE, GREY = "#1a8f5a", "#c9622b", "#3f74c6", "#888"


def power(exponent):
    return f"{10 ** exponent:,}" if 0 <= exponent <= 5 else f"1e{exponent}"


def axes(x, title, below, xs, ys):
    """Logarithmic axes over whole decades: SVG, and the place of a point."""
    x0, x1 = math.floor(math.log10(min(xs)) + 1e-9), math.ceil(math.log10(max(xs)) - 1e-9)
    y0, y1 = math.floor(math.log10(min(ys)) + 1e-9), math.ceil(math.log10(max(ys)) - 1e-9)
    x1, y1 = max(x1, x0 + 1), max(y1, y0 + 1)

    def place(a, b):
        return (x + WIDTH * (math.log10(a) - x0) / (x1 - x0), TOP + HEIGHT * (y1 - math.log10(b)) / (y1 - y0))
    out = [f'<text class="t" x="{x + WIDTH / 2}" y="{TOP - 12}" text-anchor="middle">{title}</text>',
           f'<text class="t" x="{x + WIDTH / 2}" y="{TOP + HEIGHT + 34}" text-anchor="middle">{below}</text>']
    for e in range(x0, x1 + 1):
        at, _ = place(10.0 ** e, 10.0 ** y0)
        out.append(f'<path class="g" d="M{at:.1f} {TOP}v{HEIGHT}"/><text class="t" x="{at:.1f}" y="{TOP + HEIGHT + 16}" '
                   f'text-anchor="middle">{power(e)}</text>')
    for e in range(y0, y1 + 1):
        _, at = place(10.0 ** x0, 10.0 ** e)
        out.append(f'<path class="g" d="M{x} {at:.1f}h{WIDTH}"/><text class="t" x="{x - 6}" y="{at + 4:.1f}" '
                   f'text-anchor="end">{power(e)}</text>')
    return out, place


def line(places, colour, dashed=False):
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
    dash, fill = (' stroke-dasharray="4 3"', "none") if dashed else ("", colour)
    return [f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.6"{dash}/>'] + [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{fill}" stroke="{colour}" stroke-width="1.4"/>' for x, y in places]


def picture(path, panels, legend, title):
    width = LEFT + max(panels * (WIDTH + GAP), 7 * len(title))
    height = TOP + HEIGHT + 48 + LEGEND * len(legend)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
           'font-family="sans-serif" font-size="11">',
           '<style>.t{fill:#777}.g{stroke:#888;stroke-opacity:.28;fill:none}</style>',
           f'<text class="t" x="{LEFT}" y="20" font-size="13">{title}</text>']
    for i, (colour, dashed, words) in enumerate(legend):
        y = TOP + HEIGHT + 58 + LEGEND * i
        out.append(f'<circle cx="{LEFT + 5}" cy="{y - 4}" r="4" fill="{"none" if dashed else colour}" stroke="{colour}"/>'
                   f'<text class="t" x="{LEFT + 16}" y="{y}">{words}</text>')

    def write(body):
        path.write_text("\n".join(out + body + ["</svg>"]) + "\n", encoding="utf-8")
    return write


def rows_of(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def wavelets(folder, pictures):
    with open(folder / "wavelets.csv", newline="", encoding="utf-8") as file:
        curves = [r[1:] for r in csv.reader(file) if r and r[0] == "curve" and r[1] != "scene"]
    scene, size = curves[0][0], max(int(c[1]) for c in curves if c[0] == curves[0][0])
    curves = [c for c in curves if c[0] == scene and int(c[1]) == size]
    kinds = {"weighted": (GREEN, False, "wavelets, terms chosen by the transport that they meet"),
             "size": (ORANGE, True, "wavelets, terms chosen by their size"),
             "sh": (BLUE, False, "SH, 2 to 10 bands")}
    maps = list(dict.fromkeys(c[2] for c in curves))
    xs, ys = [float(c[5]) for c in curves], [100 * float(c[6]) for c in curves]
    body = []
    for i, name in enumerate(maps):
        drawn, place = axes(LEFT + i * (WIDTH + GAP), name, "bytes of the light", xs, ys)
        body += drawn
        for kind, (colour, dashed, _) in kinds.items():
            body += line([place(float(c[5]), 100 * float(c[6])) for c in curves if (c[2], c[3]) == (name, kind)],
                         colour, dashed)
    picture(pictures / "wavelet_terms.svg", len(maps), kinds.values(),
            f"Diffuse exit radiance of {scene.replace('_', ' ')}, faces of {size}: relative rms error in per cent")(body)


def size(folder, pictures):
    speed = [r for r in rows_of(folder / "scaling.csv") if r["threads"] == "1"]
    memory = rows_of(folder / "memory_vertices.csv")
    body, place = axes(LEFT, "CPU microseconds a vertex, 448 rays, a ball with dents", "vertices",
                       [float(r["vertices"]) for r in speed],
                       [float(r[k]) for r in speed for k in ("cpu_us", "bare_us")])
    body += line([place(float(r["vertices"]), float(r["cpu_us"])) for r in speed], GREEN)
    body += line([place(float(r["vertices"]), float(r["bare_us"])) for r in speed], GREY, True)
    drawn, place = axes(LEFT + WIDTH + GAP, "MB, hilly ground, 48 rays", "vertices",
                        [float(r["vertices"]) for r in memory],
                        [max(float(r[k]), 1) for r in memory for k in ("peak_mb", "output_mb")])
    body += drawn + line([place(float(r["vertices"]), float(r["peak_mb"])) for r in memory], GREEN)
    body += line([place(float(r["vertices"]), max(float(r["output_mb"]), 1)) for r in memory], BLUE, True)
    picture(pictures / "size.svg", 2, [(GREEN, False, "bake: time, peak memory"), (GREY, True, "a bare loop over the same rays"),
                                       (BLUE, True, "the bundle that it writes")], "What size costs")(body)


def runtime(folder, pictures):
    rows = {tuple(r["name"].strip('"').split("/")[:2]): 1e9 * float(r["per_vertex"])
            for r in rows_of(folder / "runtime.csv") if r["build"] == "-march=native"}
    most, body = max(rows.values()), []
    for i, encoding in enumerate(dict.fromkeys(k[1] for k in rows)):
        y = TOP + i * HEIGHT / 5
        body.append(f'<text class="t" x="{LEFT - 6}" y="{y + 20:.1f}" text-anchor="end">{encoding}</text>')
        for k, (kind, colour) in enumerate((("shade", GREEN), ("read", GREY))):
            length = 1.5 * WIDTH * rows[kind, encoding] / most
            body.append(f'<rect x="{LEFT}" y="{y + 3 + 17 * k:.1f}" width="{length:.1f}" height="15" fill="{colour}"/>'
                        f'<text class="t" x="{LEFT + length + 6:.1f}" y="{y + 15 + 17 * k:.1f}">{rows[kind, encoding]:.2g}</text>')
    picture(pictures / "runtime.svg", 2, [(GREEN, False, "shading from transport of 5 bands"),
                                          (GREY, False, "a plain read of the same bytes")],
            "CPU nanoseconds a vertex, 2,000,000 vertices, one thread, -march=native")(body)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    status = 0
    for draw in (wavelets, size, runtime):
        try:
            draw(Path(sys.argv[1]), Path(sys.argv[2]))
        except (OSError, IndexError, KeyError, ValueError) as error:
            print(f"plot of {draw.__name__} stays as it was: {error!r}", file=sys.stderr)
            status = 1
    sys.exit(status)


main()
