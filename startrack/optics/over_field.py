"""Optics -> Psf at points of the field, where aberrations grow with the distance to the axis."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from startrack.core import Floats, Psf
from startrack.optics.parameters import Optics
from startrack.optics.pixel_psf import pixel_psf
from startrack.optics.zernike import Aberration, nm_to_noll, noll_to_nm


def at_field(optics: Optics, x: float, y: float) -> Optics:
    """The optics for a star at a field angle.

    A term that grows is given for a star along +x: rms (angle / field_edge)^growth. At the azimuth
    phi it is rotated, by the symmetry of a lens of revolution:

        (cos, sin) -> (c cos(m phi) - s sin(m phi), c sin(m phi) + s cos(m phi))

    x, y     radian, field angles along the columns and the rows
    Returns  optics with constant aberrations alone
    """
    height, azimuth = math.hypot(x, y) / optics.field_edge, math.atan2(y, x)
    terms: dict[int, float] = defaultdict(float)
    for each in optics.aberrations:
        rms = each.rms * height**each.growth if each.growth else each.rms
        n, m = noll_to_nm(each.noll)
        turn = abs(m) * azimuth if each.growth else 0.0
        if m < 0:
            turn += math.pi / 2  # a sine is a cosine shifted by a quarter of its period
        if m == 0:
            terms[each.noll] += rms
        else:
            terms[nm_to_noll(n, abs(m))] += rms * math.cos(turn)
            terms[nm_to_noll(n, -abs(m))] += rms * math.sin(turn)
    # The cosine of a quarter turn is rounding, not an aberration.
    least = 1e-12 * max((abs(rms) for rms in terms.values()), default=0.0)
    kept = tuple(Aberration(noll, rms) for noll, rms in sorted(terms.items()) if abs(rms) > least)
    return replace(optics, aberrations=kept)


def over_field(
    optics: Optics, angles: Sequence[tuple[float, float]], pitch: float,
    wavelength: Floats, weight: Floats, fill_factor: float = 1.0, diffusion: float = 0.0,
) -> tuple[Psf, ...]:  # fmt: skip
    """One Psf for each field angle; the other arguments are those of `pixel_psf`.

    angles  radian, field angles (x, y)
    """
    return tuple(
        pixel_psf(at_field(optics, x, y), pitch, wavelength, weight, fill_factor, diffusion)
        for x, y in angles
    )
