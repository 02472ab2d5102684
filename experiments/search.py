"""How fast and how accurate are forecasts, and how close do searches by forecasts come to the best?

python experiments/search.py [--json FILE] [--designs 20] [--seeds 10] [--trials 2000] [--quick]

A forecast is compared with the complete budgets of the same units. The best design is the best of
all searches: searches with all seeds, and a long search by nlopt from the best of them. Fresh
trials also judge the ends. Last, complete commands are timed, unless --no-commands is given.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import command
import numpy as np
import scipy

from startrack import Case, load_design, shipped
from startrack.core import Floats
from startrack.design import Campaign, DesignSpace, Moment, Objective, Variable, branches
from startrack.optimise import (
    Explorer,
    Foresight,
    Search,
    TrackerSource,
    TrialRunner,
    budgets_of_units,
    explore,
    forecasts,
    foresee_all,
    fresh_units,
    level_interval_of_units,
    minimise,
)
from startrack.optimise import missed as missed_of
from startrack.population import middle_of


def _if_installed(name: str) -> Any:
    """A peer's module; None if it is not installed: the peer is left out."""
    return importlib.import_module(name) if importlib.util.find_spec(name) else None


cma, optuna = _if_installed("cma"), _if_installed("optuna")
ARCSEC = math.radians(1 / 3600)
FRESH = 20001  # seed of the trials that judge where searches end
UNITS = ("nanosatellite", "high_accuracy")  # designs judged over their units
ALONE = "noise_only"
LONG = 400  # forecasts of each long search
PEER_SEEDS = 5  # number of seeds of other searches
COMMANDS = {
    "optimize_warm_s": ("optimize", "nanosatellite"),
    "optimize_high_accuracy_s": ("optimize", "high_accuracy"),
    "pareto_s": ("pareto", "nanosatellite", "--points", "12"),
    "what_matters_s": ("what-matters", "nanosatellite", "--units", "0"),
    "sample_s": ("sample", "nanosatellite"),
}
# In addition to the five variables of the campaign with noise alone: 30 in all.
DETECTOR = "instrument.detector."
MORE = (
    Variable("instrument.optics.k1", -0.05, 0.05),
    Variable("instrument.optics.principal_x", -40.0, 40.0),
    Variable("instrument.optics.principal_y", -40.0, 40.0),
    Variable(f"{DETECTOR}pixel_pitch", "7 um", "16 um"),
    Variable(f"{DETECTOR}dark_current", "20 electron / s", "200 electron / s"),
    Variable(f"{DETECTOR}read_noise", "4 electron", "16 electron"),
    Variable(f"{DETECTOR}prnu", 0.003, 0.03),
    Variable(f"{DETECTOR}full_well", "10000 electron", "60000 electron"),
    Variable(f"{DETECTOR}pixel_rate", "4 Mpix / s", "20 Mpix / s"),
    Variable(f"{DETECTOR}fill_factor", 0.5, 1.0),
    Variable(f"{DETECTOR}diffusion", "0 um", "4 um"),
    Variable(f"{DETECTOR}crosstalk", 0.0, 0.05),
    Variable(f"{DETECTOR}nonlinearity", 0.0, 0.02),
    Variable(f"{DETECTOR}settling", 0.0, 0.01),
    Variable(f"{DETECTOR}bits", 10, 14),
    Variable("tracker.detection.window", 5, 13),
    Variable("tracker.detection.edge", 0, 6),
    Variable("tracker.detection.saturation", 3000.0, 4095.0),
    Variable("tracker.detection.kernel_sigma", 0.6, 1.6),
    Variable("tracker.detection.mesh", 16, 64),
    Variable("tracker.detection.max_spots", 8, 120),
    Variable("tracker.detection.min_area", 1, 4),
    Variable("tracker.identification.min_matches", 4, 8),
    Variable("tracker.identification.focal_tolerance", 1e-4, 5e-3),
    Variable("tracker.attitude.gate", 3.0, 8.0),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--designs", type=int, default=20, help="number of random designs of each campaign"
    )
    parser.add_argument("--seeds", type=int, default=10, help="number of searches of each campaign")
    parser.add_argument(
        "--trials", type=int, default=2000, help="number of fresh trials that judge each result"
    )
    parser.add_argument(
        "--no-commands", action="store_true", help="leave out the times of whole commands"
    )
    options = command.read(parser, designs=1, seeds=1, trials=20)
    figures: dict[str, Any] = {"forecast_s": {}, "forecast_error": 0.0, "regret": {}}
    figures |= dict.fromkeys(COMMANDS)
    for name in UNITS[: 1 if options.quick else None]:
        seconds, error = beside_whole_budgets(name, options.designs, options.quick)
        figures["forecast_s"][name] = seconds
        figures["forecast_error"] = max(figures["forecast_error"], error)
    for name in (ALONE,) if options.quick else (ALONE, *UNITS):
        figures["regret"][name] = regrets(name, options.seeds, options.trials, options.quick)
    figures["unmoved"] = [each for one in figures["regret"].values() for each in one.pop("unmoved")]
    figures["peers"] = {name: one.pop("peers") for name, one in figures["regret"].items()}
    figures |= thirty_variables(options.quick)
    if not (options.no_commands or options.quick):
        figures |= {name: seconds_of(*words) for name, words in COMMANDS.items()}
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


def campaign_of(name: str) -> tuple[Case, Campaign]:
    design = load_design(shipped(f"designs/{name}.toml"))
    assert design.campaign
    return design.case, design.campaign


def spaces_of(case: Case, campaign: Campaign) -> dict[str, DesignSpace]:
    """The space of each combination of the choices of a campaign."""
    return {
        branch.label: DesignSpace(branch.case, campaign.variables, campaign.links)
        for branch in branches(case, campaign.choices)
    }


def beside_whole_budgets(name: str, count: int, quick: bool) -> tuple[float, float]:
    """Median CPU time of a forecast, second, and its worst relative difference from budgets with
    individual stars for each unit."""
    case, campaign = campaign_of(name)
    if quick:
        campaign = replace(campaign, unit_count=2)
    spaces = list(spaces_of(case, campaign).values())
    random, seconds, errors = np.random.default_rng(7), list[float](), list[float]()
    for number in range(count):
        space = spaces[number % len(spaces)]
        point = random.random(len(space)) if number else space.start
        began = time.process_time()
        fast = expected(space, campaign, point)
        seconds.append(time.process_time() - began)
        whole = in_whole_budgets(space, campaign, point)
        errors.append(abs(fast / whole - 1))
        print(f"{name} {number}: {seconds[-1]:.2f} s, {100 * errors[-1]:.2f} %", flush=True)
    return float(np.median(seconds[1:] or seconds)), float(np.nanmax(errors))


def expected(space: DesignSpace, campaign: Campaign, point: Floats) -> float:
    judged = campaign.judged(space.design(point))
    return forecasts(judged, Objective.read(campaign.objective))[0]


def in_whole_budgets(space: DesignSpace, campaign: Campaign, point: Floats) -> float:
    """The objective with stars chosen and moved again for each unit and environment."""
    budgets = "startrack.budget.units"
    measured = sys.modules[budgets]._measured

    def of_unit(case: Case, seed: int, moment: Moment, settings: Any, like: Case | None) -> Any:
        return measured(case, seed, moment, settings, like or middle_of(case, settings.age))

    with patch(f"{budgets}._middle", return_value=None), patch(f"{budgets}._measured", of_unit):
        budgets_of_units.cache_clear()
        try:
            return expected(space, campaign, point)
        finally:
            budgets_of_units.cache_clear()


class End(NamedTuple):
    """The end of a search: the branch, its space, the design and its forecast."""

    branch: str
    space: DesignSpace
    point: Floats
    value: Foresight


def regrets(name: str, seeds: int, trials: int, quick: bool) -> dict[str, Any]:
    """Distances of the ends of searches with several seeds from the best, by forecasts with one
    seed of units.

    trials  number of fresh trials that also judge the ends; 0: none
    """
    case, campaign = campaign_of(name)
    if quick:
        campaign = replace(campaign, analytic_evaluations=4)
    spaces = spaces_of(case, campaign)
    ends, counts, unmoved = list[End](), list[int](), list[str]()
    for seed in range(1, seeds + 1):
        explorers = {
            label: Explorer(TrackerSource(space, campaign), f"seed {seed} {label}".strip())
            for label, space in spaces.items()
        }
        began, starts = time.process_time(), {label: space.start for label, space in spaces.items()}
        left = explore(explorers, starts, campaign)
        label = min(left, key=lambda label: left[label].score)
        best, space = left[label], spaces[label]
        ends.append(End(label, space, best.best, _value(space, campaign, best.best)))
        counts.append(
            sum(not value.left_out for each in explorers.values() for value in each.values)
        )
        spans, still = best.spans(best.best), np.abs(best.best - space.start) < 1e-6
        unmoved += [
            f"{name}: {variable.name}"
            for variable, span, held in zip(space.variables, spans, still, strict=True)
            if held and not span.everywhere
        ]
        print(
            f"{name} seed {seed}: {counts[-1]} forecasts, {best.score:.4f}, {label} "
            f"{best.best.round(3)}, {time.process_time() - began:.0f} s",
            flush=True,
        )

    scores = [end.value.score for end in ends]
    first = ends[int(np.argmin(scores))]
    long, most = Scores(first.space, campaign), 10 if quick else LONG
    minimise(long, first.point, Search(evaluations=most, first_step=0.1, last_step=1e-4))
    others = {
        peer: [
            least_of(search, Scores(first.space, campaign), int(np.median(counts)), seed)
            for seed in range(1, min(seeds, PEER_SEEDS) + 1)
        ]
        for peer, search in ({} if campaign.choices else PEERS).items()
    }
    meeting = [end.value.score for end in ends if not missed_of(end.value.margins)]
    best_score = min([*meeting, long.least, *chain(*others.values())])
    missed = [math.expm1(score - best_score) for score in scores]
    for peer, least_scores in others.items():
        print(f"{name} {peer}: {np.median(least_scores):.4f}, best {best_score:.4f}", flush=True)
    figures = {
        "peers": {peer: _regret(np.median(values), best_score) for peer, values in others.items()},
        "median": float(np.median(missed)),
        "worst": max(missed),
        "infeasible": sum(missed_of(end.value.margins) > 0 for end in ends),
        "forecasts": float(np.median(counts)),
        "unmoved": unmoved,
    }
    if trials:
        figures |= by_trials(name, campaign, ends, End(*first[:2], long.point, first.value), trials)
    return figures


def by_trials(
    name: str, campaign: Campaign, ends: list[End], best: End, trials: int
) -> dict[str, float]:
    """Distances of designs from the best design, by trials with units and noise that no search
    used.

    All designs have the same units and noise, so that a ratio is more accurate than a level. A
    search whose end is better by trials than the best by forecasts has a negative regret.
    """
    runner, level = TrialRunner(seed=FRESH), dict[tuple[str, bytes], float]()
    for end in (best, *ends):
        key = end.branch, end.point.tobytes()
        if key not in level:
            level[key] = _level(end, campaign, runner, trials)
            print(f"{name}: {level[key]:.4g} arcsec by trials of {end.point.round(3)}", flush=True)
    reference = level[best.branch, best.point.tobytes()]
    missed = [level[end.branch, end.point.tobytes()] / reference - 1 for end in ends]
    return {"median_by_trials": float(np.median(missed)), "worst_by_trials": float(max(missed))}


def _level(end: End, campaign: Campaign, runner: TrialRunner, trials: int) -> float:
    """The objective, arcsec, by a number of trials in its weighted conditions."""
    weighted = [one for one in campaign.judged(end.space.design(end.point)) if one.weight]
    objective = Objective.read(campaign.objective)
    if not weighted[0].units:
        levels = [
            float(objective.of(objective.squares(runner.run(one.case, trials, campaign.fidelity))))
            for one in weighted
        ]
        return campaign.goal.over(levels, [one.weight for one in weighted]) / ARCSEC
    campaign = replace(campaign, fresh_units=math.ceil(trials / campaign.trials_per_unit))
    rows = [fresh_units(one, campaign, runner) for one in weighted]
    return level_interval_of_units(objective, weighted, rows, campaign, runner).value / ARCSEC


def _value(space: DesignSpace, campaign: Campaign, point: Floats) -> Foresight:
    [value] = foresee_all(space, campaign, [point])
    return value


def thirty_variables(quick: bool) -> dict[str, float]:
    """Gain of a search of thirty variables over a search of five, and its number of forecasts."""
    case, campaign = campaign_of(ALONE)
    if quick:
        campaign = replace(campaign, analytic_evaluations=4)
    found = list[Explorer]()
    for more, times in (((), 1), (MORE, 10)):
        most = campaign.analytic_evaluations
        if found:
            most = times * len(found[0].points)
        asked = replace(campaign, variables=(*campaign.variables, *more), analytic_evaluations=most)
        began, space = time.process_time(), DesignSpace(case, asked.variables, asked.links)
        explorer = Explorer(TrackerSource(space, asked))
        explore({"": explorer}, {"": space.start}, asked)
        print(
            f"{len(space)} variables: {len(explorer.points)} forecasts, {explorer.score:.4f}, "
            f"{time.process_time() - began:.0f} s; {explorer.ending}",
            flush=True,
        )
        found.append(explorer)
    five, thirty = found
    return {
        "thirty_gain": math.exp(five.score - thirty.score),
        "thirty_forecasts_ratio": len(thirty.points) / len(five.points),
    }


def _regret(score: float, best: float) -> float | None:
    """Relative excess of an error over the best; None if no design met its limits."""
    return math.expm1(score - best) if math.isfinite(score) else None


class _Used(Exception):
    """All forecasts were used."""


Score = Callable[[Floats], float]


class Scores:
    """The score of each point; the lowest score so far of points that meet all limits, and its
    point."""

    def __init__(self, space: DesignSpace, campaign: Campaign) -> None:
        self.space, self.campaign, self.least, self.point = space, campaign, math.inf, space.start

    def __call__(self, point: Floats) -> float:
        value = _value(self.space, self.campaign, point)
        if value.score < self.least and not missed_of(value.margins):
            self.least, self.point = value.score, np.array(point)
        return value.score


def least_of(
    search: Callable[[Score, int, int, int], None], score: Scores, most: int, seed: int
) -> float:
    """The lowest score that a search finds in a number of forecasts, among designs that meet all "
    "limits."""
    used = 0

    def kept(point: Floats) -> float:
        nonlocal used
        if used == most:
            raise _Used
        used, value = used + 1, score(np.clip(point, 0, 1))
        return value if math.isfinite(value) else BAD

    with suppress(_Used):
        search(kept, len(score.space), most, seed)
    return score.least


BAD = 30.0  # score of a design without an attitude, for searches that need a number


def _sbplx(score: Score, count: int, most: int, seed: int) -> None:
    """Plain Sbplx from a random start, and from another start when it has converged."""
    random = np.random.default_rng(seed)
    while True:
        minimise(score, random.random(count), Search(evaluations=most))


def _evolution(score: Score, count: int, most: int, seed: int) -> None:
    """SciPy's differential evolution, in populations of 5 designs per variable."""
    scipy.optimize.differential_evolution(
        score, [(0.0, 1.0)] * count, popsize=5, maxiter=most, rng=seed, polish=False
    )


def _cma(score: Score, count: int, most: int, seed: int) -> None:
    """CMA-ES (Hansen 2016), from the middle of the space."""
    options = {"bounds": [0, 1], "seed": seed, "verbose": -9, "maxfevals": most}
    cma.fmin2(score, np.full(count, 0.5), 0.3, options, restarts=9)


def _optuna(score: Score, count: int, most: int, seed: int, sampler: str = "TPESampler") -> None:
    """Optuna's sampler with the given name."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
    study = optuna.create_study(sampler=getattr(optuna.samplers, sampler)(seed=seed))

    def objective(trial: Any) -> float:
        return score(np.array([trial.suggest_float(str(k), 0, 1) for k in range(count)]))

    study.optimize(objective, n_trials=most)


PEERS: dict[str, Callable[[Score, int, int, int], None]] = {
    "Sbplx": _sbplx,
    "differential evolution": _evolution,
    **({"CMA-ES": _cma} if cma else {}),
    **({"TPE": _optuna} if optuna else {}),
    **(
        {"GP": partial(_optuna, sampler="GPSampler")}
        if optuna and importlib.util.find_spec("torch")
        else {}
    ),
}


def seconds_of(*words: str) -> float:
    """Seconds of a command on two workers, with compiled kernels; arguments: its name, a design,
    options."""
    with tempfile.TemporaryDirectory() as folder:
        name, design, *more = words
        path = str(shipped(f"designs/{design}.toml"))
        call = [sys.executable, "-m", "startrack.cli", name, path, *more]
        began = time.perf_counter()
        subprocess.run(
            [*call, "--out", str(Path(folder) / "out")], check=False, capture_output=True
        )
        return time.perf_counter() - began


if __name__ == "__main__":
    command.run(main)
