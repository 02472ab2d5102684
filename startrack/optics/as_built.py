"""Surfaces of a lens -> displacements of stars by small alignment errors of its elements."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Camera, Floats, Ints, Refused, node_places
from startrack.optics.lens_family import family_surfaces, open_family
from startrack.optics.lens_table import lens_path, open_lens
from startrack.optics.parameters import Optics
from startrack.optics.surfaces import AIR, Surfaces, meet, open_surfaces, refracted

SHIFT, TURN = 1e-6, 1e-5  # metre and radian, steps of an element for its slopes
RINGS = ((0.0, 1), (0.45, 6), (0.8, 12))  # radius in the stop and number of the rays of a star
INWARD = 0.8  # factor on the field angle if a ray misses a surface
KINDS = ("decentre", "tilt", "wedge")


class ElementSlopes(NamedTuple):
    """Displacements of stars by an alignment error of one metre or radian, along x or y.

    kind   (k,) index into KINDS
    slope  (2 n, k) pixel per metre (decentre) or per radian, at the nodes of a `Displacement`: all
           x before all y
    """

    kind: Ints
    slope: Floats


class BuiltLens(NamedTuple):
    """A lens, and a camera with three digits, so that all units of a design share slopes.

    changed  nanosecond, time of the last change of the file
    """

    file: str
    changed: int
    family: str
    focal_length: float
    f_number: float
    camera: Camera


def built_lens(optics: Optics, family: str, camera: Camera) -> BuiltLens:
    """The lens of a camera.

    family  lens family that gives the slopes, scaled to this size, if `optics` has no lens table
    camera  camera without a residual
    """
    size, f_number = (float(f"{value:.3g}") for value in (optics.focal_length, optics.f_number))
    name = optics.lens_family or ("" if optics.lens_file else family)
    alike = _rounded(camera.columns, camera.rows, float(f"{camera.focal_length_px:.3g}"))
    file = optics.lens_file
    changed = lens_path(file).stat().st_mtime_ns if file else 0
    return BuiltLens(file, changed, name, size, f_number, alike)


@lru_cache(maxsize=8)
def _rounded(columns: int, rows: int, focal_length_px: float) -> Camera:
    return Camera(columns, rows, focal_length_px)


def element_slopes(lens: BuiltLens) -> ElementSlopes:
    """Slopes of the places of stars by decentre, tilt and wedge of each element of a lens.

    A cemented group is decentred and tilted as one piece, about its middle. A wedge is a tilt of
    the last surface of a piece of glass about its vertex. The place of a star is the mean of its
    rays; other elements, the stop and the detector do not move.

    Raises  Refused if no surfaces of a lens are known.
    Accuracy  model: one wavelength; no vignetting; a lens faster than the traced one has the slopes
              of the traced one. numerical: 1e-4 of the slopes. For errors of 20 um and 1 arcmin,
              chief rays move as in optiland within 2 % and 0.05 um.
    """
    surfaces = _surfaces(lens)
    camera = lens.camera
    direction = camera.unproject(node_places(camera.columns, camera.rows))
    tangent = direction[:, :2] / direction[:, 2:]
    kinds, off = _elements(surfaces)
    moved = _places(surfaces, tangent, off)
    step = np.array([SHIFT, TURN, TURN])[kinds]
    slope = (moved[1:] - moved[0]) / step[:, None, None]
    pixel = camera.focal_length_px / lens.focal_length
    return ElementSlopes(kinds, pixel * slope.transpose(2, 1, 0).reshape(-1, len(kinds)))


def _surfaces(lens: BuiltLens) -> Surfaces:
    if lens.file:
        table, stored = open_lens(lens.file), open_surfaces(lens_path(lens.file))
    elif lens.family:
        table = open_family(lens.family)
        stored = family_surfaces(lens.family, table.focal_length, table.f_number)
    else:
        raise Refused(
            "residual.family must name a family of lenses if decentre, tilt or wedge is not 0 "
            "and optics have neither lens_file nor lens_family, got ''"
        )
    if stored is None:
        raise Refused(f"{lens.file} must hold SURFACES of its lens for decentre, tilt and wedge")
    faster = min(table.f_number / lens.f_number, 1.0)
    return stored.scaled(lens.focal_length / table.focal_length, faster)


def _elements(surfaces: Surfaces) -> tuple[Ints, Floats]:
    """Kind (k,) of each alignment error, and its effect on each surface.

    Returns  kinds, and (k + 1, s, 4): shift in x and y (metre), rotation of the normal towards x
             and y (radian), for a step of each error; the first entry is without error
    """
    vertex = surfaces.vertex[:-1]
    groups: list[tuple[int, int]] = []
    for first, last in surfaces.elements:
        if groups and first != last and groups[-1][1] == first:
            groups[-1] = (groups[-1][0], last)
        else:
            groups.append((first, last))
    kinds, rows = list[int](), [np.zeros((len(surfaces), 4))]
    for axis in range(2):
        for first, last in groups:
            span = slice(first, last + 1)
            shifted, turned = np.zeros((2, len(surfaces), 4))
            shifted[span, axis] = SHIFT
            turned[span, axis] = TURN * (vertex[span] - vertex[span].mean())
            turned[span, 2 + axis] = TURN
            kinds += [0, 1]
            rows += [shifted, turned]
        for first, last in surfaces.elements:
            if surfaces.index[first] > AIR and first != last:
                wedged = np.zeros((len(surfaces), 4))
                wedged[last, 2 + axis] = TURN
                kinds.append(2)
                rows.append(wedged)
    return np.array(kinds), np.stack(rows)


def _places(surfaces: Surfaces, tangent: Floats, off: Floats) -> Floats:
    """Places (k, n, 2) metre of stars at tangents (n, 2), for each alignment error (k, s, 4)."""
    tangent, pupil = tangent.copy(), _pupil()
    for _ in range(20):
        placed = _traced(surfaces, tangent, pupil, off)
        lost = ~np.isfinite(placed).all(axis=(0, 2))
        if not lost.any():
            return placed
        tangent[lost] *= INWARD
    raise Refused("a lens must image its field, but rays meet no surface")


def _pupil() -> Floats:
    angle = [np.arange(count) * 2 * np.pi / count for _, count in RINGS]
    return np.concatenate(
        [
            radius * np.column_stack([np.cos(turn), np.sin(turn)])
            for (radius, _), turn in zip(RINGS, angle, strict=True)
        ]
    )


def _traced(surfaces: Surfaces, tangent: Floats, pupil: Floats, off: Floats) -> Floats:
    axis, chief = surfaces.heights()
    beam = float(surfaces.radius[surfaces.stop] / abs(axis[surfaces.stop]))
    start = chief[0] * tangent[:, None] + beam * pupil  # (n, r, 2), at the first vertex
    shape = (3, len(off), *start.shape[:2])
    point = np.zeros(shape)
    point[:2] = start.transpose(2, 0, 1)[:, None]
    ray = np.ones((3, len(tangent)))
    ray[:2] = tangent.T
    ray = np.broadcast_to((ray / np.linalg.norm(ray, axis=0))[:, None, :, None], shape)
    vertex, before = surfaces.vertex, surfaces.index_before
    with np.errstate(invalid="ignore", divide="ignore"):
        for at in range(len(surfaces)):
            x, y, p, q = off[:, at].T[:, :, None, None]
            origin = np.stack([x, y, np.full_like(x, vertex[at])])
            point, ray = _turned(point - origin, p, q), _turned(ray, p, q)
            point, normal = meet(point, ray, surfaces.curvature[at])
            if surfaces.mirror[at]:
                ray = ray - 2 * (ray * normal).sum(axis=0) * normal
            else:
                ray = refracted(ray, normal, before[at] / surfaces.index[at])
            point, ray = _turned(point, -p, -q) + origin, _turned(ray, -p, -q)
        point = point + (vertex[-1] - point[2]) / ray[2] * ray
    return point[:2].mean(axis=-1).transpose(1, 2, 0)


def _turned(vector: Floats, p: Floats, q: Floats) -> Floats:
    """Vectors in the axes of a surface whose normal is tilted by small angles towards x and y."""
    x, y, z = vector
    return np.stack([x - p * z, y - q * z, z + p * x + q * y])
