"""Place and time of a photograph -> direction of its camera, without refraction and aberration."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from startrack.catalog import aberrate, earth_observer
from startrack.core import (
    FINITE,
    Camera,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    installed_tables,
    parameter,
    utc,
)
from startrack.identification import LensFit, fit_again, fit_frame
from startrack.photograph.solve import Photograph
from startrack.space import EARTH_RADIUS, SPIN, horizon_axes, refraction, rotation_matrices

# Of refraction, one standard deviation, chosen by hand: 15 K or 50 hPa other than the formula's.
AIR = 0.05


class Site(Parameters):
    """A place on the Earth, and a time."""

    latitude: float = parameter(
        "geodetic", unit=Unit("rad", "deg"), limit=Range(-math.pi / 2, math.pi / 2)
    )
    longitude: float = parameter("to the east", unit=Unit("rad", "deg"), limit=FINITE)
    time: str = parameter("UTC, ISO 8601")
    height: float = parameter(
        "above the sea", unit=Unit("m"), limit=Range(-500.0, 40e3), default=0.0
    )

    @cached_property
    def axes(self) -> Floats:
        """Columns east, north and up (3, 3) of the horizon, ICRS axes.

        Accuracy  model: astropy's installed tables of the Earth's rotation.
        """
        date = utc(self.time)
        to_earth = rotation_matrices("GCRS", "ITRS", date)[0]
        return np.asarray(to_earth.T @ horizon_axes(self.latitude, self.longitude))

    @cached_property
    def velocity(self) -> Floats:
        """(3,) m/s against the solar system's barycentre, ICRS axes."""
        with installed_tables():
            year = float(utc(self.time).tdb.jyear)
        spin = SPIN * (EARTH_RADIUS + self.height) * math.cos(self.latitude)
        return earth_observer(year).velocity + spin * self.axes[:, 0]

    def seen(self, direction: Floats) -> Floats:
        """Directions in which a camera at the site sees stars, by aberration and refraction.

        direction  (n, 3) unit vectors of the catalogue, ICRS axes
        Returns    (n, 3) unit vectors, ICRS axes
        Accuracy   model: that of `refraction`; no deflection by the Sun (0.04 arcsec at most at
                   night).
        """
        moved = aberrate(direction, self.velocity)
        up = self.axes[:, 2]
        sine = np.clip(moved @ up, -1.0, 1.0)
        level = moved - sine[:, None] * up
        level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
        raised = np.arcsin(sine)
        raised = raised + refraction(raised, self.height)
        return np.asarray(np.cos(raised)[:, None] * level + np.sin(raised)[:, None] * up)

    def angles(self, direction: Floats) -> tuple[float, float]:
        """Azimuth, from north over east, and elevation of a direction (3,), radian."""
        east, north, up = (direction @ self.axes).tolist()
        return math.atan2(east, north) % (2 * math.pi), math.asin(min(max(up, -1.0), 1.0))


@dataclass(frozen=True, eq=False)
class PlacedPhotograph:
    """Direction of the camera of a photograph.

    fit         its attitude and lens, with the stars at their directions from the site;
                `icrs_to_image` belongs to the axis through the middle of the image, and its
                covariance includes the air's refraction
    azimuth     radian of that axis, from north over east
    elevation   radian above the horizontal
    refraction  radian, by which the air lifts a star that is seen there
    aberration  radian, by which the Earth's motion displaces a star there
    """

    fit: LensFit
    azimuth: float
    elevation: float
    refraction: float
    aberration: float


def place_photograph(
    photo: Photograph, site: Site, camera: Camera | None = None
) -> PlacedPhotograph:
    """The attitude of a solved photograph, from its place and time.

    The matches stay; their stars have their directions from the site.

    camera    the calibrated camera by which it was solved; None: its lens was unknown
    Raises    ValueError if the photograph has no attitude, or if a matched star is below the
              horizon, which means that place or time are wrong.
    Accuracy  model: that of `fit_frame`, or of `fit_lens`; refraction is known to 5 %, which the
              covariance counts.
    """
    if photo.matches.icrs_to_camera is None:
        raise Refused("a photograph must be solved before it is placed")
    stars = site.seen(photo.matches.direction)
    lowest = float(np.degrees(np.arcsin(np.min(stars @ site.axes[:, 2]))))
    if lowest < 0:
        raise Refused(
            f"place and time must have all matched stars above the horizon, got {-lowest:.3g} deg "
            "below it"
        )
    matches = replace(photo.matches, direction=stars)
    if camera is None:
        fit = fit_again(photo.spots, matches)
    else:
        fit = fit_frame(photo.spots, replace(matches, camera=camera))
    axis = fit.icrs_to_image.inv().apply([0.0, 0.0, 1.0])
    azimuth, elevation = site.angles(axis)
    lift = float(refraction(np.array(elevation), site.height, seen=True))
    level = np.cross(site.axes[:, 2], axis)  # about which refraction turns the image
    level = fit.icrs_to_image.apply(level / max(float(np.linalg.norm(level)), 1e-12))
    covariance = fit.covariance + (AIR * lift) ** 2 * np.outer(level, level)
    moved = aberrate(axis[None], -site.velocity)[0]
    return PlacedPhotograph(
        fit._replace(covariance=covariance),
        azimuth,
        elevation,
        lift,
        2 * math.asin(float(np.linalg.norm(moved - axis)) / 2),
    )
