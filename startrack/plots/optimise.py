"""Pictures of studies: convergence, samples, Pareto fronts and sensitivities."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from startrack.core import Floats, Ints, arcsec
from startrack.design import Campaign
from startrack.metrics import Interval, bracketed
from startrack.optimise import (
    Evaluation,
    Landscape,
    Optimum,
    Point,
    Sensitivity,
    Tolerance,
    thinned,
)
from startrack.plots import style

SAME = 0.02  # relative change of an error; a smaller one is not drawn as a bar
COLUMNS, PANEL = 2, 1.05  # of the panels of variables; inch, height of each
LETTERS_BESIDE = 36  # letters in the title of one of several panels
HOW_TO_READ = (
    "below, each variable from its low to its high bound: dots are designs that were forecast or "
    "tried, the line is the best so far, the band the range that keeps the objective while the "
    "others follow"
)
DOTS = 2000  # samples that are drawn
MARKS = 0.025, 0.5, 0.975  # quantiles that are marked
LARGEST = 1.6  # inch, of a panel of a corner picture whose letters are legible in 400 pixels


@style.styled
def draw_convergence(path: Path, optimum: Optimum, campaign: Campaign) -> None:
    """Draw the minimised quantity of each evaluated design, and its variables."""
    fresh, _ = optimum.fresh
    result = f"the best is better by {bracketed(optimum.factor, '.2f')}"
    if not math.isfinite(optimum.factor.value):
        result = "start or best have no attitude"
    elif optimum.candidate:
        result = "none is better than the start"
    count = len(optimum.evaluations)
    figure = style.picture(
        0.6,
        f"{count} design{'s' * (count != 1)} on the same skies and noise; on {fresh.trials} fresh "
        f"frames {result}\n{HOW_TO_READ}",
    )
    error, *variables = variable_panels(figure, len(optimum.space.variables), (4.6,))
    words, unit = campaign.made_small
    if optimum.units and campaign.minimise == "error":
        words += f"\n{optimum.units.over.words}"
    _tried(error, optimum, f"{words} ({unit})")
    draw_variables(variables, optimum)
    style.save_picture(path, figure)


def _tried(axes: Axes, optimum: Optimum, objective: str) -> None:
    tried = optimum.evaluations
    number_of = _forecast_count(optimum) + np.arange(1, len(tried) + 1)
    if optimum.landscape:
        draw_forecasts(axes, optimum.landscape)
    errors = np.array([_made_small(evaluation) for evaluation in tried])
    feasible = np.array([evaluation.feasible for evaluation in tried])
    solved = np.isfinite(errors)
    for chosen, marker, colour, label in (
        (feasible & solved, "o", style.GREEN, "meets the requirements"),
        (~feasible & solved, "X", style.RED, "misses a requirement"),
    ):
        axes.plot(
            number_of[chosen],
            errors[chosen],
            marker,
            ms=4.5,
            color=colour,
            label=f"{label} ({chosen.sum()})",
        )
    so_far = _best_so_far(_counted_errors(optimum), optimum)
    axes.step(
        number_of,
        np.where(np.isfinite(so_far), so_far, np.nan),
        where="post",
        color=style.GREEN,
        lw=1.8,
        label="best by as many trials",
    )
    if not solved.all():
        at = number_of[~solved]
        axes.plot(
            at,
            np.full(len(at), 0.02),
            "|",
            ms=8,
            color=style.GREY,
            clip_on=False,
            transform=axes.get_xaxis_transform(),
            label=f"no error: no trial, or none solved ({len(at)})",
        )
    _numbers_of_trials(axes, np.array([done.trials for done in tried]), _forecast_count(optimum))
    axes.set(yscale="log", ylabel=objective)
    axes.tick_params(labelbottom=True)
    axes.set_xlabel("evaluation (number)")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0, _forecast_count(optimum) + len(tried) + 1)
    if not solved.any():
        style.say(axes, "no design has an attitude")
    style.legend_below(axes, 2)


def _forecast_count(optimum: Optimum) -> int:
    return len(optimum.landscape.forecasts) if optimum.landscape else 0


def draw_forecasts(axes: Axes, landscape: Landscape) -> None:
    """Draw the forecasts of the designs before any trial."""
    error, met = np.exp(landscape.expected), np.array(landscape.met, bool)
    number_of = np.arange(1, len(error) + 1)
    for chosen, marker, shade, label in ((met, "o", 1.0, "meets"), (~met, "x", 0.4, "misses")):
        axes.plot(
            number_of[chosen],
            error[chosen],
            marker,
            ms=3,
            color=style.GREY,
            alpha=shade,
            label=f"forecast, {label} the requirements ({chosen.sum()})",
        )
    least = np.fmin.accumulate(np.where(met, error, np.nan))
    axes.step(
        number_of, least, where="post", color=style.BLUE, lw=1.8, label="best forecast that meets"
    )


def _made_small(design: Evaluation) -> float:
    """Arcsec, or a cost; NaN where no trial is solved."""
    solved = math.isfinite(design.error)
    return design.cost if solved and math.isfinite(design.cost) else design.error / arcsec


def _counted_errors(optimum: Optimum) -> Floats:
    """Minimised quantity (n,); infinite where a requirement is missed, or no trial is solved."""
    return np.array(
        [
            _made_small(design) if design.feasible and math.isfinite(design.error) else math.inf
            for design in optimum.evaluations
        ]
    )


def _best_so_far(errors: Floats, optimum: Optimum) -> Floats:
    """Least error up to each design, among designs with as many trials: fewer trials err more by
    chance.

    errors  (n,) arcsec; infinite for designs that do not count
    """
    least, result, trials = math.inf, [], 0
    for error, evaluation in zip(errors, optimum.evaluations, strict=True):
        if evaluation.trials not in (0, trials):
            least, trials = math.inf, evaluation.trials
        least = min(least, error)
        result.append(least)
    return np.array(result)


def _numbers_of_trials(axes: Axes, trials: Floats, before: int) -> None:
    """Dotted lines where designs have more or fewer trials than the designs before them.

    before  number of the designs without trials
    """
    run = np.flatnonzero(trials > 0)
    steps = [k for k, last in zip(run[1:], run[:-1], strict=True) if trials[k] != trials[last]]
    for n, k in enumerate(steps):
        axes.axvline(
            before + k + 0.5,
            color=style.GREY,
            lw=1.0,
            ls=":",
            label=None if n else "another number of trials",
        )
    shown = -math.inf
    for k in [*run[:1], *steps]:
        # Numbers that would lie over each other are left out.
        if k - shown < 0.06 * (before + len(trials)):
            continue
        shown = k
        style.note(
            axes,
            f"{trials[k]:.0f}",
            (before + k + 0.6, 1.0),
            (1, -2),
            color="0.3",
            va="top",
            xycoords=("data", "axes fraction"),
        )
    if len(run):
        ends = dict.fromkeys(f"{end:.0f}" for end in (trials[run].min(), trials[run].max()))
        style.panel_title(axes, f"numbers at the top: trials per design, {' to '.join(ends)}")


def draw_variables(panels: Sequence[Axes], optimum: Optimum) -> None:
    """A panel for each variable of the designs: those tried, the best so far, its range at the end.

    From its low to its high bound, in its unit.
    """
    landscape, space = optimum.landscape, optimum.space
    points = [
        *(landscape.forecasts if landscape else ()),
        *(design.coordinates for design in optimum.evaluations),
    ]
    number_of, best = np.arange(1, len(points) + 1), _best_numbers(optimum)
    names = [variable.name for variable in space.variables]
    ticks = (0.0, 0.5, 1.0)
    values = [space.values(np.full(len(names), tick)) for tick in ticks]
    for axes, name, short, line in zip(
        panels, names, short_names(names), np.array(points).T, strict=True
    ):
        axes.plot(number_of, line, ".", ms=2.5, color=style.GREY, alpha=0.4)
        axes.plot(number_of, line[best], lw=1.6, color=style.GREEN, drawstyle="steps-post")
        if landscape:
            span = landscape.spans[name]
            axes.axhspan(span.low, span.high, color=style.SKY, alpha=0.3, lw=0)
        texts = [space.shown(name, at[name], 3).partition(" ") for at in values]
        axes.set_yticks(ticks, [number for number, _, _ in texts])
        axes.set_ylabel(f"({texts[0][2] or 1})")
        axes.set(xlim=(0, len(points) + 1), ylim=(-0.05, 1.05))
        axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
        axes.tick_params(labelbottom=False)
        style.panel_title(axes, short, LETTERS_BESIDE)
    for axes in panels[-COLUMNS:]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("evaluation (number)")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def variable_panels(figure: Figure, count: int, above: Sequence[float]) -> list[Axes]:
    """Panels of a figure below each other; below these, small panels in two columns.

    above    inch, heights of the panels; the figure is made as high as all need
    Returns  these panels, and then one for each of `count` variables
    """
    rows = -(-count // COLUMNS)
    heights = [*above, *[PANEL] * rows]
    figure.set_figheight(figure.get_figheight() + sum(heights))
    grid = figure.add_gridspec(len(heights), COLUMNS, height_ratios=heights)
    wide = [figure.add_subplot(grid[row, :]) for row in range(len(above))]
    places = [divmod(number, COLUMNS) for number in range(count)]
    return [*wide, *(figure.add_subplot(grid[len(above) + row, at]) for row, at in places)]


def _best_numbers(optimum: Optimum) -> Ints:
    """Number of the best design up to each forecast and then each evaluation.

    The best of forecasts is not compared with trials, nor one with fewer trials.
    """
    landscape, tried = optimum.landscape, _counted_errors(optimum)
    forecast = np.where(landscape.met, landscape.expected, np.inf) if landscape else np.empty(0)
    values = np.concatenate([forecast, tried])
    least = np.concatenate([np.fmin.accumulate(forecast), _best_so_far(tried, optimum)])
    best = (values == least) & np.isfinite(values)
    return np.maximum.accumulate(np.where(best, np.arange(len(values)), 0))


@style.styled
def draw_tolerance(path: Path, tolerance: Tolerance) -> None:
    """Distribution of each pair of variables, and of each, over designs within the error limit."""
    source, points = tolerance.source, thinned(tolerance.samples, DOTS)
    marks = np.quantile(tolerance.samples, MARKS, axis=0)
    texts = [list(source.shown(point).values()) for point in (*marks, *points)]
    units = [text.partition(" ")[2] for text in texts[0]]
    values = np.array([[float(text.split()[0]) for text in row] for row in texts])
    labels = [
        f"{name} ({unit or 1})" for name, unit in zip(short_names(source.names), units, strict=True)
    ]
    limit = f"{tolerance.limit / source.unit.size:.4g} {source.unit.name}".strip()
    draw_corner(
        path,
        values[len(MARKS) :],
        labels,
        f"designs that keep the objective below {limit}\n"
        f"{tolerance.chains.effective.min():.0f} independent samples, response surface within "
        f"{100 * tolerance.check_error:.1f} % on {tolerance.checks} unseen designs",
        values[: len(MARKS)],
    )


@style.styled
def draw_tornado(
    path: Path, variables: Sequence[Sensitivity], objective: str, unit: str = "arcsec"
) -> None:
    """Range of the objective over each variable alone, and the Sobol indices of each variable."""
    order = sorted(variables, key=_swing)
    figure = style.picture(2.6 + 0.85 * len(order))
    swing, indices = figure.subplots(2, 1)
    _swings(swing, order, objective, unit)
    _indices(indices, order)
    style.save_picture(path, figure)


def _swings(axes: Axes, order: Sequence[Sensitivity], objective: str, unit: str) -> None:
    design = order[0].error
    for y, variable in enumerate(order):
        ends = {"low": variable.low, "high": variable.high}
        finite = list(filter(math.isfinite, (*ends.values(), variable.error)))
        axes.plot(
            (min(finite), max(finite)), (y, y), lw=10, color=style.BLUE, solid_capstyle="butt"
        )
        if all(abs(end / variable.error - 1) <= SAME for end in ends.values()):
            text = f"changes it by less than {100 * SAME:g} %"
            style.note(axes, text, (variable.error, y), (6, 0))
        lost = [name for name, value in ends.items() if not math.isfinite(value)]
        moved = {
            name: value
            for name, value in ends.items()
            if math.isfinite(value) and abs(value / variable.error - 1) > SAME
        }
        for better in (True, False):  # both ends may lie on one side of the design
            there = {n: value for n, value in moved.items() if (value < variable.error) == better}
            if there:
                text = ", ".join(f"{name}: {style.number(value)}" for name, value in there.items())
                far = min(there.values()) if better else max(there.values())
                off, side = (-4, "right") if better else (4, "left")
                style.note(axes, text, (far, y), (off, 0), ha=side)
        if lost:
            text = f"no forecast at its {' and '.join(lost)} bound"
            style.note(axes, text, (max(finite), y), (4, -9), color=style.RED, path_effects=[])
    axes.axvline(
        design,
        color=style.BLACK,
        lw=1.2,
        label=f"the design: {style.number(design)} {unit}".strip(),
    )
    axes.set_xscale("log")
    axes.set_yticks(range(len(order)), short_names([variable.name for variable in order]))
    axes.margins(x=0.25)
    axes.set(xlabel=style.with_unit(objective, unit), ylim=(-0.7, len(order) - 0.3))
    axes.grid(axis="y", visible=False)
    style.panel_title(axes, "each variable alone from its low to its high bound, by forecast")
    style.legend_below(axes, 1)


def _indices(axes: Axes, order: Sequence[Sensitivity]) -> None:
    for shift, kind, label, colour, hatch in (
        (0.2, "total", "total, with all others", style.ORANGE, ""),
        (-0.2, "first", "first order, alone", style.GREEN, "///"),
    ):
        for y, variable in enumerate(order):
            index: Interval = getattr(variable, kind)
            axes.barh(
                y + shift,
                index.value,
                0.36,
                color=colour,
                hatch=hatch,
                ec="white",
                label=None if y else label,
            )
            bars = style.bars_of(index)
            axes.errorbar(index.value, y + shift, xerr=bars, fmt="none", ecolor=style.BLACK, lw=1.2)
            end = max(index.high, index.value)
            style.note(axes, f"{index.value:z.2f}", (end, y + shift), (4, 0))
    axes.set_yticks(range(len(order)), short_names([variable.name for variable in order]))
    axes.margins(x=0.12)
    axes.set(xlabel="Sobol index of ln(objective) (fraction of its variance)")
    axes.grid(axis="y", visible=False)
    style.panel_title(axes, "over the design space; lines: 95 % intervals")
    style.legend_below(axes, 2)


def short_names(names: Sequence[str]) -> list[str]:
    """The last parts of names, for pictures; whole names where the last parts are not unique."""
    last = [name.rpartition(".")[2] for name in names]
    return [
        short if last.count(short) == 1 else name for short, name in zip(last, names, strict=True)
    ]


def _swing(variable: Sensitivity) -> float:
    values = list(filter(math.isfinite, (variable.low, variable.high, variable.error)))
    lost = not all(map(math.isfinite, (variable.low, variable.high)))
    return max(values) / min(values) + 1e9 * lost


@style.styled
def draw_front(path: Path, points: Sequence[Point], goals: tuple[str, str], trials: int) -> None:
    """The Pareto front of forecasts, and the same designs in trials.

    goals  both, in words and with their units
    """
    figure = style.picture(5.0, f"{len(points)} Pareto-optimal designs by forecast")
    axes = figure.subplots()
    expected = np.array([point.expected for point in points])
    axes.plot(*expected.T, "o-", ms=5, color=style.BLUE, label="forecast")
    label = f"{trials} trials each, 95 % intervals"
    for n, point in enumerate(points):
        value = np.array(point.measured)
        bars = [style.bars_of(interval) for interval in point.intervals]
        axes.errorbar(
            value[0],
            value[1],
            xerr=np.nan_to_num(bars[0]),
            yerr=np.nan_to_num(bars[1]),
            fmt="s",
            ms=6,
            mfc="white",
            color=style.RED,
            label=None if n else label,
        )
        # A thin line joins the two of one design.
        axes.plot(
            *np.stack([point.expected, value]).T,
            ":",
            color=style.GREY,
            lw=1,
            label=None if n else "the same design",
        )
        style.note(axes, str(n + 1), point.expected, (-5, -10), ha="right", va="baseline")
    axes.set(xscale="log", yscale="log")
    axes.margins(0.12)
    axes.set(xlabel=goals[0], ylabel=goals[1])
    style.panel_title(axes, "numbers: rows of front.md")
    style.legend_below(axes, 3)
    style.save_picture(path, figure)


@style.styled
def draw_corner(
    path: Path, samples: Floats, labels: Sequence[str], title: str, marks: Floats | None = None
) -> None:
    """Distribution of each pair of columns of samples (n, d), of which DOTS are drawn, and of each.

    marks  (3, d) ends of the 95 % interval and the median between them; None: of all samples
    """
    n = len(labels)
    if marks is None:
        marks = np.quantile(samples, MARKS, axis=0)
    samples = thinned(samples, DOTS)
    figure = style.picture(style.WIDE + 0.5, title)
    # More than four columns need a larger picture for the same letters.
    side = max(style.WIDE, LARGEST * n)
    figure.set_size_inches(side, side + 0.5)
    grid = figure.subplots(n, n, squeeze=False, sharex="col")
    for i in range(n):
        for j in range(n):
            axes: Axes = grid[i, j]
            if j > i:
                axes.set_axis_off()
                continue
            axes.grid(visible=False)
            if i == j:
                _one(axes, samples[:, i], marks[:, i])
            else:
                axes.plot(samples[:, j], samples[:, i], ".", ms=1.5, alpha=0.4, color=style.BLUE)
                axes.yaxis.set_major_locator(MaxNLocator(4, prune="both"))
            axes.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
            axes.tick_params(axis="x", rotation=45)
            if i == n - 1:
                axes.set_xlabel(labels[j])
            if j == 0 and i > 0:
                axes.set_ylabel(labels[i])
            elif i != j:
                axes.tick_params(labelleft=False)
    style.save_picture(path, figure)


def _one(axes: Axes, values: Floats, marks: Floats) -> None:
    """Histogram with its median and 95 % of the samples."""
    low, middle, high = marks
    axes.hist(values, 30, color=style.BLUE)
    for at, line in ((low, ":"), (middle, "-"), (high, ":")):
        axes.axvline(at, color=style.BLACK, ls=line, lw=1)
    axes.set_yticks([])
    # Digits by the width, so that a narrow distribution is not rounded away.
    digits = max(0, 2 - math.floor(math.log10(high - low))) if high > low else 3
    texts = [f"{value:.{digits}f}" for value in (middle, low, high)]
    axes.set_title(f"{texts[0]}\n[{texts[1]}, {texts[2]}]", fontsize=style.SMALL)
