"""How does startrack handle cases in which similar programs fail?

The cases are listed in `tests/hard`, and also run as tests.

    python experiments/hard_cases.py [--markdown FILE] [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import command

from startrack.benchmark import versions


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--markdown", type=Path, metavar="FILE")
    options = command.read(parser)
    cases = import_module("tests.hard").CASES
    rows = [tried(case) for case in (cases[::40] if options.quick else cases)]
    text = table(rows)
    print(text)
    if options.markdown:
        options.markdown.write_text(text, encoding="utf-8")
    command.save(options, rows)


def tried(case: Any) -> dict[str, Any]:
    """One row: the result and its time."""
    began = time.process_time()
    came = case.try_()
    return {
        "room": case.room,
        "case": case.name,
        "expected": case.told,
        "came": came,
        "as_expected": bool(case.holds(came)),
        "fault": case.fault,
        "seconds": time.process_time() - began,
    }


def table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "# Hard cases",
        "",
        f"{command.source('hard_cases.py')}, {versions()}; {len(rows)} cases, "
        f"{sum(row['as_expected'] for row in rows)} as expected. They are tests as well.",
        "",
        "| package | case | expected | found | |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        came = row["came"] if isinstance(row["came"], str) else f"{row['came']:.3g}"
        mark = "" if row["as_expected"] else f"**no**: {row['fault']}"
        cells = (row["room"], row["case"], row["expected"], came, mark)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    command.run(main)
