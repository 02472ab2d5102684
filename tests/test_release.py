"""The content of a release: the package with its data, equal from the wheel and the checkout."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

HOME = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=HOME, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def test_the_wheel_has_all_sources_and_data_and_nothing_else(wheel):
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    kept = {"__pycache__", ".ruff_cache"}
    expected = set()
    for folder, inside in (("startrack", "startrack"), ("catalogs", "startrack/_catalogs")):
        for path in (HOME / folder).rglob("*"):
            if path.is_file() and not kept & set(path.parts):
                expected.add(f"{inside}/{path.relative_to(HOME / folder)}")
    assert names == expected


@pytest.mark.slow
def test_a_trial_from_the_wheel_is_that_of_the_checkout(wheel, tmp_path):
    """With the packages of this environment, in a folder without a checkout."""
    site = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(site)]
    subprocess.run([*install, str(wheel)], cwd=tmp_path, check=True)
    found = []
    for place, folder in ((site, tmp_path), (HOME, HOME)):
        environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "PYTHONPATH": str(place)}
        options = {"cwd": folder, "env": environment, "check": True, "capture_output": True}
        where = "import startrack; print(startrack.__file__)"
        where = subprocess.run([sys.executable, "-c", where], **options).stdout.decode()
        assert where.startswith(str(place))
        words = ["-m", "startrack.cli", "montecarlo", "--trials", "20", "--json"]
        run = subprocess.run([sys.executable, *words], **options)
        values = json.loads(run.stdout.splitlines()[-1])
        assert values.pop("design").startswith(str(place))
        found.append({k: v for k, v in values.items() if "second" not in k and k[-2:] != "_s"})
    assert found[0] == found[1]
