"""Rays in bundles: what each of them needs alike is computed by loops of vector instructions.

A bundle is one array, so that the compiler knows that its rows do not overlap: the value `row` of
ray k is bundle[row + k].
"""

from __future__ import annotations

import numpy as np
from numba import njit

from startrack.scene.earth.march import lay, onset
from startrack.scene.earth.path import Path
from startrack.scene.earth.polish import normal_at, refine

WIDTH = 128  # rays, of which all rows fit into the innermost cache

(
    OX, OY, OZ, DX, DY, DZ, START,  # what is given: origin, direction, from where to follow
    BEGIN, END, MIDDLE, HALF, MARGIN, U0, U1, U2, V0, V1, V2, H0, H1, H2, SINE, COSINE,  # the path
) = range(0, 23 * WIDTH, WIDTH)  # fmt: skip
# What takes the place of the path once a ray has met a cell: which, its corners; then the point.
GUESS, LOW, HIGH, ROW, COLUMN, A, B, C, D = range(BEGIN, BEGIN + 9 * WIDTH, WIDTH)
FOUND, U, V, HEIGHT, NX, NY, NZ = range(D + WIDTH, D + 8 * WIDTH, WIDTH)


@njit(cache=True, error_model="numpy")
def empty_bundle():  # type: ignore[no-untyped-def]
    """Rays that are all alike and meet nothing, to be filled in."""
    bundle = np.zeros(23 * WIDTH)
    bundle[OX : OX + WIDTH] = 1e8
    bundle[DX : DX + WIDTH] = 1.0
    return bundle


@njit(cache=True, error_model="numpy")
def lay_all(bundle, lines, exact):  # type: ignore[no-untyped-def]
    """The first path of each ray, as `onset` and `lay` find it."""
    for k in range(WIDTH):
        ox, oy, oz = bundle[OX + k], bundle[OY + k], bundle[OZ + k]
        dx, dy, dz = bundle[DX + k], bundle[DY + k], bundle[DZ + k]
        start = bundle[START + k]
        begin, end = onset(lines, ox, oy, oz, dx, dy, dz, start)
        # A shadow begins on the surface, where its path must be best.
        ahead = (not exact) & (begin <= start)
        middle, half, margin, path = lay(lines, ox, oy, oz, dx, dy, dz, begin, end, ahead)
        bundle[BEGIN + k], bundle[END + k] = begin, end
        bundle[MIDDLE + k], bundle[HALF + k], bundle[MARGIN + k] = middle, half, margin
        bundle[U0 + k], bundle[U1 + k], bundle[U2 + k] = path.u0, path.u1, path.u2
        bundle[V0 + k], bundle[V1 + k], bundle[V2 + k] = path.v0, path.v1, path.v2
        bundle[H0 + k], bundle[H1 + k], bundle[H2 + k] = path.h0, path.h1, path.h2
        bundle[SINE + k], bundle[COSINE + k] = path.sine, path.cosine


@njit(cache=True, error_model="numpy", forceinline=True)
def path_of(bundle, k):  # type: ignore[no-untyped-def]
    """The path that was laid for ray k."""
    return Path(
        bundle[U0 + k], bundle[U1 + k], bundle[U2 + k],
        bundle[V0 + k], bundle[V1 + k], bundle[V2 + k],
        bundle[H0 + k], bundle[H1 + k], bundle[H2 + k],
        bundle[SINE + k], bundle[COSINE + k],
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def refine_all(bundle, lines):  # type: ignore[no-untyped-def]
    """The point and the normal in each ray's cell, as `refine` and `normal_at` find them."""
    for k in range(WIDTH):
        ox, oy, oz = bundle[OX + k], bundle[OY + k], bundle[OZ + k]
        dx, dy, dz = bundle[DX + k], bundle[DY + k], bundle[DZ + k]
        i, j = bundle[COLUMN + k], bundle[ROW + k]
        b, c, d = bundle[B + k], bundle[C + k], bundle[D + k]
        found, s, u, v, height, sine, cosine = refine(
            lines, ox, oy, oz, dx, dy, dz, bundle[GUESS + k], i, j, bundle[A + k], b, c, d
        )
        nx, ny, nz = normal_at(
            lines, ox + s * dx, oy + s * dy, height, sine, cosine,
            b + d * (v - j), c + d * (u - i),
        )  # fmt: skip
        bundle[FOUND + k] = s if found else np.nan
        bundle[U + k], bundle[V + k], bundle[HEIGHT + k] = u, v, height
        bundle[NX + k], bundle[NY + k], bundle[NZ + k] = nx, ny, nz
