"""Scene, Selection -> the catalogue's epoch and orbital velocity, which must match the scene."""

from dataclasses import replace

import numpy as np

from startrack.catalog import Selection, earth_observer
from startrack.core import LIGHT_SPEED, Floats, Refused, arcsec
from startrack.scene import ObserverOrbit, Scene, orbital_velocity
from startrack.space import AU

# Largest difference of the sky's epoch from the date. It is a year, the resolution of a date such
# as "2026". Stars to G = 8 move by 0.03 arcsec (median), 0.4 arcsec (99 %) or 7 arcsec (Groombridge
# 1830) in a year.
MOTION_YEARS = 1.0
# The Earth's velocity turns by 60 degrees in this time. The error of the aberration is then as
# large as the aberration, 20.5 arcsec. The error of the bodies of a scene, which are computed
# without aberration, has the same size.
ABERRATION_YEARS = 1 / 6
# Chosen by hand: a tenth of the aberration of a low orbit. A larger value would accept a wrong
# orbit, a smaller one would refuse a direction that is rounded to 6 degrees.
ABERRATION = 0.5 * arcsec
# Metre. The error of the parallax (0.8 arcsec for the nearest star) is then below 0.08 arcsec.
NEAR_EARTH = 0.1 * AU
PHASES = 720  # phases of an orbit with a random phase: the nearest differs by 0.02 arcsec


def seen_from(scene: Scene, catalog: Selection) -> Selection:
    """The catalogue with its epoch and its orbital velocity given.

        epoch = the middle of the scene's dates,   velocity = orbital velocity at the scene's phase

    These values are used if the catalogue leaves them out (None, or no velocity of an observer in
    an orbit). Without a date the epoch is 2026.0. There is no orbital velocity without an orbit,
    nor for an orbit whose phase each trial draws: the stars of all trials are at the same apparent
    places.

    Raises    ValueError if a given value contradicts the scene, with both keys and values.
    Accuracy  model: if trials draw their dates, the stars stay at one epoch. If trials draw the
              phase of the orbit, its aberration is left out (5.2 arcsec in a low orbit).
    """
    epoch = catalog.year
    velocity: tuple[float, ...] = catalog.orbital_velocity or ()
    if scene.date is not None:
        first, last = scene.years
        epoch = (first + last) / 2 if catalog.epoch is None else epoch
        _check_epoch(scene, catalog, epoch)
        _check_place(scene, catalog)
    if scene.orbit and catalog.aberration:
        if velocity:
            _check_velocity(scene.orbit, velocity)
        else:
            phase = scene.orbit.phase
            velocity = () if phase is None else tuple(orbital_velocity(scene.orbit, phase).tolist())
    return replace(catalog, epoch=epoch, orbital_velocity=velocity)


def believed_from(scene: Scene, true: Selection, believed: Selection) -> Selection:
    """The tracker's catalogue with its epoch and orbital velocity given.

    An epoch that it leaves out is the true one if the scene has a date. A velocity that it leaves
    out is the true one if the scene has an orbit. Values that it gives may differ from the truth.
    """
    epoch, velocity = believed.year, believed.orbital_velocity
    if believed.epoch is None and scene.date is not None:
        epoch = true.year
    if velocity is None:
        velocity = true.orbital_velocity if scene.orbit and believed.aberration else ()
    return replace(believed, epoch=epoch, orbital_velocity=velocity)


def _check_epoch(scene: Scene, catalog: Selection, epoch: float) -> None:
    apparent = catalog.aberration or catalog.parallax
    tolerance = ABERRATION_YEARS if apparent else MOTION_YEARS
    first, last = scene.years
    if not first - tolerance <= epoch <= last + tolerance:
        why = " with aberration or parallax" if apparent else ""
        span = f" and scene.days {scene.days:g}" if scene.days else ""
        raise Refused(
            f"catalog.epoch must lie within {tolerance:.2g} years{why} of scene.date "
            f"{scene.date!r}{span}, or be left out, got {epoch:.8g}"
        )


def _check_place(scene: Scene, catalog: Selection) -> None:
    """Refuse the Earth's velocity and place for an observer far from the Earth."""
    assumed = catalog.parallax or (catalog.aberration and not catalog.orbital_velocity)
    if scene.place is None or not assumed:
        return
    earth = earth_observer(sum(scene.years) / 2).position * AU
    distance = float(np.linalg.norm(np.array(scene.place) - earth))
    if distance > NEAR_EARTH:
        raise Refused(
            "scene.place must lie within 0.1 AU of the Earth if catalog.parallax is true, or if "
            "catalog.aberration is true without catalog.orbital_velocity, "
            f"got {distance / AU:.3g} AU"
        )


def _check_velocity(orbit: ObserverOrbit, velocity: tuple[float, ...]) -> None:
    given = np.array(velocity)
    if orbit.phase is None:  # any velocity of the orbit may be meant
        phases = np.linspace(0, 2 * np.pi, PHASES)
        true = np.array([orbital_velocity(orbit, float(phase)) for phase in phases])
        kept = "one"
    else:
        true = orbital_velocity(orbit, orbit.phase)
        kept = f"that, {_shown(true)},"
    if np.linalg.norm(true - given, axis=-1).min() > ABERRATION * LIGHT_SPEED:
        raise Refused(
            f"catalog.orbital_velocity must be {kept} of scene.orbit, or be left out, got "
            f"{_shown(given)}"
        )


def _shown(velocity: Floats) -> str:
    return f"({', '.join(f'{component / 1000:.4g}' for component in velocity)}) km/s"
