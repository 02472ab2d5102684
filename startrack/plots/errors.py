"""Pictures of errors: of many trials, of one sequence in time, and predicted and measured
values."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from startrack.core import Floats, Rows, arcsec, deg
from startrack.design import Accuracy
from startrack.metrics import Interval, Summary, summarise
from startrack.plots import style
from startrack.sequence import Mode
from startrack.verification import FlightComparison

BINS = 41


@style.styled
def draw_errors(
    path: Path | None,
    outcomes: Rows,
    title: str,
    summary: Summary | None = None,
    required: Sequence[Accuracy] = (),
) -> Figure:
    """The errors of many trials: across the boresight as points, about it as a histogram.

    Axes hold eight times the typical error. Larger ones stand at the edge, and are counted.

    summary   of these outcomes against the requirements; None: no requirements
    required  limits of errors; only limits of an rms per axis are drawn
    """
    correct = outcomes[outcomes["solved"] & ~outcomes["false"]]
    summary = summary or summarise(outcomes)
    available = summary.availability
    figure = style.picture(
        4.4,
        f"{title}: {summary.trials} trials, availability {100 * available.value:.1f} % "
        f"[{100 * available.low:.1f}, {100 * available.high:.1f}]; shown: the {len(correct)} "
        "solved and not false",
    )
    across, about = figure.subplots(1, 2)
    x, y, z = (np.asarray(correct[f"error_{axis}"], float) / arcsec for axis in "xyz")
    most = {limit.name: limit.most for limit in required if limit.objective.rms_per_axis}
    _across(across, x, y, summary.across, most.get("across"))
    _about(about, z, summary.about, most.get("about"))
    return style.save_picture(path, figure)


def _across(axes: Axes, x: Floats, y: Floats, rms: Interval, most: float | None) -> None:
    style.panel_title(axes, "across the boresight", 36)
    axes.set(xlabel="error about x (arcsec)", ylabel="error about y (arcsec)", aspect="equal")
    if not len(x):
        style.say(axes, "no attitude")
        return
    limit = style.robust_limit(np.concatenate([x, y]))
    size = np.hypot(x, y)
    inside = np.maximum(np.abs(x), np.abs(y)) <= limit
    axes.plot(x[inside], y[inside], ".", ms=3, alpha=0.5, color=style.BLUE, label="trial")
    if not inside.all():
        far = np.stack([x[~inside], y[~inside]])
        # On the edge, in their direction.
        axes.plot(
            *(far * limit / np.abs(far).max(axis=0)),
            "X",
            ms=6,
            color=style.RED,
            clip_on=False,
            zorder=5,
            label=f"{(~inside).sum()} beyond the axes, to {style.number(float(size.max()))} arcsec",
        )
    turn = np.linspace(0, 2 * np.pi, 200)
    radius = rms.value / arcsec
    axes.plot(
        radius * np.cos(turn),
        radius * np.sin(turn),
        color="k",
        lw=1.2,
        label=f"rms per axis\n{_interval_text(rms)}",
    )
    if most is not None:
        allowed, label = most / arcsec, _limit_text(most)
        if allowed <= limit:
            circle = allowed * np.cos(turn), allowed * np.sin(turn)
            axes.plot(*circle, "--", color=style.RED, label=label)
        else:
            axes.plot([], [], "--", color=style.RED, label=f"{label} (beyond)")
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit))
    style.legend_below(axes, 1)


def _about(axes: Axes, z: Floats, rms: Interval, most: float | None) -> None:
    style.panel_title(axes, "about the boresight", 36)
    axes.set(xlabel="error about z (arcsec)", ylabel="number of trials")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    if not len(z):
        style.say(axes, "no attitude")
        return
    limit = style.robust_limit(z)
    inside = np.abs(z) <= limit
    axes.hist(
        z[inside],
        BINS,
        range=(-limit, limit),
        color=style.BLUE,
        label=f"rms\n{_interval_text(rms)}",
    )
    if not inside.all():
        for side in (-1, 1):
            if many := int((side * z > limit).sum()):
                axes.annotate(
                    f"{many} beyond",
                    (side * limit, 0),
                    (0, 4),
                    textcoords="offset points",
                    rotation=90,
                    color=style.RED,
                    fontsize=8.5,
                    va="bottom",
                    ha="right" if side > 0 else "left",
                )
        largest = style.number(float(np.abs(z).max()))
        axes.plot(
            [],
            [],
            "X",
            color=style.RED,
            label=f"{(~inside).sum()} beyond the axis, to {largest} arcsec",
        )
    root = rms.value / arcsec
    axes.plot(
        [-root, -root, np.nan, root, root],
        [0, 1, np.nan, 0, 1],
        color=style.BLACK,
        lw=1.2,
        transform=axes.get_xaxis_transform(),
    )
    if most is not None:
        far, label = most / arcsec, _limit_text(most)
        for side in (-1, 1) if far <= limit else ():
            axes.axvline(side * far, ls="--", color=style.RED)
        label += "" if far <= limit else " (beyond)"
        axes.plot([], [], "--", color=style.RED, label=label)
    axes.set_xlim(-limit, limit)
    style.legend_below(axes, 1)


def _limit_text(most: float) -> str:
    return f"required: {most / arcsec:g} arcsec"


def _interval_text(interval: Interval) -> str:
    value, low, high = (
        style.number(x / arcsec) for x in (interval.value, interval.low, interval.high)
    )
    return f"{value} [{low}, {high}] arcsec"


MODES = {
    Mode.SEARCHING: (style.RED, "X"),
    Mode.ACQUIRED: (style.PURPLE, "D"),
    Mode.TRACKED: (style.GREEN, "o"),
    Mode.COASTED: (style.ORANGE, "s"),
}
AXES = {"x": "about x", "y": "about y", "z": "about the boresight"}
TYPICAL = 8.0  # median errors up to which the axis is linear


@style.styled
def draw_sequence(path: Path | None, table: Rows, title: str) -> Figure:
    """Rate and mode, and the error about each axis: of each frame alone and of the filter.

    Of the camera of the design; for each further head, the error of its alignment.
    """
    further = [table[table["head"] == head] for head in range(1, int(table["head"].max()) + 1)]
    table = table[table["head"] == 0]
    figure = style.picture(10.5 + 2.5 * len(further), title)
    ratios = 1.0, *[1.6] * (3 + len(further))
    rate, *panels = figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios)
    time = table["time"]
    rate.step(time, table["rate"] / deg, where="mid", color=style.GREY, lw=1)
    for mode, (colour, marker) in MODES.items():
        here = table["mode"] == mode
        if here.any():
            rate.plot(
                time[here],
                table["rate"][here] / deg,
                marker,
                ms=4,
                color=colour,
                label=f"{mode.name.lower()} ({here.sum()} frames)",
            )
    rate.set(ylabel="rate (deg/s)")
    rate.set_ylim(0, 1.15 * max(float(table["rate"].max() / deg), 1e-6))
    style.legend_below(rate, 2, labels=False)
    for axes, (axis, label) in zip(panels, AXES.items(), strict=False):
        _over_time(axes, table, axis, f"error {label} (arcsec)")
    for axes, rows in zip(panels[3:], further, strict=True):
        _alignment(axes, rows)
    panels[-1].set_xlabel("time (s)")
    style.legend_below(panels[2], 2, labels=bool(not further))
    if further:
        style.legend_below(panels[-1], 2)
    for axes in panels:
        axes.yaxis.set_minor_locator(NullLocator())
    return style.save_picture(path, figure)


def _over_time(axes: Axes, table: Rows, axis: str, label: str) -> None:
    time = table["time"]
    filtered, sigma = (table[name + axis] / arcsec for name in ("filtered_", "filtered_sigma_"))
    alone, wrong = table[f"error_{axis}"] / arcsec, table["false"]
    axes.fill_between(
        time,
        -3 * sigma,
        3 * sigma,
        color=style.BLUE,
        alpha=0.15,
        lw=0,
        label="3 sigma that the filter states",
    )
    axes.plot(time, filtered, "-", lw=1.3, color=style.BLUE, label="filter")
    axes.plot(time[~wrong], alone[~wrong], ".", ms=5, color=style.RED, label="frame alone")
    if wrong.any():
        axes.plot(time[wrong], alone[wrong], "kX", ms=6, label="frame alone, false attitude")
    size = np.abs(alone[~wrong])
    scale = max(float(np.nanmedian(size)) * TYPICAL, 1e-3) if np.isfinite(size).any() else 1.0
    scale = float(f"{scale:.1g}")
    # A coasting filter drifts by degrees; linear near zero, logarithmic beyond.
    shown = np.concatenate([alone, filtered, 3 * sigma])
    largest = float(np.nanmax(np.abs(shown))) if np.isfinite(shown).any() else scale
    if largest > 3 * scale:
        axes.set_yscale("symlog", linthresh=scale, linscale=1.5)
        ends = [scale * 10.0**n for n in range(1 + int(np.log10(largest / scale)))]
        axes.set_yticks(
            [*(-end for end in reversed(ends)), 0.0, *ends],
            [*(f"-{end:g}" for end in reversed(ends)), "0", *(f"{end:g}" for end in ends)],
        )
        text = f"axis linear to ±{scale:g} arcsec, logarithmic beyond; largest drawn "
        style.panel_title(axes, f"{text}{style.number(largest)} arcsec")
    axes.set_ylim(-1.3 * largest, 1.3 * largest)
    axes.set_ylabel(label)
    axes.axhline(0, color=style.GREY, lw=0.5)


def _alignment(axes: Axes, table: Rows) -> None:
    """The errors of the alignment of a head, beside the 3 sigma that the filter states."""
    worst = np.zeros(len(table))
    colours = style.BLUE, style.ORANGE, style.GREEN
    for (axis, label), colour in zip(AXES.items(), colours, strict=True):
        axes.plot(
            table["time"],
            table[f"alignment_{axis}"] / arcsec,
            lw=1.3,
            color=colour,
            label=f"error of its alignment {label}",
        )
        worst = np.fmax(worst, 3 * table[f"alignment_sigma_{axis}"] / arcsec)
    axes.fill_between(
        table["time"],
        -worst,
        worst,
        color=style.GREY,
        alpha=0.15,
        lw=0,
        label="3 sigma of the least known axis",
    )
    axes.set_ylabel(f"alignment, head {int(table['head'][0]) + 1} (arcsec)")
    axes.axhline(0, color=style.GREY, lw=0.5)


@style.styled
def draw_flown(path: Path | None, flown: FlightComparison, title: str) -> Figure:
    """Predicted over seen of each figure, and the centroid over the phase of the pixel."""
    shown = [row for row in flown.differences if np.isfinite(row.ratio) and row.predicted.value]
    curves = {star: pair for star, pair in flown.curves.items() if np.isfinite(pair[0]).any()}
    figure = style.picture(3.4 + 0.5 * len(shown) / 2 + 2.6 * len(curves), title)
    heights = [0.25 * len(shown) + 1, *(2.2 for _ in curves)]
    panels = np.atleast_1d(figure.subplots(1 + len(curves), 1, height_ratios=heights))
    ratios, below = panels[0], range(len(shown))
    for n, row in zip(below, shown, strict=True):
        ends = [row.predicted.low / row.seen.value, row.predicted.high / row.seen.value]
        colour, marker = (style.RED, "D") if row.differs else (style.BLUE, "o")
        seen_ends = [row.seen.low / row.seen.value, row.seen.high / row.seen.value]
        ratios.plot(seen_ends, [n, n], color="0.75", lw=7, solid_capstyle="butt", zorder=1)
        ratios.plot(ends, [n, n], color=colour, lw=2)
        ratios.plot(row.ratio, n, marker, color=colour)
    ratios.axvline(1.0, color=style.GREY, lw=1)
    ratios.set(yticks=list(below), yticklabels=[f"{row.star} {row.name}" for row in shown])
    ratios.set(
        xlabel="over what is seen; grey: seen, 95 %; red diamonds: the intervals do not meet"
    )
    ratios.invert_yaxis()
    for axes, (star, (seen, predicted)) in zip(panels[1:], curves.items(), strict=True):
        phase = (np.arange(seen.shape[1]) + 0.5) / seen.shape[1] - 0.5
        for axis, colour in ((0, style.BLUE), (1, style.ORANGE)):
            axes.plot(phase, predicted[axis], color=colour, label=f"{'xy'[axis]} predicted")
            axes.plot(phase, seen[axis], "o", color=colour, label=f"{'xy'[axis]} seen")
        axes.set(xlabel="place in the pixel", ylabel="offset of the centroid (pixel)")
        style.panel_title(axes, star, 40)
        style.legend_below(axes, 4)
    return style.save_picture(path, figure)
