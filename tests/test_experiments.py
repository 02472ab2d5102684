"""Every experiment runs in its quick mode."""

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# Run by another interpreter, in which a peer is installed that startrack's own cannot have, or by
# another experiment.
WORKERS = {"cedar_worker.py", "speed_against.py", "terrain_rugged.py"}
SCRIPTS = [
    path
    for path in sorted((ROOT / "experiments").glob("*.py"))
    if path.name not in WORKERS and "__main__" in path.read_text()
]
_specification = importlib.util.spec_from_file_location(
    "command", ROOT / "experiments" / "command.py"
)
command = importlib.util.module_from_spec(_specification)
_specification.loader.exec_module(command)
# Those whose smallest sizes take longest: four fifths of the time of all.
LONG = {
    "all",
    "ask_it",
    "attitude",
    "chandra",
    "day",
    "detection",
    "frame_picture",
    "hard_cases",  # tests/test_hard_cases.py has the same cases
    "house",
    "same_bytes",
    "how_sure",
    "units",
    "variance",
    "budget_against_trials",
    "camera_in_loop",
    "camera_posterior",
    "cameras",
    "campaign",
    "design",
    "earth_loop",
    "ecosystem",
    "exclusion",
    "fidelities",
    "figures",
    "first_run",
    "identification",
    "lens",
    "nanosatellite",
    "optimiser",
    "page_in_browser",
    "photographs",
    "profile_trial",
    "moving_objects",
    "radiometry",
    "retrieval_formulas",
    "robust",
    "search",
    "second_camera",
    "speed",
    "terrain",
    "validation",
    "backgrounds",
    "earth_images",
    "earth_sensors",
    "in_motion",
    "in_seconds",
    "intervals",
    "mission",
    "scanner_jitter",
    "scenes",
    "speed_vs_error",
    "meant",
    "earth_surfaces",
    "flown",
    "psf_models",
    "smallest_fires",
    "solvers",
}
EXPECTED = {
    name: command.expectations(name)
    for name in tomllib.loads((ROOT / "experiments" / "expected.toml").read_text())
}
# Parts of experiments that a quick run leaves out.
NOT_QUICK = {
    ("campaign", "same_bytes"),
    ("day", "resumed"),
    ("day", "wheel_same"),
    ("meant", "orders_green"),
    ("intervals", "sobol_error"),
    ("intervals", "rare_ratio"),
}
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

# One process loads what all scripts load, and each script runs in a copy of it: its own imports,
# the kernels that a trial reads from disk, the tables of dates, the names of the fonts and the
# first picture would be most of its time. Tables that the scripts have in common are as coarse as
# the sizes of their quick modes, whose figures mean nothing.
PARENT = """
import gc, os, runpy, sys, traceback
sys.path.insert(0, sys.argv[1])
import one_thread
import astropy.coordinates, astropy.time, numpy, scipy.optimize, scipy.stats
import startrack.benchmark, startrack.earth.imager, startrack.mission, startrack.optimise
import startrack.plots, startrack.sequence, startrack.verification
from astropy.utils import iers
from matplotlib.figure import Figure
from startrack import Fidelity, load_design, run_trials, shipped
from startrack.core import installed_tables

sizes = {"plots.style": ("DPI", 30), "trial.window_plan": ("SAMPLES", 4),
         "verification.accuracy": ("FIELDS", 32)}
for module, (name, size) in sizes.items():
    held = sys.modules["startrack." + module]
    assert hasattr(held, name), name
    setattr(held, name, size)
for fidelity in Fidelity:
    run_trials(load_design(shipped("designs/noise_only.toml")).case, 1, range(1), fidelity)
with installed_tables():
    iers.earth_orientation_table.get()
figure = Figure()
figure.subplots().set(title="fonts", xlabel="10")
figure.canvas.draw()
gc.freeze()
for line in sys.stdin:
    script, folder = line.rstrip("\\n").split("\\t")
    child = os.fork()
    if child:
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
        continue
    os.chdir(folder)
    for stream, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), stream)
    sys.argv = [script, "--quick", "--json", "figures.json"]
    try:
        runpy.run_path(script, run_name="__main__")
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)
    sys.exit()
"""


@pytest.fixture(scope="session")  # a worker that gets these tests in parts starts one
def parent():
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, str(ROOT / "experiments")],
        env=os.environ | {"MPLBACKEND": "agg"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield process
        process.stdin.close()


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem in LONG else ())
        for path in SCRIPTS
    ],
)
def test_an_experiment_runs_in_its_quick_mode(script, parent, tmp_path):
    assert "command.read(" in script.read_text(), (
        f"{script.name} must read its options with `command.read`, which adds --quick and --json, "
        "and do every step on the smallest sizes under --quick"
    )
    print(script, tmp_path, sep="\t", file=parent.stdin, flush=True)
    status = int(parent.stdout.readline())
    assert status == 0, f"{script.name} --quick:\n{(tmp_path / 'stderr').read_text()[-3000:]}"
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures is not None
    missing = [row.place for row in command.judge(script.stem, figures) if row.value is None]
    assert not {(script.stem, place) for place in missing} - NOT_QUICK
    left = sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith("."))
    assert left == ["figures.json", "stderr", "stdout"], (
        f"{script.name} --quick must leave no file that is not asked for"
    )


def test_what_experiments_use_of_tests_is_found_beside_an_installed_package():
    """`command` adds the checkout to the path, after the installed package."""
    for path in SCRIPTS:
        text = path.read_text()
        if (place := text.find("from tests.")) >= 0:
            assert 0 <= text.find("\nimport command\n") < place, path.name
    assert str(ROOT) in sys.path


def test_a_long_experiment_is_one():
    assert {path.stem for path in SCRIPTS} >= LONG


def test_expectations_are_of_experiments_and_their_claims_stand_in_the_pages():
    assert set(EXPECTED) <= {path.stem for path in SCRIPTS}
    for name, rows in EXPECTED.items():
        for row in rows:
            assert row.low is not None or row.high is not None, (name, row)
            if row.page:
                assert row.text in (ROOT / row.page).read_text(encoding="utf-8"), (name, row)
                assert row.claim is not None, (name, row)
                assert row.commit, (name, row)


def test_a_figure_out_of_its_range_is_said_and_ends_with_status_1(tmp_path, capsys, monkeypatch):
    figures = {"coverage_95": {"across": 0.95, "across-99.73": 0.96, "availability": 0.0}}
    options = argparse.Namespace(json=None, quick=False)
    monkeypatch.setattr(sys, "argv", ["campaign.py"])
    with pytest.raises(SystemExit) as ended:
        command.run(lambda: command.save(options, figures))
    assert ended.value.code == 1
    errors = capsys.readouterr().err.splitlines()
    assert errors == [
        "NOT AS EXPECTED: coverage_95/availability: 0, expected at least 0.92",
        "NOT AS EXPECTED: same_bytes: missing, expected at least 1",
    ]


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
