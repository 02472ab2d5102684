"""Elements of a detector, the times of its lines, and the line of sight of each pixel.

As in orekit's Rugged, times of lines and elements are independent.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import FINITE, Floats, Parameters, Unit, parameter, printed
from startrack.earth.geometry.orbit import Carrier, Flight, fly
from startrack.earth.terrain import Rays, geodetic


class Dating(Parameters):
    """Times of the lines of an image.

        time = start + line * period

    Lines are read at equal intervals.
    """

    start: float = parameter("second after the epoch", limit=FINITE, default=0.0)
    period: float = parameter(
        "second from line to line; 0 for a matrix, whose lines are taken together",
        limit=FINITE,
        default=0.0,
    )

    def at(self, line: Floats) -> Floats:
        """Seconds after the epoch, (n,), of lines (n,); fractions of a line are allowed."""
        return self.start + line * self.period


@printed
@dataclass(frozen=True, eq=False)
class Elements:
    """Positions on the camera's pixel grid of the elements of one line of the image."""

    # (columns, stages) pixel, for each column of the image; the charges or numbers of all stages
    # are added.
    x: Floats
    y: Floats  # (columns, stages) pixel, likewise
    delay: Floats  # (columns, stages) lines, delay of each stage's exposure


def line_elements(columns: int, y: float) -> Elements:
    """One row of pixels at the row `y` of the camera."""
    core.whole(1, 2**20, columns=columns)
    core.finite(y=y)
    x = np.arange(float(columns))[:, None]
    return Elements(x, np.full_like(x, y), np.zeros_like(x))


def staggered_elements(
    columns: int, y: float, rows_apart: float, lines_a_pixel: float = 2.0
) -> Elements:
    """Two rows, the second shifted by half a pixel; their pixels alternate in the image.

    The rows see a point on the ground at different times; the image combines the rows so that the
    point is in one line. The ground moves to smaller rows, as below a Pointing.

    columns        columns of the image, twice the columns of a row
    rows_apart     pixel from the first row to the second
    lines_a_pixel  lines in which the ground moves by a pixel: 2 for equal sampling along and across
    """
    core.whole(2, 2**20, columns=columns)
    core.finite(y=y, rows_apart=rows_apart)
    core.positive(lines_a_pixel=lines_a_pixel)
    second = np.arange(float(columns))[:, None] % 2
    x = np.arange(float(columns))[:, None] / 2
    return Elements(x, y + rows_apart * second, -rows_apart * lines_a_pixel * second)


def tdi_elements(columns: int, y: float, stages: int, forwards: int = -1) -> Elements:
    """Rows whose charge moves with the image: stage s is s rows farther and is exposed s lines
    later.

    forwards  1 where the ground moves to larger rows, -1 where it moves to smaller ones
    """
    core.whole(1, 2**20, columns=columns)
    core.whole(1, 4096, stages=stages)
    stage = np.arange(float(stages)) - (stages - 1) / 2
    x = np.broadcast_to(np.arange(float(columns))[:, None], (columns, stages)).copy()
    return Elements(x, y + stage + 0 * x, forwards * stage + 0 * x)


def matrix_elements(columns: int, first: int, rows: int) -> Elements:
    """Elements of the given rows of a matrix, row by row; the rows are exposed together."""
    core.whole(1, 2**20, columns=columns, rows=rows)
    y, x = np.mgrid[first : first + rows, :columns].astype(float).reshape(2, -1, 1)
    return Elements(x, y, np.zeros_like(x))


def inside_pixel(side: int) -> Floats:
    """Offsets (side^2, 2), in pixel, of rays on a regular grid in a pixel."""
    core.positive(side=side)
    at = (np.arange(side) + 0.5) / side - 0.5
    return np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)


Jitter = Callable[[Floats], Floats]


class Pointing(Parameters):
    """Attitude of a camera with respect to its orbit.

    At zero its boresight points to the Earth's centre and +y along the flight,
    so that the ground moves to smaller rows. The angles then rotate the camera about its axes,
    z first, then y, then x.
    """

    roll: float = parameter(
        "angle about y, along the flight", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    pitch: float = parameter(
        "angle about x; positive is forwards", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    yaw: float = parameter("about z", unit=Unit("rad", "deg"), limit=FINITE, default=0.0)

    def camera_to_itrs(self, flight: Flight) -> Rotation:
        """Attitude at (n,) states, Earth-fixed."""
        down = -flight.position / np.linalg.norm(flight.position, axis=1, keepdims=True)
        side = np.cross(flight.course, down)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        along = np.cross(down, side)
        local = Rotation.from_matrix(np.stack([side, along, down], axis=-1))
        return local * Rotation.from_euler("ZYX", [self.yaw, self.roll, -self.pitch])


def sight(
    camera: core.Camera,
    pixel: Floats,
    time: Floats,
    orbit: Carrier,
    pointing: Pointing,
    turn: Jitter | None = None,
    spread: float | None = None,
) -> Rays:
    """Lines of sight of pixels at the times of their exposure.

    The true direction is the apparent direction minus the velocity over the speed of light. With
    the velocity over the rotating Earth, this corrects aberration and light time together, to first
    order.

    pixel    (n, 2) pixel (x, y)
    time     (n,) second after the epoch of the orbit
    turn     attitude jitter: at (m,) seconds the (m, 3) rotation vectors in radian, in camera axes,
             of the scene's rotation in the camera
    spread   radian between neighbouring rays; None: rays of the sensor's pixels
    Returns  (n,) rays
    Accuracy  model: second order of v / c, 0.4 mm of ground at 600 km.
    """
    moment, which = np.unique(time, return_inverse=True)
    flight = fly(orbit, moment)
    attitude = pointing.camera_to_itrs(flight)
    if turn is not None:
        attitude = attitude * Rotation.from_rotvec(turn(moment)).inv()
    direction = attitude[which].apply(camera.unproject(pixel))
    direction -= flight.velocity[which] / core.LIGHT_SPEED
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    if spread is None:
        spread = 1 / camera.focal_length_px
    return Rays(flight.position[which], direction, np.full(len(time), spread))


def scan_lines(
    camera: core.Camera,
    elements: Elements,
    lines: Floats,
    dating: Dating,
    orbit: Carrier,
    pointing: Pointing,
    turn: Jitter | None = None,
    rays_per_side: int = 1,
) -> Rays:
    """The rays of lines of an image: line by line, column by column, stage by stage.

    A pixel is the mean of its rays. Reshape the rays to (lines, columns, stages * rays_per_side^2).

    lines          (n,) numbers of the lines
    rays_per_side  rays along each side of a pixel, against aliasing
    """
    core.whole(1, 64, rays_per_side=rays_per_side)
    inside = inside_pixel(rays_per_side)
    shape = (len(lines), *elements.x.shape, len(inside))
    time = dating.at(lines[:, None, None, None] + elements.delay[..., None])
    place = np.stack([elements.x, elements.y], axis=-1)[None, :, :, None] + inside
    place = np.broadcast_to(place, (*shape, 2)).reshape(-1, 2)
    spread = 1 / camera.focal_length_px / rays_per_side
    return sight(camera, place, np.broadcast_to(time, shape).ravel(), orbit, pointing, turn, spread)


def ground_rate(orbit: Carrier) -> float:
    """Angular rate of the ground below the satellite at the epoch, radian / second.

    The rate times the focal length in pixels is the line rate for square pixels at the nadir. The
    last 16 orbits are cached, because astropy takes 7 ms for the axes of the Earth.
    """
    return _below(orbit)[0]


def flight_height(orbit: Carrier) -> float:
    """Height above the ellipsoid at the epoch, metre; cached as `ground_rate`."""
    return _below(orbit)[1]


@lru_cache(maxsize=16)
def _below(orbit: Carrier) -> tuple[float, float]:
    """Angular rate of the ground below, radian / second, and height above it, metre."""
    flight = fly(orbit, np.zeros(1))
    position, velocity = flight.position[0], flight.velocity[0]
    radius = float(np.linalg.norm(position))
    rise = position / radius
    across = float(np.linalg.norm(velocity - velocity @ rise * rise))
    height = float(geodetic(position[None])[2][0])
    return across * (radius - height) / radius / height, height
