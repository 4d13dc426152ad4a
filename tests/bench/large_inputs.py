#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes large inputs: what they show does not matter, how large they are does.

    large_inputs.py map OUT.hdr HEIGHT        a sky with a sun, 2 HEIGHT x HEIGHT
    large_inputs.py ground OUT.glb VERTICES   hilly ground of about so many vertices, two triangles each
"""
import array
import json
import math
import struct
import sys


def write_map(path, height):
    """Flat Radiance scanlines: noise in the mantissas, so that no texel equals the next."""
    width = 2 * height
    noise = bytearray(4 * width + 4 * 997)
    x = 1
    for i in range(0, len(noise), 4):
        for c in range(3):
            x = x * 1103515245 + 12345 & 0x7FFFFFFF
            noise[i + c] = 128 + (x >> 16) % 128
        noise[i + 3] = 128
    with open(path, "wb") as file:
        file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width))
        for row in range(height):
            begin = 4 * (row * 131 % 997)
            texels = bytearray(noise[begin:begin + 4 * width])
            if row == height // 4:
                texels[4 * (width // 3) + 3] = 128 + 16
            file.write(texels)


def write_ground(path, vertices):
    n = math.isqrt(vertices)
    positions, normals = array.array("f"), array.array("f")
    step = 8 * math.pi / n
    waves = [(math.sin(i * step), math.cos(i * step)) for i in range(n)]
    for sin_z, cos_z in waves:
        z = len(positions) / 3 / n * step
        for i, (sin_x, cos_x) in enumerate(waves):
            positions.extend((i * step, sin_x * sin_z, z))
            dx, dz = cos_x * sin_z, sin_x * cos_z
            scale = 1 / math.sqrt(dx * dx + 1 + dz * dz)
            normals.extend((-dx * scale, scale, -dz * scale))
    triangles = array.array("I")
    for row in range(n - 1):
        for i in range(row * n, row * n + n - 1):
            triangles.extend((i, i + n, i + 1, i + 1, i + n, i + n + 1))
    blocks = [positions.tobytes(), normals.tobytes(), triangles.tobytes()]
    views, offset = [], 0
    for block in blocks:
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(block)})
        offset += len(block)
    extent = (n - 1) * step
    scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "buffers": [{"byteLength": offset}], "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": n * n, "type": "VEC3", "min": [0, -1, 0],
             "max": [extent + step, 1, extent + step]},
            {"bufferView": 1, "componentType": 5126, "count": n * n, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5125, "count": len(triangles), "type": "SCALAR"}]}
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    with open(path, "wb") as file:
        file.write(struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + offset, len(text), 0x4E4F534A) + text)
        file.write(struct.pack("<II", offset, 0x004E4942))
        for block in blocks:
            file.write(block)


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in ("map", "ground"):
        sys.exit(__doc__)
    (write_map if sys.argv[1] == "map" else write_ground)(sys.argv[2], int(sys.argv[3]))


main()
