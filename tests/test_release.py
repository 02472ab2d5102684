"""What a release holds: the package with its data, the same from the wheel as from the checkout."""

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
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", "v"], cwd=tmp_path,
                   check=True)  # fmt: skip
    python = str(tmp_path / "v" / "bin" / "python")
    install = [python, "-m", "pip", "install", "-q", "--no-deps", "--force-reinstall", str(wheel)]
    subprocess.run(install, cwd=tmp_path, check=True)
    words = ["-m", "startrack.cli", "montecarlo", "--trials", "20", "--json"]
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    found = []
    for program, folder, more in ((python, tmp_path, {}), (sys.executable, HOME, {})):
        run = subprocess.run(
            [program, *words], cwd=folder, env=environment | more, check=True, capture_output=True
        )
        values = json.loads(run.stdout.splitlines()[-1])
        found.append({key: value for key, value in values.items() if "second" not in key})
    assert found[0] == found[1]
