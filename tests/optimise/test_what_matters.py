import math

import pytest

from startrack.core import arcsec
from startrack.design.variables import DesignSpace
from startrack.optimise import TrackerSource, TrialRunner, what_matters
from startrack.optimise import source as module
from startrack.optimise.evaluate import Foresight

MIDDLE, WIDTH = 0.3, 0.5  # of the parabola, in the unit cube


def source(small, monkeypatch, law, margins=lambda case: {}):
    """Two variables, focal length and exposure, with designs forecast by a law (radian)."""
    focal, exposure = small.campaign.variables[0], small.campaign.variables[3]
    space = DesignSpace(small.case, (focal, exposure))

    def forecast(space, _, points, *__, **___):
        cases = [space.design(point) for point in points]
        return [Foresight(math.log(law(space, case) / arcsec), margins(case)) for case in cases]

    monkeypatch.setattr(module, "foresee_all", forecast)
    return TrackerSource(space, small.campaign.of_errors, TrialRunner(1))


def test_ranges_end_where_a_parabola_is_one_per_cent_above_its_least(small, monkeypatch):
    """ln error = ((u - 0.3)^2 + (v - 0.3)^2) / 0.5: the range ends sqrt(0.5 ln 1.01) from 0.3,
    because the other variable takes its own optimum."""

    def law(space, case):
        u, v = space.coordinates(case)
        return arcsec * math.exp(((u - MIDDLE) ** 2 + (v - MIDDLE) ** 2) / WIDTH)

    found = what_matters(source(small, monkeypatch, law), 32)
    assert math.exp(found.best.expected) == pytest.approx(1, abs=0.002)
    far = math.sqrt(WIDTH * small.campaign.precision)
    for axis, influence in enumerate(found.influences):
        span = influence.span
        # Halvings leave 1/24 / 2^4 of the range; the emulator is not exact.
        assert span.low == pytest.approx(MIDDLE - far, abs=0.01)
        assert span.high == pytest.approx(MIDDLE + far, abs=0.01)
        assert span.at_low[1 - axis] == pytest.approx(MIDDLE, abs=0.02)
        assert influence.sensitivity.total.value == pytest.approx(0.5, abs=0.03)


def test_one_per_cent_of_a_power_law_and_of_a_margin(small, monkeypatch):
    """error ~ f^2 / sqrt(t) changes by (1.01^2 - 1) and by 1.01^-0.5 - 1; a margin 1 - f / 50 mm by
    -0.01 f / 50 mm, and it is missed at 70 mm."""

    def law(_, case):
        return case.instrument.optics.focal_length**2 / math.sqrt(case.instrument.detector.exposure)

    def margins(case):
        return {"length": 1 - case.instrument.optics.focal_length / 0.05, "room": 5.0}

    made = source(small, monkeypatch, law, margins)
    found = what_matters(made, 32)
    focal, exposure = found.influences
    assert focal.change == pytest.approx(1.01**2 - 1, rel=0.01)
    assert exposure.change == pytest.approx(1.01**-0.5 - 1, rel=0.01)
    assert found.tightest == "length"
    assert focal.margins["length"] == pytest.approx(-0.01 * 35 / 50)
    assert exposure.margins["length"] == 0
    assert focal.missed == ((), ("length",))
    assert focal.costs["mass_kg"] > 0 == exposure.costs["mass_kg"]
    # The best is the shortest lens with the longest exposure.
    assert found.met
    assert focal.span.low == 0
    assert exposure.span.high == 1
    assert [one.sensitivity.name for one in found.ordered] == list(made.names)
