#!/usr/bin/env python3
"""Writes cone.npy: a cone of radius 0.2 and height 0.3 in the middle of a flat square, 65 x 65 heights."""
import math
import struct

N = 65
rows = [[0.3 * max(0.0, 1.0 - math.hypot(i / (N - 1) - 0.5, j / (N - 1) - 0.5) / 0.2) for i in range(N)] for j in range(N)]
head = "{'descr': '<f4', 'fortran_order': False, 'shape': (%d, %d), }" % (N, N)
head += " " * (63 - (10 + len(head)) % 64) + "\n"
with open("cone.npy", "wb") as f:
    f.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode())
    for row in rows:
        f.write(struct.pack("<%df" % N, *row))
