"""Residual: displacements of a unit's stars that no camera model describes, by their causes."""

import numpy as np
from scipy.linalg import lstsq
from scipy.spatial import distance

from startrack import core
from startrack.core import (
    FINITE,
    NODES,
    NON_NEGATIVE,
    Floats,
    Ints,
    Parameters,
    Range,
    Unit,
    kept,
    parameter,
)
from startrack.optics.as_built import KINDS, BuiltLens, built_lens, element_slopes
from startrack.optics.parameters import Optics

PER_AXIS = "rms of each element along either axis"


class Residual(Parameters):
    """Displacements over the frame that no camera model of a tracker describes before calibration.

        displacement = s f(seed) + drift temperature g(seed) + flatness h(seed) tan(incidence)
                       + sum over elements of their slopes times decentre, tilt and wedge
        s^2 = rms^2 + (angle focal length)^2 + (grid / pitch)^2

    f, g and h are normal random fields with the correlation exp(-(d / scale)^2 / 2) over a distance
    d. From f and g, the part that a camera model or an attitude could absorb is removed (a
    rotation, focal length, principal point, k1, k2, p1 and p2). Then they have an rms of 1 per axis
    over the frame. The displacements by the elements of a lens as built are computed with rays
    through its surfaces (`element_slopes`). Only a rotation is removed from them, because the
    camera is aligned after its assembly. The calibration of the unit absorbs the displacements of
    its order.

    Accuracy  model: light meets the detector at the field angle, as for an exit pupil at a distance
              of one focal length.
    """

    rms: float = parameter("pixel, per axis, over the frame", limit=NON_NEGATIVE, default=0.0)
    angle: float = parameter(
        "rms per axis over the frame, as an angle on the sky",
        unit=Unit("rad", "arcsec"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    grid: float = parameter(
        "rms per axis on the detector: errors of the grid of its pixels",
        unit=Unit("m", "um"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    flatness: float = parameter(
        "rms deviation of the detector's surface from a plane; it displaces oblique light",
        unit=Unit("m", "um"),
        limit=NON_NEGATIVE,
        default=0.0,
    )
    scale: float = parameter(
        "correlation length over half the diagonal of the frame", limit=Range(0.05, 10), default=0.3
    )
    drift: float = parameter(
        "pixel per kelvin: rms of the change with temperature", limit=NON_NEGATIVE, default=0.0
    )
    temperature: float = parameter(
        "temperature above the one without drift", unit=Unit("K"), limit=FINITE, default=0.0
    )
    decentre: float = parameter(PER_AXIS, unit=Unit("m", "um"), limit=NON_NEGATIVE, default=0.0)
    tilt: float = parameter(PER_AXIS, unit=Unit("rad", "arcmin"), limit=NON_NEGATIVE, default=0.0)
    wedge: float = parameter(PER_AXIS, unit=Unit("rad", "arcmin"), limit=NON_NEGATIVE, default=0.0)
    family: str = parameter(
        "lens_family that stands for the lens, if the optics have no lens table", default=""
    )
    seed: int = parameter(
        "seed of the random residual of one unit; 0: no residual, as in the unit as designed",
        limit=Range(0, 2**63 - 1),
        default=0,
    )

    def smooth(self, camera: core.Camera, pitch: float) -> float:
        """Pixel, s in the equation of the class."""
        parts = self.rms, self.angle * camera.focal_length_px, self.grid / pitch
        return float(np.linalg.norm(parts))

    @property
    def of_elements(self) -> Floats:
        """Rms of decentre, tilt and wedge (3,), metre or radian, in the order of KINDS."""
        return np.array([getattr(self, kind) for kind in KINDS])

    def field(self, camera: core.Camera, optics: Optics, pitch: float) -> core.Displacement | None:
        """The displacements over a camera's frame; None without displacements.

        pitch     metre, of a pixel
        Raises    Refused if elements have alignment errors but the lens is unknown.
        Accuracy  numerical: displacements are interpolated between the nodes of a `Displacement`.
        """
        if not self.seed:
            return None
        value, root = np.zeros((2, NODES**2)), _root(camera, self.scale)
        parts = [
            ("residual", self.smooth(camera, pitch), root),
            ("residual, by temperature", self.drift * self.temperature, root),
        ]
        if self.flatness:
            height = _oblique(camera, self.scale) * (self.flatness / pitch)
            parts.append(("flatness", 1.0, height))
        if self.of_elements.any():
            parts.append(("elements", 1.0, self._elements(camera, optics)))
        for name, size, matrix in parts:
            if size:
                draw = core.Streams(self.seed, 0)(name).standard_normal(matrix.shape[1])
                value += size * (matrix @ draw).reshape(2, -1)
        if not value.any():
            return None
        return core.Displacement(camera.columns, camera.rows, tuple(value.ravel().tolist()))

    def _elements(self, camera: core.Camera, optics: Optics) -> Floats:
        """Matrix (2 n, k) from normal numbers to the displacement by the elements."""
        kind, slope = _turned_back(built_lens(optics, self.family, camera))
        return slope * self.of_elements[kind]

    def law(
        self,
        camera: core.Camera,
        optics: Optics,
        pitch: float,
        order: int,
        tangential: bool,
        nodes: int,
    ) -> Floats:
        """Root of the covariance of the field after a calibration, before it is drawn.

        From flatness and elements, a rotation and the parameters that the calibration fits are
        removed. From all parts, the field that the calibration's map absorbs is removed. Drift is
        unknown and left out.

        order, tangential, nodes  as `order`, `tangential` and `map` of `tracker.calibration`; order
                                  0: no calibration, only a rotation is removed
        Returns   (33, 33, 2, k) pixel, x and y at places that span the frame, row by row; the
                  covariance of two places is the product of theirs over the k modes
        Accuracy  numerical: a thousandth of the variance is left out.
        """
        parts, other = list[Floats](), list[Floats]()
        if (smooth := self.smooth(camera, pitch)) and nodes:
            other.append(smooth * _root(camera, self.scale))
        elif smooth:
            parts.append(smooth * _on_lattice(camera, _root(camera, self.scale)))
        if self.flatness:
            other.append(_oblique(camera, self.scale) * (self.flatness / pitch))
        if self.of_elements.any():
            other.append(self._elements(camera, optics))
        if other:
            known = [True] * 3 + [order > 0] * 3 + [order >= 3, order >= 5] + [tangential] * 2
            place = core.node_places(camera.columns, camera.rows)
            model = taken_up(camera, place)[:, known]
            if nodes:
                both = np.kron(
                    np.eye(2), core.map_weights(camera.columns, camera.rows, place, nodes)
                )
                model = np.concatenate([model, both], axis=1)
            parts.append(_on_lattice(camera, _without(model, np.concatenate(other, axis=1))))
        return np.concatenate(parts, axis=-1) if parts else np.zeros((LATTICE, LATTICE, 2, 1))


@kept(8)
def _turned_back(lens: BuiltLens) -> tuple[Ints, Floats]:
    """`ElementSlopes` without the part that a rotation could absorb."""
    kind, slope = element_slopes(lens)
    camera = lens.camera
    turns = taken_up(camera, core.node_places(camera.columns, camera.rows))[:, :3]
    return kind, _without(turns, slope)


LATTICE = 33  # places along each side of the law's table
LEFT_OUT = 1e-3  # fraction of the variance in modes that the table lacks; chosen by hand


def _on_lattice(camera: core.Camera, root: Floats) -> Floats:
    """The largest modes of a root (2 n, m) at the nodes, at the places of a law's table."""
    mode, size, _ = np.linalg.svd(root, full_matrices=False)
    left = 1 - np.cumsum(size**2) / (size**2).sum()
    count = int((left > LEFT_OUT).sum()) + 1
    x = np.linspace(-0.5, camera.columns - 0.5, LATTICE)
    y = np.linspace(-0.5, camera.rows - 0.5, LATTICE)
    place = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    values = [
        core.Displacement(camera.columns, camera.rows, tuple(column.tolist()))(place)
        for column in (mode[:, :count] * size[:count]).T
    ]
    return np.stack(values, axis=-1).reshape(LATTICE, LATTICE, 2, count)


def _root(camera: core.Camera, scale: float) -> Floats:
    """Matrix (2 n, 2 n) from normal numbers to the field at its n nodes, all x before all y.

    The part of the field that a camera model could absorb is removed; then the field is scaled to
    an expected rms of one.
    """
    # Rounded, so that most units share a root.
    return _root_of(camera.columns, camera.rows, float(f"{camera.focal_length_px:.1e}"), scale)


@kept(8)
def _root_of(columns: int, rows: int, focal: float, scale: float) -> Floats:
    both = np.asarray(np.kron(np.eye(2), _smooth(columns, rows, scale)), float)
    camera = core.Camera(columns, rows, focal)
    root = _without(taken_up(camera, core.node_places(columns, rows)), both)
    weight = _weight()
    size = np.sqrt(weight @ (root**2).sum(axis=1) / weight.sum())
    return np.asarray(root / size)


def _oblique(camera: core.Camera, scale: float) -> Floats:
    """Matrix (2 n, n) from normal numbers to the displacement, for a height of rms one."""
    height = _smooth(camera.columns, camera.rows, scale)
    slope = (core.node_places(camera.columns, camera.rows) - camera.centre) / camera.focal_length_px
    return np.concatenate([slope[:, :1] * height, slope[:, 1:] * height])


def _smooth(columns: int, rows: int, scale: float) -> Floats:
    """Symmetric matrix (n, n) from normal numbers to a field of variance one at the nodes.

    The symmetric root is used because it is unique. Evenly spaced places have equal eigenvalues,
    and the combinations of their eigenvectors depend on the processor.
    """
    length = scale * np.hypot(columns, rows) / 2
    apart = distance.squareform(distance.pdist(core.node_places(columns, rows)))
    value, vector = np.linalg.eigh(np.exp(-((apart / length) ** 2) / 2))
    return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)) @ vector.T)


def _weight() -> Floats:
    """Weights (2 n,) of the nodes: nodes at the edges have half of the area of others."""
    line = np.ones(NODES)
    line[[0, -1]] = 0.5
    return np.tile(np.outer(line, line).ravel(), 2)


def _without(model: Floats, root: Floats) -> Floats:
    """A root (2 n, m) without the part that columns of a model (2 n, k) could absorb.

    Columns are scaled, and solved without a singular value decomposition, which need not converge.
    """
    weight = np.sqrt(_weight())[:, None]
    scaled = weight * model / np.linalg.norm(weight * model, axis=0)
    taken, *_ = lstsq(scaled, weight * root, cond=1e-9, lapack_driver="gelsy")
    return np.asarray(root - scaled @ taken / weight)


def taken_up(camera: core.Camera, place: Floats) -> Floats:
    """Displacements (2 n, 10) of places (n, 2) by a rotation and by the parameters of a camera.

    All x come before all y. The columns, on any scale, are three rotations, focal length, principal
    point (for a narrow field nearly equal to two of the rotations), k1, k2, p1, p2.
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
