"""Non-sequential ray trace: an independent computation of ghosts.

It shares only the prescription with `startrack.optics.ghosts`. Each surface is a sphere within its
clear aperture, surrounded by an opaque plate. A ray meets the nearest surface ahead; its reflected
and its refracted part are followed up to two reflections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from startrack.core import Floats
from startrack.optics import Surfaces


@dataclass
class Lens:
    """A lens of spheres.

    vertex    (s,) metre along the axis
    sphere    (s,) metre, radius with its sign; infinite: a plane
    clear     (s,) metre, radius of the clear aperture
    index     (s + 1,) of the media before, between and after
    detector  metre, place of the detector
    """

    vertex: Floats
    sphere: Floats
    clear: Floats
    index: Floats
    detector: float


def lens_of(surfaces: Surfaces) -> Lens:
    """The lens from startrack's surfaces."""
    vertex = np.concatenate([[0.0], np.cumsum(surfaces.thickness)])
    with np.errstate(divide="ignore"):
        sphere = np.where(surfaces.curvature == 0, np.inf, 1 / surfaces.curvature)
    index = np.concatenate([[1.0], surfaces.index])
    return Lens(vertex[:-1], sphere, surfaces.radius, index, float(vertex[-1]))


def source(lens: Lens, direction: Floats, count: int) -> tuple[Floats, Floats, float]:
    """Rays (count^2, 3) of a distant source on a square in front of the first surface; area of
    each."""
    half = 1.1 * lens.clear[0]
    axis = ((np.arange(count) + 0.5) / count * 2 - 1) * half
    x, y = (each.ravel() for each in np.meshgrid(axis, axis))
    at = np.column_stack([x, y, np.zeros_like(x)]) - 0.5 * lens.detector * np.asarray(direction)
    ray = np.tile(np.asarray(direction, float), (count**2, 1))
    return at, ray, float((2 * half / count) ** 2 * direction[2])


def ahead(lens: Lens, at: Floats, ray: Floats) -> Floats:
    """Distance to each surface (s + 1, n) that lies ahead, infinite where none; the detector last.

    By the roots of |point + t ray - centre|^2 = radius^2 on the vertex's side of the sphere.
    """
    found = []
    for vertex, sphere in zip(lens.vertex, lens.sphere, strict=True):
        if np.isinf(sphere):
            t = (vertex - at[:, 2]) / ray[:, 2]
            found.append(np.where(t > 1e-9, t, np.inf))
            continue
        off = at - [0, 0, vertex + sphere]
        half = (off * ray).sum(1)
        inside = half**2 - (off**2).sum(1) + sphere**2
        best = np.full(len(at), np.inf)
        for sign in (-1, 1):
            t = -half + sign * np.sqrt(np.maximum(inside, 0))
            z = at[:, 2] + t * ray[:, 2]
            near = (z - vertex - sphere) * sphere < 0
            best = np.where((inside > 0) & (t > 1e-9) & near, np.minimum(best, t), best)
        found.append(best)
    t = (lens.detector - at[:, 2]) / ray[:, 2]
    found.append(np.where(t > 1e-9, t, np.inf))
    return np.array(found)


def ghosts(
    lens: Lens, at: Floats, ray: Floats, reflects: Floats
) -> dict[tuple[int, ...], tuple[Floats, Floats, Floats]]:
    """Points where rays meet the detector after two reflections: {(first, second): (x, y, weight)}.

    at, ray   (n, 3); rays start before the lens
    reflects  (s + 1,) reflectances; they weight reflected rays, transmitted rays keep their weight
    """
    made: dict[tuple[int, ...], list[tuple[Floats, Floats, Floats]]] = {}
    # Histories of reflections with their rays: (position, direction, medium, weight).
    start = (at, ray, np.zeros(len(at), int), np.ones(len(at)))
    waiting: list[tuple[Any, ...]] = [((), *start)]
    while waiting:
        history, at, ray, medium, weight = waiting.pop()
        if not len(at):
            continue
        distance = ahead(lens, at, ray)
        next_ = distance.argmin(0)
        known = np.isfinite(distance.min(0))
        for which in np.unique(next_[known]):
            mine = known & (next_ == which)
            met = at[mine] + distance[which, mine][:, None] * ray[mine]
            now, w, inside = ray[mine], weight[mine], medium[mine]
            if which == len(lens.vertex):
                if len(history) == 2:
                    made.setdefault(history, []).append((met[:, 0], met[:, 1], w))
                elif not history and reflects[which]:
                    turned = now * [1, 1, -1]
                    waiting.append(((which,), met, turned, inside, w * reflects[which]))
                continue
            open_ = np.hypot(met[:, 0], met[:, 1]) <= lens.clear[which]
            met, now, w, inside = met[open_], now[open_], w[open_], inside[open_]
            if np.isinf(lens.sphere[which]):
                normal = np.tile([0.0, 0.0, 1.0], (len(met), 1))
            else:
                normal = met - [0, 0, lens.vertex[which] + lens.sphere[which]]
                normal /= np.linalg.norm(normal, axis=1)[:, None]
            cosine = (normal * now).sum(1)
            normal = np.where(cosine[:, None] < 0, normal, -normal)
            cosine = -np.abs(cosine)
            if reflects[which] and len(history) < 2:
                turned = now - 2 * cosine[:, None] * normal
                waiting.append(((*history, int(which)), met, turned, inside, w * reflects[which]))
            # Into the medium on the other side.
            other = np.where(inside == which, which + 1, which)
            ratio = lens.index[inside] / lens.index[other]
            root = 1 - ratio**2 * (1 - cosine**2)
            on = root >= 0
            bent = ratio[:, None] * now + (
                (-ratio * cosine - np.sqrt(np.maximum(root, 0)))[:, None] * normal
            )
            waiting.append((history, met[on], bent[on], other[on], w[on]))
    found = {}
    for key, parts in made.items():
        x, y, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
        found[key] = x, y, weights
    return found
