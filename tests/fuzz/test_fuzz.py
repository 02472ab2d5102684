"""Files from anybody, in every command: a result or a sentence, within time and memory."""

import os
import subprocess
import sys
import textwrap

import pytest

from tests.fuzz.arena import Arena
from tests.fuzz.caches import run_caches
from tests.fuzz.campaign import run_cases
from tests.fuzz.clusters import run_clusters
from tests.fuzz.planted import SHOWN, is_found
from tests.fuzz.worker import FAULTS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's /proc")
SEED = int(os.environ.get("STARTRACK_FUZZ_SEED", "1"))


def faults_of(number: int, seed: int, **options) -> list[str]:
    print(f"seed {seed}; STARTRACK_FUZZ_SEED sets another")
    found: list[str] = []

    def report(case, verdict):
        if verdict.fault:
            found.append(f"{verdict.fault}: {' '.join(case.arguments)}: {verdict.detail}")

    outside = run_cases(number, seed, report, **options)
    return found + [f"written outside of its folder: {path}" for path in outside]


@pytest.mark.parametrize("number", [3, pytest.param(50, marks=pytest.mark.slow)])
def test_a_few_cases(number):
    """Each case is a command. The time holds compilation, too."""
    assert faults_of(number, SEED, seconds=300.0, primed=False) == []


@pytest.mark.slow
def test_10_000_cases():
    assert faults_of(10_000, SEED + 1) == []


def test_eleven_faults_are_known():
    assert set(SHOWN) == set(FAULTS) - {""}
    assert len(SHOWN) == 11


@pytest.mark.slow
@pytest.mark.parametrize("fault", SHOWN)
def test_a_fault_put_in_on_purpose_is_found(fault):
    assert is_found(fault, SEED)


@pytest.mark.parametrize(("says", "hangs"), [(True, False), (False, True)])
def test_what_says_how_far_it_is_has_not_hung(says, hangs, tmp_path):
    """A process that works for 1.5 s, which is more than it may in silence."""
    program = f"""
        import sys, time
        while time.process_time() < 1.5:
            if {says}:
                print("words", file=sys.stderr, flush=True)
        print("answer")
    """
    words = tmp_path / "err.txt"
    with words.open("w") as file:
        line = [sys.executable, "-c", textwrap.dedent(program)]
        worker = subprocess.Popen(line, text=True, stdout=subprocess.PIPE, stderr=file)
        try:
            assert Arena._answers(worker, 0.6, words) is not hangs
        finally:
            worker.kill()
            worker.communicate()


@pytest.mark.slow
def test_damaged_caches_change_nothing(tmp_path):
    assert run_caches(tmp_path, 9, SEED) == 0


@pytest.mark.slow
def test_workers_with_other_code_are_refused(tmp_path):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    assert run_clusters(tmp_path) == 0
