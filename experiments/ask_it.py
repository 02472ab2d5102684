"""Do sweeps agree with single commands, solved limits with dense sweeps, and do searches improve?

    python experiments/ask_it.py [--json FILE] [--markdown FILE.md] [--designs NAME ...]
                                 [--trials N] [--points N] [--searches N]

sweep_same       1 if each figure of `startrack sweep` is, byte for byte, that of `requirements` and
                 `montecarlo` with the same --set
solve_for_error  worst relative difference of `startrack solve-for` from a dense sweep on the same
                 skies and noise, whose error is interpolated
inside           1 if each value of the dense sweep lies in the interval of `solve-for`
move_ms_95, search_visible_s, saved_same, offline, page_lines
                 of `startrack page` in a headless Chromium, see page_in_browser.py; without a
                 Chromium they are left out, and a sentence says so
worse_best       number of searches of `startrack optimize` whose best design is worse than the
                 start: it misses a limit that the start keeps, or has a larger error on fresh
                 trials
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import command
import numpy as np
import page_in_browser

from startrack import arcsec, shipped, solve_for, sweep
from startrack.cli import main as startrack
from startrack.io import save_text

VALUES = {
    "instrument.optics.f_number": ("1.3", "1.7", "2.2"),
    "instrument.detector.exposure": ("50 ms", "200 ms"),
    "tracker.detection.centroid": ("gravity", "likelihood"),
}
# Fields of hot pixels, which the nanosatellite has, need windows.
FIDELITY = {"noise_only": "covariance", "nanosatellite": "window"}
BY_TRIALS = "across_rms_arcsec", "about_rms_arcsec", "availability", "availability_95"
# A key, its range, and a limit that is crossed in it.
LIMITS = (
    ("instrument.optics.f_number=1.2..3", "across=0.5 arcsec"),
    ("instrument.optics.f_number=1.2..3", "about=8 arcsec"),
    ("instrument.detector.exposure=20..400 ms", "across=0.6 arcsec"),
    ("instrument.optics.blur=3..40 um", "across=1 arcsec"),
)
NEAR = 0.06  # of a value, on each side, over which it is swept
TIGHT = (  # so that few designs keep the limits, and that none does
    "campaign.requirements.max_across=0.3 arcsec",
    "campaign.requirements.max_across=0.01 arcsec",
    "campaign.requirements.max_mass=0.2 kg",
)
SEARCH = (
    "analytic_evaluations=16",
    "evaluations=4",
    "trials=20",
    "most_trials=40",
    "fresh_trials=100",
    "fidelity=covariance",
)


def run(*words: str) -> dict[str, Any]:
    """The result of a command as JSON."""
    out = StringIO()
    with redirect_stdout(out):
        startrack([*words, "--json"])
    found: dict[str, Any] = json.loads(out.getvalue())
    return found


def same(design: str, key: str, values: tuple[str, ...], trials: int, folder: str) -> list[str]:
    """Differences between a sweep and single commands, by formula and by trials."""
    off = []
    for more in ([], ["--trials", str(trials), "--fidelity", FIDELITY[design]]):
        rows = run(
            "sweep", design, f"{key}={','.join(values)}", *more, "--workers", "1", "--out", folder
        )["rows"]
        for value, row in zip(values, rows, strict=True):
            change = ["--set", f"{key}={value}"]
            if more:
                single = run("montecarlo", design, *change, *more, "--workers", "1")
                pairs = {name: single[name] for name in BY_TRIALS}
            else:
                single = run("requirements", design, *change)
                pairs = {f"margin: {name}": value for name, value in single["margins"].items()}
                pairs |= {"mass (kg)": single["mass_kg"], "power (W)": single["power_w"]}
            off += [
                f"{design} {key}={value} {name}: {row[name]}, alone {number}"
                for name, number in pairs.items()
                if json.dumps(row[name]) != json.dumps(number)
            ]
    return off


def crossings(design: str, key: str, limit: str, trials: int, points: int) -> list[dict[str, Any]]:
    """Each value of `solve_for`, with its interval, beside that of a dense sweep."""
    path, name = shipped(f"designs/{design}.toml"), key.partition("=")[0]
    found, axis = solve_for(path, key, limit, trials=trials), limit.partition("=")[0]
    most = float(limit.partition("=")[2].split()[0])
    rows = []
    for crossing in found.crossings:
        value = crossing.value
        assert not isinstance(value, float | int)
        unit = found.key.unit
        low, high = (1 - NEAR) * value.value, (1 + NEAR) * value.value
        dense = sweep(
            path, f"{name}={low!r}..{high!r} {unit}".strip(), points=points, trials=trials
        )
        error = np.log(dense.table[axis] / arcsec / most)
        order = np.argsort(error)
        at = float(np.interp(0.0, error[order], np.array(dense.keys[0].numbers)[order]))
        rows.append(
            {
                "key": name,
                "limit": limit,
                "solve_for": [value.value, value.low, value.high],
                "by_formula": crossing.formula,
                "dense": at,
                "unit": unit,
            }
        )
    return rows


def worse(design: str, changes: tuple[str, ...], seed: int, folder: str) -> bool:
    """Whether the best design of a search is worse than the start."""
    words = [word for change in changes for word in ("--set", change)]
    found = run("optimize", design, *words, "--seed", str(seed), "--workers", "1", "--out", folder)
    start = run("requirements", design, *words)
    larger = found["factor"] < 1 and not found["start_stays"]
    return bool(larger and (start["met"] or not found["feasible"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", nargs="+", default=[*FIDELITY], choices=[*FIDELITY])
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument(
        "--points", type=int, default=13, help="number of values of the dense sweep"
    )
    parser.add_argument(
        "--limits", type=int, default=len(LIMITS), help="number of limits to solve for"
    )
    parser.add_argument(
        "--searches", type=int, default=2, help="number of searches for each tight requirement"
    )
    parser.add_argument(
        "--moves", type=int, default=200, help="number of moves of the page's sliders"
    )
    parser.add_argument("--markdown", type=Path)
    quick: dict[str, Any] = {"trials": 8, "points": 3, "limits": 1, "searches": 0, "moves": 0}
    options = command.read(parser, designs=["noise_only"], **quick)
    values = VALUES
    if options.quick:
        values = {key: some[:1] for key, some in list(VALUES.items())[:1]}
    off, lines = list[str](), list[str]()
    with tempfile.TemporaryDirectory() as folder:
        for design in options.designs:
            for key, some in values.items():
                off += same(design, key, some, options.trials, f"{folder}/{design}{key}")
        lost = [
            worse(
                "noise_only",
                (limit, *(f"campaign.{way}" for way in SEARCH)),
                seed,
                f"{folder}/{n}{seed}",
            )
            for n, limit in enumerate(TIGHT)
            for seed in range(1, options.searches + 1)
        ]
    print("\n".join(off) or "each figure of the sweeps is that of a single command")
    rows = [
        row
        for key, limit in LIMITS[: options.limits]
        for row in crossings("noise_only", key, limit, options.trials, options.points)
    ]
    lines = ["| key | limit | solve-for | by formula | dense sweep |", "|---|---|---|---|---|"]
    for row in rows:
        value, low, high = row["solve_for"]
        lines.append(
            f"| {row['key']} | {row['limit']} | {value:.4g} [{low:.4g}, {high:.4g}] {row['unit']} "
            f"| {row['by_formula']:.4g} | {row['dense']:.4g} |"
        )
    text = "\n".join(lines)
    print(text)
    if options.markdown:
        save_text(options.markdown, text + "\n")
    errors = [abs(row["solve_for"][0] / row["dense"] - 1) for row in rows]
    command.save(
        options,
        {
            "sweep_same": int(not off),
            "solve_for_error": max(errors, default=math.nan),
            "inside": int(
                all(row["solve_for"][1] <= row["dense"] <= row["solve_for"][2] for row in rows)
            ),
            "worse_best": sum(lost),
            "searches": len(lost),
            "values": rows,
            **page_in_browser.figures(options.designs, options.moves),
        },
    )


if __name__ == "__main__":
    command.run(main)
