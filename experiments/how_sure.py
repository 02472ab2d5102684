"""Question: do intervals of predictions hold, for published trackers and for drawn designs?

    STARTRACK_DATA=folder python experiments/how_sure.py [--json FILE] [--draws N] [--quick]

Each published tracker is predicted with the laws of its design file; the residual of its class
after calibration is estimated without this tracker (leave-one-out). Further trackers of
`STARTRACK_DATA/references/trackers-more` are predicted with the laws of all shipped trackers. Then
designs are drawn from the laws of a prototype; their errors and figures of frames are given as told
figures, both by the whole budget of each design, and the intervals of the unknowns are compared
with the truth. Last, a simulated test campaign: for some drawn prototypes 200 frames are rendered,
measured and given as told figures, and the following prediction is compared with the truth.

log_error_across, _about  mean of |ln(median / published)| over the shipped trackers
skill_across, _about      that mean over the same mean for a constant: the geometric mean of the
                          published figures of the other trackers of the class
holds_68, holds_95        fraction of the published figures within the intervals
width                     mean of half the logarithm of the ratio of the ends of the 68 % intervals
unseen                    the same for further trackers, if available
within_1_5, _2, _3, of    number of trackers with both figures within a factor; number of trackers
residual_px, residual_factor  for a class: residual after calibration that gives the published
                          figures, geometric mean and factor of 68 %
about_over_across         for a tracker: error about the boresight over error across, by the places
                          of its stars alone (of its noise), and published
error_of_that_ratio       mean of |ln(first / second)|
posterior_68, _95         fraction of the unknowns within posterior intervals, over drawn designs
loop_within               fraction of the true figures within 95 % intervals after the loop
loop_narrows              factor of 68 % of noise across before the loop, over the factor after;
                          geometric mean
predict_s                 second, time of a prediction with two processes
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import json
import math
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import command
import numpy as np
import units
from scipy.spatial.transform import Rotation

from startrack import Streams, arcsec, load_design, random_attitude, shipped
from startrack.budget import PUBLISHED, Term
from startrack.core import Floats
from startrack.design import Told
from startrack.montecarlo import pool
from startrack.prediction import (
    MODEL_ERROR,
    Draw,
    draw_unknowns,
    fit_surface,
    learn,
    predict,
    save_told,
)
from startrack.trial import observe
from startrack.verification import told_by_frames, windows_of_frames, with_magnitudes

SEED, UNITS, SAMPLES = 1, 3, 8192
RESIDUAL = "instrument.residual.rms"
CLASSES = {"noise": Term.NOISE, "pixel": Term.PIXEL, "fov": Term.FIELD}
CLASSES |= {"thermo-elastic": Term.THERMO_ELASTIC}
AXES = ("across", "about")
LEAST_PART = 0.3  # least fraction of a published figure caused by the residual, in `implied`
TERMS = dict(zip(("NEA", "pixel", "FOV", "accuracy"), PUBLISHED.values(), strict=False))
# A prototype with five unknown values. Its told figures, with the factor of uncertainty of each;
# figures of frames have the uncertainty of 50 frames.
PROTOTYPE = """
base = "designs/noise_only.toml"
[instrument.optics]
blur = { median = "5 um", factor = 1.3 }
[instrument.optics.transmission]
factor = { median = 0.85, factor = 1.2 }
[instrument.detector]
read_noise = { median = "8 electron", factor = 1.5 }
[instrument.residual]
rms = { median = 0.07, factor = 2.0 }
[instrument.motion]
jitter_factor = { median = 1.0, factor = 1.5 }
[[instrument.motion.broadband]]
axis = "x"
frequency = ["0.5 Hz", "4.5 Hz"]
density = ["1 arcsec2 / Hz", "1 arcsec2 / Hz"]
[[instrument.motion.broadband]]
axis = "y"
frequency = ["0.5 Hz", "4.5 Hz"]
density = ["1 arcsec2 / Hz", "1 arcsec2 / Hz"]
"""
TOLD = (("accuracy", "across", 1.15), ("NEA", "across", 1.1))
FRAMES_TOLD = {"read noise": 1.01, "star signal": 1.03, "image width": 1.02, "common motion": 1.1}
LOOP_FRAMES, LOOPS = 200, 4
STEP = 0.01  # pixel, motion of stars from frame to frame in the loop


class Tracker(NamedTuple):
    """A published tracker with its draws.

    published  arcsec, rms per axis, across and about; None where nothing is published
    counts     classes of error that the figures include
    jitter     arcsec, jitter of the vehicle, which the figures also include
    family     "shelf" or "made"
    """

    name: str
    published: tuple[float | None, float | None]
    counts: tuple[Term, ...]
    jitter: tuple[float, float]
    family: str
    draws: list[Draw]

    @property
    def of_residual(self) -> bool:
        """Whether the class has a residual after calibration that the figures include."""
        named = any(unknown.name == RESIDUAL for unknown in self.draws[0].unknowns)
        return named and Term.FIELD in self.counts


def tracker_of(name: str, path: Path, one: units.Published, draws: int, executor: Any) -> Tracker:
    """A tracker with its draws, at the begin of life."""
    began = time.monotonic()
    made = draw_unknowns(path, SEED, draws, UNITS, 0.0, executor=executor)
    print(f"{name}: {len(made)} draws in {time.monotonic() - began:.0f} s", flush=True)
    return Tracker(name, (one.across, one.about), one.counts, one.jitter, one.family, made)


def samples(tracker: Tracker, shift: float) -> Floats:
    """Arcsec (n, 2): the counted figure over the unknowns.

    shift  of the logarithm of the residual after calibration, from that of the design file
    """
    surface = fit_surface([draw for draw in tracker.draws if draw.number >= 0])
    errors = surface.errors(surface.scores(surface.sample(SEED, SAMPLES)))
    errors[:, surface.counted([Term.FIELD])] *= math.exp(shift)
    counted = surface.figure(surface.scattered(errors, SEED, MODEL_ERROR), tracker.counts)
    return np.hypot(counted / arcsec, tracker.jitter)


def implied(tracker: Tracker) -> float:
    """Logarithm of the ratio of the residual that gives the published figures to the residual of
    the design file."""
    middle = tracker.draws[0].terms
    found = []
    for axis, published in enumerate(tracker.published):
        if not published:
            continue
        rest = np.array([middle[t][axis] / arcsec for t in tracker.counts if t in middle])
        field = middle[Term.FIELD][axis] / arcsec
        square = published**2 - ((rest**2).sum() - field**2) - tracker.jitter[axis] ** 2
        found.append(math.log(max(square, (LEAST_PART * published) ** 2)) / 2 - math.log(field))
    return float(np.mean(found))


def scores(trackers: Sequence[Tracker], of: Sequence[Tracker], one_out: bool) -> dict[str, Any]:
    """Scores of predictions of some trackers.

    of       trackers that give laws and constants
    one_out  whether factors are estimated without the judged tracker
    """
    rows, factors = list[tuple[int, float, float, bool, bool, float]](), []
    for tracker in trackers:
        others = [one for one in of if one.family == tracker.family]
        if one_out:
            others = [one for one in others if one.name != tracker.name]
        shifts = [implied(one) for one in others if one.of_residual]
        shift = float(np.mean(shifts)) if tracker.of_residual and shifts else 0.0
        errors, worst = samples(tracker, shift), 0.0
        for axis, published in enumerate(tracker.published):
            if not published:
                continue
            low_95, low_68, median, high_68, high_95 = np.quantile(
                errors[:, axis], (0.025, 0.16, 0.5, 0.84, 0.975)
            )
            off = math.log(median / published)
            known = np.array([one.published[axis] or math.nan for one in others])
            constant = float(np.nanmean(np.log(known))) - math.log(published)
            held = low_68 <= published <= high_68, low_95 <= published <= high_95
            rows.append((axis, off, constant, *held, math.log(high_68 / low_68) / 2))
            worst = max(worst, abs(off))
            print(
                f"  {tracker.name:12s} {AXES[axis]:6s} {median:7.3g} [{low_68:.3g}, {high_68:.3g}] "
                f"arcsec, published {published:g}"
            )
        factors.append(worst)
    table = np.array(rows)
    figures: dict[str, Any] = {}
    for axis, name in enumerate(AXES):
        some = table[table[:, 0] == axis]
        figures[f"log_error_{name}"] = float(np.abs(some[:, 1]).mean())
        constant = float(np.abs(some[:, 2]).mean())
        figures[f"skill_{name}"] = figures[f"log_error_{name}"] / constant
    figures |= {"holds_68": float(table[:, 3].mean()), "holds_95": float(table[:, 4].mean())}
    figures["width"] = float(table[:, 5].mean())
    for name, factor in (("within_1_5", 1.5), ("within_2", 2.0), ("within_3", 3.0)):
        figures[name] = sum(worst <= math.log(factor) for worst in factors)
    return figures | {"of": len(factors)}


def residuals_of(trackers: Sequence[Tracker]) -> dict[str, Any]:
    """The residual after calibration that gives the published figures, by class."""
    found: dict[str, Any] = {"residual_px": {}, "residual_factor": {}}
    for family in ("made", "shelf"):
        some = [one for one in trackers if one.family == family and one.of_residual]
        if len(some) < 2:
            continue
        law = next(u for u in some[0].draws[0].unknowns if u.name == RESIDUAL).law
        logarithm = np.array([implied(one) for one in some])
        found["residual_px"][family] = law["median"] * math.exp(float(logarithm.mean()))
        found["residual_factor"][family] = math.exp(float(logarithm.std(ddof=1)))
    return found


def about_over_across(trackers: Sequence[Tracker]) -> dict[str, Any]:
    """Published ratio of both errors, and ratio by the places of the stars alone.

    An independent error of equal size in all stars is larger about the boresight than across by the
    inverse of the stars' rms angle from the boresight; noise is such an error.
    """
    found = dict[str, list[float]]()
    for tracker in trackers:
        across, about = tracker.published
        if across and about:
            noise = tracker.draws[0].terms[Term.NOISE]
            found[tracker.name] = [float(noise[1] / noise[0]), about / across]
    off = [abs(math.log(places / published)) for places, published in found.values()]
    return {"about_over_across": found, "error_of_that_ratio": float(np.mean(off))}


def posterior(path: Path, designs: int, draws: int, executor: Any) -> dict[str, Any]:
    """Fraction of the unknowns of drawn designs within the intervals of their posterior.

    The truth of each design is its budget of drawn units, not a response surface.
    """
    known = draw_unknowns(path, SEED, draws, UNITS, 0.0, executor=executor, middle=False)
    truths = draw_unknowns(path, SEED + 1, designs, UNITS, 0.0, executor=executor, middle=False)
    surface, random = fit_surface(known), Streams(SEED, 0)("told figures")
    held, count = {68: 0, 95: 0}, 0

    def wrong(value: float, factor: float) -> float:
        return value * math.exp(math.log(factor) * random.standard_normal())

    for number, truth in enumerate(truths):
        told = list[Told]()
        for figure, axis, factor in TOLD:
            errors = [truth.terms[term] for term in TERMS[figure] if term in truth.terms]
            value = float(np.linalg.norm(errors, axis=0)[AXES.index(axis)])
            told.append(Told(figure, axis, wrong(value, factor), factor=factor))
        for figure, factor in FRAMES_TOLD.items():
            seen = wrong(truth.frames[figure], factor)
            told.append(Told(figure, number=seen, factor=factor))
        scores = learn(surface, told, SEED + number).quantiles(2000)
        quantile = np.array([truth.quantile[unknown.name] for unknown in surface.unknowns])
        for level in held:
            low, high = np.quantile(scores, (0.5 - level / 200, 0.5 + level / 200), axis=0)
            held[level] += int(((low <= quantile) & (quantile <= high)).sum())
        count += len(quantile)
    return {f"posterior_{level}": share / count for level, share in held.items()}


def loop(path: Path, loops: int, frames: int, draws: int, executor: Any) -> dict[str, Any]:
    """Simulated test campaigns of drawn prototypes: frames, their told figures, and the following
    prediction.

    The attitude turns uniformly; frames contain the jitter within an exposure.
    """
    before = predict(path, seed=SEED, draws=draws, age=0.0, executor=executor)
    believed, within, narrows = load_design(path).case, list[bool](), list[float]()
    for truth in draw_unknowns(path, SEED + 2, loops, UNITS, 0.0, middle=False):
        case = load_design(path, quantile=truth.quantile.__getitem__).case
        first, pixel = random_attitude(Streams(SEED, 0)), 1 / case.instrument.camera.focal_length_px
        turns = [Rotation.from_rotvec([STEP * pixel * k, 0, 0]) * first for k in range(frames)]
        seen = [observe(case, turn, Streams(3, k)).frame for k, turn in enumerate(turns)]
        stars = with_magnitudes(windows_of_frames(seen, believed), seen[0], believed)
        after = path.with_name("told.toml")
        save_told(after, path, told_by_frames(believed, stars, "frames of the prototype"))
        found = predict(after, seed=SEED, draws=draws, age=0.0, executor=executor)
        for figure in found.figures:
            terms = [t for t in PUBLISHED[figure.figure] if t in truth.terms]
            true = np.linalg.norm([truth.terms[t] for t in terms], axis=0)
            value = float(true[AXES.index(figure.axis)])
            within.append(figure.low_95 <= value <= figure.high_95)
            print(
                f"  loop: {figure.figure} {figure.axis}: {value / arcsec:.3g} arcsec, predicted "
                f"[{figure.low_95 / arcsec:.3g}, {figure.high_95 / arcsec:.3g}]"
            )
        nea = [one.figure("NEA", "across").factor for one in (before, found)]
        narrows.append(math.log(nea[0]) / math.log(nea[1]))
    share = float(np.mean(within))
    return {"loop_within": share, "loop_narrows": math.exp(float(np.mean(np.log(narrows))))}


def further(draws: int, executor: Any) -> list[Tracker]:
    """Trackers of the folder of external data; empty without this folder."""
    folder = Path(os.environ.get("STARTRACK_DATA", "-")) / "references/trackers-more"
    if not folder.is_dir():
        print("further trackers: left out, STARTRACK_DATA is not set or has none")
        return []
    table = json.loads((folder / "trackers.json").read_text(encoding="utf-8"))["trackers"]
    found = []
    for name, about in table.items():
        counts = tuple(CLASSES[kind] for kind in about["counts"])
        one = units.Published(about["across"], about["about"], about["klass"].split("-")[0], counts)
        one = one._replace(family="shelf" if one.family == "shelf" else "made")
        found.append(tracker_of(name, folder / f"{name}.toml", one, draws, executor))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument(
        "--designs", type=int, default=200, help="number of designs for the coverage of posteriors"
    )
    options = command.read(parser, draws=12, designs=1)
    chosen = {
        name: one
        for name, one in units.TRACKERS.items()
        if one.magnitude is None and (one.across or one.about)
    }
    if options.quick:
        chosen = {name: chosen[name] for name in ("rigel-l", "astro-aps")}
    with pool(2) as executor:
        seen = [
            tracker_of(name, shipped(f"trackers/{name}.toml"), one, options.draws, executor)
            for name, one in chosen.items()
        ]
        more = [] if options.quick else further(options.draws, executor)
        figures: dict[str, Any] = {}
        if not options.quick:
            began = time.monotonic()
            predict(shipped("trackers/astro-aps.toml"), executor=executor)
            figures["predict_s"] = time.monotonic() - began
    figures |= scores(seen, seen, one_out=True) | residuals_of([*seen, *more])
    figures |= about_over_across([*seen, *more])
    if more:
        figures["unseen"] = scores(more, seen, one_out=False)
    with pool(2) as executor, tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "prototype.toml"
        path.write_text(PROTOTYPE, encoding="utf-8")
        figures |= posterior(path, options.designs, options.draws, executor)
        loops, frames = (1, 40) if options.quick else (LOOPS, LOOP_FRAMES)
        figures |= loop(path, loops, frames, options.draws, executor)
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
