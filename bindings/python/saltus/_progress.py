"""How far a fit is, where somebody looks: a line on a terminal, or below the cell of a notebook."""
from __future__ import annotations

import sys
import time


def _notebook():
    """IPython's display functions in a notebook's kernel, else None."""
    try:
        shell = sys.modules["IPython"].get_ipython()
        if type(shell).__name__ == "ZMQInteractiveShell":
            return sys.modules["IPython"].display
    except (KeyError, AttributeError):
        pass
    return None


class Bar:
    """Iteration, loss and time left, a few times a second."""
    EVERY = 0.2

    def __init__(self, total: int, wanted: bool | None):
        self.total, self.next = total, 0.0
        self.first: tuple[int, float] | None = None
        self.handle = None
        self.display = _notebook() if wanted is not False else None
        self.shown = wanted or (wanted is None and (self.display is not None or sys.stderr.isatty()))

    def step(self, iteration: int, loss: float, best: float):
        now = time.monotonic()
        if self.first is None:
            self.first = iteration, now
        if not self.shown or (now < self.next and iteration < self.total):
            return
        self.next = now + self.EVERY
        done, spent = iteration - self.first[0], now - self.first[1]
        left = f", {spent / done * (self.total - iteration):.0f} s left" if done and iteration < self.total else ""
        filled = 24 * min(iteration, self.total) // max(self.total, 1)
        self.write(f"[{'#' * filled}{'.' * (24 - filled)}] {iteration}/{self.total}  loss {loss:.4g}, best {best:.4g}{left}")

    def write(self, line):
        if self.display is None:
            sys.stderr.write("\r" + line.ljust(79))
            sys.stderr.flush()
        elif self.handle is None:
            self.handle = self.display.display({"text/plain": line}, raw=True, display_id=True)
        else:
            self.handle.update({"text/plain": line}, raw=True)

    def end(self):
        if self.shown and self.display is None and self.next:
            sys.stderr.write("\n")
