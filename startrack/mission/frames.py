"""Plan of a mission -> trials of all heads at its instants, and the angles between the heads."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Advance, Floats, Refused, Rows, Streams, whole
from startrack.design import Fidelity
from startrack.mission.engine import MissionPlan, at
from startrack.mission.fusion import relative_alignment
from startrack.mission.rendered import HeadScene, root_of_mean, scene_at
from startrack.mission.units import temperatures_of, turned_by_heat, turns_of
from startrack.motion import realise_motion
from startrack.trial import run_trial

AXES = "xyz"
# A row for each head at each instant; errors and turns in radian about the camera's axes.
FRAMES: np.dtype[np.void] = np.dtype(
    [
        ("second", float),
        ("head", np.int64),
        ("blind", np.int64),
        ("solved", bool),
        ("false", bool),
        *((f"{name}_{axis}", float) for name in ("error", "turn") for axis in AXES),
        *((f"expected_{name}", float) for name in ("across", "about", "solved")),
        ("kelvin", float),
        ("orbit", float),
    ]
)


def frames_of(
    plan: MissionPlan, count: int, seed: int, fidelity: Fidelity, advance: Advance = lambda _: None
) -> Rows:
    """Trials of all heads of a mission together, at random instants of it.

    A blind head is not tried. The turn of a head by its structure, at the temperatures and the
    place of the orbit at that time, is listed separately from the errors: to its tracker the sky
    seems turned.

    plan     with errors
    count    of instants
    advance  called with 1 after each of them
    Returns  (instants * heads,): second, number of the head, `Blind`, whether it found an attitude
             and whether this attitude is false, its error, the turn of its structure, the error
             expected by the mission (without the alignment of the head), kelvin above the head's
             mean, place of the orbit (radian)
    Raises   Refused if the fidelity refuses a design.
    Accuracy  model: attitudes by the laws of the mission, not by a control loop. Heads whose
              designs have jitter of the platform share one realisation of the first such head's
              jitter; jitter of other designs is drawn for each head.
    """
    whole(1, 10**6, count=count)
    mission, heads = plan.loaded.mission, len(plan.heads)
    heat = temperatures_of(plan, mission.heat) if mission.heat else None
    turns = [turns_of(design.case) for design in plan.loaded.designs]
    draw = Streams(seed, 0)("instants of the frames of a mission")
    table = np.zeros((count, heads), FRAMES)
    table["second"] = np.sort(draw.uniform(0, mission.time.duration, count))[:, None]
    table["head"] = np.arange(heads)
    step = min(mission.time.step, 10.0)
    for n, row in enumerate(table):
        second = float(row["second"][0])
        chunk = at(plan, plan.motion.at(second, step, 1))
        row["orbit"] = chunk.instants.phase[0]
        for h in range(heads):
            scene, place = scene_at(plan, chunk, h, 0), row[h : h + 1]
            scene = _moved_together(plan, scene, h, Streams(seed, n))
            place["blind"], place["expected_solved"] = scene.blind, scene.solved
            of_alignment = plan.heads[h].drift
            place["expected_across"] = math.sqrt(scene.across**2 - of_alignment[0])
            place["expected_about"] = math.sqrt(scene.about**2 - of_alignment[1])
            if heat:
                place["kelvin"] = heat.of_head(h, chunk.instants.second)[0]
            turn = turned_by_heat(plan, turns[h], h, chunk.instants, heat)
            for axis, value in zip(AXES, turn[:, 0], strict=True):
                place[f"turn_{axis}"] = value
            if scene.blind:
                continue
            streams = Streams(seed, n * heads + h)
            outcome = run_trial(scene.case, scene.icrs_to_camera, streams, fidelity)
            place["solved"], place["false"] = outcome.solved, outcome.false
            for axis in AXES:
                place[f"error_{axis}"] = getattr(outcome, f"error_{axis}")
        advance(1)
    return table.ravel()


def _moved_together(plan: MissionPlan, scene: HeadScene, h: int, streams: Streams) -> HeadScene:
    """The scene of a head with the platform's jitter, which all such heads share."""
    designs = plan.loaded.designs
    motions = [
        replace(design.case.instrument.motion, rate_x=0.0, rate_y=0.0, rate_z=0.0)
        for design in designs
    ]
    own = motions[h]
    if own.jitter_of != "platform" or not own.jitters or motions.count(own) < 2:
        return scene
    first, instrument = motions.index(own), scene.case.instrument
    exposure = designs[first].case.instrument.detector.exposure
    turn = Rotation.from_matrix(plan.heads[h].axes.T @ plan.heads[first].axes)
    seen = realise_motion(own, exposure, streams).seen_from(turn)
    steady = replace(instrument.motion.steady, tones=seen.tones)
    case = replace(scene.case, instrument=replace(instrument, motion=steady))
    return replace(scene, case=case)


@dataclass(frozen=True)
class Agreement:
    """Frames of a head compared with the expectation of its mission.

    tried         number of frames in which the head is not blind; right: with a right attitude
    expected      number of right attitudes by the mission
    deviations    right minus expected, in standard deviations
    across, about  rms of the errors over the expected one, and its standard error; NaN without
                   attitudes
    """

    tried: int
    right: int
    expected: float
    deviations: float
    across: tuple[float, float]
    about: tuple[float, float]


def agreement(table: Rows, head: int) -> Agreement:
    """Comparison of the frames of a head with the expectation of its mission.

    table  of `frames_of`
    """
    rows = table[(table["head"] == head) & (table["blind"] == 0)]
    good, chance = rows["solved"] & ~rows["false"], rows["expected_solved"]
    spread = math.sqrt(max(float((chance * (1 - chance)).sum()), 1e-12))
    solved = rows[good]
    across = (solved["error_x"] ** 2 + solved["error_y"] ** 2) / 2 / solved["expected_across"] ** 2
    about = (solved["error_z"] / solved["expected_about"]) ** 2
    nothing = (math.nan, math.nan)
    return Agreement(
        len(rows),
        int(good.sum()),
        float(chance.sum()),
        float(good.sum() - chance.sum()) / spread,
        root_of_mean(across) if len(solved) else nothing,
        root_of_mean(about) if len(solved) else nothing,
    )


@dataclass(frozen=True)
class Between:
    """The angle between the boresights of two heads, radian rms about its mean.

    frames  in which both have an attitude
    before  as measured
    after   minus a model by the temperatures of both heads and the place of the orbit, on frames
            outside the fit
    """

    frames: int
    before: float
    after: float


def between(plan: MissionPlan, table: Rows, first: int, second: int) -> Between:
    """The angle between two heads by their attitudes, before and after a thermal model.

    The model is `relative_alignment` with a constant, sine and cosine of the place of the orbit
    and, if the mission has temperatures, those of both heads. It is fitted to the first, third,
    fifth, ... tenth of the frames, and judged on the others.

    table   of `frames_of`
    Raises  Refused if too few frames have both attitudes.
    """
    heads = [table[table["head"] == h] for h in (first, second)]
    both = np.all([rows["solved"] & ~rows["false"] for rows in heads], axis=0)
    heads = [rows[both] for rows in heads]
    columns = [np.ones(int(both.sum())), np.sin(heads[0]["orbit"]), np.cos(heads[0]["orbit"])]
    columns += [rows["kelvin"] for rows in heads if len(set(rows["kelvin"].tolist())) > 1]
    features = np.column_stack(columns)
    if len(features) < 4 * features.shape[1]:
        raise Refused(
            f"frames with an attitude of both heads must be at least {4 * features.shape[1]}, "
            f"got {len(features)}"
        )
    errors = []
    for h, rows in zip((first, second), heads, strict=True):
        turned = np.column_stack([rows[f"error_{axis}"] + rows[f"turn_{axis}"] for axis in AXES])
        errors.append(Rotation.from_rotvec(turned @ plan.heads[h].axes.T))
    across = np.cross(plan.heads[first].boresight, plan.heads[second].boresight)
    across /= np.linalg.norm(across)
    learnt = np.arange(len(features)) * 10 // len(features) % 2 == 0
    model = relative_alignment(errors[0][learnt], errors[1][learnt], features[learnt])
    apart = _along(errors[1] * errors[0].inv(), across)[~learnt]
    left = _along(model.corrected(errors[1], features) * errors[0].inv(), across)[~learnt]
    return Between(len(features), float(apart.std()), float(np.sqrt((left**2).mean())))


def _along(turn: Rotation, axis: Floats) -> Floats:
    return np.asarray(turn.as_rotvec() @ axis)
