"""One comparison of what startrack read with what the file means, or of a model with its limit."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

from startrack import Refused


class Verdict(enum.StrEnum):
    """What became of one file or law."""

    RIGHT = "right"
    REFUSED = "refused"
    WRONG = "wrong"
    CRASHED = "crashed"


class Check(NamedTuple):
    """A file of a format, or a law at its limit.

    kind     the format ("AEM", "TIFF") or the room of the law ("detector")
    name     the variant, in words
    verdict  right within the stated accuracy, refused with a sentence, wrong, or crashed
    note     the value and what it should be, the sentence of a refusal, or the exception
    """

    kind: str
    name: str
    verdict: Verdict
    note: str = ""


def checked(kind: str, name: str, compare: Callable[[], str | None]) -> Check:
    """The verdict of a comparison, which returns None where all is right, or what is wrong.

    A refusal is `Refused`; any other exception is a crash.
    """
    try:
        difference = compare()
    except Refused as refusal:
        return Check(kind, name, Verdict.REFUSED, str(refusal))
    except Exception as error:
        return Check(kind, name, Verdict.CRASHED, f"{type(error).__name__}: {error}")
    if difference is None:
        return Check(kind, name, Verdict.RIGHT)
    return Check(kind, name, Verdict.WRONG, difference)
