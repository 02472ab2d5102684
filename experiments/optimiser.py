"""Does the optimiser find the best design of the example, and how does it stand beside others?

python experiments/optimiser.py --json FILE [--seeds 20] [--peers 20] [--trials 10000]
                                [--methods ours,nlopt_plain,tpe,cmaes] [--ledger DIR]
                                [--picture FILE.png]
"""

from __future__ import annotations

import argparse
import bisect
import contextlib
import dataclasses
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from startrack import Case, arcsec, load_design, shipped
from startrack.core import Floats
from startrack.design import Campaign, DesignSpace, Objective
from startrack.metrics import Star, centre_of_gravity_error, summarise
from startrack.optimise import Evaluation, Ledger, Search, TrialRunner, evaluate, least
from startrack.optimise.evaluate import LOST, PENALTY, forecast, measured, missed
from startrack.optimise.margins import margins as margins_of
from startrack.optimise.runner import FRESH
from startrack.optimise.steps import availability, correct, prospect, refine

JUDGE = 1000  # seed of the trials that all designs are judged on; no search has it
CHOOSING = 300  # trials that the best of all is chosen by
REACH = 0.25  # of each range, around the best, within which the budget is set right
POLISH = 60  # designs that are tried around the best
BUDGETS = (500, 1000, 2000, 4000)  # trials, at which the leaders are compared
JUDGED = 1200  # other trials, on which all are compared with it


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--peers", type=int, default=20, help="seeds of the other optimisers")
    parser.add_argument("--methods", default="ours,nlopt_plain,tpe,cmaes")
    parser.add_argument("--trials", type=int, default=4000, help="that the others may use")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--ledger", type=Path, help="folder; goes on from what is in it")
    options = parser.parse_args()
    figures = search(options) | {"scurve_best_sigma": {n: best_width(n) for n in (3, 5, 7)}}
    options.json.write_text(json.dumps(figures, indent=1) + "\n")
    print(json.dumps(figures, indent=1))
    if options.picture:
        draw(figures, options.picture)


@dataclasses.dataclass
class Run:
    """One search: the designs that led, and after how many trials each did."""

    trials: list[int]
    places: list[Floats]

    def leader(self, trials: int) -> Floats | None:
        """The design that led after so many trials, None where there was none yet."""
        count = bisect.bisect_right(self.trials, trials)
        return self.places[count - 1] if count else None


class Counted:
    """Designs tried one by one, with the trials that they cost; the leader by what it was told."""

    def __init__(self, box: DesignSpace, campaign: Campaign, bench: TrialRunner, most: int) -> None:
        self.box, self.campaign, self.bench, self.most = box, campaign, bench, most
        self.run, self.best, self.spent = Run([], []), math.inf, 0

    def plain(self, place: Floats) -> float:
        """The score by trials alone, as one would write it without the budget.

        A design that misses what needs no trials is spared them, and has the budget's score with
        the penalty, so that the way back is down hill for everyone.
        """
        if self.spent >= self.most:
            self.run.trials.append(self.spent)
            self.run.places.append(self.run.places[-1])
            raise Spent
        place = np.clip(np.array(place, float), 0, 1)
        case = self.box.design(place)
        margins = margins_of(self.campaign.requirements, case)
        if missed(margins):
            return evaluate(self.box, self.campaign, place, self.bench, spare=True).score
        score = by_trials(case, self.campaign, self.bench, self.campaign.trials)
        self.spent += self.campaign.trials
        if score < self.best:
            self.best = score
            self.run.trials.append(self.spent)
            self.run.places.append(place)
        return score


def by_trials(
    case: Case, campaign: Campaign, bench: TrialRunner, trials: int, first: int = 0
) -> float:
    """ln(error / arcsec) of so many trials, with the L1 penalty for what is not met."""
    outcomes = bench.run(case, trials, campaign.fidelity, first)
    objective = Objective.read(campaign.objective)
    error = float(objective.of(objective.squares(outcomes)))
    margins = margins_of(campaign.requirements, case)
    margins |= measured(campaign.requirements, summarise(outcomes))
    return (math.log(error / arcsec) if error > 0 else LOST) + PENALTY * missed(margins)


class Spent(Exception):
    """All trials were used."""


def ours(box: DesignSpace, campaign: Campaign, seed: int, start: Floats, ledger: Ledger) -> Run:
    bench = TrialRunner(seed, ledger=ledger)
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


def nlopt_plain(box: DesignSpace, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    """Sbplx on the same fixed trials for each design, from the case itself."""
    counted = Counted(box, campaign, TrialRunner(seed, ledger=ledger), most)
    with contextlib.suppress(Spent):
        least(counted.plain, box.start, Search(evaluations=10_000, last_step=1e-4))
    return counted.run


def tpe(box: DesignSpace, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    counted = Counted(box, campaign, TrialRunner(seed, ledger=ledger), most)
    with contextlib.suppress(Spent):
        by_tpe(counted.plain, box.start, seed, 10_000)
    return counted.run


def by_tpe(score: Callable[[Floats], float], start: Floats, seed: int, tries: int) -> Floats:
    """Optuna's tree-structured Parzen estimator, told the start first."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    names = [f"x{n}" for n in range(len(start))]

    def objective(trial: Any) -> float:
        return score(np.array([trial.suggest_float(name, 0, 1) for name in names]))

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, multivariate=False))
    study.enqueue_trial(dict(zip(names, start.tolist(), strict=True)))
    study.optimize(objective, n_trials=tries)
    return np.array([study.best_params[name] for name in names])


def cmaes(box: DesignSpace, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    counted = Counted(box, campaign, TrialRunner(seed, ledger=ledger), most)
    with contextlib.suppress(Spent):
        by_cmaes(counted.plain, box.start, seed, 10_000)
    return counted.run


def by_cmaes(score: Callable[[Floats], float], start: Floats, seed: int, tries: int) -> Floats:
    """CMA-ES from the case itself, with its own defaults and bounds."""
    import cma

    settings = {"bounds": [0, 1], "seed": seed + 1, "verbose": -9, "maxfevals": tries}
    strategy = cma.CMAEvolutionStrategy(start.tolist(), 0.15, settings)
    while not strategy.stop():
        places = strategy.ask()
        strategy.tell(places, [score(np.array(place)) for place in places])
    return np.array(strategy.result.xbest)


class Truth:
    """Any design by trials of a seed that no search has, the same for all designs."""

    def __init__(self, box: DesignSpace, campaign: Campaign, ledger: Ledger) -> None:
        self.box, self.campaign = box, campaign
        self.bench = TrialRunner(JUDGE, ledger=ledger)

    def score(self, place: Floats, trials: int, first: int = 0) -> float:
        case = self.box.design(place)
        try:
            return by_trials(case, self.campaign, self.bench, trials, first)
        except ValueError:  # it cannot be rendered
            return LOST + PENALTY

    def shown(self, place: Floats) -> bool:
        """Whether the availability asked is shown on fresh trials, at its bound."""
        case = self.box.design(place)
        outcomes = self.bench.run(case, JUDGED, self.campaign.fidelity, FRESH)
        fraction = availability(case, self.campaign, self.bench, outcomes)
        return fraction.low >= self.campaign.requirements.min_availability

    def reference(self, places: list[Floats]) -> Floats:
        """The best of all places and of where the budget, set right by them, is best.

        It is found by trials that nothing is compared on afterwards, or its luck would be taken
        for its merit; the last choice alone, between two, is on the others, against ourselves.
        """
        best = min(places, key=lambda place: self.score(place, CHOOSING))
        tried = [
            evaluate(self.box, self.campaign, place, self.bench, CHOOSING)
            for place in places
            if np.abs(place - best).max() <= REACH
        ]
        correction = correct(tried, best, REACH)

        def score(place: Floats) -> float:
            if np.abs(place - best).max() > REACH:
                return math.nan
            case = self.box.design(place)
            expected = forecast(case, Objective.read(self.campaign.objective))
            margins = margins_of(self.campaign.requirements, case)
            return math.log(expected / arcsec) + correction(place) + PENALTY * missed(margins)

        refined = least(score, best, Search(evaluations=150, first_step=0.05)).place
        best = min((best, refined), key=lambda place: self.score(place, CHOOSING))
        # The budget has no say in this: Sbplx on the trials themselves.
        polished = least(
            lambda place: self.score(place, CHOOSING),
            best,
            Search(evaluations=POLISH, first_step=0.05),
        ).place
        return min((best, polished), key=lambda place: self.score(place, JUDGED, FRESH))


def best_width(window: int) -> float:
    """Pixel, sigma of a star whose centre of gravity has the least S-curve; no noise.

    The optimum is known: 0.42, 0.574 and 0.696 for windows of 3, 5 and 7 pixels.
    """

    def bias(place: Floats) -> float:
        return math.log(centre_of_gravity_error(Star(1e12, 0.3 + 0.7 * place[0]), window)[1])

    found = least(bias, np.array([0.9]), Search(evaluations=60))
    return 0.3 + 0.7 * float(found.place[0])


def example() -> tuple[Case, Campaign]:
    design = load_design(shipped("designs/nanosatellite.toml"))
    assert design.campaign
    return design.case, design.campaign


def search(options: argparse.Namespace) -> dict[str, Any]:
    """The example campaign by four optimisers, the others with a fixed number of trials."""
    case, campaign = example()
    box = DesignSpace(case, campaign.variables)
    started = time.process_time()
    start = prospect(box, campaign, box.start).place
    print(f"prospect {time.process_time() - started:.1f} s", start.round(3), flush=True)
    others: dict[str, Callable[..., Run]] = {"nlopt_plain": nlopt_plain, "tpe": tpe, "cmaes": cmaes}
    names = options.methods.split(",")
    seeds = {name: options.seeds if name == "ours" else options.peers for name in names}
    plan = [
        (name, seed) for seed in range(max(seeds.values())) for name in names if seed < seeds[name]
    ]
    runs: dict[str, list[Run]] = {}
    with Ledger(options.ledger / "trials.sqlite" if options.ledger else None) as ledger:
        for name, seed in plan:
            began = time.process_time()
            if name == "ours":
                run = ours(box, campaign, seed, start, ledger)
            else:
                run = others[name](box, campaign, seed, options.trials, ledger)
            runs.setdefault(name, []).append(run)
            print(name, seed, run.trials[-1], run.places[-1].round(3),
                  f"{time.process_time() - began:.0f} s", flush=True)  # fmt: skip
        return judge(box, campaign, runs, ledger)


def judge(
    box: DesignSpace, campaign: Campaign, runs: dict[str, list[Run]], ledger: Ledger
) -> dict[str, Any]:
    """Regrets against the best design of all, on the same trials."""
    truth = Truth(box, campaign, ledger)
    place = truth.reference([run.places[-1] for every in runs.values() for run in every])
    best = truth.score(place, JUDGED, FRESH)
    begun = truth.score(place, CHOOSING)
    print("optimum", place.round(4), math.exp(best), box.text(box.design(place)), flush=True)
    figures: dict[str, Any] = {
        "optimum_arcsec": math.exp(best),
        "optimum": box.text(box.design(place)),
    }
    for name, every in runs.items():
        regret = [math.exp(truth.score(run.places[-1], JUDGED, FRESH) - best) - 1 for run in every]
        prefix = "" if name == "ours" else f"{name}_"
        figures |= {
            f"{prefix}regret_median": float(np.median(regret)),
            f"{prefix}regret_worst": float(np.max(regret)),
            f"{prefix}seeds": len(regret),
            f"{prefix}trials": int(np.median([run.trials[-1] for run in every])),
            f"{prefix}regrets": regret,
            f"{prefix}path": [
                float(np.median([truth.score(leader, CHOOSING) for leader in leaders]) - begun)
                for budget in BUDGETS
                if (leaders := [at for run in every if (at := run.leader(budget)) is not None])
            ],
        }
    figures["constraint_violations_fresh"] = sum(
        not truth.shown(run.places[-1]) for run in runs.get("ours", [])
    )
    return figures


def draw(figures: dict[str, Any], path: Path) -> None:
    """Regret against trials, one line a method."""
    figure = Figure(figsize=(6.5, 4), layout="constrained")
    axes = figure.subplots()
    for prefix, label, colour in (
        ("", "startrack", "#2e7d5b"),
        ("nlopt_plain_", "Sbplx, fixed trials", "#3567a8"),
        ("tpe_", "TPE (Optuna)", "#c0392b"),
        ("cmaes_", "CMA-ES", "#8e6bbf"),
    ):
        if f"{prefix}path" not in figures:
            continue
        regret = 100 * np.expm1(figures[f"{prefix}path"])
        seeds = figures[f"{prefix}seeds"]
        axes.plot(BUDGETS[-len(regret) :], regret, "o-", ms=4, color=colour,
                  label=f"{label}, {seeds} seeds")  # fmt: skip
    axes.set(xscale="log", xlabel="window trials used", ylabel="median regret (%)")
    axes.set_yscale("symlog", linthresh=2)
    axes.set_xticks(BUDGETS, [str(one) for one in BUDGETS])
    axes.minorticks_off()
    axes.axhline(0, color="0.6", lw=0.8)
    axes.set_title(
        f"five variables, judged on {CHOOSING} trials that no search has", fontsize=9, loc="left"
    )
    axes.legend(fontsize=8)
    figure.savefig(path)


if __name__ == "__main__":
    main()
