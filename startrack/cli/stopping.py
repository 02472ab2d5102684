"""A signal or an error -> what ends a command, and the words that tell it."""

from __future__ import annotations

import os
import signal
import threading
import traceback
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from startrack.cli.options import Exit, WrongUse

PACKAGE = Path(__file__).parents[1]
LONGEST = 600  # characters of a message


class Stopped(KeyboardInterrupt):
    """The process was asked to end; no code that goes on after an Exception goes on after it."""

    def __init__(self, number: int):
        self.signal = number
        super().__init__(signal.Signals(number).name)


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end a command as Ctrl-C does: files are closed, workers ended."""

    def stop(number: int, _: Any) -> None:
        raise Stopped(number)

    kinds = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {kind: signal.getsignal(kind) for kind in kinds}
    for kind, held in before.items():
        if held != signal.SIG_IGN:  # as nohup asks
            signal.signal(kind, stop)
    try:
        yield
    finally:
        for kind, held in before.items():
            signal.signal(kind, held or signal.SIG_DFL)


def ignore_signals() -> None:
    """Let no signal end the process from here on: its command is done, and Python tidies up."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


def told(error: BaseException) -> tuple[int, str]:
    """The exit status and the sentence of what a command raised."""
    match error:
        case Stopped():
            return 128 + error.signal, f"stopped by {error}; the files on disk are complete"
        case KeyboardInterrupt():
            return Exit.INTERRUPTED, "stopped; the files on disk are complete"
        case WrongUse():
            return Exit.WRONG_USE, one_line(error)
        case BrokenPipeError():
            # What reads the output has ended, such as `head`: no one would read a message.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            return Exit.FAILED, ""
        case OSError(filename=str() | bytes() as name):
            return Exit.FAILED, f"{os.fsdecode(name)}: {error.strerror}"
        case BrokenExecutor():
            return Exit.FAILED, "a worker process died; the files on disk are complete"
        case ValueError() | ImportError() | OSError():
            return Exit.FAILED, one_line(error)
        case MemoryError():
            from startrack.core import gib, memory_limit

            return Exit.FAILED, (
                f"more memory is needed than the limit of {gib(memory_limit())} (option --memory): "
                f"{one_line(error) or 'no more could be had'}"
            )
    return Exit.FAILED, (
        f"{place_of(error)}: unexpected {type(error).__name__}: {one_line(error)} (--debug prints "
        "where)"
    )


def one_line(error: object) -> str:
    """What an error or a warning says, on one line of printable characters."""
    # A KeyError shows its key alone.
    text = f"no {error}" if isinstance(error, KeyError) else str(error)
    words = " ".join(text.split())
    clean = "".join(each if each.isprintable() else "?" for each in words)
    return clean if len(clean) <= LONGEST else f"{clean[: LONGEST - 3]}..."


def place_of(error: BaseException) -> str:
    """File and line of the package that an error comes from."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename).is_relative_to(PACKAGE)
    ]
    if not frames:
        return "startrack"
    where = Path(frames[-1].filename).relative_to(PACKAGE)
    return f"{where}, line {frames[-1].lineno}"
