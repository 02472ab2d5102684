"""Do pages and commands agree on measured figures?

    python experiments/figures.py [--write] [--results DIR] [--commands NAME ...] [--list]
        [--json FILE] [--quick]

Runs the commands of `figures.toml`, on an otherwise idle machine, and compares their figures with
the text of the pages; --write writes the figures there, with the commit. Results are kept as
DIR/NAME.json; a command with a result is not run again. --list runs nothing. It prints each line of
README.md and of the pages in `docs` that states a measure (a number with a unit) without a template
in `figures.toml`, outside pages written by scripts, and without the name of a script.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import command

ROOT = Path(__file__).parents[1]
TABLE = Path(__file__).with_suffix(".toml")
PLACE = re.compile(r"\{(\w+)\}")
MEASURE = re.compile(r"\d (?:arcsec|s|ms|min|%|GB|MB|times|seconds)\b")
# Written by scripts, or about a user's inputs.
WRITTEN = (
    "reference.md",
    "api.md",
    "gallery.md",
    "mission-keys.md",
    "profile-keys.md",
    "search-keys.md",
    "tutorial.md",
    "tutorial-earth.md",
)


class Figure(NamedTuple):
    """Text of a page with fields for figures, and the measured value of each field.

    text    text of the page; each field is a name in braces
    places  by field: path in the JSON of the command, keys joined by "/", and a format
    """

    page: str
    text: str
    command: str
    places: dict[str, tuple[str, str]]

    @property
    def pattern(self) -> re.Pattern[str]:
        """A pattern that finds the text with any figures; each field is a group."""
        parts = PLACE.split(self.text)
        named = (
            f"(?P<{part}>\\S+?)" if number % 2 else re.escape(part)
            for number, part in enumerate(parts)
        )
        return re.compile("".join(named))

    def written(self, result: Any) -> dict[str, str]:
        """The figures of a result, by field; "open" for an interval without an end."""
        return {
            name: "open" if (value := found(result, path)) is None else format(value, form)
            for name, (path, form) in self.places.items()
        }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help="write the figures into the pages")
    parser.add_argument("--results", type=Path, default=Path("figure-results"))
    parser.add_argument(
        "--commands",
        nargs="+",
        metavar="NAME",
        help="commands of figures.toml to run (default: all)",
    )
    parser.add_argument(
        "--list", action="store_true", help="list the figures that no script writes"
    )
    with tempfile.TemporaryDirectory() as folder:
        options = command.read(parser, results=Path(folder))
        if options.list:
            lines = list(unwritten())
            print("\n".join(lines))
            command.save(options, {"unwritten": len(lines)})
            return
        commands, figures = read(TABLE)
        names = options.commands or list(commands)
        results = {name: result_of(name, commands[name], options) for name in names}
        differing = 0
        for figure in figures:
            if figure.command in results:
                write = options.write and not options.quick
                differing += compared(figure, results[figure.command], ROOT / figure.page, write)
    print(f"{differing} figures of the pages differ from what the commands measured")
    command.save(options, {"figures": len(figures), "differing": differing})


def read(path: Path) -> tuple[dict[str, dict[str, list[str]]], list[Figure]]:
    """The commands and the figures of a table."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    figures = []
    for row in table["figures"]:
        page, text, name = row.pop("page"), row.pop("text"), row.pop("command")
        figures.append(Figure(page, text, name, {key: tuple(value) for key, value in row.items()}))
    return table["commands"], figures


def found(result: Any, path: str) -> Any:
    """A JSON value by path."""
    for key in path.split("/"):
        result = result[int(key)] if isinstance(result, list) else result[key]
    return result


def result_of(name: str, row: Mapping[str, list[str]], options: argparse.Namespace) -> Any:
    """The JSON of a command, with its time in seconds and the commit."""
    kept = options.results / f"{name}.json"
    if not kept.is_file():
        options.results.mkdir(parents=True, exist_ok=True)
        words = [*row["words"], *(row["quick"] if options.quick else [])]
        call = [sys.executable, "-m", "startrack.cli", words[0], design(words[1]), *words[2:]]
        began = time.perf_counter()
        out = str(options.results / name)
        done = subprocess.run([*call, "--json", "--out", out], stdout=subprocess.PIPE, text=True)
        if done.returncode not in (0, 3):
            raise SystemExit(f"startrack {' '.join(words)} ended with {done.returncode}")
        more = {"seconds": time.perf_counter() - began, "commit": command.commit()}
        kept.write_text(json.dumps(json.loads(done.stdout) | more, indent=1), encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


def design(name: str) -> str:
    """The file of a shipped design."""
    return str(ROOT / "catalogs" / "designs" / f"{name}.toml")


def compared(figure: Figure, result: Any, path: Path, write: bool) -> int:
    """Number of a page's figures that differ from a result; with --write, writes the results.

    Raises  SystemExit if the page does not contain the text exactly once.
    """
    text = path.read_text(encoding="utf-8")
    matches = list(figure.pattern.finditer(text))
    if len(matches) != 1:
        raise SystemExit(
            f"{figure.page} must contain once: {figure.text}; it does {len(matches)} times"
        )
    [match], measured = matches, figure.written(result)
    differing = {name: value for name, value in measured.items() if match[name] != value}
    for name, value in differing.items():
        print(f"{figure.page}: {name} is {match[name]}, measured: {value}")
    if write and differing:
        line = PLACE.sub(lambda place: measured[place[1]], figure.text)
        path.write_text(text[: match.start()] + line + text[match.end() :], encoding="utf-8")
    return len(differing)


def unwritten() -> Iterator[str]:
    """Lines that state a measure without a script, with page and line number."""
    _, figures = read(TABLE)
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for path in pages:
        text = path.read_text(encoding="utf-8")
        if path.name in WRITTEN or "experiments/" in text:
            continue
        page = path.relative_to(ROOT).as_posix()
        for figure in figures:
            if figure.page == page:
                text = figure.pattern.sub("", text)
        for number, line in enumerate(text.splitlines(), 1):
            if MEASURE.search(line):
                yield f"{page}:{number}: {line}"


if __name__ == "__main__":
    command.run(main)
