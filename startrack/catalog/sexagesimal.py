"""Texts such as `-16 42 58` enter; numbers such as -16.716 leave."""

from __future__ import annotations

import numpy as np

from startrack.catalog.records import Records
from startrack.values import Floats


def degrees(records: Records, name: str, cuts: tuple[int, int] | None = None) -> Floats:
    """A column of degrees (or hours), minutes and seconds as degrees (or hours).

    records  the columns
    name     which of them
    cuts     where the minutes and the seconds begin, for fields that touch; None for fields
             with blanks between them
    Returns  (n,) number, NaN where the field is blank
    Errors   ValueError where a field is not three numbers, or has 60 minutes or more.
    """
    values = np.full(len(records.line), np.nan)
    for i, text in enumerate(records.columns[name]):
        if text.strip():
            pieces = text.split() if cuts is None else [text[: cuts[0]], *_split(text, cuts)]
            try:
                whole, minutes, seconds = (float(piece) for piece in pieces)
                if not (0 <= minutes < 60 and 0 <= seconds <= 60):
                    raise ValueError
            except ValueError:
                raise ValueError(
                    f"{records.path}, line {records.line[i]}: {name} must be three numbers such "
                    f"as 16 42 58, got {text!r}"
                ) from None
            size = abs(whole) + minutes / 60 + seconds / 3600
            values[i] = -size if text.lstrip().startswith("-") else size
    return values


def _split(text: str, cuts: tuple[int, int]) -> tuple[str, str]:
    return text[cuts[0] : cuts[1]], text[cuts[1] :]
