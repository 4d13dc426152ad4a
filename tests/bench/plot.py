#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws error against CPU time from the CSV of error_against_time or transport_against_time: one
SVG a stage.

    plot.py MEASURED.csv FOLDER

A panel an input, both axes logarithmic, a line a method; filled marks are the worst error, open
marks the rms. Readable on white and on black.
"""
import csv
import math
import sys
from collections import defaultdict
from pathlib import Path

PANEL_WIDTH, PANEL_HEIGHT = 300, 260
LEFT, TOP, GAP, BOTTOM = 64, 56, 26, 92
COLOURS = {
    "envbake": "#1a8f5a",
    "importance sampling": "#c9622b",
    "filtered importance sampling": "#3f74c6",
    "texel centres": "#c9622b",
    "independent rays": "#c9622b",
    "jittered grid": "#3f74c6",
}
TITLES = {
    "mips": "Prefiltered mips, GGX, r = 1/4 1/2 3/4 1 on faces of 128 64 32 16",
    "brdf": "BRDF table",
    "sh": "SH projection, 5 bands",
    "transport": "Diffuse transport of a whole scene, 5 bands",
}
UNITS = {
    "importance sampling": "samples",
    "filtered importance sampling": "samples",
    "texel centres": "rows",
    "independent rays": "over the sphere",
    "jittered grid": "cells",
}


def decades(values):
    return math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)) + 1e-9)


def legend(method, rows):
    if method == "envbake":
        return "envbake (tolerance, or one setting)"
    settings = [int(float(r["setting"])) for r in rows if r["method"] == method]
    return f"{method} ({min(settings):,} .. {max(settings):,} {UNITS[method]})"


def power(exponent):
    return f"1e{exponent}"


class Panel:
    """One pair of axes."""

    def __init__(self, x, x_range, y_range):
        self.x, (self.x0, self.x1), (self.y0, self.y1) = x, x_range, y_range

    def place(self, seconds, error):
        u = (math.log10(seconds) - self.x0) / (self.x1 - self.x0)
        v = (math.log10(error) - self.y0) / (self.y1 - self.y0)
        return self.x + u * PANEL_WIDTH, TOP + (1 - v) * PANEL_HEIGHT

    def axes(self, title, with_labels):
        out = [f'<text class="t" x="{self.x + PANEL_WIDTH / 2}" y="{TOP - 10}" '
               f'text-anchor="middle">{title}</text>']
        for e in range(self.x0, self.x1 + 1):
            x, _ = self.place(10.0 ** e, 10.0 ** self.y0)
            out.append(f'<path class="g" d="M{x:.1f} {TOP}v{PANEL_HEIGHT}"/>')
            out.append(f'<text class="t" x="{x:.1f}" y="{TOP + PANEL_HEIGHT + 16}" '
                       f'text-anchor="middle">{power(e)}</text>')
        for e in range(self.y0, self.y1 + 1, max(1, (self.y1 - self.y0) // 7)):
            _, y = self.place(10.0 ** self.x0, 10.0 ** e)
            out.append(f'<path class="g" d="M{self.x} {y:.1f}h{PANEL_WIDTH}"/>')
            if with_labels:
                out.append(f'<text class="t" x="{self.x - 6}" y="{y + 4:.1f}" '
                           f'text-anchor="end">{power(e)}</text>')
        return out

    def line(self, points, colour, filled):
        places = [self.place(s, e) for s, e in points]
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
        dash = "" if filled else ' stroke-dasharray="4 3"'
        out = [f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.6"{dash}/>']
        for x, y in places:
            fill = colour if filled else "none"
            out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.2" fill="{fill}" '
                       f'stroke="{colour}" stroke-width="1.4"/>')
        return out


def draw(stage, rows):
    inputs = list(dict.fromkeys(r["input"] for r in rows))
    methods = list(dict.fromkeys(r["method"] for r in rows))
    seconds = [float(r["cpu_s"]) for r in rows]
    errors = [float(r[k]) for r in rows for k in ("worst", "rms")]
    x_range, y_range = decades(seconds), decades(errors)
    width = LEFT + len(inputs) * (PANEL_WIDTH + GAP)
    height = TOP + PANEL_HEIGHT + BOTTOM
    title = f"{TITLES[stage]}: error against CPU seconds"
    width = max(width, LEFT + 7 * len(title))
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
           f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">',
           '<style>.t{fill:#777}.g{stroke:#888;stroke-opacity:.28;fill:none}</style>',
           f'<text class="t" x="{LEFT}" y="20" font-size="13">{title}</text>']
    for i, name in enumerate(inputs):
        panel = Panel(LEFT + i * (PANEL_WIDTH + GAP), x_range, y_range)
        out += panel.axes(name, i == 0)
        for method in methods:
            chosen = [r for r in rows if r["input"] == name and r["method"] == method]
            for key, filled in (("worst", True), ("rms", False)):
                points = sorted((float(r["cpu_s"]), float(r[key])) for r in chosen)
                out += panel.line(points, COLOURS[method], filled)
    y = TOP + PANEL_HEIGHT + 38
    for i, method in enumerate(methods):
        out.append(f'<circle cx="{LEFT + 5}" cy="{y + 16 * i - 4}" r="4" '
                   f'fill="{COLOURS[method]}"/>')
        out.append(f'<text class="t" x="{LEFT + 16}" y="{y + 16 * i}">{legend(method, rows)}</text>')
    out.append(f'<text class="t" x="{LEFT + 330}" y="{y}">filled: worst; open, dashed: rms</text>'
               if len(inputs) > 1 else
               f'<text class="t" x="{LEFT}" y="{y + 16 * len(methods)}">'
               'filled: worst; open, dashed: rms</text>')
    out.append("</svg>")
    return "\n".join(out) + "\n"


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    if not Path(sys.argv[1]).exists():
        sys.exit(f"{sys.argv[1]} is not there: its plots stay as they were")
    by_stage = defaultdict(list)
    with open(sys.argv[1], newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            by_stage[row["stage"]].append(row)
    folder = Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    for stage, rows in by_stage.items():
        (folder / f"error_against_time_{stage}.svg").write_text(draw(stage, rows), encoding="utf-8")


main()
