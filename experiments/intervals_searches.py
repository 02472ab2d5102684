"""Ends of complete searches, judged by fresh trials: feasibility, distance from the best, time.

Each end is a line of a file, so that a stopped run continues. Other searches have the same number
of forecasts of the same campaign, without trials.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import command
import numpy as np
from search import PEERS, Scores, campaign_of, least_of, spaces_of

from startrack import arcsec
from startrack.core import Rows
from startrack.design import Campaign, Case, Judged
from startrack.metrics import fraction_interval
from startrack.optimise import (
    TrialRunner,
    fresh_units,
    level_interval_of_units,
    measured_units,
    name_by_condition,
    optimize,
)
from startrack.verification import boresights, claims_of, counted
from startrack.verification import margins as margins_of

DESIGNS = ("noise_only", "nanosatellite", "high_accuracy")
OURS = "startrack"
OTHERS = ("Sbplx", "CMA-ES", "TPE")
JUDGE = 30_001  # seed of the trials that judge ends; no search uses it


def searches(asked: argparse.Namespace) -> dict[str, Any]:
    """Run missing searches. Returns the figures of all available ends.

    asked  designs; number of seeds and first seed; peers: seeds of each other search, none for a
           campaign with choices; trials: fresh trials in each condition that judge an end; ends:
           the file
    """
    if asked.ends is None:
        with tempfile.TemporaryDirectory() as folder:
            return searches(argparse.Namespace(**vars(asked) | {"ends": Path(folder) / "ends"}))
    for name in asked.designs:
        case, campaign = campaign_of(name)
        if asked.quick:
            campaign = smallest(campaign)
        for seed in range(asked.first, asked.first + asked.seeds):
            kept(asked, name, OURS, seed, partial(ours, case, campaign, seed))
        for peer in [] if campaign.choices else [one for one in OTHERS if one in PEERS]:
            for seed in range(1, asked.peers + 1):
                if most := forecasts_of(asked, name, seed):
                    kept(asked, name, peer, seed, partial(other, case, campaign, peer, most, seed))
    return figures_of(ends_of(asked.ends), asked.designs)


def kept(
    asked: argparse.Namespace, name: str, method: str, seed: int, run: Callable[[], dict[str, Any]]
) -> None:
    """Search, judge and write one end, unless the file has it."""
    key: dict[str, Any] = {"design": name, "method": method, "seed": seed}
    if any(key.items() <= end.items() for end in ends_of(asked.ends)):
        return
    began, used = time.perf_counter(), time.process_time()
    end: dict[str, Any] = key | run()
    end |= {"seconds": time.perf_counter() - began, "cpu_s": time.process_time() - used}
    case, campaign = campaign_of(name)
    if not end["stays"]:
        case = spaces_of(case, campaign)[end["branch"]].design(np.array(end["point"]))
    end |= judged_by_trials(case, campaign, asked.trials) | {"commit": command.commit()}
    with asked.ends.open("a", encoding="utf-8") as file:
        file.write(json.dumps(end) + "\n")
    missed = {margin: round(value, 4) for margin, value in end["margins"].items() if value < 0}
    print(
        f"{name} {method} seed {seed}: {end['arcsec']:.4g} arcsec, "
        f"{'feasible' if end['feasible'] else f'misses {missed}'}, {end['seconds']:.0f} s",
        flush=True,
    )


def ends_of(path: Path) -> list[dict[str, Any]]:
    """The ends in a file."""
    if not path.is_file():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def forecasts_of(asked: argparse.Namespace, name: str, seed: int) -> int:
    """Number of forecasts of startrack's search with a seed; the median of all searches if it was
    not run."""
    ours = [end for end in ends_of(asked.ends) if (end["design"], end["method"]) == (name, OURS)]
    own = [end["forecasts"] for end in ours if end["seed"] == seed]
    return int(np.median(own or [end["forecasts"] for end in ours] or [0]))


def ours(case: Case, campaign: Campaign, seed: int) -> dict[str, Any]:
    """The end of `optimize`, and its reported figures."""
    found = optimize(case, campaign, TrialRunner(seed))
    space = found.space
    return {
        "branch": found.branch,
        "point": space.coordinates(found.best).tolist(),
        "values": space.text(found.best),
        "forecasts": len(found.landscape.forecasts) if found.landscape else 0,
        "claims": found.feasible,
        "claimed_margins": found.margins,
        "stays": found.candidate is not None,
        "rounds": found.rounds,
        "trials": sum(found.trials.values()),
        "ending": found.ending,
    }


def other(case: Case, campaign: Campaign, peer: str, most: int, seed: int) -> dict[str, Any]:
    """The best design of another search in a number of forecasts."""
    scores = Scores(spaces_of(case, campaign)[""], campaign)
    least_of(PEERS[peer], scores, most, seed)
    return {
        "branch": "",
        "point": np.asarray(scores.point).tolist(),
        "forecasts": most,
        "stays": False,
        "claims": math.isfinite(scores.least),
    }


def judged_by_trials(case: Case, campaign: Campaign, trials: int) -> dict[str, Any]:
    """Margins and objective of a design by fresh trials in all conditions, without intervals.

    All designs have the same sky, noise and units, so that a ratio of two designs is more accurate
    than an error.
    """
    runner = TrialRunner(JUDGE)
    if campaign.units:
        count = math.ceil(trials / campaign.trials_per_unit)
        campaign = replace(campaign, fresh_units=count)
    objective, margins = campaign.goal, margins_of(campaign.requirements, case)
    judged = campaign.judged(case)
    rows = [fresh_rows(condition, campaign, runner, trials) for condition in judged]
    for condition, outcomes in zip(judged, rows, strict=True):
        margins |= name_by_condition(
            condition.name, margins_by(condition, campaign, runner, outcomes)
        )
    pairs = [pair for pair in zip(judged, rows, strict=True) if pair[0].weight]
    weighted, outcomes_of = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    if weighted[0].units:
        level = level_interval_of_units(objective, weighted, outcomes_of, campaign, runner).value
    else:
        levels = [float(objective.of(objective.squares(outcomes))) for outcomes in outcomes_of]
        level = objective.over(levels, [one.weight for one in weighted])
    feasible = all(margin >= 0 for margin in margins.values())
    return {"arcsec": level / arcsec, "feasible": feasible, "margins": margins, "judged": trials}


def fresh_rows(condition: Judged, campaign: Campaign, runner: TrialRunner, trials: int) -> Rows:
    """Outcomes of fresh trials in a condition."""
    if condition.units:
        return fresh_units(condition, campaign, runner)
    return runner.run(condition.case, trials, campaign.fidelity)


def margins_by(
    condition: Judged, campaign: Campaign, runner: TrialRunner, outcomes: Rows
) -> dict[str, float]:
    """The margins that need trials, by these trials."""
    counting = counted(condition.needs, condition.case, runner.seed, outcomes)
    boresight = boresights(runner.seed, counting)
    margins = {"false attitudes": -float(outcomes["false"].mean())}
    for claim in claims_of(condition.needs):
        if condition.units and claim.accuracy:
            units = measured_units(claim.accuracy.objective, condition, counting, campaign, runner)
            share = float((units.denoised <= claim.limit).mean())
            margins[claim.name] = share - condition.units.fraction
        else:
            margins[claim.name] = claim.margin(
                claim.bounds(counting, boresight, 0.025, 0.025).value
            )
    return margins


def figures_of(ends: Sequence[dict[str, Any]], designs: Sequence[str]) -> dict[str, Any]:
    """Feasible ends, regrets and times by design, and of other searches."""
    figures: dict[str, Any] = {name: {} for name in ("feasible_ends", "regret", "optimize_s")}
    figures |= {"search_seeds": {}, "search_peers": {}, "claimed_wrongly": {}}
    for name in designs:
        here = [end for end in ends if end["design"] == name]
        mine = [end for end in here if end["method"] == OURS]
        if not mine:
            continue
        best = min((end["arcsec"] for end in here if end["feasible"]), default=math.nan)
        figures["search_seeds"][name] = len(mine)
        figures["feasible_ends"][name] = share(mine)
        figures["claimed_wrongly"][name] = sum(
            end["claims"] and not end["feasible"] for end in mine
        )
        figures["regret"][name] = regret(mine, best)
        figures["optimize_s"][name] = float(np.median([end["seconds"] for end in mine]))
        figures["search_peers"][name] = {
            peer: {"feasible": share(some), "regret": regret(some, best)}
            for peer in OTHERS
            if (some := [end for end in here if end["method"] == peer])
        }
    return figures


def share(ends: Sequence[dict[str, Any]]) -> float:
    """Fraction of feasible ends."""
    return fraction_interval(sum(end["feasible"] for end in ends), len(ends)).value


def regret(ends: Sequence[dict[str, Any]], best: float) -> dict[str, float] | None:
    """Relative excess of the feasible ends over the best."""
    over = [end["arcsec"] / best - 1 for end in ends if end["feasible"]]
    return {"median": float(np.median(over)), "worst": max(over)} if over else None


def smallest(campaign: Campaign) -> Campaign:
    """A campaign that takes seconds."""
    return replace(
        campaign,
        trials=2,
        most_trials=2,
        evaluations=2,
        unit_count=2,
        analytic_evaluations=4,
        fresh_trials=20,
        fresh_units=4,
    )
