"""Pictures of an error budget: its causes, and the sky."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from startrack.budget import Budget, Line, Survey, Term
from startrack.core import Floats, arcsec
from startrack.design import Accuracy, Case
from startrack.metrics import Interval, rms_interval
from startrack.plots.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    NO_VALUE,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    SMALL,
    YELLOW,
    colour_bar,
    colour_limits,
    number,
    outline,
    panel_title,
    picture,
    save_picture,
    styled,
)

COLOURS = {
    Term.BIAS: GREY,
    Term.THERMO_ELASTIC: ORANGE,
    Term.FIELD: BLUE,
    Term.PIXEL: GREEN,
    Term.NOISE: RED,
    Term.ABERRATION: PURPLE,
    Term.MEASUREMENT_DATE: SKY,
}
WHOLE = "0.8"  # grey of the bar end to end
TOP = 0.98  # of the directions whose error has a colour of its own


@styled
def draw_budget(
    path: Path | None,
    expected: Budget[Any],
    found: Budget[Any] | None,
    title: str,
    required: Sequence[Accuracy] = (),
) -> Figure:
    """A bar for each cause, from zero; measured values as points with their 95 % intervals.

    required  limits on the error; those of other statistics than the rms per axis are named only
    """
    names: dict[str, Line[Any]] = {line.name: line for line in expected.lines}
    beside = {line.name: line for line in found.lines} if found else {}
    order = [*names, *(name for name in beside if name not in names), "end to end"]
    names["end to end"] = expected.whole
    if found:
        beside["end to end"] = found.whole
    text = f"; points: measured in {found.whole.spread.error.shape[0]} members" if found else ""
    figure = picture(2.2 + 2 * 0.27 * len(order), f"{title}: error by cause, analytic{text}")
    panels = figure.subplots(2, 1)
    for axes, kind in zip(panels, ("across", "about"), strict=True):
        values = _bars(axes, order, names, beside, kind)
        limits = [one for one in required if one.name == kind]
        _required(axes, limits, max(values, default=1.0))
        axes.set_xlabel(f"error {kind} the boresight (arcsec rms per axis)")
    shown = {line.term for line in (*names.values(), *beside.values()) if line.term}
    for term in Term:
        if term in shown:
            panels[0].barh(0, 0, color=COLOURS[term], label=term.value)
    figure.legend(*_once(figure), loc="outside lower left", ncols=3)
    return save_picture(path, figure)


def _bars(
    axes: Axes,
    order: list[str],
    names: dict[str, Line[Any]],
    beside: dict[str, Line[Any]],
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
            texts.append(number(end))
        if other:
            value, low, high = _measured(other, kind)
            axes.errorbar(
                value, k, xerr=[[value - low], [high - value]], fmt="D", ms=4.5, color=BLACK,
                mfc="white", ecolor="0.35", elinewidth=1.5, zorder=4,
                label="measured, 95 % interval",
            )  # fmt: skip
            texts.append(f"measured {number(value)}")
            end = max(end, high)
        ends.append(end)
        axes.annotate(
            "; ".join(texts), (end, k), (4, 0), textcoords="offset points", va="center",
            fontsize=SMALL, path_effects=[outline("white")], zorder=6,
        )  # fmt: skip
    axes.set_yticks(range(len(order)), order)
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    room = 1.5 if beside else 1.15
    axes.set_xlim(0, room * max(ends) if max(ends) > 0 else 1.0)
    return ends


def _measured(line: Line[Any], kind: str) -> tuple[float, float, float]:
    """Arcsec rms per axis with its interval over the members."""
    square = (line.spread.error**2).mean(axis=1)
    found: Interval = rms_interval(square[:, :2].mean(axis=1) if kind == "across" else square[:, 2])
    high = found.high if np.isfinite(found.high) else found.value
    return found.value / arcsec, found.low / arcsec, high / arcsec


def _required(axes: Axes, limits: Sequence[Accuracy], largest: float) -> None:
    """A line at a limit of the rms per axis; a limit of another statistic in words."""
    for one in limits:
        value = one.most / arcsec
        text = f"required of the {one.objective}: at most {number(value)} arcsec"
        if one.objective.fraction is None and not (
            one.objective.radial and one.objective.axes != "about"
        ):
            axes.axvline(value, color=PURPLE, lw=2, ls="--", label="requirement, end to end")
            axes.set_xlim(0, max(axes.get_xlim()[1], 1.1 * value) if value < 5 * largest else None)
            if value >= 5 * largest:
                text += ", beyond the axis"
        else:
            text += " (no line: these bars are rms per axis)"
        panel_title(axes, text)


def _once(figure: Figure) -> tuple[list[Any], list[str]]:
    """Handles and names of all panels, each name once."""
    named: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    return list(named.values()), list(named)


@styled
def draw_sky(path: Path | None, found: Survey, case: Case, title: str) -> Figure:
    """Detected stars and errors over directions of the boresight."""
    few = case.tracker.identification.min_matches
    figure = picture(
        10.4,
        f"{title}: {len(found.stars)} directions (ICRS), an attitude at "
        f"{100 * found.solved.mean():.2f} %; {few}, 5, 8 stars or more at "
        + ", ".join(f"{100 * found.fraction(n):.1f}" for n in (few, 5, 8))
        + " %. Right ascension grows to the left",
    )
    maps = (
        (found.stars, "detected stars in the field (number)", 1.0),
        (found.across / arcsec, "error across the boresight (arcsec rms per axis)", TOP),
        (found.about / arcsec, "error about the boresight (arcsec rms)", TOP),
    )
    ra, dec = np.meshgrid(np.linspace(-np.pi, np.pi, 481), np.linspace(-np.pi / 2, np.pi / 2, 241))
    u, v = (0.5 * (each[1:, 1:] + each[:-1, :-1]) for each in (ra, dec))
    direction = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    _, nearest = cKDTree(found.direction).query(direction)
    for k, (values, label, part) in enumerate(maps):
        axes = figure.add_subplot(3, 1, k + 1, projection="mollweide")
        low, high = colour_limits(values, part)
        # East to the left, as seen from the Earth.
        shown = axes.pcolormesh(-ra, dec, values[nearest], vmin=low, vmax=high, rasterized=True)
        axes.set_facecolor(NO_VALUE)
        axes.set_xticks(np.radians([-120, -60, 0, 60, 120]), ["120°", "60°", "0°", "300°", "240°"])
        axes.set_yticks(np.radians([-60, -30, 0, 30, 60]))
        for text in axes.get_xticklabels():
            text.set(color="white", path_effects=[outline("black")])
        axes.set_axisbelow(False)  # numbers and lines over the map
        axes.grid(alpha=0.35)
        colour_bar(shown, axes, values, label, orientation="horizontal", shrink=0.7, aspect=32,
                   pad=0.03)  # fmt: skip
        panel_title(axes, _worst(axes, found, values, least=k == 0))
    return save_picture(path, figure)


def _worst(axes: Axes, found: Survey, values: Floats, least: bool) -> str:
    """Marks the worst direction, and says where it is."""
    if not np.isfinite(values).any():
        return "no attitude anywhere"
    at = int(np.nanargmin(values) if least else np.nanargmax(values))
    x, y, z = found.direction[at]
    ra, dec = np.arctan2(y, x), np.arcsin(z)
    axes.plot(-ra, dec, "X", color=YELLOW, mec="black", ms=9, mew=1.2)
    text = (
        f"worst (cross): {number(values[at])} at RA {np.degrees(ra) % 360:.0f}°, "
        f"Dec {np.degrees(dec):+.0f}°"
    )
    blind = float(np.isnan(values).mean())
    return f"{text}; grey: no attitude, {100 * blind:.1f} % of the sky" if blind else text
