#!/usr/bin/env python3
"""Writes terrain.png: 129 x 129 heights of 16 bits, an island of ridges, flat at its border. Integer hashes and sums only: the same everywhere."""
import math
import struct
import zlib

N = 129


def lattice(i, j, octave):
    h = (i * 0x9E3779B1 ^ j * 0x85EBCA77 ^ octave * 0xC2B2AE3D) & 0xFFFFFFFF
    h = ((h ^ h >> 15) * 0x2C1B3C6D) & 0xFFFFFFFF
    h = ((h ^ h >> 12) * 0x297A2D39) & 0xFFFFFFFF
    return (h ^ h >> 15) / 2**31 - 1.0


def noise(x, y, octave):
    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    u, v = u * u * u * (u * (6 * u - 15) + 10), v * v * v * (v * (6 * v - 15) + 10)
    a = lattice(i, j, octave) * (1 - u) + lattice(i + 1, j, octave) * u
    b = lattice(i, j + 1, octave) * (1 - u) + lattice(i + 1, j + 1, octave) * u
    return a * (1 - v) + b * v


def height(x, y):
    total, weight, gain, scale = 0.0, 1.0, 0.5, 3.0
    for octave in range(6):
        ridge = (1.0 - abs(noise(x * scale + 5.2 * octave, y * scale + 1.3 * octave, octave))) ** 2
        total += gain * weight * ridge
        weight = min(1.0, 1.6 * ridge)
        gain *= 0.5
        scale *= 2.03
    edge = max(0.0, 1.0 - (2.1 * math.hypot(x - 0.5, y - 0.5)) ** 4)
    return edge * max(0.0, total - 0.12)


rows = [[height(i / (N - 1), j / (N - 1)) for i in range(N)] for j in range(N)]
top = max(map(max, rows))
data = b"".join(b"\0" + struct.pack(">%dH" % N, *(round(65535 * v / top) for v in row)) for row in rows)


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


with open("terrain.png", "wb") as f:
    f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", N, N, 16, 0, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(data, 9)) + chunk(b"IEND", b""))
