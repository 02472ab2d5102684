"""How exactly do products restore the radiance and the positions of their scene?

python experiments/earth_loop.py renders, calibrates and maps two scenes. `loop_radiance_error` is
the relative error of the mean radiance of uniform ground, by an image, dark frames and flat frames
with the detector's noise. Beside it stands the standard deviation over that which the noise
predicts. `loop_place_px` is the rms distance, in pixels, between fires at known coordinates on
mountains of 1,000 m and their centroids on the map, seen 15 degrees from nadir. It contains the
errors of geometry, lens, noise, terrain, projection and resampling.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import command
import numpy as np
from numpy.typing import NDArray

from startrack import deg, shipped, um
from startrack.core import Curve
from startrack.detector import Scan
from startrack.earth.geometry import observe_earth
from startrack.earth.imager import (
    Channel,
    Cover,
    HotSpot,
    Imager,
    Land,
    Picture,
    Setting,
    Survey,
    load_survey,
    render,
)
from startrack.earth.product import Product, ProductSettings, against_truth, calibrate, make_product

Floats = NDArray[np.float64]
SIZE, FIRES = 120, 6  # pixel, and fires along each side
RELIEF, ROLL = 1000.0, 15 * deg
AREA = 0.05  # of a pixel that burns
AROUND = 4  # cells on each side of a fire that make its centroid


def main() -> None:
    """Print and save the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=SIZE, help="side of the image, pixel")
    parser.add_argument("--fires", type=int, default=FIRES, help="fires along a side")
    options = command.read(parser, size=40, fires=2)
    radiance, noise = loop_radiance_error(options.size)
    place = loop_place_px(options.size, options.fires)
    figures = {"loop_radiance_error": radiance, "loop_noise_ratio": noise, "loop_place_px": place}
    print(f"loop_radiance_error {100 * radiance:.3f} %, scatter {noise:.3f} of the predicted one")
    print(f"loop_place_px {place:.3f} pixel rms over {RELIEF:g} m of relief")
    command.save(options, figures)


def loop_radiance_error(size: int = SIZE, seed: int = 1) -> tuple[float, float]:
    """Relative error of the mean radiance of uniform ground, and its scatter over the predicted
    one."""
    survey = _survey("waoss", size, relief=1e-3)
    detector = replace(survey.camera.channels[1].detector, bits=12, prnu=0.01)
    channel = replace(survey.camera.channels[1], detector=detector)
    survey = replace(survey, camera=Imager((channel,)), land=Land())
    product, picture, channel, setting = make(survey, seed)
    truth = _truth(picture)
    error = against_truth(product, truth)[0]
    electrons = setting.electrons * truth / um
    dark = detector.dark_rate * setting.exposure
    step = detector.full_well / (2**detector.bits - 1)
    variance = electrons + dark + detector.read_noise**2 + step**2 / 12
    scatter = (product.image["radiance"] - truth) / truth * electrons / np.sqrt(variance)
    return abs(error), float(scatter.std())


def loop_place_px(size: int = SIZE, fires: int = FIRES, seed: int = 1) -> float:
    """Rms distance in pixels between fires and their centroids on the map."""
    survey = _survey("hsrs", size, RELIEF)
    warm = survey.camera.channels[0]
    warm = replace(warm, detector=replace(warm.detector, scan=Scan(), full_well=2e7))
    survey = replace(
        survey,
        camera=Imager((warm,)),
        pointing=replace(survey.pointing, roll=ROLL),
        land=Land((Cover(Curve((), (0.02,)), 290.0),), lapse=0.0),
    )
    cold, _, channel, _ = make(survey, seed)
    pixel = float(np.hypot(cold.grid.step_x, cold.grid.step_y)) / math.sqrt(2)
    spots = _spots(survey, channel, fires, AREA * pixel**2)
    hot, *_ = make(replace(survey, land=replace(survey.land, hot_spots=spots)), seed)
    excess = hot.layers["radiance"] - cold.layers["radiance"]
    x, y = np.array([_on_map(hot, each) for each in spots]).T
    found = np.array([_centroid(excess, *each) for each in zip(x, y, strict=True)])
    return float(np.sqrt(((found - np.stack([x, y], 1)) ** 2).sum(1).mean()))


def make(survey: Survey, seed: int) -> tuple[Product, Picture, Channel, Setting]:
    """The product of the first channel, its picture, the channel and its constant values."""
    channel = survey.channels[0]
    picture = Picture.blank(channel.detector.rows, channel.columns)
    setting = render(survey, channel, Path(), seed, picture)
    frames = calibrate(survey, channel, setting, seed)
    product = make_product(survey, channel, Path(), picture.numbers, frames, ProductSettings())
    return product, picture, channel, setting


def _survey(name: str, size: int, relief: float) -> Survey:
    survey = load_survey(shipped(f"scenes/{name}.toml"))
    fractal = survey.terrain.fractal
    assert fractal
    cells = 512 if size > 60 else 256
    terrain = replace(survey.terrain, fractal=replace(fractal, cells=cells, relief=relief))
    return replace(survey, lines=size, columns=size, sky_rays=0, terrain=terrain)


def _spots(survey: Survey, channel: Channel, fires: int, area: float) -> tuple[HotSpot, ...]:
    """Fires on a lattice of pixels, away from the edges and off the pixels' centres."""
    (strip,) = observe_earth(replace(survey, rays=1).scene(channel), Path())
    lines, columns, _ = strip.shape
    places = np.stack([strip.ground.longitude, strip.ground.latitude], -1)
    places = places.reshape(lines, columns, 2)
    rng = np.random.default_rng(1)
    out = []
    for line in np.linspace(10, lines - 11, fires).astype(int):
        for column in np.linspace(10, columns - 11, fires).astype(int):
            aside = rng.uniform(0, 1, 2)
            one = places[line, column]
            across, along = places[line, column + 1] - one, places[line + 1, column] - one
            longitude, latitude = one + aside[0] * across + aside[1] * along
            out.append(HotSpot(float(longitude), float(latitude), area, 900.0))
    return tuple(out)


def _on_map(product: Product, spot: HotSpot) -> tuple[float, float]:
    """Column and row of a fire by PROJ."""
    from rasterio import warp

    grid = product.grid
    x, y = warp.transform("EPSG:4326", grid.system, [spot.longitude / deg], [spot.latitude / deg])
    return (x[0] - grid.west) / grid.step_x - 0.5, (grid.north - y[0]) / grid.step_y - 0.5


def _centroid(excess: Floats, x: float, y: float) -> tuple[float, float]:
    column, row = round(x), round(y)
    part = excess[row - AROUND : row + AROUND + 1, column - AROUND : column + AROUND + 1]
    part = np.where(part > 0.02 * np.nanmax(part), part, 0.0)
    j, i = np.indices(part.shape) - AROUND
    return column + float((part * i).sum() / part.sum()), row + float((part * j).sum() / part.sum())


def _truth(picture: Picture) -> Floats:
    return np.sum([np.asarray(each, float) for each in picture.terms], 0)


if __name__ == "__main__":
    command.run(main)
