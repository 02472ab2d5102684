"""Path of a cache -> whether this process may read from it what it then computes with."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

PRIVATE = 0o700


def trusted(path: str | os.PathLike[str]) -> bool:
    """Whether a file or folder is of this user or of the system, and no other can write to it.

    An installation by the administrator is the system's: whoever runs it trusts its code already.
    """
    if not hasattr(os, "geteuid"):  # Windows: the user's folders are closed to others
        return True
    try:
        found = os.stat(path)
    except OSError:
        return False
    return found.st_uid in (os.geteuid(), 0) and not found.st_mode & stat.S_IWOTH


def private_folder(path: Path) -> bool:
    """Make a folder that only this user can open; whether there is such a one then."""
    with suppress(OSError):
        path.mkdir(parents=True, exist_ok=True, mode=PRIVATE)
    return trusted(path)
