"""Imports of a command's file -> done when the command runs, so that its help needs none of them.

A file names what it computes with under `if wanted(__name__):`, which is true in any process but
one that still reads its own command line. Such a process runs the file once more before it calls
the command, as `lazy from module import name` of Python 3.15 (PEP 810) will do.
"""

from __future__ import annotations

import gc
import sys
from importlib import reload

_POSTPONING = False  # only while a process reads its own command line
_WAITING = list[str]()  # modules that have not imported all


def wanted(module: str) -> bool:
    """Whether a module is to import all now; else `load` runs it once more."""
    if _POSTPONING:
        _WAITING.append(module)
    return not _POSTPONING


def postpone() -> None:
    """Let imports wait from now on."""
    global _POSTPONING
    _POSTPONING = True


def load() -> None:
    """Import all that waits."""
    global _POSTPONING
    _POSTPONING = False
    if not _WAITING:
        return
    gc.disable()  # nothing that is imported is garbage
    while _WAITING:
        reload(sys.modules[_WAITING.pop(0)])
    gc.freeze()
    gc.enable()
