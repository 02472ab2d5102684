"""Earth images against simulated photons, stated errors, a real image, and rays by Embree.

    python experiments/earth_images.py [--landsat FOLDER] [--json FILE] [--picture FILE] [--quick]

adjacency_error    largest relative error of the radiance at a satellite, around a coast and a
                   bright patch of 1 km, beside Monte Carlo photons in three dimensions
                   (`tests/oracle/adjacency.py`), with rays at three spacings
adjacency_of_mean  the same where the surroundings are replaced by their mean
adjacency_cost     CPU time of an image with the light of its surroundings over one with their mean,
                   alternately
within_one_sigma, within_two_sigma  fraction of the pixels of trials (`earth_trials.py`), of the
                   layer that is farthest from 68 and 95 %
real_*             of a Landsat 7 image (`earth_real.py`), with `--landsat`
embree_gain        CPU time of Embree over that of startrack's rays: the lower of nadir over 1,000 x
                   1,000 cells and shadows at 10 degrees
lines_earth        number of lines of `startrack/earth`
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import command
import earth_real
import earth_trials
import numpy as np
import one_thread  # noqa: F401
import terrain
from numpy.typing import NDArray

from startrack import deg, nm
from startrack.core import Curve
from startrack.detector import Detector, Scan
from startrack.earth.atmosphere import Air
from startrack.earth.geometry import Fractal, Orbit, Terrain, fly
from startrack.earth.imager import (
    Channel,
    Cover,
    Imager,
    Land,
    Picture,
    Setting,
    Survey,
    around_of,
    band_of,
    render,
    surrounded,
    terms_in_band,
)
from startrack.earth.terrain import EQUATORIAL, Ground, Rays, cartesian, geodetic, survey, up
from startrack.optics import Optics
from startrack.plots import BLUE, GREY, RED, picture, save_picture, styled

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
ORACLE = ROOT / "tests/oracle/adjacency.json"
SPACINGS = 15.0, 12.0, 20.0  # metre between rays; 15: pixels of 30 m with 2 x 2 rays
COAST = Fractal(0.0, 0.0, 200.0, 64, 1e-3)  # flat
MEANS = {"coast": 0.16, "patch": 0.1}
SUN = 40 * deg  # from the zenith
TRIALS, SIZE, RAYS = 300, 512, 500


class Shining(NamedTuple):
    """Radiance (n,) at a satellite over the radiance by photons, of ground at (n,) metre from a
    coast."""

    place: Floats
    ours: Floats
    plain: Floats


def main() -> None:
    """Print and save the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--landsat", type=Path, help="folder with nov4.rda and dem.rda")
    parser.add_argument("--trials", type=int, default=TRIALS, help="trials of the uncertainties")
    parser.add_argument(
        "--size", type=int, default=SIZE, help="side of the image whose cost is measured, pixel"
    )
    parser.add_argument(
        "--rays", type=int, default=RAYS, help="rays along a side of the comparison with Embree"
    )
    parser.add_argument("--picture", type=Path, help="file for the picture of coast and patch")
    options = command.read(parser, trials=2, size=48, rays=20)
    found = {
        (column["wavelength"], column["visibility"], case, spacing): shining(column, case, spacing)
        for column in columns()
        for case in MEANS
        for spacing in SPACINGS
    }
    shares = earth_trials.shares(options.trials)
    warm = earth_trials.shares(options.trials, thermal=True)
    shares |= {f"{layer} of a thermal channel": found for layer, found in warm.items()}
    figures: dict[str, Any] = {
        "adjacency_error": max(abs(each.ours - 1).max() for each in found.values()),
        "adjacency_of_mean": max(abs(each.plain - 1).max() for each in found.values()),
        "adjacency_cost": cost(options.size),
        "within_one_sigma": max((one for one, _ in shares.values()), key=lambda x: abs(x - 0.68)),
        "within_two_sigma": max((two for _, two in shares.values()), key=lambda x: abs(x - 0.95)),
        "within": shares,
        "lines_earth": sum(
            len(path.read_text().splitlines()) for path in (ROOT / "startrack/earth").rglob("*.py")
        ),
    }
    if options.landsat and not command.missing("the real image is", "rdata"):
        real = earth_real.compare(options.landsat)
        del real["images"]
        figures |= real | {"real_predicted": earth_real.PREDICTED}
    rays = terrain.speed(1024, "1k", True, options.rays)
    if "nadir_over_embree_1k" in rays:
        shadow = rays["shadow_over_embree_1k_of_elevation"][10]
        figures["embree_gain"] = min(rays["nadir_over_embree_1k"], shadow)
    for name, value in figures.items():
        print(f"{name} {value:.4g}" if isinstance(value, int | float) else f"{name} {value}")
    if options.picture:
        draw(found, options.picture)
    command.save(options, figures)


def columns() -> list[dict[str, Any]]:
    """Results of photons, at two wavelengths and two visibilities."""
    told: list[dict[str, Any]] = json.loads(ORACLE.read_text())["columns"]
    return told


def reflectance(case: str, x: Floats, y: Floats) -> Floats:
    """Reflectance of the ground, at (n,) metre east and north, as the photons meet it."""
    if case == "coast":
        return np.where(x < 0, 0.02, 0.30)
    return np.where(np.maximum(abs(x), abs(y)) < 500, 0.8, 0.1)


def shining(column: dict[str, Any], case: str, spacing: float) -> Shining:
    """The radiance of one case in one air, with its surroundings and with their mean.

    spacing  metre between rays
    """
    wavelength = column["wavelength"] * nm
    edges = np.array([-1.5, -1.0, 1.0, 1.5]) * nm + wavelength
    channel = Channel("one", Optics(0.1, 4.0), _detector(40), Curve(tuple(edges), (0, 1, 1, 0)))
    band = band_of(channel, Air(visibility=column["visibility"]), 700e3, 1.0)
    theirs = column["collected"][case]
    x = np.array(theirs["place"], float)
    ground, mean = nadir(x, np.zeros(len(x))), MEANS[case]
    rho = reflectance(case, x, np.zeros(len(x)))
    corners = nadir(np.array([-6e3, 6e3, 0.0]), np.array([-6e3, 6e3, 0.0]))
    around = surrounded(
        [corners],
        spacing,
        mean,
        band,
        lambda *place: reflectance(case, *(angle * EQUATORIAL for angle in place)),
    )
    unused: Any = None
    setting = Setting(0, 1, 0, unused, band, mean, 1, unused, environment=around)
    extinction = np.array(column["molecules"]) + np.array(column["aerosol"])
    direct = math.exp(-np.trapezoid(extinction, column["height"]))
    black = terms_in_band(ground, band, np.zeros(1), 0.0).total
    white = terms_in_band(ground, band, np.ones(1), 0.0)
    truth = black + (white.direct + white.indirect) / direct * np.array(theirs["mean"])
    ours = terms_in_band(ground, band, rho, around_of(setting, ground)).total
    return Shining(x, ours / truth, terms_in_band(ground, band, rho, mean).total / truth)


def nadir(x: Floats, y: Floats) -> Ground:
    """Flat ground at the equator and Greenwich, seen from above."""
    longitude, latitude = x / EQUATORIAL, y / EQUATORIAL
    above = cartesian(longitude, latitude, np.full(len(x), 20e3))
    rays = Rays(above, -up(longitude, latitude), np.full(len(x), 1e-3))
    flat = Terrain(fractal=COAST, highest=100.0, lowest=-10.0)
    return survey(flat.open(Path()), rays, np.array([math.cos(SUN), math.sin(SUN), 0.0]))


def cost(size: int, turns: int = 5) -> float:
    """CPU time of an image of mountains from an orbit over the time with mean surroundings."""
    channel = Channel(
        "blue",
        Optics(0.25, 4.0, blur=3e-6),
        _detector(size),
        Curve((449 * nm, 450 * nm, 500 * nm, 501 * nm), (0, 1, 1, 0)),
    )
    orbit = Orbit("2026-06-21T10:00:00", 700e3, 98 * deg, 140 * deg, 47 * deg)
    longitude, latitude, _ = (float(one[0]) for one in geodetic(fly(orbit, np.zeros(1)).position))
    hills = Terrain(fractal=Fractal(longitude, latitude, 30.0, 2048, 1500.0), highest=1600.0)
    land = Land((Cover(Curve((), (0.05,))), Cover(Curve((), (0.35,)), above=700.0)), texture=0.1)
    full = Survey(Imager((channel,)), hills, orbit=orbit, land=land, air=Air())
    ratios = []
    for turn in range(turns + 1):
        spent = []
        for one in (full, replace(full, surroundings=0.2)):
            picture = Picture.blank(size, size)
            start = time.process_time()
            render(one, channel, Path(), 1, picture)
            spent.append(time.process_time() - start)
        if turn:  # the first compiles
            ratios.append(spent[0] / spent[1])
    return float(np.median(ratios))


def _detector(size: int) -> Detector:
    return Detector(
        size, size, 10e-6, 1e-3, Curve((), (0.5,)), full_well=1e6, pixel_rate=1e9, scan=Scan()
    )


@styled
def draw(found: dict[tuple[float, float, str, float], Shining], path: Path) -> None:
    """Draw the radiance over the photons' radiance, with the surroundings and with their mean."""
    figure = picture(3.4, "Radiance at a satellite beside photons in three dimensions")
    axes = figure.subplots(1, 2, sharey=True)
    for ax, case in zip(axes, MEANS, strict=True):
        for (wavelength, visibility, kind, spacing), one in found.items():
            if (visibility, kind, spacing) == (23e3, case, SPACINGS[0]):
                style, band = {470: "o", 865: "s"}[int(wavelength)], f"{wavelength:g} nm"
                ax.plot(one.place / 1e3, one.plain, style, color=RED, label=f"{band}, mean")
                ax.plot(one.place / 1e3, one.ours, style, color=BLUE, label=f"{band}, as it is")
        ax.axhspan(0.99, 1.01, color=GREY, alpha=0.3)
        ax.set(xlabel="from the coast (km)" if case == "coast" else "from the middle (km)")
        ax.set_title(f"{case}, surroundings:", fontsize=9)
    axes[0].set_ylabel("radiance / that of photons")
    axes[1].legend()
    save_picture(path, figure)


if __name__ == "__main__":
    command.run(main)
