"""Text that Zemax saves -> a PsfFile of Huygens PSFs, a LensTable of wavefront maps."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused, positive
from startrack.io import decoded, read_bytes, with_points
from startrack.optics.lens_table import LensTable
from startrack.optics.psf_file import LARGEST, SMALLEST, PsfFile
from startrack.optics.pupil import even_terms, zernike

TERMS = 37  # largest Noll index of a wavefront
MOST_BYTES = 100_000_000
ROOM = 293.15  # kelvin
BAND = (300e-9, 1100e-9)  # metre, range that one wavelength represents
WIDE = 0.1  # radian, largest difference of fields for one field angle
NUMBER = r"[-+]?[0-9]*[.,]?[0-9]+(?:[eE][-+]?[0-9]+)?"
MICRO = r"(?:u|[^\sA-Za-z]{1,2})m|[Mm]icrons?|[Mm]icrometers?"  # in any encoding
PLAIN = re.compile(r"[-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?")
# One wavelength or a range, at a field of one or two angles.
WAVE = re.compile(
    rf"({NUMBER})(?:\s*(?:to|-)\s*({NUMBER}))?\s*(?:{MICRO})\s+at\s+({NUMBER})(?:[,;]?\s+({NUMBER}))?"
    r"\s*\((\w+)\)"
)
SPACING = re.compile(rf"[Dd]ata spacing is\s+({NUMBER})\s*([^\s.,;]*)")
VALUES = re.compile(r"[Vv]alues are\s+([^\n.,]*)")
OTHER_VALUES = re.compile(r"\b(?:log|db\b|real|imag|phase|ampl)", re.IGNORECASE)
CENTRE = re.compile(rf"[Cc]enter coordinates\s*:?\s*({NUMBER})[,;]?\s+({NUMBER})\s*(\w+)")
MILLIMETRES = {"millimeters": 1e-3, "centimeters": 1e-2, "inches": 25.4e-3, "meters": 1.0}
POINT = re.compile(r"[Cc]enter point is:?\s*(?:row\s*)?(\d+),\s*(?:col(?:umn)?\s*)?(\d+)")


class _Page(NamedTuple):
    """One saved page: wavelength (metre) and field angle (radian); x runs off the axis.

    path     of its file
    data     (n, n) numbers, the middle at n // 2
    spacing  metre, spacing of a PSF; 0: a wavefront in waves, NaN outside the pupil
    place    metre, distance of the middle from the axis; None if the page does not state it
    band     metre, first and last wavelength; `wavelength` is their middle
    """

    path: Path
    wavelength: float
    angle: float
    data: Floats
    spacing: float
    place: float | None
    band: tuple[float, float]


def holds_wavefronts(paths: Sequence[Path]) -> bool:
    """Whether pages are wavefront maps, not PSFs. Exceptions are those of `psfs_of_pages`."""
    return _pages(paths)[0].spacing == 0


def psfs_of_pages(paths: Sequence[Path], source: str) -> PsfFile:
    """Images from pages of Huygens PSFs, one for each wavelength and field (0, y).

    The first row of numbers has the largest y.

    Raises  OSError; ValueError if a page is invalid, or the set is not complete.
    """
    pages = _pages(paths)
    waves, angles, of = _nodes(pages)
    spacings = {page.spacing for page in pages}
    if len(spacings) > 1 or len({page.data.shape for page in pages}) > 1:
        raise Refused("all pages must have one spacing and size")
    if len(waves) > 1 and any(page.band[0] != page.band[1] for page in pages):
        raise Refused("pages must be of one wavelength each, or all of one range of wavelengths")
    image = np.array([[of[w, a].data for a in angles] for w in waves])
    places = [[of[w, a].place for a in angles] for w in waves]
    placed = all(place is not None for row in places for place in row) and len(angles) > 1
    return PsfFile(
        source,
        image,
        spacings.pop(),
        pixel=False,
        pitch=None,
        energy=1.0,
        wavelength=np.array(waves),
        angle=np.array(angles),
        place=np.array(places, float) if placed else None,
    )


def table_of_pages(
    paths: Sequence[Path],
    focal_length: float,
    f_number: float,
    name: str,
    source: str,
    flipped: bool = False,
) -> tuple[LensTable, Floats]:
    """The lens table of pages of wavefront maps, one for each wavelength and field (0, y).

    Its terms to Noll 37, even across the field, are fitted by least squares over the open pupil. A
    map is positive if the path is longer than the path of the chief ray. A single wavelength
    represents all wavelengths from 300 to 1100 nm, with the same path. A single field angle
    represents all angles to 0.1 radian.

    focal_length, f_number  metre, 1, of the lens
    flipped                 whether maps are positive if the path is shorter
    Raises    OSError; ValueError if a page is invalid, or the set is not complete.
    Returns   the table, and the residual rms (w, f) in waves of its wavefronts after the terms
    Accuracy  model: a round pupil without vignetting, distortion and lateral colour, because the
              maps do not contain them.
    """
    positive(focal_length=focal_length, f_number=f_number)
    pages = _pages(paths)
    waves, angles, of = _nodes(pages)
    noll = even_terms(TERMS)
    fits = [[_terms(of[w, a].data, noll) for a in angles] for w in waves]
    terms = np.array([[fit[0] for fit in row] for row in fits]) * np.reshape(waves, (-1, 1, 1))
    left = np.array([[fit[1] for fit in row] for row in fits])
    field, wavelength = np.array(angles), np.array(waves)
    if len(field) == 1:
        field, terms = np.array([0.0, WIDE]), np.repeat(terms, 2, axis=1)
    if len(wavelength) == 1:
        wavelength, terms = np.array(BAND), np.repeat(terms, 2, axis=0)
    shape = len(wavelength), len(field)
    place = np.broadcast_to(focal_length * np.tan(field), shape).copy()
    half, zero = np.full(shape, 0.5 / f_number), np.zeros(shape)
    area = np.full(shape, math.pi / 4 * (focal_length / f_number) ** 2)
    table = LensTable(
        name=name,
        source=source,
        focal_length=focal_length,
        f_number=f_number,
        temperature=np.array([ROOM]),
        wavelength=wavelength,
        field=field,
        noll=np.array(noll),
        wavefront=(-terms if flipped else terms)[None],
        place=place[None],
        pupil=np.stack([zero, half, half] * 2, axis=-1)[None],
        outline=np.zeros((1, *shape, 0)),
        area=area[None],
        amplitude=np.zeros((1, *shape, 0)),
        curvature=zero[None],
    )
    return table, left


def _terms(waves: Floats, noll: Sequence[int]) -> tuple[Floats, float]:
    """Terms of a map of waves, and the residual rms after these terms."""
    inside, axis = np.isfinite(waves), np.arange(len(waves)) - len(waves) // 2
    across, down = np.meshgrid(axis, axis)
    radius = max(float(np.hypot(across, down)[inside].max()), 1.0)
    u, v = across[inside] / radius, down[inside] / radius
    shapes = np.column_stack([np.ones_like(u), *(zernike(j, u, v) for j in noll)])
    terms = np.linalg.lstsq(shapes, waves[inside], rcond=None)[0]
    return np.asarray(terms[1:], float), float((waves[inside] - shapes @ terms).std())


def _nodes(
    pages: Sequence[_Page],
) -> tuple[list[float], list[float], dict[tuple[float, float], _Page]]:
    of = dict[tuple[float, float], _Page]()
    for page in pages:
        first = of.setdefault((page.wavelength, page.angle), page)
        if first is not page:
            raise Refused(
                f"pages must differ in wavelength or field, but {first.path} and {page.path} are "
                f"both for {page.wavelength * 1e6:g} um at {math.degrees(page.angle):g} deg"
            )
    waves, angles = (sorted({key[k] for key in of}) for k in (0, 1))
    for w in waves:
        for a in angles:
            if (w, a) not in of:
                raise Refused(
                    "a page must be given for each wavelength and field, but none is for "
                    f"{w * 1e6:g} um at {math.degrees(a):g} deg"
                )
    return waves, angles, of


def _pages(paths: Sequence[Path]) -> list[_Page]:
    pages = [_page(path) for path in paths]
    if len({page.spacing == 0 for page in pages}) > 1:
        raise Refused("all pages must be of one kind, Huygens PSFs or wavefront maps")
    return pages


def _page(path: Path) -> _Page:
    text = decoded(read_bytes(path, "text saved by Zemax", MOST_BYTES), path)
    wave = WAVE.search(text)
    is_psf, is_map = "Huygens PSF" in text[:2000], "avefront" in text[:2000]
    if not wave or is_psf == is_map:
        raise Refused(
            f"{path} must be a Huygens PSF or a wavefront map, saved by Zemax as text, with its "
            "wavelength, or range of wavelengths, and its field"
        )
    if wave[5] != "deg":
        raise Refused(f"{path} must have its field in degree (deg), got {wave[5]}")
    first, last = _number(wave[1]), _number(wave[2] or wave[1])
    # A field of one angle is along y, as usual for a lens of revolution.
    across, along = (_number(wave[3]), _number(wave[4])) if wave[4] else (0.0, _number(wave[3]))
    if across or along < 0:
        raise Refused(
            f"{path} must have a field (0, y) with y not negative, got ({across:g}, {along:g})"
        )
    rows = [[with_points(word) for word in line.split()] for line in text.splitlines()]
    rows = [row for row in rows if len(row) >= SMALLEST and all(map(PLAIN.fullmatch, row))]
    side = max((len(row) for row in rows), default=0)
    rows = [row for row in rows if len(row) == side]
    if len(rows) != side or not SMALLEST <= side <= LARGEST:
        raise Refused(
            f"{path} must hold a square of {SMALLEST} to {LARGEST} numbers a side, got "
            f"{len(rows)} rows of {side}"
        )
    data = np.array(rows, float)
    point = POINT.search(text)
    row, column = (int(point[1]), int(point[2])) if point else (side // 2 + 1, side // 2 + 1)
    data = _about(data[::-1].T, column - 1, side - row)
    angle, band = math.radians(along), (first * 1e-6, last * 1e-6)
    wavelength = (band[0] + band[1]) / 2
    if is_map:
        if first != last:
            raise Refused(f"{path} must be a wavefront map of one wavelength, got a range")
        return _Page(
            path=path,
            wavelength=wavelength,
            angle=angle,
            data=np.where(data == 0, np.nan, data),
            spacing=0.0,
            place=None,
            band=band,
        )
    spacing, centre = SPACING.search(text), CENTRE.search(text)
    if not spacing:
        raise Refused(f"{path} must say its data spacing")
    if not re.fullmatch(MICRO, spacing[2]):
        got = spacing[2] or "no unit"
        raise Refused(f"{path} must have its data spacing in micrometre, got {got}")
    values = VALUES.search(text)
    if values and OTHER_VALUES.search(values[1]):
        raise Refused(f"{path} must hold intensities, got {values[1].strip()}")
    place = None
    if centre:
        if centre[3].lower() not in MILLIMETRES:
            raise Refused(f"{path} must have its centre in millimetre, got {centre[3]}")
        place = _number(centre[2]) * MILLIMETRES[centre[3].lower()]
    return _Page(
        path=path,
        wavelength=wavelength,
        angle=angle,
        data=data,
        spacing=_number(spacing[1]) * 1e-6,
        place=place,
        band=band,
    )


def _number(text: str) -> float:
    return float(with_points(text))


def _about(data: Floats, row: int, column: int) -> Floats:
    """The largest square with an odd side around a sample."""
    side = len(data)
    half = min(row, column, side - 1 - row, side - 1 - column)
    if half < SMALLEST // 2:
        raise Refused(f"the centre point must lie within the data, got {row}, {column}")
    return data[row - half : row + half + 1, column - half : column + half + 1]
