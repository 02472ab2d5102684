"""How much does a search improve a first design, on fresh trials?

python experiments/design.py [DESIGN] [--json FILE] [--picture FILE.png] [--workers 2]
                             [--seed 1] [--quick]

DESIGN is a name in catalogs/designs, such as nanosatellite or high_accuracy, or a file; --quick
takes noise_only.
The result is judged on frames that the search has not used; all intervals have 95 % confidence.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from pathlib import Path
from typing import Any

import command
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from startrack import Fidelity, arcsec, load_design, shipped
from startrack.design import AXES, Campaign, Objective
from startrack.metrics import Interval
from startrack.montecarlo import Sampling, pool, warm
from startrack.optimise import (
    FRESH,
    Evaluation,
    Ledger,
    Optimum,
    TrialRunner,
    comparison,
    optimize,
    optimum_values,
)
from startrack.plots import (
    BLUE,
    GREEN,
    GREY,
    RED,
    draw_variables,
    legend_below,
    panel_title,
    picture,
    save_picture,
    styled,
    variable_panels,
)

SMALLEST: dict[str, Any] = {  # of a campaign, under --quick
    "trials": 3,
    "most_trials": 3,
    "evaluations": 2,
    "analytic_evaluations": 2,
    "fresh_trials": 3,
}
BEFORE, AFTER, MISSED = BLUE, GREEN, RED


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("design", nargs="?", default="nanosatellite")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--ledger", type=Path, help="file of finished trials, from which a stopped run continues"
    )
    options = command.read(parser, workers=1)
    path = Path("noise_only" if options.quick else options.design)
    if not path.suffix:
        path = shipped(f"designs/{path}.toml")
    design = load_design(path)
    campaign = design.campaign
    assert campaign, path
    if options.quick:
        campaign = dataclasses.replace(campaign, **SMALLEST)
    began = time.monotonic()
    if options.workers > 1:
        for fidelity in (campaign.fidelity, Fidelity.FRAME):
            warm(design.case, Sampling(fidelity))
    with Ledger(options.ledger) as ledger, pool(options.workers) as executor:
        runner = TrialRunner(options.seed, executor, options.workers, ledger)
        optimum = optimize(design.case, campaign, runner, lambda one: told(one, began))
        fresh = [
            runner.run(case, campaign.fresh_trials, Fidelity.FRAME, FRESH)
            for case in (optimum.start, optimum.best)
        ]
    print(f"{optimum.branch}\n{comparison(optimum, campaign)}\n\n{optimum.ending}")
    figures = {"design": path.stem, "seed": options.seed, **optimum_values(optimum, campaign)}
    command.save(options, command.finite(figures))
    if options.picture:
        draw(optimum, campaign, fresh, path.stem, options.picture)


def told(one: Evaluation, began: float) -> None:
    """Print one line for each design, to show progress."""
    print(
        f"{time.monotonic() - began:6.0f} s  {one.trials:4d} trials  {one.error / arcsec:8.3f} "
        f"arcsec  {'' if one.feasible else 'misses a requirement'}",
        flush=True,
    )


@styled
def draw(
    optimum: Optimum, campaign: Campaign, fresh: list[NDArray[np.void]], name: str, path: Path
) -> None:
    """Draw the error before and after, and the path of the search."""
    branch = f", {optimum.branch}" if optimum.branch else ""
    figure = picture(0.6, f"{name}{branch}: better by {told_interval(optimum.factor, 2)}")
    count = len(optimum.space.variables)
    shares, upper, *variables = variable_panels(figure, count, (3.5, 3.5))
    draw_shares(shares, optimum, campaign, fresh)
    draw_path(upper, optimum)
    draw_variables(variables, optimum)
    save_picture(path, figure)


def draw_shares(
    axes: Axes, optimum: Optimum, campaign: Campaign, fresh: list[NDArray[np.void]]
) -> None:
    """The fraction of fresh frames whose error is at most a given one, before and after."""
    objective = Objective.read(campaign.objective)
    for outcomes, label, colour in zip(
        fresh, ("first guess", "optimised"), (BEFORE, AFTER), strict=True
    ):
        squares = objective.squares(outcomes)
        length = np.sort(np.sqrt(len(AXES[objective.axes]) * squares[np.isfinite(squares)]))
        ratio = objective.ratio([squares], [np.ones(len(squares))])
        error = Interval(*(one / arcsec for one in (ratio.value, ratio.low, ratio.high)))
        label = f"{label}, rms {told_interval(error, 3)} arcsec"
        fraction = np.arange(1, len(length) + 1) / len(outcomes)
        axes.step(length / arcsec, fraction, where="post", color=colour, lw=1.4, label=label)
        axes.axvspan(error.low, error.high, color=colour, alpha=0.2, lw=0)
    axes.set(
        xscale="log",
        ylim=(0, 1.02),
        ylabel="frames with no longer error (fraction)",
        xlabel=f"length of the error, {objective.axes} (arcsec)",
    )
    axes.set_xlim(
        left=min(np.quantile(np.asarray(line.get_xdata(), float), 0.005) for line in axes.lines)
    )
    title = f"{len(fresh[0])} fresh frames; bands: {objective} per axis, 95 %"
    panel_title(axes, title)
    legend_below(axes, 1)


def draw_path(axes: Axes, optimum: Optimum) -> None:
    """The error of each design that was tried, in order."""
    tried = optimum.evaluations
    number = np.arange(1, len(tried) + 1)
    error, expected = (
        np.array([getattr(one, name) / arcsec for one in tried]) for name in ("error", "expected")
    )
    good = np.array([one.feasible for one in tried])
    spared = np.array([one.trials == 0 for one in tried])
    axes.plot(number[good], error[good], "o", ms=4, color=AFTER, label="meets the requirements")
    axes.plot(
        number[~good & ~spared],
        error[~good & ~spared],
        "x",
        ms=4,
        color=MISSED,
        label="misses one on its trials",
    )
    axes.plot(
        number[spared],
        expected[spared],
        ".",
        ms=4,
        color="0.6",
        label="cannot lead: no trials, as the budget expects",
    )
    axes.axhline(
        optimum.tuning_error / arcsec,
        color=GREY,
        lw=1,
        ls=":",
        label="the best, on its tuning trials",
    )
    axes.set(ylabel="rms error (arcsec)", yscale="log", xlabel="evaluation (number)")
    counts = [one.trials for one in tried if one.trials]
    title = f"{len(tried)} designs, {min(counts)} to {max(counts)} tuning trials each"
    panel_title(axes, title)
    legend_below(axes, 2)


def told_interval(one: Interval, digits: int) -> str:
    return f"{one.value:.{digits}f} [{one.low:.{digits}f}, {one.high:.{digits}f}]"


if __name__ == "__main__":
    command.run(main)
