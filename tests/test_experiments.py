"""Every experiment runs in its quick mode, so that none breaks unseen."""

import gc
import importlib
import json
import os
import runpy
import subprocess
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import matplotlib
import pytest
from astropy.utils import iers
from matplotlib.figure import Figure

from startrack import Fidelity, load_design, run_trials, shipped
from startrack.core import installed_tables

ROOT = Path(__file__).parents[1]
# Run by another interpreter, in which a peer is installed that startrack's own cannot have.
WORKERS = {"cedar_worker.py", "terrain_rugged.py"}
SCRIPTS = [
    path
    for path in sorted((ROOT / "experiments").glob("*.py"))
    if path.name not in WORKERS and "__main__" in path.read_text()
]
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

COMMON = (
    "astropy.coordinates", "astropy.time", "scipy.optimize", "scipy.stats", "startrack.benchmark",
    "startrack.earth.imager", "startrack.mission", "startrack.optimise", "startrack.sequence",
    "startrack.verification",
)  # fmt: skip
# Tables that the scripts have in common are as coarse as the sizes of their quick modes, whose
# figures mean nothing.
COARSE = {
    "plots.style": ("DPI", 30),
    "trial.window": ("SAMPLES", 4),
    "verification.margins": ("FIELDS", 32),
}


@pytest.fixture(scope="module", autouse=True)
def _loaded():
    """This process has what would be most of each script's time, for each runs in a copy of it.

    Imports, the kernels that a trial reads from disk, the tables of dates, the names of the fonts
    and the first picture.
    """
    for name in COMMON:
        importlib.import_module(name)
    case = load_design(shipped("designs/noise_only.toml")).case
    for fidelity in Fidelity:
        run_trials(case, 1, range(1), fidelity)
    with installed_tables():
        iers.earth_orientation_table.get()
    figure = Figure()
    figure.subplots().set(title="fonts", xlabel="10")
    figure.canvas.draw()
    gc.freeze()


def run_in_copy(script, folder):
    """The status with which a script ends that runs in a folder, in a copy of this process."""
    copy = os.fork()
    if copy:
        return os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1])
    status = 1
    try:
        os.chdir(folder)
        for stream, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), stream)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")  # not what pytest reads
        run_quickly(script)
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)  # what tests have left to do at the end is not the copy's


def run_quickly(script):
    """Run a script as `python script --quick --json figures.json` would."""
    warnings.resetwarnings()
    matplotlib.use("agg")
    tempfile.tempdir = tempfile.mkdtemp(prefix=".", dir=Path.cwd())
    for module, (name, size) in COARSE.items():
        held = importlib.import_module(f"startrack.{module}")
        assert hasattr(held, name), name
        setattr(held, name, size)
    sys.path.insert(0, str(script.parent))
    sys.argv = [str(script), "--quick", "--json", "figures.json"]
    runpy.run_path(str(script), run_name="__main__")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_experiment_runs_in_its_quick_mode(script, tmp_path):
    assert "command.read(" in script.read_text(), (
        f"{script.name} must read its options with `command.read`, which adds --quick and --json, "
        "and do every step on the smallest sizes under --quick"
    )
    status = run_in_copy(script, tmp_path)
    assert status == 0, f"{script.name} --quick:\n{(tmp_path / 'stderr').read_text()[-3000:]}"
    assert json.loads((tmp_path / "figures.json").read_text()) is not None
    left = sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith("."))
    assert left == ["figures.json", "stderr", "stdout"], (
        f"{script.name} --quick must leave no file that is not asked for"
    )


@pytest.mark.slow
def test_a_campaign_with_its_processes_in_its_quick_mode(tmp_path):
    words = ["--quick", "--json", "figures.json", "--parts", "bytes", "efficiency", "kills"]
    subprocess.run(
        [sys.executable, str(ROOT / "experiments" / "campaign.py"), *words],
        cwd=tmp_path,
        check=True,
    )
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["same_bytes"]
    assert figures["lost"] == figures["doubled"] == figures["different"] == 0
