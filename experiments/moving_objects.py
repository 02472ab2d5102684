"""Formulas of moving objects compared with trials, over designs that stress them, and a picture of
a detection.

python experiments/moving_objects.py --figure moving-objects.png prints, for AsteroidFinder and for
designs that stress the formulas, the flux at which 50 % and 90 % of the objects are found and the
median error of a place, each by trials over the value by formula; and, for AsteroidFinder, the
limiting magnitudes with their 95 % intervals.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import command
import numpy as np

from startrack import plots
from startrack.core import deg
from startrack.moving import MovingProblem, added_images, field_of, load_moving_design, score_maps

TRIALS = 180  # with which a median place scatters by 6 %
STRESSED: dict[str, dict[str, float]] = {
    "as designed": {},
    "f/5": {"instrument.optics.f_number": 5.0},
    "long focal length": {"instrument.optics.focal_length": 1.2},
    "eight images": {"moving_object.images": 8.0},
    "little gain": {"instrument.detector.em_gain": 4.0},
    "frames of 1 s": {"instrument.detector.exposure": 1.0, "moving_object.frames": 10.0},
    "fast": {
        "moving_object.rate": 4 * deg / 86400,
        "moving_object.fastest": 6 * deg / 86400,
        "moving_object.interval": 60.0,
    },
}


def main() -> None:
    """Print and save the ratios, and draw an object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=TRIALS, help="trials of each design")
    parser.add_argument("--figure", type=Path, help="file for the picture of an object")
    options = command.read(parser, trials=4)
    figures = compare(options.trials, STRESSED)
    worst = max(
        max(ratio, 1 / ratio)
        for design in figures["designs"].values()
        for name, ratio in design.items()
        if name != "place"
    )
    print(f"worst ratio of a limit: {worst:.3f}")
    if options.figure:
        draw(options.figure)
    command.save(options, figures | {"formula_over_trials": worst})


def compare(
    trials: int, designs: dict[str, dict[str, float]]
) -> dict[str, dict[str, dict[str, float]]]:
    """Trials over formula for each design, and limiting magnitudes of the first design."""
    design = load_moving_design("asteroidfinder")
    start = MovingProblem(replace(design, campaign=replace(design.campaign, links=())))
    ratios, limits = dict[str, dict[str, float]](), dict[str, dict[str, float]]()
    for name, values in designs.items():
        problem = start.replaced(values)
        judged, expected = problem.judge(problem.trials(1, range(trials))), problem.expect()
        ratios[name] = {
            part: judged.parts[part].value / expected.parts[part]
            for part in ("limit 50", "limit 90", "place")
        }
        print(name, {part: round(ratio, 3) for part, ratio in ratios[name].items()}, flush=True)
        if not values:
            for part in ("limit 50 V", "limit 90 V"):
                own = judged.parts[part]
                ends = {"trials": own.value, "low": own.low, "high": own.high}
                limits[part] = ends | {"formula": expected.parts[part]}
                print(part, limits[part], flush=True)
    return {"designs": ratios, "limits": limits}


@plots.styled
def draw(path: Path) -> None:
    """One image of a field, and the sum of the matched filters along the true motion."""
    design = load_moving_design("asteroidfinder")
    field = field_of(design, 3, 4)
    flux = 1.3 * MovingProblem(design).expect().value
    images = added_images(design, field, flux)
    maps = score_maps(design, images, field.angle)
    total = np.zeros(maps.signal.shape[1:])
    weight = np.zeros_like(total)
    for k, time in enumerate(design.moving_object.times):
        shift = np.rint(2 * (field.speed * time + field.rest[k].mean(0))).astype(int)
        total += np.roll(maps.signal[k], -shift[::-1], (0, 1))
        weight += np.roll(maps.weight[k], -shift[::-1], (0, 1))
    score = total / np.sqrt(weight)
    figure = plots.picture(4.2, f"an object of {flux:.0f} uJy (half of {flux / 1.3:.0f} are found)")
    left, right = figure.subplots(1, 2)
    middle = np.median(images[0])
    spread = 1.5 * float(np.median(np.abs(images[0] - middle)))
    left.imshow(images[0], vmin=middle - 3 * spread, vmax=middle + 8 * spread, cmap="gray")
    plots.panel_title(left, "one image: 50 frames")
    shown = right.imshow(score, vmin=-4, vmax=math.ceil(float(score.max())), cmap="gray")
    plots.panel_title(right, "all images along the motion (sigma)")
    centre = (images.shape[1] - 1) / 2
    for axes, scale, place in (
        (
            left,
            1.0,
            field.place + field.speed * design.moving_object.times[0] + field.rest[0].mean(0),
        ),
        (right, 2.0, field.place),
    ):
        x, y = scale * (centre + place)
        axes.plot(x, y, "o", ms=18, mfc="none", mec=plots.ORANGE, mew=1.5)
        axes.set(xlabel="column", ylabel="row")
        axes.grid(visible=False)
    figure.colorbar(shown, ax=right, shrink=0.7)
    plots.save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
