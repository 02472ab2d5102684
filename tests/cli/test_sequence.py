"""`startrack sequence` from its arguments to its table, picture and JSON."""

import json

import cv2
import numpy as np
import pytest

from startrack.cli.main import main

SHORT = """
period = "0.2 s"
[gyro]
angle_random_walk = "0.1 deg / h(1/2)"
rate_random_walk = "1 deg / h(3/2)"
bias = "3 deg / h"
[[legs]]
duration = "0.9 s"
rate_x = "0.05 deg / s"
"""


def test_it_writes_a_table_a_picture_and_a_summary(capsys, tmp_path):
    profile = tmp_path / "short.toml"
    profile.write_text(SHORT)
    out = tmp_path / "out"
    status = main(
        [
            "sequence",
            "--profile",
            str(profile),
            "--sequences",
            "2",
            "--workers",
            "1",
            "--out",
            str(out),
            "--json",
        ]
    )
    result = json.loads(capsys.readouterr().out)
    assert status == 0
    assert result["frames"] == 10
    assert result["known"] == 1
    assert 0 < result["across_rms_arcsec"] < 5
    table = np.genfromtxt(out / "frames.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["time"][:5], 0.04 + 0.2 * np.arange(5))
    assert cv2.imread(str(out / "sequence.png")) is not None
    assert json.loads((out / "summary.json").read_text()) == result


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "legs is missing"),
        ('[[legs]]\nduration = "2 m"\n', "legs[0].duration must have a unit that converts to s"),
        ('[[legs]]\nduration = "-2 s"\n', "legs[0].duration must be positive, got -2.0"),
        ("[[legs]", "must be a TOML file"),
    ],
)
def test_a_wrong_profile_is_refused_with_its_place(capsys, tmp_path, text, sentence):
    profile = tmp_path / "wrong.toml"
    profile.write_text(text)
    assert main(["sequence", "--profile", str(profile)]) == 2
    assert sentence in capsys.readouterr().err
