"""Plan of a mission -> mountings of its heads that meet its requirements best."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from startrack.budget import exclusions
from startrack.core import Advance, Flags, Floats, Refused, arcsec, deg
from startrack.design import Case, Requirements, replaced_all
from startrack.mission.engine import MissionPlan
from startrack.mission.fusion import fused_variance, platform_motion
from startrack.mission.heads import (
    MOON_RADIUS,
    SUN_RADIUS,
    BlindingLimits,
    Mounted,
    Shadow,
    in_anomaly,
    limits_of,
    look,
    shadow_of,
)
from startrack.mission.instants import Instants
from startrack.mission.parameters import Head, Loaded, Mission, MissionRequirements, mounted
from startrack.optimise import Search, minimise
from startrack.space import GM

WINDOWS, POINTS = 96, 100  # orbits over the mission, and instants in each
GRID = 10 * deg  # between the directions tried for each head in turn
COARSE = 15 * deg  # the same, when many searches are compared
DENSITY = 950.0  # kg / m^3, median of seven trackers that were built (see `Requirements.density`)
ROUNDS = 6  # most rounds in which each head is moved in turn
REACH = 20 * deg  # range of nlopt's search around that
EVALUATIONS = 400
MISSED = 10.0  # weight of a requirement that is missed, to one that is met; chosen by hand
MET = 0.1  # weight of a requirement that is met, to the error; chosen by hand
FORBIDDEN = 1e3  # score for each radian inside a keep-out cone
TUBE_LENGTH = "instrument.tube.length"
LENGTHS = 9  # of tubes, between which the search interpolates
FINE: Floats = np.arange(0.2, 90.0, 0.2) * deg  # at which their exclusion angles are sought


@dataclass(frozen=True, eq=False)
class PlacementSamples:
    """Some orbits of a mission, each with consecutive instants.

    step      second between two of them
    windows   number of orbits
    instants, shadow, saa   at all of them, one orbit after the other
    """

    step: float
    windows: int
    instants: Instants
    shadow: Shadow
    saa: Flags | None


@dataclass(frozen=True)
class PlacementQuality:
    """Quality of a set of mountings.

    longest    second, longest time without a valid head within one orbit of the samples
    one, two   fraction of the time with at least one, and two, valid heads
    error      radian, rms about the worst body axis while a head is valid; infinite if none is
    keep_out   radian, sum of the depths of boresights inside keep-out cones
    """

    longest: float
    one: float
    two: float
    error: float
    keep_out: float

    def score(self, needs: MissionRequirements, step: float) -> float:
        """Score, smaller is better: first the missed requirements, then the error.

        The sum over requirements of MISSED * excess + MET * ratio, with ratio = value / limit, plus
        the error over its limit, or over one arcsecond without a limit.
        """
        size = self.error / (needs.max_error or arcsec)
        return self.missed(needs, step) + MET * sum(self._ratios(needs, step)) + size

    def missed(self, needs: MissionRequirements, step: float) -> float:
        """The part of the score for missed requirements and violated keep-out cones."""
        excess = [max(ratio - 1, 0.0) for ratio in self._ratios(needs, step)]
        if needs.max_error:
            excess.append(max(self.error / needs.max_error - 1, 0.0))
        return MISSED * sum(excess) + FORBIDDEN * self.keep_out

    def _ratios(self, needs: MissionRequirements, step: float) -> list[float]:
        """Ratio of value to limit of each requirement on blindness and availability."""
        ratios = []
        if needs.max_blind is not None:
            ratios.append(self.longest / max(needs.max_blind, step))
        for value, limit in (
            (self.one, needs.availability_one),
            (self.two, needs.availability_two),
        ):
            if limit is not None:
                ratios.append((1 - value) / max(1 - limit, 1e-6))
        return ratios


def sample(plan: MissionPlan) -> PlacementSamples:
    """Orbits evenly distributed over the mission."""
    mission = plan.loaded.mission
    first = plan.motion.at(0.0, 1.0, 2)
    place, speed = (float(np.linalg.norm(vector[:, 0])) for vector in (first.place, first.speed))
    period = math.tau * math.sqrt(1 / (2 / place - speed**2 / GM) ** 3 / GM)
    period = min(period, mission.time.duration)
    step = period / POINTS
    windows = max(min(WINDOWS, int(mission.time.duration / period)), 1)
    begin = np.linspace(0, mission.time.duration - period, windows)
    parts = [plan.motion.at(float(second), step, POINTS) for second in begin]
    instants = Instants(
        *(
            np.concatenate([getattr(part, field.name) for part in parts], axis=-1)
            for field in fields(Instants)
        )
    )
    saa = in_anomaly(mission.radiation, instants)
    return PlacementSamples(step, windows, instants, shadow_of(instants, mission.structure), saa)


def blind_at(samples: PlacementSamples, head: Mounted, boresight: Floats) -> Flags:
    """(n,) whether a head is blind at the samples, with a boresight (3,) in body axes."""
    axes = np.column_stack([np.zeros((3, 2)), boresight])
    moved = replace(head, axes=axes)
    return np.asarray(look(moved, samples.instants, samples.shadow, samples.saa).blind > 0)


def _longest(holds: Flags, windows: int) -> int:
    """Most steps in a row that hold within one window."""
    rows = np.pad(holds.reshape(windows, -1), ((0, 0), (1, 1))).astype(np.int8).ravel()
    edge = np.flatnonzero(np.diff(rows))
    return int((edge[1::2] - edge[::2]).max(initial=0))


@dataclass(frozen=True, eq=False)
class Placement:
    """Mountings that were found.

    mission        with azimuth and elevation of each head
    before, after  quality of the file's mountings and of these mountings, at the samples
    evaluations    number of sets of mountings that were tried
    ending         of nlopt's search
    """

    mission: Mission
    before: PlacementQuality
    after: PlacementQuality
    evaluations: int
    ending: str


def place(
    plan: MissionPlan,
    advance: Advance = lambda _: None,
    grid_step: float | None = None,
    evaluations: int | None = None,
) -> Placement:
    """Find mountings for the heads of a mission by their requirements.

    Each head in turn takes the best direction of a grid over the sphere, until none moves; then
    nlopt (Sbplx) moves all together within 20 degrees.

    plan      with errors
    advance   called with the number of evaluations after each of them
    grid_step    radian between directions of the grid; None: 10 degrees
    evaluations  largest number for nlopt; 0: the best of the grid is the result
    Accuracy  model: 96 orbits of the mission, at 100 instants each; each head has its mean error
              over the sky at all times. Numerical: nlopt ends at steps of 0.04 degrees; the search
              may end in an optimum that is not the best of all.
    """
    mission = plan.loaded.mission
    samples, needs = sample(plan), mission.requirements
    lines = [head.boresight for head in plan.heads]
    around = _Around(plan, samples, lines)
    tried = 0

    def worth(lines: Sequence[Floats], blind: Sequence[Flags]) -> PlacementQuality:
        nonlocal tried
        tried += 1
        advance(1)
        return around.worth(lines, blind)

    def score(lines: Sequence[Floats], blind: Sequence[Flags]) -> float:
        return worth(lines, blind).score(needs, samples.step)

    before = worth(lines, around.blind(lines))
    grid = sphere(grid_step or GRID)
    lines = _best_on_grid(
        score, lines, around.blind(lines), grid, _masks(samples, plan.heads, grid)
    )
    around = replace(around, lines=lines)

    def of(coordinates: Floats) -> float:
        there = around.moved(coordinates)
        return score(there, around.blind(there))

    ending, limit = "the best of the grid", EVALUATIONS if evaluations is None else evaluations
    if limit:
        search = Search(evaluations=limit, first_step=0.1, last_step=1e-3)
        least_score = minimise(of, np.full(2 * len(lines), 0.5), search)
        lines, ending = around.moved(least_score.coordinates), least_score.ending
    after = worth(lines, around.blind(lines))
    return Placement(_mounted_at(mission, lines), before, after, tried, ending)


def _best_on_grid(
    score: Callable[[Sequence[Floats], Sequence[Flags]], float],
    lines: list[Floats],
    blind: list[Flags],
    grid: Floats,
    masks: Sequence[Flags],
) -> list[Floats]:
    """Boresights of least score; each head in turn takes its best one until none moves.

    blind  whether each head is blind at each instant
    masks  the same, of each head at each direction of the grid
    """
    best = score(lines, blind)
    for _ in range(ROUNDS):
        start = best
        for h in range(len(lines)):
            for line, mask in zip(grid, masks[h], strict=True):
                value = score(_with(lines, h, line), _with(blind, h, mask))
                if value < best - 1e-9:
                    best, lines, blind = value, _with(lines, h, line), _with(blind, h, mask)
        if best > start - 1e-9:
            break
    return lines


def moved_plan(plan: MissionPlan, mission: Mission) -> MissionPlan:
    """The plan with the mountings of another mission, otherwise unchanged."""
    heads = tuple(
        replace(head, axes=moved.mounting.as_matrix())
        for head, moved in zip(plan.heads, mission.heads, strict=True)
    )
    return replace(plan, loaded=Loaded(mission, plan.loaded.designs), heads=heads)


@dataclass(frozen=True)
class Trade:
    """A number of heads with a baffle, placed by a coarse search.

    heads    number of heads
    angle    radian, the exclusion angle of the Sun by the baffle
    length   metre, of the baffle before the lens; the longest if designs differ
    mass     kilogram, of all heads with their baffles
    quality  at the samples of the search
    met      whether the requirements of the mission are met at these samples
    """

    heads: int
    angle: float
    length: float
    mass: float
    quality: PlacementQuality
    met: bool


def trades(
    plan: MissionPlan,
    counts: Sequence[int],
    angles: Sequence[float],
    advance: Advance = lambda _: None,
) -> list[Trade]:
    """Each number of heads with each angle of the baffle, at the mountings found by a search.

    For more heads than in the mission, its heads are repeated in order. If a design has a tube
    (`instrument.tube`), the tube gets the length with this exclusion angle of the Sun; the
    exclusion angles of Moon and Earth and the mass follow from it. For other designs, length and
    mass are from the cost laws (`Requirements`), by default with the density of built trackers, and
    the exclusion angles of Moon and Earth stay.

    advance  called with 1 after each of them
    Raises   ValueError if an angle lies in the field of a head, or if no tube from a quarter to
             four times the design's length has it.
    """
    results = []
    for count in counts:
        for angle in angles:
            changed = _with_heads(plan, count, angle)
            results.append(_trade(changed, angle, place(changed, grid_step=COARSE, evaluations=0)))
            advance(1)
    return results


def _trade(plan: MissionPlan, angle: float, placement: Placement) -> Trade:
    """A placement of the heads of a plan, whose baffles have this angle."""
    designs, quality = plan.loaded.designs, placement.after
    length = max(
        _baffle_length(_behind(head, design.case, angle)[1], angle)
        for head, design in zip(plan.loaded.mission.heads, designs, strict=True)
    )
    met = _meets(quality, plan.loaded.mission.requirements)
    return Trade(len(designs), angle, length, _mass(plan, angle), quality, met)


def _mass(plan: MissionPlan, angle: float) -> float:
    """Kilogram of all heads, with baffles of this angle."""
    total = 0.0
    for head, design in zip(plan.loaded.mission.heads, plan.loaded.designs, strict=True):
        needs = design.campaign.requirements if design.campaign else Requirements()
        case = _behind(head, design.case, angle)[1]
        if not case.instrument.tube:
            needs = replace(needs, baffle_angle=angle, density=needs.density or DENSITY)
        total += needs.mass(case)
    return total


def lightest(
    plan: MissionPlan,
    counts: Sequence[int],
    angles: tuple[float, float],
    advance: Advance = lambda _: None,
    evaluations: int = EVALUATIONS,
) -> list[tuple[Trade, Placement]]:
    """The lightest baffles and the placement that meet the requirements, for each number of heads.

    Directions of all heads and the angle of their baffles are searched together. From the mountings
    of a coarse search with the longest baffle, and with the shortest, nlopt (Sbplx) minimises

        mass / mass with the longest baffle + score of missed requirements

    A last search, at that angle, minimises the error.

    angles       radian, shortest and longest exclusion angle of the Sun that a baffle may have
    advance      called with 1 after each number of heads
    evaluations  number for each of these searches
    Returns      in the order of `counts`; a Trade says whether the requirements are met
    Raises       ValueError as `trades`, or where the two do not increase
    Accuracy     as `place`; angles of tubes are interpolated between 9 lengths, within 0.2 degrees.
    """
    if not angles[0] < angles[1]:
        raise Refused(f"angles must increase, got {angles[0] / deg:.3g}, {angles[1] / deg:.3g} deg")
    placements = []
    for count in counts:
        placements.append(_lightest(plan, count, angles, evaluations))
        advance(1)
    return placements


def _lightest(
    plan: MissionPlan, count: int, angles: tuple[float, float], evaluations: int
) -> tuple[Trade, Placement]:
    low, high = angles
    longest = _with_heads(plan, count, low)
    samples, needs = sample(longest), longest.loaded.mission.requirements
    heaviest = _mass(longest, low)
    search = Search(evaluations=evaluations, first_step=0.1, last_step=1e-3)
    starts = [
        place(_with_heads(plan, count, angle), grid_step=COARSE, evaluations=0) for angle in angles
    ]
    arounds = [
        _Around(longest, samples, [head.mounting.as_matrix()[:, 2] for head in start.mission.heads])
        for start in starts
    ]

    def angle_at(coordinates: Floats) -> float:
        return low + float(coordinates[-1]) * (high - low)

    def weight(around: _Around, coordinates: Floats) -> float:
        angle = angle_at(coordinates)
        missed = around.quality(coordinates[:-1], angle).missed(needs, samples.step)
        return _mass(longest, angle) / heaviest + missed

    middle = np.full(2 * count, 0.5)
    searched = [
        minimise(partial(weight, around), np.append(middle, end), search)
        for around, end in zip(arounds, (0.0, 1.0), strict=True)
    ]
    best, around = min(zip(searched, arounds, strict=True), key=lambda pair: pair[0].score)
    angle = angle_at(best.coordinates)

    def error(coordinates: Floats) -> float:
        return around.quality(coordinates, angle).score(needs, samples.step)

    last = minimise(error, best.coordinates[:-1], replace(search, first_step=0.05))
    changed = _with_heads(plan, count, angle)
    mission = _mounted_at(changed.loaded.mission, around.moved(last.coordinates))
    tried = sum(start.evaluations for start in starts) + last.evaluations
    tried += sum(result.evaluations for result in searched)
    quality = around.quality(last.coordinates, angle)
    placement = Placement(mission, starts[0].after, quality, tried, last.ending)
    return _trade(moved_plan(changed, mission), angle, placement), placement


@dataclass(frozen=True, eq=False)
class _Around:
    """Heads of a plan within REACH of some directions, at the samples of a search."""

    plan: MissionPlan
    samples: PlacementSamples
    lines: Sequence[Floats]

    @cached_property
    def _tangents(self) -> list[tuple[Floats, Floats]]:
        """Two unit vectors across each direction."""
        turns = [mounted(*angles_of(line)).as_matrix() for line in self.lines]
        return [(axes[:, 0], axes[:, 1]) for axes in turns]

    @cached_property
    def _variances(self) -> list[tuple[float, float]]:
        """Radian^2 across and about, over the sky, at the middle rate and the faintest sky.

        Without the motion of the platform.
        """
        variances = []
        for head, surrogate in zip(self.plan.heads, self.plan.surrogates, strict=True):
            table = surrogate.table[:2, len(surrogate.rate) // 2, -1, -1, -1]
            motion = (head.moved[0] + head.moved[1]) / 2, head.moved[2]
            across, about = np.exp(table).mean(axis=1) + head.drift - motion
            variances.append((float(across), float(about)))
        return variances

    def moved(self, coordinates: Floats) -> list[Floats]:
        """Directions (3,) at coordinates (2 h,) of the unit cube, whose middle is the start."""
        offset = (coordinates.reshape(-1, 2) - 0.5) * (2 * REACH)
        turned = [
            line + a * math.tan(u) + b * math.tan(v)
            for line, (a, b), (u, v) in zip(self.lines, self._tangents, offset, strict=True)
        ]
        return [line / np.linalg.norm(line) for line in turned]

    def blind(self, lines: Sequence[Floats], sun: float | None = None) -> list[Flags]:
        """Times at which heads along some directions are blind, with baffles of an exclusion angle
        of the Sun (radian); None: each with its own."""
        heads = self.plan.heads
        if sun is not None:
            heads = _mounted_behind(self.plan, sun)
        return [blind_at(self.samples, *pair) for pair in zip(heads, lines, strict=True)]

    def worth(self, lines: Sequence[Floats], blind: Sequence[Flags]) -> PlacementQuality:
        """Quality of heads along some directions, given the samples at which they are blind."""
        mission, samples = self.plan.loaded.mission, self.samples
        valid = [~hidden for hidden in blind]
        many = np.sum(valid, axis=0)
        across, about = np.repeat(np.transpose(self._variances)[..., None], len(many), axis=2)
        motions = None
        if any(head.moved.any() for head in self.plan.heads):
            motions = [
                np.broadcast_to(
                    platform_motion(mounted(*angles_of(line)).as_matrix(), np.sqrt(head.moved)),
                    (len(many), 3, 3),
                )
                for head, line in zip(self.plan.heads, lines, strict=True)
            ]
        common = mission.common.variance
        variance = fused_variance(lines, across, about, valid, common, motions)
        covered = many > 0
        square = variance[:, covered].mean(axis=1).max() if covered.any() else math.inf
        inside_cones = sum(cone.depth(line) for cone in mission.keep_out for line in lines)
        longest = _longest(many == 0, samples.windows) * samples.step
        fractions = float(covered.mean()), float((many > 1).mean())
        return PlacementQuality(longest, *fractions, math.sqrt(float(square)), inside_cones)

    def quality(self, coordinates: Floats, sun: float) -> PlacementQuality:
        """Quality at coordinates, with an exclusion angle of the Sun (radian)."""
        lines = self.moved(coordinates)
        return self.worth(lines, self.blind(lines, sun))


def _mounted_at(mission: Mission, lines: Sequence[Floats]) -> Mission:
    """The mission with its heads along some directions."""
    heads = tuple(
        replace(head, azimuth=float(a), elevation=float(e), roll=0.0, camera_to_body=None)
        for head, (a, e) in zip(mission.heads, map(angles_of, lines), strict=True)
    )
    return replace(mission, heads=heads)


def _with_heads(plan: MissionPlan, count: int, angle: float) -> MissionPlan:
    """The plan with `count` heads behind baffles with an exclusion angle of the Sun."""
    of = [k % len(plan.heads) for k in range(count)]
    heads = []
    for n, k in enumerate(of):
        half = plan.loaded.designs[k].case.instrument.camera.half_diagonal
        if angle <= half + SUN_RADIUS:
            raise Refused(
                f"angle of the baffle must be above the half diagonal of the field, "
                f"{half / deg:.3g} deg, got {angle / deg:.3g} deg"
            )
        head = plan.loaded.mission.heads[k]
        heads.append(replace(head, name=f"{n + 1} {head.name}"))
    needs = plan.loaded.mission.requirements
    if count < 2:
        needs = replace(needs, availability_two=None)
    changed = replace(
        plan,
        loaded=Loaded(
            replace(plan.loaded.mission, heads=tuple(heads), requirements=needs),
            tuple(plan.loaded.designs[k] for k in of),
        ),
        heads=tuple(plan.heads[k] for k in of),
        surrogates=tuple(plan.surrogates[k] for k in of),
        stray=tuple(plan.stray[k] for k in of),
    )
    mounted_heads = _mounted_behind(changed, angle)
    heads = [
        _behind(head, design.case, angle)[0]
        for head, design in zip(heads, changed.loaded.designs, strict=True)
    ]
    mission = replace(changed.loaded.mission, heads=tuple(heads))
    return replace(changed, loaded=replace(changed.loaded, mission=mission), heads=mounted_heads)


def _mounted_behind(plan: MissionPlan, angle: float) -> tuple[Mounted, ...]:
    """The heads of a plan behind baffles with an exclusion angle of the Sun."""
    changed = []
    for mounted_head, head, design in zip(
        plan.heads, plan.loaded.mission.heads, plan.loaded.designs, strict=True
    ):
        limits = replace(mounted_head.limits, sun=angle)
        if design.case.instrument.tube:
            limits = limits_of(*_behind(head, design.case, angle))
        changed.append(replace(mounted_head, name=head.name, limits=limits))
    return tuple(changed)


def _behind(head: Head, case: Case, angle: float) -> tuple[Head, Case]:
    """A head, and its design, behind a baffle with a given exclusion angle of the Sun.

    A tube gets the length with this angle; the exclusion angles of Moon and Earth follow from it.
    """
    given = replace(head.exclusion, sun=angle)
    if case.instrument.tube is None:
        return replace(head, exclusion=given), case
    length, (sun, moon, earth) = _tubes(case, given.altitude)
    if not sun[-1] <= angle <= sun[0]:
        raise Refused(
            f"angle of a baffle with instrument.tube must lie in [{sun[-1] / deg:.3g}, "
            f"{sun[0] / deg:.3g}] deg, which need four times to a quarter of its length, got "
            f"{angle / deg:.3g} deg"
        )
    metre = float(np.exp(np.interp(-angle, -sun, np.log(length))))
    of_tube = {
        "moon": float(np.interp(metre, length, moon)),
        "earth": float(np.interp(metre, length, earth)),
    }
    exclusion = replace(given, **(of_tube | given.angles))
    return replace(head, exclusion=exclusion), replaced_all(case, {TUBE_LENGTH: metre})


@lru_cache(maxsize=8)
def _tubes(case: Case, altitude: float) -> tuple[Floats, Floats]:
    """Lengths (n,) metre of the tube of a design, rising, and its exclusion angles (3, n) radian of
    Sun, Moon and Earth there, falling."""
    assert case.instrument.tube
    length = case.instrument.tube.length * np.geomspace(0.25, 4.0, LENGTHS)
    rows = list[list[float]]()
    for metre in length:
        try:
            tube = replaced_all(case, {TUBE_LENGTH: float(metre)})
        except Refused:  # a wall that is given is narrower than the entrance of so long a tube
            break
        rows.append([exclusion.least() for exclusion in exclusions(tube, FINE, altitude).values()])
    half = case.instrument.camera.half_diagonal
    field = np.array([[half + SUN_RADIUS], [half + MOON_RADIUS], [half]])
    angles = np.maximum(np.minimum.accumulate(np.array(rows).T, axis=1), field)
    finite = np.isfinite(angles.sum(axis=0))
    if finite.sum() < 2:
        raise Refused(
            "instrument.tube must keep out Sun, Moon and Earth at some angle below 90 deg at "
            "several lengths from a quarter to four times its own"
        )
    return length[: len(finite)][finite], angles[:, finite]


def _baffle_length(case: Case, angle: float) -> float:
    """Metre, of a tube, or of a baffle outside the field by the law of `Requirements`."""
    if tube := case.instrument.tube:
        return tube.length
    field = math.tan(case.instrument.camera.half_diagonal)
    return case.instrument.optics.aperture / (math.tan(angle) - field)


def _meets(quality: PlacementQuality, needs: MissionRequirements) -> bool:
    return not (
        (needs.max_blind is not None and quality.longest > needs.max_blind)
        or (needs.availability_one is not None and quality.one < needs.availability_one)
        or (needs.availability_two is not None and quality.two < needs.availability_two)
        or (needs.max_error is not None and quality.error > needs.max_error)
    )


def angles_of(boresight: Floats) -> tuple[float, float]:
    """Azimuth and elevation (radian) of a boresight (3,) in body axes."""
    x, y, z = boresight
    return math.atan2(y, x), math.asin(min(max(z, -1.0), 1.0))


def sphere(step: float) -> Floats:
    """(n, 3) unit vectors about one step (radian) apart, in rows of equal elevation."""
    rows = []
    for row in np.linspace(-math.pi / 2, math.pi / 2, round(math.pi / step) + 1):
        count = max(round(math.tau * math.cos(row) / step), 1)
        turn = np.arange(count) * math.tau / count
        rows.append(
            np.column_stack(
                [
                    math.cos(row) * np.cos(turn),
                    math.cos(row) * np.sin(turn),
                    np.full(count, math.sin(row)),
                ]
            )
        )
    return np.concatenate(rows)


def map_of(
    plan: MissionPlan, head: int, step: float = 5 * deg
) -> tuple[Floats, Floats, Floats, Floats]:
    """Blind time of one head, and score of the search, over all directions of its boresight.

    plan     with errors
    step     radian between two of them
    Returns  (n, 3) directions in body axes; (n,) fraction of the time in which the head is blind;
             (n,) second, the longest such time within an orbit; (n,) score of all heads with the
             others at their places; smaller is better
    """
    samples, lines, needs = sample(plan), sphere(step), plan.loaded.mission.requirements
    around = _Around(plan, samples, [head_.boresight for head_ in plan.heads])
    blind = [blind_at(samples, plan.heads[head], line) for line in lines]
    longest = [_longest(mask, samples.windows) * samples.step for mask in blind]
    own, hidden = around.lines, around.blind(around.lines)
    qualities = (
        around.worth(_with(own, head, line), _with(hidden, head, mask))
        for line, mask in zip(lines, blind, strict=True)
    )
    score = [quality.score(needs, samples.step) for quality in qualities]
    return lines, np.array([mask.mean() for mask in blind]), np.array(longest), np.array(score)


def _masks(samples: PlacementSamples, heads: Sequence[Mounted], grid: Floats) -> list[Flags]:
    """(directions, n) whether each head is blind there; once for heads with the same limits."""
    masks = dict[tuple[BlindingLimits, bytes], Flags]()
    keys = [(head_.limits, head_.position.tobytes()) for head_ in heads]
    for key, head in zip(keys, heads, strict=True):
        if key not in masks:
            masks[key] = np.array([blind_at(samples, head, line) for line in grid])
    return [masks[key] for key in keys]


def _with(items: Sequence[Any], at: int, item: Any) -> list[Any]:
    return [*items[:at], item, *items[at + 1 :]]
