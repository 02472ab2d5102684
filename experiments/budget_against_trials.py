"""Does the analytic budget agree with trials, or else say why not? Is the error near its bound?

    python experiments/budget_against_trials.py --json budget_against_trials.json
    python experiments/budget_against_trials.py --quick

24 designs are drawn over slews, blurs, skies and effects. Each has its budget, the effects that
the budget says it leaves out, and its error by trials. Then a tracker with the likelihood centroid
slews at rates from 0 to 3 deg / s; its error stands beside the Cramer-Rao bound of whole frames
with their smear. With --markdown the tables are written as docs/figures/budget-against-trials.md.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import command
import numpy as np
from scipy.spatial.transform import Rotation

from startrack import Streams, arcsec, deg, random_attitude, run_trials, shipped
from startrack.budget import Budget, ErrorLaw, analytic
from startrack.catalog import open_sky
from startrack.core import Floats
from startrack.design import Case, Fidelity, load_design, replaced
from startrack.detector import Hits
from startrack.io import save_text
from startrack.metrics import Summary, summarise
from startrack.observation import expected_electrons, line_of_sight, stars_in_field
from startrack.scene import Scene

SEED = 24
RATES = (0.0, 0.05, 0.3, 1.0, 2.0, 3.0)  # deg / s, of the designs
AGREE = 1.15  # ratio up to which formula and trials agree
EXAMPLE = load_design(shipped("designs/noise_only.toml")).case


def changed(case: Case, **changes: object) -> Case:
    """The case with other keys; a double underscore is the point of a key."""
    for name, value in changes.items():
        case = replaced(case, name.replace("__", "."), value)
    return case


def effects(case: Case) -> dict[str, Case]:
    """Effects that a design may have; each entry contains one."""
    detector, optics = "instrument__detector__", "instrument__optics__"
    camera = case.instrument.camera
    still = {"tracker__detection__smear_x": 0.0, "tracker__detection__smear_y": 0.0}
    return {
        "none": case,
        "rolling shutter, 20 us a row": changed(
            case, **{detector + "row_delay": 20e-6, "tracker__row_delay": 0.0}
        ),
        "blur of 1 um": changed(case, **{optics + "blur": 1e-6}),
        "distortion not calibrated": replace(
            case, tracker=replace(case.tracker, camera=replace(camera, k1=camera.k1 + 0.01))
        ),
        "catalogue to G 5.2": replace(case, catalog=replace(case.catalog, limit_g=5.2)),
        "Moon and zodiacal light": replace(
            case, scene=Scene(lights=("zodiacal", "moon"), date="2026-03-01T00:00:00", days=365.0)
        ),
        "smear not known": changed(case, **still),
        "blur of 25 um": changed(case, **{optics + "blur": 25e-6}),
        "likelihood": changed(case, tracker__detection__centroid="likelihood"),
        "cosmic rays": replace(
            case,
            instrument=replace(
                case.instrument, detector=replace(case.instrument.detector, hits=Hits(rate=2e6))
            ),
        ),
        "read noise of 40 electrons": changed(case, **{detector + "read_noise": 40.0}),
        "roll of 2 deg / s": changed(case, instrument__motion__rate_z=2 * deg),
    }


def designs(count: int) -> Iterator[tuple[str, Case]]:
    """Designs drawn over the space; all effects are equally frequent."""
    rng = np.random.default_rng(SEED)
    for k in range(count):
        u = rng.random(7)
        rate, way = RATES[int(u[0] * len(RATES))] * deg, 2 * math.pi * u[1]
        focal, stop = 20e-3 * 3 ** u[2], 1.4 * 2.2 ** u[3]
        exposure, blur = 40e-3 * 4 ** u[4], 3.5e-6 + 9e-6 * u[5]
        case = changed(
            EXAMPLE,
            instrument__motion__rate_x=rate * math.cos(way),
            instrument__motion__rate_y=rate * math.sin(way),
            instrument__optics__focal_length=focal,
            instrument__optics__f_number=stop,
            instrument__optics__blur=blur,
            instrument__detector__exposure=exposure,
            scene__background_g=18.5 + 3.5 * u[6],
        )
        named = effects(case)
        effect = list(named)[k % len(named)]
        text = (
            f"{1e3 * focal:.0f} mm f/{stop:.1f}, {1e3 * exposure:.0f} ms, blur {1e6 * blur:.0f} "
            f"um, {rate / deg:g} deg/s, sky {18.5 + 3.5 * u[6]:.1f}"
        )
        yield text if effect == "none" else f"{text}; {effect}", named[effect]


@dataclass(frozen=True)
class Compared:
    """A design by formula and by trials."""

    name: str
    budget: Budget[ErrorLaw] | None
    summary: Summary

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects that the formula says it leaves out."""
        return self.budget.left_out if self.budget else ("an attitude: too few stars anywhere",)

    @property
    def ratio(self) -> float:
        """Error across by trials over the error by formula; NaN if either is missing."""
        return self.summary.across.value / self.budget.across if self.budget else math.nan

    @property
    def apart(self) -> float:
        """The larger of the ratio and its inverse; 1 if neither finds an attitude."""
        if math.isnan(self.ratio):
            return 1.0 if not self.budget and not self.summary.availability.value else math.inf
        return max(self.ratio, 1 / self.ratio)

    @property
    def silent(self) -> bool:
        """Whether they disagree and the formula names no effect."""
        return self.apart > AGREE and not self.left_out


def compare(name: str, case: Case, trials: int) -> Compared:
    """Budget and trials of a design: trials of windows, or of frames if windows refuse the
    design."""
    try:
        budget = analytic(case)
    except ValueError:
        budget = None
    try:
        outcomes = run_trials(case, SEED, range(trials), Fidelity.WINDOW)
    except ValueError:
        outcomes = run_trials(case, SEED, range(trials), Fidelity.FRAME)
    return Compared(name, budget, summarise(outcomes))


STEP = 0.02  # pixel, of the derivatives of a frame
WIDER = 1e-4  # relative, step of the focal length


def frame_information(case: Case, attitude: Rotation, streams: Streams) -> Floats:
    """Fisher's information (4, 4) of a frame about three small rotations and the scale.

    The frame is the expectation of its electrons; its pixels have the variance of photons,
    read-out, rounding and photo-response. No pixel is left out, and all brightnesses are known: no
    tracker has more information.
    """
    camera, detector = case.instrument.camera, case.instrument.detector

    def frame(one: Case, turned: Rotation) -> Floats:
        stars = stars_in_field(open_sky(one.catalog), turned, one.instrument.camera)
        path = line_of_sight(one.instrument, streams)
        return expected_electrons(one, stars, path, turned, streams)

    steps = STEP / camera.focal_length_px * np.array([1.0, 1.0, 4.0])
    slopes = []
    for axis, step in enumerate(steps):
        turn = Rotation.from_rotvec(step * np.eye(3)[axis])
        up, down = frame(case, turn * attitude), frame(case, turn.inv() * attitude)
        slopes.append((up - down).ravel() / (2 * step))
    focal = case.instrument.optics.focal_length
    up, down = (
        frame(changed(case, instrument__optics__focal_length=focal * (1 + way * WIDER)), attitude)
        for way in (1, -1)
    )
    slopes.append((up - down).ravel() / (2 * WIDER))
    mean = frame(case, attitude).ravel()
    variance = mean + detector.noise**2 + detector.electrons_per_dn**2 / 12
    variance += (detector.prnu * mean) ** 2
    slope = np.stack(slopes)
    information = (slope / variance) @ slope.T
    information[3, 3] += case.tracker.identification.focal_tolerance**-2
    return information


def bound(case: Case, trials: int) -> float:
    """Radian rms per axis across the boresight, over the attitudes of the first trials."""
    squares = []
    for number in range(trials):
        streams = Streams(SEED, number)
        information = frame_information(case, random_attitude(streams), streams)
        squares.append(np.diag(np.linalg.inv(information))[:2].mean())
    return math.sqrt(np.mean(squares))


@dataclass(frozen=True)
class Slew:
    """A tracker at one rate: error by trials and formula, and its bound; radian."""

    rate: float
    summary: Summary
    formula: float
    bound: float


def slew(rate: float, trials: int) -> Slew:
    """The example with another centroid, at a rate about x, radian / second."""
    case = changed(
        EXAMPLE,
        instrument__motion__rate_x=rate,
        instrument__motion__rate_y=0.0,
        tracker__detection__centroid="likelihood",
    )
    found = compare("", case, trials)
    assert found.budget
    return Slew(rate, found.summary, found.budget.across, bound(case, trials))


def table_of_designs(rows: list[Compared]) -> list[str]:
    """A table of the designs in Markdown."""
    lines = [
        "| design | formula (arcsec) | trials (arcsec) | trials / formula | available by formula, "
        "trials (%) | not counted, by its own words |",
        "|---|---|---|---|---|---|",
    ]
    for one in rows:
        formula = f"{one.budget.across / arcsec:.3g}" if one.budget else "none"
        share = f"{100 * one.budget.availability:.1f}" if one.budget else "0"
        across = one.summary.across
        lines.append(
            f"| {one.name} | {formula} | {across.value / arcsec:.3g} [{across.low / arcsec:.3g}, "
            f"{across.high / arcsec:.3g}] | {one.ratio:.2f} | {share}, "
            f"{100 * one.summary.availability.value:.1f} | {'; '.join(one.left_out) or 'nothing'} |"
        )
    return lines


def table_of_slews(rows: list[Slew]) -> list[str]:
    """A table of the rates in Markdown."""
    lines = [
        "| rate (deg/s) | bound (arcsec) | trials (arcsec) | trials / bound | formula (arcsec) | "
        "normalised error squared | available (%) |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in rows:
        across = one.summary.across
        lines.append(
            f"| {one.rate / deg:g} | {one.bound / arcsec:.3f} | {across.value / arcsec:.3f} "
            f"[{across.low / arcsec:.3f}, {across.high / arcsec:.3f}] | "
            f"{across.value / one.bound:.2f} | {one.formula / arcsec:.3f} | "
            f"{one.summary.nees:.2f} | {100 * one.summary.availability.value:.1f} |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--designs", type=int, default=24)
    parser.add_argument(
        "--trials", type=int, default=240, help="trials of each design and of each rate"
    )
    parser.add_argument("--rates", default="0,0.3,1,2,3", help="slew rates, deg / s")
    parser.add_argument("--markdown", type=Path, help="file for the page, in Markdown")
    options = command.read(parser, designs=2, trials=3, rates="2")
    compared = []
    for name, case in designs(options.designs):
        compared.append(compare(name, case, options.trials))
        print(table_of_designs(compared[-1:])[-1], flush=True)
    slews = []
    for rate in map(float, options.rates.split(",")):
        slews.append(slew(rate * deg, options.trials))
        print(table_of_slews(slews[-1:])[-1], flush=True)
    counted = [one.apart for one in compared if not one.left_out]
    nees = [one.summary.nees for one in slews]
    figures: dict[str, Any] = {
        "silent_disagreements": sum(one.silent for one in compared),
        "worst_ratio_of_counted": max(counted, default=1.0),
        "slew_over_bound_max": max(one.summary.across.value / one.bound for one in slews),
        "slew_nees_min": min(nees),
        "slew_nees_max": max(nees),
        "designs": len(compared),
        "designs_counted": len(counted),
        "trials": options.trials,
    }
    command.save(options, figures)
    print(json.dumps(figures, indent=1))
    if options.markdown:
        save_text(options.markdown, page(compared, slews, figures))


def page(compared: list[Compared], slews: list[Slew], figures: dict[str, Any]) -> str:
    """The page of the documents."""
    apart = [one for one in compared if one.apart > AGREE]
    return "\n".join(
        [
            "# The analytic budget compared with trials",
            f"{command.source('budget_against_trials.py --markdown FILE')}. Brackets hold 95 % "
            "intervals.",
            "",
            f"{len(compared)} designs of the example's detector, drawn over focal length, "
            "f-number, "
            "blur, exposure, sky and rate, each with one more effect. The error is rms per axis "
            "across "
            f"the boresight, over {figures['trials']} trials of fidelity `window`, or `frame` "
            "where that refuses the design. The last column is what `startrack budget` and "
            "`requirements` "
            "print of the design. Of the designs of which the budget counts every effect, "
            f"{figures['designs_counted']}, the worst differs by a factor of "
            f"{figures['worst_ratio_of_counted']:.2f}; {len(apart)} of all differ by more than "
            f"{100 * (AGREE - 1):.0f} %, {figures['silent_disagreements']} of these without a "
            "word.",
            "",
            *table_of_designs(compared),
            "",
            "## Slews",
            "The example with the centroid `likelihood`, turning about x. The tracker knows its "
            "rate, "
            "as a gyroscope tells it. The bound is that of Cramer and Rao for the pixels of a "
            "whole "
            "frame with its smear, with the attitude and the scale unknown and all brightnesses "
            "known, "
            "over the same attitudes; it is computed from derivatives of rendered frames, without "
            "the detection.",
            "",
            *table_of_slews(slews),
            "",
        ]
    )


if __name__ == "__main__":
    command.run(main)
