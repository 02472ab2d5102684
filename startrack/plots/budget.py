"""Pictures of an error budget: its causes, the sky, and the error over rate, magnitude, field."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from scipy.spatial import cKDTree

from startrack.budget import Budget, Line, Survey, Term, analytic, residuals
from startrack.core import Floats, arcsec, deg
from startrack.design import Case
from startrack.io import save_figure
from startrack.trial import Errors, errors

COLOURS = {
    Term.BIAS: "#7f7f7f",
    Term.THERMO_ELASTIC: "#d95f02",
    Term.FIELD: "#3567a8",
    Term.PIXEL: "#2e7d5b",
    Term.NOISE: "#c0392b",
    Term.ABERRATION: "#8e44ad",
    Term.MEASUREMENT_DATE: "#b8860b",
}
SUM = "#222222"
RATES = np.concatenate([[0.0], np.geomspace(0.02, 2.0, 14)]) * deg
MEDIAN = 0.6745  # of the absolute value of a normal error, over its sigma
TRIALS = 60  # whose stars are evaluated


def draw_budget(path: Path, expected: Budget[Any], found: Budget[Any] | None, title: str) -> None:
    """A bar for each cause, analytic above measured."""
    names: dict[str, Line[Any]] = {line.name: line for line in expected.lines}
    beside = {line.name: line for line in found.lines} if found else {}
    order = [*names, *(name for name in beside if name not in names), "end to end"]
    names["end to end"] = expected.whole
    if found:
        beside["end to end"] = found.whole
    figure = Figure(figsize=(10, 1.2 + 0.42 * len(order)), layout="constrained")
    for axes, kind in zip(figure.subplots(1, 2, sharey=True), ("across", "about"), strict=True):
        for k, name in enumerate(order):
            for line, shift, alpha in ((names.get(name), -0.2, 1.0), (beside.get(name), 0.2, 0.5)):
                if line is None:
                    continue
                colour = COLOURS[line.term] if line.term else SUM
                height = 0.38 if found else 0.7
                at = k + (shift if found else 0.0)
                axes.barh(at, getattr(line, kind) / arcsec, height, color=colour, alpha=alpha)
        axes.set(xscale="log", xlabel=f"{kind} the boresight (arcsec rms per axis)")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(axis="x", which="both", alpha=0.2)
    axes.invert_yaxis()
    first = figure.axes[0]
    first.set_yticks(range(len(order)), order)
    for term in Term:
        if any(line.term is term for line in expected.lines):
            axes.barh(0, 0, color=COLOURS[term], label=term.value)
    shown = axes.get_legend_handles_labels()
    figure.legend(*shown, loc="outside lower center", ncols=7, fontsize=8, frameon=False)
    text = f", measured below in {found.whole.spread.error.shape[0]} members" if found else ""
    figure.suptitle(f"{title}: error by cause, analytic{text}", fontsize=10)
    save_figure(path, figure)


def draw_sky(path: Path, found: Survey, case: Case, title: str) -> None:
    """Detected stars and errors over directions of the boresight."""
    figure = Figure(figsize=(9, 11), layout="constrained")
    maps = (
        (found.stars, "detected stars in the field", None),
        (found.across / arcsec, "error across the boresight (arcsec rms per axis)", 98),
        (found.about / arcsec, "error about the boresight (arcsec rms)", 98),
    )
    ra, dec = np.meshgrid(np.linspace(-np.pi, np.pi, 481), np.linspace(-np.pi / 2, np.pi / 2, 241))
    u, v = (0.5 * (each[1:, 1:] + each[:-1, :-1]) for each in (ra, dec))
    direction = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    _, nearest = cKDTree(found.direction).query(direction)
    for k, (values, label, top) in enumerate(maps):
        axes = figure.add_subplot(3, 1, k + 1, projection="mollweide")
        high = np.nanpercentile(values, top) if top else np.nanmax(values)
        # East to the left, as seen from the Earth.
        shown = axes.pcolormesh(
            -ra, dec, values[nearest], cmap="viridis", vmax=high, rasterized=True
        )
        axes.set_xticks(np.radians([-120, -60, 0, 60, 120]), ["120°", "60°", "0°", "300°", "240°"])
        axes.tick_params(labelsize=7, axis="x", colors="0.8")
        axes.tick_params(labelsize=7, axis="y")
        axes.grid(alpha=0.25)
        bar = figure.colorbar(shown, ax=axes, shrink=0.8, label=label)
        bar.ax.tick_params(labelsize=8)
        worst = np.nanargmin(values) if k == 0 else np.nanargmax(values)
        x, y, z = found.direction[worst]
        axes.plot(-np.arctan2(y, x), np.arcsin(z), "x", color="#ff4040", ms=8, mew=2)
        text = f"{values[worst]:.2f} at ra {np.degrees(np.arctan2(y, x)) % 360:.0f}°, " \
               f"dec {np.degrees(np.arcsin(z)):+.0f}°"  # fmt: skip
        axes.set_title(f"worst (cross): {text}", fontsize=9)
    few = case.tracker.identification.min_matches
    figure.suptitle(
        f"{title}: {len(found.stars)} directions (ICRS), an attitude at "
        f"{100 * found.solved.mean():.2f} %; {few}, 5, 8 stars or more at "
        + ", ".join(f"{100 * found.fraction(n):.1f}" for n in (few, 5, 8))
        + " %",
        fontsize=10,
    )
    save_figure(path, figure)


def draw_curves(path: Path, case: Case, seed: int, title: str, trials: int = TRIALS) -> None:
    """The error over slew rate, and that of single stars over magnitude and field position.

    seed, trials  of the frames whose stars are evaluated
    """
    figure = Figure(figsize=(11, 8), layout="constrained")
    (rates, stars), (place, count) = figure.subplots(2, 2)
    _over_rate(rates, case)
    seen = residuals(case, seed, trials)
    good = np.hypot(*seen.error.T) < 1.0
    _over_magnitude(stars, case, seen.magnitude[good], seen.error[good])
    camera = case.instrument.camera
    edges = [np.linspace(-0.5, n - 0.5, 9) for n in (camera.columns, camera.rows)]
    x, y = seen.position[good].T
    number, _, _ = np.histogram2d(x, y, edges)
    # Over the analytic error of its magnitude; medians, because neighbours cause outliers.
    star = errors(case)
    normal = np.sqrt(np.interp(seen.magnitude[good], star.magnitude, _total(star)))
    fraction = np.abs(seen.error[good]) / normal[:, None] / MEDIAN
    cell = [np.clip(np.searchsorted(e, p) - 1, 0, 7) for e, p in zip(edges, (x, y), strict=True)]
    size = np.full((8, 8), np.nan)
    for i, j in np.ndindex(8, 8):
        mine = fraction[(cell[0] == i) & (cell[1] == j)]
        if len(mine) > 4:
            size[i, j] = np.median(mine)
    for axes, values, label in (
        (place, size, "typical error of a star over the analytic one"),
        (count, number / trials, "matched stars per frame"),
    ):
        shown = axes.pcolormesh(*edges, values.T, cmap="viridis")
        figure.colorbar(shown, ax=axes, label=label)
        axes.set(xlabel="x, column (pixel)", ylabel="y, row (pixel)", aspect="equal")
        axes.invert_yaxis()
        axes.set_title(f"over the field, {trials} trials, {good.sum()} stars", fontsize=9)
    figure.suptitle(title, fontsize=10)
    save_figure(path, figure)


def _over_rate(axes: Axes, case: Case) -> None:
    across, about, solved, left_out = [], [], [], []
    for rate in RATES:
        motion = replace(case.instrument.motion, rate_x=rate, rate_y=0.0, rate_z=0.0)
        moving = replace(case, instrument=replace(case.instrument, motion=motion))
        try:
            budget = analytic(moving)
        except ValueError:  # no star is detected any more
            break
        across.append(budget.across / arcsec)
        about.append(budget.about / arcsec)
        solved.append(budget.availability)
        left_out.append(len(budget.left_out))
    shown = RATES[: len(across)] / deg
    axes.plot(shown, across, "o-", ms=3, color="#3567a8", label="across")
    axes.plot(shown, about, "s-", ms=3, color="#c0392b", label="about")
    few = [k for k, fraction in enumerate(solved) if fraction < 0.99]
    if few:
        axes.axvline(shown[few[0]], color="0.5", ls=":", label="less than 99 % of the sky")
    more = [k for k, effects in enumerate(left_out) if effects > left_out[0]]
    if more:
        axes.axvspan(shown[more[0]], shown[-1], color="0.9", label="with effects not counted")
    axes.set_xscale("symlog", linthresh=0.02)
    axes.set(yscale="log", xlim=(0, None))
    axes.set(xlabel="rate about x (deg/s)", ylabel="error (arcsec rms per axis)")
    axes.set_title("over the slew rate, analytic", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _over_magnitude(axes: Axes, case: Case, magnitude: Floats, error: Floats) -> None:
    star = errors(case)
    for name, covariance in star.random.items():
        axes.plot(star.magnitude, np.sqrt(_variance(covariance)), lw=1.2, label=name)
    axes.plot(star.magnitude, np.sqrt(_total(star)), "k-", lw=1.6, label="all, analytic")
    for low in np.arange(np.floor(star.magnitude[0]), star.magnitude[-1], 0.5):
        mine = error[(magnitude >= low) & (magnitude < low + 0.5)]
        if len(mine) > 10:
            axes.plot(low + 0.25, np.median(np.abs(mine)) / MEDIAN, "ko", ms=4, mfc="none")
    axes.plot([], [], "ko", ms=4, mfc="none", label="trials (median of absolute values)")
    axes.set(
        yscale="log", xlabel="magnitude G of a solar-type star", ylabel="error (pixel per axis)"
    )
    axes.set_ylim(1e-3, 1)
    axes.set_title("error of a star over its magnitude", fontsize=9)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7)


def _total(star: Errors) -> Floats:
    """Variance per axis (m,) of all random causes of single stars."""
    return np.asarray(sum(_variance(each) for each in star.random.values()))


def _variance(covariance: Floats) -> Floats:
    return np.maximum(np.trace(covariance, axis1=1, axis2=2) / 2, 0.0)
