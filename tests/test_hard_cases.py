"""Every hard case of `tests/hard` has the expected result."""

import pytest

from tests.hard import CASES, ROOMS


def marked(case):
    marks = [pytest.mark.xfail(reason=case.fault)] if case.fault else []
    return pytest.param(case, marks=marks, id=f"{case.room}: {case.name}")


@pytest.mark.parametrize("case", [marked(case) for case in CASES])
def test_it_comes_as_expected(case):
    came = case.try_()
    assert case.holds(came), f"came {came}, expected {case.told}"


def test_every_room_has_its_cases():
    assert {case.room for case in CASES} == {room.__name__.split(".")[2] for room in ROOMS}
