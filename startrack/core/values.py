"""The values that are passed between rooms, with shape and unit of each array."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.spatial.transform import Rotation

from startrack.core.arrays import Flags, Floats, Ints, Singles
from startrack.core.camera import Camera
from startrack.core.printing import printed
from startrack.core.units import Unit


@printed
@dataclass(frozen=True, eq=False)
class Stars:
    """Stars of the sky.

    identifier   (n,) Gaia DR3 source_id, or minus the Hipparcos number
    direction    (n, 3) unit vectors, ICRS axes
    magnitude_g  (n,) magnitude in Gaia's G band (Vega)
    colour       (n,) magnitude BP - RP; NaN where unknown
    """

    identifier: Ints
    direction: Floats
    magnitude_g: Annotated[Floats, Unit("mag")]
    colour: Annotated[Floats, Unit("mag")]

    def __len__(self) -> int:
        return len(self.identifier)

    def find(self, identifier: Ints) -> tuple[Ints, Flags]:
        """Indices (m,) of the stars with these identifiers (m,), and whether each is there.

        The index of a missing star is arbitrary.
        """
        order = np.argsort(self.identifier, kind="stable")
        at = np.searchsorted(self.identifier, identifier, sorter=order)
        index = order[np.minimum(at, len(self) - 1)]
        return index, self.identifier[index] == identifier

    def __getitem__(self, choice: slice | Ints | Flags) -> Stars:
        return Stars(
            self.identifier[choice],
            self.direction[choice],
            self.magnitude_g[choice],
            self.colour[choice],
        )


@printed
@dataclass(frozen=True, eq=False)
class DiffuseLight:
    """Light that varies over the frame: a spectrum times a map.

    spectrum  (k,) photon / s / m^2 / sr in each spectral bin
    fraction  (p, q) 1, at points evenly spaced from the centre of the frame's first pixel to that
              of its last, row by row; linear between them
    """

    spectrum: Annotated[Floats, Unit("photon / s / m2 / sr")]
    fraction: Floats


@printed
@dataclass(frozen=True, eq=False)
class StrayLightSource:
    """A body whose light reaches the detector as stray light.

    direction          (n, 3) unit vectors to its parts, ICRS axes
    fraction           (n,) 1, of `photon_irradiance` that comes from each part
    photon_irradiance  (k,) photon / s / m^2 in each spectral bin
    """

    direction: Floats
    fraction: Floats
    photon_irradiance: Annotated[Floats, Unit("photon / s / m2")]


@printed
@dataclass(frozen=True, eq=False)
class Light:
    """Light at the entrance pupil, of point sources and of the background.

    direction          (n, 3) unit vectors to the point sources, ICRS axes
    wavelength         (k,) metre, centres of the spectral bins
    photon_irradiance  (n, k) photon / s / m^2 of each point source in each spectral bin
    background         (k,) photon / s / m^2 / sr in each spectral bin, uniform over the field
    diffuse            further light, which varies over the field
    stray_sources      bodies whose light reaches the detector as stray light
    """

    direction: Floats
    wavelength: Annotated[Floats, Unit("m", "nm")]
    photon_irradiance: Annotated[Floats, Unit("photon / s / m2")]
    background: Annotated[Floats, Unit("photon / s / m2 / sr")]
    diffuse: tuple[DiffuseLight, ...] = ()
    stray_sources: tuple[StrayLightSource, ...] = ()


EMPTY = np.empty(0)
NO_BEND = np.array([np.inf])
# Of the peak, by which a table may differ from the product of its middle lines.
PRODUCT_TOLERANCE = 1e-14


class PsfTable(NamedTuple):
    """The tables of a PSF, arranged for the kernels.

    The pixels of a star are `oversampling` samples apart. So a star is the sum of 36 images, one
    for each interpolation weight, whose pixels are neighbours when the table is sorted by strides.

    strides       (oversampling, oversampling, k) 1, for each first row and column of samples: the
                  pixels row by row, `across` of them in a row; of the first table
    several       (tables, oversampling, oversampling, k) float32, of all tables of a FieldPsf
    bend          (tables,) 1, error of straight lines between the samples of each table of a
                  FieldPsf; infinite otherwise
    line, column  (m,) along x and along y, whose product is the only table; empty otherwise
    samples       along a side of a table
    oversampling  samples per pixel
    across        pixels of a side of the table, rounded up
    """

    strides: Floats
    several: Singles
    bend: Floats
    line: Floats
    column: Floats
    samples: int
    oversampling: int
    across: int


def arranged(tables: Floats, oversampling: int, several: bool) -> PsfTable:
    """Tables (k, m, m) of a PSF for the kernels; `several`: of a FieldPsf."""
    side, step = tables.shape[-1], oversampling
    across = -(-side // step)
    if several:
        lines, bend = (EMPTY, EMPTY), np.array([_bend(table) for table in tables])
        all_tables = _by_strides(tables, step, across, np.float32)
    else:
        lines, bend = _separate(tables[0]), NO_BEND
        all_tables = np.empty((0, step, step, across * (across + 2)), np.float32)
    strides = _by_strides(tables[:1], step, across, np.float64)[0]
    return PsfTable(strides, all_tables, bend, *lines, side, step, across)


def _by_strides(tables: Floats, step: int, across: int, kind: DTypeLike) -> NDArray[Any]:
    """Tables (k, m, m) as `PsfTable.several`, filled up with zeros."""
    count, side, _ = tables.shape
    padded = np.zeros((count, across * step, across * step), kind)
    padded[:, :side, :side] = tables
    strides = padded.reshape(count, across, step, across, step).transpose(0, 2, 4, 1, 3)
    # Kernels read whole rows, also from the last pixels on.
    room = np.zeros((count, step, step, across * (across + 2)), kind)
    room[..., : across**2].reshape(count, step, step, across, across)[:] = strides
    return room


def _bend(table: Floats) -> float:
    """Largest error of straight lines between samples: an eighth of the second differences."""
    bends = (np.diff(table, 2, axis=axis) for axis in (0, 1))
    return sum(max(float(bend.max()), -float(bend.min())) for bend in bends) / 8


def _separate(table: Floats) -> tuple[Floats, Floats]:
    """The line (along x) and the column of which the table is the product, if it is one."""
    middle = table.shape[0] // 2
    line, column, peak = table[middle], table[:, middle], table[middle, middle]
    alike = (
        peak > 0
        and np.abs(np.outer(column, line) - table * peak).max() <= PRODUCT_TOLERANCE * peak**2
    )
    return (line / np.sqrt(peak), column / np.sqrt(peak)) if alike else (EMPTY, EMPTY)


@printed
@dataclass(frozen=True, eq=False)
class Psf:
    """The image of a point, integrated over pixels.

    table         (m, m) 1, fraction of the energy that falls into a pixel whose centre lies at
                  ((column - m // 2) / oversampling, (row - m // 2) / oversampling) pixel from
                  the point's image
    oversampling  samples per pixel
    energy        1, fraction of the star's energy inside the box of the table
    """

    table: Floats
    oversampling: int
    energy: float

    @property
    def half_width(self) -> float:
        """Pixel, from the centre of the table to its edge."""
        return (self.table.shape[0] // 2) / self.oversampling

    @cached_property
    def arranged(self) -> PsfTable:
        """The table for the kernels."""
        return arranged(self.table[None], self.oversampling, several=False)


@printed
@dataclass(frozen=True, eq=False)
class LineOfSight:
    """Motion of the line of sight in one exposure.

    time      (m,) second from the middle of the exposure
    weight    (m,) 1, fraction of the exposure of each point; sums to 1
    rotation  (m, 3) radian, rotation vector of icrs_to_camera at `time` times the inverse of that
              at the middle, in camera axes: apparent rotation of the sky
    """

    time: Annotated[Floats, Unit("s", "ms")]
    weight: Floats
    rotation: Annotated[Floats, Unit("rad", "arcsec")]


@printed
@dataclass(frozen=True, eq=False)
class Frame:
    """A digital image, and the meaning of its numbers (NaN where unknown).

    image             (rows, columns) digital number
    exposure          second
    electrons_per_dn  electron per digital number
    offset            digital number of an empty pixel
    read_noise        electron rms
    time              second since 2000-01-01 UTC without leap seconds, as the file is stamped
    excess_noise      1, variance of the detected light over its mean, of a multiplication register
    """

    image: NDArray[np.number]
    exposure: float = float("nan")
    electrons_per_dn: float = float("nan")
    offset: float = 0.0
    read_noise: float = float("nan")
    time: float = float("nan")
    excess_noise: float = 1.0

    @property
    def noise_gain(self) -> float:
        """Digital number of light over its variance, 1 / digital number.

        Electron per digital number where no register multiplies the electrons.
        """
        return self.electrons_per_dn / self.excess_noise

    @property
    def _rows(self) -> list[tuple[str, str]]:
        rows = [("size", f"{self.image.shape[1]} x {self.image.shape[0]} pixels")]
        rows += [("type", str(self.image.dtype))]
        if self.image.size:
            rows += [("values", f"{self.image.min():g} to {self.image.max():g} DN")]
        properties = (
            ("exposure", 1e3 * self.exposure, "ms"),
            ("gain", self.electrons_per_dn, "e-/DN"),
            ("offset", self.offset, "DN"),
            ("read noise", self.read_noise, "e- rms"),
        )
        return rows + [
            (name, f"{value:.4g} {unit}") for name, value, unit in properties if value == value
        ]


@printed
@dataclass(frozen=True, eq=False)
class Spots:
    """Spots that the detection found, brightest first.

    x, y        (n,) pixel, column and row of the centroid
    flux        (n,) digital number above the background
    covariance  (n, 2, 2) pixel^2, of (x, y)
    snr         (n,) 1, flux over its standard deviation
    area        (n,) pixel, size of the connected component
    """

    x: Annotated[Floats, Unit("pixel")]
    y: Annotated[Floats, Unit("pixel")]
    flux: Annotated[Floats, Unit("DN")]
    covariance: Annotated[Floats, Unit("pixel2")]
    snr: Floats
    area: Ints

    def __len__(self) -> int:
        return len(self.x)


class Status(StrEnum):
    """End of an identification or of an attitude. A sky that cannot be solved is data."""

    SOLVED = "solved"
    AMBIGUOUS = "ambiguous"
    TOO_FEW = "too few stars"
    NO_MATCH = "no match"
    BLANK = "blank image"


@printed
@dataclass(frozen=True, eq=False)
class Matches:
    """Catalogue star of each matched spot.

    status             solved, or why not
    reason             one sentence
    spot               (m,) index into the spots
    star               (m,) index into the tracker's catalogue
    direction          (m, 3) unit vectors of these stars, ICRS axes
    camera             the tracker's camera, its focal length refined if it was allowed to be
    icrs_to_camera     first attitude, None if there is none
    false_probability  bound on the probability that chance alone made such a match
    """

    status: Status
    reason: str
    spot: Ints
    star: Ints
    direction: Floats
    camera: Camera
    icrs_to_camera: Rotation | None
    false_probability: float

    def __len__(self) -> int:
        return len(self.spot)


@printed
@dataclass(frozen=True, eq=False)
class Estimate:
    """The attitude that the tracker reports.

    status             solved, or why not
    reason             one sentence
    icrs_to_camera     attitude, None if there is none
    covariance         (3, 3) radian^2, of the small rotation about the camera's axes
    residual_rms       pixel, root mean square over both axes of the stars used
    stars              number of used stars
    false_probability  as in Matches
    used               (stars,) indices into the matches; None: not known
    """

    status: Status
    reason: str
    icrs_to_camera: Rotation | None
    covariance: Annotated[Floats, Unit("rad2", "arcsec2")]
    residual_rms: Annotated[float, Unit("pixel")]
    stars: int
    false_probability: float
    used: Ints | None = None
