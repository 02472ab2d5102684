"""Skies of many kinds, each made from its number alone, so that all programs see the same spots.

A sky is a recipe: field, kind and number give the seed of all that is drawn for it. Nothing is
kept on disk. Spots lie on a square frame of SIZE pixels; all programs are told a focal length that
is wrong by up to one percent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from startrack import deg
from startrack.benchmark import solving
from startrack.catalog import Selection, open_sky
from startrack.core import Camera, Floats, Ints, Spots, Stars
from startrack.identification import PatternIndex, build_index

SIZE, TOLERANCE = solving.SIZE, solving.TOLERANCE
SEED = 20261129
# Side of the field, degree: faintest star that is detected, G; some 25 stars in the middle. The
# catalogue of 2 deg ends half a magnitude below it, that of the others a whole one.
LIMIT_G = {2: 9.5, 4: 8.0, 8: 6.5, 12: 6.0, 20: 5.0, 40: 4.0, 60: 3.5}
DEEPEST_G = 10.0  # of the catalogue of the project
DEEP_G = 8.0  # from which on a catalogue needs the deep one


class Kind(NamedTuple):
    """The difficulties of a sky.

    noise       pixel rms per axis of a centroid; `across` along x instead, for streaks
    false       spots at random places; `clustered` ones within CLUSTER pixels of one place
    missing     fraction of the true stars that are missing
    scale       additional relative error of the focal length
    distortion  pixel, at the corner, radial, unknown to the programs
    deeper      magnitude by which fainter stars are detected
    column      false spots on one column, brighter than the middle star
    planets     false spots, brighter than all stars
    sky         False: all spots are at random places
    """

    noise: float = 0.2
    across: float | None = None
    false: int = 5
    clustered: int = 0
    missing: float = 0.1
    scale: float = 0.0
    distortion: float = 0.0
    deeper: float = 0.0
    column: int = 0
    planets: int = 0
    sky: bool = True


FEW = "few points"  # of frames without a star; counted only if it is asked for
KINDS = {
    "plain": Kind(),
    "noise": Kind(noise=1.0),
    "false spots": Kind(false=20),
    "cluster": Kind(clustered=15),
    "missing": Kind(missing=0.4),
    "wrong field": Kind(scale=0.03),
    "distortion": Kind(distortion=3.0),
    "streaks": Kind(across=1.5),
    "dense": Kind(deeper=1.0),
    "hot columns": Kind(column=10),
    "planets": Kind(planets=3),
    "all at once": Kind(0.5, 1.0, 10, 8, 0.25, 0.0, 1.0, 0.0, 5, 2),
    "no stars": Kind(false=30, sky=False),
    FEW: Kind(false=12, sky=False),
}
CLUSTER = 40.0  # pixel, sigma of a cluster


@dataclass(frozen=True)
class Tracker:
    """startrack's data before a sky is given: camera, catalogue and index of patterns."""

    camera: Camera
    stars: Stars
    index: PatternIndex
    tree: KDTree


@lru_cache
def tracker(field: int) -> Tracker:
    limit = min(LIMIT_G[field] + 1, DEEPEST_G)
    source = "deep" if limit > DEEP_G else "bright"
    stars = open_sky(Selection(source=source, limit_g=limit)).stars
    camera = Camera.from_field_of_view(SIZE, SIZE, field * deg)
    return Tracker(camera, stars, build_index(stars, field * deg), KDTree(stars.direction))


def seed_of(field: int, kind: str, number: int) -> np.random.Generator:
    return np.random.default_rng([SEED, field, list(KINDS).index(kind), number])


def sky(field: int, kind: str, number: int) -> solving.BenchmarkView:
    """The spots of one sky, brightest first, and the truth."""
    how, rng, known = KINDS[kind], seed_of(field, kind, number), tracker(field)
    camera, stars = known.camera, known.stars
    icrs_to_camera = Rotation.from_quat(rng.standard_normal(4))
    near = _near(known, icrs_to_camera) if how.sky else np.zeros(0, np.int64)
    pixel = camera.project(icrs_to_camera.apply(stars.direction[near]))
    inside = camera.holds(pixel)
    near, pixel = near[inside], pixel[inside]
    magnitude = stars.magnitude_g[near] + solving.MAGNITUDE_NOISE * rng.standard_normal(len(near))
    bright = magnitude < LIMIT_G[field] + how.deeper
    near, pixel, magnitude = near[bright], pixel[bright], magnitude[bright]
    kept = rng.random(len(near)) >= how.missing
    near, pixel, magnitude = near[kept], pixel[kept], magnitude[kept]
    place, magnitude = solving.blended(pixel, np.arange(len(near)), magnitude)
    near, pixel = near[place], pixel[place]
    middle = (SIZE - 1) / 2
    radius = np.linalg.norm(pixel - middle, axis=1, keepdims=True) / (middle * math.sqrt(2))
    pixel = pixel + how.distortion * radius**2 * (pixel - middle) / (middle * math.sqrt(2))
    sigma = np.array([how.across or how.noise, how.noise])
    pixel = pixel + sigma * rng.standard_normal(pixel.shape)
    false, brightness = _false(how, rng, magnitude, LIMIT_G[field])
    star: Ints = np.concatenate([near, np.full(len(false), -1)])
    pixel, magnitude = np.concatenate([pixel, false]), np.concatenate([magnitude, brightness])
    order = np.argsort(magnitude, kind="stable")
    wrong = (1 + how.scale * rng.choice([-1, 1])) / rng.uniform(1 - TOLERANCE, 1 + TOLERANCE)
    spots = solving.spots_at(pixel[order], 10 ** (-0.4 * magnitude[order]), float(sigma.max()))
    return solving.BenchmarkView(spots, star[order], icrs_to_camera, camera.scaled(wrong))


def holds(field: int, kind: str, number: int, direction: Floats) -> bool:
    """Whether the frame of a sky contains a direction (3,), ICRS axes, without making the sky."""
    turn = Rotation.from_quat(seed_of(field, kind, number).standard_normal(4))
    x, y, z = turn.apply(direction)
    return z > 0 and max(abs(x), abs(y)) < z * math.tan(field * deg / 2)


def _near(known: Tracker, icrs_to_camera: Rotation) -> Ints:
    """Stars in the circle about the boresight that contains the frame."""
    boresight = icrs_to_camera.inv().apply([0.0, 0.0, 1.0])
    reach = 2 * math.sin(known.camera.half_diagonal / 2) * 1.001
    return np.array(known.tree.query_ball_point(boresight, reach), np.int64)


def _false(
    how: Kind, rng: np.random.Generator, magnitude: Floats, limit: float
) -> tuple[Floats, Floats]:
    """Places (n, 2) pixel and magnitudes (n,) of false spots."""
    like = magnitude if len(magnitude) else limit - np.abs(rng.exponential(1.0, 30))
    places, bright = [SIZE * rng.random((how.false, 2)) - 0.5], [rng.choice(like, how.false)]
    if how.clustered:
        at = SIZE * rng.random(2) + CLUSTER * rng.standard_normal((how.clustered, 2))
        places.append(np.clip(at, 0, SIZE - 1))
        bright.append(rng.choice(like, how.clustered))
    if how.column:
        x = np.full(how.column, np.floor(SIZE * rng.random()))
        places.append(np.column_stack([x, SIZE * rng.random(how.column) - 0.5]))
        bright.append(np.median(like) - rng.exponential(1.0, how.column))
    if how.planets:
        places.append(SIZE * rng.random((how.planets, 2)) - 0.5)
        bright.append(like.min() - 1 - rng.random(how.planets))
    return np.concatenate(places), np.concatenate(bright)


def noise_of(kind: str) -> float:
    """Pixel, the largest rms of a centroid along an axis."""
    how = KINDS[kind]
    return max(how.noise, how.across or 0.0)


def is_wrong(estimate: Rotation, seen: solving.BenchmarkView, kind: str) -> bool:
    """Whether an attitude error exceeds noise and distortion; true for any attitude of no sky."""
    if not KINDS[kind].sky:
        return True
    off = solving.away(estimate, seen)
    allowed = max(3.0, 6 * noise_of(kind)) + 2 * KINDS[kind].distortion
    focal = seen.believed.focal_length_px
    # A turn about the boresight moves the edge of the frame.
    return math.hypot(off[0], off[1]) * focal > allowed or abs(off[2]) * SIZE / 2 > 3 * allowed


def spots_array(spots: Spots) -> Floats:
    """(n, 3) pixel x and y from the middle of the frame, and flux."""
    centre = (SIZE - 1) / 2
    return np.column_stack([spots.x - centre, spots.y - centre, spots.flux])
