"""Four scenes of a star tracker with all effects, and changes that leave out each effect."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from backgrounds import BAFFLE, around
from leaving_out import Change, Floats, View, rms
from scipy.spatial.transform import Rotation

from startrack import (
    Case,
    Fidelity,
    Streams,
    arcsec,
    deg,
    load_design,
    nm,
    random_attitude,
    run_trial,
    shipped,
    um,
)
from startrack.detector import Defects, Hits, Pattern
from startrack.motion import Broadband, Tone
from startrack.optics import Aberration
from startrack.scene import ObserverOrbit, Scene, SkyObserver, observer_of
from startrack.space import EARTH_RADIUS

SEED = 11
FAR = 30 * deg  # from the edges of all bodies, in a dark field
ATTITUDES = 1000  # attitudes that a trial may draw until a field is dark

# By night over the equator: the Sun is behind the Earth, the Moon 35 degrees off the zenith.
NIGHT = Scene(
    lights=("zodiacal", "starlight", "planets", "sun", "moon", "earth", "airglow", "cities"),
    date="2026-04-28T12:00:00",
    orbit=ObserverOrbit(600e3, phase=215 * deg),
)


def views() -> Iterator[View]:
    """The scenes, one after the other."""
    case = everything(load_design(shipped("designs/noise_only.toml")).case)
    observer = observer_of(NIGHT, None)
    down = observer.earth / np.linalg.norm(observer.earth)
    horizon = math.asin(EARTH_RADIUS / float(np.linalg.norm(observer.earth)))
    moon = observer.see("moon").direction
    half = case.instrument.camera.fov_y / 2
    dark = partial(dark_field, observer, down, horizon)
    yield view(
        "in the dark", f"all bodies at least {FAR / deg:.0f} degrees off the field", case, dark
    )
    yield view(
        "slewing",
        "the dark field at 0.5 degrees per second",
        with_motion(case, rate_x=0.5 * deg, rate_y=0.0),
        dark,
    )
    yield view(
        "with the Moon",
        f"the gibbous Moon in the field, {0.7 * half / deg:.1f} degrees off its middle",
        case,
        partial(beside, moon, 0.7 * half),
    )
    yield view(
        "with the limb",
        f"the Earth's limb by night in the field, {half / 3 / deg:.1f} degrees off its middle",
        case,
        partial(beside, down, horizon + half / 3),
    )


def view(name: str, text: str, case: Case, attitude: Callable[[int], Rotation]) -> View:
    def look(fidelity: Fidelity, case: Case, number: int) -> Floats:
        return errors(case, attitude(number), number, fidelity)

    return View(
        name,
        f"{text}; a trial is a frame at another attitude",
        case,
        EFFECTS,
        partial(look, Fidelity.FRAME),
        lambda case, numbers, values: rms(values),
        ("across / arcsec", "about / arcsec"),
        partial(look, Fidelity.WINDOW),
    )


def errors(case: Case, attitude: Rotation, number: int, fidelity: Fidelity) -> Floats:
    """Errors (2, 2), arcsec: two across the boresight, one about it.

    NaN without an attitude or with a wrong attitude.
    """
    one = run_trial(case, attitude, Streams(SEED, number), fidelity)
    if one.false or not one.solved:
        return np.full((2, 2), math.nan)
    return np.array([[one.error_x, one.error_z], [one.error_y, math.nan]]) / arcsec


def dark_field(observer: SkyObserver, down: Floats, horizon: float, number: int) -> Rotation:
    """A random attitude that is far from the Moon and from the Earth's limb."""
    moon = observer.see("moon").direction
    for n in count():
        attitude = random_attitude(Streams(SEED, ATTITUDES * number + n))
        boresight = attitude.as_matrix()[2]
        if boresight @ moon < math.cos(FAR) and boresight @ down < math.cos(horizon + FAR):
            return attitude
    raise AssertionError


def beside(direction: Floats, angle: float, number: int) -> Rotation:
    return around(direction, angle, Streams(SEED, number))


def everything(plain: Case) -> Case:
    """A design with all effects of a matrix's frame, of usual size; values are assumed."""
    case = with_detector(
        plain,
        defects=Defects(dsnu=20.0, hot=1e-3, hot_current=2000.0, dead=1e-4),
        diffusion=2 * um,
        crosstalk=0.01,
        lag=0.001,
        hits=Hits(5e4),
        blooming=True,
        nonlinearity=0.01,
        adc_inl=0.5,
        pattern=Pattern(row=0.5, column=0.5, column_offset=1.0),
        settling=1e-3,
        read_noise_spread=0.15,
        row_delay=10e-6,
    )
    case = with_optics(case, psf="kirchhoff", k1=-0.02, aberrations=(Aberration(6, 40 * nm),))
    hum = Tone(30.0, rms_x=0.3 * arcsec, rms_y=0.3 * arcsec)
    level = (1e-3 * arcsec**2, 1e-3 * arcsec**2)  # 0.3 arcsec rms
    rumble = tuple(Broadband(axis, (1.0, 100.0), level) for axis in "xy")
    case = with_motion(case, tones=(hum,), broadband=rumble)
    case = replace(case, scene=NIGHT, instrument=replace(case.instrument, baffle=BAFFLE))
    faint = replace(case.catalog, limit_g=8.0)
    # A tracker that does not know when its rows are exposed.
    tracker = replace(case.tracker, catalog=case.catalog, row_delay=0.0)
    return replace(case, catalog=faint, tracker=tracker)


def with_detector(case: Case, **changes: Any) -> Case:
    return with_part(case, "detector", changes)


def with_optics(case: Case, **changes: Any) -> Case:
    return with_part(case, "optics", changes)


def with_motion(case: Case, **changes: Any) -> Case:
    return with_part(case, "motion", changes)


def with_part(case: Case, part: str, changes: dict[str, Any]) -> Case:
    """Another detector, lens or motion."""
    instrument = case.instrument
    changed = replace(getattr(instrument, part), **changes)
    return replace(case, instrument=replace(instrument, **{part: changed}))


def without_lights(case: Case, *names: str) -> Case:
    lights = tuple(light for light in case.scene.lights if light not in names)
    return replace(case, scene=replace(case.scene, lights=lights))


def without_faint_stars(case: Case) -> Case:
    return replace(case, catalog=case.believed_catalog)


def without_baffle(case: Case) -> Case:
    return replace(case, instrument=replace(case.instrument, baffle=None))


EFFECTS: dict[str, Change] = {
    "zodiacal light": lambda case: without_lights(case, "zodiacal"),
    "starlight below the catalogue": lambda case: without_lights(case, "starlight"),
    "planets": lambda case: without_lights(case, "planets"),
    "Sun": lambda case: without_lights(case, "sun"),
    "Moon": lambda case: without_lights(case, "moon"),
    "airglow and cities": lambda case: without_lights(case, "airglow", "cities"),
    "Earth and all of its lights": lambda case: without_lights(case, "airglow", "cities", "earth"),
    "stray light": without_baffle,
    "stars of G 7 to 8": without_faint_stars,
    "distortion": lambda case: with_optics(case, k1=0.0),
    "Kirchhoff (Fraunhofer instead)": lambda case: with_optics(case, psf="fraunhofer"),
    "wavefront error of 40 nm": lambda case: with_optics(case, aberrations=()),
    "slew": lambda case: with_motion(case, rate_x=0.0, rate_y=0.0),
    "jitter of 0.4 arcsec": lambda case: with_motion(case, tones=(), broadband=()),
    "PRNU": lambda case: with_detector(case, prnu=0.0),
    "dark current": lambda case: with_detector(case, dark_current=0.0),
    "DSNU, hot and dead pixels": lambda case: with_detector(case, defects=None),
    "diffusion and crosstalk": lambda case: with_detector(case, diffusion=0.0, crosstalk=0.0),
    "lag": lambda case: with_detector(case, lag=0.0),
    "cosmic rays": lambda case: with_detector(case, hits=None),
    "blooming": lambda case: with_detector(case, blooming=False),
    "noisy pixels": lambda case: with_detector(case, read_noise_spread=0.0),
    "non-linearity": lambda case: with_detector(case, nonlinearity=0.0, adc_inl=0.0),
    "row and column noise": lambda case: with_detector(case, pattern=None),
    "settling of the read-out": lambda case: with_detector(case, settling=0.0),
    "rolling shutter": lambda case: with_detector(case, row_delay=0.0),
    "read noise": lambda case: with_detector(case, read_noise=0.0, read_noise_spread=0.0),
}
