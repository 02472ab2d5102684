"""Best rotation of a 3 x 3 matrix of products; least squares in three unknowns."""

import math

import numpy as np

from startrack.core import Floats, kernel

EPS = 2.0**-52
MOST_SWEEPS = 12  # limit of the sweeps: convergence is quadratic, so that a few are enough


@kernel
def best_rotation(b: Floats, rotation: Floats) -> Floats:
    """Write the rotation R with the largest trace(R^T b), and return the main direction u1.

        b = U S V^T with falling S,   R = u1 v1^T + u2 v2^T + (u1 x u2) (v1 x v2)^T

    The cross products make both frames right-handed. They do not need the smallest singular value,
    which has no correct digits. Method: Golub and Van Loan (2013), Matrix Computations, 8.6.3.

    b         (3, 3); overwritten: its columns become U S
    rotation  (3, 3), written
    Returns   (3,) u1
    """
    v = np.zeros((3, 3))
    v[0, 0] = v[1, 1] = v[2, 2] = 1.0
    for _ in range(MOST_SWEEPS):
        turned = False
        for i, j in ((0, 1), (0, 2), (1, 2)):
            turned |= _make_orthogonal(b, v, i, j)
        if not turned:
            break
    length, first = np.empty(3), 0
    for j in range(3):
        length[j] = math.sqrt(b[0, j] ** 2 + b[1, j] ** 2 + b[2, j] ** 2)
        if length[j] > length[first]:
            first = j
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
def _make_orthogonal(b: Floats, v: Floats, i: int, j: int) -> bool:
    """Rotate columns i and j of b and v to make b's orthogonal; return whether it was needed."""
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
            first, second = m[k, i], m[k, j]
            m[k, i] = cosine * first - sine * second
            m[k, j] = sine * first + cosine * second
    return True


@kernel
def _frame(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Two orthogonal unit vectors: along the first, and as close as possible to the second."""
    size, least = math.sqrt(_dot(first, first)), 0
    u1, u2 = np.empty(3), np.empty(3)
    for k in range(3):
        u1[k] = first[k] / size if size > 0 else (1.0 if k == 0 else 0.0)
        if abs(u1[k]) < abs(u1[least]):
            least = k
    along = _dot(u1, second)
    for k in range(3):
        u2[k] = second[k] - u1[k] * along
    if math.sqrt(_dot(u2, u2)) <= EPS * size:
        for k in range(3):
            u2[k] = 1.0 if k == least else 0.0
    _normalise(u2)
    along = _dot(u1, u2)
    for k in range(3):
        u2[k] -= u1[k] * along  # once more: a short or chosen vector is not yet orthogonal
    _normalise(u2)
    return u1, u2


@kernel
def _dot(a: Floats, b: Floats) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _normalise(vector: Floats) -> None:
    """Make its length one."""
    length = math.sqrt(_dot(vector, vector))
    for k in range(3):
        vector[k] /= length


@kernel
def _cross(a: Floats, b: Floats) -> Floats:
    out = np.empty(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k] = a[i] * b[j] - a[j] * b[i]
    return out


@kernel
def least_squares(columns: Floats, triangle: Floats, step: Floats) -> None:
    """Minimise |A d - t| by modified Gram-Schmidt with the target as the last column.

    It is as stable as Householder's method: Bjorck (1996), Numerical Methods for Least Squares
    Problems, 2.4.

    columns   (4, n) the three columns of A, and t; overwritten
    triangle  (3, 3), written: upper triangular, A = Q triangle; with a zero on its diagonal if A
              has not full rank
    step      (3,), written: d; not finite if A has not full rank
    """
    count = columns.shape[1]
    target = np.zeros(3)
    for i in range(3):
        square = 0.0
        for k in range(count):
            square += columns[i, k] ** 2
        triangle[i, i] = math.sqrt(square)
        scale = 1 / triangle[i, i] if triangle[i, i] > 0 else 0.0
        for k in range(count):
            columns[i, k] *= scale
        for j in range(i + 1, 4):
            along = 0.0
            for k in range(count):
                along += columns[i, k] * columns[j, k]
            for k in range(count):
                columns[j, k] -= along * columns[i, k]
            if j < 3:
                triangle[i, j] = along
            else:
                target[i] = along
    for i in range(2, -1, -1):
        rest = target[i]
        for j in range(i + 1, 3):
            rest -= triangle[i, j] * step[j]
        step[i] = rest / triangle[i, i]


@kernel
def invert(triangle: Floats, inverse: Floats) -> None:
    """Write the inverse of an upper triangular matrix; infinite if it is singular."""
    a, b, c = triangle[0, 0], triangle[1, 1], triangle[2, 2]
    inverse[:] = 0.0
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = 1 / a, 1 / b, 1 / c
    inverse[0, 1] = -triangle[0, 1] / (a * b)
    inverse[1, 2] = -triangle[1, 2] / (b * c)
    inverse[0, 2] = (triangle[0, 1] * triangle[1, 2] / b - triangle[0, 2]) / (a * c)


@kernel
def largest_eigenvalue(m: Floats) -> float:
    """Largest eigenvalue of a symmetric 3 x 3 matrix, to 1e-8 (Smith 1961, Comm. ACM 4, 168)."""
    mean = (m[0, 0] + m[1, 1] + m[2, 2]) / 3
    off = m[0, 1] ** 2 + m[0, 2] ** 2 + m[1, 2] ** 2
    x, y, z = m[0, 0] - mean, m[1, 1] - mean, m[2, 2] - mean
    spread = math.sqrt((x * x + y * y + z * z + 2 * off) / 6)
    if not spread > 0:
        return mean
    x, y, z = x / spread, y / spread, z / spread
    xy, xz, yz = m[0, 1] / spread, m[0, 2] / spread, m[1, 2] / spread
    half = (x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz)) / 2
    return mean + 2 * spread * math.cos(math.acos(min(1.0, max(-1.0, half))) / 3)
