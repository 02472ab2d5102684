import json
from pathlib import Path

import pytest

from startrack.cli.main import main
from startrack.io import shipped


def test_json_and_picture(tmp_path: Path, capsys):
    assert main(["psf", "--json", "--out", str(tmp_path)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((tmp_path / "psf.json").read_text())
    assert result["model"] == "airy"
    assert 0 < result["model_error"] < 0.05
    fractions = list(result["encircled_energy"].values())
    assert fractions == sorted(fractions)
    assert 0.9 < fractions[-1] <= 1
    factors = result["mtf_nyquist_x"]
    product = factors["optics"] * factors["pixel"] * factors["motion"]
    assert abs(factors["total"] - product) < 2e-3
    assert (tmp_path / "psf.png").read_bytes().startswith(b"\x89PNG")


@pytest.fixture
def undrawn(monkeypatch):
    monkeypatch.setattr("startrack.plots.draw_psf", lambda *_, **__: None)


def test_text(undrawn, tmp_path: Path, capsys):
    assert main(["psf", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    for word in ("model", "FWHM", "energy within", "MTF at Nyquist", "because", "of the peak"):
        assert word in text


def test_a_missing_design_is_wrong_use(tmp_path: Path, capsys):
    assert main(["psf", str(tmp_path / "none.toml")]) == 2
    assert "there is none" in capsys.readouterr().err


def test_diffusion_has_its_own_line(undrawn, tmp_path: Path, capsys):
    design = tmp_path / "diffuse.toml"
    text = shipped("designs/noise_only.toml").read_text(encoding="utf-8")
    design.write_text(text.replace("prnu = 0.01", 'prnu = 0.01\ndiffusion = "3 um"'))
    assert main(["psf", str(design), "--json", "--out", str(tmp_path)]) == 0
    result = json.loads(capsys.readouterr().out)["mtf_nyquist_x"]
    # exp(-2 (pi sigma f)^2) of sigma = 3 / 11 pixel at f = 1 / 2 a pixel.
    assert result["diffusion"] == pytest.approx(0.693, abs=1e-3)
