"""The scripts of the gallery run, and print and write what they state."""

import runpy
from pathlib import Path

import list_gallery
import pytest

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
# What must be in the output, the files that are written, and the package that is needed.
EXPECTED = {
    "budget_over_aperture": ("arcsec across, most by", ["budget.png"], ""),
    "closed_loop": ("pointing after 20 s", ["closed_loop.png"], ""),
    "errors_of_trials": ("Summary(", ["errors.png"], ""),
    "frame_for_others": ("Frame(size: 512 x 512", ["frames/orion.ser", "frames/orion.csv"], ""),
    "guide_stars": ("triangles", ["flight/startrack_guide.bin", "flight/startrack_guide.c"], ""),
    "image_of_the_earth": ("W/m2/sr/um, in the mean", [], ""),
    "map_of_the_sky": ("arcsec at worst", ["sky.png"], ""),
    "mission_over_a_day": ("TimeIntervals(", [], ""),
    "problem_of_a_photometer": ("error of start over best", [], ""),
    "psf_through_focus": ("of the light in one pixel", ["psf.png"], ""),
    "quantities": ("arcsec Summary(across", [], ""),
    "sequence_in_xarray": ("Tracking(filter across", ["sequence.png"], "xarray"),
    "stars_of_a_frame": ("solved", ["orion.png"], ""),
    "trials_in_pandas": ("'error_x': 'rad'", ["stars.png"], "pandas"),
}


QUICK = ("quantities", "trials_in_pandas")


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=() if one in QUICK else pytest.mark.slow) for one in sorted(EXPECTED)],
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


def test_each_script_is_run_and_on_the_page():
    scripts = sorted(GALLERY.glob("*.py"))
    assert {path.stem for path in scripts} == set(EXPECTED)
    page = list_gallery.PAGE.read_text(encoding="utf-8")
    for script in scripts:
        # Without what it prints and draws, which differs between machines in the last digit.
        for part in list_gallery.section(script, "", "").split("prints")[0].split("\n\n"):
            assert part in page, f"{script.name}: python docs/list_gallery.py writes the page anew"
        for picture in EXPECTED[script.stem][1]:
            assert not picture.endswith("png") or f"](gallery/{picture})" in page
