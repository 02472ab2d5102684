"""Pictures of studies: convergence, samples, Pareto fronts and sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, ScalarFormatter

from startrack.core import Floats, arcsec
from startrack.design import Objective
from startrack.io import save_figure
from startrack.optimise import Goals, Optimum, Point, Sensitivity, Tolerance, thinned


def draw_convergence(path: Path, optimum: Optimum, objective: str) -> None:
    """The error of each evaluated design, and its variables."""
    tried = optimum.evaluations
    figure = Figure(figsize=(9, 7), layout="constrained")
    error, variables = figure.subplots(2, 1, sharex=True)
    number = np.arange(1, len(tried) + 1)
    found = np.array([one.error / arcsec for one in tried])
    feasible = np.array([one.feasible for one in tried])
    error.semilogy(number[feasible], found[feasible], "o", ms=4, color="#2e7d5b",
                   label="meets the requirements")  # fmt: skip
    error.semilogy(number[~feasible], found[~feasible], "x", ms=4, color="#c0392b",
                   label="misses a requirement")  # fmt: skip
    # The line of the best leaves out designs that miss a requirement.
    so_far = np.fmin.accumulate(np.where(feasible, found, np.inf))
    error.step(number, np.where(np.isfinite(so_far), so_far, np.nan), where="post", color="#2e7d5b",
               lw=1)  # fmt: skip
    trials = np.array([one.trials for one in tried])
    for at in np.flatnonzero(np.diff(trials)):
        error.axvline(at + 1.5, color="0.6", lw=0.8, ls=":")
    error.set_ylabel(f"{Objective.read(objective)} (arcsec)")
    few = min((count for count in trials.tolist() if count), default=0)
    error.set_title(
        f"{len(tried)} designs, {few} to {trials.max()} trials "
        f"each, same skies and noise; on {optimum.fresh[0].trials} fresh frames better by "
        f"{optimum.factor.value:.2f} [{optimum.factor.low:.2f}, {optimum.factor.high:.2f}]",
        fontsize=9,
        loc="left",
    )
    error.legend(fontsize=8)
    draw_variables(variables, optimum)
    save_figure(path, figure)


def draw_variables(axes: Axes, optimum: Optimum) -> None:
    """Each variable of each evaluated design, scaled to its bounds."""
    cube = np.array([one.coordinates for one in optimum.evaluations])
    for variable, line in zip(optimum.space.variables, cube.T, strict=True):
        axes.plot(np.arange(1, len(line) + 1), line, lw=1.2, label=variable.name.rpartition(".")[2])
    axes.set(xlabel="evaluation", ylabel="variable, scaled to its bounds", ylim=(-0.03, 1.25))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(fontsize=8, ncols=3, loc="upper right")


def draw_tolerance(path: Path, tolerance: Tolerance) -> None:
    """Distribution of each pair of variables, and of each, over designs within the error limit."""
    space = tolerance.space
    texts = [
        list(space.text(space.design(point)).values()) for point in thinned(tolerance.samples, 2000)
    ]
    units = [text.partition(" ")[2] for text in texts[0]]
    names = [variable.name.rpartition(".")[2] for variable in space.variables]
    labels = [f"{name} ({unit})" if unit else name for name, unit in zip(names, units, strict=True)]
    draw_corner(
        path,
        np.array([[float(text.split()[0]) for text in row] for row in texts]),
        labels,
        f"designs that keep the error below {tolerance.limit / arcsec:.2f} arcsec\n"
        f"{tolerance.chains.effective.min():.0f} independent samples, response surface within "
        f"{100 * tolerance.check_error:.1f} % on {tolerance.checks} unseen designs",
    )


def draw_tornado(path: Path, found: Sequence[Sensitivity], objective: str) -> None:
    """Range of the error over each variable alone, and Sobol indices of each."""
    order = sorted(found, key=_swing)
    names = [one.name.rpartition(".")[2] for one in order]
    figure = Figure(figsize=(9, 1.5 + 0.5 * len(order)), layout="constrained")
    swing, indices = figure.subplots(1, 2, sharey=True)
    at = np.arange(len(order))
    for y, one in zip(at, order, strict=True):
        ends = min(one.low, one.high, one.error), max(one.low, one.high, one.error)
        swing.plot(ends, [y, y], lw=9, color="#3567a8", solid_capstyle="butt")
        for error_at_bound, bound in ((one.low, "low"), (one.high, "high")):
            if abs(error_at_bound / one.error - 1) > 0.02:  # else the text would be on the line
                swing.annotate(
                    bound, (error_at_bound, y + 0.28), fontsize=7, ha="center", va="center"
                )
    swing.axvline(order[0].error, color="0.3", lw=0.8, label="design")
    swing.legend(fontsize=8, loc="lower right")
    swing.set_xscale("log")
    swing.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    swing.xaxis.set_major_formatter(ScalarFormatter())
    swing.xaxis.set_minor_formatter(NullFormatter())
    swing.set_yticks(at, names)
    swing.set(xlabel=f"{objective} (arcsec)", ylim=(-0.6, len(at) - 0.4))
    for shift, kind, colour in ((0.17, "total", "#d08a2e"), (-0.17, "first", "#2e7d5b")):
        value = np.array([getattr(one, kind).value for one in order])
        low = np.array([getattr(one, kind).low for one in order])
        high = np.array([getattr(one, kind).high for one in order])
        indices.barh(at + shift, value, 0.3, color=colour, label=kind)
        middle = [np.maximum(value - low, 0), np.maximum(high - value, 0)]
        indices.errorbar(value, at + shift, xerr=middle, fmt="none", ecolor="0.2", lw=0.8)
    indices.set(xlabel="Sobol index of ln(error) over the design space (95 % bars)")
    indices.legend(fontsize=8, loc="lower right")
    save_figure(path, figure)


def _swing(one: Sensitivity) -> float:
    values = (one.low, one.high, one.error)
    return max(values) / min(values)


def draw_front(
    path: Path, points: Sequence[Point], goals: Goals, units: Sequence[str], trials: int
) -> None:
    """The Pareto front of the analytic budget, and the same designs in trials."""
    figure = Figure(figsize=(6.5, 4.5), layout="constrained")
    axes = figure.subplots()
    expected = np.array([one.expected for one in points])
    measured = np.array([one.measured for one in points])
    axes.plot(*expected.T, "o-", ms=4, color="#3567a8", label="analytic budget")
    axes.plot(*measured.T, "s", ms=5, mfc="none", color="#c0392b", label=f"{trials} trials each")
    axes.set(xscale="log", yscale="log")
    axes.set(xlabel=f"{goals.first} ({units[0]})", ylabel=f"{goals.second} ({units[1]})")
    axes.set_title(f"{len(points)} Pareto-optimal designs", fontsize=9, loc="left")
    axes.legend(fontsize=8)
    save_figure(path, figure)


def draw_corner(path: Path, samples: Floats, labels: Sequence[str], title: str) -> None:
    """Distribution of each pair of columns of samples (n, d), and of each."""
    n = len(labels)
    figure = Figure(figsize=(2 * n + 1, 2 * n + 1), layout="constrained")
    grid = figure.subplots(n, n, squeeze=False)
    for i in range(n):
        for j in range(n):
            axes: Axes = grid[i, j]
            if j > i:
                axes.set_axis_off()
                continue
            if i == j:
                axes.hist(samples[:, i], 30, color="#3567a8")
                axes.set_yticks([])
            else:
                axes.plot(samples[:, j], samples[:, i], ".", ms=1.5, alpha=0.4, color="#3567a8")
            axes.tick_params(labelsize=7)
            if i == n - 1:
                axes.set_xlabel(labels[j], fontsize=8)
            if j == 0 and i > 0:
                axes.set_ylabel(labels[i], fontsize=8)
    figure.suptitle(title, fontsize=9)
    save_figure(path, figure)
