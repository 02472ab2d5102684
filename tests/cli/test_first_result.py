"""A fresh process loads only what a first trial needs."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from startrack import load_design, shipped
from startrack.core import Streams
from startrack.detection import examine
from startrack.observation import random_attitude
from startrack.response import star_response
from startrack.trial import observe

HEAVY = ["scipy.stats", "scipy.optimize", "scipy.signal", "astropy", "matplotlib", "nlopt", "rich"]


def loaded(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    return set(subprocess.check_output([sys.executable, "-c", code], text=True).split())


def test_the_package_alone_loads_no_other():
    assert not {"numpy", "scipy", "numba", "cv2", *HEAVY} & loaded("import startrack")


def test_a_command_limits_the_threads_of_its_matrices_before_these_are_loaded():
    """Otherwise each worker would have as many threads as there are cores, and they would wait
    for each other."""
    code = (
        "import os, sys; from startrack.cli.main import main; sys.argv[1:] = ['keys', '-x']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"
    )
    bare = {name: text for name, text in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", code], text=True, env=bare, capture_output=True, check=True
    )
    assert done.stdout == "1 False\n"


def test_the_chain_loads_no_package_and_its_picture_no_room_that_draws_others():
    code = (
        "import json, sys, startrack.trial\n"
        "chain = list(sys.modules); from startrack.plots import draw_frame\n"
        "print(json.dumps([chain, list(sys.modules)]))"
    )
    done = subprocess.check_output([sys.executable, "-c", code], text=True)
    chain, picture = json.loads(done)
    assert not set(HEAVY).intersection(chain)
    rooms = {"budget", "montecarlo", "mission", "optimise", "report", "sequence"}
    assert not {f"startrack.{room}" for room in rooms}.intersection(picture)
    assert "matplotlib" in picture


def test_processes_of_the_tests_import_these_sources(tmp_path):
    """Another copy, such as one that pip installed, would compile all kernels again."""
    code = "import startrack; print(startrack.__path__[0])"
    found = subprocess.check_output([sys.executable, "-c", code], text=True, cwd=tmp_path)
    assert Path(found.strip()) == Path(__file__).parents[2] / "startrack"


def compute_less(put):
    """Measure stars at fewer places in the pixel and with fewer samples of noise, because Python
    is slow."""
    put(star_response, "PHASES", 2)
    put(examine, "PATTERNS", 20)


def first_trial():
    """The example with a quarter of its pixels: hash of the frame, spots, matches, attitude."""
    text = shipped("designs/noise_only.toml").read_text(encoding="utf-8")
    # No other test has this case or this blur: what is kept of theirs is not of `compute_less`.
    for old, new in (
        ("columns = 512", "columns = 250"),
        ("rows = 512", "rows = 250"),
        ('blur = "5 um"', 'blur = "4.9 um"'),
    ):
        assert old in text
        text = text.replace(old, new)
    path = Path("first.toml")
    path.write_text(text)
    case = load_design(path).case
    streams = Streams(1, 3)
    record = observe(case, random_attitude(streams), streams)
    image = hashlib.sha256(record.frame.image.tobytes()).hexdigest()
    attitude = record.estimate.icrs_to_camera.as_quat(canonical=True)
    return image, record.outcome.spots, record.outcome.stars, attitude.tolist()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """The first trial by compiled kernels, which also keeps the index of the patterns."""
    star_response.phases.cache_clear()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path_factory.mktemp("compiled"))
            compute_less(patch.setattr)
            return first_trial()
    finally:
        star_response.phases.cache_clear()  # other tests have more of them


def in_a_fresh_process(folder, *lines):
    """Run the first trial in a fresh process with a new folder for kernels; the modules that it
    loads."""
    code = [
        "import json, sys",
        "from contextlib import nullcontext",
        "mode = nullcontext()",
        *lines,
        "from tests.cli.test_first_result import compute_less, first_trial",
        "compute_less(setattr)",
        "with mode:",
        "    found = first_trial()",
        "print(json.dumps([*found, list(sys.modules)]))",
    ]
    places = {"NUMBA_CACHE_DIR": str(folder / "code"), "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(code)],
        text=True,
        cwd=folder,
        check=True,
        env={**os.environ, **places},
        capture_output=True,
    )
    return *json.loads(done.stdout), done.stderr


def test_a_first_trial_compiles_nothing_and_finds_the_same(tmp_path, compiled):
    """Python runs the kernels; sums in another order differ in their last digits.

    The process loads no tables, no ephemeris and no pictures.
    """
    *found, attitude, modules, _ = in_a_fresh_process(
        tmp_path, "from startrack.core import interpreted", "mode = interpreted(lambda: True)"
    )
    assert not list(tmp_path.rglob("*.nbc"))
    assert "astropy.io.fits" in modules  # the catalogue is one
    needless = {"astropy.table", "astropy.time", "astropy.coordinates", "matplotlib", "nlopt"}
    assert not needless.intersection(modules)
    *expected, same = compiled
    assert found == expected
    assert found[2] > 5
    assert max(abs(a - b) for a, b in zip(attitude, same, strict=True)) < 1e-11


@pytest.mark.slow
def test_a_first_trial_on_plain_numba_finds_the_same(tmp_path, compiled):
    """As with a numba that lacks the unpublished names; one line reports it."""
    *found, _, errors = in_a_fresh_process(
        tmp_path, "sys.modules['startrack.core.compiler'] = None"
    )
    assert tuple(found) == compiled
    assert errors.count("this version of numba has changed") == 1
    assert list(tmp_path.rglob("*.nbc"))
