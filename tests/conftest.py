"""Shared by the tests: outside data, and a small design that takes milliseconds."""

import dataclasses
import gc
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

# As a command does, before anything loads numpy: small matrices on two threads take longer.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import hypothesis

from startrack.cli import terminal
from startrack.core import Curve, interpreted, is_ready
from startrack.design import Case, Design, load_design
from startrack.io import shipped

cv2.setNumThreads(1)  # workers take the cores
hypothesis.settings.register_profile("untimed", deadline=None)  # the first call may compile kernels
hypothesis.settings.load_profile("untimed")
ROOT = Path(__file__).parents[1]
ORACLE = ROOT / "tests" / "oracle"
# Processes that tests start import these sources too, and so find the kernels that are compiled.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
)
collect_ignore = ["oracle"]  # scripts that need what the tests do not
COMPILING = pytest.StashKey[subprocess.Popen | None]()  # the process that compiles before the tests


def pytest_configure(config):
    """Keep built files in a folder for this run, and compile while workers collect the tests."""
    gc.disable()  # it takes a fifth of the time in which the tests are imported, and finds nothing
    if hasattr(config, "workerinput"):
        return
    folder = tempfile.TemporaryDirectory()
    config.add_cleanup(folder.cleanup)
    os.environ["STARTRACK_CACHE"] = folder.name  # of the workers too, which share the indexes
    workers = config.getoption("numprocesses", None)
    config.stash[COMPILING] = None
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    if workers and whole and not is_ready():
        config.stash[COMPILING] = process = subprocess.Popen(
            [sys.executable, "-m", "startrack.cli", "warm"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        config.add_cleanup(process.terminate)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node):
    """Wait until kernels are compiled; otherwise several workers would begin with the same ones."""
    process = node.config.stash[COMPILING]
    if process and process.wait():
        pytest.exit(f"startrack warm must end without an error, got {process.stderr.read()}", 1)


def pytest_collection_finish(session):
    gc.freeze()  # what is imported stays: searching it takes 3 % of the suite
    gc.set_threshold(100_000)  # 3 %, too; cycles are few
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _quick_example():
    """Commands without a design take the one with noise only, whose frames and budgets are quick.

    Their pictures have a tenth of the pixels; those of tests/plots have all.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(terminal, "EXAMPLE", "designs/noise_only.toml")
        patch.setattr("startrack.plots.style.DPI", 60)
        # Or a test would find the results of another one, which had changed the code.
        patch.setattr("startrack.io.cache.interpreting", lambda: True)
        yield


@pytest.fixture
def in_python():
    """Run kernels that are not on disk as Python code: a few small arrays need no compiler.

    For tests of kernels that only other kernels call; the calling kernels are compiled and tested
    elsewhere.
    """
    with interpreted(lambda: True):
        yield


@pytest.fixture(scope="session")
def outside() -> Path:
    """The folder of external data, which is not part of the project."""
    folder = os.environ.get("STARTRACK_DATA")
    if not folder:
        pytest.skip("STARTRACK_DATA does not name the folder of outside data")
    return Path(folder)


@pytest.fixture(scope="session")
def oracle():
    """Read a file of independent results."""
    return lambda name: json.loads((ORACLE / name).read_text())


@pytest.fixture(scope="session")
def small() -> Design:
    """The design with noise only, with a quarter of the pixels, twice as wide, and few trials."""
    design = load_design(shipped("designs/noise_only.toml"))
    assert design.campaign is not None
    instrument = design.case.instrument
    detector = dataclasses.replace(
        instrument.detector, columns=256, rows=256, pixel_pitch=2 * instrument.detector.pixel_pitch
    )
    optics = dataclasses.replace(instrument.optics, blur=2 * instrument.optics.blur)
    instrument = dataclasses.replace(instrument, detector=detector, optics=optics)
    campaign = dataclasses.replace(
        design.campaign,
        trials=12,
        most_trials=24,
        evaluations=20,
        analytic_evaluations=8,
        fresh_trials=60,
        sample_trials=12,
        # What so few fresh trials can show.
        requirements=dataclasses.replace(design.campaign.requirements, min_availability=0.95),
    )
    return Design(dataclasses.replace(design.case, instrument=instrument), campaign)


@pytest.fixture(scope="session")
def blind(small) -> Case:
    """A case that cannot be rendered: its lens passes no light of Gaia's band."""
    infrared = Curve((2e-6, 3e-6), (1.0, 1.0))
    optics = dataclasses.replace(small.case.instrument.optics, transmission=infrared)
    return dataclasses.replace(
        small.case, instrument=dataclasses.replace(small.case.instrument, optics=optics)
    )
