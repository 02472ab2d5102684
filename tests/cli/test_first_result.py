"""A fresh process loads what a first trial needs, and nothing that it can do without."""

import subprocess
import sys
from pathlib import Path

HEAVY = ["scipy.stats", "scipy.optimize", "scipy.signal", "astropy", "matplotlib", "nlopt", "rich"]


def loaded(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    return set(subprocess.check_output([sys.executable, "-c", code], text=True).split())


def test_the_package_alone_loads_no_other():
    assert not {"numpy", "scipy", "numba", "cv2", *HEAVY} & loaded("import startrack")


def test_the_chain_loads_no_package_before_it_is_asked_for():
    assert not loaded("import startrack.trial").intersection(HEAVY)


def test_the_chain_builds_no_kernel_before_it_is_called():
    code = (
        "import startrack.trial; from startrack.core import poisson_quantile; "
        "print(poisson_quantile.types)"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_a_first_trial_loads_no_tables_no_ephemeris_and_no_pictures():
    first = (
        "from startrack import load_design, run_random_trial, shipped; "
        "case = load_design(shipped('designs/nanosatellite.toml')).case; "
        "assert run_random_trial(case, 1, 0).solved"
    )
    needless = {"astropy.table", "astropy.time", "astropy.coordinates", "matplotlib", "nlopt"}
    modules = loaded(first)
    assert "astropy.io.fits" in modules  # the catalogue is one
    assert not needless & modules


def test_processes_of_the_tests_import_these_sources(tmp_path):
    """Another copy, as pip installed it, would compile all kernels once more."""
    code = "import startrack; print(startrack.__path__[0])"
    found = subprocess.check_output([sys.executable, "-c", code], text=True, cwd=tmp_path)
    assert Path(found.strip()) == Path(__file__).parents[2] / "startrack"
