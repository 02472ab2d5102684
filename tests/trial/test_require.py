import dataclasses

import pytest

from startrack.core import deg
from startrack.design import Fidelity, load_design
from startrack.io import shipped
from startrack.optics import Baffle
from startrack.trial import require_fidelity, run_trials

CASE = load_design(shipped("designs/noise_only.toml")).case


def lit(*lights, baffle=None):
    scene = dataclasses.replace(
        CASE.scene, background_g=None, lights=lights, date="2026-03-20T12:00:00"
    )
    instrument = dataclasses.replace(CASE.instrument, baffle=baffle)
    return dataclasses.replace(CASE, scene=scene, instrument=instrument)


BAFFLE = Baffle((20 * deg, 60 * deg), (1e-3, 1e-7))


@pytest.mark.parametrize(
    ("case", "named"),
    [(lit("zodiacal"), "zodiacal"), (lit("sun", baffle=BAFFLE), "sun")],
    ids=["zodiacal", "sun"],
)
def test_what_a_trial_in_windows_refuses_is_refused_before(case, named):
    with pytest.raises(ValueError, match=f"without {named}; choose the fidelity frame"):
        require_fidelity(case, Fidelity.WINDOW)
    with pytest.raises(ValueError, match="must be frame"):
        run_trials(case, 1, range(1), Fidelity.WINDOW)
    require_fidelity(case, Fidelity.FRAME)


@pytest.mark.parametrize("case", [CASE, lit("planets")], ids=["dark", "planets"])
def test_what_windows_can_compute_is_not_refused(case):
    require_fidelity(case, Fidelity.WINDOW)
    assert len(run_trials(case, 1, range(2), Fidelity.WINDOW)) == 2


def test_drawn_spots_refuse_all_lights():
    for fidelity in (Fidelity.SPOTS, Fidelity.COVARIANCE):
        with pytest.raises(ValueError, match="lights of the scene"):
            require_fidelity(lit("planets"), fidelity)
