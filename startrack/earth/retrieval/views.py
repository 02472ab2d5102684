"""A trial of a retrieval -> its images, the truth and the result beside each other, and words."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import Floats, Ints, um
from startrack.earth.retrieval import fire, hot_spots, land_cover, minerals, stereo, waves
from startrack.earth.retrieval.context import threshold_of
from startrack.earth.retrieval.study import EarthDesign
from startrack.problem import TrialImage, TrialView

RADIANCE = "W / m2 / sr / um"


def _radiance(name: str, values: Floats, scale: str = "") -> TrialImage:
    return TrialImage(name, RADIANCE, values * um, scale=scale)


def view_fires(
    design: EarthDesign, own: hot_spots.HotSpots, seed: int, number: int, trial: int
) -> TrialView:
    """Both channels with the fires whose power is measured, and the score of each pixel."""
    views = hot_spots.views_of(design, own)
    image = hot_spots.image_of(design, own, views, seed, number)
    seen = hot_spots.observed_fires(views, image, own)
    limit = threshold_of(own.false_alarms, own.window, own.guard)
    found = hot_spots.highest_near(seen.score, image, views) > limit
    hot = seen.score > limit
    near = hot_spots.pixels_of_fire(views.mid)
    for x, y in image.pixel:
        hot[y - near : y + near + 1, x - near : x + near + 1] = False
    inner = slice(own.window, -own.window)
    false = np.argwhere(hot[inner, inner])[:, ::-1] + own.window
    places = image.pixel + image.inside
    marks = {
        "fire found": places[found],
        "fire missed": places[~found],
        "false alarm": false.astype(float),
        "fire of this trial": places[trial : trial + 1],
    }
    power = hot_spots.measured_power(views, image, own, seen).power[trial]
    true = fire.radiated_power(own.temperature, own.area)
    text = (
        f"{found.sum()} of {len(found)} fires of {own.area:g} m2 at {own.temperature:g} K are "
        f"found; pixels with a score above {limit:.2f} are hot. Power of this trial's fire: "
        f"{true / 1e6:.4g} MW, retrieved {power / 1e6:.4g} MW"
    )
    names = views.mid.channel.name, views.thermal.channel.name
    layers = [
        *(
            _radiance(name, layer)
            for name, layer in zip(names, (seen.mid, seen.thermal), strict=True)
        ),
        TrialImage("score", "", seen.score.astype(float)),
    ]
    return TrialView(tuple(layer._replace(marks=marks) for layer in layers), text)


def view_land(
    design: EarthDesign, own: land_cover.LandCover, seed: int, number: int, trial: int
) -> TrialView:
    """Reflectance in each channel, and truth and result of the index and the classes."""
    image, shape = land_cover.observe_land(design, own, seed, number), (own.size, own.size)
    cover = land_cover.classify_land(design, own, image.measured)
    index = [land_cover.index_of(own, part) for part in (image.truth, image.measured)]
    names = tuple(f"cover {n + 1}" for n in range(len(design.land.covers)))
    wrong = cover != image.cover
    layers = [
        TrialImage(f"{name}, {kind}", "reflectance", values.reshape(shape), scale=name)
        for name, *pair in zip(own.channels, image.truth, image.measured, strict=True)
        for kind, values in zip(("true", "measured"), pair, strict=True)
    ]
    layers += [
        TrialImage(f"index, {kind}", "", values.reshape(shape), scale="index")
        for kind, values in zip(("true", "measured"), index, strict=True)
    ]
    layers += [
        TrialImage(f"class, {kind}", "", values.reshape(shape).astype(float), classes=names)
        for kind, values in (("true", image.cover), ("retrieved", cover))
    ]
    result = wrong.reshape(shape).astype(float)
    layers.append(TrialImage("class", "", result, classes=("right", "wrong")))
    error = math.sqrt(float(((image.measured - image.truth) ** 2).mean()))
    text = f"error of reflectance {error:.4g} rms, {100 * wrong.mean():.3g} % of the pixels wrong"
    return TrialView(tuple(layers), text)


def view_terrain(
    design: EarthDesign, own: stereo.Stereo, seed: int, number: int, trial: int
) -> TrialView:
    """Both images, and the true and the retrieved heights."""
    images = stereo.observe_terrain(design, own, seed, number)
    found = stereo.match_heights(design, own, images)
    height = np.where(found.matched, found.height, np.nan)
    error = height - images.height
    rms = math.sqrt(float((error[found.matched] ** 2).mean())) if found.matched.any() else math.nan
    matched = found.matched.sum() / max(int(found.inside.sum()), 1)
    layers = (
        *(
            _radiance(name, layer)
            for name, layer in zip(own.channels, (images.first, images.second), strict=True)
        ),
        TrialImage("height, true", "m", images.height, scale="height"),
        TrialImage("height, retrieved", "m", height, scale="height"),
        TrialImage("error of height", "m", error),
    )
    text = f"error of heights {rms:.4g} m rms; {100 * matched:.3g} % of the pixels are matched"
    return TrialView(layers, text)


def view_sea(
    design: EarthDesign, own: waves.Waves, seed: int, number: int, trial: int
) -> TrialView:
    """The glint; height and direction of its waves in words."""
    image = waves.observe_waves(design, own, seed, number)
    found = waves.retrieve_waves(design, own, image.radiance)
    half = math.remainder(found.direction - image.direction, math.pi)
    true = math.degrees(image.direction)
    text = (
        f"significant height {image.height:.4g} m, retrieved {found.height:.4g} m; direction "
        f"{true:.1f} deg, retrieved {true + math.degrees(half):.1f} deg"
    )
    return TrialView((_radiance(own.channel, image.radiance),), text)


def view_spectra(
    design: EarthDesign, own: minerals.Minerals, seed: int, number: int, trial: int
) -> TrialView:
    """Spectra, a line each: radiance, true and retrieved emissivity; and the class of each."""
    spectra = minerals.observe_minerals(design, own, seed, number)
    found = minerals.identify_minerals(design, own, spectra.radiance)
    names = tuple(mineral.name for mineral in minerals.library())
    columns = math.ceil(math.sqrt(own.pixels))

    def square(values: Ints) -> Floats:
        cells = np.full(columns * math.ceil(own.pixels / columns), np.nan)
        cells[: own.pixels] = values
        return cells.reshape(-1, columns)

    here = {"spectrum of this trial": np.array([[0.0, trial]])}
    cell = {"spectrum of this trial": np.array([[trial % columns, trial // columns]], float)}
    layers = (
        _radiance("spectra", spectra.radiance)._replace(marks=here),
        TrialImage("emissivity, true", "", spectra.emissivity, here, scale="emissivity"),
        TrialImage("emissivity, retrieved", "", found.emissivity, here, scale="emissivity"),
        TrialImage("class, true", "", square(spectra.mineral), cell, names),
        TrialImage("class, retrieved", "", square(found.mineral), cell, names),
    )
    wrong = int((found.mineral != spectra.mineral).sum())
    text = (
        f"lines are spectra, columns wavelengths from {own.first / um:g} to {own.last / um:g} um; "
        f"{wrong} of {own.pixels} spectra are wrong. This trial: {names[spectra.mineral[trial]]} "
        f"at {spectra.temperature[trial]:.1f} K, retrieved {names[found.mineral[trial]]} at "
        f"{found.temperature[trial]:.1f} K"
    )
    return TrialView(layers, text)
