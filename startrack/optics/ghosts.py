"""Light -> Light: ghosts of bright sources by two reflections in the lens, as diffuse light."""

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import (
    Camera,
    DiffuseLight,
    Floats,
    Light,
    Parameters,
    Range,
    Refused,
    parameter,
)
from startrack.optics.lens_family import family_surfaces
from startrack.optics.lens_table import lens_path, open_lens
from startrack.optics.parameters import Optics
from startrack.optics.surfaces import AIR, Surfaces, meet, open_surfaces, refracted, replace_part

PART = "GHOSTS"
GRID = 33  # number of traced rays across the beam
FAINTEST = 1e-3  # irradiance over the brightest ghost of a source; fainter ghosts are left out
FRONT = 1.1  # half side of the grid over the clear radius of the first surface
WIDEST = math.radians(60)  # from the axis, limit for a source
PARTS = 12  # parts of a cell between traced rays, along a side
NODES = 20  # nodes of a map across half of a ghost
COARSEST = 64  # pixel, largest distance between nodes


class Ghosts(Parameters):
    """Reflections that make ghosts."""

    coating: float = parameter(
        "reflectance of each surface between glass and air", limit=Range(0, 1), default=0.005
    )
    detector: float = parameter("reflectance of the detector", limit=Range(0, 1), default=0.1)
    sources: int = parameter(
        "number of the brightest point sources that make ghosts, beside Sun, Moon and Earth",
        limit=Range(1, 10_000),
        default=10,
    )


class Pair(NamedTuple):
    """A pair of reflections, and its ghost by paraxial optics.

    first, second  surfaces, in the order of the reflections; the number after the last surface is
                   the detector
    width          1, radius of the disc on the detector over the radius of the beam before the lens
    place          metre, distance of its middle from the axis for a field angle whose tangent is 1
    reflectance    1, product of both reflectances
    """

    first: int
    second: int
    width: float
    place: float
    reflectance: float

    @property
    def irradiance(self) -> float:
        """Irradiance on the detector over irradiance before the lens: reflectance / width^2."""
        return self.reflectance / max(self.width**2, 1e-12)


def full_surfaces(optics: Optics) -> Surfaces | None:
    """The surfaces of a design's lens in the design's size, full open; None if unknown.

    A lens of a family has the clear apertures that its beams need at the design's f-number.
    """
    if optics.lens_family:
        return family_surfaces(
            optics.lens_family, optics.focal_length, optics.f_number, optics.family_field
        )
    stored = open_surfaces(lens_path(optics.lens_file)) if optics.lens_file else None
    if stored is None:
        return None
    return stored.scaled(optics.focal_length / open_lens(optics.lens_file).focal_length)


def lens_surfaces(optics: Optics) -> Surfaces:
    """The surfaces of a design's lens, in the design's size, stopped down and focused.

    Raises  ValueError if they are unknown.
    """
    made = full_surfaces(optics)
    if made is None:
        raise Refused("ghosts must be left out if no lens table has SURFACES of the lens")
    if not optics.lens_family:
        radius = made.radius.copy()
        radius[made.stop] *= min(open_lens(optics.lens_file).f_number / optics.f_number, 1.0)
        made = replace(made, radius=radius)
    if made.mirror.any():
        raise Refused("ghosts must be left out if the lens has a mirror")
    thickness = made.thickness.copy()
    thickness[-1] += optics.defocus
    return replace(made, thickness=thickness)


def reflectances(surfaces: Surfaces, ghosts: Ghosts) -> Floats:
    """Reflectance (s + 1,) of each surface and of the detector.

    Between two glasses by Fresnel, ((n' - n) / (n' + n))^2; zero for a diaphragm.
    """
    before, after = surfaces.index_before, surfaces.index
    glasses = (before > AIR) & (after > AIR)
    bare = ((after - before) / (after + before)) ** 2
    coated = np.where(glasses, bare, ghosts.coating)
    return np.append(np.where(np.abs(after - before) > 1e-6, coated, 0.0), ghosts.detector)


def pairs(surfaces: Surfaces, ghosts: Ghosts) -> tuple[Pair, ...]:
    """All pairs of reflections, the brightest on the axis first.

    They are computed by products of the matrices of surfaces and spaces along the path of the
    light: forwards, backwards after the first reflection, and forwards again.
    """
    reflectance = reflectances(surfaces, ghosts)
    entry = float(surfaces.heights()[1][0])  # metre at the first vertex, of the ray of slope 1
    bright = []
    for first in range(1, len(surfaces) + 1):
        for second in range(first):
            both = float(reflectance[first] * reflectance[second])
            if both:
                matrix = _folded(surfaces, first, second)
                place = matrix[0, 0] * entry + matrix[0, 1]
                bright.append(Pair(first, second, abs(matrix[0, 0]), float(place), both))
    return tuple(sorted(bright, key=lambda pair: -pair.irradiance))


def _steps(count: int, first: int, second: int) -> list[tuple[int, bool, bool]]:
    """Steps in order: surface, whether it reflects, whether the light comes from the front.

    The detector ends the list, unless it reflects.
    """
    forward = [(at, False, True) for at in range(first)]
    back = [(at, False, False) for at in range(first - 1, second, -1)]
    again = [(at, False, True) for at in range(second + 1, count)]
    return [*forward, (first, True, True), *back, (second, True, False), *again]


def _folded(surfaces: Surfaces, first: int, second: int) -> Floats:
    """Matrix (2, 2) from height and slope before the lens to those on the detector."""
    count = len(surfaces)
    before, vertex = surfaces.index_before, surfaces.vertex
    curvature = np.append(surfaces.curvature, 0.0)
    matrix, at = np.eye(2), 0.0
    for surface, reflects, front in _steps(count, first, second):
        space = vertex[surface] - at
        at = float(vertex[surface])
        if reflects:
            bend = np.array([[1.0, 0.0], [-2 * curvature[surface], -1.0]])
        else:
            here, there = before[surface], surfaces.index[surface]
            if not front:
                here, there = there, here
            power = (there - here) * curvature[surface]
            bend = np.array([[1.0, 0.0], [-power / there, here / there]])
        matrix = bend @ np.array([[1.0, space], [0.0, 1.0]]) @ matrix
    return np.array([[1.0, float(vertex[-1]) - at], [0.0, 1.0]]) @ matrix


class Beam(NamedTuple):
    """Rays of a source after two reflections.

    x, y  (n, n) metre on the detector; NaN for rays that miss a surface
    open  (n, n) 1, distance from the axis over the clear radius, largest over all surfaces met
    cell  square metre, area across the beam of each ray
    """

    x: Floats
    y: Floats
    open: Floats
    cell: float


def trace_ghost(surfaces: Surfaces, pair: Pair, direction: Floats) -> Beam:
    """Rays on a square grid before the lens, traced exactly through the folded path.

    direction  (3,) unit vector to the source in camera axes. In this function its rays run along
               this vector, because a lens inverts the image, and camera axes are those of the image
    Accuracy   model: spheres, the index of one wavelength, no polarisation.
    """
    count = len(surfaces)
    vertex, curvature = surfaces.vertex, np.append(surfaces.curvature, 0.0)
    before = np.append(surfaces.index_before, surfaces.index[-1])
    after = np.append(surfaces.index, 1.0)
    size = FRONT * float(surfaces.radius[0])
    axis = np.linspace(-size, size, GRID)
    across, down = np.meshgrid(axis, axis)
    point = np.stack([across, down, np.zeros_like(across)])
    ray = np.broadcast_to(np.asarray(direction, float)[:, None, None], point.shape).copy()
    worst = np.zeros_like(across)
    with np.errstate(invalid="ignore", divide="ignore"):
        for surface, reflects, front in _steps(count, pair.first, pair.second):
            point[2] -= vertex[surface]
            bend = curvature[surface]
            point, normal = meet(point, ray, bend)
            if surface < count:
                ratio = np.hypot(point[0], point[1]) / surfaces.radius[surface]
                worst = np.fmax(worst, ratio)
            if reflects:
                ray = ray - 2 * (ray * normal).sum(axis=0) * normal
            else:
                here, there = before[surface], after[surface]
                ray = refracted(ray, normal, here / there if front else there / here)
            point[2] += vertex[surface]
        point[2] -= vertex[-1]
        point, _ = meet(point, ray, 0.0)
    lost = ~np.isfinite(point).all(axis=0)
    cell = float(axis[1] - axis[0]) ** 2 * float(direction[2])
    return Beam(point[0], point[1], np.where(lost, 9.0, worst), cell)


def add_ghosts(
    light: Light,
    ghosts: Ghosts,
    optics: Optics,
    icrs_to_camera: Rotation,
    camera: Camera,
    pitch: float,
) -> Light:
    """The light with ghosts, as diffuse light of the same irradiance on the detector.

        radiance = irradiance of the source R1 R2 (beam / image) focal_length^2 / area

    for each small part of the beam and its image on the detector, as in `stray_light`.

    pitch     metre, side of a pixel
    Raises    ValueError if the surfaces of the lens are not known, or one is a mirror.
    Accuracy  model: two reflections; one wavelength; the coating's reflectance at all angles; pairs
              whose paraxial irradiance is below 1e-3 of a source's brightest pair, and sources
              beyond 60 deg, are left out; the absorption is that of the direct light. numerical:
              linear interpolation between traced rays, which are 1/32 of the beam apart.
    """
    surfaces = lens_surfaces(optics)
    reflections = pairs(surfaces, ghosts)
    kept = [pair for pair in reflections if pair.irradiance >= FAINTEST * reflections[0].irradiance]
    made = []
    for direction, spectrum in _sources(light, ghosts.sources):
        ahead = icrs_to_camera.apply(direction)
        if not ahead[2] > math.cos(WIDEST):
            continue
        maps = [ghost_map(surfaces, pair, ahead, camera, pitch, optics) for pair in kept]
        made += [DiffuseLight(spectrum, ghost) for ghost in _summed(maps)]
    return replace(light, diffuse=light.diffuse + tuple(made))


def _sources(light: Light, count: int) -> list[tuple[Floats, Floats]]:
    """Directions and irradiances of the brightest point sources, and of all bodies."""
    brightness = light.photon_irradiance.sum(axis=1)
    order = np.argsort(-brightness, kind="stable")[:count]
    sources = [(light.direction[at], light.photon_irradiance[at]) for at in order]
    for body in light.stray_sources:
        sources += [
            (direction, fraction * body.photon_irradiance)
            for direction, fraction in zip(body.direction, body.fraction, strict=True)
            if fraction > 0
        ]
    return sources


def ghost_map(
    surfaces: Surfaces, pair: Pair, direction: Floats, camera: Camera, pitch: float, optics: Optics
) -> Floats | None:
    """Fraction at nodes over the frame, as in `DiffuseLight`; None if no light falls there.

    Arguments as `add_ghosts`; direction as `trace_ghost`.
    """
    beam = trace_ghost(surfaces, pair, direction)
    across = beam.x / pitch + camera.centre[0]
    down = beam.y / pitch + camera.centre[1]
    passes = beam.open <= 1.2
    inside = passes & (np.abs(beam.x) < 1e3) & (np.abs(beam.y) < 1e3)
    if not inside.any():
        return None
    width = float(max(np.ptp(across[inside]), np.ptp(down[inside]))) / 2
    low = across[inside].min(), down[inside].min()
    high = across[inside].max(), down[inside].max()
    if low[0] > camera.columns or low[1] > camera.rows or high[0] < 0 or high[1] < 0:
        return None
    step = 2.0 ** math.floor(math.log2(min(max(width / NODES, 1.0), COARSEST)))
    columns, rows = (max(math.ceil((n - 1) / step) + 1, 2) for n in (camera.columns, camera.rows))
    counted = _counted(beam, across, down, (columns, rows), camera)
    node = ((camera.columns - 1) / (columns - 1)) * ((camera.rows - 1) / (rows - 1))  # pixel^2
    scale = pair.reflectance * beam.cell / PARTS**2 / node * camera.focal_length_px**2 / optics.area
    return counted * scale


def _counted(
    beam: Beam, across: Floats, down: Floats, shape: tuple[int, int], camera: Camera
) -> Floats:
    """Number of rays (rows, columns) near each node, from a grid PARTS times finer than traced."""
    columns, rows = shape
    along = (np.arange(PARTS) + 0.5) / PARTS
    weight = np.stack([1 - along, along])

    def finer(values: Floats) -> Floats:
        """(cells, PARTS, cells, PARTS) between the corners of each cell."""
        corner = np.stack(
            [
                np.stack([values[:-1, :-1], values[:-1, 1:]]),
                np.stack([values[1:, :-1], values[1:, 1:]]),
            ]
        )
        return np.einsum("abij,ap,bq->ipjq", corner, weight, weight)

    with np.errstate(invalid="ignore"):
        u, v, ratio = finer(across), finer(down), finer(beam.open)
        column = np.rint(u * ((columns - 1) / (camera.columns - 1)))
        row = np.rint(v * ((rows - 1) / (camera.rows - 1)))
        good = (ratio <= 1) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    at = row[good].astype(np.int64) * columns + column[good].astype(np.int64)
    counted = np.bincount(at, minlength=rows * columns).reshape(rows, columns).astype(float)
    # Nodes on the border are the middles of cells of which half lies outside the frame.
    counted[[0, -1]] *= 2
    counted[:, [0, -1]] *= 2
    return counted


def _summed(maps: list[Floats | None]) -> list[Floats]:
    """The sum of the maps of each shape."""
    sums: dict[tuple[int, ...], Floats] = {}
    for ghost in maps:
        if ghost is not None:
            sums[ghost.shape] = sums.get(ghost.shape, 0.0) + ghost
    return list(sums.values())


def save_ghosts(path: Path, surfaces: Surfaces) -> None:
    """Add the image GHOSTS to the FITS file of a lens table, or replace it.

    (g, 4): first and second surface, width and place of `Pair`; every pair of surfaces that differ
    in index, and the detector as the surface after the last.
    """
    rows = [pair[:4] for pair in pairs(surfaces, Ghosts(1.0, 1.0))]
    replace_part(path, PART, np.array(sorted(rows), float), "1, 1, 1, m")
