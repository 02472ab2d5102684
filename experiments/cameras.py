"""What images do the cameras of Krutz et al. (2011) take of synthetic terrain, and of stars?

Renders WAOSS, HSRS, MERTIS and ADS40 over their scenes, and AsteroidFinder on the sky, in digital
numbers: one picture per camera.

    python experiments/cameras.py [--json FILE] [--figure DIR] [--quick]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import numpy as np
import one_thread  # noqa: F401
from numpy.typing import NDArray

from startrack import Streams, load_design, observe, pointing, shipped
from startrack.earth.imager import Picture, load_survey, render
from startrack.plots import colour_bar, save_picture, styled
from startrack.plots import picture as blank

SCENES = ("waoss", "hsrs", "mertis", "ads40")
PRAESEPE = (130.1, 19.67)  # right ascension and declination, degree: an open cluster


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--figure", type=Path, help="folder for the pictures")
    chosen = command.read(parser)
    figures: dict[str, Any] = {}
    for name in SCENES[2:3] if chosen.quick else SCENES:
        images = {}
        path = shipped(f"scenes/{name}.toml")
        survey = load_survey(path)
        for channel in survey.channels[:1] if chosen.quick else survey.channels:
            start = time.process_time()
            picture = Picture.blank(channel.detector.rows, channel.columns)
            render(survey, channel, path.parent, 1, picture)
            images[channel.name] = picture.numbers
            figures[f"{name}_{channel.name}"] = told(channel.detector.bits, picture, start)
        show(chosen.figure, name, images)
    case = load_design(shipped("cameras/asteroidfinder.toml")).case
    if chosen.quick:
        part = replace(case.instrument.detector, columns=256, rows=256)
        case = replace(case, instrument=replace(case.instrument, detector=part))
    record = observe(case, pointing(*PRAESEPE, 0.0), Streams(1, 0))
    figures["asteroidfinder"] = {
        "stars": len(record.stars),
        "spots": record.outcome.spots,
        "matches": record.outcome.stars,
        "status": str(record.estimate.status),
    }
    show(chosen.figure, "asteroidfinder", {"one of four EMCCDs": record.frame.image})
    for name, value in figures.items():
        print(f"{name:20} {value}")
    command.save(chosen, figures)


def told(bits: int, picture: Picture, start: float) -> dict[str, float]:
    return {
        "number_median": float(np.median(picture.numbers)),
        "number_max": float(picture.numbers.max()),
        "saturated": float((picture.numbers == 2**bits - 1).mean()),
        "cpu_s": round(time.process_time() - start, 2),
    }


@styled
def show(folder: Path | None, name: str, images: dict[str, NDArray[Any]]) -> None:
    """All channels side by side, each stretched over 1 to 99.5 %."""
    if folder is None:
        return
    across = min(len(images), 2)
    down = -(-len(images) // across)
    figure = blank(0.4 + 8.0 / across * down, name)
    axes = figure.subplots(down, across, squeeze=False)
    for each in axes.ravel()[len(images) :]:
        each.axis("off")
    for each, (title, numbers) in zip(axes.ravel(), images.items(), strict=False):
        low, high = np.percentile(numbers, (1, 99.5))
        shown = each.imshow(numbers, cmap="gray", vmin=low, vmax=max(high, low + 1))
        each.set(title=title, xlabel="column (pixel)", ylabel="line (pixel)")
        each.grid(visible=False)
        colour_bar(
            shown, each, numbers, "image (digital number)", orientation="horizontal", aspect=22
        )
    save_picture(folder / f"{name}.png", figure)


if __name__ == "__main__":
    command.run(main)
