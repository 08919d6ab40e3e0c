#!/usr/bin/env python3
"""How long after a keystroke `saltus lsp` has its diagnostics: every shipped source is opened, and at places of it that a seed
chooses a letter is typed and taken away again. Each edit waits for the diagnostics of its version; hover and completion are
measured at the same places.

    SALTUS_BIN=build/bin/saltus tests/bench/lsp.py [PLACES]
"""
import os
import random
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "lsp"))
from client import ROOT, SOURCES, Server, position  # noqa: E402


def part(values, share):
    return 1e3 * sorted(values)[min(len(values) - 1, int(share * len(values)))]


def main():
    places = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    rng = random.Random(1)
    s = Server()
    keys, asked, slowest = [], {"hover": [], "completion": []}, (0, "")
    for path in SOURCES:
        text = Path(path).read_text()
        uri = s.open(path, text)
        s.diagnostics(uri)
        own = []
        for _ in range(places):
            at = rng.randrange(len(text))
            here, behind = position(text, at), position(text, at)
            behind["character"] += 1
            for edit in ({"range": {"start": here, "end": here}, "text": "x"}, {"range": {"start": here, "end": behind}, "text": ""}):
                start = time.perf_counter()
                s.change(uri, edit)
                s.diagnostics(uri)
                own.append(time.perf_counter() - start)
            for what in asked:
                start = time.perf_counter()
                s.at(what, uri, text, at)
                asked[what].append(time.perf_counter() - start)
        slowest = max(slowest, (part(own, 0.5), str(Path(path).relative_to(ROOT))))
        keys += own
        s.tell("textDocument/didClose", {"textDocument": {"uri": uri}})
    s.shutdown()
    print(f"{'':12}{'p50 ms':>8}{'p95 ms':>8}{'max ms':>8}{'n':>8}")
    for name, values in [("keystroke", keys), *asked.items()]:
        print(f"{name:12}{part(values, 0.5):8.1f}{part(values, 0.95):8.1f}{1e3 * max(values):8.1f}{len(values):8}")
    print(f"slowest file (median): {slowest[1]}, {slowest[0]:.1f} ms")


if __name__ == "__main__":
    main()
