"""The best rotation of a 3 x 3 matrix of products, by one-sided Jacobi rotations."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import kernel

EPS = 2.0**-52
MOST_SWEEPS = 12  # a limit: convergence is quadratic, so that a few are enough


@kernel
def best_rotation(b, rotation):  # type: ignore[no-untyped-def]
    """Write the rotation R of largest trace(R^T b), and return the direction of its largest part.

        b = U S V^T with falling S,   R = u1 v1^T + u2 v2^T + (u1 x u2) (v1 x v2)^T

    The cross products make both frames right-handed, and need no smallest singular value, which
    has no correct digits. Method: Golub and Van Loan (2013), Matrix Computations, 8.6.3.

    b         (3, 3); destroyed: its columns become U S
    rotation  (3, 3), written
    Returns   (3,) u1
    """
    v = np.eye(3)
    for _ in range(MOST_SWEEPS):
        turned = False
        for i, j in ((0, 1), (0, 2), (1, 2)):
            turned |= _make_orthogonal(b, v, i, j)
        if not turned:
            break
    length = np.sqrt((b**2).sum(axis=0))
    first = np.argmax(length)
    second = (first + 1) % 3
    if length[(first + 2) % 3] > length[second]:
        second = (first + 2) % 3
    u1, u2 = _frame(b[:, first], b[:, second])
    u3, v3 = _cross(u1, u2), _cross(v[:, first], v[:, second])
    for i in range(3):
        for j in range(3):
            rotation[i, j] = u1[i] * v[j, first] + u2[i] * v[j, second] + u3[i] * v3[j]
    return u1


@kernel
def _make_orthogonal(b, v, i, j):  # type: ignore[no-untyped-def]
    """Rotate columns i and j of b and of v so that those of b are orthogonal; whether needed."""
    ii = jj = ij = 0.0
    for k in range(3):
        ii += b[k, i] * b[k, i]
        jj += b[k, j] * b[k, j]
        ij += b[k, i] * b[k, j]
    if abs(ij) <= EPS * math.sqrt(ii * jj):
        return False
    zeta = (jj - ii) / (2 * ij)
    tangent = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1 + zeta * zeta))
    cosine = 1 / math.sqrt(1 + tangent * tangent)
    sine = cosine * tangent
    for m in (b, v):
        for k in range(3):
            one, other = m[k, i], m[k, j]
            m[k, i] = cosine * one - sine * other
            m[k, j] = sine * one + cosine * other
    return True


@kernel
def _frame(first, second):  # type: ignore[no-untyped-def]
    """Two orthogonal unit vectors: along the first, and as near as can be to the second."""
    size = math.sqrt((first**2).sum())
    u1 = first / size if size > 0 else np.array([1.0, 0.0, 0.0])
    u2 = second - u1 * (u1 * second).sum()
    if math.sqrt((u2**2).sum()) <= EPS * size:
        u2 = np.zeros(3)
        u2[np.argmin(np.abs(u1))] = 1.0
    u2 = u2 / math.sqrt((u2**2).sum())
    u2 = u2 - u1 * (u1 * u2).sum()  # again: a short or chosen vector is not orthogonal yet
    return u1, u2 / math.sqrt((u2**2).sum())


@kernel
def _cross(a, b):  # type: ignore[no-untyped-def]
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
