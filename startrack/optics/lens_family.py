"""Family, focal length, f-number -> the LensTable of a lens of that family."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Refused
from startrack.io import shipped
from startrack.optics.lens_table import LensTable, open_lens
from startrack.optics.pupil import noll_to_nm, zernike
from startrack.optics.surfaces import Surfaces, open_surfaces

WIDER = 1.5  # largest field over the field of the traced lens
NARROWER = 0.5
COMPLEXITY = 0.5  # exponent of the growth of the number of elements


class Family(NamedTuple):
    """Lenses of one shape.

    lens     the traced lens, of the catalogue of lenses
    fastest  smallest f-number to which its aberrations are extrapolated
    """

    lens: str
    fastest: float


FAMILIES = {
    "double-gauss": Family("double_gauss", 1.2),  # six elements about a stop, two of them cemented
    "petzval": Family("petzval", 1.2),  # two spaced positive groups and a field flattener
    "cooke-triplet": Family("triplet", 2.4),  # three spaced elements
    "catadioptric": Family("catadioptric", 2.5),  # Maksutov's meniscus and mirror, prime focus
}


@lru_cache(maxsize=32)
def family_table(name: str, f_number: float, field: float | None = None) -> LensTable:
    """The lens of a family, in the size of the traced lens; the design scales it and stops it down.

    A slower lens is the traced lens, stopped down. A faster or wider lens has other aberrations. At
    the same place of the pupil and of the field, each Zernike term (n, m) of the wavefront W (in
    length) becomes

        W' = s^n [W(0) + q^k (W(h) - W(0))],   k = max(m, 4 - n, 2 if m = 0),  h = field / edge

    s is the traced f-number over the new one; q is the tangent of the new edge of the field over
    the traced one. These are the lowest orders of each aberration by Seidel (spherical aberration
    s^4, coma s^3 q, astigmatism and curvature s^2 q^2), for the focus of the traced lens. The terms
    of the amplitude of the light in the pupil are multiplied by s^n q^m. The tilt keeps the chief
    ray in place. Distortion grows as q^2; lateral colour does not grow. The pupil is s times as
    wide, with the vignetting at the same h, and the area is s^2 times as large. All lengths,
    including the wavefront, scale with the focal length.

    name      one of FAMILIES
    f_number  1; the table is for this f-number, or for the traced one if that is faster
    field     radian, half field for which the lens is made; None: the field of the traced lens
    Raises    ValueError for another name, for a lens faster than the family's fastest, or for a
              field outside half to one and a half times the traced field.
    Accuracy  model: catalogs/lenses/README.md states the error of the wavefront's rms: tables that
              were scaled from f-numbers 1.2 to 1.4 times as large are compared with rays through
              the prescription itself. A lens designed for the speed is better, a lens with worse
              glass is worse. Thermal defocus scales like a defocus.
    """
    family = _family(name)
    table = open_lens(family.lens)
    if f_number < family.fastest * (1 - 1e-6):
        raise Refused(
            f"f_number must be at least {family.fastest:g} in the lens_family {name}, got "
            f"{f_number:g}"
        )
    wider = _wider(name, table, field)
    faster = max(table.f_number / f_number, 1.0)
    if faster == wider == 1.0:
        return table
    return scaled_table(table, faster, wider)


def family_surfaces(
    name: str, focal_length: float, f_number: float, field: float | None = None
) -> Surfaces:
    """The surfaces of a lens of a family, with the clear apertures that its beams need.

    Raises  as `family_table`.
    """
    family = _family(name)
    table = open_lens(family.lens)
    stored = open_surfaces(shipped(f"lenses/{family.lens}.fits"))
    assert stored is not None  # shipped tables have surfaces
    return stored.scaled(
        focal_length / table.focal_length, table.f_number / f_number, _wider(name, table, field)
    )


def element_count(name: str, f_number: float, field: float | None = None) -> float:
    """Number of elements of a lens of a family; a faster or wider lens than the traced needs more.

        elements = traced elements * max(1, s q)^(1 / 2)

    Accuracy  model: lenses of 50 mm have six at f/2, seven at f/1.4, eight at f/1.2.
    """
    table = open_lens(_family(name).lens)
    more = max(table.f_number / f_number, 1.0) * _wider(name, table, field)
    elements = len(family_surfaces(name, table.focal_length, table.f_number).elements)
    return elements * max(more, 1.0) ** COMPLEXITY


def scaled_table(table: LensTable, faster: float, wider: float) -> LensTable:
    """A table at another aperture and field, by the orders of its aberrations: `family_table`."""
    order = np.array([noll_to_nm(j) for j in table.noll.tolist()])
    n, m = order.T
    power = np.maximum(np.maximum(np.abs(m), 4 - n), np.where(m == 0, 2, 1))
    axis = table.wavefront[:, :, :1]
    wavefront = (axis + (table.wavefront - axis) * wider**power) * faster**n
    terms = slice(table.amplitude.shape[-1])
    amplitude = table.amplitude * faster ** n[terms] * wider ** m[terms]
    wavefront = _without_moving_chief(table, wavefront, faster)
    angle = np.arctan(np.tan(table.field) * wider)
    place = _distorted(table, wider)
    pupil = table.pupil.copy()
    stop, clear = table.pupil[..., :3], table.pupil[..., 3:]
    pupil[..., 0] = stop[..., 0] * wider
    pupil[..., 3] = stop[..., 0] * wider + (clear[..., 0] - stop[..., 0]) * faster
    pupil[..., (1, 2, 4, 5)] *= faster
    return LensTable(
        name=f"{table.name}, {faster:.4g} times as fast and {wider:.4g} times as wide",
        source=table.source,
        focal_length=table.focal_length,
        f_number=table.f_number / faster,
        temperature=table.temperature,
        wavelength=table.wavelength,
        field=angle,
        noll=table.noll,
        wavefront=wavefront,
        place=place,
        pupil=pupil,
        outline=table.outline,
        area=table.area * faster**2,
        amplitude=amplitude,
        curvature=table.curvature,
    )


def _without_moving_chief(table: LensTable, wavefront: Floats, faster: float) -> Floats:
    """The terms, with a tilt that keeps the slope of the ray through the middle of the stop."""
    step = 1e-4
    at = np.array([step, -step]), np.zeros(2)
    slope = np.array([float(np.diff(-zernike(j, *at))[0]) for j in table.noll.tolist()]) / 2 / step
    tilt = table.noll.tolist().index(2) if 2 in table.noll else None
    if tilt is None:
        return wavefront
    wanted = (table.wavefront @ slope) * faster
    wavefront[..., tilt] += (wanted - wavefront @ slope) / slope[tilt]
    return wavefront


def _distorted(table: LensTable, wider: float) -> Floats:
    """Metre, places at the scaled field angles."""
    ideal = table.focal_length * np.tan(table.field[1:])
    relative = table.place[..., 1:] / ideal - 1
    # Towards the axis only lateral colour remains.
    nearer = np.tan(table.field[1:3]) ** 2
    if len(nearer) > 1:
        bend = (relative[..., 1] - relative[..., 0]) / (nearer[1] - nearer[0])
        colour = (relative[..., 0] - bend * nearer[0])[..., None]
    else:
        colour = relative[..., :1]
    place = ideal * wider * (1 + colour + (relative - colour) * wider**2)
    return np.concatenate([table.place[..., :1], place], axis=-1)


def open_family(name: str) -> LensTable:
    """The traced lens of a family.

    Raises  ValueError for another name.
    """
    return open_lens(_family(name).lens)


def _family(name: str) -> Family:
    if name not in FAMILIES:
        raise Refused(f"lens_family must be one of {', '.join(FAMILIES)}, got {name!r}")
    return FAMILIES[name]


def _wider(name: str, table: LensTable, field: float | None) -> float:
    if field is None:
        return 1.0
    edge = float(table.field[-1])
    wider = float(np.tan(field) / np.tan(edge))
    if not NARROWER * (1 - 1e-9) <= wider <= WIDER * (1 + 1e-9):
        low, high = (np.degrees(np.arctan(np.tan(edge) * factor)) for factor in (NARROWER, WIDER))
        raise Refused(
            f"family_field must lie in [{low:.3g}, {high:.3g}] deg in the lens_family {name}, got "
            f"{np.degrees(field):.3g} deg"
        )
    return wider
