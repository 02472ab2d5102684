"""Which figures on the pages are still valid?

python experiments/all.py [NAME ...] [--results DIR] [--judge] [--markdown FILE.md] [--json FILE]
                          [--quick]

Runs every experiment that has expectations (`expected.toml`), or those named, one after the other;
all take hours. Their figures are stored as DIR/NAME.json. One table is printed: figure, claim,
value, expected range, and the commit at which the claim was measured. --judge runs nothing and
reads the stored figures. The status is 1 where a figure is outside its range, or is missing.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import command

HERE = Path(__file__).parent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    names = list(tomllib.loads(command.EXPECTED.read_text(encoding="utf-8")))
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="experiments to run (default: all)"
    )
    parser.add_argument("--results", type=Path, default=Path("experiment-results"))
    parser.add_argument("--judge", action="store_true", help="judge stored figures; run nothing")
    parser.add_argument("--markdown", type=Path, help="file for the table, in Markdown")
    with tempfile.TemporaryDirectory() as folder:
        options = command.read(parser, names=["frame_picture"], results=Path(folder))
        if unknown := set(options.names) - set(names):
            parser.error(f"no expectations are stated for {', '.join(sorted(unknown))}")
        rows = list[command.Judged]()
        table = ["| experiment | figure | claimed | found | expected | measured at | holds |"]
        table += ["|---|---|---|---|---|---|---|"]
        for name in options.names or names:
            for row in _judged(name, options):
                rows.append(row)
                table.append(_line(name, row))
    text = "\n".join(table)
    print(text)
    if options.markdown:
        options.markdown.write_text(text + "\n", encoding="utf-8")
    holding = sum(row.holds for row in rows)
    print(f"{holding} of {len(rows)} figures are as expected")
    command.save(options, {"figures": len(rows), "holding": holding})
    if holding < len(rows) and not options.quick:
        sys.exit(1)


def _judged(name: str, options: argparse.Namespace) -> list[command.Judged]:
    """The figures of one experiment; it is run unless its figures are only judged."""
    path = options.results / f"{name}.json"
    if not options.judge:
        options.results.mkdir(parents=True, exist_ok=True)
        words = [sys.executable, str(HERE / f"{name}.py"), "--json", str(path)]
        subprocess.run([*words, *(["--quick"] if options.quick else [])], check=False)
    figures: object = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return command.judge(name, figures)


def _line(name: str, row: command.Judged) -> str:
    expectation = row.expectation
    claim = "" if expectation.claim is None else f"{expectation.claim:g} ({expectation.page})"
    value = "missing" if row.value is None else f"{row.value:.4g}"
    holds = "yes" if row.holds else "NO"
    return (
        f"| {name} | {row.place} | {claim} | {value} | {expectation.range} "
        f"| {expectation.commit} | {holds} |"
    )


if __name__ == "__main__":
    command.run(main)
