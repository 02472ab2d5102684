"""How long does each common command take, until its first line and to its end?

Runs commands of `startrack` on shipped designs, and on an engineer's designs if STARTRACK_DATA has
`field/engineer`, each in a separate process, with compiled kernels. Times are wall-clock times, for
an idle processor; `cpu_s` is also given, and `peak_mb`, the largest memory of the process (1 MB =
1e6 bytes). `--parts` measures some of:

    commands  `first_line_s`, `whole_s`, `cpu_s`, `peak_mb` by command, the worst over the designs,
              without kept results; `again_cpu_s` for a second call on the same design
    forecast  `forecast_s`: CPU seconds of one forecast of the nanosatellite in all of its
              conditions, with 20 units and without, while the exposure changes
    windows   `window_plan_s`: CPU seconds of the plan of window trials by number of pixels, and the
              exponent of their growth, `window_plan_exponent`

    python experiments/in_seconds.py [--json FILE] [--parts PART ...] [--quick]
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np

from startrack import Fidelity, load_design, run_trials, shipped
from startrack.design import replaced
from startrack.optimise import expected_objective

PARTS = ("commands", "forecast", "windows")
DESIGNS = ("noise_only", "high_accuracy", "nanosatellite")
CHANGES = 5  # changes of the exposure; the median counts
SIDES = (512, 1024, 2048)  # pixel, sides of frames for window plans
MB = 1e6


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, metavar="PART")
    options = command.read(parser)
    figures: dict[str, Any] = {}
    if "commands" in options.parts:
        figures |= commands(options.quick)
    if "forecast" in options.parts:
        figures["forecast_s"] = forecasts(options.quick)
    if "windows" in options.parts:
        figures |= window_plans(options.quick)
    for name, value in figures.items():
        print(f"{name}: {value}")
    command.save(options, figures, partial=set(options.parts) < set(PARTS))


def commands(quick: bool) -> dict[str, dict[str, float]]:
    """The figures of each command, worst over the designs."""
    figures: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["STARTRACK_CACHE"] = str(Path(folder) / "cache")
        for name, words in calls(quick):
            out = ["--out", str(Path(folder) / "out")] if "--out" in name else []
            if not quick:
                clocked([*words, *out])  # compiles kernels and builds indexes of stars
            for file in Path(folder).glob("cache/result-*"):
                file.unlink()
            clocks = clocked([*words, *out])
            clocks["again_cpu_s"] = clocked([*words, *out])["cpu_s"]
            for figure, value in clocks.items():
                of_commands = figures.setdefault(figure, {})
                of_commands[name] = max(value, of_commands.get(name, 0.0))
            print(name, Path(words[1]).name, flush=True)
    return figures


def calls(quick: bool) -> Iterator[tuple[str, list[str]]]:
    """Names and arguments of the commands, on each design."""
    if quick:
        yield "requirements", ["requirements", str(shipped("designs/noise_only.toml"))]
        return
    engineer = Path(os.environ.get("STARTRACK_DATA", "")) / "field" / "engineer"
    designs = [str(shipped(f"designs/{name}.toml")) for name in DESIGNS]
    own = [engineer / "imx16.toml"] if (engineer / "imx16.toml").is_file() else []
    for design in [*designs, *map(str, own)]:
        yield "requirements", ["requirements", design]
        yield "budget", ["budget", design]
        yield "budget --out", ["budget", design]
    missions = [str(shipped("missions/sun-synchronous.toml"))]
    missions += (
        [str(engineer / "mission.toml"), str(engineer / "mission-imx16.toml")] if own else []
    )
    for mission in missions:
        yield "mission --out", ["mission", mission]
    yield "optimize --out", ["optimize", str(shipped("designs/noise_only.toml"))]


def clocked(words: list[str]) -> dict[str, float]:
    """Seconds until the first line and to the end, CPU seconds and megabytes of one command."""
    began = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-m", "startrack.cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        first = time.perf_counter() - began
        process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 3):  # 3: a requirement is not met
        raise SystemExit(f"startrack {' '.join(words)} ended with {process.returncode}")
    return {
        "first_line_s": first,
        "whole_s": time.perf_counter() - began,
        "cpu_s": used.ru_utime + used.ru_stime,
        "peak_mb": used.ru_maxrss * 1024 / MB,
    }


def forecasts(quick: bool) -> dict[str, float]:
    """CPU seconds of a forecast of the nanosatellite, with 20 units and without."""
    design = load_design(shipped(f"designs/{'noise_only' if quick else 'nanosatellite'}.toml"))
    campaign = design.campaign
    assert campaign is not None
    seconds, exposure = {}, design.case.instrument.detector.exposure
    for name, changed in (
        ("20 units", replace(campaign, unit_count=20)),
        ("without units", replace(campaign, units=None)),
    ):
        spent = []
        for _ in range(2 if quick else 1 + CHANGES):
            exposure *= 0.999
            case = replaced(design.case, "instrument.detector.exposure", exposure)
            began = time.process_time()
            expected_objective(case, changed)
            spent.append(time.process_time() - began)
        seconds[name] = float(np.median(spent[1:]))
    return seconds


def window_plans(quick: bool) -> dict[str, Any]:
    """CPU seconds of the first window trial over those of the second, by pixels of the frame."""
    case, seconds = load_design(shipped("designs/noise_only.toml")).case, dict[int, float]()
    sides = (64, 96, 128) if quick else (SIDES[0] // 2, *SIDES)
    for side in sides:  # the first compiles
        wide = replaced(case, "instrument.detector.columns", side)
        wide = replaced(wide, "instrument.detector.rows", side)
        spent = []
        for trial in (0, 1):
            began = time.process_time()
            run_trials(wide, 1, range(trial, trial + 1), Fidelity.WINDOW)
            spent.append(time.process_time() - began)
        if side > sides[0]:
            seconds[side * side] = spent[0] - spent[1]
    pixels, plans = np.log([*seconds]), np.log(np.maximum([*seconds.values()], 1e-3))
    growth = np.polyfit(pixels, plans, 1)[0]
    named = {str(pixel): plan for pixel, plan in seconds.items()}
    return {"window_plan_s": named, "window_plan_exponent": float(growth)}


if __name__ == "__main__":
    command.run(main)
