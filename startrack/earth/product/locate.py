"""Line and column at which a camera in flight sees points of the ground."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from startrack.core import LIGHT_SPEED, Camera, Floats
from startrack.earth.geometry import EarthScene, Elements, fly

NODES = 65  # of the flight's spline over the image
BEYOND = 0.1  # of the lines, before and after the image, in which the spline holds
STEPS = 8  # of the search of a line, at most
CLOSE = 1e-6  # line


@dataclass(frozen=True, eq=False)
class Locator:
    """The inverse of a sight: from points to the image.

    A line camera sees a point when it crosses the plane of the line; its time is searched by
    Newton's method on splines of position, velocity and attitude.

    scene  with its sensor
    lens   camera of the sensor's pixels, with its distortion; None: the sensor's own, without
    """

    scene: EarthScene
    lens: Camera | None = None
    _flight: CubicSpline = field(init=False)
    _row: Elements = field(init=False)
    _at_once: bool = field(init=False)  # a matrix

    def __post_init__(self) -> None:
        sensor, carrier = self.scene.sensor, self.scene.carrier
        dating = sensor.dating(carrier)
        margin = BEYOND * sensor.lines + 2 * sensor.stages
        at = np.linspace(-margin, sensor.lines - 1 + margin, NODES)
        if not dating.period:
            at = np.linspace(-1.0, 1.0, 4)
        flight = fly(carrier, dating.at(at))
        turn = self.scene.pointing.camera_to_itrs(flight).as_matrix().reshape(-1, 9)
        values = np.concatenate([flight.position, flight.velocity, turn], 1)
        object.__setattr__(self, "_flight", CubicSpline(at, values))
        object.__setattr__(self, "_row", sensor.elements(carrier)[0])
        object.__setattr__(self, "_at_once", not dating.period)

    def locate(self, point: Floats) -> Floats:
        """Where points are seen.

        point     (n, 3) metre, in the Earth's fixed axes
        Returns   (n, 2) column and line of the image, whole at the middle of a pixel; far outside,
                  or NaN, where the image does not show them
        Accuracy  numerical: 1e-6 pixel. Staggered rows, and the stages of TDI, count as one row in
                  their middle: even and odd columns lie to both sides of it by what the Earth turns
                  in between, 0.09 pixel for the camera `hsrs`.
        """
        sensor = self.scene.sensor
        row = self._row
        if self._at_once:
            return self._project(point, np.zeros(len(point)))
        first, last = row.x.mean(1)[[0, -1]]
        step = (last - first) / (len(row.x) - 1)
        y, late = float(row.y.mean()), float(row.delay.mean())
        line = np.full(len(point), (sensor.lines - 1) / 2)
        pace = self._pace(point, y, late)
        low, high = self._flight.x[[0, -1]]
        seen = self._project(point, line + late)
        for _ in range(STEPS):
            change = (seen[:, 1] - y) / pace
            line = np.clip(line - change, low - late, high - late)
            seen = self._project(point, line + late)
            if not (np.abs(change) > CLOSE).any():
                break
        return np.stack([(seen[:, 0] - first) / step, line], 1)

    def camera(self, line: Floats) -> Floats:
        """Position (n, 3) metre of the camera at lines (n,)."""
        return self._at(line)[:, :3]

    def _pace(self, point: Floats, y: float, late: float) -> float:
        """Rows by which the ground moves from line to line, near the image's middle."""
        middle = (self.scene.sensor.lines - 1) / 2 + late
        some = point[:: max(1, len(point) // 16)]
        before, after = (self._project(some, np.full(len(some), middle + d)) for d in (-0.5, 0.5))
        moved = (after - before)[:, 1]
        moved = moved[np.isfinite(moved)]
        return float(moved.mean()) if len(moved) and moved.mean() else -1.0

    def _at(self, line: Floats) -> Floats:
        return np.asarray(self._flight(np.zeros_like(line) if self._at_once else line))

    def _project(self, point: Floats, line: Floats) -> Floats:
        """Pixel (n, 2) of the camera's grid at which it would see points at the time of lines."""
        flight = self._at(line)
        sight = point - flight[:, :3]
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        # The camera's direction a has a - v / c along the sight: see `sight`.
        drift = flight[:, 3:6] / LIGHT_SPEED
        along = np.einsum("ij,ij->i", sight, drift)
        square = np.einsum("ij,ij->i", drift, drift)
        sight = (np.sqrt(along**2 + 1 - square) - along)[:, None] * sight + drift
        turn = flight[:, 6:].reshape(-1, 3, 3)
        camera = self.lens or self.scene.sensor.camera
        return camera.project(np.einsum("nij,ni->nj", turn, sight))
