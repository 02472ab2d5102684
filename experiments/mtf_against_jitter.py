"""How sharp should the optics be if the bus shakes? Blur and exposure at each jitter, by budget.

python experiments/mtf_against_jitter.py --json FILE [--picture FILE.png]

Krutz et al. (2011), section 4, name the jitter of the bus and the optical MTF as what a star
sensor's design trades. For each rms of a 40 Hz tone the blur of the optics is tuned; the error of
the tuned design and of the sharpest and of the most blurred optics are then compared by trials.
The truth is the attitude in the middle of the exposure, so that the jitter is itself an error.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from startrack.case import Case, Fidelity
from startrack.catalog import shipped
from startrack.design import load_design
from startrack.motion import Tone
from startrack.study.bench import Bench
from startrack.study.box import Box, Variable
from startrack.study.evaluate import forecast
from startrack.study.objective import Objective
from startrack.study.search import Search, least
from startrack.units import arcsec, um

JITTER = (0.0, 0.3, 1.0, 5.0)  # arcsec rms about x and y
FREQUENCY = 40.0  # Hz
BLUR = Variable("instrument.optics.blur", "1 um", "15 um")
RMS = Objective()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--trials", type=int, default=200)
    options = parser.parse_args()
    bench, rows = Bench(1), []
    for jitter in JITTER:
        rows.append(tuned(jitter, bench, options.trials))
        print(json.dumps(rows[-1]), flush=True)
    options.json.write_text(json.dumps({"mtf_against_jitter": rows}, indent=1) + "\n")
    if options.picture:
        draw(rows, options.picture, options.trials)


def shaken(jitter: float) -> Case:
    """The example design on a bus that shakes."""
    case = load_design(shipped("designs/nanosatellite.toml")).case
    tone = Tone(FREQUENCY, jitter * arcsec, jitter * arcsec, lead_y=-math.pi / 2)
    motion = dataclasses.replace(case.instrument.motion, tones=(tone,))
    return dataclasses.replace(case, instrument=dataclasses.replace(case.instrument, motion=motion))


def tuned(jitter: float, bench: Bench, trials: int) -> dict[str, Any]:
    """The blur that the budget finds best, and trials there and at both ends."""
    box = Box(shaken(jitter), (BLUR,))

    def score(place: np.ndarray[Any, np.dtype[np.float64]]) -> float:
        return math.log(forecast(box.design(place), RMS))

    found = least(score, box.start, Search(evaluations=18, first_step=0.2, last_step=0.01))
    row: dict[str, Any] = {"jitter_arcsec": jitter}
    row["best_blur_um"] = box.values(found.place)[BLUR.name] / um
    row["expected_arcsec"] = math.exp(found.score) / arcsec
    for name, place in (("sharp", np.zeros(1)), ("best", found.place), ("blurred", np.ones(1))):
        squares = RMS.squares(bench.run(box.design(place), trials, Fidelity.WINDOW))
        ratio = RMS.ratio(squares, np.ones(len(squares)), bench.seed)
        row[f"{name}_arcsec"] = [one / arcsec for one in (ratio.value, ratio.low, ratio.high)]
        row[f"{name}_availability"] = float(np.isfinite(squares).mean())
    return row


def draw(rows: list[dict[str, Any]], path: Path, trials: int) -> None:
    figure = Figure(figsize=(6.5, 4), layout="constrained")
    axes = figure.subplots()
    jitter = [row["jitter_arcsec"] for row in rows]
    for name, colour in (("sharp", "#3567a8"), ("best", "#2e7d5b"), ("blurred", "#c0392b")):
        value, low, high = np.transpose([row[f"{name}_arcsec"] for row in rows])
        label = {"sharp": "blur 1 um", "best": "tuned blur", "blurred": "blur 15 um"}[name]
        bars = [value - low, high - value]
        axes.errorbar(jitter, value, bars, fmt="o-", ms=4, capsize=3, color=colour, label=label)
    for x, row in zip(jitter, rows, strict=True):
        place = (x, row["best_arcsec"][0])
        axes.annotate(f"{row['best_blur_um']:.1f} um", place, (4, -10), fontsize=7,
                      textcoords="offset points")  # fmt: skip
    axes.set(xlabel=f"jitter at {FREQUENCY:g} Hz (arcsec rms about x and y)", yscale="log",
             ylabel="rms error across (arcsec)")  # fmt: skip
    axes.set_title(f"{trials} window trials a point, 95 % intervals", fontsize=9, loc="left")
    axes.legend(fontsize=8)
    figure.savefig(path)


if __name__ == "__main__":
    main()
