"""At the first run, a second process compiles kernels while the command works."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from startrack.core import interpreted, is_ready, kernel_folder

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

# Commands of one trial, which run without compilation; other commands compile the kernels they
# need.
ONE_TRIAL = ("simulate", "solve", "detect")
IDENTIFICATION, TRIAL = "identification", "fidelity frame"  # parts of `startrack tools warm`
LOCK = "compiling.lock"  # locked by the compiling process while it runs
# Processes that continue after their command: Python warns of one that is forgotten before its end.
CONTINUING = list[subprocess.Popen[bytes]]()


@contextmanager
def compiled_beside(command: str) -> Iterator[None]:
    """Compile the kernels of this process and of the next command on a second core.

    Meanwhile a command of one trial runs kernels as Python code. The second process continues after
    the command's end. It is not started if all kernels are compiled, if they cannot be cached, on a
    single core, or if another command has started one.
    """
    folder = kernel_folder()
    if is_ready():
        yield
        return
    process, alone = None, command in ONE_TRIAL
    if folder is not None and (os.cpu_count() or 1) > 1:
        lock = folder / LOCK
        parts = (IDENTIFICATION, TRIAL) if alone else (IDENTIFICATION,)
        process = start(parts, lock)
    try:
        if alone:
            with interpreted(lambda: folder is not None and _held(folder / LOCK) is None):
                yield
        else:
            yield
    finally:
        if process and alone:
            CONTINUING.append(process)
        elif process:
            process.terminate()
            process.wait()


def start(parts: tuple[str, ...], lock: Path) -> subprocess.Popen[bytes] | None:
    """Start the compiling process in a separate session; None if another process already
    compiles."""
    command = [sys.executable, "-m", "startrack.cli", "warm"]
    command += [word for part in parts for word in ("--part", part)]
    file = _held(lock, close=False)
    if file is None:
        return None
    try:  # the process inherits the lock and releases it at its end
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            pass_fds=file,
        )
    finally:
        for number in file:
            os.close(number)


def _held(lock: Path, close: bool = True) -> tuple[int, ...] | None:
    """The open file of the lock; None if another process holds it."""
    if fcntl is None:
        return ()
    with suppress(OSError):
        file = os.open(lock, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(file)
            return None
        if not close:
            return (file,)
        os.close(file)
    return ()
