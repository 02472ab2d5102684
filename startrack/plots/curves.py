"""Picture of an error budget beside trials: over slew rate, magnitude and field position."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from startrack.budget import Budget, analytic, check, residuals
from startrack.core import Floats, Ints, Refused, arcsec, deg
from startrack.design import Case
from startrack.montecarlo import quantile_interval
from startrack.plots.style import (
    BLACK,
    BLUE,
    CYCLE,
    GREY,
    LETTERS,
    LINES,
    NO_VALUE,
    RED,
    colour_bar,
    colour_limits,
    legend_below,
    number,
    panel_title,
    picture,
    save_picture,
    say,
    styled,
)
from startrack.trial import Errors, errors

SMEARS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # pixel in an exposure
LONGEST = 8.0  # of those of the formula, which takes ten seconds for a longer one
BETWEEN = 1  # rates of the formula between two of the trials
MEDIAN = 0.6745  # of the absolute value of a normal error, over its sigma
TRIALS = 60  # whose stars are evaluated
AVAILABLE = 0.99  # of the sky
FLOOR = 0.01  # of the least total error; smaller causes are not drawn
FEWEST = 10  # stars of a magnitude or a part of the field that have a point
IN_A_PART = 30  # stars in a part of the field, on average, below which there are fewer parts
PARTS = (8, 6, 4, 3, 2)  # along a side of the field


class Curve(NamedTuple):
    """Analytic error over the slew rate.

    rate     (n,) radian / second
    budgets  of each; None where no field is solved
    """

    rate: Floats
    budgets: tuple[Budget[Any] | None, ...]

    @property
    def across(self) -> Floats:
        """Radian, rms per axis; NaN where no field is solved."""
        return np.array([one.across if one else math.nan for one in self.budgets])

    @property
    def about(self) -> Floats:
        """Radian, rms; NaN where no field is solved."""
        return np.array([one.about if one else math.nan for one in self.budgets])

    @property
    def available(self) -> Floats:
        """Fraction of the sky."""
        return np.array([one.availability if one else 0.0 for one in self.budgets])

    @property
    def left_out(self) -> tuple[tuple[str, ...], ...]:
        """Effects that the formula does not count at each rate."""
        return tuple(one.left_out if one else () for one in self.budgets)

    @property
    def first_left_out(self) -> int | None:
        """Index of the first rate at which the formula leaves out more than at rest."""
        rest = len(self.left_out[0])
        return next((k for k, found in enumerate(self.left_out) if len(found) > rest), None)

    @property
    def new_left_out(self) -> str:
        """What it leaves out there, beyond what it leaves out at rest."""
        first = self.first_left_out
        if first is None:
            return ""
        # Their amounts may differ, the words do not.
        known = {_words(one) for one in self.left_out[0]}
        return "; ".join(one for one in self.left_out[first] if _words(one) not in known)


def _words(phrase: str) -> str:
    return "".join(letter for letter in phrase if not letter.isdigit() and letter != ".")


def slewing(case: Case, rate: float) -> Case:
    """The design at another slew rate (radian / second) about x, all else as it is."""
    motion = replace(case.instrument.motion, rate_x=rate, rate_y=0.0, rate_z=0.0)
    return replace(case, instrument=replace(case.instrument, motion=motion))


def slew_rates(case: Case, longest: float = math.inf) -> Floats:
    """Radian / second, of the smears `SMEARS` up to the longest (pixel)."""
    instrument = case.instrument
    pixel = 1 / instrument.camera.focal_length_px
    smears = np.array([smear for smear in SMEARS if smear <= longest])
    return smears * pixel / instrument.detector.exposure


def analytic_curve(
    case: Case, rates: Floats, advance: Callable[[int], None] | None = None
) -> Curve:
    """The analytic budget at some slew rates, of which `advance` is called after each."""
    found = []
    for rate in rates:
        found.append(_budget(case, float(rate)))
        if advance:
            advance(1)
    return Curve(rates, tuple(found))


def _budget(case: Case, rate: float) -> Budget[Any] | None:
    """None where no field is solved."""
    try:
        return analytic(slewing(case, rate))
    except Refused:
        return None


def between(rates: Floats) -> Floats:
    """The rates, and some in equal steps between each two."""
    steps = BETWEEN + 1
    return np.interp(np.arange(steps * (len(rates) - 1) + 1) / steps, range(len(rates)), rates)


@styled
def draw_curves(
    path: Path,
    case: Case,
    seed: int,
    title: str,
    trials: int = TRIALS,
    advance: Callable[[int], None] | None = None,
) -> None:
    """The error over slew rate, and that of single stars over magnitude and field position.

    seed, trials  of the frames whose stars are evaluated
    advance       called after each of `rates_drawn`
    """
    figure = picture(12.0, title)
    panels = figure.subplot_mosaic(
        [["rates"] * 2, ["stars"] * 2, ["place", "count"]], height_ratios=(1.05, 1, 1)
    )
    rates, stars, place, count = (panels[one] for one in ("rates", "stars", "place", "count"))
    _over_rate(rates, case, seed, advance)
    seen = residuals(case, seed, trials)
    good = np.hypot(*seen.error.T) < 1.0
    _over_magnitude(stars, case, seen.magnitude[good], seen.error[good])
    _over_field((place, count), case, seen.position[good], seen.magnitude[good],
                seen.error[good], trials)  # fmt: skip
    if not good.all():
        stars.plot([], [], " ", label=f"{(~good).sum()} stars off by a pixel or more left out")
        legend_below(stars, 2)
    save_picture(path, figure)


def rates_drawn(case: Case) -> int:
    """Number of slew rates of the curve."""
    return len(between(slew_rates(case, LONGEST)))


def _over_rate(axes: Axes, case: Case, seed: int, advance: Callable[[int], None] | None) -> None:
    rates = slew_rates(case, LONGEST)
    curve = analytic_curve(case, between(rates), advance)
    shown = curve.rate / deg
    for style, name, colour in (("-", "across", BLUE), ("--", "about", RED)):
        axes.plot(shown, getattr(curve, name) / arcsec, style, color=colour,
                  label=f"{name}, analytic")  # fmt: skip
    tried = [
        (float(rate), check(slewing(case, float(rate)), budget, seed))
        for rate, budget in zip(rates, curve.budgets[:: BETWEEN + 1], strict=True)
        if budget
    ]
    for marker, name, colour in (("o", "across", BLUE), ("s", "about", RED)):
        found = [getattr(one.summary, name) for _, one in tried]
        value, low, high = (
            np.array([getattr(one, part) for one in found]) / arcsec
            for part in ("value", "low", "high")
        )
        bars = [np.where(np.isfinite(end), end, 0) for end in (value - low, high - value)]
        trials = f"{tried[0][1].summary.trials} trials" if tried else "no trial"
        axes.errorbar([rate / deg for rate, _ in tried], value, yerr=bars, fmt=marker, ms=5,
                      mfc="white", color=colour, label=f"{name}, {trials} each, 95 %")  # fmt: skip
    below = [
        f"{one.summary.availability.value:.0%} at {number(rate / deg)}"
        for rate, one in tried
        if one.summary.availability.value < AVAILABLE
    ]
    differs = [number(rate / deg) for rate, one in tried if one.differs]
    _shade(axes, curve)
    axes.set_xscale("symlog", linthresh=max(rates[1] / deg, 1e-9))
    axes.set(yscale="log", xlim=(-0.2 * shown[1], 1.15 * shown[-1]))
    axes.set_xticks(rates / deg, [number(one) for one in rates / deg])
    axes.set(xlabel="rate about x (deg/s)", ylabel="error (arcsec rms per axis)")
    text = "over the slew rate"
    if differs:
        text += f"; formula and trials differ at {', '.join(differs)} deg/s"
    if below:
        text += f"; trials with a correct attitude: {', '.join(below)} deg/s, else 99 % or more"
    panel_title(axes, text)
    legend_below(axes, 2)


def _shade(axes: Axes, curve: Curve) -> None:
    """Rates at which the formula leaves out more than at rest, or a part of the sky is lost."""
    shown = curve.rate / deg
    few = np.flatnonzero(curve.available < AVAILABLE)
    if len(few):
        axes.axvline(shown[few[0]], color=GREY, ls=":", lw=1.5,
                     label="from here less than 99 % of the sky, analytic")  # fmt: skip
    first = curve.first_left_out
    if first is not None:
        axes.axvspan(
            shown[first], 1.15 * shown[-1], color="0.9", zorder=0,
            label=fill(f"shaded: analytic without {curve.new_left_out}", LETTERS // 2),
        )  # fmt: skip


def _over_magnitude(axes: Axes, case: Case, magnitude: Floats, error: Floats) -> None:
    star = errors(case)
    total = np.sqrt(_total(star))
    floor = FLOOR * float(total.min())
    for (name, covariance), colour, line in zip(star.random.items(), CYCLE, LINES, strict=False):
        own = np.sqrt(_variance(covariance))
        drawn = np.where(own >= floor, own, np.nan)
        part = "" if (own >= floor).all() else f", where above {number(floor)} pixel"
        axes.plot(star.magnitude, drawn, ls=line, color=colour, lw=1.2, label=name + part)
    axes.plot(star.magnitude, total, "-", color=BLACK, lw=1.8, label="all, analytic")
    at, found = [], []
    for low in np.arange(np.floor(star.magnitude[0]), star.magnitude[-1], 0.5):
        mine = error[(magnitude >= low) & (magnitude < low + 0.5)]
        if len(mine) >= FEWEST:
            at.append(low + 0.25)
            one = quantile_interval(np.abs(mine).ravel(), 0.5)
            found.append((one.value / MEDIAN, one.low / MEDIAN, one.high / MEDIAN))
    if found:
        value, lowest, highest = np.array(found).T
        bars = [value - lowest, np.where(np.isfinite(highest), highest - value, 0)]
        axes.errorbar(at, value, yerr=bars, fmt="o", ms=4.5, mfc="white", color=BLACK,
                      label="trials: median size over 0.6745, 95 %")  # fmt: skip
    axes.set(
        yscale="log", xlabel="magnitude G of a solar-type star", ylabel="error (pixel per axis)"
    )
    panel_title(axes, "error of a star over its magnitude")
    legend_below(axes, 2)


def _over_field(
    panels: tuple[Axes, Axes],
    case: Case,
    position: Floats,
    magnitude: Floats,
    error: Floats,
    trials: int,
) -> None:
    """Maps of the field: error over the analytic one, and number of stars."""
    camera = case.instrument.camera
    parts = next((n for n in PARTS if len(position) >= IN_A_PART * n * n), PARTS[-1])
    edges = [np.linspace(-0.5, n - 0.5, parts + 1) for n in (camera.columns, camera.rows)]
    cell = [
        np.clip(np.searchsorted(edge, one) - 1, 0, parts - 1)
        for edge, one in zip(edges, position.T, strict=True)
    ]
    known = np.zeros((parts, parts))
    np.add.at(known, tuple(cell), 1)
    # Over the analytic error of its magnitude; medians, because neighbours cause outliers.
    star = errors(case)
    normal = np.sqrt(np.interp(magnitude, star.magnitude, _total(star)))
    size = _medians(np.abs(error) / normal[:, None] / MEDIAN, cell, parts)
    for axes, values, label in (
        (panels[0], size, "error of a star over the analytic (ratio)"),
        (panels[1], known / trials, "matched stars (number per frame)"),
    ):
        low, high = colour_limits(values)
        shown = axes.pcolormesh(*edges, values.T, vmin=low, vmax=high)
        axes.set_facecolor(NO_VALUE)
        axes.set(xlabel="x, column (pixel)", ylabel="y, row (pixel)", aspect="equal")
        axes.invert_yaxis()
        axes.grid(visible=False)
        colour_bar(shown, axes, values, label, orientation="horizontal", aspect=22)
        empty = f"; grey: fewer than {FEWEST} stars" if np.isnan(values).any() else ""
        panel_title(axes, f"over the field: {trials} trials, {len(position)} stars{empty}", 36)
        if not len(position):
            say(axes, "no matched star")


def _medians(values: Floats, cell: list[Ints], parts: int) -> Floats:
    """Median of each part of the field, NaN where it has few stars."""
    found = np.full((parts, parts), np.nan)
    for i, j in np.ndindex(parts, parts):
        mine = values[(cell[0] == i) & (cell[1] == j)]
        if len(mine) >= FEWEST:
            found[i, j] = np.median(mine)
    return found


def _total(star: Errors) -> Floats:
    """Variance per axis (m,) of all random causes of single stars."""
    return np.asarray(sum(_variance(each) for each in star.random.values()))


def _variance(covariance: Floats) -> Floats:
    return np.maximum(np.trace(covariance, axis1=1, axis2=2) / 2, 0.0)
