#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes a copy of a .glb in which every material is the same plain one.

    with_material.py IN.glb OUT.glb ROUGHNESS METALLIC

METALLIC "both": primitives are a white metal and the plain dielectric in turn.
"""
import json
import struct
import sys

source, target, roughness, metallic = sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4]
with open(source, "rb") as file:
    data = file.read()
(size,) = struct.unpack_from("<I", data, 12)
gltf, rest = json.loads(data[20:20 + size]), data[20 + size:]


def material(color, metallic):
    return {"pbrMetallicRoughness": {
        "baseColorFactor": color, "metallicFactor": float(metallic), "roughnessFactor": roughness}}


plain = [0.95, 0.8, 0.55, 1]
gltf["materials"] = ([material([1, 1, 1, 1], 1), material(plain, 0)] if metallic == "both"
                     else [material(plain, metallic)])
primitives = [primitive for mesh in gltf["meshes"] for primitive in mesh["primitives"]]
for i, primitive in enumerate(primitives):
    primitive["material"] = i % len(gltf["materials"])
text = json.dumps(gltf).encode()
text += b" " * (-len(text) % 4)
with open(target, "wb") as file:
    file.write(data[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + b"JSON" + text + rest)
