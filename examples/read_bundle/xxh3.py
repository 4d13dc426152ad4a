# SPDX-License-Identifier: Apache-2.0
"""XXH3-64 with seed 0, the checksum of bundles, by the specification of xxHash 0.8."""
import numpy as np

SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221"
    "b8084674f743248ee03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb"
    "170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e")
P32 = 0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D
P64 = (0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5)
U64 = (1 << 64) - 1


def xxh3(data):
    """The checksum of an array of bytes."""
    data = np.ascontiguousarray(data)
    n, d = data.size, data[:240].tobytes() if data.size <= 240 else b""
    u = lambda b, at, size=8: int.from_bytes(b[at:at + size], "little")
    secret = lambda at: u(SECRET, at)
    fold = lambda a, b: (a * b & U64) ^ (a * b >> 64)
    mix = lambda at, key: fold(u(d, at) ^ secret(key), u(d, at + 8) ^ secret(key + 8))
    rotate = lambda h, r: (h << r | h >> (64 - r)) & U64
    def stir(h, first, one, second, two, third):
        h = (h ^ h >> first) * one & U64
        h = (h ^ h >> second) * two & U64
        return h ^ h >> third
    avalanche = lambda h: stir(h & U64, 37, 0x165667919E3779F9, 32, 1, 64)
    if n <= 3:
        keyed = secret(56) ^ secret(64) if n == 0 else \
            (d[0] << 16 | d[n >> 1] << 24 | d[-1] | n << 8) ^ u(SECRET, 0, 4) ^ u(SECRET, 4, 4)
        return stir(keyed, 33, P64[1], 29, P64[2], 32)
    if n <= 8:
        h = (u(d, n - 4, 4) + (u(d, 0, 4) << 32)) ^ secret(8) ^ secret(16)
        h = (h ^ rotate(h, 49) ^ rotate(h, 24)) * 0x9FB21C651E98DF25 & U64
        h = (h ^ (h >> 35) + n) * 0x9FB21C651E98DF25 & U64
        return h ^ h >> 28
    if n <= 16:
        low, high = u(d, 0) ^ secret(24) ^ secret(32), u(d, n - 8) ^ secret(40) ^ secret(48)
        return avalanche(n + int.from_bytes(low.to_bytes(8, "little"), "big") + high + fold(low, high))
    if n <= 128:
        return avalanche(n * P64[0] + sum(mix(16 * i, 32 * i) + mix(n - 16 * (i + 1), 32 * i + 16)
                                          for i in range((n - 1) // 32 + 1)))
    if n <= 240:
        h = avalanche(n * P64[0] + sum(mix(16 * i, 16 * i) for i in range(8)))
        return avalanche(h + sum(mix(16 * i, 16 * i - 125) for i in range(8, n // 16)) + mix(n - 16, 119))
    keys = np.stack([np.frombuffer(SECRET, "<u8", 8, 8 * i) for i in range(17)])
    acc = np.array([P32[2], *P64[:4], P32[1], P64[4], P32[0]], np.uint64)
    def accumulate(acc, stripes, keys):
        keyed = stripes ^ keys
        return acc + stripes.reshape(-1, 4, 2)[:, :, ::-1].reshape(-1, 8).sum(0, dtype=np.uint64) \
            + ((keyed & np.uint64(0xFFFFFFFF)) * (keyed >> np.uint64(32))).sum(0, dtype=np.uint64)
    whole = (n - 1) // 64
    stripes = data[:64 * whole].view("<u8").reshape(-1, 8)
    for first in range(0, whole, 16):
        block = stripes[first:first + 16]
        acc = accumulate(acc, block, keys[:len(block)])
        if first + 16 <= (n - 1) // 1024 * 16:
            acc = (acc ^ acc >> np.uint64(47) ^ keys[16]) * np.uint64(P32[0])
    last = np.frombuffer(data[n - 64:].tobytes(), "<u8")[None]
    acc = accumulate(acc, last, np.frombuffer(SECRET, "<u8", 8, 121)).tolist()
    return avalanche(n * P64[0] + sum(fold(acc[2 * i] ^ secret(11 + 16 * i), acc[2 * i + 1] ^ secret(19 + 16 * i))
                                      for i in range(4)))
