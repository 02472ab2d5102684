"""A comparison of values read by startrack with the meaning of the file, or of a model with its
limit."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

from startrack import Refused


class Verdict(enum.StrEnum):
    """Verdict on a file or law."""

    RIGHT = "right"
    REFUSED = "refused"
    WRONG = "wrong"
    CRASHED = "crashed"


class Check(NamedTuple):
    """A file of a format, or a law at its limit.

    kind     the format ("AEM", "TIFF") or the room of the law ("detector")
    name     the variant, in words
    verdict  right within the stated accuracy, refused with a sentence, wrong, or crashed
    note     actual and correct value, message of a refusal, or exception
    """

    kind: str
    name: str
    verdict: Verdict
    note: str = ""


def checked(kind: str, name: str, compare: Callable[[], str | None]) -> Check:
    """The verdict of a comparison; the comparison returns None if all is right, else a description
    of the error.

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
