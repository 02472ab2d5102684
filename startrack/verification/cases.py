"""Design and campaign -> every case that a verification judges: conditions and keep-out angles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from startrack.budget import added, stray_light_levels
from startrack.core import deg
from startrack.design import Campaign, Case, Judged, KeepOut


def cases(case: Case, campaign: Campaign) -> tuple[tuple[Judged, ...], tuple[str, ...]]:
    """The cases in which a design is judged, and why others that it must be judged in are not.

    Those of `Campaign.judged`; and, for each keep-out angle, the sky with the stray light of the
    body at this angle: the Sun, the full Moon, or the sunlit Earth.

    Accuracy  model: that of `exclusions`; the stray light is uniform over the field.
    """
    keep_out = campaign.requirements.min_keep_out
    found, left = list(campaign.judged(case)), []
    for body, angle in keep_out.angles.items():
        name = f"{body} at {angle / deg:g} deg"
        reason = _refusal(case, angle)
        if reason:
            left.append(f"{name}: {reason}")
        else:
            lit = lit_by(case, keep_out, body)
            found.append(Judged(name, lit, campaign.requirements, 0.0))
    return tuple(found), tuple(left)


def _refusal(case: Case, angle: float) -> str:
    if case.instrument.baffle is None:
        return "instrument.baffle must be given, without which no stray light is computed"
    corner = case.instrument.camera.half_diagonal
    if angle <= corner:
        return f"the body would be in the field, whose half diagonal is {corner / deg:.1f} deg"
    return ""


def lit_by(case: Case, keep_out: KeepOut, body: str) -> Case:
    """The case with the stray light of a body at its keep-out angle as uniform background."""
    angle = np.array([keep_out.angles[body]])
    stray = float(stray_light_levels(case, angle, keep_out.altitude)[body][0])
    level = added((stray, case.scene.sky_g))
    if not math.isfinite(level):
        return case
    return replace(case, scene=replace(case.scene, background_g=level))
