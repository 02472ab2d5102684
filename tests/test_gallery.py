"""The scripts of the gallery run, and print and write what they say."""

import importlib.util
import runpy
from pathlib import Path

import pytest

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
# What must be in the output, the files that are written, and the package that is needed.
EXPECTED = {
    "budget_over_aperture": ("arcsec across, most by", ["budget.png"], ""),
    "frame_for_others": ("Frame(size: 512 x 512", ["frames/orion.ser", "frames/orion.csv"], ""),
    "guide_stars": ("triangles", ["flight/startrack_guide.bin", "flight/startrack_guide.c"], ""),
    "quantities": ("arcsec Summary(across", [], ""),
    "sequence_in_xarray": ("units:    rad", ["sequence.png"], "xarray"),
    "trials_in_pandas": ("'error_x': 'rad'", [], "pandas"),
}


SLOW = ("budget_over_aperture", "frame_for_others", "guide_stars", "sequence_in_xarray")


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.slow if one in SLOW else ()) for one in sorted(EXPECTED)],
)
def test_a_script_of_the_gallery_runs(name, tmp_path, monkeypatch, capsys):
    text, files, package = EXPECTED[name]
    if package:
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(GALLERY / f"{name}.py"), run_name="__main__")
    assert text in capsys.readouterr().out
    for file in files:
        assert (tmp_path / file).stat().st_size > 0


def test_each_script_is_run():
    assert {path.stem for path in GALLERY.glob("*.py")} == set(EXPECTED)
    assert importlib.util.find_spec("startrack")
