"""Run the blocks of the tutorials; compare, or update, their output and pictures.

    python docs/run_tutorial.py            prints where a page differs from the output
    python docs/run_tutorial.py --write    writes output and pictures into the pages
    python docs/run_tutorial.py tutorial-earth.md    of one page alone

All blocks of a page use one folder. A block `toml NAME` becomes a file. A block `sh` has commands,
which must end with exit status 0 unless a comment names another. A block `python` is run. A block
`text` quotes the output of the block before it. Its words must be equal. Its numbers must agree
within the fraction that the block names (`text 30%`), or within one unit of the last digit. Three
dots stand for omitted lines. A picture `tutorial/NAME` is the file NAME of that folder.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from startrack.cli import main as startrack_command

PAGES = tuple(Path(__file__).parent / name for name in ("tutorial.md", "tutorial-earth.md"))
BLOCK = re.compile(r"```(toml|sh|python|text)(?: (\S+))?\n(.*?)```", re.DOTALL)
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
STATUS = re.compile(r"# exit status (\d)")
PICTURE = re.compile(r"\]\(tutorial/([\w/.-]+)\)")
LEFT_OUT = "..."


class Told(NamedTuple):
    """A block that quotes output, and the lines of the output.

    span      first and last character of the quoted text in the page
    fraction  largest relative difference of its numbers
    """

    span: tuple[int, int]
    quoted: list[str]
    came: list[str]
    fraction: float


def walk(page: str, folder: Path) -> list[Told]:
    """Run all blocks of a page in a folder, in their order.

    Raises  AssertionError where a command ends with another exit status than the page says.
    """
    told = []
    came = ""
    names: dict[str, Any] = {"__name__": "tutorial"}
    with contextlib.chdir(folder):
        for block in BLOCK.finditer(page):
            kind, word, text = block.groups()
            if kind == "text":
                fraction = float(word.rstrip("%")) / 100 if word else 0.0
                told.append(Told(block.span(3), text.splitlines(), came.splitlines(), fraction))
            elif kind == "toml":
                Path(word).write_text(text, encoding="utf-8")
            else:
                with contextlib.redirect_stdout(io.StringIO()) as printed:
                    _run(text) if kind == "sh" else exec(compile(text, "tutorial", "exec"), names)
                came = printed.getvalue()
    return told


def _run(commands: str) -> None:
    for line in commands.splitlines():
        words = shlex.split(line, comments=True)
        assert words[0] == "startrack", line
        expected = STATUS.search(line)
        status = startrack_command(words[1:])
        assert status == (int(expected[1]) if expected else 0), f"{line}: exit status {status}"


def faults(told: Told) -> list[str]:
    """Quoted lines that the commands did not print."""
    found = []
    for quoted, came in pairs(told):
        if came is None:
            found.append(f"did not come: {quoted}")
        elif not alike(quoted, came, told.fraction):
            found.append(f"quoted: {quoted}\n   came: {came}")
    return found


def pairs(told: Told) -> Iterator[tuple[str, str | None]]:
    """Each quoted line with the one that came in its place, None where there is none."""
    rest = iter(told.came)
    skipping = False
    for line in told.quoted:
        if line == LEFT_OUT:
            skipping = True
            continue
        came = next(rest, None)
        while skipping and came is not None and words_of(came) != words_of(line):
            came = next(rest, None)
        yield line, came
        skipping = False
    surplus = next(rest, None)
    if surplus is not None and not skipping:
        yield "", surplus


def words_of(line: str) -> list[str]:
    """Words of a line, with a mark in place of each number; spaces do not count."""
    return NUMBER.sub("#", line).split()


def alike(quoted: str, came: str, fraction: float) -> bool:
    """Whether two lines have the same words, and numbers that differ by no more than a fraction."""
    if words_of(quoted) != words_of(came):
        return False
    return all(
        abs(float(one) - float(other)) <= fraction * abs(float(one)) + 1.01 * _last_digit(one)
        for one, other in zip(NUMBER.findall(quoted), NUMBER.findall(came), strict=True)
    )


def _last_digit(number: str) -> float:
    """
    >>> _last_digit("-2.50"), _last_digit("17")
    (0.01, 1.0)
    """
    mantissa, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))


def rewritten(page: str, told: Sequence[Told]) -> str:
    """The page with what came in the place of what it quotes."""
    for one in reversed(told):
        came = (line if new is None else new for line, new in pairs(one))
        lines = [line if line == LEFT_OUT else next(came) for line in one.quoted]
        page = page[: one.span[0]] + "".join(f"{line}\n" for line in lines) + page[one.span[1] :]
    return page


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="update the page and its pictures")
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="names of pages (default: all)")
    options = parser.parse_args()
    known = [path.name for path in PAGES]
    for name in options.pages:
        if name not in known:
            parser.error(f"PAGE must be one of {', '.join(known)}, got {name}")
    wrong = False
    for path in PAGES:
        if not options.pages or path.name in options.pages:
            found = _walk_page(path, options.write)
            print(f"{path.name}: " + ("\n".join(found) or "the page agrees with the output"))
            wrong = wrong or bool(found)
    return 1 if wrong and not options.write else 0


def _walk_page(path: Path, write: bool) -> list[str]:
    """Faults of a page, which is updated where that is asked for."""
    page = path.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        told = walk(page, Path(folder))
        if write:
            path.write_text(rewritten(page, told), encoding="utf-8")
            for name in PICTURE.findall(page):
                target = path.parent / "tutorial" / name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(Path(folder, name), target)
    return [fault for one in told for fault in faults(one)]


if __name__ == "__main__":
    sys.exit(main())
