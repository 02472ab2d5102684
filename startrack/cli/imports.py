"""Imports of a command's file -> done when the command runs, so that its help needs none of them.

As `lazy from module import name` of Python 3.15 (PEP 810).
"""

from __future__ import annotations

import builtins
import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

_POSTPONING = False  # only while a process reads its own command line
_WAITING = list[dict[str, Any]]()  # names of the files that something stands in for


class _Standin:
    """Stands in a file for a module, or for a name of it."""

    def __init__(self, module: str, name: str = ""):
        self._module, self._name = module, name

    def __getattr__(self, name: str) -> _Standin:
        if name.startswith("__") or self._name:
            raise AttributeError(f"{self._module}.{self._name} is not imported yet: {name}")
        return _Standin(self._module, name)

    def _found(self) -> Any:
        module = import_module(self._module)
        return getattr(module, self._name) if self._name else module


@contextmanager
def deferred() -> Iterator[None]:
    """Imports within are done by `load`, if the process has called `postpone`, and else at once."""
    if not _POSTPONING:
        yield
        return
    found = builtins.__import__

    def stand_in(
        name: str,
        names: dict[str, Any],
        local: object = None,
        listed: Sequence[str] | None = (),
        level: int = 0,
    ) -> _Standin:
        _WAITING.append(names)
        return _Standin(name)

    builtins.__import__ = stand_in  # type: ignore[assignment]
    try:
        yield
    finally:
        builtins.__import__ = found


def postpone() -> None:
    """Let `deferred` imports wait from now on."""
    global _POSTPONING
    _POSTPONING = True


def load() -> None:
    """Import all that waits."""
    global _POSTPONING
    _POSTPONING = False
    with _kept():
        while _WAITING:
            names = _WAITING.pop()
            found = {name: one for name, one in names.items() if isinstance(one, _Standin)}
            names |= {name: one._found() for name, one in found.items()}


@contextmanager
def _kept() -> Iterator[None]:
    """Nothing that is imported is garbage; to look for some takes 0.3 s in a run of seconds."""
    if not _WAITING:
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
