#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the CSV of glossy_against_split_sum.sh: error of a picture against roughness, one panel a
scene and environment; the lower of two lines is the better choice.

    plot_glossy.py GLOSSY.csv PICTURE.svg
"""
import csv
import math
import sys
from pathlib import Path

WIDTH, HEIGHT, LEFT, TOP, GAP, BOTTOM = 230, 220, 56, 56, 24, 64
LINES = {"glossy_percent": ("#1a8f5a", "glossy transport"), "split_sum_percent": ("#3f74c6", "split sum"),
         "noise_percent": ("#999", "noise of the reference")}
LOW, HIGH = 1, 40  # per cent


def x_of(panel, roughness):
    return LEFT + panel * (WIDTH + GAP) + roughness * WIDTH


def y_of(percent):
    percent = min(max(percent, LOW), HIGH)
    return TOP + HEIGHT * (1 - math.log(percent / LOW) / math.log(HIGH / LOW))


def panel(index, title, rows):
    out = [f'<text class="t" x="{x_of(index, 0.5)}" y="{TOP - 10}" text-anchor="middle">{title}</text>']
    for percent in (1, 2, 5, 10, 20, 40):
        y = y_of(percent)
        out.append(f'<path class="g" d="M{x_of(index, 0):.1f} {y:.1f}h{WIDTH}"/>')
        if index == 0:
            out.append(f'<text class="t" x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{percent} %</text>')
    for tenth in range(0, 11, 2):
        x = x_of(index, tenth / 10)
        out.append(f'<path class="g" d="M{x:.1f} {TOP}v{HEIGHT}"/>')
        out.append(f'<text class="t" x="{x:.1f}" y="{TOP + HEIGHT + 16}" text-anchor="middle">{tenth / 10:g}</text>')
    for key, (colour, _) in LINES.items():
        for metallic, dash in (("1", ""), ("0", ' stroke-dasharray="4 3"')):
            chosen = sorted((float(r["roughness"]), float(r[key])) for r in rows if r["metallic"] == metallic)
            places = [(x_of(index, r), y_of(e)) for r, e in chosen]
            out.append(f'<path d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in places)}" fill="none" '
                       f'stroke="{colour}" stroke-width="1.6"{dash}/>')
            out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.8" fill="{colour if metallic == "1" else "none"}" '
                    f'stroke="{colour}"/>' for x, y in places]
    return out


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    if not Path(sys.argv[1]).exists():
        sys.exit(f"{sys.argv[1]} is not there: its plots stay as they were")
    with open(sys.argv[1], newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    panels = list(dict.fromkeys((r["scene"], r["environment"]) for r in rows))
    width, height = LEFT + max(len(panels) * (WIDTH + GAP), 3 * 170 + 210), TOP + HEIGHT + BOTTOM
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
           f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">',
           '<style>.t{fill:#777}.g{stroke:#888;stroke-opacity:.28;fill:none}</style>',
           f'<text class="t" x="{LEFT}" y="20" font-size="13">Relative rms error of a picture against '
           'perceptual roughness, lights extracted</text>']
    for i, (scene, environment) in enumerate(panels):
        out += panel(i, f"{scene}, {environment}",
                     [r for r in rows if (r["scene"], r["environment"]) == (scene, environment)])
    x = LEFT
    for colour, name in LINES.values():
        out.append(f'<circle cx="{x + 5}" cy="{height - 18}" r="4" fill="{colour}"/>'
                   f'<text class="t" x="{x + 16}" y="{height - 14}">{name}</text>')
        x += 170
    out.append(f'<text class="t" x="{x}" y="{height - 14}">filled: metal; open, dashed: dielectric</text></svg>')
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        file.write("\n".join(out) + "\n")


main()
