#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads envbake bundles with numpy alone. Written from docs/format.md, not from the C++ reader.

    import envb
    bundle = envb.Bundle("scene.envb")
    bundle["environment/sh"]                   an array; uncompressed ones lie in the file's mapping
    envb.irradiance(bundle["environment/sh"], normals)

    envb.py FILE...                            checks files and lists what is in them
"""
import json
import sys

import numpy as np

from xxh3 import xxh3

TYPES = [np.dtype(t) for t in ("<f4", "<f2", "u1", "<u2", "<u4", "i1", "<i2")]
ENTRY = np.dtype([("name_at", "<u4"), ("name_size", "<u2"), ("type", "u1"), ("codec", "u1"),
                  ("rank", "u1"), ("reserved", "u1", 7), ("shape", "<u8", 6), ("offset", "<u8"),
                  ("stored", "<u8"), ("size", "<u8"), ("checksum", "<u8")])
NAME_CHARACTERS = set("abcdefghijklmnopqrstuvwxyz0123456789_-.")


class BundleError(Exception):
    """The file is no bundle, or a damaged one."""


def require(holds, what):
    if not holds:
        raise BundleError(what)


class Bundle:
    """Named arrays; `entries` is what the table says of each."""

    def __init__(self, path):
        data = np.fromfile(path, "u1", 64)
        require(data.size == 64, "shorter than a header")
        self.data = data = np.memmap(path, "u1", "r")
        header = data[:64].tobytes()
        number = lambda at, size: int.from_bytes(header[at:at + size], "little")
        require(header[:8] == b"\x89ENVB\r\n\x1a", "not a bundle")
        require(number(8, 2) == 1, f"major version {number(8, 2)}")
        require(xxh3(data[:56]) == number(56, 8), "the header is damaged")
        require(number(48, 8) == 0, "reserved bytes of the header are set")
        count, table_at, table_size = number(12, 4), number(24, 8), number(32, 8)
        require(number(16, 8) == data.size, f"{data.size} bytes, not the {number(16, 8)} it should have")
        require(table_at % 64 == 0 and table_at >= 64 and table_at + table_size == data.size
                and table_size >= 96 * count, "the table lies outside of the file")
        table = data[table_at:]
        require(xxh3(table) == number(40, 8), "the table is damaged")
        self.entries = {}
        before = b""
        for entry in table[:96 * count].view(ENTRY):
            entry = {k: entry[k].tolist() for k in ENTRY.names}
            begin, end = entry["name_at"], entry["name_at"] + entry["name_size"]
            require(96 * count <= begin < end <= table_size and end - begin <= 255, "a name outside of the table")
            raw = table[begin:end].tobytes()
            name = raw.decode("latin-1")
            require(all(part and set(part) <= NAME_CHARACTERS for part in name.split("/")), "a name that is none")
            require(before < raw, f"{name}: names out of order")
            before = raw
            self._check(name, entry, table_at)
            self.entries[name] = entry
        decoded = sum(entry["size"] for entry in self.entries.values() if entry["codec"])
        require(decoded <= max(1 << 23, 16 * data.size), "decodes to more than a file of its size may")

    @staticmethod
    def _check(name, entry, table_at):
        require(not any(entry["reserved"]), f"{name}: reserved bytes are set")
        require(entry["type"] < len(TYPES), f"{name}: an element type of a newer version")
        require(entry["codec"] <= 1, f"{name}: a codec of a newer version")
        require(1 <= entry["rank"] <= 6, f"{name}: rank {entry['rank']}")
        shape = entry["shape"][:entry["rank"]]
        require(not any(entry["shape"][entry["rank"]:]), f"{name}: a shape beyond its rank")
        size = TYPES[entry["type"]].itemsize
        for extent in shape:
            size *= extent
            require(size < 1 << 64 or 0 in shape, f"{name}: larger than any file")
        require(entry["size"] == size, f"{name}: {entry['size']} bytes for a shape of {size}")
        require(entry["codec"] or entry["stored"] == size, f"{name}: stored size differs")
        require(entry["offset"] % 64 == 0 and entry["offset"] >= 64
                and entry["offset"] + entry["stored"] <= table_at, f"{name}: outside of the file")

    def __getitem__(self, name):
        """Checks the array's checksum, too."""
        entry = self.entries[name]
        stored = self.data[entry["offset"]:entry["offset"] + entry["stored"]]
        require(xxh3(stored) == entry["checksum"], f"{name}: damaged")
        if entry["codec"]:
            try:
                import zstandard
            except ImportError:
                raise BundleError(f"{name}: compressed; install the module zstandard, or bake without --compress")
            stored = np.frombuffer(zstandard.ZstdDecompressor().decompress(stored.tobytes(), entry["size"]), "u1")
            require(stored.size == entry["size"], f"{name}: decodes to another size")
        return stored.view(TYPES[entry["type"]]).reshape(entry["shape"][:entry["rank"]])

    def transport(self, mesh, rows=slice(None)):
        """T of vertices of a mesh, [k, bands^2] or [k, bands^2, 3], decoded from whatever it is stored as."""
        name = f"mesh/{mesh}/diffuse"
        if name + "_weights" in self.entries:
            basis = self["mesh/diffuse_basis"][self[name + "_cluster"][rows]].astype("f4")
            return basis[:, 0] + np.einsum("vk,vk...->v...", self[name + "_weights"][rows], basis[:, 1:])
        T = self[name][rows]
        low, step = np.moveaxis(self[name + "_range"], -1, 0) if T.dtype.kind == "u" else (0, 1)
        return np.float32(low + step * np.float64(T))

    def __iter__(self):
        return iter(self.entries)

    def metadata(self):
        return json.loads(self["metadata"].tobytes())


def sh_basis(bands, w):
    """Y_i of unit directions w [k, 3] as [k, bands^2]: real, orthonormal, no Condon-Shortley phase,
    polar axis +Z. By the recurrences of the associated Legendre functions, over sin^m theta."""
    x, y, z = np.moveaxis(np.asarray(w, np.float64), -1, 0)
    Y = np.empty((x.size, bands * bands))
    turn, sector = np.ones_like(x) + 0j, np.ones_like(x)  # (x + iy)^m; P_mm
    for m in range(bands):
        below, P, factor = np.zeros_like(z), sector, (2 * m + 1) / (4 * np.pi)
        for l in range(m, bands):
            N = np.sqrt((2 * l + 1) / (4 * np.pi) * np.prod([1.0 / k for k in range(l - m + 1, l + m + 1)]))
            N *= np.sqrt(2) if m else 1
            Y[:, l * l + l + m] = N * P * turn.real
            if m:
                Y[:, l * l + l - m] = N * P * turn.imag
            below, P = P, ((2 * l + 1) * z * P - (l + m) * below) / (l + 1 - m)
        turn, sector = turn * (x + 1j * y), sector * (2 * m + 1)
    return Y


def clamped_cosine(bands):
    """A_l of the irradiance, repeated over m: pi, 2 pi / 3, pi / 4, 0, -pi / 24 ..."""
    A = [np.pi, 2 * np.pi / 3]
    for l in range(2, bands):
        A.append(0.0 if l % 2 else (np.pi / 4 if l == 2 else -A[l - 2] * (l - 3) / (l + 2)))
    return np.repeat(A[:bands], [2 * l + 1 for l in range(bands)])


def irradiance(sh, normals):
    """E(n) of environment/sh [bands^2, c] at normals [k, 3]: [k, c]."""
    bands = round(np.sqrt(len(sh)))
    return sh_basis(bands, normals) * clamped_cosine(bands) @ np.asarray(sh, np.float64)


def diffuse_exit(transport, sh):
    """Exit radiance of albedo 1 of vertices with transport [k, bands^2] or [k, bands^2, 3]: [k, c]."""
    n = min(transport.shape[1], len(sh))
    T, L = np.asarray(transport[:, :n], np.float64), np.asarray(sh[:n], np.float64)
    return T @ L if T.ndim == 2 else np.einsum("kic,ic->kc", T, np.broadcast_to(L, (n, 3)))


def self_test(bundle):
    """How many answers of the bundle's self-test on SH were compared; raises where one is off."""
    tolerance, compared = bundle.metadata().get("self_test", {}).get("tolerance"), 0
    def compare(what, value, answer):
        off = np.abs(value - answer) - tolerance * (np.abs(answer) + 1e-3 * np.abs(answer).max())
        require(off.max() <= 0, f"self-test: {what}")
        return len(answer)
    if "selftest/irradiance/value" in bundle:
        compared += compare("irradiance", irradiance(bundle["environment/sh"], bundle["selftest/irradiance/normal"]),
                            bundle["selftest/irradiance/value"])
    if "selftest/diffuse/value" in bundle:
        answers = []
        for mesh, v in bundle["selftest/diffuse/vertex"].tolist():
            answers.append(diffuse_exit(bundle.transport(mesh, [v]), bundle["environment/sh"])[0] * [1, 1, 1])
            if f"mesh/{mesh}/emitted" in bundle.entries:
                answers[-1] += bundle[f"mesh/{mesh}/emitted"][v]
        compared += compare("diffuse", np.array(answers), bundle["selftest/diffuse/value"])
    return compared


def main(paths):
    status = 0
    for path in paths:
        try:
            bundle = Bundle(path)
            arrays = {name: bundle[name] for name in bundle}
            lines = [f"  {name:32} {array.dtype.name:8} {' x '.join(map(str, array.shape))}"
                     for name, array in arrays.items()]
            print(f"{path}: {len(lines)} arrays, self-test: {self_test(bundle)} answers agree", *lines, sep="\n")
        except (BundleError, OSError) as error:
            print(f"{path}: {error}", file=sys.stderr)
            status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
