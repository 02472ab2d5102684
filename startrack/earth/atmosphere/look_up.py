"""Radiance of each pixel from BandTable and viewing geometry: the second of the two steps."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from startrack.core import Floats, Refused, Singles, deg, kept, kernel, read_only
from startrack.earth.atmosphere.table import BandTable

Reals = NDArray[np.floating[Any]]

STEP = 1 * deg  # step of the fine table in the zenith angles
AZIMUTH_STEP = 2 * deg
OUTSIDE = 1e-6  # fraction of a cell, tolerance for rounding
HEIGHT_STEP = 250.0  # metre


class Reach(NamedTuple):
    """Ranges of height, sensor, sun and azimuth of a scene, (low, high) each: metre, radian,
    radian, radian."""

    height: tuple[float, float]
    sensor: tuple[float, float]
    sun: tuple[float, float]
    azimuth: tuple[float, float]


class SlantPath(NamedTuple):
    """Viewing geometry and illumination of n pixels of ground.

    height     (n,) metre above the sea
    sensor     (n,) radian, zenith angle of the sensor
    sun        (n,) radian, zenith angle of the Sun
    azimuth    (n,) radian, between them, in [0, pi]
    incidence  (n,) 1, cosine between the ground's normal and the Sun; negative values are set to 0
    lit        (n,) 1, fraction of the pixel in the direct beam: 0 in shadow
    sky_view   (n,) 1, fraction of the sky's light that reaches the ground
    """

    height: Floats
    sensor: Floats
    sun: Floats
    azimuth: Floats
    incidence: Floats
    lit: Floats
    sky_view: Floats


@dataclass(frozen=True, eq=False)
class FineTable:
    """The part of a BandTable that a scene needs, fine enough for linear interpolation.

    start, step  (4,) for height, sensor, sun and azimuth, metre and radian
    path         (h, v, s, p, b)
    ground       (h, v, s, 3 b), direct, sky and around in sequence
    backscatter  (h, b)
    through      (h, v, b)
    rise, fall   (h, v, b), or None
    """

    start: Floats
    step: Floats
    path: Singles
    ground: Singles
    backscatter: Singles
    through: Singles
    rise: Singles | None = None
    fall: Singles | None = None

    def heat(self, values: Singles, sight: SlantPath) -> Floats:
        """Values (n, b) of `through`, `rise` or `fall`, linear between nodes."""
        last = np.array(values.shape[:2]) - 1
        height = np.clip((sight.height - self.start[0]) / self.step[0], 0, last[0])
        sensor = np.clip((sight.sensor - self.start[1]) / self.step[1], 0, last[1])
        h, v = height.astype(int), sensor.astype(int)
        up, right = np.minimum(h + 1, last[0]), np.minimum(v + 1, last[1])
        y, x = (height - h)[:, None], (sensor - v)[:, None]
        near = values[h, v] * (1 - x) + values[h, right] * x
        far = values[up, v] * (1 - x) + values[up, right] * x
        return near * (1 - y) + far * y


@kept(8)
def refine(table: BandTable, ranges: Reach) -> FineTable:
    """The part of a table that a scene needs, on finer nodes, by cubic splines; 8 are kept.

    Raises    ValueError if the scene reaches beyond the table.
    Accuracy  numerical: linear interpolation over 1 degree errs by 1e-3 up to 70 degrees.
    """
    axes = table.height, table.sensor, table.sun, table.azimuth
    steps = HEIGHT_STEP, STEP, STEP, AZIMUTH_STEP
    nodes = [_nodes(*way) for way in zip(Reach._fields, axes, ranges, steps, strict=True)]
    ground = np.concatenate([table.direct, table.sky, table.around], 3)
    path, backscatter = table.path, table.backscatter
    for i, (axis, at) in enumerate(zip(axes, nodes, strict=True)):
        path = _spline(axis, path, i, at)
        if i < 3:
            ground = _spline(axis, ground, i, at)
    backscatter = _spline(table.height, backscatter, 0, nodes[0])
    heat = [
        None
        if term is None
        else _single(_spline(table.sensor, _spline(table.height, term, 0, nodes[0]), 1, nodes[1]))
        for term in (table.through, table.rise, table.fall)
    ]
    start = np.array([at[0] for at in nodes])
    step = np.array([at[1] - at[0] if len(at) > 1 else 1.0 for at in nodes])
    sunlit = (_single(part) for part in (path, ground, backscatter))
    return FineTable(start, step, *sunlit, *heat)


def _single(values: Floats) -> Singles:
    return np.ascontiguousarray(values, np.float32)


def look_up(
    table: FineTable,
    sight: SlantPath,
    reflectance: Reals,
    surroundings: Reals,
    direct: Reals | None = None,
) -> tuple[Singles, Singles, Singles]:
    """Reflected and scattered sunlight, in the terms of Krutz et al. (2011).

        L_dir = R s cos(alpha) / cos(sun) D
        L_ind = rho (V K + (D + K) B) + rho (1 - V) rho" (D + K) (1 + B)
        L_sc  = P + A (rho' + rho' B),            B = rho" S / (1 - rho" S)

    with D, K, A and P the table's direct, sky, around and path terms, rho the ground's reflectance,
    R the reflectance factor for sunlight (rho for Lambertian ground), rho' the reflectance of the
    surroundings from which the air scatters light into the line of sight, and rho" the reflectance
    of the points from which it scatters light to the ground; these points also illuminate slopes,
    by 1 - V.

    Source: Krutz et al. (2011), eqs. (1) and (2), with transmittances and 1 / pi written out.

    sight         n pixels
    reflectance   (n, b) or (b,) 1
    surroundings  (b,) 1, rho' = rho" for all pixels; or (2, n, b), rho' and rho" of each pixel
    direct        (n, b) 1, R, at least 0; None: `reflectance`
    Returns       three of (n, b) watt / m^2 / sr
    Raises        ValueError if a pixel lies outside the table, is not a number, or has a
                  reflectance outside [0, 1].
    Accuracy      model: surroundings are flat; slopes do not change the radiance of the air.
    """
    count, bands = len(sight.height), table.backscatter.shape[1]
    rho = _singles(reflectance, (count, bands))
    factor = rho if direct is None else _singles(direct, (count, bands))
    around = np.asarray(surroundings)
    around = around if around.ndim == 3 else around[None, None]
    around = _singles(around, (2, around.shape[1], bands))
    for name, values in (("reflectance", rho), ("surroundings", around)):
        if not (values >= 0).all() or not (values <= 1).all():
            wrong = values[~((values >= 0) & (values <= 1))]
            raise ValueError(f"{name} must lie in [0, 1], got {float(wrong[0])}")
    if not (factor >= 0).all():
        raise ValueError(f"direct must be at least 0, got {factor[~(factor >= 0)][0]}")
    beam = np.maximum(sight.incidence, 0) / np.cos(sight.sun) * sight.lit
    geometry = np.stack([beam, sight.sky_view]).astype(np.float32)
    if not np.isfinite(geometry).all():
        raise ValueError("incidence, lit and sky_view must be finite")
    out = np.empty((3, count, bands), np.float32)
    where = sight.height, sight.sensor, sight.sun, sight.azimuth
    view = table.path, table.ground, table.backscatter, where, table.start, table.step
    outside = _look_up(*view, geometry, rho, factor, around, out)
    if outside >= 0:
        raise ValueError(
            "every pixel must lie inside the reach that the table was refined for, pixel "
            f"{outside} has height, sensor, sun, azimuth = "
            f"{', '.join(f'{values[outside]:.6g}' for values in where)}"
        )
    return out[0], out[1], out[2]


def _nodes(name: str, axis: Floats, extent: tuple[float, float], step: float) -> Floats:
    low, high = extent
    slack = 1e-9 * max(1.0, abs(axis[-1]))
    if not axis[0] - slack <= low <= high <= axis[-1] + slack:
        raise Refused(
            f"{name} must lie in the table's [{axis[0]:g}, {axis[-1]:g}], got {low:g} to {high:g}"
            + ("" if name == "height" else f" radian: {low / deg:.4g} to {high / deg:.4g} degree")
        )
    count = int(np.ceil((high - low) / step - 1e-9)) + 1
    return np.linspace(low, max(high, low), count)


def _spline(axis: Floats, values: Floats, along: int, at: Floats) -> Floats:
    if len(axis) == 1:
        return np.repeat(values, len(at), along)
    return CubicSpline(axis, values, along)(at)


def _singles(values: Reals, shape: tuple[int, ...]) -> Singles:
    return read_only(np.ascontiguousarray(np.broadcast_to(values, shape), np.float32))


@kernel(fastmath={"contract", "reassoc", "nsz", "arcp"})
def _look_up(path, ground, backscatter, where, start, step, geometry, rho, factor, around, out):  # type: ignore[no-untyped-def]
    """Fill `out`. Returns the first pixel outside the table, or -1.

    The corners are written out: the compiler then handles all bands in eight lanes, five times as
    fast as loops over corners.
    """
    bands = rho.shape[1]
    one = np.float32(1)
    low, high = np.empty(4, np.int64), np.empty(4, np.int64)
    part = np.empty(4, np.float32)
    white_ground = np.empty(3 * bands, np.float32)
    for n in range(rho.shape[0]):
        for d in range(4):
            cell = (where[d][n] - start[d]) / step[d]
            last = path.shape[d] - 1
            if not (-OUTSIDE < cell < last + OUTSIDE):
                return n
            low[d] = min(max(int(cell), 0), max(last - 1, 0))
            high[d] = min(low[d] + 1, last)
            part[d] = cell - low[d]
        h, v, s, p = part[0], part[1], part[2], part[3]
        w0, w1 = (one - h) * (one - v) * (one - s), (one - h) * (one - v) * s
        w2, w3 = (one - h) * v * (one - s), (one - h) * v * s
        w4, w5 = h * (one - v) * (one - s), h * (one - v) * s
        w6, w7 = h * v * (one - s), h * v * s
        g, f = ground[low[0], low[1]], ground[low[0], high[1]]
        k, m = ground[high[0], low[1]], ground[high[0], high[1]]
        g0, g1, g2, g3 = g[low[2]], g[high[2]], f[low[2]], f[high[2]]
        g4, g5, g6, g7 = k[low[2]], k[high[2]], m[low[2]], m[high[2]]
        for b in range(3 * bands):
            white_ground[b] = (w0 * g0[b] + w1 * g1[b] + w2 * g2[b] + w3 * g3[b]) + (
                w4 * g4[b] + w5 * g5[b] + w6 * g6[b] + w7 * g7[b]
            )
        scattered = out[2, n]
        scattered[:] = 0
        for side in range(2):
            at = low[3] if side == 0 else high[3]
            fraction = one - p if side == 0 else p
            a, c = path[low[0], low[1]], path[low[0], high[1]]
            d2, e = path[high[0], low[1]], path[high[0], high[1]]
            a0, a1, a2, a3 = a[low[2], at], a[high[2], at], c[low[2], at], c[high[2], at]
            a4, a5, a6, a7 = d2[low[2], at], d2[high[2], at], e[low[2], at], e[high[2], at]
            for b in range(bands):
                scattered[b] += fraction * (
                    (w0 * a0[b] + w1 * a1[b] + w2 * a2[b] + w3 * a3[b])
                    + (w4 * a4[b] + w5 * a5[b] + w6 * a6[b] + w7 * a7[b])
                )
        beam, view = geometry[0, n], geometry[1, n]
        here = n if around.shape[1] > 1 else 0
        sent, returned = around[0, here], around[1, here]
        below, above = backscatter[low[0]], backscatter[high[0]]
        direct, indirect, reflects, mirrors = out[0, n], out[1, n], rho[n], factor[n]
        for b in range(bands):
            of_beam, of_sky = white_ground[b], white_ground[bands + b]
            white = of_beam + of_sky
            bounce = one / (one - returned[b] * ((one - h) * below[b] + h * above[b]))
            slopes = (one - view) * returned[b] * white * bounce
            direct[b] = mirrors[b] * beam * of_beam
            indirect[b] = reflects[b] * (view * of_sky + white * (bounce - one) + slopes)
            scattered[b] += white_ground[2 * bands + b] * sent[b] * bounce
    return -1
