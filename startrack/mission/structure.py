"""Structure of the spacecraft and instants -> its angle from a head's line of sight."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from startrack.core import Floats
from startrack.mission.instants import Instants
from startrack.mission.parameters import Obstacle
from startrack.space import angle, cross, dot, unit

SIDES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))  # normal of a side of a box, and its two edges


def faces_of(structure: Sequence[Obstacle], instants: Instants) -> list[Floats]:
    """Rectangles of the structure in body axes, (4, 3, n) metre, or (4, 3, 1) where they stand.

    A panel that follows the Sun turns about its hinge until its normal is as near to the Sun as
    that allows; a side of a box never turns.
    """
    found = []
    for one in structure:
        corners = [np.array(each) for each in _rectangles(one)]
        if one.hinge is None:
            found += [each[..., None] for each in corners]
            continue
        turn = _turn(one, instants)
        axis, origin = np.array(one.hinge) / np.linalg.norm(one.hinge), np.array(one.centre)
        found += [
            np.stack([origin[:, None] + _turned(axis, corner - origin, turn) for corner in each])
            for each in corners
        ]
    return found


def _rectangles(one: Obstacle) -> list[Floats]:
    """(4, 3) corners in order around each rectangle; a size of zero leaves one."""
    centre, half = np.array(one.centre), np.array(one.size) / 2
    found = []
    for n, a, b in SIDES:
        if not (half[a] and half[b]):
            continue
        for side in (-1, 1) if half[n] else (1,):
            middle = centre.copy()
            middle[n] += side * half[n]
            corners = []
            for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = middle.copy()
                corner[a] += u * half[a]
                corner[b] += v * half[b]
                corners.append(corner)
            found.append(np.array(corners))
    return found


def _turn(one: Obstacle, instants: Instants) -> Floats:
    """(n,) radian about the hinge that bring the thinnest side's normal nearest to the Sun."""
    assert one.hinge is not None
    axis = np.array(one.hinge) / np.linalg.norm(one.hinge)
    normal = np.zeros(3)
    normal[int(np.argmin(one.size))] = 1.0
    normal -= axis * (axis @ normal)
    normal /= np.linalg.norm(normal)
    sun = np.stack([dot(row, instants.sun) for row in instants.body])
    return np.arctan2(np.cross(axis, normal) @ sun, normal @ sun)


def _turned(axis: Floats, arm: Floats, turn: Floats) -> Floats:
    """(3, n) a vector turned about an axis by angles (n,), by Rodrigues' formula."""
    along = axis * (axis @ arm)
    return (
        along[:, None]
        + np.outer(arm - along, np.cos(turn))
        + np.outer(np.cross(axis, arm), np.sin(turn))
    )


def nearest(faces: Sequence[Floats], position: Floats, boresight: Floats) -> Floats:
    """Angle from a line of sight to the nearest point of the structure.

    The angle to a rectangle is zero where the line meets it; else that to the nearest of its four
    edges, which are arcs of great circles as seen from the head.

    faces      of `faces_of`
    position   (3,) metre, of the head's aperture;  boresight  (3,) in body axes
    Returns    (n,) or (1,) radian
    """
    least: Floats = np.full(1, math.pi)
    for corners in faces:
        seen = corners - position[None, :, None]
        line = np.broadcast_to(boresight[:, None], seen.shape[1:])
        rays = [unit(one) for one in seen]
        sides, best = [], np.full(seen.shape[-1], math.pi)
        for a, b in itertools.pairwise([*rays, rays[0]]):
            normal = cross(a, b)
            size = np.sqrt(dot(normal, normal))
            normal = normal / np.maximum(size, 1e-12)
            height = dot(line, normal)
            ahead, behind = dot(cross(normal, a), line), dot(cross(b, normal), line)
            between = (ahead >= 0) & (behind >= 0) & (size > 1e-9)
            ends = np.minimum(angle(dot(a, line)), angle(dot(b, line)))
            best = np.minimum(
                best, np.where(between, np.abs(np.arcsin(np.clip(height, -1, 1))), ends)
            )
            sides.append(height)
        middle = dot(np.sum(rays, axis=0), line) > 0
        inside = (
            np.all(np.array(sides) >= 0, axis=0) | np.all(np.array(sides) <= 0, axis=0)
        ) & middle
        least = np.minimum(least, np.where(inside, 0.0, best))
    return least
