"""Do the pages state the figures that the commands measure?

    python experiments/figures.py [--write] [--results DIR] [--commands NAME ...] [--list]
        [--json FILE] [--quick]

Runs the commands of `figures.toml`, on a machine that does nothing else, and compares their figures
with the words of the pages; --write writes them there, with the commit. Results are kept as
DIR/NAME.json, and a command whose result is there is not run again. --list runs nothing: it prints
each line of README.md and of the pages in `docs` that states a measure (a number with a unit) and
stands in no template of `figures.toml`, in no page that a script writes, and names no script.
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
# Written by scripts, or about what a user gives.
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
    """Words of a page with places for figures, and the measured value of each place.

    text    of the page, each place a name in braces
    places  name: the place in the JSON of the command, keys joined by "/", and a form of `format`
    """

    page: str
    text: str
    command: str
    places: dict[str, tuple[str, str]]

    @property
    def pattern(self) -> re.Pattern[str]:
        """A pattern that finds the words with any figures; each place is a group."""
        parts = PLACE.split(self.text)
        named = (
            f"(?P<{part}>\\S+?)" if number % 2 else re.escape(part)
            for number, part in enumerate(parts)
        )
        return re.compile("".join(named))

    def written(self, result: Any) -> dict[str, str]:
        """The figures of a result, by their place; "open" where an interval has no end."""
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
    """A value of JSON by its place."""
    for key in path.split("/"):
        result = result[int(key)] if isinstance(result, list) else result[key]
    return result


def result_of(name: str, row: Mapping[str, list[str]], options: argparse.Namespace) -> Any:
    """The JSON of a command, with its seconds and the commit that it ran at."""
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
    """Number of a page's figures that differ from a result; writes the results if asked to.

    Raises  SystemExit where the words do not stand in the page exactly once.
    """
    text = path.read_text(encoding="utf-8")
    matches = list(figure.pattern.finditer(text))
    if len(matches) != 1:
        raise SystemExit(
            f"{figure.page} must say once: {figure.text}; it does {len(matches)} times"
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
    """Lines that state a measure which no script writes, with page and number."""
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
