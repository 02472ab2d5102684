"""Three directions enter; a code that neither rotation nor scale changes leaves.

The two directions farthest apart are the base, A and B. In the plane that touches the sphere
between them, with A at (0, 0) and B at (1, 0), the place (x, y) of the third, C, is the code. It
lies in the lens of the points nearer to A and to B than these to each other. Of the two ways to
name A and B the canonical one has x <= 1/2. A mirror image has another code.

Source: the idea is that of Lang et al. (2010), Astron. J. 139, 1782, sect. 2.2, who take four
stars and the square over the base.
"""

from __future__ import annotations

import math

from numba import njit

from startrack.values import Floats

TALLEST = math.sqrt(3) / 2  # half the height of the lens over a base of one


@njit(cache=True, error_model="numpy")
def place(a: Floats, b: Floats, c: Floats) -> tuple[float, float]:  # pragma: no cover
    """Where C lies over the base from A to B.

    a, b, c  (3,) unit vectors
    Returns  (x, y) in units of the base, as described above
    """
    mx, my, mz = a[0] + b[0], a[1] + b[1], a[2] + b[2]
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    # m and e are normal to each other; |e| / |m| = tan(separation / 2)
    nx, ny, nz = my * ez - mz * ey, mz * ex - mx * ez, mx * ey - my * ex
    ee = ex * ex + ey * ey + ez * ez
    mm = mx * mx + my * my + mz * mz
    depth = c[0] * mx + c[1] * my + c[2] * mz
    along = c[0] * ex + c[1] * ey + c[2] * ez
    across = c[0] * nx + c[1] * ny + c[2] * nz
    return 0.5 + 0.5 * along * mm / (depth * ee), 0.5 * across * math.sqrt(mm) / (depth * ee)


@njit(cache=True, error_model="numpy")
def separation(a: Floats, b: Floats) -> float:  # pragma: no cover
    """Radian between two unit vectors (3,), accurate at small angles."""
    chord = math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    return 2 * math.asin(min(chord / 2, 1.0))
