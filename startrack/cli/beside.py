"""At the first run, another process compiles while this one works."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from startrack.core import FOLDERS, UNKEPT, interpreted
from startrack.identification import is_ready

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

TRIAL, IDENTIFICATION = "fidelity frame", "identification"  # parts of `startrack warm`
# Commands of one trial, and what is compiled for the next command. The index of the patterns comes
# first, which is the one thing that takes Python longer than compiling and running.
ONE_TRIAL = {
    "simulate": (IDENTIFICATION, TRIAL),
    "solve": (IDENTIFICATION, TRIAL),
    "detect": (TRIAL,),
}
# What other commands need last comes first; of `warm` itself the second half of its parts.
OTHERS = (IDENTIFICATION, "fidelity window")
HALF_OF_WARM = (IDENTIFICATION, "sequence", "fidelity covariance", "analytic budget", "one PSF")
LOCK = "compiling.lock"  # held by the process that compiles, as long as it runs


@contextmanager
def compiled_beside(command: str) -> Iterator[None]:
    """Compile on a second core what this process needs.

    A command of one trial runs kernels as Python code meanwhile, and the other process goes on
    after its end, so that the next command finds all compiled. Other commands need compiled code;
    each kernel is compiled by the process that comes to it first, and the other one waits for it.
    Nothing is started where all has been compiled before, cannot be kept, or there is one core, or
    another command has started it.
    """
    first, lock = bool(UNKEPT) or not is_ready(), Path(min(FOLDERS, default="")) / LOCK
    useful = (os.cpu_count() or 1) > 1 and first and not UNKEPT
    if command in ONE_TRIAL and first:
        process = _start(ONE_TRIAL[command], lock) if useful else None
        with interpreted(_working(process, lock) if useful else lambda: False):
            yield
        return
    if not useful:
        yield
        return
    process = _start(HALF_OF_WARM if command == "warm" else OTHERS, lock)
    try:
        yield
    finally:
        if process:
            process.terminate()
            process.wait()


def _start(parts: Sequence[str], lock: Path) -> subprocess.Popen[bytes] | None:
    """A process that compiles, in a session of its own; None where another one does already."""
    command = [sys.executable, "-m", "startrack.cli", "warm"]
    command += [word for part in parts for word in ("--part", part)]
    held = _held(lock)
    if held is None:
        return None
    try:  # the lock is inherited, and ends with the process
        return subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True, pass_fds=held,
        )  # fmt: skip
    finally:
        for one in held:
            os.close(one)


def _working(process: subprocess.Popen[bytes] | None, lock: Path) -> Callable[[], bool]:
    """Whether a process still compiles: this one, or that of another command."""
    if process is not None:
        return lambda: process.poll() is None

    def elsewhere() -> bool:
        held = _held(lock)
        for one in held or ():
            os.close(one)
        return held is None

    return elsewhere


def _held(lock: Path) -> tuple[int, ...] | None:
    """The open file of the lock, none without locks; None where another process holds it."""
    if fcntl is None:
        return ()
    with suppress(OSError):
        file = os.open(lock, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(file)
            return None
        return (file,)
    return ()
