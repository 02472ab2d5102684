"""Residual: what the places of stars differ by from any camera model, a random field of a unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.spatial import distance

from startrack.core import (
    FINITE,
    NODES,
    NON_NEGATIVE,
    Camera,
    Displacement,
    Floats,
    Parameters,
    Range,
    Streams,
    Unit,
    kept,
    node_places,
)


@dataclass(frozen=True)
class Residual(Parameters):
    """A smooth field of displacements over the frame, which no camera model of a tracker has.

        displacement = rms f(seed) + drift temperature g(seed)

    of two normal random fields f and g with the correlation exp(-(d / scale)^2 / 2) over a distance
    d, without the part that a camera model or an attitude could take up: a turn, focal length,
    principal point, k1, k2, p1 and p2; and of rms 1 per axis over the frame.
    """

    rms: Annotated[float, NON_NEGATIVE, "pixel, per axis, over the frame"] = 0.0
    scale: Annotated[float, Range(0.05, 10),
        "correlation length over half the diagonal of the frame"] = 0.3  # fmt: skip
    drift: Annotated[float, NON_NEGATIVE,
        "pixel per kelvin: rms of the change with temperature"] = 0.0  # fmt: skip
    temperature: Annotated[float, Unit("K"), FINITE,
        "above that at which the field is f alone"] = 0.0  # fmt: skip
    seed: Annotated[int, Range(0, 2**63 - 1),
        "of the two fields of one unit; 0: of the unit as designed, which has none"
    ] = 0  # fmt: skip

    def field(self, camera: Camera) -> Displacement | None:
        """The displacements over a camera's frame; None where there are none.

        Accuracy  numerical: between the nodes of a `Displacement`.
        """
        shift = self.drift * self.temperature
        if not (self.seed and (self.rms or shift)):
            return None
        value = np.zeros((2, NODES**2))
        focal = float(f"{camera.focal_length_px:.1e}")  # so that most units share a root
        root = _root(camera.columns, camera.rows, focal, self.scale)
        for size, name in ((self.rms, "residual"), (shift, "residual, by temperature")):
            if size:
                draw = Streams(self.seed, 0)(name).standard_normal(2 * NODES**2)
                value += size * (root @ draw).reshape(2, -1)
        return Displacement(camera.columns, camera.rows, tuple(value.ravel().tolist()))


LATTICE = 33  # places along each side of the law's table
LEFT_OUT = 1e-3  # of the variance, in the modes that the table lacks; chosen by hand


@kept(8)
def residual_law(camera: Camera, scale: float) -> Floats:
    """Root of the covariance of a field of rms one, as it is known before it is drawn.

    camera   of the frame, without a residual
    scale    1, of `Residual`
    Returns  (33, 33, 2, k) pixel, x and y at places that span the frame, row by row; the covariance
             of two places is the product of theirs over the k modes
    Accuracy  numerical: a thousandth of the variance is left out.
    """
    focal = float(f"{camera.focal_length_px:.1e}")
    mode, size, _ = np.linalg.svd(_root(camera.columns, camera.rows, focal, scale))
    left = 1 - np.cumsum(size**2) / (size**2).sum()
    count = int((left > LEFT_OUT).sum()) + 1
    x = np.linspace(-0.5, camera.columns - 0.5, LATTICE)
    y = np.linspace(-0.5, camera.rows - 0.5, LATTICE)
    place = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    values = [
        Displacement(camera.columns, camera.rows, tuple(column.tolist()))(place)
        for column in (mode[:, :count] * size[:count]).T
    ]
    return np.stack(values, axis=-1).reshape(LATTICE, LATTICE, 2, count)


@kept(8)
def _root(columns: int, rows: int, focal: float, scale: float) -> Floats:
    """Matrix (2 n, 2 n) from normal numbers to the field at its n nodes, all x before all y.

    Of the field, the part that a camera model could take up is removed before it is scaled to an
    expected rms of one. The nodes at the edges count by the half, and those in the corners by a
    quarter of the area of others.
    """
    place = node_places(columns, rows)
    length = scale * np.hypot(columns, rows) / 2
    apart = distance.squareform(distance.pdist(place))
    value, vector = np.linalg.eigh(np.exp(-((apart / length) ** 2) / 2))
    smooth = vector * np.sqrt(np.maximum(value, 0.0))
    root = np.kron(np.eye(2), smooth)
    line = np.ones(NODES)
    line[[0, -1]] = 0.5
    weight = np.tile(np.outer(line, line).ravel(), 2)
    model = taken_up(Camera(columns, rows, focal), place)
    normal = model.T @ (weight[:, None] * model)
    root = (
        root - model @ np.linalg.lstsq(normal, model.T @ (weight[:, None] * root), rcond=1e-12)[0]
    )
    size = np.sqrt(weight @ (root**2).sum(axis=1) / weight.sum())
    return np.asarray(root / size)


def taken_up(camera: Camera, place: Floats) -> Floats:
    """Displacements (2 n, 10) of places (n, 2) by a turn and by the parameters of a camera.

    All x before all y; on any scale, of the columns 1: three turns, focal length, principal point
    (of which two are all but turns of a narrow field), k1, k2, p1, p2.
    """
    half = np.hypot(camera.columns, camera.rows) / 2
    x, y = (place - camera.centre).T / half
    r2, none = x * x + y * y, np.zeros(len(place))
    slope = half / camera.focal_length_px
    columns = [
        (1 + (slope * x) ** 2, slope**2 * x * y),
        (slope**2 * x * y, 1 + (slope * y) ** 2),
        (-y, x),
        (x, y),
        (1 + none, none),
        (none, 1 + none),
        (x * r2, y * r2),
        (x * r2**2, y * r2**2),
        (2 * x * y, r2 + 2 * y * y),
        (r2 + 2 * x * x, 2 * x * y),
    ]
    return np.concatenate(np.array(columns).transpose(1, 2, 0))
