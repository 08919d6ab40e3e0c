"""Curves that a notebook shows: small pictures in SVG, without another package."""
from __future__ import annotations

import html
import math
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ._errors import UsageError
from ._images import write_whole

COLOURS = ("#3465a4", "#cc0000", "#4e9a06", "#c17d11", "#75507b", "#555753")
LEFT, RIGHT, TOP, BELOW, WIDTH, HEIGHT = 58, 20, 10, 22, 480, 200  # the frame, and room for ticks around it; pixels


class Plot:
    """Curves, drawn by `plot`: a notebook shows them, ``save("loss.svg")`` writes them, ``svg`` is their text."""

    def __init__(self, svg: str, names: Iterable[str] = ()):
        self.svg, self._names = svg, [str(name) for name in names]

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self):
        return f"<saltus.Plot of {', '.join(self._names) or 'curves'}>"

    def save(self, path: str | os.PathLike) -> None:
        """Writes an .svg file."""
        write_whole(path, self.svg.encode())


def _ticks(lo, hi, log):
    """Three to seven round numbers between two."""
    if log:
        for factors in (1, 2, 5), (1, 3), (1,):
            found = [f * 10.0 ** k for k in range(math.floor(lo), math.ceil(hi) + 1) for f in factors]
            found = [v for v in found if lo - 1e-9 <= math.log10(v) <= hi + 1e-9]
            if len(found) <= 7:
                break
        found = found[::(len(found) + 6) // 7] if len(found) > 1 else [10 ** v for v in np.linspace(lo, hi, 3)]
        return [(math.log10(v), f"{v:.3g}") for v in found]
    step = 10.0 ** math.floor(math.log10((hi - lo) / 3))
    step *= next(f for f in (5, 2, 1) if (hi - lo) / (f * step) >= 3)
    first = math.ceil(lo / step - 1e-9)
    return [(k * step, f"{k * step:.6g}") for k in range(first, math.floor(hi / step + 1e-9) + 1)]


def plot(curves: Mapping[str, Any], *, log: bool = False, title: str = "") -> Plot:
    """Draws curves by name: of each the ys, which stand at 0, 1, 2, ..., or a pair (xs, ys). log: y is logarithmic; what
    is not finite, or not positive then, is left out, with the line broken.

        saltus.plot({"adam": result.losses, "interior only": other.losses}, log=True)"""
    lines = []
    for name, given in curves.items():
        pair = isinstance(given, tuple) and len(given) == 2
        y = np.asarray(given[1] if pair else given, np.float64)
        x = np.asarray(given[0], np.float64) if pair else np.arange(float(y.size))
        if y.ndim != 1 or x.shape != y.shape:
            raise UsageError(f"{name}: a curve is numbers in a row, or two rows of one length, not {x.shape} and {y.shape}")
        if log:
            y = np.log10(np.where(y > 0, y, np.nan))
        lines.append((name, x, y, np.isfinite(x) & np.isfinite(y)))
    if not any(good.any() for *_, good in lines):
        raise UsageError("there is nothing to draw: no curve has a finite number" + (" above 0" if log else ""))

    def span(of):
        found = np.concatenate([line[of][line[3]] for line in lines])
        lo, hi = float(found.min()), float(found.max())
        return (lo, hi) if hi > lo else (lo - (abs(lo) or 1) / 2, hi + (abs(hi) or 1) / 2)
    (x0, x1), (y0, y1) = span(1), span(2)
    pad = 0.04 * (y1 - y0)
    y0, y1 = y0 - pad, y1 + pad

    def at(x, y):
        return LEFT + (WIDTH - LEFT - RIGHT) * (x - x0) / (x1 - x0), TOP + (HEIGHT - TOP - BELOW) * (y1 - y) / (y1 - y0)
    (left, bottom), (right, top) = at(x0, y0), at(x1, y1)
    below = 16 * len(lines) if len(lines) > 1 or title or "" not in curves else 0
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT + below}" font-family="sans-serif" '
           f'font-size="11">', f'<rect width="{WIDTH}" height="{HEIGHT + below}" fill="white"/>']
    for v, text in _ticks(y0, y1, log):
        y = at(x0, v)[1]
        out.append(f'<path d="M{left:.1f} {y:.1f}H{right:.1f}" stroke="#ddd"/>'
                   f'<text x="{left - 5:.1f}" y="{y + 4:.1f}" text-anchor="end" fill="#555">{text}</text>')
    for v, text in _ticks(x0, x1, False):
        x = at(v, y0)[0]
        out.append(f'<text x="{x:.1f}" y="{bottom + 15:.1f}" text-anchor="middle" fill="#555">{text}</text>')
    out.append(f'<rect x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" height="{bottom - top:.1f}" fill="none" '
               f'stroke="#999"/>')
    for i, (name, x, y, good) in enumerate(lines):
        colour, path, down = COLOURS[i % len(COLOURS)], "", False
        for px, py, ok in zip(x, y, good):
            if ok:
                path += "{}{:.1f} {:.1f}".format("L" if down else "M", *at(px, py))
            down = bool(ok)
        out.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.5" stroke-linejoin="round"/>')
        if below:
            out.append(f'<text x="{left:.1f}" y="{HEIGHT + 10 + 16 * i}" fill="{colour}">{html.escape(str(name))}</text>')
    if title:
        out.append(f'<text x="{right:.1f}" y="{HEIGHT + 10}" text-anchor="end" fill="#555">{html.escape(title)}</text>')
    return Plot("\n".join(out) + "\n</svg>\n", curves)
