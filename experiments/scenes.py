"""Which effects does a scene need, how much time does each take, and which error results if it is
left out?

Four scenes of the nanosatellite's tracker (in the dark, slewing, with the Moon, with the limb) and
an Earth imager, each with all effects of the chain. Every effect is left out alone, on the same
skies and noise. Then, starting with the smallest, effects are left out together as long as the root
sum square of their errors stays below a fraction of the scene's error. An effect whose absence
makes a solved trial unsolved is kept. The remaining chain is judged on trials that were not used
for the selection.

    python experiments/scenes.py [--trials N] [--out DIR] [--json FILE] [--quick] [SCENE ...]

writes scenes.md, scenes.json and scenes.png; a quarter of an hour of CPU time for 16 trials of each
scene.
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import cv2
import scenes_imager
import scenes_tracker
from leaving_out import Effect, Found, Gap, View, Way, leave_out
from matplotlib.axes import Axes

from startrack.benchmark import figure, spent, versions
from startrack.io import save_json, save_text
from startrack.plots import CYCLE, LINES, RED, SMALL, legend_below, picture, save_picture, styled

FRACTION = 1 / 3
TIMED = 4  # trials repeated alternately with all effects, for the time
IMAGES = 4  # trials of a tracker per trial of the imager, which has thousands of pixels
KEPT, SPARED = "#1f6f43", "#999999"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    views = {view.name: view for view in (*scenes_tracker.views(), scenes_imager.view())}
    names = ", ".join(views)
    parser.add_argument(
        "scenes", nargs="*", metavar="SCENE", help=f"scenes to run: {names} (default: all)"
    )
    parser.add_argument(
        "--trials", type=int, default=16, help="trials of each scene of a tracker (default: 16)"
    )
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR")
    options = command.read(parser, trials=1)
    cv2.setNumThreads(1)
    chosen = [views[name] for name in options.scenes or views]
    if options.quick:
        few = dict(list(chosen[0].effects.items())[:2])
        chosen = [replace(chosen[0], effects=few)]
    found = [study(one, options.trials) for one in chosen]
    text = markdown(found, options.trials)
    out = options.out / "scenes.md"
    save_text(out, text)
    figures = {"versions": versions(), **values(found)}
    save_json(out.with_suffix(".json"), figures)
    command.save(options, figures)
    draw(out.with_suffix(".png"), found)
    print(text)


def study(view: View, trials: int) -> Found:
    if view.faster is None:
        trials = max(trials // IMAGES, 1)
    return leave_out(view, trials, min(TIMED, trials), FRACTION, tell)


def tell(what: str) -> None:
    print(what, file=sys.stderr, flush=True)


def markdown(found: Sequence[Found], trials: int) -> str:
    """A table of the chains, and a table of effects for each scene."""
    source = command.source(f"scenes.py --trials {trials}")
    lines = [
        "# Effects that a scene needs",
        "",
        "![Error caused by leaving out each effect, and the time of a trial](scenes.png)",
        "",
        f"{source}, {versions()}; CPU time of one thread, median.",
        "",
        "Each scene has all effects that startrack models. Each effect is left out alone, on the "
        "same attitudes and noise: its error is the rms of the difference, with its standard "
        "error. Starting with the smallest, effects are left out as long as the root sum square "
        f"of their errors stays below {FRACTION:.2g} of the error of the scene, across and about; "
        "an effect whose absence makes a solved trial unsolved is kept. The selection is checked "
        "on as many other trials.",
        "",
        "| scene | effects | CPU time | solved | error | gap to everything | left out, root sum "
        "square |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in found:
        for way in one.ways:
            spared = "" if way is one.ways[0] else joined(one.bound)
            gap = "" if way is one.ways[0] else measured(way.gap)
            lines.append(
                f"| {one.view.name} | {way.name} | {spent(way.seconds)} | {way.answers} of "
                f"{one.trials} | {joined(way.error)} | {gap} | {spared} |"
            )
    for one in found:
        lines += ["", *effects_of(one)]
    return "\n".join([*lines, ""])


def effects_of(found: Found) -> list[str]:
    view = found.view
    kept = sum(effect.kept for effect in found.effects)
    lines = [
        f"## {view.name}",
        f"{view.text[0].upper()}{view.text[1:]}; {found.trials} trials. Errors are "
        f"{' and '.join(view.kinds)}; of the scene: {joined(found.own)}. It needs {kept} of "
        f"{len(found.effects)} effects.",
        "",
        "| effect | error when left out | fraction of the scene's error | solved or not changed | "
        "CPU time | kept |",
        "|---|---|---|---|---|---|",
    ]
    for effect in sorted(found.effects, key=lambda effect: -effect.fraction):
        lines.append(
            f"| {effect.name} | {measured(effect.gap)} | {effect.fraction:.2f} | "
            f"{effect.gap.changed} | {1e3 * effect.seconds:+.1f} ms | "
            f"{'yes' if effect.kept else ''} |"
        )
    if found.refused:
        lines += ["", f"No faster way: {found.refused}."]
    return lines


def joined(values: Any) -> str:
    return "; ".join(figure(value) for value in values)


def measured(gap: Gap) -> str:
    return "; ".join(
        f"{figure(error)} ± {figure(sigma)}" if error else "0"
        for error, sigma in zip(gap.error, gap.sigma, strict=True)
    )


def values(found: Sequence[Found]) -> dict[str, Any]:
    """Values of the tables for JSON; times in seconds."""
    return {
        one.view.name: {
            "kinds": one.view.kinds,
            "trials": one.trials,
            "own": list(one.own),
            "bound": list(one.bound),
            "refused": one.refused,
            "effects": {effect.name: plain(effect) for effect in one.effects},
            "ways": {way.name: plain(way) for way in one.ways},
        }
        for one in found
    }


def plain(row: Effect | Way) -> dict[str, Any]:
    """A row without its name, with arrays as lists."""
    gap = {"error": list(row.gap.error), "sigma": list(row.gap.sigma), "changed": row.gap.changed}
    known = {**row._asdict(), "gap": gap}
    del known["name"]
    return {name: list(each) if name == "error" else each for name, each in known.items()}


@styled
def draw(path: Path, found: Sequence[Found]) -> None:
    """A panel for each scene with effects by fraction; a panel of the chains' time and error."""
    heights = [*(1.0 + 0.17 * len(one.effects) for one in found), 3.6]
    figure = picture(
        0.5 + sum(heights),
        "Every effect left out alone, on the same skies and noise; green circles: kept, grey: "
        "left out, triangles: 0.001 or less; dashed: limit for all effects left out together",
    )
    *panels, ways = figure.subplots(len(heights), 1, height_ratios=heights)
    for axes, one in zip(panels, found, strict=True):
        draw_effects(axes, one)
    draw_ways(ways, found)
    save_picture(path, figure)


def draw_effects(axes: Axes, found: Found) -> None:
    effects = sorted(found.effects, key=lambda effect: effect.fraction)
    least = 1e-3
    for row, effect in enumerate(effects):
        worst = (effect.gap.error / found.own).argmax()
        sigma = effect.gap.sigma[worst] / found.own[worst]
        colour = KEPT if effect.kept else SPARED
        axes.errorbar(
            max(effect.fraction, least),
            row,
            xerr=sigma if effect.fraction > least else 0.0,
            fmt="o" if effect.fraction > least else "<",
            color=colour,
            ms=5,
        )
        axes.annotate(
            f"{1e3 * effect.seconds:+.1f} ms",
            (1.01, row),
            xycoords=("axes fraction", "data"),
            fontsize=SMALL,
            va="center",
            color=colour,
        )
    axes.set(
        xscale="log",
        xlim=(least / 1.5, None),
        ylim=(-0.7, len(effects) - 0.3),
        xlabel="error when left out, over the scene's error (1)",
        title=f"{found.view.name}, {found.trials} trials; right: CPU time of a trial",
    )
    axes.set_yticks(range(len(effects)), [effect.name for effect in effects])
    axes.axvline(FRACTION, color=RED, ls="--", lw=1.2)
    axes.grid(axis="y", visible=False)


def draw_ways(axes: Axes, found: Sequence[Found]) -> None:
    for n, one in enumerate(found):
        time = [1e3 * way.seconds for way in one.ways]
        error = [float(way.error[0] / one.ways[0].error[0]) for way in one.ways]
        axes.plot(time, error, ls=LINES[n], color=CYCLE[n], lw=1, label=one.view.name)
        for t, e, mark in zip(time, error, "so^", strict=False):
            axes.plot(t, e, mark, color=CYCLE[n], ms=6)
    axes.set(
        xscale="log",
        xlabel="CPU time of a trial (ms)",
        ylabel="error over error with everything (1)",
        title="square: everything; circle: what is needed; triangle: in windows",
    )
    axes.margins(0.15, 0.2)
    legend_below(axes, 3)


if __name__ == "__main__":
    command.run(main)
