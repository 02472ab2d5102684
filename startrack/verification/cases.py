"""Design and campaign -> all cases to judge, and the trials that count."""

import math
from dataclasses import replace

import numpy as np

from startrack.budget import stray_light_levels
from startrack.core import Floats, Rows, deg
from startrack.design import Campaign, Case, Judged, KeepOut, Requirements
from startrack.montecarlo import at_random
from startrack.scene import BODIES, body_angles


def cases(case: Case, campaign: Campaign) -> tuple[tuple[Judged, ...], tuple[str, ...]]:
    """The cases in which a design is judged, and why other required cases cannot be judged.

    They are the cases of `Campaign.judged` and, for each keep-out angle, the sky with the stray
    light of the body at this angle: the Sun, the full Moon, or the sunlit Earth.

    Accuracy  model: that of `exclusions`; the stray light is uniform over the field.
    """
    keep_out = campaign.requirements.min_keep_out
    judged, left = list(campaign.judged(case)), []
    for body, angle in keep_out.angles.items():
        name = f"{body} at {angle / deg:g} deg"
        reason = _refusal(case, angle)
        if reason:
            left.append(f"{name}: {reason}")
        else:
            lit = lit_by(case, keep_out, body)
            judged.append(Judged(name, lit, campaign.requirements, 0.0))
    return tuple(judged), tuple(left)


def _refusal(case: Case, angle: float) -> str:
    if case.instrument.stray is None:
        return "instrument.baffle or tube must be given: without it no stray light is computed"
    corner = case.instrument.camera.half_diagonal
    if angle <= corner:
        return f"the body would be in the field, whose half diagonal is {corner / deg:.1f} deg"
    return ""


def lit_by(case: Case, keep_out: KeepOut, body: str) -> Case:
    """The case with the stray light of a body at its keep-out angle as uniform background."""
    angle = np.array([keep_out.angles[body]])
    stray = float(stray_light_levels(case, angle, keep_out.altitude)[body][0])
    if math.isnan(stray):
        return case
    return replace(case, scene=case.scene.with_stray_light(stray))


def boresights(seed: int, outcomes: Rows) -> Floats:
    """(n, 3) directions of the boresights of the trials of a seed, ICRS axes."""
    if not len(outcomes):
        return np.empty((0, 3))
    return at_random(seed, outcomes["trial"].tolist()).inv().apply([0.0, 0.0, 1.0])


def counted(needs: Requirements, case: Case, seed: int, outcomes: Rows) -> Rows:
    """The outcomes that count in errors and availability.

    All outcomes count, unless blinded trials are left out. A trial is blinded if the Sun, the Moon
    or the Earth is a light of the scene and nearer to the boresight than its keep-out angle.

    seed  of the trials, which have random attitudes
    """
    limits = {
        name: angle
        for name, angle in needs.min_keep_out.angles.items()
        if name in case.scene.lights
    }
    if needs.blinded == "counted" or not limits:
        return outcomes
    numbers = outcomes["trial"].tolist()
    angles = body_angles(case.scene, seed, numbers, boresights(seed, outcomes))
    kept = np.ones(len(outcomes), bool)
    for name, angle in limits.items():
        kept &= angles[:, BODIES.index(name)] >= angle
    return outcomes[kept]
