"""Case, fidelity -> a refusal, before the first trial, of what that fidelity cannot compute."""

from __future__ import annotations

from startrack.design import Case, Fidelity
from startrack.detector import require_independent_pixels
from startrack.trial.effects import require_least_squares, require_window
from startrack.trial.spot_plan import refuse


def require_fidelity(case: Case, fidelity: Fidelity) -> None:
    """Refuse a fidelity that some trial of a case would refuse.

    Raises  Refused that names what it cannot compute.
    """
    if fidelity is Fidelity.WINDOW:
        require_independent_pixels(case.instrument.detector)
        require_window(case)
    elif fidelity is not Fidelity.FRAME:
        refuse(case)
        if fidelity is Fidelity.COVARIANCE:
            require_least_squares(case)
