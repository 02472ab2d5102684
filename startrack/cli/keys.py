"""`startrack keys`: what a design file may hold."""

from __future__ import annotations

import argparse
import shutil
from textwrap import fill

from startrack.cli.options import Exit, Option, Options, WrongUse, wanted

if wanted(__name__):
    import difflib
    import json

    from startrack.cli.terminal import print_result
    from startrack.design import Key, design_keys, design_schema, search_keys
    from startrack.earth import retrieval

WIDEST = 100  # letters of a line

declare = Options(
    "Prints each key of a design file with its type, the unit that its value is written with, "
    "its range and default, what it means, and which fidelities take it where some do not (in "
    "brackets: run without it): all, or those of one table. For example\n\n"
    "  startrack keys instrument.detector\n"
    "  startrack keys field of view\n\n"
    "Words that are no table are looked for in names and meanings, and among the words of "
    "datasheets. "
    "--schema prints a JSON Schema of them, by which editors complete and check design files: "
    "with taplo, as in VS Code's Even Better TOML, by a first line\n\n"
    "  #:schema ./design.schema.json",
    Option(
        "table TABLE",
        "table or key, such as instrument.optics, or words (default: all)",
        default=[],
        many="*",
    ),
    Option("--scene", "those of a scene file of an Earth camera, in place of a design file"),
    Option("--schema", "print the JSON Schema of a whole design file"),
)


def command(options: argparse.Namespace) -> int:
    """Print the keys, one after the other."""
    if options.schema:
        schema = retrieval.scene_schema() if options.scene else design_schema()
        print(json.dumps(schema, indent=1))
        return Exit.DONE
    table = " ".join(options.table)
    keys = retrieval.scene_keys() if options.scene else design_keys()
    chosen = [key for key in keys if f"{key.name}.".startswith(f"{table}." if table else "")]
    chosen = chosen or ([] if "." in table else search_keys(table, keys))
    if not chosen:
        near = difflib.get_close_matches(table, [key.name for key in keys], 3)
        raise WrongUse(
            f"TABLE must be a table or a key of a {'scene' if options.scene else 'design'} file, "
            f"got {table!r}" + (f"; similar are {', '.join(near)}" if near else "")
        )
    width = min(shutil.get_terminal_size().columns, WIDEST)
    for key in chosen:
        print_result(options, key._asdict(), _text(key, width))
    return Exit.DONE


def _text(key: Key, width: int) -> str:
    kind = f"{key.kind} in {key.unit}" if key.unit else key.kind
    kind += f", {key.range}" if key.range else ""
    default = {"required": ", required", "": ""}.get(key.default, f", default {key.default}")
    meaning = key.meaning
    if key.taken_by not in ("", "all"):
        meaning = f"{meaning.rstrip('.')}. Taken by: {key.taken_by}."
    meaning = fill(meaning, width, initial_indent="    ", subsequent_indent="    ")
    return f"{key.name}  ({kind}{default})\n{meaning}"
