"""Products of many vectors that lie component by component: (3, n) and (3, 3, n)."""

from __future__ import annotations

import numpy as np

from startrack.core import Floats


def dot(a: Floats, b: Floats) -> Floats:
    """(n,) scalar products of (3, n)."""
    total = a[0] * b[0]
    total += a[1] * b[1]
    total += a[2] * b[2]
    return total


def cross(a: Floats, b: Floats) -> Floats:
    """(3, n) vector products of (3, n)."""
    return np.stack([
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    ])  # fmt: skip


def unit(a: Floats) -> Floats:
    """(3, n) of length one."""
    return a / np.sqrt(dot(a, a))


def times(matrix: Floats, a: Floats) -> Floats:
    """(3, n) products of (3, 3, n) matrices and (3, n) vectors."""
    return np.stack([dot(row, a) for row in matrix])


def from_body(body: Floats, line: Floats) -> Floats:
    """(3, n) in ICRS axes of a direction (3,) in body axes; body (3, 3, n), see `Instants`."""
    total = body[0] * line[0]
    total += body[1] * line[1]
    total += body[2] * line[2]
    return total


def angle(cosine: Floats) -> Floats:
    """(n,) radian of cosines that rounding may have moved beyond one."""
    return np.arccos(np.clip(cosine, -1.0, 1.0))
