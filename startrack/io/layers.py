"""A file, its base files, and single values that override all -> one table.

The file of each value is known, so that an error names this file.
"""

import difflib
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

from startrack import core
from startrack.core import Refused
from startrack.io.reading import shipped
from startrack.io.tables import LONGEST_NAME
from startrack.io.toml_file import parsed, read_table

LAYERED = ("variations", "trackers", "designs")  # folders of base files of designs
# largest number of files of a design, counted each time they are named; chosen by hand
MOST_FILES = 256
DEEPEST = 16  # files below each other; chosen by hand
KEY = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*")
PLACE = re.compile(r"[^\s:]+")
SET = "--set"
Joined = Mapping[str, Mapping[str, Any]]
NOT_JOINED: Joined = {}


class Renewed(NamedTuple):
    """A key that replaces the other keys of its table, such as the name of a product.

    If a file names it, the values of lower files in that table are dropped.

    key   of the table
    kept  keys of the table that remain valid
    """

    key: str
    kept: tuple[str, ...]


NOT_RENEWED: Mapping[str, Renewed] = {}
NO_PAIRS: Mapping[str, tuple[str, str]] = {}


def _named_file(entry: object) -> str:
    """An entry of `include` that is the name of a file."""
    if not isinstance(entry, str):
        raise Refused(f"include must be a list of names of files, got {core.shown(entry)}")
    return entry


class LayerRules(NamedTuple):
    """Rules for combining a file with its base files.

    joined    keys of the outermost table whose lists of tables are added to those of lower files;
              an entry replaces a lower entry that agrees in some keys, given with defaults
    renewed   tables of which one key stands for the others, by their places
    instead   two alternative keys of a table, by its place: a file with one of them removes the
              other one of lower files
    is_value  whether a table is a value, which replaces another one and is not merged with it
    file_of   function: entry of `include` -> name of its file; raises Refused if it is none
    named     places of lists of tables with different names: a file with a table in place of the
              list changes entries by their names
    resolved  function: table of a file, its path -> the table with the contents of files that its
              values name
    """

    joined: Joined = NOT_JOINED
    renewed: Mapping[str, Renewed] = NOT_RENEWED
    instead: Mapping[str, tuple[str, str]] = NO_PAIRS
    is_value: Callable[[object], bool] = lambda table: False
    file_of: Callable[[object], str] = _named_file
    named: Collection[str] = ()
    resolved: Callable[[dict[str, Any], Path], dict[str, Any]] = lambda table, path: table

    def is_table(self, value: object) -> bool:
        """Whether a value of a file is a table whose keys are merged."""
        return isinstance(value, dict) and not self.is_value(value)


@dataclass
class Layers:
    """One table of several files.

    table   the values
    origin  file (or `--set`) of each value that is not a table, by its place: "scene.background_g"
    rules   rules for combining files
    """

    table: dict[str, Any] = field(default_factory=dict)
    origin: dict[str, str] = field(default_factory=dict)
    rules: LayerRules = field(default_factory=LayerRules)

    def lay(self, above: dict[str, Any], origin: str | dict[str, str], place: str = "") -> None:
        """Put a table over this one: tables are merged by their keys, all else is replaced."""
        is_table = self.rules.is_table
        joined = NOT_JOINED if place or origin == SET else self.rules.joined
        below = self.table
        for name in filter(None, place.split(".")):
            below = below[name]
        rule = self.rules.renewed.get(place)
        if rule and rule.key in above and not is_table(above[rule.key]):
            self._renew(below, rule, place, _origin(origin, f"{place}.{rule.key}"))
        for key, other in permutations(self.rules.instead.get(place, ()), 2):
            if key in above and other in below:
                self.drop(f"{place}.{other}")
        for key, value in above.items():
            inner = f"{place}.{key}" if place else key
            if is_table(value) and is_table(below.get(key)):
                self.lay(value, origin, inner)
                continue
            entries, by_name = below.get(key), inner in self.rules.named
            if (origin == SET or by_name) and is_table(value) and isinstance(entries, list):
                below[key] = self._with_entries(entries, value, origin, inner)
                continue
            if key in joined and isinstance(value, list) and isinstance(below.get(key), list):
                value = _joined(below[key], value, joined[key])
            for place_below in [place for place in self.origin if _within(place, inner)]:
                del self.origin[place_below]
            below[key] = {} if is_table(value) else value
            if is_table(value):
                self.lay(value, origin, inner)
            else:
                self.origin[inner] = _origin(origin, inner)

    def _renew(self, below: dict[str, Any], rule: Renewed, place: str, by: str) -> None:
        """Remove values of other files that a key replaces."""
        for key in [key for key in below if key not in rule.kept]:
            inner = f"{place}.{key}"
            said = {at for name, at in self.origin.items() if _within(name, inner)}
            if said != {by}:
                self.drop(inner)

    def _with_entries(
        self, entries: list[Any], above: dict[str, Any], origin: str | dict[str, str], place: str
    ) -> list[Any]:
        """A list of tables with changes of some, by their numbers, or by names if the list is
        `named`: {"0": {"scale": 0.5}}."""
        changed, numbers = list(entries), {str(number): number for number in range(len(entries))}
        if place in self.rules.named:
            numbers |= {
                str(entry.get("name")): number
                for number, entry in enumerate(entries)
                if isinstance(entry, dict)
            }
        for name, change in above.items():
            number = numbers.get(name, -1)
            if number < 0 or not isinstance(entries[number], dict) or not isinstance(change, dict):
                by, last = "" if isinstance(origin, dict) else f"{origin} ", list(numbers)[-1:]
                raise Refused(
                    f"{by}{place}.{name} must be a key of an entry, {place}.0.KEY to "
                    f"{place}.{''.join(last)}.KEY"
                )
            entry = Layers(dict(entries[number]), rules=self.rules)
            inner = f"{place}.{name}."
            entry.lay(
                change,
                origin
                if isinstance(origin, str)
                else {at.removeprefix(inner): file for at, file in origin.items()},
            )
            changed[number] = entry.table
            of_entry = f"{place}[{number}]"
            self.origin |= {f"{of_entry}.{key}": at for key, at in entry.origin.items()}
        return changed

    def drop(self, place: str) -> None:
        """Take out a value or a table."""
        table: Any = self.table
        *outer, last = place.split(".")
        for name in outer:
            table = table.get(name) if isinstance(table, dict) else None
        if not isinstance(table, dict) or last not in table:
            raise Refused(f"{SET} {place}= must name a key that the files have, and none has it")
        del table[last]
        self.origin = {name: at for name, at in self.origin.items() if not _within(name, place)}

    def note_below(self, table: Mapping[str, Any], origin: str, place: str) -> None:
        """Note the file of values that stand below all files, such as those of a product."""
        for key, value in table.items():
            inner = f"{place}.{key}"
            if self.rules.is_table(value):
                self.note_below(value, origin, inner)
            else:
                self.origin.setdefault(inner, origin)

    def folder_of(self, place: str, path: Path) -> Path:
        """The folder of the file that a value is from; for `--set`, the folder of the outermost
        file.

        path  of the file over all
        """
        origin = self.origin.get(place, SET)
        return path.parent if origin == SET else Path(origin).parent

    def blamed(self, message: str, path: Path) -> str:
        """A message on a place in the table, with the file of the value there."""
        match = PLACE.match(message)
        place = match[0] if match else ""
        origins = {origin for name, origin in self.origin.items() if _within(name, place)}
        file = origins.pop() if len(origins) == 1 else path
        return core.of_file(message, file)


def _origin(origin: str | dict[str, str], place: str) -> str:
    return origin if isinstance(origin, str) else origin[place]


def read_layers(
    path: Path, what: str, changes: Sequence[str] = (), rules: LayerRules | None = None
) -> Layers:
    """The table of a file over those that it names.

        base = "other.toml"          the file below all others
        include = ["a.toml", ...]    over the base, each over the one before

    Both keys are at the beginning of the file, whose own values replace theirs; these files may
    name further files. A name is that of a file in the same folder, or of one in the catalogue
    ("designs/nanosatellite.toml"). Tables are merged by their keys; a list replaces a list.

    what     expected kind of file, for error messages: "a design file"
    rules    rules for combining files; None: tables are merged and nothing else
    changes  "key = value" each, over all files: "instrument.optics.f_number=2.0", and of an entry
             of a list of tables "variation.0.scale=0.5". A value that is not TOML is a text:
             "instrument.optics.blur=3 um". Without a value, the key is removed from the files, so
             that its default holds: "instrument.detector.age=".
    Raises   ValueError if a file is missing, is not TOML or includes itself through other files, or
             if a change is invalid. The message is one sentence with the file.
    """
    if isinstance(changes, str):
        raise Refused(f"changes must be a list of texts KEY=VALUE, got {core.shown(changes)}")
    layers = _read_layers(path, what, rules or LayerRules(), (), [])
    for change in changes:
        key, _, text = change.partition("=")
        if "=" in change and not text.strip() and KEY.fullmatch(key.strip()):
            layers.drop(key.strip())
        else:
            layers.lay(_changed(change), SET)
    return layers


def _joined(below: list[Any], above: list[Any], alike: Mapping[str, Any]) -> list[Any]:
    """The entries of both lists, without those below that one above is alike."""

    def name(entry: Any) -> list[Any] | None:
        table = isinstance(entry, dict)
        return [entry.get(key, default) for key, default in alike.items()] if table else None

    named = [name(entry) for entry in above]
    return [entry for entry in below if name(entry) not in named] + above


def _read_layers(
    path: Path, what: str, rules: LayerRules, above: tuple[Path, ...], done: list[Path]
) -> Layers:
    """The layers of a file and of those that it names.

    above  files that lead to it
    done   files that were read until now, each as often as it was named
    """
    real = Path(os.path.realpath(path))  # `resolve` has no OSError for a loop
    if real in above:
        raise Refused(f"{above[0]}: base and include must not lead back to {path}")
    if len(above) == DEEPEST:
        raise Refused(f"{above[0]} must have at most {DEEPEST} files below each other")
    done.append(real)
    if len(done) > MOST_FILES:
        top = above[0] if above else path
        raise Refused(
            f"{top} must be made of at most {MOST_FILES} files, named by base and include"
        )
    own = read_table(path, what)
    below, more = own.pop("base", None), own.pop("include", [])
    if below is not None and not isinstance(below, str):
        raise Refused(f"{path}: base must be the name of a file, got {core.shown(below)}")
    if not isinstance(more, list):
        raise Refused(f"{path}: include must be a list of names of files, got {core.shown(more)}")
    try:
        included = [("include", rules.file_of(entry)) for entry in more]
    except Refused as error:
        raise Refused(f"{path}: {error}") from None
    layers = Layers(rules=rules)
    for key, name in [("base", below)] * (below is not None) + included:
        inner = _found(path, key, str(name))
        read = _read_layers(inner, what, rules, (*above, real), done)
        layers.lay(read.table, read.origin)
    layers.lay(rules.resolved(own, path), str(path))
    return layers


def keys_of_layers(path: Path, what: str) -> set[str]:
    """The keys at the top level of a file and of its base files.

    Raises  ValueError as `read_layers`.
    """
    keys = set[str]()
    for _ in range(DEEPEST):
        table = read_table(path, what)
        keys |= table.keys()
        if not isinstance(table.get("base"), str):
            break
        path = _found(path, "base", table["base"])
    return keys


def _found(path: Path, key: str, name: str) -> Path:
    try:
        beside = path.parent / name
        return beside if name and beside.exists() else shipped(name or "-")
    except (OSError, ValueError):  # not there, or a name that no file can have
        raise Refused(
            f"{path}: {key} must be the name of a file beside it, or of one in the catalogue, such "
            f"as {_like(name)!r}, got {core.shown(name)}"
        ) from None


def _like(name: str) -> str:
    """The file of the catalogue whose name is most like another one."""
    stems = {
        file.stem: f"{folder}/{file.name}"
        for folder in LAYERED
        for file in sorted(shipped(folder).glob("*.toml"))
    }
    asked = name.rpartition("/")[2].removesuffix(".toml")
    close = difflib.get_close_matches(asked[:LONGEST_NAME], stems, 1, 0.75)
    return stems[close[0] if close else "nanosatellite"]


def _changed(change: str) -> dict[str, Any]:
    key, equals, text = (part.strip() for part in change.partition("="))
    if not (equals and KEY.fullmatch(key)):
        raise Refused(
            f"{SET} must be KEY=VALUE, such as instrument.optics.f_number=2.0, got "
            f"{core.shown(change)}"
        )
    try:
        read = parsed(f"value = {text}")
    except (ValueError, RecursionError):
        read = {}
    *outer, last = key.split(".")
    table: dict[str, Any] = {last: read["value"] if list(read) == ["value"] else text}
    for name in reversed(outer):
        table = {name: table}
    return table


def _within(place: str, other: str) -> bool:
    return place == other or place.startswith(f"{other}.")
