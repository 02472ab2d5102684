"""Question: do the intervals of predictions hold, of published trackers and of drawn designs?

    STARTRACK_DATA=folder python experiments/how_sure.py [--json FILE] [--draws N] [--quick]

Each published tracker is predicted with the laws of its design file, the residual that its class
leaves after calibration estimated without it (leave-one-out); further trackers of
`STARTRACK_DATA/references/trackers-more` are predicted with the laws of all shipped ones. Then
designs are drawn from the laws of one tracker, their errors told, and the intervals of what was
told nothing but that are compared with the truth.

log_error_across, _about  mean of |ln(median / published)|, of the shipped trackers
skill_across, _about      that over the same of a constant: the geometric mean of what is published
                          of the other trackers of the class
holds_68, holds_95        share of the published figures that the intervals hold
width                     mean of half the logarithm of the ratio of the ends of 68 %
unseen                    the same of further trackers, where they are there
within_1_5, _2, _3, of    trackers both of whose figures are predicted within a factor, of how many
residual_px, residual_factor  of a class: the residual after calibration that makes what is
                          published, its geometric mean and the factor that holds 68 %
about_over_across         of a tracker: error about the boresight over that across, by the places of
                          its stars alone (of its noise), and as published
error_of_that_ratio       mean of |ln| of the first over the second
posterior_68, _95         share of the unknowns that posterior intervals hold, over drawn designs
predict_s                 of one prediction with two processes, second
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import json
import math
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import command
import numpy as np
import units
from scipy.special import ndtr, ndtri

from startrack import Streams, arcsec, shipped
from startrack.budget import PUBLISHED, Term
from startrack.core import Floats
from startrack.design import Told
from startrack.montecarlo import pool
from startrack.prediction import Draw, PredictionSurface, draw_unknowns, fit_surface, learn, predict

SEED, UNITS, SAMPLES = 1, 3, 8192
RESIDUAL = "instrument.residual.rms"
CLASSES = {"noise": Term.NOISE, "pixel": Term.PIXEL, "fov": Term.FIELD}
CLASSES |= {"thermo-elastic": Term.THERMO_ELASTIC}
AXES = ("across", "about")
LEAST_PART = 0.3  # of a published figure that the residual makes, at least, in `implied`
TERMS = dict(zip(("NEA", "pixel", "FOV", "accuracy"), PUBLISHED.values(), strict=False))
TOLD = (("accuracy", "across", 1.15), ("NEA", "across", 1.1))  # of synthetic designs


class Tracker(NamedTuple):
    """A published tracker with its draws.

    published  arcsec, rms per axis, across and about; None where nothing is published
    counts     classes of error that the figures hold
    jitter     arcsec, of the vehicle, which the figures hold, too
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
        """Whether its class has a residual after calibration, and its figures hold it."""
        named = any(unknown.name == RESIDUAL for unknown in self.draws[0].unknowns)
        return named and Term.FIELD in self.counts


def tracker_of(name: str, path: Path, one: units.Published, draws: int, executor: Any) -> Tracker:
    """A tracker with its draws, all at the begin of life."""
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
    counted = surface.figure(surface.scattered(errors, SEED), tracker.counts) / arcsec
    return np.hypot(counted, tracker.jitter)


def implied(tracker: Tracker) -> float:
    """Logarithm of the residual that makes what is published, over that of the design file."""
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
    """How predictions of some trackers hold.

    of       the trackers that laws and constants are from
    one_out  whether each is left out of them where it is judged
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
    """The residual after calibration that makes what is published, by class."""
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
    """Ratio of both published errors beside that which the places of the stars alone make.

    An error that is alike and independent in all stars is larger about the boresight than across by
    the inverse of their root-mean-square angle from it, whatever its size; noise is such an error.
    """
    found = dict[str, list[float]]()
    for tracker in trackers:
        across, about = tracker.published
        if across and about:
            noise = tracker.draws[0].terms[Term.NOISE]
            found[tracker.name] = [float(noise[1] / noise[0]), about / across]
    off = [abs(math.log(places / published)) for places, published in found.values()]
    return {"about_over_across": found, "error_of_that_ratio": float(np.mean(off))}


def posterior(surface: PredictionSurface, designs: int) -> dict[str, Any]:
    """Share of the scores of drawn designs that the intervals of their posterior hold."""
    random = Streams(SEED, 0)("drawn designs")
    held = {68: 0, 95: 0}
    count = len(surface.unknowns)
    for number in range(designs):
        truth = random.standard_normal((1, count))
        errors = surface.errors(surface.scores(ndtr(truth)))
        errors = errors * np.exp(surface.scatter * random.standard_normal(errors.shape))
        told = []
        for figure, axis, factor in TOLD:
            value = surface.figure(errors, TERMS[figure])[0, AXES.index(axis)]
            wrong = math.exp(math.log(factor) * random.standard_normal())
            told.append(Told(figure, axis, float(value) * wrong, factor=factor))
        scores = ndtri(learn(surface, told, SEED + number).quantiles(2000))
        for level in held:
            ends = np.quantile(scores, (0.5 - level / 200, 0.5 + level / 200), axis=0)
            held[level] += int(((ends[0] <= truth[0]) & (truth[0] <= ends[1])).sum())
    return {f"posterior_{level}": share / (designs * count) for level, share in held.items()}


def further(draws: int, executor: Any) -> list[Tracker]:
    """Trackers of the folder of outside data; none where there is none."""
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
    parser.add_argument("--designs", type=int, default=200, help="of the posterior's coverage")
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
    drawn = next(one for one in seen if one.name == "rigel-l")
    surface = fit_surface([draw for draw in drawn.draws if draw.number >= 0])
    figures |= posterior(surface, options.designs)
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
