"""Plan of a mission -> trials at its instants: scenes of heads, and a check of their errors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Advance, Floats, Ints, Refused, Streams
from startrack.design import Case, replaced_all
from startrack.detector import Hits
from startrack.mission.engine import Chunk, MissionPlan, at, conditions_of, groups_of
from startrack.mission.heads import state_of
from startrack.mission.surrogate import SurrogateCorrection
from startrack.space import hit_map
from startrack.trial import run_trial

DIGITS = 7  # of rates in radian / second; 0.02 arcsec / s
CANDIDATES = 4000  # instants of the mission, from which those of trials are chosen
PRIOR = 0.2  # standard deviation of a coefficient of the correction before trials; chosen by hand
STEPS = 50  # of the fit


@dataclass(frozen=True, eq=False)
class HeadScene:
    """Scene in the field of one head at one instant.

    case            its design at its age and temperature, turning as the spacecraft does, with the
                    stray light of its baffle
    icrs_to_camera  its true attitude
    blind           Blind, as a number; 0 where it is valid
    across, about   radian, rms error expected by the mission, with the alignment of the head
    solved          1, expected probability of an attitude
    """

    case: Case
    icrs_to_camera: Rotation
    blind: int
    across: float
    about: float
    solved: float


def scenes_at(plan: MissionPlan, second: float) -> tuple[HeadScene, ...]:
    """Each head at an instant, to be rendered by a trial of any fidelity.

    plan    with errors
    second  after the begin of the mission
    """
    step = min(plan.loaded.mission.time.step, 10.0)
    chunk = at(plan, plan.motion.at(second, step, 1))
    return tuple(scene_at(plan, chunk, h, 0) for h in range(len(plan.heads)))


def scene_at(plan: MissionPlan, chunk: Chunk, h: int, k: int) -> HeadScene:
    """One head at one of the instants of a chunk."""
    head, seen, instants = plan.heads[h], chunk.seen[h], chunk.instants
    mission, design = plan.loaded.mission, plan.loaded.designs[h]
    now = conditions_of(plan, h, instants, seen, chunk.shadow)
    age = None if now.age is None else float(now.age[k])
    warmer = head.temperature.offset if now.warmer is None else float(now.warmer[k])
    case = state_of(design.case, mission.heads[h], mission.check.seed, age, warmer)
    x, y, z = (round(float(rate), DIGITS) for rate in head.axes.T @ instants.rate[:, k])
    motion = replace(case.instrument.motion, rate_x=x, rate_y=y, rate_z=z)
    case = replace(case, instrument=replace(case.instrument, motion=motion))
    case = hit_at(plan, case, chunk, k)
    if now.background is not None:
        case = replace(case, scene=replace(case.scene, background_g=float(now.background[k])))
    across, about, solved = (float(values[k]) for values in chunk.errors[h])
    to_camera = Rotation.from_matrix(head.axes.T)
    body = Rotation.from_matrix(instants.body[..., k])
    return HeadScene(case, to_camera * body, int(seen.blind[k]), across**0.5, about**0.5, solved)


def hit_at(plan: MissionPlan, case: Case, chunk: Chunk, k: int) -> Case:
    """The case with additional hits by the trapped particles at an instant of a chunk."""
    mission, detector = plan.loaded.mission, case.instrument.detector
    if mission.radiation.hits is None:
        return case
    assert mission.orbit.altitude is not None
    where = hit_map(mission.orbit.altitude, mission.radiation.hits)
    here = where(chunk.instants.latitude[k : k + 1], chunk.instants.longitude[k : k + 1])
    rate, charge = (float(one[0]) for one in here)
    if not rate:
        return case
    own = detector.hits or Hits(0.0, charge)
    # All tracks have the mean charge of both kinds of particles.
    charge = (own.rate * own.charge + rate * charge) / (own.rate + rate)
    hits = replace(own, rate=own.rate + rate, charge=charge)
    return replaced_all(case, {"instrument.detector.hits": hits}).unit_of(case.design or case)


@dataclass(frozen=True)
class Checked:
    """Trials at instants of a mission, compared with its expected errors for some heads.

    A ratio is the rms error of the trials over the expected one, with its standard error.

    heads         numbers of the heads
    trials        number of trials, at instants at which the head is not blind
    attitudes     trials with a right attitude;  expected  their number by the budget
    across, about     ratio, of the budget
    corrected_across, corrected_about   the same for all trials, each half with the correction
                                        fitted to the other half
    """

    heads: tuple[int, ...]
    trials: int
    attitudes: int
    expected: float
    across: tuple[float, float]
    about: tuple[float, float]
    corrected_across: tuple[float, float]
    corrected_about: tuple[float, float]


def checked(
    plan: MissionPlan, advance: Advance = lambda _: None
) -> tuple[MissionPlan, tuple[Checked, ...]]:
    """The plan with its surrogates corrected by trials, and the errors of the surrogates.

    The trials of a design are at instants of the mission that are spread evenly over the rate, then
    over the background, the number of stars, the temperature and the age of its heads, in turn.

    advance  called with 1 after each trial
    Returns  the plan itself and nothing if the mission has no check by trials
    Raises   ValueError if the fidelity refuses the design, or if too few trials have an attitude.
    """
    mission = plan.loaded.mission
    count, every = mission.check.trials, max(mission.time.steps // CANDIDATES, 1)
    if not count:
        return plan, ()
    step = every * mission.time.step
    chunk = at(plan, plan.motion.at(0.0, step, -(-mission.time.steps // every)))
    surrogates, checks = list(plan.surrogates), []
    for group in groups_of(plan.loaded, plan.heads):
        correction, check = _checked(plan, chunk, group, count, advance)
        checks.append(check)
        for h in group:
            surrogates[h] = replace(surrogates[h], correction=correction)
    return replace(plan, surrogates=tuple(surrogates)), tuple(checks)


def _checked(
    plan: MissionPlan, chunk: Chunk, group: Sequence[int], count: int, advance: Advance
) -> tuple[SurrogateCorrection, Checked]:
    names = ", ".join(plan.heads[h].name for h in group)
    places, values = _places(plan, chunk, group, count)
    check = plan.loaded.mission.check
    ratios, used, chances = [], [], []
    for n, (h, k) in enumerate(places):
        scene = scene_at(plan, chunk, h, k)
        streams = Streams(check.seed, n)
        outcome = run_trial(scene.case, scene.icrs_to_camera, streams, check.fidelity)
        chances.append(scene.solved)
        if outcome.solved and not outcome.false:
            across, about = np.square([scene.across, scene.about]) - plan.heads[h].drift
            x, y, z = outcome.error_x, outcome.error_y, outcome.error_z
            ratios.append(((x * x + y * y) / 2 / across, z * z / about))
            used.append(n)
        advance(1)
    if len(used) < max(count // 4, 8):
        raise Refused(
            f"head {names}: at least a quarter of the trials must have an attitude, got "
            f"{len(used)} of {count}"
        )
    ratio = np.array(ratios)
    kept = {name: value[used] for name, value in values.items()}
    left = judged_by_the_other_half(ratio, kept)
    over_expected = [root_of_mean(squares[:, k]) for squares in (ratio, left) for k in (0, 1)]
    chance = float(np.sum(chances))
    return fitted(ratio, kept), Checked(tuple(group), count, len(used), chance, *over_expected)


def judged_by_the_other_half(ratio: Floats, values: dict[str, Floats]) -> Floats:
    """Ratios (n, 2) over their correction, which is fitted to the other half (even or odd rows)."""
    half, left = np.arange(len(ratio)) % 2 == 0, ratio.copy()
    for here in (half, ~half):
        other = fitted(ratio[~here], {name: value[~here] for name, value in values.items()})
        features = other.features({name: value[here] for name, value in values.items()})
        left[here] /= np.exp(features @ other.coefficient.T)
    return left


def root_of_mean(square: Floats) -> tuple[float, float]:
    """Root of a mean, and its standard error."""
    mean = float(square.mean())
    return math.sqrt(mean), float(square.std() / math.sqrt(len(square)) / 2 / math.sqrt(mean))


def _places(
    plan: MissionPlan, chunk: Chunk, group: Sequence[int], count: int
) -> tuple[list[tuple[int, int]], dict[str, Floats]]:
    """Heads and instants of the trials, and the values that a correction may depend on there."""
    where, parts = list[Ints](), list[dict[str, Floats]]()
    for h in group:
        seen = chunk.seen[h]
        now = conditions_of(plan, h, chunk.instants, seen, chunk.shadow)
        valid = np.flatnonzero(seen.blind == 0)
        where.append(np.stack([np.full(len(valid), h), valid], axis=1))
        of_head = plan.surrogates[h].values(now)
        parts.append({name: value[valid] for name, value in of_head.items()})
    every = np.concatenate(where)
    names = ", ".join(plan.heads[h].name for h in group)
    if not len(every):
        raise Refused(f"head {names}: must be valid at some time to be checked by trials")
    values = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    draw = Streams(plan.loaded.mission.check.seed, 0)("instants of the check of a mission")
    chosen = []
    for n in range(count):
        value = values[list(values)[n % len(values)]]
        wanted = draw.uniform(value.min(), value.max())
        near = np.argsort(np.abs(value - wanted), kind="stable")[: max(len(value) // 100, 1)]
        chosen.append(int(near[draw.integers(len(near))]))
    picked = [(int(h), int(k)) for h, k in every[chosen]]
    return picked, {name: value[chosen] for name, value in values.items()}


def fitted(ratio: Floats, values: dict[str, Floats]) -> SurrogateCorrection:
    """The correction that makes squared errors most likely.

    A squared error over its expected value has a mean of exp(features . coefficient) and a standard
    deviation in proportion to it (a gamma regression), as far as the coefficients are not held
    near zero by their prior.

    ratio   (n, 2) squared errors over their expected values, across and about
    values  each (n,), of `Surrogate.values`
    """
    ends = {name: (float(value.min()), float(value.max())) for name, value in values.items()}
    used = [(name, low, high) for name, (low, high) in ends.items() if high > low]
    scale = [(0.0, 1.0), *(((low + high) / 2, (high - low) / 2) for _, low, high in used)]
    names = "all", *(name for name, _, _ in used)
    shape = SurrogateCorrection(names, np.array(scale), np.empty(0), np.empty(0))
    features = shape.features({"stars": np.zeros(len(ratio)), **values})
    coefficient, spread = zip(
        *(_gamma(features, ratio[:, k], dispersion) for k, dispersion in enumerate((1.0, 2.0))),
        strict=True,
    )
    return replace(shape, coefficient=np.array(coefficient), spread=np.array(spread))


def _gamma(features: Floats, ratio: Floats, dispersion: float) -> tuple[Floats, Floats]:
    """Coefficients and their standard errors.

    dispersion  variance over the squared mean, of normal errors
    """
    prior = np.eye(features.shape[1]) / PRIOR**2
    coefficient = np.zeros(features.shape[1])
    for _ in range(STEPS):
        rest = ratio / np.exp(features @ coefficient)
        slope = features.T @ (rest - 1) / dispersion - prior @ coefficient
        curvature = (features * rest[:, None]).T @ features / dispersion + prior
        step = np.linalg.solve(curvature, slope)
        coefficient = coefficient + np.clip(step, -0.5, 0.5)
    spread = np.sqrt(np.diag(np.linalg.inv(features.T @ features / dispersion + prior)))
    return coefficient, spread
