"""Writes for flown.py: the page on flown cameras, misses first, from figures alone."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

HEAD, NOTES = (
    Path(__file__).with_suffix(".md").read_text(encoding="utf-8").split("<!-- notes -->\n")
)
ROW = "| {name} | {median:.4g} | {low_68:.4g} to {high_68:.4g} | {low_90:.4g} to {high_90:.4g} |"


def held(row: dict[str, Any], value: float, level: int) -> bool:
    """Whether an interval contains a value."""
    return bool(row[f"low_{level}"] <= value <= row[f"high_{level}"])


def misses(row: dict[str, Any], value: float) -> float:
    """Distance of a value from the middle of the 90 % interval, in half widths."""
    middle = (row["high_90"] + row["low_90"]) / 2
    half = max((row["high_90"] - row["low_90"]) / 2, 1e-12)
    return abs(value - middle) / half


def text_of(
    frozen: dict[str, Any], results: dict[str, Any] | None, second: dict[str, float], source: str
) -> str:
    """The page.

    frozen   contents of `predictions.json`
    results  contents of `results.json`; None: not opened
    second   contents of `second.json`: predictions after the data were opened
    """
    table = frozen["figures"]
    head = {key: frozen[key] for key in ("commit", "version", "seed", "draws")}
    text = HEAD.format(source=source, count=len(table), **head)
    if results is None:
        text += "\n**The results are not opened yet.**\n\n"
        text += "| figure | median | 68 % | 90 % | what makes it wide |\n|---|---|---|---|---|\n"
        for name, row in table.items():
            text += f"{ROW.format(name=name, **row)} {row['wide']} |\n"
    else:
        text += scored(table, results["figures"], second)
    text += "\n**Cannot be predicted**\n"
    for name, why in frozen["cannot"].items():
        text += f"- {name}: {why}.\n"
    text += "\nDark current of a pixel in the model of BRITE's CCD, electron/s (median, "
    text += "factor of 68 %): "
    text += "; ".join(
        f"{celsius} degC {median:g} ({factor:g})"
        for celsius, (median, factor) in frozen["dark"].items()
    )
    return text + ".\n"


def shares(table: dict[str, Any], seen: dict[str, Any]) -> dict[int, float]:
    """Fraction of the figures with a result that intervals of 68, 90 and 95 % contain."""
    known = {name: row["value"] for name, row in seen.items() if name in table}
    return {
        level: sum(held(table[name], value, level) for name, value in known.items()) / len(known)
        for level in (68, 90, 95)
    }


def scored(table: dict[str, Any], results: dict[str, Any], second: dict[str, float]) -> str:
    """Fractions, and all figures with measured values, misses first."""
    seen = {name: row["value"] for name, row in results.items() if name in table}
    text = (
        f"\nOf {len(seen)} figures with a result, intervals of 68, 90 and 95 % contain "
        "fractions of "
    )
    text += ", ".join(f"{share:.2f}" for share in shares(table, results).values())
    text += "; by camera (90 %): "
    text += ", ".join(
        f"{camera} {sum(held(table[name], seen[name], 90) for name in own)} of {len(own)}"
        for camera, own in by_camera(seen).items()
    )
    text += ".\n\n" + NOTES
    order = sorted(seen, key=lambda name: -misses(table[name], seen[name]))
    outside = [name for name in order if not held(table[name], seen[name], 90)]
    for title, names in (
        ("Outside the interval of 90 %, largest deviation first", outside),
        ("Inside", [name for name in table if name in seen and name not in outside]),
    ):
        text += f"\n**{title}**\n\n"
        text += (
            "| figure | measured | median | 68 % | 90 % | measured / median | second prediction |\n"
        )
        text += "|---|---|---|---|---|---|---|\n"
        for name in names:
            row, value = table[name], seen[name]
            ratio = value / row["median"] if row["median"] else math.nan
            line = ROW.format(name=name, **row).split(" | ", 1)
            after = f"{second[name]:.4g}" if name in second else ""
            text += f"{line[0]} | {value:.4g} | {line[1]} {ratio:.3g} | {after} |\n"
    without = [
        f"{name} ({row['median']:.3g}, {row['low_90']:.3g} to {row['high_90']:.3g})"
        for name, row in table.items()
        if name not in seen
    ]
    return text + "\n**Without a result** (median, 90 %): " + ", ".join(without) + ".\n"


def by_camera(seen: dict[str, Any]) -> dict[str, list[str]]:
    """The figures of each camera."""
    cameras = {"T": "TIM", "E": "EBEX", "u": "UniBRITE", "h": "BRITE-Heweliusz", "G": "TESS"}
    return {
        camera: own
        for letter, camera in cameras.items()
        if (own := [name for name in seen if name[0] == letter])
    }
