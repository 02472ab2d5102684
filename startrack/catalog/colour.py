"""Magnitudes of older bands -> Gaia's G and BP - RP.

Every relation is a polynomial in c = BP - RP. A colour in older bands is the difference of two such
polynomials, which is solved for c. Then G follows from one magnitude.
"""

import numpy as np
from numpy.polynomial import polynomial

from startrack.core import Floats

# Gaia DR3 documentation, section 5.5.1, tables 5.8 to 5.10 (Carrasco & Bellazzini; the same
# fits as Riello et al. 2021, A&A 649, A3, appendix C): coefficients of c^0, c^1, ...
G_MINUS_V = (-0.02704, 0.01424, -0.2156, 0.01426)  # scatter 0.03 mag, -0.5 < c < 5
G_MINUS_B = (0.01448, -0.6874, -0.3604, 0.06718, -0.006061)  # scatter 0.06 mag
G_MINUS_VT = (-0.01077, -0.0682, -0.2387, 0.02342)  # -0.35 < c < 4
G_MINUS_BT = (-0.004288, -0.8547, 0.1244, -0.9085, 0.4843, -0.06814)  # -0.3 < c < 3
# BP - RP from V - I (Cousins), -0.4 < V - I < 5, scatter 0.04 mag.
C_OF_V_MINUS_I = (-0.03298, 1.259, -0.1279, 0.01631)

# Fitted by catalogs/stars/build.py to the stars that have G, BP - RP and Hp. The scatter is 0.005
# mag for the four fifths of them that are neither double nor variable.
G_MINUS_HP = (-0.01988, -0.2383, -0.12604, 0.02431, -0.00186)
HP_RANGE = (-0.4, 3.2)

# BP - RP assumed to compute G of a star without any colour: the median of the shipped stars.
TYPICAL_COLOUR = 1.1


def g_from_johnson(v: Floats, b_minus_v: Floats) -> tuple[Floats, Floats]:
    """G and BP - RP of stars with Johnson's V and B - V.

    v, b_minus_v  (n,) magnitude, NaN where unknown
    Returns       (n,) G and (n,) BP - RP, which is NaN where the colour is missing
    Accuracy      0.03 mag in G for stars with 0 < B - V < 1.3. Beyond B - V = 1.5, B - V says
                  little about a giant's temperature, and the error of G is 0.5 mag. Without a
                  colour it is 0.3 mag.
    """
    colour = _solve(G_MINUS_V, G_MINUS_B, b_minus_v, -0.5, 3.0)
    return v + _shift(G_MINUS_V, colour), colour


def g_from_tycho(vt: Floats, bt_minus_vt: Floats) -> tuple[Floats, Floats]:
    """G and BP - RP of stars with Tycho's VT and BT - VT.

    vt, bt_minus_vt  (n,) magnitude, NaN where unknown
    Returns          (n,) G and (n,) BP - RP, which is NaN where the colour is missing
    Accuracy         0.05 mag in G if the error of BT and VT is 0.02 mag; 0.3 mag without a colour.
    """
    colour = _solve(G_MINUS_VT, G_MINUS_BT, bt_minus_vt, -0.3, 2.5)
    return vt + _shift(G_MINUS_VT, colour), colour


def g_from_hipparcos(hp: Floats, v_minus_i: Floats) -> tuple[Floats, Floats]:
    """G and BP - RP of stars with Hipparcos' Hp and V - I.

    hp, v_minus_i  (n,) magnitude, NaN where unknown
    Returns        (n,) G and (n,) BP - RP, which is NaN where the colour is missing
    Accuracy       0.02 mag in G if the error of V - I is 0.02 mag; 0.3 mag without a colour.
    """
    colour = _polynomial(np.clip(v_minus_i, -0.4, 4.0), C_OF_V_MINUS_I)
    return hp + _shift(G_MINUS_HP, np.clip(colour, *HP_RANGE)), colour


def v_from_g(g: Floats, colour: Floats) -> Floats:
    """Johnson's V, (n,) magnitude, of stars with G and BP - RP; error 0.3 mag without a colour."""
    return g - _shift(G_MINUS_V, colour)


def _shift(relation: tuple[float, ...], colour: Floats) -> Floats:
    return _polynomial(np.where(np.isnan(colour), TYPICAL_COLOUR, colour), relation)


def _solve(
    red: tuple[float, ...], blue: tuple[float, ...], index: Floats, low: float, high: float
) -> Floats:
    """Solve red(c) - blue(c) = index for c in [low, high]; NaN stays NaN."""
    grid = np.linspace(low, high, 2001)
    rising = _polynomial(grid, red) - _polynomial(grid, blue)
    return np.interp(index, rising, grid)


def _polynomial(colour: Floats, relation: tuple[float, ...]) -> Floats:
    return np.asarray(polynomial.polyval(colour, relation), float)
