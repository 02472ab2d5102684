"""Shares of time: calls of a file to outside code belong to that file."""

import sys
from pathlib import Path

import pytest

import startrack

sys.path.append(str(Path(__file__).parents[1] / "experiments"))
from profile_trial import Profile, fractions, rooms, spendings

HOME = Path(startrack.__file__).parent


def function(name: str) -> tuple[str, int, str]:
    path = str(HOME / name) if name.endswith(".py") else "~"
    return path, 1, name


def called(own: float, **callers: float):
    """A row of a profile: own seconds, and seconds within for each caller."""
    by = {function(f"{name}.py"): (1, 1, 0.0, within) for name, within in callers.items()}
    return 1, 1, own, own, by


def test_what_a_file_calls_outside_is_its_own():
    stats = {
        function("chain.py"): called(1.0),
        function("detection/find.py"): called(2.0, chain=9.0),
        function("numpy.dot"): called(5.0, chain=4.0, **{"detection/find": 1.0}),
    }
    assert fractions(stats) == pytest.approx({"chain.py": 5 / 8, "detection/find.py": 3 / 8})


def test_what_is_called_outside_by_outside_counts_once():
    outer, inner = function("scipy"), function("numpy")
    stats = {
        function("chain.py"): called(1.0),
        outer: called(1.0, chain=3.0),
        inner: (1, 1, 2.0, 2.0, {outer: (1, 1, 2.0, 2.0)}),
    }
    assert fractions(stats) == {"chain.py": 1.0}


def test_a_room_has_all_of_its_files():
    found = Profile(1.0, {"detection/find.py": 0.5, "chain.py": 0.3, "detection/detect.py": 0.2})
    assert rooms(found) == pytest.approx({"detection": 0.7, "chain.py": 0.3})


def test_a_profile_of_a_real_trial_adds_up_and_sees_the_kernels():
    import cProfile
    import pstats

    from profile_trial import run

    from startrack.design.case import Fidelity
    from startrack.design.files import load_design
    from startrack.io import shipped

    case = load_design(shipped("designs/noise_only.toml")).case
    run(case, Fidelity.FRAME, 3)
    profiler = cProfile.Profile()
    profiler.runcall(run, case, Fidelity.FRAME, 3)
    report = pstats.Stats(profiler)
    seconds = sum(own for _, own in spendings(report.stats))
    assert seconds == pytest.approx(report.total_tt, rel=0.02)
    assert "detector/digitise.py" in fractions(report.stats)
