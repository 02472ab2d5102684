"""Zernike polynomials by Noll's index: the shapes of wavefront errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from scipy import special

from startrack.core import FINITE, Floats, Parameters, Range, Refused, Unit

MOST = 231  # Noll index of the last mode with n = 20


@dataclass(frozen=True)
class Aberration(Parameters):
    """One term of the wavefront error."""

    noll: Annotated[int, Range(1, MOST),
        "Noll's index: 4 defocus, 5 and 6 astigmatism, 7 and 8 coma, 11 spherical"]  # fmt: skip
    rms: Annotated[float, Unit("m", "nm"), FINITE,
        "over the clear circular aperture (at the edge of the field if it grows)"]  # fmt: skip
    growth: Annotated[int, Range(0, 10),
        "power of the field angle with which it grows from the axis; 0: the same everywhere"
    ] = 0  # fmt: skip


def noll_to_nm(noll: int) -> tuple[int, int]:
    """Radial order n and azimuthal order m of a Noll index; m < 0 for the sine.

    Source: Noll (1976), J. Opt. Soc. Am. 66, 207, table I.

    >>> [noll_to_nm(j) for j in (1, 2, 3, 4, 5, 6, 7, 8, 11)]
    [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (4, 0)]
    """
    n = (math.isqrt(8 * noll - 7) - 1) // 2
    rank = noll - n * (n + 1) // 2  # 1 ... n + 1 within the order
    m = 2 * (rank // 2) if n % 2 == 0 else 2 * ((rank - 1) // 2) + 1
    return n, m if noll % 2 == 0 else -m


def zernike(noll: int, x: Floats, y: Floats) -> Floats:
    """A Zernike polynomial, of unit rms over the unit disk.

        Z = sqrt(n + 1) R_n^m(rho) {1, sqrt(2) cos(m theta), sqrt(2) sin(m theta)}
        R_n^m(rho) = (-1)^k rho^m P_k^(m, 0)(1 - 2 rho^2),  k = (n - m) / 2

    Source: Noll (1976), eqs. (1)-(3); the Jacobi polynomials keep R stable at high orders.

    x, y     (...) 1, in radii of the aperture; beyond the rim the polynomial is continued
    Returns  (...) 1
    """
    n, m = noll_to_nm(noll)
    order = abs(m)
    k = (n - order) // 2
    square = x * x + y * y
    radial = (-1) ** k * special.eval_jacobi(k, order, 0, 1 - 2 * square)
    # rho^m exp(i m theta) is a power of x + i y: no angle, which is undefined at the centre.
    power = (x + 1j * y) ** order
    turn = power.imag if m < 0 else power.real
    return math.sqrt((n + 1) * (2 if m else 1)) * radial * turn


def nm_to_noll(n: int, m: int) -> int:
    """Noll's index of radial order n and azimuthal order m; m < 0 for the sine.

    >>> all(nm_to_noll(*noll_to_nm(j)) == j for j in range(1, MOST + 1))
    True
    """
    first = n * (n + 1) // 2 + 1
    here = [noll for noll in range(first, first + n + 1) if noll_to_nm(noll) == (n, m)]
    if not here:
        raise Refused(f"m must be one of -n, -n + 2, ... n, got n = {n}, m = {m}")
    return here[0]
