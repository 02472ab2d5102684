"""A folder or a file -> claimed for this process; others are told which one has it."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from startrack.io.saving import DRAFT

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

NAME = ".startrack-process"  # in a folder that is written to
LONGEST = 1000  # byte of a note


def note_owner(path: Path) -> None:
    """Write beside a file that this process has it; nothing where that cannot be written."""
    with suppress(OSError):
        _note(path).write_text(_words(), encoding="utf-8")


def forget_owner(path: Path) -> None:
    """Remove that note."""
    with suppress(OSError):
        _note(path).unlink()


def owner(path: Path) -> str:
    """Who has a file, as its note says: ", 1234 since 2026-..."; empty where there is none."""
    return _read(_note(path))


def _note(path: Path) -> Path:
    return path.with_name(f"{path.name}-process")


def _words() -> str:
    since = datetime.now(UTC).isoformat(timespec="seconds")
    return json.dumps({"process": os.getpid(), "host": socket.gethostname(), "since": since})


def _read(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            held = json.loads(file.read(LONGEST))
        return f", {int(held['process'])} on {held['host']!s:.60} since {held['since']!s:.40}"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


@contextmanager
def claimed_folder(folder: Path) -> Iterator[None]:
    """Let no other process of startrack write to a folder at the same time.

    The lock is the system's, so that it ends with the process however that ends. Drafts of files
    that an ended process left in the folder are removed.

    Raises  OSError with the other process and since when it has the folder.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NAME
    if fcntl is None:
        yield
        return
    while True:
        with open(path, "a+b") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise OSError(f"{folder} is in use by another process{_read(path)}") from None
            if not _named(path, file.fileno()):
                continue  # the process before removed it between the two calls
            file.truncate(0)
            file.write(_words().encode())
            file.flush()
            for draft in folder.glob(f".*{DRAFT}*"):
                draft.unlink()
            try:
                yield
            finally:
                with suppress(OSError):
                    path.unlink()
                    if made:
                        folder.rmdir()  # where nothing was written
            return


def _named(path: Path, number: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(number))
    except FileNotFoundError:
        return False
