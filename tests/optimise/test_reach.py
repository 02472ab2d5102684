import numpy as np

from startrack.design.variables import Box, Variable
from startrack.optimise.evaluate import missed
from startrack.optimise.steps import reach


class Narrow:
    """Requirements that are nearly met about the start alone; all else leads away from it."""

    def margins(self, case):
        off = abs(case.instrument.optics.blur - START)
        return {"blur": -0.01 if off < 1e-9 else -0.6 + 1e4 * off}


START = 4.321e-6


def test_what_comes_nearest_is_never_worse_than_the_start(small):
    case = Box(small.case, (Variable("instrument.optics.blur", "1 um", "12 um"),))
    start = (START - 1e-6) / 11e-6
    box = Box(case.design(np.array([start])), case.variables)
    found = reach(box, Narrow())
    assert found.short == missed(found.margins) <= 0.01
