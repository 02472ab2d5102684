"""Does the optimiser find the best design of the example, and how does it stand beside others?

python experiments/optimiser.py --json FILE [--seeds 20] [--peers 20] [--trials 10000]
                                [--methods ours,nlopt_plain,tpe,cmaes] [--ledger DIR]
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.case import Case, Fidelity
from startrack.catalog import shipped
from startrack.design import load_design
from startrack.study.bench import Bench
from startrack.study.box import Box
from startrack.study.campaign import Campaign
from startrack.study.correction import correct
from startrack.study.evaluate import PENALTY, Evaluation, evaluate, forecast, measured_score, missed
from startrack.study.ledger import Ledger
from startrack.study.objective import Objective
from startrack.study.prospect import prospect
from startrack.study.refine import refine
from startrack.study.search import Search, least

Floats = NDArray[np.float64]
JUDGE = 1000  # seed of the trials that all designs are judged on; no search has it
JUDGED = 400  # trials of each design there


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--peers", type=int, default=20, help="seeds of the other optimisers")
    parser.add_argument("--methods", default="ours,nlopt_plain,tpe,cmaes")
    parser.add_argument("--trials", type=int, default=10_000, help="that the others may use")
    parser.add_argument("--ledger", type=Path, help="folder; goes on from what is in it")
    options = parser.parse_args()
    figures = search(options)
    options.json.write_text(json.dumps(figures, indent=1) + "\n")
    print(json.dumps(figures, indent=1))


@dataclasses.dataclass
class Run:
    """One search: the designs that led, and after how many trials each did."""

    trials: list[int]
    places: list[Floats]


class Counted:
    """Designs tried one by one, with the trials that they cost; the leader by what it was told."""

    def __init__(self, box: Box, campaign: Campaign, bench: Bench, most: int) -> None:
        self.box, self.campaign, self.bench, self.most = box, campaign, bench, most
        self.run, self.best, self.spent = Run([], []), math.inf, 0

    def plain(self, place: Floats) -> float:
        """The score by trials alone, as one would write it without the budget."""
        if self.spent >= self.most:
            raise Spent
        one = evaluate(self.box, self.campaign, np.asarray(place, float), self.bench, spare=True)
        self.spent += one.trials
        score = measured_score(one)
        if score < self.best:
            self.best = score
            self.run.trials.append(self.spent)
            self.run.places.append(np.clip(np.array(place, float), 0, 1))
        return score


class Spent(Exception):
    """All trials were used."""


def ours(box: Box, campaign: Campaign, seed: int, start: Floats, ledger: Ledger) -> Run:
    bench = Bench(seed, ledger=ledger)
    run = Run([], [])
    best: dict[int, float] = {}
    counted = 0

    def watch(one: Evaluation) -> None:
        nonlocal counted
        counted += one.trials
        if one.feasible and one.score < best.get(one.trials, math.inf):
            best[one.trials] = one.score
            run.trials.append(counted)
            run.places.append(np.array(one.place))

    final, _ = refine(box, start, campaign, bench, watch)
    run.trials.append(counted)
    run.places.append(np.array(final[0].place))
    return run


def nlopt_plain(box: Box, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    """Sbplx on the same fixed trials for each design, from the case itself."""
    counted = Counted(box, campaign, Bench(seed, ledger=ledger), most)
    with contextlib.suppress(Spent):
        least(counted.plain, box.start, Search(evaluations=10_000, last_step=1e-4))
    return counted.run


def tpe(box: Box, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    """Optuna's tree-structured Parzen estimator, told the start first."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    counted = Counted(box, campaign, Bench(seed, ledger=ledger), most)
    names = [variable.name for variable in box.variables]

    def objective(trial: Any) -> float:
        return counted.plain(np.array([trial.suggest_float(name, 0, 1) for name in names]))

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, multivariate=False))
    study.enqueue_trial(dict(zip(names, box.start.tolist(), strict=True)))
    with contextlib.suppress(Spent):
        study.optimize(objective, n_trials=10_000)
    return counted.run


def cmaes(box: Box, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    """CMA-ES from the case itself, with its own defaults and bounds."""
    import cma

    counted = Counted(box, campaign, Bench(seed, ledger=ledger), most)
    settings = {"bounds": [0, 1], "seed": seed + 1, "verbose": -9, "maxfevals": 10_000}
    strategy = cma.CMAEvolutionStrategy(box.start.tolist(), 0.15, settings)
    with contextlib.suppress(Spent):
        while not strategy.stop():
            places = strategy.ask()
            strategy.tell(places, [counted.plain(np.array(place)) for place in places])
    return counted.run


class Truth:
    """The error of any design by many trials of a seed that no search has.

    Near the best of all, the budget corrected by all that was tried there; elsewhere the trials
    of the design itself, to 2.5 %.
    """

    def __init__(self, box: Box, campaign: Campaign, ledger: Ledger) -> None:
        self.box, self.campaign = box, campaign
        self.bench = Bench(JUDGE, ledger=ledger)
        self.tried = dict[bytes, Evaluation]()

    def try_(self, place: Floats) -> Evaluation:
        key = place.tobytes()
        if key not in self.tried:
            self.tried[key] = evaluate(self.box, self.campaign, place, self.bench, JUDGED)
        return self.tried[key]

    def optimum(self, near: Floats, reach: float = 0.25) -> tuple[Floats, float]:
        """Refine from the best that any search found, on the budget corrected by all trials."""
        self.middle, self.reach = near, reach
        self.correction = correct(list(self.tried.values()), near, reach)

        def score(place: Floats) -> float:
            if np.abs(place - near).max() > reach:
                return math.nan
            return self.smooth(place)

        found = least(score, near, Search(evaluations=250, first_step=0.05))
        return found.place, found.score

    def smooth(self, place: Floats) -> float:
        """ln(error / arcsec) with penalties for what needs no trials."""
        case = self.box.design(place)
        margins = self.campaign.requirements.margins(case)
        expected = forecast(case, Objective.read(self.campaign.objective))
        log = math.log(expected * 206264.806) + self.correction(place)
        return log + PENALTY * missed(margins)

    def score(self, place: Floats) -> float:
        if np.abs(place - self.middle).max() <= self.reach:
            one = self.try_(place)
            lost = PENALTY * max(0.0, -one.margins.get("availability", -1.0))
            return self.smooth(place) + lost
        return measured_score(self.try_(place))


def example() -> tuple[Case, Campaign]:
    design = load_design(shipped("designs/nanosatellite.toml"))
    assert design.campaign
    return design.case, design.campaign


def search(options: argparse.Namespace) -> dict[str, Any]:
    """The example campaign by four optimisers, the others with a fixed number of trials."""
    case, campaign = example()
    box = Box(case, campaign.variables)
    started = time.process_time()
    start = prospect(box, campaign, box.start).place
    print(f"prospect {time.process_time() - started:.1f} s", start.round(3), flush=True)
    others: dict[str, Callable[..., Run]] = {"nlopt_plain": nlopt_plain, "tpe": tpe, "cmaes": cmaes}
    runs: dict[str, list[Run]] = {}

    def note(name: str, seed: int, run: Run) -> None:
        runs.setdefault(name, []).append(run)
        print(name, seed, run.trials[-1], run.places[-1].round(3),
              f"{time.process_time() - started:.0f} s", flush=True)  # fmt: skip

    for name in options.methods.split(","):
        with Ledger(options.ledger / f"{name}.sqlite" if options.ledger else None) as ledger:
            for seed in range(options.seeds if name == "ours" else options.peers):
                if name == "ours":
                    note(name, seed, ours(box, campaign, seed, start, ledger))
                else:
                    note(name, seed, others[name](box, campaign, seed, options.trials, ledger))
    with Ledger(options.ledger / "truth.sqlite" if options.ledger else None) as ledger:
        return judge(box, campaign, runs, ledger)


def judge(
    box: Box, campaign: Campaign, runs: dict[str, list[Run]], ledger: Ledger
) -> dict[str, Any]:
    """Regrets against the best design of all."""
    truth = Truth(box, campaign, ledger)
    for run in (run for every in runs.values() for run in every):
        truth.try_(run.places[-1])
    leader = min(
        (run.places[-1] for every in runs.values() for run in every),
        key=lambda place: measured_score(truth.try_(place)),
    )
    place, best = truth.optimum(leader)
    print("optimum", place.round(4), math.exp(best), box.text(box.design(place)), flush=True)
    print("judged with", truth.bench.tried.get(Fidelity.WINDOW), "trials", flush=True)
    figures: dict[str, Any] = {"optimum_arcsec": math.exp(best)}
    for name, every in runs.items():
        regret = [math.exp(truth.score(run.places[-1]) - best) - 1 for run in every]
        prefix = "regret" if name == "ours" else f"{name}_regret"
        figures |= {
            f"{prefix}_median": float(np.median(regret)),
            f"{prefix}_worst": float(np.max(regret)),
            f"{prefix}_seeds": len(regret),
            "trials" if name == "ours" else f"{name}_trials": int(
                np.median([run.trials[-1] for run in every])
            ),
            f"{prefix}s": regret,
        }
    return figures


if __name__ == "__main__":
    main()
