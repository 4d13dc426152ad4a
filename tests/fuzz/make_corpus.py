#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the seeds that the fuzzers of images, environments and scenes start from.

    make_corpus.py FOLDER      makes FOLDER/image, FOLDER/environment and FOLDER/scene, the last of what
                               make_meshes has left in FOLDER/compression, too
"""
import base64
import json
import pathlib
import struct
import sys
import zlib

folder = pathlib.Path(sys.argv[1])


def write(kind, name, data):
    path = folder / kind / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


# Radiance: flat texels, run-length encoded rows, exposure.
def radiance(width, height, rows, header=b""):
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n" + header + f"\n-Y {height} +X {width}\n".encode() + rows


flat = b"".join(bytes([10 * i + 1, 40, 200 - i, 128 + i % 3]) for i in range(4 * 2))
encoded = b""
for y in range(8):
    encoded += bytes([2, 2, 0, 16])
    for channel in range(4):
        encoded += bytes([128 + 10, 60 + channel]) + bytes([6, 1, 2, 3, y, 5, 129 - channel])
images = {
    "flat.hdr": radiance(4, 2, flat),
    "runs.hdr": radiance(16, 8, encoded),
    "exposed.hdr": radiance(4, 2, flat, b"EXPOSURE=2.5\nPRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329\n"),
}


# OpenEXR: scan lines of floats, one row a chunk or sixteen in ZIP; an envmap; a tile.
def attribute(name, kind, value):
    return name + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value


def exr(width, height, compression=0, envmap=None, tile=None, channels=(b"B", b"G", b"R")):
    listed = b"".join(c + b"\0" + struct.pack("<IIii", 2, 0, 1, 1) for c in channels) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    head = struct.pack("<II", 20000630, 2 | (0x200 if tile else 0))
    head += attribute(b"channels", b"chlist", listed)
    head += attribute(b"compression", b"compression", bytes([compression]))
    head += attribute(b"dataWindow", b"box2i", window) + attribute(b"displayWindow", b"box2i", window)
    head += attribute(b"lineOrder", b"lineOrder", b"\0")
    head += attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
    head += attribute(b"screenWindowCenter", b"v2f", struct.pack("<ff", 0, 0))
    head += attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1))
    if envmap is not None:
        head += attribute(b"envmap", b"envmap", bytes([envmap]))
    if tile:
        head += attribute(b"tiles", b"tiledesc", struct.pack("<IIB", tile, tile, 0))
    head += b"\0"

    def packed(rows):
        if compression == 0:
            return rows
        halves = rows[0::2] + rows[1::2]
        differences = bytearray(halves[:1])
        for a, b in zip(halves, halves[1:]):
            differences.append((b - a + 128) % 256)
        deflated = zlib.compress(bytes(differences))
        return deflated if len(deflated) < len(rows) else rows

    def row(y):
        return b"".join(struct.pack("<f", (x + y + c) % 3 * 0.5) for c in range(len(channels)) for x in range(width))

    chunks = []
    if tile:
        for ty in range(0, height, tile):
            for tx in range(0, width, tile):
                rows = row(0)[: 4 * min(tile, width - tx)] * len(channels) * min(tile, height - ty)
                chunks.append(struct.pack("<iiii", tx // tile, ty // tile, 0, 0) + struct.pack("<I", len(rows)) + rows)
    else:
        for y in range(0, height, 16 if compression == 3 else 1):
            rows = packed(b"".join(row(k) for k in range(y, min(height, y + (16 if compression == 3 else 1)))))
            chunks.append(struct.pack("<iI", y, len(rows)) + rows)
    at, offsets = len(head) + 8 * len(chunks), b""
    for chunk in chunks:
        offsets += struct.pack("<Q", at)
        at += len(chunk)
    return head + offsets + b"".join(chunks)


images.update({
    "rows.exr": exr(8, 4),
    "zip.exr": exr(16, 8, compression=3),
    "grey.exr": exr(4, 2, channels=(b"Y",)),
    "envmap.exr": exr(8, 4, envmap=0),
    "cube.exr": exr(2, 12, envmap=1),
    "tiles.exr": exr(8, 4, tile=4),
})
for name, data in images.items():
    write("image", name, data)
    write("environment", name, data)


# PNG of every kind of pixel, JPEG of one grey block and of three.
def png(width, height, colour=6, bits=8, interlaced=0, palette=b"", transparent=b""):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colour]

    def rows(columns, lines):
        size = (columns * channels * bits + 7) // 8
        return b"".join(bytes([y % 5]) + bytes((60 * x + y) % 4 for x in range(size)) for y in range(lines))

    passes = [(0, 8, 0, 8), (4, 8, 0, 8), (0, 4, 4, 8), (2, 4, 0, 4), (0, 2, 2, 4), (1, 2, 0, 2), (0, 1, 1, 2)]
    pixels = rows(width, height) if not interlaced else b"".join(
        rows((width - x + dx - 1) // dx, (height - y + dy - 1) // dy) for x, dx, y, dy in passes if x < width)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, interlaced))
            + (chunk(b"PLTE", palette) if palette else b"") + (chunk(b"tRNS", transparent) if transparent else b"")
            + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b""))


def jpeg(components, progressive=False):
    def segment(marker, data):
        return bytes([0xFF, marker]) + struct.pack(">H", len(data) + 2) + data

    ids = range(1, components + 1)
    one_code = [1] + [0] * 15  # the code 0
    scan = bytes([components]) + b"".join(bytes([i, 0]) for i in ids) + bytes([0, 0 if progressive else 63, 0])
    return (b"\xff\xd8" + segment(0xDB, b"\0" + b"\x10" * 64)
            + segment(0xC2 if progressive else 0xC0,
                      struct.pack(">BHHB", 8, 8, 8, components) + b"".join(bytes([i, 0x11, 0]) for i in ids))
            + segment(0xC4, bytes([0x00, *one_code, 6])) + segment(0xC4, bytes([0x10, *one_code, 0]))
            + segment(0xDA, scan) + b"\x3e" * components + b"\xff\xd9")


textures = {
    "rgba.png": png(3, 2), "rgb.png": png(3, 2, 2), "grey_alpha.png": png(3, 2, 4), "grey16.png": png(3, 2, 0, 16),
    "bits.png": png(9, 3, 0, 1), "transparent.png": png(3, 2, 2, transparent=b"\0\1\0\2\0\3"),
    "palette.png": png(5, 2, 3, 2, palette=bytes(range(12)), transparent=b"\0\x80"),
    "interlaced.png": png(9, 9, 6, 8, 1), "grey.jpg": jpeg(1), "colour.jpg": jpeg(3),
    "progressive.jpg": jpeg(1, progressive=True),
}
for name, data in textures.items():
    write("image", name, data)


# glTF
class Scene:
    """One buffer and what lies in it."""

    def __init__(self):
        self.data = b""
        self.fallbacks = []  # buffers without data, of what is compressed
        self.gltf = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
                     "meshes": [{"primitives": []}], "accessors": [], "bufferViews": []}

    def view(self, data):
        self.data += b"\0" * (-len(self.data) % 4)
        self.gltf["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(self.gltf["bufferViews"]) - 1

    def accessor(self, code, component, kind, values, **more):
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind]
        self.gltf["accessors"].append({"bufferView": self.view(struct.pack(f"<{len(values)}{code}", *values)),
                                       "componentType": component, "type": kind, "count": len(values) // width, **more})
        return len(self.gltf["accessors"]) - 1

    def positions(self):
        return self.accessor("f", 5126, "VEC3", [0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0.5], min=[0, 0, 0], max=[1, 1, 0.5])

    def primitive(self, attributes, indices=None, **more):
        primitive = {"attributes": attributes, **more}
        if indices is not None:
            primitive["indices"] = indices
        self.gltf["meshes"][0]["primitives"].append(primitive)

    def glb(self):
        self.gltf["buffers"] = [{"byteLength": len(self.data)}, *self.fallbacks]
        text = json.dumps(self.gltf).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + b"\0" * (-len(self.data) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
        return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body

    def text(self):
        self.gltf["buffers"] = [{"byteLength": len(self.data), "uri": "data:application/octet-stream;base64,"
                                 + base64.b64encode(self.data).decode()}]
        return json.dumps(self.gltf).encode()


plain = Scene()
plain.primitive({"POSITION": plain.positions()}, plain.accessor("H", 5123, "SCALAR", [0, 1, 2, 1, 3, 2]))
write("scene", "plain.glb", plain.glb())
write("scene", "plain.gltf", plain.text())

strips = Scene()
p = strips.positions()
n = strips.accessor("f", 5126, "VEC3", [0, 0, 1] * 4)
strips.primitive({"POSITION": p, "NORMAL": n}, mode=5)
strips.primitive({"POSITION": p}, strips.accessor("B", 5121, "SCALAR", [0, 1, 2, 3]), mode=6)
strips.gltf["nodes"] = [{"children": [1], "scale": [1, -1, 1]}, {"mesh": 0, "rotation": [0, 0, 0.6, 0.8]}]
write("scene", "strips.glb", strips.glb())

textured = Scene()
uv = textured.accessor("H", 5123, "VEC2", [0, 0, 65535, 0, 0, 65535, 65535, 65535], normalized=True)
colour = textured.accessor("B", 5121, "VEC4", [255, 128, 0, 255] * 4, normalized=True)
textured.primitive({"POSITION": textured.positions(), "TEXCOORD_0": uv, "COLOR_0": colour},
                   textured.accessor("I", 5125, "SCALAR", [0, 1, 2]), material=0)
textured.gltf["images"] = [{"bufferView": textured.view(png(2, 2)), "mimeType": "image/png"}]
textured.gltf["samplers"] = [{"wrapS": 33648, "wrapT": 33071}]
textured.gltf["textures"] = [{"source": 0, "sampler": 0}]
textured.gltf["extensionsUsed"] = ["KHR_texture_transform", "KHR_materials_emissive_strength", "KHR_materials_ior"]
textured.gltf["materials"] = [{
    "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": True, "emissiveFactor": [1, 0.5, 0],
    "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {
        "offset": [0.5, 0], "rotation": 1, "scale": [2, 2]}}}, "metallicRoughnessTexture": {"index": 0}},
    "emissiveTexture": {"index": 0},
    "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 5}, "KHR_materials_ior": {"ior": 1.4}}}]
textured.gltf["nodes"][0]["extras"] = {"envbake": {"receives": True, "casts": False}}
write("scene", "textured.glb", textured.glb())

deformed = Scene()
p = deformed.positions()
target = deformed.accessor("f", 5126, "VEC3", [0, 0, 1] * 4, min=[0, 0, 1], max=[0, 0, 1])
joints = deformed.accessor("B", 5121, "VEC4", [0, 1, 0, 0] * 4)
weights = deformed.accessor("f", 5126, "VEC4", [0.5, 0.5, 0, 0] * 4)
deformed.primitive({"POSITION": p, "JOINTS_0": joints, "WEIGHTS_0": weights},
                   deformed.accessor("H", 5123, "SCALAR", [0, 1, 2, 2, 1, 3]), targets=[{"POSITION": target}])
deformed.gltf["meshes"][0]["weights"] = [0.25]
unit = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
deformed.gltf["skins"] = [{"joints": [1, 2], "inverseBindMatrices": deformed.accessor("f", 5126, "MAT4", unit * 2)}]
deformed.gltf["nodes"] = [{"mesh": 0, "skin": 0}, {"translation": [0, 0, 1], "children": [2]}, {"matrix": unit}]
deformed.gltf["scenes"][0]["nodes"] = [0, 1]
write("scene", "deformed.glb", deformed.glb())

sparse = Scene()
p = sparse.positions()
sparse.gltf["accessors"][p]["sparse"] = {
    "count": 1, "indices": {"bufferView": sparse.view(struct.pack("<H", 3)), "componentType": 5123},
    "values": {"bufferView": sparse.view(struct.pack("<fff", 1, 1, 0.5))}}
quantised = sparse.accessor("b", 5120, "VEC3", [0, 0, 127, 0] * 3, normalized=True)
sparse.gltf["bufferViews"][-1]["byteStride"] = 4
sparse.gltf["accessors"][quantised]["count"] = 3
sparse.gltf["accessors"][quantised]["type"] = "VEC3"
sparse.gltf["extensionsUsed"] = sparse.gltf["extensionsRequired"] = ["KHR_mesh_quantization"]
sparse.primitive({"POSITION": p})
write("scene", "sparse.glb", sparse.glb())


# Meshes that are compressed: positions, normals, places in the texture and joints, as make_meshes has them.
def glb_of(draco):
    stream = draco.read_bytes()
    vertices, _, indices = struct.unpack("<IIQ", draco.with_suffix(".worker").read_bytes()[1:17])
    scene = Scene()

    def accessor(component, kind, count):
        scene.gltf["accessors"].append({"componentType": component, "type": kind, "count": count})
        return len(scene.gltf["accessors"]) - 1

    attributes = {"POSITION": accessor(5126, "VEC3", vertices), "NORMAL": accessor(5126, "VEC3", vertices),
                  "TEXCOORD_0": accessor(5126, "VEC2", vertices), "JOINTS_0": accessor(5121, "VEC4", vertices)}
    weights = scene.accessor("f", 5126, "VEC4", [1, 0, 0, 0] * vertices)
    scene.primitive({**attributes, "WEIGHTS_0": weights}, accessor(5125, "SCALAR", indices),
                    extensions={"KHR_draco_mesh_compression": {
                        "bufferView": scene.view(stream), "attributes": {name: i for i, name in enumerate(attributes)}}})
    scene.gltf["extensionsUsed"] = scene.gltf["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    return scene.glb()


for file in sorted((folder / "compression").glob("*.draco")):
    write("scene", file.stem + "_draco.glb", glb_of(file))


def meshopt_view(scene, name):
    data = (folder / "compression" / name).read_bytes()
    mode, filter_, stride, low, high = data[:5]
    count = low + 256 * high
    view = scene.view(data[5:])
    compressed = scene.gltf["bufferViews"][view]
    scene.gltf["bufferViews"][view] = {"buffer": 1, "byteLength": count * stride, "extensions": {"EXT_meshopt_compression": {
        **compressed, "byteStride": stride, "count": count, "mode": ["ATTRIBUTES", "TRIANGLES", "INDICES"][mode],
        "filter": ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"][filter_]}}}
    return view, count


for positions, indices, component in (("positions", "triangles1", 5123), ("exponential", "indices1", 5125)):
    packed = Scene()
    accessors = []
    for name, form in ((positions, (5126, "VEC3")), ("octahedral", (5120, "VEC4")), (indices, (component, "SCALAR"))):
        view, count = meshopt_view(packed, name + ".meshopt")
        packed.gltf["accessors"].append({"bufferView": view, "componentType": form[0], "type": form[1], "count": count})
        accessors.append(len(packed.gltf["accessors"]) - 1)
    packed.gltf["accessors"][accessors[1]].update(type="VEC3", normalized=True)
    packed.gltf["bufferViews"][1]["byteStride"] = 4
    packed.primitive({"POSITION": accessors[0], "NORMAL": accessors[1]}, accessors[2])
    packed.gltf["extensionsUsed"] = packed.gltf["extensionsRequired"] = ["EXT_meshopt_compression", "KHR_mesh_quantization"]
    packed.fallbacks = [{"byteLength": 1 << 16, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}]
    write("scene", positions + "_meshopt.glb", packed.glb())
