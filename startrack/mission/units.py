"""Plan of a mission -> temperatures on board, and errors of spacecraft whose heads are units."""

import math
from dataclasses import dataclass, replace

import numpy as np

from startrack.budget import UnitBudgets, analytic, unit_budgets
from startrack.core import (
    DAY,
    SIDEREAL_YEAR,
    YEAR,
    Advance,
    Flags,
    Floats,
    Refused,
    printed,
    utc,
    whole,
)
from startrack.design import TURNS, Case
from startrack.metrics import Interval, level_interval
from startrack.mission.engine import (
    CHUNK,
    Chunk,
    MissionPlan,
    at,
    groups_of,
    own_errors,
    platform_motions,
)
from startrack.mission.heads import state_of
from startrack.mission.instants import Instants
from startrack.space import STEFAN, Heat, incident, march, taken_by_head, taken_by_platform
from startrack.trial import Term

THERMAL_STEP = 60.0  # second, the longest of the temperatures
SPIN_UP = 20  # orbits, or days, before the begin
# Of the Earth's orbit; day of the year.
ECCENTRICITY, PERIHELION = 0.01671, 3.0
SHARED = (Term.BIAS, Term.THERMO_ELASTIC)  # terms that are not drawn anew with time
LEAST_SQUARE = 1e-18  # radian^2, of a bias: 0.0002 arcsec
FIELDS = 64  # of the budget of each unit
PRINCIPAL = "instrument.optics.principal_x"


@printed
@dataclass(frozen=True, eq=False)
class MissionTemperatures:
    """Temperatures of a platform and its h heads, at n times.

    second    (n,) after the begin of the mission
    platform  (n,) kelvin
    heads     (h, n) kelvin
    sides     (h, 2, n) W / m2 that the tube of a head takes up on its side at +x over that at -x,
              halved, and of y, in camera axes
    """

    second: Floats
    platform: Floats
    heads: Floats
    sides: Floats

    def of_head(self, h: int, second: Floats) -> tuple[Floats, Floats]:
        """Kelvin above the mean of the mission (m,), and `sides` (2, m), of a head at m times."""
        warm = self.heads[h] - self.heads[h].mean()
        return (
            np.interp(second, self.second, warm),
            np.stack([np.interp(second, self.second, side) for side in self.sides[h]]),
        )


def temperatures_of(plan: MissionPlan, heat: Heat) -> MissionTemperatures:
    """Temperatures of a platform and its heads along a mission.

    Sun, albedo and infrared of the Earth fall on the six faces of the box in its attitude, and on
    four sides and the end of the tube of each head in its direction; the Sun's distance changes
    over the year. Before the begin, the first orbits are repeated until the platform has settled.

    Raises    as the plan's motion
    Accuracy  model: that of `Heat`. numerical: first order in the step of a minute at most, 2 % of
              a swing for a head of 450 J / K at 0.2 W / K.
    """
    time = plan.loaded.mission.time
    step = max(time.step, min(THERMAL_STEP, time.duration))
    count = max(math.ceil(time.duration / step), 2)
    heads = len(plan.heads)
    power, sides = np.empty((1 + heads, count)), np.empty((heads, 2, count))
    for first in range(0, count, CHUNK):
        part = slice(first, min(first + CHUNK, count))
        instants = plan.motion.at(first * step, step, part.stop - first)
        power[:, part], sides[:, :, part], shines = _taken(plan, heat, instants)
    capacity = np.array([heat.capacity, *[heat.head_capacity] * heads])
    size = STEFAN * np.array(shines)
    kelvin = np.full(1 + heads, float((power.mean(axis=1).sum() / size.sum()) ** 0.25))
    begin = np.ascontiguousarray(power[:, : max(int(DAY / step), 1)])
    for _ in range(SPIN_UP):
        march(begin, size, capacity, heat.conductance, step, kelvin, np.empty_like(begin))
    course = np.empty_like(power)
    march(power, size, capacity, heat.conductance, step, kelvin, course)
    return MissionTemperatures(step * np.arange(count, dtype=float), course[0], course[1:], sides)


def _taken(plan: MissionPlan, heat: Heat, instants: Instants) -> tuple[Floats, Floats, list[float]]:
    """W (1 + h, n) that platform and heads take up and dissipate, `sides`, their black surfaces."""
    day = float(utc(plan.loaded.mission.time.begin).to_datetime().timetuple().tm_yday)
    angle = math.tau * (day - PERIHELION + instants.second / DAY) / (SIDEREAL_YEAR / DAY)
    nearer = (1 + ECCENTRICITY * np.cos(angle)) ** 2
    signed = [sign * row for row in instants.body for sign in (1, -1)]
    sunlight, earth = incident(heat, np.stack(signed), instants.place, instants.sun)
    taken, dark = taken_by_platform(heat, sunlight * nearer, earth)
    power, sides, shines = [taken + heat.power], [], [dark]
    for head in plan.heads:
        x, y, z = np.einsum("ac,ain->cin", head.axes, instants.body)
        faces = np.stack([x, -x, y, -y, z])
        sunlight, earth = incident(heat, faces, instants.place, instants.sun)
        taken, *side, own = taken_by_head(heat, sunlight * nearer, earth)
        power.append(taken + heat.head_power)
        sides.append(side)
        shines.append(own)
    return np.stack(power), np.array(sides), shines


@printed
@dataclass(frozen=True, eq=False)
class Fleet:
    """Missions of s spacecraft whose h heads are drawn units.

    rms         (s, 3) radian, of the fused attitude about the body's axes, over the steps with a
                valid head
    aligned     (s, 3) the same with relative alignments of heads that were calibrated in flight
    heads       (s, h, 2) radian, across (per axis) and about, of each head over its valid steps
    swing       (h, 3) radian, rms over the mission of the thermo-elastic turn about camera axes
    known       fraction of the steps with a valid head
    heat        temperatures; None where the mission has no heat
    """

    rms: Floats
    aligned: Floats
    heads: Floats
    swing: Floats
    known: float
    heat: MissionTemperatures | None

    def level(self, fraction: float = 0.95, aligned: bool = False) -> Interval:
        """Radian, about the worst axis, that a fraction of the spacecraft keeps."""
        return level_interval((self.aligned if aligned else self.rms).max(axis=1), fraction)


def fly_units(plan: MissionPlan, count: int, seed: int, advance: Advance = lambda _: None) -> Fleet:
    """The errors of spacecraft whose heads are drawn units, at all steps of a mission.

        e_h = b_h + A_h l(t) + N(0, V_h + U_h),   x = P sum_h V_h^-1 e_h,   P = (sum_h V_h^-1)^-1

    and the motion of the platform within an exposure, which is common to all heads; with the bias b
    of a unit after its calibration, the responses A of its structure to loads l(t) (mean
    temperature, gradients, fluxes), the variance V of the surrogate, and the additional variance U
    of the unit by residual, calibration and noise. All units have the same weights, with the mean
    of U, and the detection of the surrogate. The mean square of x over time is a quadratic form in
    b, so that additional spacecraft take no time. Unit h + s heads of a seed is head h of
    spacecraft s.

    count     of spacecraft
    advance   called with the number of steps after each part
    Raises    ValueError if a design has no [[variation]], structure or residual, so that its
              units do not differ; as `unit_budgets`
    Accuracy  model: U does not depend on place or time. Gradients of the panel follow the orbit.
              The mean temperature of a head over the mission is its temperature in the calibration.
              Units have their age in the middle of the mission, or the age of the design if the
              mission gives heads no age.
    """
    whole(1, 10**6, count=count)
    mission, heads = plan.loaded.mission, len(plan.heads)
    heat = temperatures_of(plan, mission.heat) if mission.heat else None
    bias, extra = _drawn(plan, count, seed)
    weight = extra.mean(axis=0)
    turns = [turns_of(design.case) for design in plan.loaded.designs]
    size = 3 * heads + 1
    moments, noise, steps = np.zeros((3, size, size)), np.zeros(3), 0
    alone = [np.zeros((4, 4)) for _ in range(heads)]
    for first in range(0, mission.time.steps, CHUNK):
        some = min(CHUNK, mission.time.steps - first)
        chunk = at(plan, plan.motion.at(first * mission.time.step, mission.time.step, some), first)
        turned = [turned_by_heat(plan, turns[h], h, chunk.instants, heat) for h in range(heads)]
        valid = np.array([seen.blind == 0 for seen in chunk.seen])
        gain, own = _gains(plan, chunk, weight, valid)
        by_heat = sum(g @ turn.T[..., None] for g, turn in zip(gain, turned, strict=True))
        row = np.concatenate([*gain, by_heat], axis=2)
        row = row[valid.any(axis=0)].transpose(1, 0, 2)
        moments += row.transpose(0, 2, 1) @ row
        noise += own.sum(axis=0)
        steps += int(valid.any(axis=0).sum())
        for h, here in enumerate(valid):
            _add_alone(alone[h], chunk.errors[h], turned[h], here)
        advance(some)
    if not steps:
        raise Refused("heads must be valid at some step of the mission, none is")
    common = mission.common.variance
    rms = [
        np.sqrt(_squares(biases, extra, moments / steps) + noise / steps + common)
        for biases in (bias, _aligned(plan, bias))
    ]
    swing = np.sqrt([moment[:3, :3].diagonal() / max(moment[3, 3], 1.0) for moment in alone])
    return Fleet(
        rms[0], rms[1], _of_heads(alone, bias, extra), swing, steps / mission.time.steps, heat
    )


def _drawn(plan: MissionPlan, count: int, seed: int) -> tuple[Floats, Floats]:
    """Biases (s, h, 3) radian and extra variances (s, h, 3) radian^2 of the units, camera axes."""
    mission, heads = plan.loaded.mission, len(plan.heads)
    bias, extra = np.zeros((count, heads, 3)), np.zeros((count, heads, 3))
    for group in groups_of(plan.loaded, plan.heads):
        case, age = plan.loaded.designs[group[0]].case, plan.heads[group[0]].age
        if not (case.varying or case.instrument.residual):
            raise Refused(
                f"design of {plan.heads[group[0]].name} must have [[variation]], "
                "[instrument.structure] or [instrument.residual], so that its units differ"
            )
        law = case.instrument.detector.age
        middle = law.years * YEAR if law else 0.0
        if age is not None:
            middle = age + mission.time.duration / 2
        budgets = unit_budgets(case, seed, count * len(group), middle, 1, FIELDS)
        head = replace(mission.heads[group[0]], unit=None)
        square = _square(budgets) - _designed(state_of(case, head, seed, middle, 0.0))
        for k, h in enumerate(group):
            bias[:, h], extra[:, h] = budgets.bias[k :: len(group)], square[k :: len(group)]
    return bias, np.maximum(extra, 0.0)


def _square(budgets: UnitBudgets) -> Floats:
    """Mean square error (n, 3) of units, without bias and thermo-elastic turns."""
    squares = (rms**2 for term, rms in budgets.terms.items() if term not in SHARED)
    return np.asarray(sum(squares, np.zeros((len(budgets), 3))))


def _designed(case: Case) -> Floats:
    """The same (3,) of the unit as designed, in the same fields."""
    lines = [line for line in analytic(case, FIELDS).lines if line.term not in SHARED]
    return np.asarray(sum((line.spread.rms() ** 2 for line in lines), np.zeros(3)))


def turns_of(case: Case) -> Floats:
    """Turn (3, 5) of the camera by each load, radian; none without a structure.

    A detector that moves in its plane turns the sky as the camera does: the principal point is
    elsewhere than its tracker takes it to be.
    """
    structure, instrument = case.instrument.structure, case.instrument
    if structure is None:
        return np.zeros((3, 5))
    pitch, none = instrument.detector.pitch, np.zeros(5)
    responses = structure.responses(instrument.optics, pitch)
    shift = responses.get(PRINCIPAL, none) * pitch / instrument.optics.focal_length
    return np.array([responses.get(name, none) for name in TURNS]) - [none, shift, none]


def turned_by_heat(
    plan: MissionPlan, turns: Floats, h: int, instants: Instants, heat: MissionTemperatures | None
) -> Floats:
    """Thermo-elastic error (3, n) radian of a head, in camera axes: the turn, backwards."""
    instrument = plan.loaded.designs[h].case.instrument
    if instrument.structure is None:
        return np.zeros((3, len(instants.second)))
    given = heat.of_head(h, instants.second) if heat else (None, None)
    place = instants.phase / math.tau
    return np.asarray(-turns @ instrument.structure.loads(instrument.optics, place, *given))


def _gains(
    plan: MissionPlan, chunk: Chunk, weight: Floats, valid: Flags
) -> tuple[list[Floats], Floats]:
    """Fused error about the body's axes (n, 3, 3) by each head's in its camera axes; its noise.

    weight   (h, 3) radian^2, which the tracker adds to the variances of the surrogate
    Returns  the gains, and (n, 3) radian^2 of the fused attitude by these variances alone, with
             the motion of the platform, which is one for all heads
    """
    inverse, noisy, total = list[Floats](), list[Floats](), np.zeros((valid.shape[1], 3, 3))
    for h, (across, about) in enumerate(own_errors(chunk)):
        noisy.append(np.stack([across, across, about], axis=1))
        inverse.append(valid[h, :, None] / (noisy[h] + weight[h]))
    for head, own in zip(plan.heads, inverse, strict=True):
        outer = head.axes.T[:, :, None] * head.axes.T[:, None, :]
        total += (own @ outer.reshape(3, 9)).reshape(-1, 3, 3)
    total[~valid.any(axis=0)] = np.eye(3)
    fused = np.linalg.inv(total)
    gain = [
        (fused @ head.axes) * own[:, None, :] for head, own in zip(plan.heads, inverse, strict=True)
    ]
    alone = [(g**2 * v[:, None]).sum(axis=2) for g, v in zip(gain, noisy, strict=True)]
    motions = platform_motions(plan, chunk)
    if motions:
        in_camera = (head.axes.T @ motion for head, motion in zip(plan.heads, motions, strict=True))
        common = np.sum([g @ s for g, s in zip(gain, in_camera, strict=True)], axis=0)
        alone.append((common**2).sum(axis=2))
    return gain, np.sum(alone, axis=0)


def _add_alone(
    total: Floats, errors: tuple[Floats, Floats, Floats], turned: Floats, valid: Flags
) -> None:
    """Add a head's steps: squares of its turn, its noise on the diagonal beyond, their number."""
    across, about, _ = errors
    total[:3, :3] += np.diag((turned[:, valid] ** 2).sum(axis=1))
    total[3, :3] += turned[:, valid].sum(axis=1)
    total[0, 3] += across[valid].sum()
    total[2, 3] += about[valid].sum()
    total[3, 3] += valid.sum()


def _of_heads(alone: list[Floats], bias: Floats, extra: Floats) -> Floats:
    """Rms (s, h, 2) across and about, of each head by itself."""
    rms = []
    for h, total in enumerate(alone):
        steps = max(total[3, 3], 1.0)
        noise = np.array([total[0, 3], total[0, 3], total[2, 3]]) / steps
        mean, square = total[3, :3] / steps, total[:3, :3].diagonal() / steps
        error = noise + extra[:, h] + bias[:, h] ** 2 + 2 * bias[:, h] * mean + square
        rms.append(np.sqrt(np.stack([error[:, :2].mean(axis=1), error[:, 2]], axis=1)))
    return np.stack(rms, axis=1)


def _squares(bias: Floats, extra: Floats, moments: Floats) -> Floats:
    """Mean squares (s, 3) radian^2 of fused errors without noise, from mean products of gains."""
    units, size = len(bias), moments.shape[1] - 1
    flat, more = bias.reshape(units, size), extra.reshape(units, size)
    steady = np.concatenate([flat, np.ones((units, 1))], axis=1)
    square = np.einsum("sk,ikl,sl->si", steady, moments, steady)
    return np.asarray(square + more @ np.einsum("ikk->ki", moments)[:size])


def _aligned(plan: MissionPlan, bias: Floats) -> Floats:
    """Biases of heads aligned to each other in flight: they have a common rotation of the body.

    It is their best mean, weighted by the mean squares of each head's biases over the units.
    """
    axes = np.stack([head.axes for head in plan.heads])
    weight = 1 / np.maximum((bias**2).mean(axis=0), LEAST_SQUARE)
    information = np.einsum("hac,hc,hbc->hab", axes, weight, axes)
    turn = np.einsum("hac,hc,shc->sa", axes, weight, bias) @ np.linalg.inv(information.sum(axis=0))
    return np.einsum("hac,sa->shc", axes, turn)
