"""A line camera over mountains with all effects, and changes that leave out each effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from leaving_out import Change, Floats, View

from startrack import shipped
from startrack.detector import Defects, Pattern
from startrack.earth.imager import Channel, Picture, Survey, load_survey, render

SIZE, CELLS = 48, 256  # pixels of the image and cells of the terrain along a side


class Flight(NamedTuple):
    """A survey, and one channel of its camera."""

    survey: Survey
    channel: Channel


def view() -> View:
    """The stereo scanner's nadir line, in 12 bits."""
    survey = load_survey(shipped("scenes/waoss.toml"))
    fractal = survey.terrain.fractal
    assert fractal
    terrain = replace(survey.terrain, fractal=replace(fractal, cells=CELLS))
    survey = replace(survey, lines=SIZE, columns=SIZE, sky_rays=8, rays=3, terrain=terrain)
    nadir = next(channel for channel in survey.channels if channel.forwards == 0)
    full = with_detector(
        Flight(survey, nadir),
        bits=12,
        prnu=0.01,
        dark_current=2e4,
        defects=Defects(dsnu=1e4, hot=1e-3, hot_current=1e6),
        nonlinearity=0.01,
        adc_inl=1.0,
        pattern=Pattern(row=10.0, column=10.0, column_offset=20.0),
        settling=1e-3,
    )
    return View(
        "Earth imager",
        f"the stereo scanner WAOSS looks down on mountains from 300 km; a trial is an image of "
        f"{SIZE} x {SIZE} pixels of other mountains",
        full,
        EFFECTS,
        numbers,
        noise,
        ("numbers / DN",),
    )


def numbers(flight: Flight, number: int, seed: int = 0) -> Floats:
    """Digital numbers (p, 1) of the pixels of an image; the seed is for the noise."""
    survey, channel = flight
    picture = Picture.blank(channel.detector.rows, channel.columns)
    render(of_mountains(survey, number + 1), channel, Path(), seed, picture)
    return picture.numbers.reshape(-1, 1).astype(float)


def of_mountains(survey: Survey, seed: int) -> Survey:
    """The flight over another part of the Earth."""
    fractal = survey.terrain.fractal
    assert fractal
    terrain = replace(survey.terrain, fractal=replace(fractal, seed=seed))
    return replace(survey, terrain=terrain, land=replace(survey.land, texture_seed=seed))


def noise(flight: Flight, trials: Sequence[int], values: Floats) -> Floats:
    """Rms (1,) of the changes, digital number, when only the noise is drawn again."""
    other = np.array([numbers(flight, number, seed=1) for number in trials])
    return np.sqrt(((values - other) ** 2).mean((0, 1)) / 2)


def with_detector(flight: Flight, **changes: Any) -> Flight:
    detector = replace(flight.channel.detector, **changes)
    return flight._replace(channel=replace(flight.channel, detector=detector))


def with_survey(flight: Flight, **changes: Any) -> Flight:
    return flight._replace(survey=replace(flight.survey, **changes))


def with_optics(flight: Flight, **changes: Any) -> Flight:
    optics = replace(flight.channel.optics, **changes)
    return flight._replace(channel=replace(flight.channel, optics=optics))


def without_relief(flight: Flight) -> Flight:
    """Flat ground at the height of the sea."""
    terrain = flight.survey.terrain
    assert terrain.fractal
    flat = replace(terrain.fractal, relief=1e-3)
    return with_survey(flight, terrain=replace(terrain, fractal=flat))


def without_texture(flight: Flight) -> Flight:
    return with_survey(flight, land=replace(flight.survey.land, texture=0.0))


def detector(**changes: Any) -> Callable[[Flight], Flight]:
    return lambda flight: with_detector(flight, **changes)


EFFECTS: dict[str, Change] = {
    "relief (flat ground instead)": without_relief,
    "texture of the ground": without_texture,
    "air": lambda flight: with_survey(flight, air=None),
    "light from the surroundings": lambda flight: with_survey(flight, surroundings=0.0),
    "sky that a slope sees": lambda flight: with_survey(flight, sky_rays=0),
    "9 rays a pixel (4 instead)": lambda flight: with_survey(flight, rays=2),
    "Airy (a Gaussian instead)": lambda flight: with_optics(flight, psf="gaussian"),
    "blur of the lens": lambda flight: with_optics(flight, blur=0.0),
    "PRNU": detector(prnu=0.0),
    "dark current": detector(dark_current=0.0),
    "DSNU and hot pixels": detector(defects=None),
    "non-linearity": detector(nonlinearity=0.0, adc_inl=0.0),
    "row and column noise": detector(pattern=None),
    "settling of the read-out": detector(settling=0.0),
    "read noise": detector(read_noise=0.0),
}
