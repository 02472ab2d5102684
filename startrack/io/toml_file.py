"""Path of a TOML file -> its table; files that are too large, or too slow to parse, are refused."""

import re
import tomllib
from datetime import date, time
from functools import lru_cache
from pathlib import Path
from typing import Any

from startrack import core
from startrack.core import Refused
from startrack.io.reading import read_bytes

LARGEST = 2**20  # byte; the largest design of the catalogue has 5 kB
LONGEST_KEY = 32  # parts between dots; keys of some 10000 parts take tomllib minutes
QUOTED = re.compile(r"\"(?:[^\"\\\n]|\\.)*+\"|'[^'\n]*+'")
BREAKS = str.maketrans("=,[]{}", "      ")


def read_table(path: Path, what: str) -> dict[str, Any]:
    """The table of a TOML file.

    what    expected kind of file, for error messages: "a design file"
    Raises  ValueError, one sentence with the file.
    """
    try:
        # byte-order mark of Windows editors
        text = read_bytes(path, what, LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refused(f"{path} must be a TOML file in UTF-8: {error}") from None
    except OSError as error:
        raise Refused(str(error) if error.errno is None else f"{path}: {error}") from None
    if key := _long_key(text):
        raise Refused(
            f"{path} must have keys of at most {LONGEST_KEY} parts, got {core.shown(key)} of "
            f"{key.count('.') + 1}"
        )
    try:
        return parsed(text)
    except RecursionError:
        raise Refused(f"{path} must be a TOML file without deeply nested values") from None
    except ValueError as error:
        raise Refused(f"{path} must be a TOML file: {error}") from None


def parsed(text: str) -> dict[str, Any]:
    """The table of a TOML text, in which dates and times are texts, as those in quotes are.

    Raises  RecursionError or ValueError for invalid TOML.
    """
    table: dict[str, Any] = _dates_as_texts(_read(text))  # a copy, which others may change
    return table


@lru_cache(maxsize=64)
def _read(text: str) -> dict[str, Any]:
    """The table of a text; The last 64 files are cached: a design has several files that are read
    often."""
    return tomllib.loads(text)


def _dates_as_texts(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _dates_as_texts(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_dates_as_texts(inner) for inner in value]
    if isinstance(value, date | time):  # a datetime is a date, too
        return value.isoformat().removesuffix("+00:00")
    return value


def _long_key(text: str) -> str:
    """A dotted key with too many parts; empty if there is none."""
    if text.count(".") < LONGEST_KEY:
        return ""
    for line in text.splitlines():
        if line.count(".") < LONGEST_KEY:
            continue
        bare = "".join(QUOTED.sub("q", line).split("#", 1)[0].split())
        for key in bare.translate(BREAKS).split():
            if key.count(".") >= LONGEST_KEY:
                return key
    return ""
