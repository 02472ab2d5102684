"""Plan of a mission and an instant -> the case and attitude of each head, for a trial."""

from __future__ import annotations

from dataclasses import dataclass, replace

from scipy.spatial.transform import Rotation

from startrack.design import Case
from startrack.mission.engine import Plan, at

DIGITS = 7  # of rates in radian / second; 0.02 arcsec / s


@dataclass(frozen=True, eq=False)
class Scene:
    """What one head sees at one instant.

    case            its design, turning as the spacecraft does, with the stray light of its baffle
    icrs_to_camera  its true attitude
    blind           Blind, as a number; 0 where it is valid
    across, about   radian, rms error that the mission expects, with the alignment of the head
    solved          1, probability of an attitude that it expects
    """

    case: Case
    icrs_to_camera: Rotation
    blind: int
    across: float
    about: float
    solved: float


def scenes_at(plan: Plan, second: float) -> tuple[Scene, ...]:
    """Each head at an instant, to be rendered by a trial of any fidelity.

    plan    with errors
    second  after the begin of the mission
    """
    step = min(plan.loaded.mission.time.step, 10.0)
    chunk = at(plan, plan.course.at(second, step, 1))
    body = Rotation.from_matrix(chunk.instants.body[..., 0])
    found = []
    for h, (head, seen) in enumerate(zip(plan.heads, chunk.seen, strict=True)):
        case = plan.loaded.designs[h].case
        x, y, z = (round(float(one), DIGITS) for one in head.axes.T @ chunk.instants.rate[:, 0])
        motion = replace(case.instrument.motion, rate_x=x, rate_y=y, rate_z=z)
        case = replace(case, instrument=replace(case.instrument, motion=motion))
        stray = plan.stray[h]
        if stray is not None:
            sky = float(stray(seen, chunk.shadow)[0])
            case = replace(case, scene=replace(case.scene, background_g=sky))
        across, about, solved = (float(one[0]) for one in chunk.errors[h])
        to_camera = Rotation.from_matrix(head.axes.T)
        found.append(
            Scene(case, to_camera * body, int(seen.blind[0]), across**0.5, about**0.5, solved)
        )
    return tuple(found)
