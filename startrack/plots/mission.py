"""Picture of a mission: when its heads are blind, over season and orbit."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from startrack.mission import EDGES, Availability, Flown, Plan
from startrack.plots.style import (
    BLUE,
    CYCLE,
    GREY,
    LINES,
    colour_bar,
    legend_below,
    panel_title,
    picture,
    save_picture,
    say,
    styled,
)

DAY = 86400.0


@styled
def draw_mission(
    path: Path, plan: Plan, flown: Flown, found: Availability, title: str
) -> None:  # fmt: skip
    """Blind time of each head and of all over the mission; valid heads over season and orbit."""
    figure = picture(9.0, title)
    over, phase, lengths = figure.subplots(3, 1, height_ratios=(1.1, 1.2, 0.9))
    _blind_over_time(over, plan, flown)
    _over_phase(phase, plan, flown)
    _lengths(lengths, found)
    save_picture(path, figure)


def _blind_over_time(axes: Axes, plan: Plan, flown: Flown) -> None:
    seasons = np.array_split(np.arange(flown.blind.shape[1]), len(flown.count))
    seasons = [one for one in seasons if len(one)]
    day = [one.mean() * flown.step / DAY for one in seasons]
    curves = {head.name: flown.blind[h] > 0 for h, head in enumerate(plan.heads)}
    curves["no head valid"] = flown.valid == 0
    for k, (name, blind) in enumerate(curves.items()):
        last = name == "no head valid"
        part = [100 * float(blind[one[0] : one[-1] + 1].mean()) for one in seasons]
        axes.plot(
            day, part, lw=2.0 if last else 1.2, label=name,
            color="k" if last else CYCLE[k % len(CYCLE)], ls="-" if last else LINES[k % len(LINES)],
        )  # fmt: skip
    axes.set(xlabel="day of the mission", ylabel="blind (% of the time)", xlim=(0, None))
    axes.set_ylim(0, None)
    legend_below(axes, 4)


def _over_phase(axes: Axes, plan: Plan, flown: Flown) -> None:
    days = flown.blind.shape[1] * flown.step / DAY
    mean = np.divide(
        flown.valid_sum, flown.count, out=np.full_like(flown.count, np.nan), where=flown.count > 0
    )
    colours = matplotlib.colormaps["viridis"].with_extremes(bad="0.75")
    shown = axes.imshow(
        mean.T, origin="lower", aspect="auto", extent=(0, days, 0, 360), cmap=colours,
        vmin=0, vmax=len(plan.heads),
    )  # fmt: skip
    axes.grid(False)
    axes.set(xlabel="day of the mission", ylabel="orbit from the node (deg)")
    axes.set_yticks(range(0, 361, 90))
    colour_bar(shown, axes, mean, "valid heads, mean")


def _lengths(axes: Axes, found: Availability) -> None:
    panel_title(axes, "Times without any valid head")
    counts = found.none.histogram()
    names = [f"to {high:g} s" if high < 60 else f"to {high / 60:g} min" for high in EDGES[1:-1]]
    names[-1:] = ["to 1 h", "over 1 h"]
    bars = axes.bar(range(len(counts)), counts, color=BLUE)
    axes.bar_label(bars, [f"{count}" if count else "" for count in counts], fontsize=8.5)
    axes.set_xticks(range(len(counts)), names)
    axes.set(ylabel="how often", xlabel="length")
    axes.grid(False, axis="x")
    axes.set_ylim(0, 1.15 * max(int(counts.max()), 1))
    if not counts.any():
        say(axes, "there are none")
        axes.spines[["left", "right", "top"]].set_color(GREY)
