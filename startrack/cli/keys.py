"""`startrack keys`: the keys of a kind of file."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Iterable, Sequence
from textwrap import fill
from typing import NamedTuple

from startrack.cli.options import Exit, Option, Options, WrongUse, wanted

if wanted(__name__):
    import difflib
    import json

    from startrack import mission, moving, sequence
    from startrack.cli.terminal import print_result
    from startrack.design import Key, design_keys, design_schema, keys_of, search_keys
    from startrack.earth import retrieval

WIDEST = 100  # letters per line

declare = Options(
    "Prints all keys of a design file, or the keys of one table: type, unit, range, default and "
    "meaning. If some fidelities do not take a key, the others are listed (in brackets: "
    "fidelities that run without it). For example\n\n startrack keys instrument.detector\n "
    "startrack keys field of view\n startrack keys --mission orbit\n\nWords that name no table "
    "are searched in names and meanings, and among words of datasheets; without a match in "
    "design files, in other kinds of files. --schema prints a JSON Schema, with which editors "
    "complete and check design files. For taplo, as in VS Code's Even Better TOML, the first "
    "line is\n\n #:schema ./design.schema.json",
    Option(
        "table TABLE",
        "table or key, such as instrument.optics, or words (default: all)",
        default=[],
        many="*",
    ),
    Option("--scene", "keys of a scene file of an Earth camera, in place of a design file"),
    Option("--mission", "keys of a mission file"),
    Option("--profile", "keys of a profile of `startrack sequence`"),
    Option("--search", "keys of a search for moving objects"),
    Option("--schema", "print the JSON Schema of a whole design file, or with --scene of a scene"),
)


class FileKeys(NamedTuple):
    """A kind of file, in words, and its keys."""

    what: str
    listed: Callable[[], Iterable[Key]]

    def find(self, table: str) -> list[Key]:
        """The keys of a table, or the keys that match words."""
        keys = list(self.listed())
        found = [key for key in keys if f"{key.name}.".startswith(f"{table}." if table else "")]
        return found or ([] if "." in table else search_keys(table, keys))


def command(options: argparse.Namespace) -> int:
    """Print the keys, one after the other."""
    kinds = {
        "design": FileKeys("a design file", design_keys),
        "scene": FileKeys("a scene file of an Earth camera", retrieval.scene_keys),
        "mission": FileKeys("a mission file", lambda: keys_of(mission.Mission)),
        "profile": FileKeys(
            "a profile of `startrack sequence`", lambda: keys_of(sequence.Sequence)
        ),
        "search": FileKeys("a search for moving objects", moving.moving_keys),
    }
    asked = [name for name in kinds if getattr(options, name, False)]
    if len(asked) > 1:
        raise WrongUse(f"at most one kind of file must be given, got {' and '.join(asked)}")
    if options.schema:
        if asked not in ([], ["scene"]):
            raise WrongUse(f"--schema must be of a design or a scene, got --{asked[0]}")
        print(json.dumps(retrieval.scene_schema() if asked else design_schema(), indent=1))
        return Exit.DONE
    table = " ".join(options.table)
    first = kinds.pop(asked[0] if asked else "design")
    chosen = first.find(table)
    if chosen:
        _print(options, chosen)
        return Exit.DONE
    others = {} if asked else {name: kind.find(table) for name, kind in kinds.items()}
    if not any(others.values()):
        near = difflib.get_close_matches(table, [key.name for key in first.listed()], 3)
        raise WrongUse(
            f"TABLE must be a table or a key of {first.what if asked else 'a file'}, "
            f"got {table!r}" + (f"; similar are {', '.join(near)}" if near else "")
        )
    for name, found in others.items():
        if found and not options.json:
            print(f"{kinds[name].what} has (--{name}):")
        _print(options, found)
    return Exit.DONE


def _print(options: argparse.Namespace, keys: Sequence[Key]) -> None:
    width = min(shutil.get_terminal_size().columns, WIDEST)
    for key in keys:
        print_result(options, key._asdict(), _text(key, width))


def _text(key: Key, width: int) -> str:
    kind = f"{key.kind} in {key.unit}" if key.unit else key.kind
    kind += f", {key.range}" if key.range else ""
    default = {"required": ", required", "": ""}.get(key.default, f", default {key.default}")
    meaning = key.meaning
    if key.taken_by not in ("", "all"):
        meaning = f"{meaning.rstrip('.')}. Taken by: {key.taken_by}."
    meaning = fill(meaning, width, initial_indent="    ", subsequent_indent="    ")
    return f"{key.name}  ({kind}{default})\n{meaning}"
