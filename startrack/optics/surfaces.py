"""Surfaces: radii, spaces, glasses and clear apertures of a lens, in the file of its table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from startrack.core import Floats, Refused, positive
from startrack.io import open_checked, whole
from startrack.optics.lens_table import FORMAT, kept_files

PART = "SURFACES"
COLUMNS = ("curvature", "thickness", "index", "radius", "mirror")
AIR = 1.05  # least index of a glass
CROWN, CROWN_INDEX, PER_INDEX = 2510.0, 1.5168, 8500.0  # kg / m^3; 1; kg / m^3
LIGHTEST = 2300.0  # kg / m^3
MIRROR_DENSITY = 2230.0  # kg / m^3


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Spherical surfaces of a lens, from the front to the last before the detector.

    curvature  (s,) 1 / metre, positive if the centre lies behind the surface
    thickness  (s,) metre along the axis to the next surface, from the last to the detector;
               negative after a mirror
    index      (s,) 1, after the surface; before the first is 1
    radius     (s,) metre, of the clear aperture
    mirror     (s,) whether the surface reflects
    stop       index of the stop
    """

    curvature: Floats
    thickness: Floats
    index: Floats
    radius: Floats
    mirror: Floats
    stop: int

    def __post_init__(self) -> None:
        count = len(self.curvature)
        if not 1 <= count <= 1000 or not 0 <= self.stop < count:
            raise Refused(f"surfaces must be 1 to 1000, one of them the stop, got {count}")
        for name in ("thickness", "index", "radius", "mirror"):
            if getattr(self, name).shape != (count,):
                raise Refused(f"{name} must have one number for each surface")
        table = np.concatenate([self.curvature, self.thickness, self.index, self.radius])
        if not np.isfinite(table).all():
            raise Refused("surfaces must hold finite numbers")
        positive(index=float(self.index.min()), radius=float(self.radius.min()))
        if (np.abs(self.curvature) * self.radius >= 1).any():
            raise Refused("radius of a clear aperture must be below the radius of its surface")

    def __len__(self) -> int:
        return len(self.curvature)

    @property
    def vertex(self) -> Floats:
        """Position along the axis (s + 1,), metre, of each surface and of the detector."""
        return np.concatenate([[0.0], np.cumsum(self.thickness)])

    @property
    def index_before(self) -> Floats:
        """Index (s,) before each surface."""
        return np.concatenate([[1.0], self.index[:-1]])

    def heights(self) -> tuple[Floats, Floats]:
        """Paraxial heights (s,) of a ray parallel to the axis and of a ray through the stop's
        middle.

        The first has a height of one metre before the lens; the second a field angle whose tangent
        is 1.
        """
        before, after = self.signed_index()
        matrix, rows = np.eye(2), []
        for at in range(len(self)):
            rows.append(matrix[0].copy())
            power = (after[at] - before[at]) * self.curvature[at]
            bend = np.array([[1.0, 0.0], [-power / after[at], before[at] / after[at]]])
            matrix = np.array([[1.0, self.thickness[at]], [0.0, 1.0]]) @ bend @ matrix
        height = np.array(rows)
        entry = -height[self.stop, 1] / height[self.stop, 0]  # of the chief ray at the first vertex
        return height[:, 0], height[:, 0] * entry + height[:, 1]

    def signed_index(self) -> tuple[Floats, Floats]:
        """Indices (s,) before and after each surface; negative if light runs backwards."""
        after = (-1.0) ** np.cumsum(self.mirror > 0)
        before = np.where(self.mirror > 0, -after, after)
        return self.index_before * before, self.index * after

    @property
    def elements(self) -> tuple[tuple[int, int], ...]:
        """First and last surface of each piece of glass, and of each mirror."""
        glass = [(at, at + 1) for at in range(len(self) - 1) if self.index[at] > AIR]
        return (*glass, *((at, at) for at in range(len(self)) if self.mirror[at]))

    def glass_mass(self) -> float:
        """Mass of all elements, kilogram, from their shapes.

        A mirror is of borosilicate glass, with a thickness of a sixth of its diameter.

        Accuracy  model: the edge of an element is the larger of its two clear apertures. The
                  density is 2510 kg / m^3 at the index of BK7, and 8500 more per unit of the index;
                  it fits 12 common glasses to 20 % (lead-free flints are lighter).
        """
        total = 0.0
        for first, last in self.elements:
            radius = float(max(self.radius[first], self.radius[last]))
            if first == last:
                total += np.pi * radius**3 / 3 * MIRROR_DENSITY
                continue
            front, back = (_cap(float(self.curvature[at]), radius) for at in (first, last))
            volume = np.pi * radius**2 * float(self.thickness[first]) - front + back
            density = CROWN + PER_INDEX * (float(self.index[first]) - CROWN_INDEX)
            total += max(volume, 0.0) * max(density, LIGHTEST)
        return total

    def length(self) -> float:
        """Length, metre, from the foremost vertex to the rearmost vertex or the detector."""
        return float(np.ptp(self.vertex))

    def scaled(self, size: float, faster: float = 1.0, wider: float = 1.0) -> Surfaces:
        """The same shape in another size, with clear apertures for other beams.

        A clear aperture is a sum of two terms: the height of the outermost axial ray, times
        `faster`, and the remainder for oblique beams, times `wider`.

        faster, wider  aperture and tangent of the field over those of this lens, at one focal
                       length
        """
        axis = np.abs(self.heights()[0])
        axis = axis * float(self.radius[self.stop]) / float(axis[self.stop])
        beam = np.minimum(axis, self.radius)
        radius = beam * faster + (self.radius - beam) * wider
        most = 0.98 / np.maximum(np.abs(self.curvature), 1e-9)  # a half sphere ends a surface
        return replace(
            self,
            curvature=self.curvature / size,
            thickness=self.thickness * size,
            radius=np.minimum(radius, most) * size,
        )


def _cap(curvature: float, radius: float) -> float:
    """Cubic metre between a surface and the plane through its vertex; the sign of the curvature."""
    bend = min(abs(curvature), 0.999 / radius)
    if bend == 0:
        return 0.0
    sphere = 1 / bend
    sag = sphere - np.sqrt(sphere**2 - radius**2)
    volume = np.pi * sag**2 * (sphere - sag / 3)
    # The volume between the plane and the cap, in the cylinder.
    return float(np.copysign(np.pi * radius**2 * sag - volume, curvature))


def meet(point: Floats, ray: Floats, curvature: float) -> tuple[Floats, Floats]:
    """Points at which rays meet a sphere whose vertex is the origin, and its unit normal there."""
    along = curvature * (point * ray).sum(axis=0) - ray[2]
    off = curvature * (point * point).sum(axis=0) - 2 * point[2]
    root = np.sqrt(along * along - curvature * off)
    distance = off / (-along + np.copysign(root, -along))
    met = point + distance * ray
    normal = curvature * met
    normal[2] -= 1
    return met, normal


def refracted(ray: Floats, normal: Floats, ratio: float) -> Floats:
    """Directions after a surface, by Snell's law; NaN for total reflection."""
    cosine = (ray * normal).sum(axis=0)
    root = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    return ratio * ray + (np.copysign(root, cosine) - ratio * cosine) * normal


def save_surfaces(path: Path, surfaces: Surfaces) -> None:
    """Add the image SURFACES to the FITS file of a lens table, or replace it.

    (s, 6): curvature, thickness, index, radius of the clear aperture, whether it reflects, whether
    it is the stop.
    """
    stop = np.zeros(len(surfaces))
    stop[surfaces.stop] = 1
    columns = [*(getattr(surfaces, name) for name in COLUMNS), stop]
    replace_part(path, PART, np.column_stack(columns), "1/m, m, 1, m, 1, 1")


def replace_part(path: Path, name: str, table: Floats, units: str) -> None:
    """Add an image with a name to the FITS file of a lens table, or replace it.

    units  units of the columns
    """
    from astropy.io import fits

    with open_checked(path, "LENS", FORMAT, "a lens table") as parts:
        kept = [part.copy() for part in parts if part.name != name]
    part = fits.ImageHDU(table, name=name)
    part.header["BUNIT"] = units
    with whole(Path(path)) as draft:
        fits.HDUList([*kept, part]).writeto(draft, checksum=True)


def load_surfaces(path: Path) -> Surfaces | None:
    """The surfaces of a lens table's file; None without surfaces.

    Raises  FileNotFoundError; ValueError if the file is not a lens table, or is damaged.
    """
    with open_checked(path, "LENS", FORMAT, "a lens table") as parts:
        if PART not in [part.name for part in parts]:
            return None
        table = np.array(parts[PART].data, float)
    if table.ndim != 2 or table.shape[1] != len(COLUMNS) + 1 or (table[:, -1] == 1).sum() != 1:
        raise Refused(f"{path}: SURFACES must have six columns and one stop")
    try:
        columns = dict(zip(COLUMNS, np.ascontiguousarray(table[:, :-1].T), strict=True))
        return Surfaces(**columns, stop=int(table[:, -1].argmax()))
    except ValueError as error:
        raise Refused(f"{path}: {error}") from None


open_surfaces = kept_files(load_surfaces)
