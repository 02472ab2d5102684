"""Mission -> Flown: what blinds each head at every step, from chunk to chunk of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.mission.bodies import PLANETS
from startrack.mission.heads import Mounted, Seen, Shadow, inside, look, mount, shadow_of
from startrack.mission.instants import Course, Instants, course_of
from startrack.mission.parameters import Loaded
from startrack.mission.vectors import dot, unit

CHUNK = 8192  # steps at once: their arrays fit into the cache of a core
SEASONS, PHASES = 52, 36  # parts of the mission and of the orbit, for maps
PLANET_KNOT = 3600.0  # second between two places of the planets


@dataclass(frozen=True, eq=False)
class Plan:
    """What is computed once for a mission, before its steps.

    course  where the spacecraft is and how it points
    heads   with their mountings and exclusion angles
    """

    loaded: Loaded
    course: Course
    heads: tuple[Mounted, ...]


def plan_of(loaded: Loaded) -> Plan:
    """The plan of a mission.

    Raises  ValueError where a file, the elements or a head cannot be used; ImportError without
            sgp4 for `orbit.tle`.
    """
    mission = loaded.mission
    course = course_of(mission)
    heads = tuple(
        mount(head, design.case) for head, design in zip(mission.heads, loaded.designs, strict=True)
    )
    return Plan(loaded, course, heads)


@dataclass(frozen=True, eq=False)
class Flown:
    """A mission at all of its m steps, with h heads.

    step       second between two steps
    blind      (h, m) Blind of each head, as numbers
    eclipse    (m,) whether the Earth hides the centre of the Sun
    closest    (h, 3) radian, least angle to Sun, Moon (not hidden by the Earth) and limb
    planets    (h, 5) second, in which each of PLANETS is within the half diagonal of the field
    rate       (h, 2) radian / second, largest rate across and about the boresight
    count      (SEASONS, PHASES) steps in each part of the mission and of the orbit
    valid_sum  (SEASONS, PHASES) valid heads, summed over these
    """

    step: float
    blind: NDArray[np.uint8]
    eclipse: NDArray[np.bool_]
    closest: Floats
    planets: Floats
    rate: Floats
    count: Floats
    valid_sum: Floats

    @property
    def valid(self) -> NDArray[np.intp]:
        """(m,) number of heads that nothing blinds."""
        return (self.blind == 0).sum(axis=0)


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some steps of a mission: the instants, the Earth's shadow, what each head sees."""

    first: int
    instants: Instants
    shadow: Shadow
    seen: tuple[Seen, ...]


def chunks(plan: Plan, first: int = 0, last: int | None = None) -> Iterator[Chunk]:
    """The steps of a mission from `first` to before `last`, in pieces."""
    mission = plan.loaded.mission
    end = mission.time.steps if last is None else last
    for begin in range(first, end, CHUNK):
        count = min(CHUNK, end - begin)
        step = mission.time.step
        yield at(plan, plan.course.at(begin * step, step, count), begin)


def at(plan: Plan, instants: Instants, first: int = 0) -> Chunk:
    """What the heads of a mission see at some instants."""
    shadow = shadow_of(instants)
    radiation = plan.loaded.mission.radiation
    saa = inside(radiation, instants) if radiation.saa == "blind" else None
    seen = tuple(look(head, instants, shadow, saa) for head in plan.heads)
    return Chunk(first, instants, shadow, seen)


def fly(plan: Plan, advance: Callable[[int], None] = lambda _: None) -> Flown:
    """All steps of a mission.

    advance  called with the number of steps after each chunk
    """
    steps, heads = plan.loaded.mission.time.steps, len(plan.heads)
    flown = Flown(
        plan.loaded.mission.time.step,
        np.empty((heads, steps), np.uint8),
        np.empty(steps, bool),
        np.full((heads, 3), np.inf),
        np.zeros((heads, len(PLANETS))),
        np.zeros((heads, 2)),
        np.zeros((SEASONS, PHASES)),
        np.zeros((SEASONS, PHASES)),
    )
    for chunk in chunks(plan):
        here = slice(chunk.first, chunk.first + len(chunk.instants.second))
        flown.eclipse[here] = chunk.shadow.sun
        for h, seen in enumerate(chunk.seen):
            flown.blind[h, here] = seen.blind
            flown.closest[h] = np.minimum(flown.closest[h], _closest(seen, chunk.shadow))
        _add_to_maps(chunk, flown, here)
        _count_planets(plan, chunk, flown)
        _keep_rates(plan, chunk, flown)
        advance(here.stop - here.start)
    return flown


def _add_to_maps(chunk: Chunk, flown: Flown, here: slice) -> None:
    steps = flown.blind.shape[1]
    season = np.arange(here.start, here.stop) * SEASONS // steps
    phase = np.minimum((chunk.instants.phase * (PHASES / math.tau)).astype(np.intp), PHASES - 1)
    cell, size = season * PHASES + phase, SEASONS * PHASES
    valid = (flown.blind[:, here] == 0).sum(axis=0)
    shape = (SEASONS, PHASES)
    flown.count[:] += np.bincount(cell, minlength=size).reshape(shape)
    flown.valid_sum[:] += np.bincount(cell, valid, minlength=size).reshape(shape)


def _closest(seen: Seen, shadow: Shadow) -> tuple[float, float, float]:
    return (
        float(np.where(shadow.sun, np.inf, seen.sun).min()),
        float(np.where(shadow.moon, np.inf, seen.moon).min()),
        float(seen.limb.min()),
    )


def _count_planets(plan: Plan, chunk: Chunk, flown: Flown) -> None:
    """Add the time in which a planet is in the field and the Earth does not fill it."""
    second = chunk.instants.second
    block = max(int(PLANET_KNOT / flown.step), 1)
    for low in range(0, len(second), block):
        part = slice(low, low + block)
        places = plan.course.bodies.planets_at(second[part].mean(keepdims=True))[..., 0]
        # The mean aberration of the part is within 0.0001 degrees.
        apparent = unit((places + chunk.instants.aberration[:, part].mean(axis=1)).T)
        for h, (head, seen) in enumerate(zip(plan.heads, chunk.seen, strict=True)):
            close = apparent.T @ seen.line[:, part] > np.cos(head.field)
            close &= seen.limb[part] > -head.field
            flown.planets[h] += flown.step * close.sum(axis=1)


def _keep_rates(plan: Plan, chunk: Chunk, flown: Flown) -> None:
    rate = chunk.instants.rate
    square = dot(rate, rate)
    for h, head in enumerate(plan.heads):
        about = head.boresight @ rate
        across = float(np.sqrt(np.maximum(square - about * about, 0).max()))
        flown.rate[h] = np.maximum(flown.rate[h], (across, float(np.abs(about).max())))
