"""The line of sight of each pixel of a camera in flight, at its own time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import LIGHT_SPEED, Camera, Floats, Unit, finite, whole
from startrack.earth.geometry.orbit import Carrier, Flight, fly
from startrack.earth.geometry.sensor import Dating, Elements, inside_pixel
from startrack.earth.terrain import Rays, geodetic

Jitter = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Pointing:
    """Attitude of a camera with respect to its orbit.

    At zero its boresight points to the Earth's centre and +y along the flight,
    so that the ground moves to smaller rows. The angles then rotate the camera about its axes,
    z first, then y, then x.

    roll   radian about y, the axis along the flight: to the side
    pitch  radian about x: forwards where positive
    yaw    radian about z
    """

    roll: Annotated[float, Unit("rad", "deg")] = 0.0
    pitch: Annotated[float, Unit("rad", "deg")] = 0.0
    yaw: Annotated[float, Unit("rad", "deg")] = 0.0

    def __post_init__(self) -> None:
        finite(roll=self.roll, pitch=self.pitch, yaw=self.yaw)

    def camera_to_itrs(self, flight: Flight) -> Rotation:
        """(n,) rotations."""
        down = -flight.position / np.linalg.norm(flight.position, axis=1, keepdims=True)
        side = np.cross(flight.course, down)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        along = np.cross(down, side)
        local = Rotation.from_matrix(np.stack([side, along, down], axis=-1))
        return local * Rotation.from_euler("ZYX", [self.yaw, self.roll, -self.pitch])


@dataclass(frozen=True, eq=False)
class Fixed:
    """A camera that keeps its attitude among the stars."""

    icrs_to_camera: Rotation

    def camera_to_itrs(self, flight: Flight) -> Rotation:
        """(n,) rotations."""
        return flight.icrs_to_itrs * self.icrs_to_camera.inv()


def sight(
    camera: Camera,
    pixel: Floats,
    time: Floats,
    orbit: Carrier,
    pointing: Pointing | Fixed,
    turn: Jitter | None = None,
    spread: float | None = None,
) -> Rays:
    """The lines of sight of pixels at their times.

    Light comes from the apparent direction minus the velocity over the speed of light. With the
    velocity over the rotating Earth this corrects aberration and light time together, to first
    order.

    pixel    (n, 2) pixel (x, y)
    time     (n,) second after the epoch of the orbit
    turn     attitude jitter: at (m,) seconds the (m, 3) rotation vectors in radian, in camera axes,
             by which the scene rotates in the camera
    spread   radian between neighbouring rays; None for those of pixels
    Returns  (n,) rays
    Accuracy  model: second order of v / c, 0.4 mm of ground at 600 km.
    """
    moment, which = np.unique(time, return_inverse=True)
    flight = fly(orbit, moment)
    attitude = pointing.camera_to_itrs(flight)
    if turn is not None:
        attitude = attitude * Rotation.from_rotvec(turn(moment)).inv()
    direction = attitude[which].apply(camera.unproject(pixel))
    direction -= flight.velocity[which] / LIGHT_SPEED
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    if spread is None:
        spread = 1 / camera.focal_length_px
    return Rays(flight.position[which], direction, np.full(len(time), spread))


def scan_lines(
    camera: Camera,
    elements: Elements,
    lines: Floats,
    dating: Dating,
    orbit: Carrier,
    pointing: Pointing | Fixed,
    turn: Jitter | None = None,
    rays_per_side: int = 1,
) -> Rays:
    """The rays of lines of an image: line by line, column by column, stage by stage.

    A pixel is the mean of its rays: reshape to (lines, columns, stages * rays_per_side^2).

    lines          (n,) numbers of the lines
    rays_per_side  rays along each side of a pixel, against aliasing
    """
    whole(1, 64, rays_per_side=rays_per_side)
    inside = inside_pixel(rays_per_side)
    shape = (len(lines), *elements.x.shape, len(inside))
    time = dating.at(lines[:, None, None, None] + elements.delay[..., None])
    place = np.stack([elements.x, elements.y], axis=-1)[None, :, :, None] + inside
    return sight(
        camera,
        np.broadcast_to(place, (*shape, 2)).reshape(-1, 2),
        np.broadcast_to(time, shape).ravel(),
        orbit,
        pointing,
        turn,
        1 / camera.focal_length_px / rays_per_side,
    )


@lru_cache(maxsize=16)
def ground_rate(orbit: Carrier) -> float:
    """Radian per second at which the ground below the satellite moves at its epoch.

    Times the focal length in pixels it is the line rate that makes square pixels at the nadir. Kept
    for the 16 last orbits, because astropy takes 7 ms for the axes of the Earth.
    """
    flight = fly(orbit, np.zeros(1))
    position, velocity = flight.position[0], flight.velocity[0]
    radius = float(np.linalg.norm(position))
    rise = position / radius
    across = float(np.linalg.norm(velocity - velocity @ rise * rise))
    height = float(geodetic(position[None])[2][0])
    return across * (radius - height) / radius / height
