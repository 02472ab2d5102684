"""How sharp should the optics be under jitter of the spacecraft? The error over the optical MTF, by
jitter.

python experiments/mtf_against_jitter.py [--json FILE] [--picture FILE.png] [--trials 200] [--quick]

Krutz et al. (2011), section 4, name the jitter of the spacecraft and the optical MTF as the
trade-off of a star sensor's design. For each rms of the jitter the example design has trials with
several blurs of the optics, on the same skies and noise; the best blur is the minimum of the
parabola through the three least errors. 95 % intervals are from resampled trials.

The tones are zero at the middle of the exposure, where the attitude is thus the mean. The remaining
effect of jitter is blur, which depends on the optics. The attitude at an instant also has the error
`jitter_rms`, which does not depend on the optics.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import command
import numpy as np

from startrack import Case, Fidelity, arcsec, deg, load_design, shipped, um
from startrack.core import Floats
from startrack.design import Objective, replaced
from startrack.motion import Tone, jitter_rms
from startrack.observation import psf_of
from startrack.optimise import TrialRunner
from startrack.plots import CYCLE, MARKERS, legend_below, picture, save_picture, styled

JITTER = (0.0, 10.0, 20.0, 40.0)  # arcsec rms about x and y; a pixel spans 65
FREQUENCIES = (40.0, 60.0)  # Hz, about x and y
BLURS = np.array([3.0, 4.0, 5.0, 6.0, 7.5, 9.5, 12.0]) * um
RMS = Objective()
RESAMPLES = 1000
COLOURS = ("#2e7d5b", "#3567a8", "#d08a2e", "#c0392b")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--trials", type=int, default=200)
    options = command.read(parser, trials=3)
    runner, rows, blurs = TrialRunner(1), [], BLURS[: 3 if options.quick else None]
    for jitter in JITTER[:1] if options.quick else JITTER:
        rows.append(traded(shaken(jitter * arcsec), blurs, runner, options.trials))
        rows[-1] = {"jitter_arcsec": jitter} | rows[-1]
        print(json.dumps(rows[-1]), flush=True)
    command.save(options, {"mtf_against_jitter": rows})
    if options.picture:
        draw(rows, options.picture, options.trials)


def shaken(rms: float) -> Case:
    """The example design on a spacecraft with jitter."""
    case = load_design(shipped("designs/noise_only.toml")).case
    about_x, about_y = FREQUENCIES
    tones = (
        Tone(about_x, rms_x=rms, phase=-90 * deg),
        Tone(about_y, rms_y=rms, phase=0.0, lead_y=-90 * deg),
    )
    return replaced(case, "instrument.motion.tones", tones)


def traded(case: Case, blurs: Floats, runner: TrialRunner, trials: int) -> dict[str, Any]:
    """The error and the optical MTF of each blur, and the best blur."""
    designs = [replaced(case, "instrument.optics.blur", blur) for blur in blurs]
    squares = np.array([RMS.squares(runner.run(one, trials, Fidelity.WINDOW)) for one in designs])
    rng = np.random.default_rng(runner.seed)
    drawn = [RMS.of(squares[:, rng.integers(0, trials, trials)]) for _ in range(RESAMPLES)]
    error = RMS.of(squares)
    detector = case.instrument.detector
    return {
        "blur_um": (blurs / um).tolist(),
        "mtf": [optical_mtf(one) for one in designs],
        "error_arcsec": (error / arcsec).tolist(),
        "error_95": (np.quantile(drawn, [0.025, 0.975], axis=0) / arcsec).tolist(),
        "availability": np.isfinite(squares).mean(axis=1).tolist(),
        "best_blur_um": lowest(error, blurs) / um,
        "best_blur_95": (
            np.quantile([lowest(each, blurs) for each in drawn], [0.025, 0.975]) / um
        ).tolist(),
        "wander_arcsec": (
            jitter_rms(case.instrument.motion, detector.exposure)[:2] / arcsec
        ).tolist(),
    }


def optical_mtf(case: Case) -> float:
    """The MTF of lens, blur and pixel at half a cycle per pixel, from the rendered PSF."""
    psf = psf_of(case.instrument)
    across = (np.arange(len(psf.table)) - len(psf.table) // 2) / psf.oversampling
    return float(abs(psf.table.sum(axis=0) @ np.exp(-1j * np.pi * across)) / psf.table.sum())


def lowest(error: Floats, blurs: Floats) -> float:
    """Minimum of the parabola through the three lowest neighbours, in logarithms, metre."""
    at = int(np.clip(np.argmin(error), 1, len(error) - 2))
    near = slice(at - 1, at + 2)
    bend, slope, _ = np.polyfit(np.log(blurs[near]), np.log(error[near]), 2)
    least = -slope / (2 * bend) if bend > 0 else np.log(blurs[np.argmin(error)])
    return float(np.exp(np.clip(least, np.log(blurs[0]), np.log(blurs[-1]))))


@styled
def draw(rows: list[dict[str, Any]], path: Path, trials: int) -> None:
    """The error over the blur, with the optical MTF on the upper axis, and the best blur for each
    jitter."""
    figure = picture(5.6, f"{trials} window trials a point, 95 % intervals; bands: the best blur")
    axes = figure.subplots()
    for row, colour, mark in zip(rows, CYCLE, MARKERS, strict=False):
        blur, error = np.array(row["blur_um"]), np.array(row["error_arcsec"])
        low, high = row["error_95"]
        low_blur, high_blur = row["best_blur_95"]
        label = (
            f"{row['jitter_arcsec']:g} arcsec: best {row['best_blur_um']:.1f} um "
            f"[{low_blur:.1f}, {high_blur:.1f}]"
        )
        axes.errorbar(
            blur,
            error,
            [error - low, high - error],
            fmt=f"{mark}-",
            ms=4,
            capsize=3,
            color=colour,
            label=label,
        )
        axes.axvspan(low_blur, high_blur, color=colour, alpha=0.15, lw=0)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="rms blur of the optics (um)",
        ylabel="rms error across (arcsec)",
    )
    axes.set_xticks(blur, [f"{one:g}" for one in blur])
    axes.minorticks_off()
    above = axes.secondary_xaxis("top")
    above.set_xticks(blur, [f"{one:.2g}" for one in rows[0]["mtf"]])
    above.minorticks_off()
    above.set_xlabel("MTF of optics and pixel at Nyquist's frequency (1)")
    axes.plot([], [], " ", label="jitter, rms about x and y:")
    legend_below(axes, 2)
    save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
