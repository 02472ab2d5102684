"""Case, fidelity -> a refusal, before the first trial, of what that fidelity cannot compute."""

from __future__ import annotations

from startrack.core import Refused, is_code
from startrack.design import Case, Fidelity
from startrack.detector import require_independent_pixels
from startrack.trial.covariance import require_least_squares
from startrack.trial.spot_plan import refuse
from startrack.trial.window import require_filter, require_no_ghosts

# Lights of the scene that vary over the field wherever the camera points, or in some attitudes.
VARYING = ("zodiacal", "starlight", "earth", "airglow")
STRAY = ("sun", "moon", "earth")  # which do so through a baffle


def require_fidelity(case: Case, fidelity: Fidelity) -> None:
    """Refuse a fidelity that some trial of a case would refuse.

    Raises  ValueError that names what it cannot compute.
    """
    if fidelity is Fidelity.WINDOW:
        require_independent_pixels(case.instrument.detector)
        require_no_ghosts(case.instrument)
        require_filter(case.tracker.detection)
        lights = [one for one in case.scene.lights if one in VARYING or is_code(one)]
        if case.instrument.baffle is not None:
            lights += [one for one in case.scene.lights if one in STRAY and one not in lights]
        if lights:
            raise Refused(
                "window needs a sky whose light is uniform over the field, so that lights must be "
                f"without {', '.join(lights)}; choose the fidelity frame"
            )
    elif fidelity is not Fidelity.FRAME:
        refuse(case)
        if fidelity is Fidelity.COVARIANCE:
            require_least_squares(case)
