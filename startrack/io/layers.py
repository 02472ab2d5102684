"""A TOML file, the files below it, and single values -> one table, and the file of each value."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from startrack.core import Refused, shown
from startrack.io.shipped import shipped
from startrack.io.tables import read_table

DEEPEST = 16  # files below each other; chosen by hand
KEY = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*")
PLACE = re.compile(r"[^\s:]+")
SET = "--set"
Joined = Mapping[str, Mapping[str, Any]]
NOT_JOINED: Joined = {}


@dataclass
class Layers:
    """One table of several files.

    table   the values
    origin  file (or `--set`) of each value that is no table, by its place: "scene.background_g"
    """

    table: dict[str, Any] = field(default_factory=dict)
    origin: dict[str, str] = field(default_factory=dict)

    def lay(
        self,
        above: dict[str, Any],
        origin: str | dict[str, str],
        place: str = "",
        joined: Joined = NOT_JOINED,
    ) -> None:
        """Put a table over this one: tables are merged by their keys, all else is replaced.

        joined  as `read_layers` has it
        """
        held = self.table
        for name in filter(None, place.split(".")):
            held = held[name]
        for key, value in above.items():
            inner = f"{place}.{key}" if place else key
            if isinstance(value, dict) and isinstance(held.get(key), dict):
                self.lay(value, origin, inner)
                continue
            if key in joined and isinstance(value, list) and isinstance(held.get(key), list):
                value = _joined(held[key], value, joined[key])
            for known in [one for one in self.origin if _within(one, inner)]:
                del self.origin[known]
            held[key] = {} if isinstance(value, dict) else value
            if isinstance(value, dict):
                self.lay(value, origin, inner)
            else:
                self.origin[inner] = origin if isinstance(origin, str) else origin[inner]

    def blamed(self, message: str, path: Path) -> str:
        """A message on a place in the table, with the file that the value there is from."""
        found = PLACE.match(message)
        place = found[0] if found else ""
        origins = {one for name, one in self.origin.items() if _within(name, place)}
        return f"{origins.pop() if len(origins) == 1 else path}: {message}"


def read_layers(
    path: Path, what: str, changes: Sequence[str] = (), joined: Joined = NOT_JOINED
) -> Layers:
    """The table of a file over those that it names.

        base = "other.toml"          the file below all others
        include = ["a.toml", ...]    over the base, each over the one before

    Both stand first in the file, which is over them; they may name others themselves. A name is
    that of a file beside the one that names it, or of one in the catalogue
    ("designs/nanosatellite.toml"). Tables are merged by their keys; a list replaces a list.

    what     the file must be, for the errors: "a design file"
    joined   keys of the outermost table whose lists of tables are added to those of the files
             below; an entry replaces one below that is alike in some keys, given with defaults
    changes  "key = value" each, over all files: "instrument.optics.f_number=2.0". A value that is
             no TOML is a text: "instrument.optics.blur=3 um".
    Raises   ValueError, one sentence with the file: where a file is missing or no TOML, names
             itself by way of others, or a change is none.
    """
    layers = _read(path, what, joined, ())
    for change in changes:
        layers.lay(_changed(change), SET)
    return layers


def _joined(below: list[Any], above: list[Any], alike: Mapping[str, Any]) -> list[Any]:
    """The entries of both lists, without those below that one above is alike."""

    def name(entry: Any) -> list[Any] | None:
        return (
            [entry.get(key, default) for key, default in alike.items()]
            if isinstance(entry, dict)
            else None
        )

    named = [name(entry) for entry in above]
    return [entry for entry in below if name(entry) not in named] + above


def _read(path: Path, what: str, joined: Joined, above: tuple[Path, ...]) -> Layers:
    if path.resolve() in above:
        raise Refused(f"{above[0]}: base and include must not lead back to {path}")
    if len(above) == DEEPEST:
        raise Refused(f"{above[0]} must have at most {DEEPEST} files below each other")
    own = read_table(path, what)
    below, more = own.pop("base", None), own.pop("include", [])
    if below is not None and not isinstance(below, str):
        raise Refused(f"{path}: base must be the name of a file, got {shown(below)}")
    if not (isinstance(more, list) and all(isinstance(one, str) for one in more)):
        raise Refused(f"{path}: include must be a list of names of files, got {shown(more)}")
    layers = Layers()
    for key, name in [("base", below)] * (below is not None) + [("include", one) for one in more]:
        read = _read(_found(path, key, str(name)), what, joined, (*above, path.resolve()))
        layers.lay(read.table, read.origin, joined=joined)
    layers.lay(own, str(path), joined=joined)
    return layers


def _found(path: Path, key: str, name: str) -> Path:
    try:
        beside = path.parent / name
        return beside if name and beside.exists() else shipped(name or "-")
    except (OSError, ValueError):  # not there, or a name that no file can have
        raise Refused(
            f"{path}: {key} must be the name of a file beside it, or of one in the catalogue, such "
            f"as 'designs/nanosatellite.toml', got {shown(name)}"
        ) from None


def _changed(change: str) -> dict[str, Any]:
    key, equals, text = (part.strip() for part in change.partition("="))
    if not (equals and KEY.fullmatch(key)):
        raise Refused(
            f"{SET} must be KEY=VALUE, such as instrument.optics.f_number=2.0, got {shown(change)}"
        )
    try:
        read = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        read = {}
    *outer, last = key.split(".")
    table: dict[str, Any] = {last: read["value"] if list(read) == ["value"] else text}
    for name in reversed(outer):
        table = {name: table}
    return table


def _within(place: str, other: str) -> bool:
    return place == other or place.startswith(f"{other}.")
