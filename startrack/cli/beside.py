"""At the first run, another process compiles the identification while this one does the rest."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from startrack.core import COMPILED_BESIDE, UNKEPT
from startrack.identification import is_ready

PART = "identification"  # of `startrack warm`
ROOMS = ("startrack.identification", "startrack.attitude")  # about half of what a trial compiles


@contextmanager
def compiled_beside() -> Iterator[None]:
    """Compile on a second core what this process needs last; it waits when it needs it.

    Nothing is done where it has been compiled before, cannot be kept, or there is one core.
    """
    if (os.cpu_count() or 1) < 2 or UNKEPT or is_ready():
        yield
        return
    process = subprocess.Popen(
        [sys.executable, "-m", "startrack.cli", "warm", "--part", PART],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    COMPILED_BESIDE.update(dict.fromkeys(ROOMS, process.wait))
    try:
        yield
    finally:
        for room in ROOMS:
            COMPILED_BESIDE.pop(room, None)
        process.terminate()
        process.wait()
