"""Pictures of an error budget: its causes, the sky, and curves over rate, magnitude and field."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from startrack.budget import (
    Budget,
    BudgetCurve,
    BudgetLine,
    ErrorCurves,
    RateSurvey,
    Residuals,
    Term,
    UnitBudgets,
)
from startrack.core import YEAR, Floats, arcsec, deg, is_code
from startrack.design import Accuracy, Case
from startrack.detection import STREAK
from startrack.metrics import Interval, rms_interval
from startrack.montecarlo import quantile_interval
from startrack.plots import style
from startrack.response import Errors
from startrack.trial import SingleStars

COLOURS = {
    Term.BIAS: style.GREY,
    Term.THERMO_ELASTIC: style.ORANGE,
    Term.FIELD: style.BLUE,
    Term.PIXEL: style.GREEN,
    Term.NOISE: style.RED,
    Term.ABERRATION: style.PURPLE,
    Term.MEASUREMENT_DATE: style.SKY,
    Term.PLATFORM: style.BLACK,
}
WHOLE = "0.8"  # grey of the bar end to end
TOP = 0.98  # of the directions whose error has a colour of its own
MEDIAN = 0.6745  # of the absolute value of a normal error, over its sigma
AVAILABLE = 0.99  # of the sky
FLOOR = 0.01  # of the least total error; smaller causes are not drawn
FEWEST = 10  # stars of a magnitude or a part of the field that have a point
IN_A_PART = 30  # least average number of stars in a part of the field; fewer stars make fewer parts
PARTS = (8, 6, 4, 3, 2)  # along a side of the field


@style.styled
def draw_budget(
    path: Path | None,
    expected: Budget[Any],
    by_trials: Budget[Any] | None,
    title: str,
    required: Sequence[Accuracy] = (),
    units: UnitBudgets | None = None,
) -> Figure:
    """A bar for each cause, from zero; measured values as points with their 95 % intervals.

    required  limits on the error; a limit on another statistic than the rms per axis has no line;
              the title of its panel names it
    units     budgets of drawn units; the causes of the unit as designed come first, then the
              classes of error of the units
    """
    names: dict[str, BudgetLine[Any] | _OfUnits] = {line.name: line for line in expected.lines}
    beside = {line.name: line for line in by_trials.lines} if by_trials else {}
    total = "as designed" if units else "end to end"
    of_units = _of_units(units) if units else {}
    order = list(dict.fromkeys([*names, *beside, total, *of_units]))
    names |= {total: expected.whole, **of_units}
    if by_trials:
        beside[total] = by_trials.whole
    text = ""
    if by_trials:
        text = f"; points: measured in {by_trials.whole.spread.error.shape[0]} members"
    if units:
        text += f"; below: rms over {len(units)} units at {units.age / YEAR:g} yr"
    figure = style.picture(2.2 + 2 * 0.27 * len(order), f"{title}: error by cause, analytic{text}")
    panels = figure.subplots(2, 1)
    for axes, kind in zip(panels, ("across", "about"), strict=True):
        values = _bars(axes, order, names, beside, kind)
        limits = [limit for limit in required if limit.name == kind]
        _required(axes, limits, max(values, default=1.0))
        axes.set_xlabel(f"error {kind} the boresight (arcsec rms per axis)")
    shown = {line.term for line in (*names.values(), *beside.values()) if line.term}
    for term in Term:
        if term in shown:
            panels[0].barh(0, 0, color=COLOURS[term], label=term.value)
    figure.legend(*_once(figure), loc="outside lower left", ncols=3)
    return style.save_picture(path, figure)


class _OfUnits(NamedTuple):
    """A class of error over units, as a line of a budget: radian rms across and about."""

    term: Term | None
    across: float
    about: float


def _of_units(units: UnitBudgets) -> dict[str, _OfUnits]:
    parts = {Term.BIAS: units.bias} | units.terms
    square = {term: (error**2).mean(axis=0) for term, error in parts.items()}
    total = np.sum(list(square.values()), axis=0)

    def row(term: Term | None, part: Floats) -> _OfUnits:
        return _OfUnits(term, float(np.sqrt(part[:2].mean())), float(np.sqrt(part[2])))

    rows = {f"units: {term.value}": row(term, square[term]) for term in Term if term in square}
    return {**rows, "units: all, with bias": row(None, total)}


def _bars(
    axes: Axes,
    order: list[str],
    names: Mapping[str, BudgetLine[Any] | _OfUnits],
    beside: Mapping[str, BudgetLine[Any]],
    kind: str,
) -> list[float]:
    """The bars of a panel; returns the largest value of each, arcsec."""
    ends = []
    for k, name in enumerate(order):
        line, other, texts, end = names.get(name), beside.get(name), [], 0.0
        if line:
            end = getattr(line, kind) / arcsec
            colour = COLOURS[line.term] if line.term else WHOLE
            axes.barh(k, end, 0.7, color=colour)
            texts.append(style.number(end))
        if other:
            value, low, high = _measured(other, kind)
            axes.errorbar(
                value,
                k,
                xerr=[[value - low], [high - value]],
                fmt="D",
                ms=4.5,
                color=style.BLACK,
                mfc="white",
                ecolor="0.35",
                elinewidth=1.5,
                zorder=4,
                label="measured, 95 % interval",
            )
            texts.append(f"measured {style.number(value)}")
            end = max(end, high)
        ends.append(end)
        style.note(axes, "; ".join(texts), (end, k), (4, 0), zorder=6)
    axes.set_yticks(range(len(order)), order)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    room = 1.5 if beside else 1.15
    axes.set_xlim(0, room * max(ends) if max(ends) > 0 else 1.0)
    return ends


def _measured(line: BudgetLine[Any], kind: str) -> tuple[float, float, float]:
    """Arcsec rms per axis with its interval over the members."""
    square = (line.spread.error**2).mean(axis=1)
    rms: Interval = rms_interval(square[:, :2].mean(axis=1) if kind == "across" else square[:, 2])
    high = rms.high if np.isfinite(rms.high) else rms.value
    return rms.value / arcsec, rms.low / arcsec, high / arcsec


def _required(axes: Axes, limits: Sequence[Accuracy], largest: float) -> None:
    """A line at a limit of the rms per axis; a limit of another statistic in words."""
    for limit in limits:
        value = limit.most / arcsec
        text = f"required of the {limit.objective}: at most {style.number(value)} arcsec"
        radial = limit.objective.radial and limit.objective.axes != "about"
        if limit.objective.fraction is None and not radial:
            if value < 5 * largest:
                axes.axvline(value, color=style.PURPLE, lw=2, ls="--", label="requirement")
                axes.set_xlim(0, max(axes.get_xlim()[1], 1.1 * value))
            else:
                text += ", beyond the axis"
        else:
            text += " (no line: these bars are rms per axis)"
        style.panel_title(axes, text, 64)


def _once(figure: Figure) -> tuple[list[Any], list[str]]:
    """Handles and names of all panels, each name once."""
    named: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    return list(named.values()), list(named)


@style.styled
def draw_sky(path: Path | None, survey: RateSurvey, case: Case, title: str) -> Figure:
    """Detected stars and errors over directions of the boresight."""
    few = case.tracker.identification.min_matches
    figure = style.picture(
        10.4,
        f"{_of_which_unit(title, case)}: {len(survey.stars)} directions (ICRS), an attitude at "
        f"{100 * survey.solved.mean():.2f} %; {few}, 5, 8 stars or more at "
        + ", ".join(f"{100 * survey.fraction(n):.1f}" for n in (few, 5, 8))
        + " %. Right ascension grows to the left",
    )
    full = np.ptp(survey.stars) < 0.05  # as many as the tracker keeps, everywhere
    maps = (
        (survey.faintest, f"faintest of the {survey.stars[0]:.0f} stars that count (G)", 1.0)
        if full
        else (survey.stars, "detected stars in the field (number)", 1.0),
        (survey.across / arcsec, "error across the boresight (arcsec rms per axis)", TOP),
        (survey.about / arcsec, "error about the boresight (arcsec rms)", TOP),
    )
    ra, dec = np.meshgrid(np.linspace(-np.pi, np.pi, 481), np.linspace(-np.pi / 2, np.pi / 2, 241))
    u, v = (0.5 * (grid[1:, 1:] + grid[:-1, :-1]) for grid in (ra, dec))
    direction = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    _, nearest = cKDTree(survey.direction).query(direction)
    for k, (values, label, part) in enumerate(maps):
        axes = figure.add_subplot(3, 1, k + 1, projection="mollweide")
        low, high = style.colour_limits(values, part)
        # East to the left, as seen from the Earth.
        shown = axes.pcolormesh(-ra, dec, values[nearest], vmin=low, vmax=high, rasterized=True)
        axes.set_facecolor(style.NO_VALUE)
        axes.set_xticks(np.radians([-120, -60, 0, 60, 120]), ["120°", "60°", "0°", "300°", "240°"])
        axes.set_yticks(np.radians([-60, -30, 0, 30, 60]))
        for text in axes.get_xticklabels():
            text.set(color="white", path_effects=[style.outline("black")])
        axes.set_axisbelow(False)  # numbers and lines over the map
        axes.grid(alpha=0.35)
        style.colour_bar(
            shown, axes, values, label, orientation="horizontal", shrink=0.7, aspect=32, pad=0.03
        )
        style.panel_title(axes, _worst(axes, survey, values, least=k == 0 and not full))
    return style.save_picture(path, figure)


def _of_which_unit(title: str, case: Case) -> str:
    """The title; if units differ, with the words that these errors leave their differences out."""
    return f"{title}, the unit as designed, without unit differences" if case.varying else title


def _worst(axes: Axes, survey: RateSurvey, values: Floats, least: bool) -> str:
    """Marks the worst direction, and says where it is."""
    if not np.isfinite(values).any():
        return "no attitude anywhere"
    at = int(np.nanargmin(values) if least else np.nanargmax(values))
    x, y, z = survey.direction[at]
    ra, dec = np.arctan2(y, x), np.arcsin(z)
    axes.plot(-ra, dec, "X", color=style.YELLOW, mec="black", ms=9, mew=1.2)
    text = (
        f"worst (cross): {style.number(values[at])} at RA {np.degrees(ra) % 360:.0f}°, "
        f"Dec {np.degrees(dec):+.0f}°"
    )
    blind = float(np.isnan(values).mean())
    return f"{text}; grey: no attitude, {100 * blind:.1f} % of the sky" if blind else text


@style.styled
def draw_curves(path: Path | None, curves: ErrorCurves, case: Case, title: str) -> Figure:
    """The error over slew rate, and the error of single stars over magnitude and field position."""
    figure = style.picture(12.0, _of_which_unit(title, case))
    panels = figure.subplot_mosaic(
        [["rates"] * 2, ["stars"] * 2, ["place", "count"]], height_ratios=(1.05, 1, 1)
    )
    rates, stars, place, count = (panels[name] for name in ("rates", "stars", "place", "count"))
    _over_rate(rates, curves, case)
    good = np.hypot(*curves.seen.error.T) < 1.0
    seen = Residuals(*(column[good] for column in curves.seen))
    budget = curves.curve.budgets[0]
    causes = [line.name for line in budget.lines if line.across > 0] if budget else []
    _over_magnitude(stars, curves.stars, curves.boxed, seen, causes)
    _over_field((place, count), curves, case, seen)
    if not good.all():
        stars.plot([], [], " ", label=f"{(~good).sum()} stars off by a pixel or more left out")
        style.legend_below(stars, 2)
    return style.save_picture(path, figure)


def _over_rate(axes: Axes, curves: ErrorCurves, case: Case) -> None:
    curve, tried = curves.curve, curves.tried
    rates = curve.rate[:: curves.steps]
    shown = curve.rate / deg
    for line, name, colour in (("-", "across", style.BLUE), ("--", "about", style.RED)):
        axes.plot(
            shown, getattr(curve, name) / arcsec, line, color=colour, label=f"{name}, analytic"
        )
    for marker, name, colour in (("o", "across", style.BLUE), ("s", "about", style.RED)):
        rms = [getattr(checked.summary, name) for _, checked in tried]
        trials = f"{tried[0][1].summary.trials} trials" if tried else "no trial"
        style.draw_intervals(
            axes,
            [rate / deg for rate, _ in tried],
            rms,
            arcsec,
            fmt=marker,
            ms=5,
            mfc="white",
            color=colour,
            label=f"{name}, {trials} each, 95 %",
        )
    below = [
        f"{checked.summary.availability.value:.0%} at {style.number(rate / deg)}"
        for rate, checked in tried
        if checked.summary.availability.value < AVAILABLE
    ]
    differs = [style.number(rate / deg) for rate, checked in tried if checked.differs]
    _shade_rates(axes, curve)
    streaks = STREAK / case.instrument.camera.focal_length_px / case.instrument.detector.exposure
    centroid = case.tracker.detection.centroid
    changes = centroid != "likelihood" and not is_code(centroid)
    if curve.rate[0] < streaks < curve.rate[-1] and changes:
        axes.axvline(
            streaks / deg,
            color=style.GREY,
            ls="-.",
            lw=1.2,
            label="from here streaks are fitted (likelihood)",
        )
    axes.set_xscale("symlog", linthresh=max(rates[1] / deg, 1e-9))
    axes.set(yscale="log", xlim=(-0.2 * shown[1], 1.15 * shown[-1]))
    axes.set_xticks(rates / deg, [style.number(rate) for rate in rates / deg])
    axes.set(xlabel="rate about x (deg/s)", ylabel="error (arcsec rms per axis)")
    text = "over the slew rate"
    if differs:
        text += f"; formula and trials differ at {', '.join(differs)} deg/s"
    if below:
        text += f"; trials with a correct attitude: {', '.join(below)} deg/s, else 99 % or more"
    style.panel_title(axes, text)
    style.legend_below(axes, 2)


def _shade_rates(axes: Axes, curve: BudgetCurve) -> None:
    """Shade the rates at which the formula leaves out more than at rest, or a part of the sky is
    lost."""
    shown = curve.rate / deg
    few = np.flatnonzero(curve.available < AVAILABLE)
    if len(few):
        axes.axvline(
            shown[few[0]],
            color=style.GREY,
            ls=":",
            lw=1.5,
            label="from here less than 99 % of the sky, analytic",
        )
    first = curve.first_left_out
    if first is not None:
        axes.axvspan(
            shown[first],
            1.15 * shown[-1],
            color="0.9",
            zorder=0,
            label=fill(f"shaded: analytic without {curve.new_left_out}", style.LETTERS // 2),
        )


def _over_magnitude(
    axes: Axes, star: Errors, in_boxes: SingleStars | None, seen: Residuals, causes: Sequence[str]
) -> None:
    """Draw the errors of a star; `causes` of the attitude's error contain the causes of its
    error."""
    text = "error of a star over its magnitude"
    if in_boxes:
        _in_boxes(axes, in_boxes)
    else:
        _by_formula(axes, star)
        if more := [cause for cause in causes if cause not in star.random]:
            text += f"; trials have {', '.join(more)} beyond these lines"
    at, sizes = [], []
    edges = in_boxes.magnitude if in_boxes else star.magnitude
    for low in np.arange(np.floor(edges[0]), edges[-1], 0.5):
        mine = seen.error[(seen.magnitude >= low) & (seen.magnitude < low + 0.5)]
        if len(mine) >= FEWEST:
            at.append(low + 0.25)
            sizes.append(quantile_interval(np.abs(mine).ravel(), 0.5))
    if sizes:
        style.draw_intervals(
            axes,
            at,
            sizes,
            MEDIAN,
            fmt="o",
            ms=4.5,
            mfc="white",
            color=style.BLACK,
            label="trials: median / 0.6745, 95 %",
        )
    axes.set(
        yscale="log", xlabel="magnitude G of a solar-type star", ylabel="error (pixel per axis)"
    )
    style.panel_title(axes, text)
    style.legend_below(axes, 2)


def _in_boxes(axes: Axes, star: SingleStars) -> None:
    """Stars that were drawn in boxes."""
    rows = (
        ("total", "all, drawn in boxes: rms", style.BLACK, "-"),
        ("usual", "the same: median size over 0.6745", style.BLACK, "--"),
        ("temporal", "from exposure to exposure", style.RED, "-."),
        ("method", "centroid method", style.BLUE, ":"),
    )
    for name, label, colour, line in rows:
        axes.plot(star.magnitude, getattr(star, name), line, color=colour, lw=1.6, label=label)


def _by_formula(axes: Axes, star: Errors) -> None:
    """Each cause of the formula, and all of them."""
    total = np.sqrt(_total(star))
    floor = FLOOR * float(total.min())
    for (name, covariance), colour, line in zip(
        star.random.items(), style.CYCLE, style.LINES, strict=False
    ):
        own = np.sqrt(_variance(covariance))
        drawn = np.where(own >= floor, own, np.nan)
        part = "" if (own >= floor).all() else f" (above {style.number(floor)})"
        axes.plot(star.magnitude, drawn, ls=line, color=colour, lw=1.2, label=name + part)
    axes.plot(star.magnitude, total, "-", color=style.BLACK, lw=1.8, label="all, analytic")


def _over_field(
    panels: tuple[Axes, Axes], curves: ErrorCurves, case: Case, seen: Residuals
) -> None:
    """Maps of the field: error over the analytic one, and number of stars."""
    camera, position, trials = case.instrument.camera, seen.position, curves.trials
    parts = next((n for n in PARTS if len(position) >= IN_A_PART * n * n), PARTS[-1])
    edges = [np.linspace(-0.5, n - 0.5, parts + 1) for n in (camera.columns, camera.rows)]
    cell = [
        np.clip(np.searchsorted(edge, places) - 1, 0, parts - 1)
        for edge, places in zip(edges, position.T, strict=True)
    ]
    count = np.zeros((parts, parts))
    np.add.at(count, tuple(cell), 1)
    # Over the analytic error of its magnitude; medians, because neighbours cause outliers.
    star = curves.stars
    normal = np.sqrt(np.interp(seen.magnitude, star.magnitude, _total(star)))
    ratio, size = np.abs(seen.error) / normal[:, None] / MEDIAN, np.full((parts, parts), np.nan)
    for i, j in np.ndindex(parts, parts):
        mine = ratio[(cell[0] == i) & (cell[1] == j)]
        if len(mine) >= FEWEST:
            size[i, j] = np.median(mine)
    for axes, values, label in (
        (panels[0], size, "error of a star over the analytic (ratio)"),
        (panels[1], count / trials, "matched stars (number per frame)"),
    ):
        low, high = style.colour_limits(values)
        shown = axes.pcolormesh(*edges, values.T, vmin=low, vmax=high)
        axes.set_facecolor(style.NO_VALUE)
        axes.set(xlabel="x, column (pixel)", ylabel="y, row (pixel)", aspect="equal")
        axes.invert_yaxis()
        axes.grid(visible=False)
        style.colour_bar(shown, axes, values, label, orientation="horizontal", aspect=22)
        empty = f"; grey: fewer than {FEWEST} stars" if np.isnan(values).any() else ""
        style.panel_title(
            axes, f"over the field: {trials} trials, {len(position)} stars{empty}", 36
        )
        if not len(position):
            style.say(axes, "no matched star")


def _total(star: Errors) -> Floats:
    """Variance per axis (m,) of all random causes of single stars."""
    return np.asarray(sum(_variance(covariance) for covariance in star.random.values()))


def _variance(covariance: Floats) -> Floats:
    return np.maximum(np.trace(covariance, axis1=1, axis2=2) / 2, 0.0)
