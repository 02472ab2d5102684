"""How a command ends: its exit status, and the error that asks for another call."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """Exit status of a command."""

    DONE = 0
    FAILED = 1
    WRONG_USE = 2
    UNSOLVED = 3  # done, but something is unsolved


class WrongUse(ValueError):
    """An argument or a design file that cannot be used."""
