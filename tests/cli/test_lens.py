"""`startrack lens`, and commands that a lens table stops."""

from __future__ import annotations

import importlib.util
import json

import pytest

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
