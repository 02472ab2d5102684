"""Files from anybody, in every command: a result or a sentence, within time and memory."""

import os
import sys

import pytest

from tests.fuzz.campaign import Enough, run_cases
from tests.fuzz.grammar import (
    campaign_case,
    catalog_case,
    design_case,
    image_case,
    replaced_case,
    scene_case,
    special_case,
    store_case,
    text_case,
)
from tests.fuzz.worker import FAULTS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's /proc")
SEED = int(os.environ.get("STARTRACK_FUZZ_SEED", "1"))


def faults_of(number: int, seed: int, **options) -> list[str]:
    print(f"seed {seed}; STARTRACK_FUZZ_SEED sets another")
    found: list[str] = []

    def report(case, verdict):
        if verdict.fault:
            found.append(f"{verdict.fault}: {' '.join(case.arguments)}: {verdict.detail}")

    run_cases(number, seed, report, **options)
    return found


def test_100_cases():
    """Each case is a command. The time holds compilation, too."""
    assert faults_of(100, SEED, seconds=300.0, primed=False) == []


@pytest.mark.slow
def test_10_000_cases():
    assert faults_of(10_000, SEED + 1) == []


# Where a fault shows, so that it is found soon; and what it is then called.
SHOWN = {
    "quantities are not limited": (design_case, "traceback"),
    "any file is opened": (special_case, "hang"),
    "long keys are read": (text_case, "hang memory traceback"),
    "images of any kind are read": (special_case, "hang"),
    "damage of a store escapes": (store_case, "traceback"),
    "trials of other files are mixed": (replaced_case, "silent_difference"),
    "a trial divides by zero": (design_case, "traceback"),
    "JSON with NaN": (campaign_case, "silent_nan"),
    "memory beyond the limit": (image_case, "memory"),
    "a command that hangs": (catalog_case, "hang"),
    "sizes of numbers are not limited": (scene_case, "traceback silent_nan memory"),
}


def test_eleven_faults_are_known():
    assert set(SHOWN) == set(FAULTS) - {""}
    assert len(SHOWN) == 11


@pytest.mark.slow
@pytest.mark.parametrize("fault", SHOWN)
def test_a_fault_put_in_on_purpose_is_found(fault):
    kind, names = SHOWN[fault]
    found: list[str] = []

    def report(case, verdict):
        if verdict.fault:
            found.append(verdict.fault)
            raise Enough

    run_cases(
        400,
        SEED,
        report,
        seconds=3.0 if "long" in fault else 10.0,
        kinds=(kind,),
        fault=fault,
        primed=False,
    )
    assert found
    assert found[0] in names
