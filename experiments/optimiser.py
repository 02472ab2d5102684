"""Does the optimiser find the best design of the example, and how does it compare with other
optimisers?

python experiments/optimiser.py [--json FILE] [--seeds 20] [--peers 20] [--trials 10000]
                                [--methods ours,nlopt_plain,tpe,cmaes] [--ledger DIR]
                                [--picture FILE.png] [--quick]
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
from typing import Any, NamedTuple

import command
import numpy as np
from centre_of_gravity import centre_of_gravity_error

from startrack import Case, arcsec, load_design, shipped
from startrack.core import Floats
from startrack.design import Campaign, DesignSpace, Objective
from startrack.metrics import Star
from startrack.optimise import (
    FRESH,
    LOST,
    PENALTY,
    Evaluation,
    Explorer,
    Ledger,
    Search,
    TrackerSource,
    TrialRunner,
    confirm_requirements,
    evaluate,
    expected_objective,
    explore,
    fit_correction,
    measured_margins,
    minimise,
    missed,
    refine,
    trials_of_tracker,
)
from startrack.plots import CYCLE, MARKERS, legend_below, picture, save_picture, styled
from startrack.verification import margins as margins_of

JUDGE = 1000  # seed of the trials that judge all designs; no search uses it
REACH = 0.25  # fraction of each range, around the best, in which the budget is corrected
BUDGETS = (500, 1000, 2000, 4000)  # numbers of trials at which the leading designs are compared
SMALLEST: dict[str, Any] = {  # smallest campaign, for --quick
    "trials": 2,
    "most_trials": 2,
    "evaluations": 2,
    "analytic_evaluations": 2,
}


class Judging(NamedTuple):
    """Settings of the judgement of searches.

    choosing   trials for the choice of the overall best
    polish     designs tried around the best
    judged     other trials, for the comparison of all with the best
    """

    choosing: int = 300
    polish: int = 60
    judged: int = 1200


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument(
        "--peers", type=int, default=20, help="number of seeds of each other optimiser"
    )
    parser.add_argument("--methods", default="ours,nlopt_plain,tpe,cmaes")
    parser.add_argument(
        "--trials", type=int, default=4000, help="largest number of trials of each other optimiser"
    )
    parser.add_argument("--picture", type=Path)
    parser.add_argument(
        "--ledger", type=Path, help="folder of finished trials, from which a stopped run continues"
    )
    options = command.read(parser, seeds=1, peers=1, trials=4)
    figures = search(options) | {
        "scurve_best_sigma": {n: best_width(n, 5 if options.quick else 60) for n in (3, 5, 7)}
    }
    command.save(options, figures)
    print(json.dumps(figures, indent=1))
    if options.picture:
        draw(figures, options.picture)


@dataclasses.dataclass
class Run:
    """One search: the leading designs, and the number of trials after which each led."""

    trials: list[int]
    points: list[Floats]

    def leader(self, trials: int) -> Floats | None:
        """The leading design after a number of trials; None if there was none yet."""
        count = bisect.bisect_right(self.trials, trials)
        return self.points[count - 1] if count else None


class Counted:
    """Designs tried one by one, with their numbers of trials; the leader by its score."""

    def __init__(
        self, space: DesignSpace, campaign: Campaign, runner: TrialRunner, most: int
    ) -> None:
        self.space, self.campaign, self.runner, self.most = space, campaign, runner, most
        self.run, self.best, self.spent = Run([], []), math.inf, 0

    def plain(self, coordinates: Floats) -> float:
        """The score by trials alone, without the budget.

        A design that misses a limit without trials has no trials: its score is the budget's score
        with the penalty. So the score decreases towards designs that meet the limits.
        """
        if self.spent >= self.most:
            self.run.trials.append(self.spent)
            self.run.points.append(self.run.points[-1])
            raise Spent
        coordinates = np.clip(np.array(coordinates, float), 0, 1)
        case = self.space.design(coordinates)
        margins = margins_of(self.campaign.requirements, case)
        if missed(margins):
            return evaluate(self.space, self.campaign, coordinates, self.runner, spare=True).score
        score = by_trials(case, self.campaign, self.runner, self.campaign.trials)
        self.spent += self.campaign.trials
        if score < self.best:
            self.best = score
            self.run.trials.append(self.spent)
            self.run.points.append(coordinates)
        return score


def by_trials(
    case: Case, campaign: Campaign, runner: TrialRunner, trials: int, first: int = 0
) -> float:
    """ln(error / arcsec) by a number of trials, with the L1 penalty for missed limits."""
    outcomes = runner.run(case, trials, campaign.fidelity, first)
    objective = Objective.read(campaign.objective)
    error = float(objective.of(objective.squares(outcomes)))
    margins = margins_of(campaign.requirements, case)
    margins |= measured_margins(campaign.judged(case)[0], outcomes, runner.seed)
    return (math.log(error / arcsec) if error > 0 else LOST) + PENALTY * missed(margins)


class Spent(Exception):
    """All trials were used."""


def ours(space: DesignSpace, campaign: Campaign, seed: int, ledger: Ledger) -> Run:
    runner = TrialRunner(seed, ledger=ledger)
    explorer = Explorer(TrackerSource(space, campaign, runner))
    explore({"": explorer}, {"": space.start}, campaign)
    print(f"{len(explorer.points)} forecasts; {explorer.ending}", flush=True)
    run = Run([], [])
    best: dict[int, float] = {}
    counted = 0

    def watch(one: Evaluation) -> None:
        nonlocal counted
        counted += one.trials
        if one.feasible and one.score < best.get(one.trials, math.inf):
            best[one.trials] = one.score
            run.trials.append(counted)
            run.points.append(np.array(one.coordinates))

    try_design = trials_of_tracker(explorer, space, campaign, runner)
    final, _ = refine(explorer, campaign.evaluations, campaign.most_trials, try_design, watch)
    run.trials.append(counted)
    run.points.append(np.array(final[0].coordinates))
    return run


def nlopt_plain(
    space: DesignSpace, campaign: Campaign, seed: int, most: int, ledger: Ledger
) -> Run:
    """Sbplx on fixed trials for each design, from the start design."""
    counted = Counted(space, campaign, TrialRunner(seed, ledger=ledger), most)
    with contextlib.suppress(Spent):
        minimise(counted.plain, space.start, Search(evaluations=10_000, last_step=1e-4))
    return counted.run


def tpe(space: DesignSpace, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    counted = Counted(space, campaign, TrialRunner(seed, ledger=ledger), most)
    with contextlib.suppress(Spent):
        by_tpe(counted.plain, space.start, seed, 10_000)
    return counted.run


def by_tpe(score: Callable[[Floats], float], start: Floats, seed: int, tries: int) -> Floats:
    """Optuna's tree-structured Parzen estimator, with the start design as first trial."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    names = [f"x{n}" for n in range(len(start))]

    def objective(trial: Any) -> float:
        return score(np.array([trial.suggest_float(name, 0, 1) for name in names]))

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, multivariate=False))
    study.enqueue_trial(dict(zip(names, start.tolist(), strict=True)))
    study.optimize(objective, n_trials=tries)
    return np.array([study.best_params[name] for name in names])


def cmaes(space: DesignSpace, campaign: Campaign, seed: int, most: int, ledger: Ledger) -> Run:
    counted = Counted(space, campaign, TrialRunner(seed, ledger=ledger), most)
    with contextlib.suppress(Spent):
        by_cmaes(counted.plain, space.start, seed, 10_000)
    return counted.run


def by_cmaes(score: Callable[[Floats], float], start: Floats, seed: int, tries: int) -> Floats:
    """CMA-ES from the start design, with its defaults and bounds."""
    import cma

    settings = {"bounds": [0, 1], "seed": seed + 1, "verbose": -9, "maxfevals": tries}
    strategy = cma.CMAEvolutionStrategy(start.tolist(), 0.15, settings)
    while not strategy.stop():
        points = strategy.ask()
        strategy.tell(points, [score(np.array(coordinates)) for coordinates in points])
    return np.array(strategy.result.xbest)


class Truth:
    """The error of any design by trials of a seed that no search uses, the same for all designs."""

    def __init__(
        self, space: DesignSpace, campaign: Campaign, ledger: Ledger, judging: Judging
    ) -> None:
        self.space, self.campaign, self.judging = space, campaign, judging
        self.runner = TrialRunner(JUDGE, ledger=ledger)

    def score(self, coordinates: Floats, trials: int, first: int = 0) -> float:
        case = self.space.design(coordinates)
        try:
            return by_trials(case, self.campaign, self.runner, trials, first)
        except ValueError:  # it cannot be rendered
            return LOST + PENALTY

    def shown(self, coordinates: Floats) -> bool:
        """Whether the required availability is shown on fresh trials, by its bound."""
        case = self.space.design(coordinates)
        outcomes = self.runner.run(case, self.judging.judged, self.campaign.fidelity, FRESH)
        own = self.campaign.judged(case)[0]
        return (
            confirm_requirements(own, self.campaign, self.runner, outcomes)["availability"].margin
            >= 0
        )

    def reference(self, points: list[Floats]) -> Floats:
        """The best design: best of all tried designs, and of the optimum of the corrected budget.

        The trials for this choice are not used in later comparisons, which would be biased in its
        favour. Only the last choice, between two designs, uses the comparison's trials, to
        startrack's disadvantage.
        """
        choosing, polish, judged = self.judging
        best = min(points, key=lambda coordinates: self.score(coordinates, choosing))
        tried = [
            evaluate(self.space, self.campaign, coordinates, self.runner, choosing)
            for coordinates in points
            if np.abs(coordinates - best).max() <= REACH
        ]
        correction = fit_correction(tried, best, REACH)

        def score(coordinates: Floats) -> float:
            if np.abs(coordinates - best).max() > REACH:
                return math.nan
            case = self.space.design(coordinates)
            expected = expected_objective(case, self.campaign)
            margins = margins_of(self.campaign.requirements, case)
            return math.log(expected / arcsec) + correction(coordinates) + PENALTY * missed(margins)

        refined = minimise(
            score, best, Search(evaluations=max(polish, 2) * 5 // 2, first_step=0.05)
        ).coordinates
        best = min((best, refined), key=lambda coordinates: self.score(coordinates, choosing))
        # The budget is not used here: Sbplx uses the trials directly.
        polished = minimise(
            lambda coordinates: self.score(coordinates, choosing),
            best,
            Search(evaluations=polish, first_step=0.05),
        ).coordinates
        return min((best, polished), key=lambda coordinates: self.score(coordinates, judged, FRESH))


def best_width(window: int, evaluations: int) -> float:
    """Sigma of a star with the smallest S-curve of the centre of gravity, without noise, pixel.

    The known optimum is 0.42, 0.574 and 0.696 for windows of 3, 5 and 7 pixels.
    """

    def bias(coordinates: Floats) -> float:
        return math.log(centre_of_gravity_error(Star(1e12, 0.3 + 0.7 * coordinates[0]), window)[1])

    found = minimise(bias, np.array([0.9]), Search(evaluations=evaluations))
    return 0.3 + 0.7 * float(found.coordinates[0])


def example() -> tuple[Case, Campaign]:
    design = load_design(shipped("designs/noise_only.toml"))
    assert design.campaign
    return design.case, design.campaign


def search(options: argparse.Namespace) -> dict[str, Any]:
    """The example campaign by four optimisers; the others have a fixed number of trials."""
    case, campaign = example()
    judging = Judging()
    if options.quick:
        campaign, judging = dataclasses.replace(campaign, **SMALLEST), Judging(2, 1, 2)
    space = DesignSpace(case, campaign.variables)
    others: dict[str, Callable[..., Run]] = {"nlopt_plain": nlopt_plain, "tpe": tpe, "cmaes": cmaes}
    needs = {"tpe": "optuna", "cmaes": "cma"}
    names = [
        name
        for name in options.methods.split(",")
        if name not in needs or not command.missing(f"{name} is", needs[name])
    ]
    seeds = {name: options.seeds if name == "ours" else options.peers for name in names}
    plan = [
        (name, seed) for seed in range(max(seeds.values())) for name in names if seed < seeds[name]
    ]
    runs: dict[str, list[Run]] = {}
    with Ledger(options.ledger / "trials.sqlite" if options.ledger else None) as ledger:
        for name, seed in plan:
            began = time.process_time()
            if name == "ours":
                run = ours(space, campaign, seed, ledger)
            else:
                run = others[name](space, campaign, seed, options.trials, ledger)
            runs.setdefault(name, []).append(run)
            print(
                name,
                seed,
                run.trials[-1],
                run.points[-1].round(3),
                f"{time.process_time() - began:.0f} s",
                flush=True,
            )
        return judge(space, campaign, runs, ledger, judging)


def judge(
    space: DesignSpace,
    campaign: Campaign,
    runs: dict[str, list[Run]],
    ledger: Ledger,
    judging: Judging,
) -> dict[str, Any]:
    """Regrets relative to the overall best design, on the same trials."""
    truth = Truth(space, campaign, ledger, judging)
    coordinates = truth.reference([run.points[-1] for every in runs.values() for run in every])
    best = truth.score(coordinates, judging.judged, FRESH)
    begun = truth.score(coordinates, judging.choosing)
    print(
        "optimum",
        coordinates.round(4),
        math.exp(best),
        space.text(space.design(coordinates)),
        flush=True,
    )
    figures: dict[str, Any] = {
        "optimum_arcsec": math.exp(best),
        "optimum": space.text(space.design(coordinates)),
    }
    for name, every in runs.items():
        regret = [
            math.exp(truth.score(run.points[-1], judging.judged, FRESH) - best) - 1 for run in every
        ]
        prefix = "" if name == "ours" else f"{name}_"
        figures |= {
            f"{prefix}regret_median": float(np.median(regret)),
            f"{prefix}regret_worst": float(np.max(regret)),
            f"{prefix}seeds": len(regret),
            f"{prefix}trials": int(np.median([run.trials[-1] for run in every])),
            f"{prefix}regrets": regret,
            f"{prefix}path": [
                float(
                    np.median([truth.score(leader, judging.choosing) for leader in leaders]) - begun
                )
                for budget in BUDGETS
                if (leaders := [at for run in every if (at := run.leader(budget)) is not None])
            ],
        }
    figures["constraint_violations_fresh"] = sum(
        not truth.shown(run.points[-1]) for run in runs.get("ours", [])
    )
    return figures


@styled
def draw(figures: dict[str, Any], path: Path) -> None:
    """Regret over trials, one line per method."""
    figure = picture(
        4.8, f"Five variables, judged on {Judging().choosing} trials that no search uses"
    )
    axes = figure.subplots()
    for (prefix, label), colour, mark in zip(
        {
            "": "startrack",
            "nlopt_plain_": "Sbplx, fixed trials",
            "tpe_": "TPE (Optuna)",
            "cmaes_": "CMA-ES",
        }.items(),
        CYCLE,
        MARKERS,
        strict=False,
    ):
        if f"{prefix}path" not in figures:
            continue
        regret = 100 * np.expm1(figures[f"{prefix}path"])
        seeds = figures[f"{prefix}seeds"]
        axes.plot(
            BUDGETS[-len(regret) :],
            regret,
            f"{mark}-",
            ms=4,
            color=colour,
            label=f"{label}, {seeds} seeds",
        )
    axes.set(xscale="log", xlabel="window trials used (number)", ylabel="median regret (%)")
    axes.set_yscale("symlog", linthresh=2)
    axes.set_xticks(BUDGETS, [str(one) for one in BUDGETS])
    axes.minorticks_off()
    axes.axhline(0, color="0.6", lw=0.8)
    legend_below(axes, 2)
    save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
