"""Points where rays meet a surface of constant height above the ellipsoid, such as the sea."""

import math
from dataclasses import dataclass

import numpy as np

from startrack.core import Flags, Floats, finite, kernel
from startrack.earth.terrain.ellipsoid import angle, shell, vertical
from startrack.earth.terrain.ground import Levels, Rays
from startrack.earth.terrain.march import HIT, MISS
from startrack.earth.terrain.trace import RayHits, no_hits

STEPS = 8  # steps of Newton's method; the start is within a metre, the convergence quadratic


@dataclass(frozen=True)
class ConstantHeight:
    """The surface of one height in metres above the ellipsoid: 0 is the ellipsoid alone."""

    height: float = 0.0

    def __post_init__(self) -> None:
        finite(height=self.height)

    def meet(self, rays: Rays) -> tuple[RayHits, Levels]:
        """Find where rays from above meet the surface; at height 0 in closed form.

        Accuracy  numerical: 1e-8 m; a ray that grazes within 1e-6 m may be put on the wrong side.
        """
        hits = no_hits(len(rays))
        # An integer would compile the kernel again.
        _meet(rays.origin, rays.direction, float(self.height), hits)
        return hits, np.zeros(len(rays), np.int8)

    def stops(self, rays: Rays, level: Levels, start: float) -> Flags:
        """Whether rays that begin on the surface lead below it."""
        moved = Rays(rays.origin + start * rays.direction, rays.direction, rays.spread)
        return self.meet(moved)[0].hit


@kernel
def _meet(origin: Floats, direction: Floats, height: float, hits: RayHits) -> None:
    status, distance, place, normal = hits.status, hits.distance, hits.place, hits.normal
    for n in range(len(origin)):
        ox, oy, oz = origin[n]
        dx, dy, dz = direction[n]
        s, leave = shell(ox, oy, oz, dx, dy, dz, height)
        status[n] = MISS
        if not 0 <= s <= leave:
            continue
        for _ in range(STEPS if height else 0):
            x, y, z = ox + s * dx, oy + s * dy, oz + s * dz
            sine, cosine, above, across = vertical(x, y, z)
            fall = sine * dz + cosine * (x * dx + y * dy) / across
            step = (height - above) / min(fall, -1e-6)
            s += step
            if abs(step) < 1e-9:
                break
        x, y, z = ox + s * dx, oy + s * dy, oz + s * dz
        sine, cosine, above, across = vertical(x, y, z)
        status[n], distance[n] = HIT, s
        place[n, 0], place[n, 1], place[n, 2] = angle(y, x), angle(sine, cosine), above
        scale = cosine / max(across, 1e-3)
        normal[n, 0], normal[n, 1], normal[n, 2] = scale * x, scale * y, sine


@kernel
def tangent_height(origin: Floats, direction: Floats) -> Floats:
    """Lowest height of each ray above the ellipsoid, (n,) metre; the origin's height if the ray
    rises.

    Newton's method on the slope of the height. The derivative of the slope is cos^2(e) / r, nearly
    constant.
    """
    out = np.empty(len(origin))
    for n in range(len(origin)):
        ox, oy, oz = origin[n]
        dx, dy, dz = direction[n]
        s = max(0.0, -(ox * dx + oy * dy + oz * dz))
        for _ in range(50):
            x, y, z = ox + s * dx, oy + s * dy, oz + s * dz
            sine, cosine, _, across = vertical(x, y, z)
            rise = sine * dz + cosine * (x * dx + y * dy) / max(across, 1e-3)
            radius = math.sqrt(x * x + y * y + z * z)
            step = -rise * radius
            s = max(0.0, s + step)
            if abs(step) < 1e-3 or s == 0:
                break
        out[n] = vertical(ox + s * dx, oy + s * dy, oz + s * dz)[2]
    return out
