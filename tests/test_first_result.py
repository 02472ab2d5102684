"""A fresh process loads what a first trial needs, and nothing that it can do without."""

import subprocess
import sys

HEAVY = ["scipy.stats", "scipy.optimize", "scipy.signal", "astropy", "matplotlib", "nlopt", "rich"]


def loaded(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    return set(subprocess.check_output([sys.executable, "-c", code], text=True).split())


def test_the_package_alone_loads_no_other():
    assert not {"numpy", "scipy", "numba", "cv2", *HEAVY} & loaded("import startrack")


def test_the_chain_loads_no_package_before_it_is_asked_for():
    assert not loaded("import startrack.chain").intersection(HEAVY)
