"""Outcomes of trials -> status, reason, boresight and nearby bodies of each trial."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Rows, arcsec, deg
from startrack.design import Case, KeepOut
from startrack.io import celestials
from startrack.metrics import STATED, STATED_ALONE, ErrorLimits, correct
from startrack.scene import BODIES, SUN_RADIUS, body_angles

DISC = math.asin(SUN_RADIUS / 1.496e11)  # radian, of the Sun, and nearly of the Moon


class Ending(StrEnum):
    """End of a trial.

    correct, inaccurate, false  solved; see `startrack.metrics.correct` and `Outcome`
    blinded                     no attitude, and a light among Sun, Moon and Earth is in the field
                                or nearer than its keep-out angle
    too few stars               no attitude, with fewer spots than the identification needs
    no match                    no attitude, with enough spots
    """

    CORRECT = "correct"
    INACCURATE = "inaccurate"
    FALSE = "false"
    BLINDED = "blinded"
    TOO_FEW = "too few stars"
    NO_MATCH = "no match"


@dataclass(frozen=True, eq=False)
class Endings:
    """Ends of n trials.

    ending  (n,) of each
    reason  (n,) a sentence
    angles  (n, 3) radian from the boresight to Sun, Moon and the Earth's limb; NaN where the scene
            has no date or no orbit
    """

    ending: Sequence[Ending]
    reason: Sequence[str]
    angles: Floats

    def count(self) -> dict[Ending, int]:
        """Number of trials by their end."""
        return {way: sum(ending is way for ending in self.ending) for way in Ending}


def endings(
    case: Case,
    seed: int,
    outcomes: Rows,
    icrs_to_camera: Rotation,
    limits: ErrorLimits = STATED_ALONE,
    keep_out: KeepOut | None = None,
) -> Endings:
    """End of each trial from its outcome, without running it again.

    icrs_to_camera  true attitude of each
    limits          of a correct attitude
    keep_out        angles within which a body blinds; None: only in the field
    Accuracy        model: the positions of the bodies, not the image, decide whether a trial is
    blinded.
    """
    right = correct(outcomes, limits)
    lines = icrs_to_camera.inv().apply([0.0, 0.0, 1.0])
    angles = body_angles(case.scene, seed, outcomes["trial"].tolist(), lines)
    made, reasons = [], []
    for n, outcome in enumerate(outcomes):
        around = dict(zip(BODIES, angles[n].tolist(), strict=True))
        ending, reason = _ending(case, outcome, bool(right[n]), around, limits, keep_out)
        made.append(ending)
        reasons.append(reason)
    return Endings(made, reasons, angles)


def _ending(
    case: Case,
    outcome: np.void,
    right: bool,
    around: Mapping[str, float],
    limits: ErrorLimits,
    keep_out: KeepOut | None,
) -> tuple[Ending, str]:
    if outcome["solved"]:
        size = math.hypot(outcome["error_x"], outcome["error_y"]) / arcsec
        about = abs(float(outcome["error_z"])) / arcsec
        off = f"off by {size:.3g} arcsec across and {about:.3g} about the boresight"
        if outcome["false"]:
            return Ending.FALSE, off
        if right:
            return Ending.CORRECT, f"{outcome['stars']} stars"
        asked = f"stated ({STATED:g} sigma)" if limits == STATED_ALONE else "required"
        return Ending.INACCURATE, f"{off}, more than is {asked}"
    if body := _blinding(case, around, keep_out):
        return Ending.BLINDED, f"{body} at {around[body] / deg:.1f} deg"
    spots, needed = int(outcome["spots"]), case.tracker.identification.min_matches
    if spots < needed:
        return Ending.TOO_FEW, f"{spots} spots, of which {needed} are needed"
    return Ending.NO_MATCH, f"{spots} spots, not identified"


def _blinding(case: Case, around: Mapping[str, float], keep_out: KeepOut | None) -> str:
    """The nearest blinding body; empty if there is none."""
    corner = case.instrument.camera.half_diagonal
    limits = {"sun": corner + DISC, "moon": corner + DISC, "earth": corner}
    limits |= keep_out.angles if keep_out else {}
    near = {
        name: around[name] - limit
        for name, limit in limits.items()
        if name in case.scene.lights and around[name] < limit
    }
    return min(near, key=near.__getitem__, default="")


COLUMNS = ("ra_deg", "dec_deg", "roll_deg", "rate_deg_per_s", "sun_deg", "moon_deg", "limb_deg")


def with_causes(case: Case, outcomes: Rows, icrs_to_camera: Rotation, ends: Endings) -> Rows:
    """The table of outcomes with the boresight, end and reason of each trial.

    Returns  (n,) structured array: the fields of the outcomes; right ascension and declination of
             the boresight, roll, slew rate, angles to Sun, Moon and the Earth's limb, in degree;
             `status` and `reason`
    """
    width = max((len(reason) for reason in ends.reason), default=1)
    dtype = [*outcomes.dtype.descr, *((name, float) for name in COLUMNS)]
    table = np.empty(len(outcomes), [*dtype, ("status", "U16"), ("reason", f"U{max(width, 1)}")])
    for name in outcomes.dtype.names or ():
        table[name] = outcomes[name]
    angles = celestials(icrs_to_camera.as_matrix()).T
    for name, column in zip(("ra_deg", "dec_deg", "roll_deg"), angles, strict=True):
        table[name] = column
    table["rate_deg_per_s"] = case.instrument.motion.rate / deg
    for name, column in zip(("sun_deg", "moon_deg", "limb_deg"), ends.angles.T, strict=True):
        table[name] = column / deg
    table["status"], table["reason"] = ends.ending, ends.reason
    return table
