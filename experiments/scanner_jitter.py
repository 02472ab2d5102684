"""How much jitter does a line scanner tolerate? The tone that increases the error by 10 %, over
frequency.

python experiments/scanner_jitter.py [--json FILE] [--picture FILE.png] [--skies 24] [--workers 2]
                                    [--quick]

The scanner is a tracker with time delay and integration, catalogs/designs/scanner.toml. Two limits
are computed at each frequency: the rms about x and y that increases the error across the boresight
by 10 %, and the rms that reduces the MTF at the Nyquist frequency by 10 %.

The error follows a small jitter linearly, e(a) = e(0) + a w. Over three phases of the tone, a third
of a turn apart, the mean of e(0) w is zero and the mean of w^2 exact, so that on the same skies
    a = sqrt((1.1^2 - 1) <e(0)^2> / <w^2>).
The growth is then measured at this a. 95 % intervals are from resampled skies. The truth is the
attitude at the middle of the image.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path as File
from typing import Any

import command
import numpy as np
from krutz_2011 import NYQUIST, nyquist_mtf
from scipy.optimize import brentq

from startrack import Case, arcsec, deg, load_design, shipped
from startrack.core import Floats, Ints, LineOfSight
from startrack.design import replaced
from startrack.montecarlo import pool
from startrack.motion import Motion, Tone, image_path, slew, stability
from startrack.observation import duration
from startrack.optimise import TrialRunner
from startrack.plots import BLUE, GREEN, legend_below, picture, save_picture, styled

FREQUENCIES = (0.05, 0.15, 0.5, 1.5, 5.0, 15.0, 50.0, 150.0)  # Hz; at most two cycles per line
PHASES = (0.0, 120 * deg, 240 * deg)
PROBE = 5 * arcsec  # rms; a tenth of a pixel, well above the noise in the difference
LOSS = 0.1
RESAMPLES = 2000


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--picture", type=File)
    parser.add_argument("--skies", type=int, default=24)
    parser.add_argument("--workers", type=int, default=2)
    options = command.read(parser, skies=2, workers=1)
    case = load_design(shipped("designs/scanner.toml")).case
    rows, phases = [], PHASES[: 1 if options.quick else None]
    with pool(options.workers) as executor:
        runner = TrialRunner(1, executor, options.workers)
        for frequency in FREQUENCIES[4:5] if options.quick else FREQUENCIES:
            error = tolerated_by_error(case, frequency, runner, options.skies, phases)
            mtf = tolerated_by_mtf(case, frequency, 1 if options.quick else 12)
            rows.append({"frequency_hz": frequency} | error | mtf)
            print(json.dumps(rows[-1]), flush=True)
    command.save(options, {"scanner_jitter": rows})
    if options.picture:
        draw(case, rows, options.picture, options.skies)


def shaken(case: Case, frequency: float, rms: float, phase: float) -> Case:
    """The design with a circular tone."""
    return replaced(case, "instrument.motion.tones", (circle(frequency, rms, phase),))


def circle(frequency: float, rms: float, phase: float) -> Tone:
    return Tone(frequency, rms, rms, phase=phase, lead_y=-90 * deg)


def errors(case: Case, runner: TrialRunner, skies: int) -> Floats:
    """Errors across (skies, 2), radian; NaN without a correct attitude."""
    outcomes = runner.run(case, skies)
    right = outcomes["solved"] & ~outcomes["false"]
    across = np.column_stack([outcomes["error_x"], outcomes["error_y"]])
    return np.where(right[:, None], across, np.nan)


def tolerated_by_error(
    case: Case, frequency: float, runner: TrialRunner, skies: int, phases: tuple[float, ...]
) -> dict[str, Any]:
    """The rms at which the error has grown by LOSS, and the growth measured at this rms."""
    rest = errors(case, runner, skies)

    def at(rms: float) -> Floats:
        return np.stack(
            [errors(shaken(case, frequency, rms, each), runner, skies) for each in phases]
        )

    slope = (at(PROBE) - rest) / PROBE
    square, square_slope = (rest**2).mean(axis=1), (slope**2).mean(axis=(0, 2))
    excess = (1 + LOSS) ** 2 - 1
    rms, low, high = resampled(
        lambda each: math.sqrt(excess * square[each].mean() / square_slope[each].mean()), skies
    )
    square_there = (at(rms) ** 2).mean(axis=(0, 2))
    growth = resampled(
        lambda each: math.sqrt(square_there[each].mean() / square[each].mean()), skies
    )
    return {
        "rms_arcsec": [one / arcsec for one in (rms, low, high)],
        "growth_there": list(growth),
        "error_at_rest_arcsec": math.sqrt(square.mean()) / arcsec,
    }


def resampled(statistic: Callable[[Ints], float], skies: int) -> tuple[float, float, float]:
    """The statistic of all skies, and the 95 % interval from resampled skies."""
    rng = np.random.default_rng(1)
    spread = [statistic(rng.integers(0, skies, skies)) for _ in range(RESAMPLES)]
    low, high = np.quantile(spread, [0.025, 0.975])
    return statistic(np.arange(skies)), float(low), float(high)


def tolerated_by_mtf(case: Case, frequency: float, count: int) -> dict[str, Any]:
    """The smallest and largest rms over the phases at which the MTF has decreased by LOSS."""
    found = [borne_by_mtf(case, frequency, phase) for phase in np.arange(count) * 15 * deg]
    return {"mtf_rms_arcsec": [min(found) / arcsec, max(found) / arcsec]}


def borne_by_mtf(case: Case, frequency: float, phase: float) -> float:
    """Rms, radian, at which the mean MTF of the jitter along x and y at Nyquist has decreased by
    LOSS.

    With synchronous charge, all stages of a star form one exposure with the sum of their times. The
    search begins at the jitter whose blur would have this MTF if it were normal.
    """
    instrument = case.instrument
    pixel = 1 / instrument.camera.focal_length_px
    ahead = np.array([0.0, 0.0, 1.0])

    def path(rms: float) -> LineOfSight:
        return slew(Motion(tones=(circle(frequency, rms, phase),)), transit(case), pixel)

    def left(rms: float) -> float:
        offset = image_path(path(rms), instrument.camera, ahead)
        return sum(nyquist_mtf(offset, path(rms).weight)) / 2 - (1 - LOSS)

    blurred = float(np.hypot(*stability(path(PROBE)).rms[:2])) / math.sqrt(2) / PROBE
    normal = math.sqrt(-math.log(1 - LOSS) / 2) / (math.pi * NYQUIST) * pixel / blurred
    return float(brentq(left, normal / 3, 3 * normal, rtol=1e-6))


def transit(case: Case) -> float:
    """Time of a star over all stages, second."""
    detector = case.instrument.detector
    assert detector.scan
    return detector.exposure * detector.scan.stages


@styled
def draw(case: Case, rows: list[dict[str, Any]], path: File, skies: int) -> None:
    """Both limits over frequency; jitter below a line is tolerated."""
    figure = picture(
        5.2,
        f"Scanner with time delay and integration, {skies} skies in {len(PHASES)} phases a "
        "point; below a line, the jitter is tolerated",
    )
    axes = figure.subplots()
    frequency = [row["frequency_hz"] for row in rows]
    rms, low, high = np.transpose([row["rms_arcsec"] for row in rows])
    axes.errorbar(
        frequency,
        rms,
        [rms - low, high - rms],
        fmt="o-",
        ms=4,
        capsize=3,
        color=GREEN,
        label="error across +10 %, by trials, 95 %",
    )
    least, greatest = np.transpose([row["mtf_rms_arcsec"] for row in rows])
    middle = (least + greatest) / 2
    axes.errorbar(
        frequency,
        middle,
        [middle - least, greatest - middle],
        fmt="s-",
        ms=4,
        capsize=3,
        color=BLUE,
        label="MTF at Nyquist -10 %, range of phases",
    )
    detector = case.instrument.detector
    for name, time in (
        ("image", duration(detector)),
        ("stages", transit(case)),
        ("line", detector.exposure),
    ):
        axes.axvline(1 / time, color="0.6", lw=0.8, ls=":")
        axes.text(
            1 / time,
            1.0,
            f" 1 / {name}",
            transform=axes.get_xaxis_transform(),
            fontsize=8,
            rotation=90,
            va="top",
            ha="right",
        )
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="frequency of the jitter (Hz)",
        ylabel="tolerated rms about x and y (arcsec)",
    )
    legend_below(axes, 1)
    save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
