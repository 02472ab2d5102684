"""`startrack lens`, and commands that a lens table stops."""

from __future__ import annotations

import importlib.util
import json
import os
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from startrack.cli.main import main
from startrack.io import shipped


def test_show_prints_what_a_table_holds(capsys):
    assert main(["lens", "show", "petzval", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["focal_length_mm"] == pytest.approx(50.58, abs=0.01)
    assert shown["field_deg"][-1] == pytest.approx(5)
    assert shown["temperature_degc"] == pytest.approx([-20, 20, 60])
    assert main(["lens", "show", "double_gauss"]) == 0
    assert "illumination" in capsys.readouterr().out
    assert main(["lens", "show", "tessar"]) == 2
    assert "one of catadioptric, double_gauss, petzval, triplet" in capsys.readouterr().err


@pytest.mark.skipif(
    importlib.util.find_spec("optiland") is not None, reason="the ray tracer is installed"
)
def test_import_without_the_ray_tracer_says_how_to_install_it(tmp_path, capsys):
    lens = str(shipped("lenses/petzval.zmx"))
    assert main(["lens", "import", lens, "--field", "3", "--out", str(tmp_path / "x.fits")]) == 1
    assert "pip install 'startrack[lens]'" in capsys.readouterr().err
    assert not (tmp_path / "x.fits").exists()


@pytest.mark.skipif(
    importlib.util.find_spec("optiland") is None, reason="needs the ray tracer optiland"
)
def test_what_the_ray_tracer_prints_is_no_part_of_the_json(tmp_path, capsys):
    """The fused silica of the lens has no extinction, which the tracer prints on standard
    output."""
    from tests.optics.test_prescription import zemax  # which needs the ray tracer

    lens = tmp_path / "lens.zmx"
    lens.write_text(zemax("F_SILICA 0 0 1.5 40"))
    few = "--fields", "2", "--wavelengths", "1", "--terms", "11"
    out = str(tmp_path / "x.fits")
    assert main(["lens", "import", str(lens), "--field", "1", *few, "--out", out, "--json"]) == 0
    printed = capsys.readouterr()
    (line,) = printed.out.splitlines()
    assert json.loads(line)["f_number"] > 1
    assert "extinction" in printed.err


@pytest.mark.skipif(not os.environ.get("STARTRACK_DATA"), reason="needs real images")
def test_measure_makes_a_psf_of_real_stars(tmp_path, capsys):
    """99 stars of four images of the sky, compared with the stars of two of the images."""
    folder = Path(os.environ["STARTRACK_DATA"]) / "images"
    images = sorted(str(path) for path in folder.glob("esa_*.tiff"))
    found = []
    for chosen in (images, [one for one in images if "Azi135" in one or "Azi45" in one]):
        out = tmp_path / f"{len(chosen)}.fits"
        options = ["--half", "5", "--oversampling", "3", "--out", str(out), "--json"]
        assert main(["lens", "measure", *chosen, *options]) == 0
        result = json.loads(capsys.readouterr().out)
        assert result["stars"] > 70
        assert result["residual"] < 0.04
        found.append(fits.getdata(out))
    assert found[0].sum() / 9 == pytest.approx(1, rel=1e-3)
    assert np.abs(found[0] - found[1]).max() < 0.15 * found[0].max()


def test_measure_needs_stars(tmp_path, capsys):
    save = tmp_path / "dark.fits"
    fits.PrimaryHDU(np.random.default_rng(1).normal(100, 5, (64, 64)).astype("f4")).writeto(save)
    assert main(["lens", "measure", str(save), "--out", str(tmp_path / "psf.fits")]) == 2
    assert "stars must be 8 at least" in capsys.readouterr().err
    assert not (tmp_path / "psf.fits").exists()
