"""The values of an Earth scene: rays from a camera, and the ground that they meet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import Flags, Floats, printed
from startrack.earth.terrain.ellipsoid import cartesian, up

ABOVE = 20e3  # metre, height from which rays look straight down
Levels = NDArray[np.int8]  # levels of a pyramid of terrain; 0 is the finest


@printed
@dataclass(frozen=True, eq=False)
class Rays:
    """Lines of sight in the Earth's fixed axes (ITRS).

    origin     (n, 3) metre
    direction  (n, 3) unit vectors, away from the camera
    spread     (n,) radian, angle between neighbouring rays; 0 for the finest terrain
    """

    origin: Floats
    direction: Floats
    spread: Floats

    def __len__(self) -> int:
        return len(self.origin)

    def __getitem__(self, choice: Flags | NDArray[np.intp] | slice) -> Rays:
        return Rays(self.origin[choice], self.direction[choice], self.spread[choice])


def rays_down(longitude: Floats, latitude: Floats, spacing: float) -> Rays:
    """Rays straight down to points (n,) in radian, `spacing` metre apart on the ground."""
    above = cartesian(longitude, latitude, np.full(len(longitude), ABOVE))
    return Rays(above, -up(longitude, latitude), np.full(len(above), spacing / ABOVE))


@printed
@dataclass(frozen=True, eq=False)
class Ground:
    """Ground that rays meet: a point of the terrain, or the sky. All vectors in the Earth's fixed
    axes.

    hit                  (n,) whether the ray meets the ground; otherwise it sees the sky, and all
                         floats below except `tangent_height` are NaN
    distance             (n,) metre from the ray's origin
    point                (n, 3) metre
    longitude, latitude  (n,) radian
    height               (n,) metre above the ellipsoid
    normal               (n, 3) unit vector of the terrain's surface
    incidence            (n,) radian, between the normal and the direction to the camera
    sun_incidence        (n,) radian, between the normal and the sun; beyond pi / 2 it is unlit
    shadow               (n,) whether there is no direct sunlight: the sun is behind the slope,
                         behind other terrain or below the horizon; false for the sky
    sky_view             (n,) 1, fraction of the light of a uniform sky that reaches the slope; 1 if
                         not computed
    tangent_height       (n,) metre, lowest height above the ellipsoid of a ray that meets no
                         ground; the origin's height if the ray rises; NaN for hits
    level                (n,) level of the terrain's pyramid; 0 is the finest, -1 the sky
    maps                 (n,) values of each accompanying map by name, in its unit
    sun                  (3,) unit vector towards the sun
    direction            (n, 3) unit vectors of the rays
    """

    hit: Flags
    distance: Floats
    point: Floats
    longitude: Floats
    latitude: Floats
    height: Floats
    normal: Floats
    incidence: Floats
    sun_incidence: Floats
    shadow: Flags
    sky_view: Floats
    tangent_height: Floats
    level: NDArray[np.int8]
    sun: Floats
    direction: Floats
    maps: dict[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.hit)

    def __getitem__(self, choice: Flags | NDArray[np.intp] | slice) -> Ground:
        return _changed([self], lambda values: values[0][choice])

    @property
    def view_zenith(self) -> Floats:
        """Angle between the vertical of the ground and the direction to the camera, (n,) radian."""
        return between(up(self.longitude, self.latitude), -self.direction)

    @property
    def sun_zenith(self) -> Floats:
        """Angle between the vertical of the ground and the sun, (n,) radian."""
        return between(up(self.longitude, self.latitude), self.sun)


def joined(parts: Sequence[Ground]) -> Ground:
    """Ground of several parts of an image, under one Sun."""
    return _changed(parts, np.concatenate)


def _changed(parts: Sequence[Ground], change: Callable[[list[Any]], Any]) -> Ground:
    """The first part, with `change` applied to each array of all parts."""
    names = [field.name for field in fields(Ground) if field.name not in ("sun", "maps")]
    maps = {name: change([part.maps[name] for part in parts]) for name in parts[0].maps}
    arrays = {name: change([getattr(part, name) for part in parts]) for name in names}
    return replace(parts[0], **arrays, maps=maps)


def between(first: Floats, second: Floats) -> Floats:
    """Angle between unit vectors, radian, accurate near 0 and pi, too."""
    second = np.broadcast_to(second, first.shape)
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.arctan2(across, np.einsum("...i,...i", first, second))
