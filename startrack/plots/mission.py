"""Pictures of missions: when heads are blind, over season, orbit and direction."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from startrack.core import DAY, Flags, Floats, arcsec, deg, utc_text
from startrack.mission import EDGES, Availability, Flown, KeepClear, MissionPlan
from startrack.plots import style

SKY_INSTANTS = 1000  # of a mission, of the map of its heads
ERROR = "error, worst axis\n(arcsec rms)"


@style.styled
def draw_mission(
    path: Path, plan: MissionPlan, flown: Flown, available: Availability, title: str
) -> None:
    """Blind time of each head and of all heads over time; valid heads and error over season and
    orbit."""
    figure = style.picture(11.0, title)
    over, phase, error, lengths = figure.subplots(4, 1, height_ratios=(1.1, 1.1, 1.1, 0.9))
    _blind_over_time(over, plan, flown)
    worst = np.sqrt(_mean(flown.square_sum, flown.known).max(axis=0)) / arcsec
    heads, few = (0, len(plan.heads)), style.colour_limits(worst, 0.99, 0.0)
    for axes, values, label, limits in (
        (phase, _mean(flown.valid_sum, flown.count), "valid heads, mean", heads),
        (error, worst, ERROR, few),
    ):
        days = flown.blind.shape[1] * flown.step / DAY
        _image(axes, values.T, (0, days, 0, 360), label, limits)
        axes.set(xlabel=_days(plan), ylabel="orbit from the node (deg)")
        axes.set_yticks(range(0, 361, 90))
    _lengths(lengths, available)
    style.save_picture(path, figure)


@style.styled
def draw_beta(path: Path, plan: MissionPlan, flown: Flown, title: str) -> None:
    """Valid heads and error over the beta angle (Sun to the plane of the orbit) and the orbit."""
    steps, any_valid, _, valid, *squares = flown.by_beta
    worst = np.sqrt(_mean(np.array(squares), any_valid).max(axis=0)) / arcsec
    used = np.flatnonzero(steps.sum(axis=1))
    part = slice(int(used[0]), int(used[-1]) + 1)
    edge = np.linspace(-90, 90, len(steps) + 1)
    extent = (0.0, 360.0, float(edge[part.start]), float(edge[part.stop]))
    figure = style.picture(8.0, title)
    often = 100 * _mean(any_valid, steps)
    least = min(float(np.nanmin(often[part])), 99.0)
    for axes, (values, label, limits) in zip(
        figure.subplots(3, 1),
        (
            (often, "one valid head or more\n(% of the time)", (least, 100.0)),
            (_mean(valid, steps), "valid heads, mean", (0, len(plan.heads))),
            (worst, ERROR, style.colour_limits(worst, 0.99, 0.0)),
        ),
        strict=True,
    ):
        _image(axes, values[part], extent, label, limits)
        axes.set(xlabel="orbit from the node (deg)", ylabel="beta angle (deg)")
        axes.set_xticks(range(0, 361, 60))
    style.save_picture(path, figure)


@style.styled
def draw_tracks(path: Path, plan: MissionPlan, title: str) -> None:
    """Boresight and field of each head on the sky, and the tracks of Sun and Moon."""
    time = plan.loaded.mission.time
    last = utc_text(time.begin, time.duration)
    figure = style.picture(
        4.5,
        f"{title}: where heads look in {time.begin[:16]} to {last[:16]} UTC (ICRS, right "
        "ascension grows to the left); rings: fields at the begin, through their corners",
    )
    axes = figure.add_subplot(projection="mollweide")
    step = time.duration / SKY_INSTANTS
    over = plan.motion.at(0.0, step, SKY_INSTANTS)
    for n, head in enumerate(plan.heads):
        colour = style.CYCLE[n % len(style.CYCLE)]
        line = np.einsum("ijn,i->jn", over.body, head.boresight)
        axes.plot(*_on_map(line), ".", ms=2, color=colour, alpha=0.35)
        axes.plot(*_on_map(_circle(line[:, 0], head.field)), ".", ms=1.2, color=colour)
        axes.plot([], [], "o", ms=5, color=colour, label=f"{head.name}, {SKY_INSTANTS} instants")
    for body, name, colour, marker in (
        (over.sun, "Sun", style.ORANGE, "o"),
        (over.moon, "Moon", style.GREY, "D"),
    ):
        axes.plot(*_on_map(body), ".", ms=2.5, color=colour)
        axes.plot(
            *_on_map(body[:, :1]),
            marker,
            ms=8,
            color=colour,
            mec="k",
            label=f"{name}, at the begin",
        )
    axes.set_xticks(np.radians([-120, -60, 0, 60, 120]), ["120°", "60°", "0°", "300°", "240°"])
    axes.set_yticks(np.radians([-60, -30, 0, 30, 60]))
    style.legend_below(axes, 3, labels=False)
    style.save_picture(path, figure)


def _on_map(line: Floats) -> tuple[Floats, Floats]:
    """Places (n,) of unit vectors (3, n) on a map whose right ascension grows to the left."""
    return -np.arctan2(line[1], line[0]), np.arcsin(np.clip(line[2], -1, 1))


def _circle(middle: Floats, radius: float) -> Floats:
    """Unit vectors (3, n) at an angle from one."""
    turn = np.linspace(0, 2 * np.pi, 180)
    aside = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    aside /= np.linalg.norm(aside)
    other = np.cross(middle, aside)
    ring = np.outer(aside, np.cos(turn)) + np.outer(other, np.sin(turn))
    return np.asarray(np.cos(radius) * middle[:, None] + np.sin(radius) * ring)


def _days(plan: MissionPlan) -> str:
    return f"day after {plan.loaded.mission.time.begin[:16]} UTC"


def _blind_over_time(axes: Axes, plan: MissionPlan, flown: Flown) -> None:
    seasons = np.array_split(np.arange(flown.blind.shape[1]), len(flown.count))
    seasons = [season for season in seasons if len(season)]
    day = [season.mean() * flown.step / DAY for season in seasons]
    curves = {head.name: flown.blind[h] > 0 for h, head in enumerate(plan.heads)}
    curves["no head valid"] = flown.valid == 0
    for k, (name, blind) in enumerate(curves.items()):
        last = name == "no head valid"
        part = [100 * float(blind[season[0] : season[-1] + 1].mean()) for season in seasons]
        colour, line = style.CYCLE[k % len(style.CYCLE)], style.LINES[k % len(style.LINES)]
        look: dict[str, Any] = {"color": "k", "ls": "-"} if last else {"color": colour, "ls": line}
        axes.plot(day, part, lw=2.0 if last else 1.2, label=name, **look)
    axes.set(xlabel=_days(plan), ylabel="blind (% of the time)", xlim=(0, None))
    axes.set_ylim(0, None)
    style.legend_below(axes, 4)


def _mean(total: Floats, count: Floats) -> Floats:
    many = np.broadcast_to(count, total.shape)
    return np.divide(total, many, out=np.full(total.shape, np.nan), where=many > 0)


def _image(
    axes: Axes,
    values: Floats,
    extent: tuple[float, float, float, float],
    label: str,
    limits: tuple[float, float | None],
    clear: Flags | bool = True,
) -> None:
    """A map with its bar of colours; grey where the value is missing or not clear."""
    colours = matplotlib.colormaps["viridis"].with_extremes(bad=style.NO_VALUE)
    shown = axes.imshow(
        np.where(clear, values, np.nan),
        origin="lower",
        aspect="auto",
        extent=extent,
        cmap=colours,
        vmin=limits[0],
        vmax=limits[1],
    )
    axes.grid(visible=False)
    style.colour_bar(shown, axes, values, label)


def _lengths(axes: Axes, available: Availability) -> None:
    style.panel_title(axes, "Times without any valid head")
    counts = available.none.histogram()
    names = [f"to {high:g} s" if high < 60 else f"to {high / 60:g} min" for high in EDGES[1:-1]]
    names[-1:] = ["to 1 h", "over 1 h"]
    bars = axes.bar(range(len(counts)), counts, color=style.BLUE)
    axes.bar_label(bars, [f"{count}" if count else "" for count in counts], fontsize=8.5)
    axes.set_xticks(range(len(counts)), names)
    axes.set(ylabel="how often", xlabel="length")
    axes.grid(visible=False, axis="x")
    axes.set_ylim(0, 1.15 * max(int(counts.max()), 1))
    if not counts.any():
        style.say(axes, "there are none")
        axes.spines[["left", "right", "top"]].set_color(style.GREY)


@style.styled
def draw_placement(
    path: Path,
    mapped: tuple[Floats, Floats, Floats, Floats],
    before: list[tuple[float, float]],
    after: list[tuple[float, float]],
    keep_out: tuple[KeepClear, ...],
    title: str,
) -> None:
    """Blind time of one head and the objective over all directions of its boresight; the heads.

    mapped         of `map_of`
    before, after  azimuth and elevation (radian) of each head
    """
    lines, part, longest, score = mapped
    azimuth, elevation = np.meshgrid(np.arange(-178.0, 180, 4) * deg, np.arange(-88.0, 90, 4) * deg)
    flat = np.cos(elevation)
    here = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
    nearest = (here @ lines.T).argmax(axis=-1)
    clear = np.ones(azimuth.shape, bool)
    for cone in keep_out:
        axis = np.array(cone.axis) / np.linalg.norm(cone.axis)
        clear &= here @ axis < np.cos(cone.angle)
    least = np.log10(np.maximum(score, 1e-6))[nearest]
    figure = style.picture(11.0, title)
    for axes, (values, label, low) in zip(
        figure.subplots(3, 1),
        (
            (100 * part[nearest], "blind (% of the time)", 0.0),
            (longest[nearest] / 60, "longest blinding\nin an orbit (min)", 0.0),
            (least, "objective of the search,\nothers as placed (log10)", float(least.min())),
        ),
        strict=True,
    ):
        _image(axes, values, (-180, 180, -90, 90), label, (low, None), clear)
        for place, marker, colour, name in (
            (before, "o", style.SKY, "before"),
            (after, "^", style.RED, "after"),
        ):
            x, y = np.degrees(np.array(place)).T
            axes.plot(x, y, marker, color=colour, mec="white", ms=8, label=name)
        axes.set(xlabel="azimuth, from x to y (deg)", ylabel="elevation, to z (deg)")
        axes.set_xticks(range(-180, 181, 60))
        axes.set_yticks(range(-90, 91, 45))
    style.legend_below(axes, 2)
    style.save_picture(path, figure)
