"""Rows of stages -> a table in Markdown, and the same as plain values."""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from startrack.benchmark.stage import Row, Stage

PACKAGES = ("startrack", "numpy", "scipy", "numba", "opencv-contrib-python-headless")
UNITS = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))


def markdown(stages: Sequence[Stage], rows: Sequence[Row]) -> str:
    """One table a stage under its work; ours are bold."""
    text = []
    for stage in stages:
        limit = f", limit {figure(stage.limit)} ({stage.limit_of})" if stage.limit_of else ""
        text += [f"### {stage.name}", f"{stage.work}; error: {stage.error}{limit}.", ""]
        text += ["| way | CPU time | error |", "|---|---|---|"]
        for row in rows:
            if row.stage == stage.name:
                way = row.way if row.peer else f"**{row.way}**"
                text.append(f"| {way} | {spent(row.seconds)} | {figure(row.error)} |")
        text += ["", *([f"Left out: {stage.missing}.", ""] if stage.missing else [])]
    return "\n".join(text)


def values(stages: Sequence[Stage], rows: Sequence[Row]) -> dict[str, Any]:
    """What the table says, for machines; times in seconds."""
    return {
        stage.name: {
            "work": stage.work,
            "error": stage.error,
            "limit": stage.limit,
            "limit_of": stage.limit_of,
            "missing": stage.missing,
            "ways": {
                row.way: {"seconds": row.seconds, "error": row.error, "peer": row.peer}
                for row in rows
                if row.stage == stage.name
            },
        }
        for stage in stages
    }


def versions(packages: Sequence[str] = ()) -> str:
    """Python, processor and packages of this run; those that are not installed are left out."""
    found = [f"Python {platform.python_version()}", platform.machine()]
    for package in (*PACKAGES, *packages):
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def figure(value: float) -> str:
    """Two digits, `-` for what is unknown."""
    return f"{value:.2g}" if math.isfinite(value) else "-"


def spent(seconds: float) -> str:
    """Three digits of the unit that suits."""
    unit, size = next((u for u in UNITS if seconds >= u[1]), UNITS[-1])
    return f"{seconds / size:.3g} {unit}"
