"""Mission -> Flown: blindness of each head at every step, and the error of the fused attitude."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import Advance, Flags, Floats, Refused, Unit, printed, require_memory
from startrack.mission.fusion import fused_variance, platform_motion
from startrack.mission.heads import (
    HeadView,
    Mounted,
    Shadow,
    in_anomaly,
    look,
    mount,
    shadow_of,
    state_of,
)
from startrack.mission.instants import Instants, SpacecraftMotion, motion_of
from startrack.mission.parameters import Loaded
from startrack.mission.surrogate import (
    Conditions,
    Ranges,
    StrayLight,
    Surrogate,
    stray_light_of,
    surrogate_of,
)
from startrack.space import PLANETS, cross, dot, unit

CHUNK = 8192  # steps at once: their arrays fit into the cache of a core
PART = 64 * CHUNK  # steps that are kept together on disk
SEASONS, PHASES = 52, 36  # parts of the mission and of the orbit, for maps
BETAS = 72  # parts of the angle from the Sun to the plane of the orbit, for maps
PLANET_KNOT = 3600.0  # second between two computed places of the planets
SAMPLED = 4000  # instants from which the range of rates is taken
MARGIN = 0.02  # relative margin on the range of rates
LEAST_SQUARE = 1e-18  # radian^2, of a head without its platform's motion: 0.0002 arcsec
WORST = 10  # moments that are listed
# Fields of `Flown` that are summed over the parts of a mission.
SUMMED = ("planets", "count", "valid_sum", "known", "square_sum", "head_sum", "exactly", "by_beta")


@dataclass(frozen=True, eq=False)
class MissionPlan:
    """Values of a mission that are computed once, before the steps.

    motion      place and attitude of the spacecraft
    heads       with their mountings and exclusion angles
    surrogates  error of each head; empty if only the geometry is needed
    stray       stray light of each head; None if it has no baffle
    """

    loaded: Loaded
    motion: SpacecraftMotion
    heads: tuple[Mounted, ...]
    surrogates: tuple[Surrogate, ...] = ()
    stray: tuple[StrayLight | None, ...] = ()


def plan_of(
    loaded: Loaded, errors: bool = True, advance: Callable[[float], None] = lambda _: None
) -> MissionPlan:
    """The plan of a mission.

    advance called with the number of heads that are done, or a fraction of a head
    errors  whether the errors of the heads are also computed: one survey of the sky for each
            design, rate and background
    Raises  ValueError if a file, the elements or a head cannot be used; ImportError without sgp4
            for `orbit.tle`.
    """
    mission = loaded.mission
    if any(design.case.scene.sky for design in loaded.designs):
        raise Refused(
            "scene.sky must be left out in the designs of a mission, which is in an orbit"
        )
    motion = motion_of(mission)
    cases = [
        state_of(design.case, head, mission.check.seed, head.age, 0.0)
        for head, design in zip(mission.heads, loaded.designs, strict=True)
    ]
    heads = tuple(mount(head, case) for head, case in zip(mission.heads, cases, strict=True))
    if not errors:
        return MissionPlan(loaded, motion, heads)
    rates = _ranges(motion, heads)
    stray = [stray_light_of(case, head) for case, head in zip(cases, heads, strict=True)]
    made = dict[int, Surrogate]()
    groups = groups_of(loaded, heads)
    for same in groups:
        case, head = cases[same[0]], heads[same[0]]
        light = [case.scene.sky_g, *(light[1] for k in same if (light := stray[k]))]
        span = min(rates[k][0] for k in same), max(rates[k][1] for k in same)
        warm = head.temperature
        warmer = warm.offset - warm.swing, warm.offset + warm.swing
        age = None if head.age is None else (head.age, head.age + mission.time.duration)
        of_design, given = loaded.designs[same[0]].case, mission.heads[same[0]]
        state = partial(state_of, of_design, given, mission.check.seed)
        try:
            surrogate = surrogate_of(
                case,
                Ranges(span, min(light), warmer, age),
                state,
                partial(_advance_heads, advance, len(same)),
            )
        except Refused as error:
            raise Refused(f"head {head.name}: {error}") from None
        made |= dict.fromkeys(same, surrogate)
    surrogates = tuple(made[h] for h in range(len(heads)))
    lights = tuple(own_light[0] if own_light else None for own_light in stray)
    return MissionPlan(loaded, motion, heads, surrogates, lights)


def _advance_heads(advance: Callable[[float], None], heads: int, part: float) -> None:
    advance(part * heads)


def groups_of(loaded: Loaded, heads: Sequence[Mounted]) -> list[list[int]]:
    """Groups of heads with the same design, unit, age and temperature, which share an error."""
    groups = dict[Any, list[int]]()
    for h, (head, design) in enumerate(zip(heads, loaded.designs, strict=True)):
        own = design.case, head.age, head.temperature, loaded.mission.heads[h].unit
        groups.setdefault(own, []).append(h)
    return list(groups.values())


def _ranges(motion: SpacecraftMotion, heads: tuple[Mounted, ...]) -> list[tuple[float, float]]:
    """Slowest and fastest rate across each boresight, at some instants of the mission."""
    time = motion.mission.time
    every = max(time.steps // SAMPLED, 1)
    rate = motion.at(0.0, every * time.step, -(-time.steps // every)).rate
    ranges = []
    for head in heads:
        across = rate_across(head, rate)
        ranges.append(((1 - MARGIN) * float(across.min()), (1 + MARGIN) * float(across.max())))
    return ranges


def rate_across(head: Mounted, rate: Floats) -> Floats:
    """(n,) radian / second across the boresight, of rates (3, n) in body axes."""
    about = head.boresight @ rate
    return np.sqrt(np.maximum(dot(rate, rate) - about * about, 0.0))


@printed
@dataclass(frozen=True, eq=False)
class Flown:
    """Results of all m steps of a mission with h heads.

    step        second between two steps
    blind       (h, m) Blind of each head, as numbers
    eclipse     (m,) whether the Earth hides the centre of the Sun
    closest     (h, 3) radian, least angle to Sun, Moon (not hidden by the Earth) and limb
    planets     (h, 5) second, in which each of PLANETS is within the half diagonal of the field
    rate        (h, 2) radian / second, largest rate across and about the boresight
    count       (SEASONS, PHASES) number of steps in each part of the mission and of the orbit
    valid_sum   (SEASONS, PHASES) sum of the number of valid heads over these steps
    known       (SEASONS, PHASES) number of these steps with a valid head
    square_sum  (3, SEASONS, PHASES) radian^2, sum over these of the variance of the fused attitude
                about each axis of the body; zero without surrogates
    head_sum    (h, 4) over the valid steps of each head: their number, variance across and about
                (radian^2), and probability of an attitude
    exactly     (h + 1,) expected number of steps with an attitude of exactly 0, 1, ... heads
    worst       (second, radian) of steps with the largest error about a body axis, largest first
    by_beta     (7, BETAS, PHASES) sums over steps, by the angle from the Sun to the plane of the
                orbit, from -90 to 90 degrees, and by the place in the orbit: number of steps, of
                steps with a valid head, with two, of valid heads; variances about the body's axes
    chances     for each head, the probability of an attitude after each blinding
    """

    step: Annotated[float, Unit("s")]
    blind: NDArray[np.uint8]
    eclipse: Flags
    closest: Annotated[Floats, Unit("rad", "deg")]
    planets: Annotated[Floats, Unit("s")]
    rate: Annotated[Floats, Unit("rad/s", "deg/s")]
    count: Floats
    valid_sum: Floats
    known: Floats
    square_sum: Floats
    head_sum: Floats
    exactly: Floats
    worst: list[tuple[float, float]]
    by_beta: Floats
    chances: tuple[list[float], ...]

    @property
    def valid(self) -> NDArray[np.intp]:
        """(m,) number of heads that are not blind."""
        return (self.blind == 0).sum(axis=0)

    @property
    def rms(self) -> Floats:
        """(3,) radian, of the fused attitude about the body's axes, over the steps with one;
        infinite if there is none.
        """
        steps = self.known.sum()
        if not steps:
            return np.full(3, np.inf)
        return np.sqrt(self.square_sum.sum(axis=(1, 2)) / steps)

    @property
    def head_rms(self) -> Floats:
        """(h, 2) radian, across and about each boresight, over the valid steps of the head;
        infinite if there is none.
        """
        steps = self.head_sum[:, :1]
        square = np.where(steps > 0, self.head_sum[:, 1:3] / np.maximum(steps, 1), np.inf)
        return np.sqrt(square)


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some steps of a mission: the instants, the Earth's shadow, the view of each head.

    errors    for each head (n,) variances across and about (radian^2, with its alignment), and
              probability of an attitude; empty without surrogates
    moved     for each head (3, n) radian^2 about the axes of its camera: the part of its errors by
              the motion of the platform, which all heads share; None without such motion
    variance  (3, n) radian^2 of the fused attitude about the body's axes, infinite without one;
              None without surrogates
    """

    first: int
    instants: Instants
    shadow: Shadow
    seen: tuple[HeadView, ...]
    errors: tuple[tuple[Floats, Floats, Floats], ...] = ()
    moved: tuple[Floats, ...] | None = None
    variance: Floats | None = None


def at(plan: MissionPlan, instants: Instants, first: int = 0) -> Chunk:
    """View of each head of a mission at some instants."""
    mission = plan.loaded.mission
    shadow = shadow_of(instants, mission.structure)
    saa = in_anomaly(mission.radiation, instants)
    seen = tuple(look(head, instants, shadow, saa) for head in plan.heads)
    if not plan.surrogates:
        return Chunk(first, instants, shadow, seen)
    errors, moved = [], []
    for h, head in enumerate(plan.heads):
        conditions = conditions_of(plan, h, instants, seen[h], shadow)
        square, square_about, solved = plan.surrogates[h](conditions)
        errors.append((square + head.drift[0], square_about + head.drift[1], solved))
        if any(other.moved.any() for other in plan.heads):
            factor = plan.surrogates[h].factor(conditions)
            moved.append(head.moved[:, None] * factor[[0, 0, 1]] * np.ones(len(solved)))
    chunk = Chunk(first, instants, shadow, seen, tuple(errors), tuple(moved) or None)
    across, about = zip(*own_errors(chunk), strict=True)
    valid = [view.blind == 0 for view in seen]
    boresights = [head.boresight for head in plan.heads]
    common = mission.common.variance
    motions = platform_motions(plan, chunk)
    return replace(
        chunk, variance=fused_variance(boresights, across, about, valid, common, motions)
    )


def own_errors(chunk: Chunk) -> list[tuple[Floats, Floats]]:
    """Variances (n,) across and about of each head, without the motion of the platform."""
    if chunk.moved is None:
        return [(across, about) for across, about, _ in chunk.errors]
    return [
        (
            np.maximum(across - (moved[0] + moved[1]) / 2, LEAST_SQUARE),
            np.maximum(about - moved[2], LEAST_SQUARE),
        )
        for (across, about, _), moved in zip(chunk.errors, chunk.moved, strict=True)
    ]


def platform_motions(plan: MissionPlan, chunk: Chunk) -> list[Floats] | None:
    """(n, 3, 3) of each head, as `platform_motion`; None without any."""
    if chunk.moved is None:
        return None
    return [
        platform_motion(head.axes, np.sqrt(moved.T))
        for head, moved in zip(plan.heads, chunk.moved, strict=True)
    ]


def conditions_of(
    plan: MissionPlan, h: int, instants: Instants, seen: HeadView, shadow: Shadow
) -> Conditions:
    """Conditions at some instants on which the error of a head depends."""
    head, stray = plan.heads[h], plan.stray[h]
    background = stray(seen, shadow) if stray else None
    warmer, age = head.warmer(instants.phase), head.aged(instants.second)
    return Conditions(seen.line, rate_across(head, instants.rate), background, warmer, age)


def fly(plan: MissionPlan, advance: Advance = lambda _: None) -> Flown:
    """All steps of a mission.

    advance  called with the number of steps after each part
    """
    parts = []
    for first, count in parts_of(plan.loaded.mission.time.steps):
        parts.append(fly_part(plan, first, count))
        advance(count)
    return merged(parts)


def parts_of(steps: int) -> list[tuple[int, int]]:
    """First step and number of steps of each part of a mission; the parts are computed
    separately."""
    return [(first, min(PART, steps - first)) for first in range(0, steps, PART)]


def fly_part(plan: MissionPlan, first: int, count: int) -> Flown:
    """Some steps of a mission, from the step `first` on."""
    heads, time = len(plan.heads), plan.loaded.mission.time
    require_memory(time.steps * (2 * heads + 16), f"a mission of {time.steps} steps")
    shape = (SEASONS, PHASES)
    flown = Flown(
        step=time.step,
        blind=np.empty((heads, count), np.uint8),
        eclipse=np.empty(count, bool),
        closest=np.full((heads, 3), np.inf),
        planets=np.zeros((heads, len(PLANETS))),
        rate=np.zeros((heads, 2)),
        count=np.zeros(shape),
        valid_sum=np.zeros(shape),
        known=np.zeros(shape),
        square_sum=np.zeros((3, *shape)),
        head_sum=np.zeros((heads, 4)),
        exactly=np.zeros(heads + 1),
        worst=[],
        by_beta=np.zeros((7, BETAS, PHASES)),
        chances=tuple([] for _ in range(heads)),
    )
    before = np.zeros(heads, np.uint8)
    if first:
        last = at(plan, plan.motion.at((first - 1) * time.step, time.step, 1))
        before[:] = [view.blind[0] for view in last.seen]
    for begin in range(first, first + count, CHUNK):
        size = min(CHUNK, first + count - begin)
        chunk = at(plan, plan.motion.at(begin * time.step, time.step, size), begin)
        here = slice(begin - first, begin - first + size)
        flown.eclipse[here] = chunk.shadow.sun
        for h, seen in enumerate(chunk.seen):
            flown.blind[h, here] = seen.blind
        _keep_extremes(plan, chunk, flown)
        _add_to_maps(chunk, flown, time.steps)
        _count_planets(plan, chunk, flown)
        if plan.surrogates:
            _add_errors(chunk, flown)
            _add_chances(chunk, flown, before)
        before[:] = [view.blind[-1] for view in chunk.seen]
    return flown


def merged(parts: Sequence[Flown]) -> Flown:
    """A mission merged from its parts, in order."""

    def each(name: str) -> Floats:
        return np.array([getattr(part, name) for part in parts])

    summed: dict[str, Any] = {name: each(name).sum(axis=0) for name in SUMMED}
    every = (moment for part in parts for moment in part.worst)
    worst = sorted(every, key=lambda moment: -moment[1])
    return replace(
        parts[0],
        blind=np.concatenate([part.blind for part in parts], axis=1),
        eclipse=np.concatenate([part.eclipse for part in parts]),
        closest=each("closest").min(axis=0),
        rate=each("rate").max(axis=0),
        worst=worst[:WORST],
        chances=tuple(
            [chance for part in parts for chance in part.chances[h]]
            for h in range(len(parts[0].chances))
        ),
        **summed,
    )


def _add_to_maps(chunk: Chunk, flown: Flown, steps: int) -> None:
    own = chunk.instants
    season = np.arange(chunk.first, chunk.first + len(own.second)) * SEASONS // steps
    phase = np.minimum((own.phase * (PHASES / math.tau)).astype(np.intp), PHASES - 1)
    sine = dot(unit(cross(own.place, own.speed)), own.sun)
    beta = (np.arcsin(np.clip(sine, -1, 1)) / math.pi + 0.5) * BETAS
    other = np.minimum(beta.astype(np.intp), BETAS - 1) * PHASES + phase
    cell, size = season * PHASES + phase, SEASONS * PHASES
    valid = np.sum([view.blind == 0 for view in chunk.seen], axis=0)
    any_valid = valid > 0

    def add(total: Floats, values: Floats) -> None:
        total += np.bincount(cell, values, minlength=size).reshape(total.shape)

    add(flown.count, np.ones(len(cell)))
    add(flown.valid_sum, valid)
    add(flown.known, any_valid)
    sums = [np.ones(len(cell)), any_valid, valid > 1, valid]
    if chunk.variance is not None:
        squares = [np.where(any_valid, variance, 0.0) for variance in chunk.variance]
        for total, square in zip(flown.square_sum, squares, strict=True):
            add(total, square)
        sums += squares
    for total, values in zip(flown.by_beta, sums, strict=False):
        total += np.bincount(other, values, minlength=BETAS * PHASES).reshape(total.shape)


def _add_errors(chunk: Chunk, flown: Flown) -> None:
    """Mean errors of each head, chances of 0, 1, ... attitudes, the worst moment of a chunk."""
    assert chunk.variance is not None
    exactly = [np.ones(len(chunk.instants.second))]
    for total, seen, (across, about, solved) in zip(
        flown.head_sum, chunk.seen, chunk.errors, strict=True
    ):
        valid = seen.blind == 0
        total += [valid.sum(), across @ valid, about @ valid, solved @ valid]
        chance = solved * valid
        lost = [probability * (1 - chance) for probability in exactly] + [np.zeros(1)]
        won = [np.zeros(1)] + [probability * chance for probability in exactly]
        exactly = [a + b for a, b in zip(lost, won, strict=True)]
    flown.exactly[:] += [probability.sum() for probability in exactly]
    size = np.where(np.isfinite(chunk.variance[0]), chunk.variance.max(axis=0), -1.0)
    worst = int(size.argmax())
    if size[worst] > 0:
        flown.worst.append((float(chunk.instants.second[worst]), math.sqrt(size[worst])))


def _add_chances(chunk: Chunk, flown: Flown, before: NDArray[np.uint8]) -> None:
    """Keep the probability of an attitude at the first step after each blinding.

    before  (h,) Blind of each head at the step before the chunk
    """
    for chances, last, seen, errors in zip(
        flown.chances, before, chunk.seen, chunk.errors, strict=True
    ):
        ends = np.flatnonzero((np.append(last, seen.blind[:-1]) > 0) & (seen.blind == 0))
        chances.extend(errors[2][ends].tolist())


def _keep_extremes(plan: MissionPlan, chunk: Chunk, flown: Flown) -> None:
    """Least angles to Sun, Moon and limb, and largest rates, of each head."""
    shadow, rate = chunk.shadow, chunk.instants.rate
    for h, (head, seen) in enumerate(zip(plan.heads, chunk.seen, strict=True)):
        sun, moon = (
            np.where(hidden, np.inf, body).min()
            for hidden, body in ((shadow.sun, seen.sun), (shadow.moon, seen.moon))
        )
        flown.closest[h] = np.minimum(flown.closest[h], (sun, moon, seen.limb.min()))
        largest = rate_across(head, rate).max(), np.abs(head.boresight @ rate).max()
        flown.rate[h] = np.maximum(flown.rate[h], largest)


def _count_planets(plan: MissionPlan, chunk: Chunk, flown: Flown) -> None:
    """Add the time in which a planet is in the field and the Earth does not fill it."""
    second = chunk.instants.second
    block = max(int(PLANET_KNOT / flown.step), 1)
    for low in range(0, len(second), block):
        part = slice(low, low + block)
        places = plan.motion.bodies.planets_at(second[part].mean(keepdims=True))[..., 0]
        # The mean aberration of the part is within 0.002 degrees.
        apparent = unit((places + chunk.instants.aberration[:, part].mean(axis=1)).T)
        for h, (head, seen) in enumerate(zip(plan.heads, chunk.seen, strict=True)):
            close = apparent.T @ seen.line[:, part] > np.cos(head.field)
            close &= seen.limb[part] > -head.field
            flown.planets[h] += flown.step * close.sum(axis=1)
