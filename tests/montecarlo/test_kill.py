"""Kill -9 of drivers and workers: nothing lost, nothing doubled, the same bytes, no orphans."""

import runpy
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's /proc")
EXPERIMENT = Path(__file__).parents[2] / "experiments" / "campaign.py"
sys.path.append(str(EXPERIMENT.parent))


@pytest.fixture(scope="module")
def kill_and_resume():
    return runpy.run_path(str(EXPERIMENT))["kill_and_resume"]


def judge(figures, kills):
    assert figures["kills"] == kills
    assert figures["campaigns"] >= 1
    for name in ("lost", "doubled", "different", "orphans"):
        assert figures[name] == 0, name


def test_a_kill(kill_and_resume, tmp_path):
    judge(kill_and_resume(tmp_path, 1, seed=2, trials=300, longest=4.0), 1)


@pytest.mark.slow
def test_fifty_kills(kill_and_resume, tmp_path):
    judge(kill_and_resume(tmp_path, 50, seed=3), 50)
