"""Kernels that numba compiles enter; a word to the person who waits for them leaves."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from numba.core import event

PATIENCE = 2.0  # second
WORD = "startrack: compiling for this machine, once after an installation, in a minute or two"


@contextmanager
def told_of_compiling() -> Iterator[None]:
    """Say once what takes so long, where kernels are not in numba's cache yet."""
    if not sys.stderr.isatty():
        yield
        return
    with event.install_listener("numba:compile", _Word()):
        yield


class _Word(event.Listener):
    """Kernels are compiled inside the compilation of those that call them, so that all count."""

    def __init__(self) -> None:
        self.spent, self.begun, self.depth, self.said = 0.0, 0.0, 0, False

    def on_start(self, event: event.Event) -> None:
        self.begun = self.begun if self.depth else time.perf_counter()
        self.depth += 1

    def on_end(self, event: event.Event) -> None:
        self.depth -= 1
        lasted = time.perf_counter() - self.begun
        if not self.said and self.spent + lasted > PATIENCE:
            self.said = True
            print(WORD, file=sys.stderr, flush=True)
        self.spent += 0.0 if self.depth else lasted
