"""Matches of frames in sequence -> the estimated camera, with temperature terms."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from startrack import core
from startrack.attitude.camera import UNKNOWNS, Calibration, MatchedFrame, moved_camera
from startrack.core import NON_NEGATIVE, Camera, Floats, Matches, Parameters, Spots, parameter

FEWEST = 4  # least stars of a frame that can update the camera
STEPS = 2  # of Gauss-Newton, in a frame
COUNT = len(UNKNOWNS)
EVERY: core.Ints = np.arange(COUNT)


class CameraFilter(Parameters):
    """A calibration in flight, frame by frame: its prior, and the changes of the camera.

    Random walks grow with the square root of time. Slopes are derivatives by the temperature that
    is given to `after_frame`. A map of residual distortion has nodes that span the frame evenly,
    with linear interpolation between them.
    """

    prior: Calibration = parameter("standard deviations at the begin", default_factory=Calibration)
    focal_length_walk: float = parameter(
        "relative", unit=core.Unit("s(-1/2)"), limit=NON_NEGATIVE, default=0.0
    )
    principal_walk: float = parameter(
        "pixel / second^(1/2), along each axis", limit=NON_NEGATIVE, default=0.0
    )
    focal_length_slope: float = parameter(
        "relative, standard deviation at the begin",
        unit=core.Unit("K-1"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    principal_slope: float = parameter(
        "pixel / kelvin along each axis, standard deviation at the begin",
        limit=NON_NEGATIVE,
        default=0.0,
    )
    map: int = parameter(
        "nodes along each side of a map of local distortion; 0: none",
        limit=core.Range(0, 9),
        default=0,
    )
    map_sigma: float = parameter(
        "pixel per axis, standard deviation of a node at the begin", limit=NON_NEGATIVE, default=0.1
    )
    map_walk: float = parameter(
        "pixel / second^(1/2), of a node per axis", limit=NON_NEGATIVE, default=0.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.map == 1:
            raise core.Refused("map must be 0 or at least 2, got 1")

    def sigma(self, camera: Camera) -> Floats:
        """Initial sigma (16 + 2 map^2,) of UNKNOWNS, of their slopes, and of the nodes' x and y."""
        slopes = np.zeros(COUNT)
        slopes[0] = self.focal_length_slope * camera.focal_length_px
        slopes[1:3] = self.principal_slope
        nodes = np.full(2 * self.map**2, self.map_sigma)
        return np.concatenate([self.prior.sigma(camera), slopes, nodes])

    def walk(self, camera: Camera) -> Floats:
        """Standard deviation (16 + 2 map^2,) of the change in a second, in the order of `sigma`."""
        walk = np.zeros(2 * COUNT + 2 * self.map**2)
        walk[0] = self.focal_length_walk * camera.focal_length_px
        walk[1:3] = self.principal_walk
        walk[2 * COUNT :] = self.map_walk
        return walk


@core.printed
@dataclass(frozen=True, eq=False)
class KnownCamera:
    """The estimate of a camera after some frames.

    camera      camera at the reference temperature, with the map as its residual
    slope       (8,) slopes of UNKNOWNS, 1 / kelvin
    covariance  (16 + 2 k, 16 + 2 k) of UNKNOWNS, their slopes, and x and y of k nodes; zero for a
                fixed one
    nodes       (k, 2) pixel, places of the nodes of the map
    """

    camera: Camera
    slope: Floats
    covariance: Floats
    nodes: Annotated[Floats, core.Unit("pixel")] = field(default_factory=lambda: np.zeros((0, 2)))

    def at(self, warmer: float) -> Camera:
        """The camera at a temperature, kelvin above the reference."""
        return moved_camera(self.camera, EVERY, warmer * self.slope)

    def moved(self, step: Floats) -> KnownCamera:
        """The estimate after a step (16 + 2 k,) of all unknowns, with unchanged covariance."""
        camera, nodes = moved_camera(self.camera, EVERY, step[:COUNT]), self.nodes
        if len(nodes):
            nodes = nodes + step[2 * COUNT :].reshape(2, -1).T
            shape = core.map_displacement(camera.columns, camera.rows, nodes)
            camera = replace(camera, residual=shape)
        return replace(self, camera=camera, slope=self.slope + step[COUNT : 2 * COUNT], nodes=nodes)

    def later(self, settings: CameraFilter, step: float) -> KnownCamera:
        """The estimate some seconds later; the camera may have changed in this time."""
        walked = np.diag(settings.walk(self.camera) ** 2 * step)
        return replace(self, covariance=self.covariance + walked)


def first_camera(camera: Camera, settings: CameraFilter) -> KnownCamera:
    """The estimate of a camera before the first frame."""
    nodes = np.zeros((settings.map**2, 2))
    covariance = np.diag(settings.sigma(camera) ** 2)
    return KnownCamera(camera, np.zeros(COUNT), covariance, nodes)


def after_frame(
    known: KnownCamera,
    settings: CameraFilter,
    spots: Spots,
    matches: Matches,
    step: float = 0.0,
    warmer: float = 0.0,
) -> KnownCamera:
    """The estimate after one more frame; the frame's attitude is eliminated.

        P^-1 <- (P + Q step)^-1 + H' S H,   H = [1, warmer 1, weights of the nodes]

    with the normal equations S of the camera's unknowns without the attitude, as in `calibrate`,
    and with its weights against false matches.

    step     second, time since the previous frame
    warmer   kelvin, temperature above the reference temperature
    Returns  the estimate; with too few matched stars, only the change with time is applied
    Accuracy  model: errors of centroids are independent from frame to frame. Errors that last at a
              place of the field, beyond the map and `prior.floor`, make the covariance too small.
    """
    known = known.later(settings, step)
    if len(matches) < FEWEST:
        return known
    # In units of the prior, so that the numbers of all unknowns have similar sizes.
    scale = settings.sigma(known.camera)
    free = np.flatnonzero(scale > 0)
    scale = scale[free]
    before = np.linalg.inv(known.covariance[np.ix_(free, free)] / np.outer(scale, scale))
    view = _view(known, warmer)[:, free] * scale
    frame, moved = MatchedFrame(spots, matches), np.zeros(len(free))
    more, full = _slopes_of_nodes(known, frame), np.zeros(len(known.covariance))
    there, normal = known, before
    for _ in range(STEPS):
        block = frame.normal(there.at(warmer), EVERY, settings.prior.floor, more)
        normal = before + view.T @ block.schur @ view
        change = np.linalg.solve(normal, view.T @ block.right - before @ moved)
        frame.turn(block.attitude(view @ change))
        moved = moved + change
        full[free] = moved * scale
        there = known.moved(full)
    covariance = np.zeros_like(known.covariance)
    covariance[np.ix_(free, free)] = np.linalg.inv(normal) * np.outer(scale, scale)
    return replace(there, covariance=covariance)


def attitude_doubt(
    known: KnownCamera, settings: CameraFilter, spots: Spots, matches: Matches, warmer: float = 0.0
) -> Floats:
    """Covariance (3, 3) radian^2 of a frame's attitude, caused by the uncertainty of the camera.

        D = A V P V' A',   V = [1, warmer 1, weights of the nodes]

    A are the derivatives of the least-squares attitude by the camera. `known` must be the estimate
    before this frame.

    Returns  zero if too few stars are matched
    Accuracy  model: the attitude is the least-squares attitude with the frame's weights and a fixed
              focal length.
    """
    if len(matches) < FEWEST:
        return np.zeros((3, 3))
    frame, view = MatchedFrame(spots, matches), _view(known, warmer)
    block = frame.normal(
        known.at(warmer), EVERY, settings.prior.floor, _slopes_of_nodes(known, frame)
    )
    return block.turned_by(view @ known.covariance @ view.T)


def _view(state: KnownCamera, warmer: float) -> Floats:
    """Matrix (8 + 2 k, 16 + 2 k) from all unknowns to those that one frame sees."""
    nodes = 2 * len(state.nodes)
    view = np.zeros((COUNT + nodes, 2 * COUNT + nodes))
    view[:COUNT, :COUNT], view[:COUNT, COUNT : 2 * COUNT] = np.eye(COUNT), warmer * np.eye(COUNT)
    view[COUNT:, 2 * COUNT :] = np.eye(nodes)
    return view


def _slopes_of_nodes(state: KnownCamera, frame: MatchedFrame) -> Floats | None:
    """Derivatives (n, 2, 2 k) of the stars' places by x and y of the nodes; None without a map."""
    if not len(state.nodes):
        return None
    camera, count = state.camera, len(state.nodes)
    weight = core.map_weights(camera.columns, camera.rows, frame.pixel, math.isqrt(count))
    slopes = np.zeros((len(weight), 2, 2 * count))
    slopes[:, 0, :count], slopes[:, 1, count:] = weight, weight
    return slopes
