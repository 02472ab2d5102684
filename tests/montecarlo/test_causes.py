import dataclasses
import math

import numpy as np
import pytest
from astropy.coordinates import GCRS, get_body
from astropy.time import Time
from scipy.spatial.transform import Rotation

from startrack.core import arcsec, deg
from startrack.design import KeepOut
from startrack.io import pointing
from startrack.metrics import ErrorLimits
from startrack.montecarlo import Ending, endings, export, with_causes
from startrack.scene import ObserverOrbit, body_angles
from startrack.trial import OUTCOMES

DATE = "2026-03-20T12:00:00"


def lit(case, *lights):
    scene = dataclasses.replace(
        case.scene, lights=lights, date=DATE, orbit=ObserverOrbit(600e3, phase=0.0)
    )
    return dataclasses.replace(case, scene=scene)


def six_trials():
    table = np.zeros(6, OUTCOMES)
    table["trial"] = np.arange(6)
    table["solved"][:3] = True
    table["error_x"][:3] = np.array([1, 20, 7200]) * arcsec
    table["false"][2] = True
    for axis in "xyz":
        table[f"sigma_{axis}"] = arcsec
    table["spots"] = [9, 9, 9, 0, 30, 30]
    return table


def sun_at(angle):
    """A boresight at a given angle from the Sun on that date, by astropy."""
    sun = get_body("sun", Time(DATE)).transform_to(GCRS())
    return pointing(sun.ra.deg, sun.dec.deg + angle, 0)


def test_each_trial_has_its_cause(case):
    """Six different ends of trials; the last two boresights are 30 and 120 degrees from the Sun."""
    attitudes = Rotation.concatenate([*[pointing(0, 85, 0)] * 4, sun_at(30), sun_at(80)])
    found = endings(
        lit(case, "sun"), 1, six_trials(), attitudes, ErrorLimits(), KeepOut(sun=40 * deg)
    )
    assert found.ending == [
        Ending.CORRECT,
        Ending.INACCURATE,
        Ending.FALSE,
        Ending.TOO_FEW,
        Ending.BLINDED,
        Ending.NO_MATCH,
    ]
    assert found.reason[4] == "sun at 30.0 deg"
    assert found.count()[Ending.BLINDED] == 1
    wide = endings(lit(case, "sun"), 1, six_trials(), attitudes, ErrorLimits(across=21 * arcsec))
    assert wide.ending[1] is Ending.CORRECT
    assert wide.ending[4] is Ending.NO_MATCH  # without a requirement, only a body in the field


def test_angles_are_those_of_astropy(case):
    attitude = Rotation.concatenate([sun_at(30)])
    line = attitude.inv().apply([0.0, 0.0, 1.0])
    sun, moon, limb = body_angles(lit(case, "sun").scene, 1, [0], line)[0]
    assert sun / deg == pytest.approx(30, abs=0.02)
    there = get_body("moon", Time(DATE)).transform_to(GCRS()).cartesian.xyz.value
    angle = math.degrees(math.acos(line[0] @ there / np.linalg.norm(there)))
    assert moon / deg == pytest.approx(angle, abs=1.2)  # the Moon's parallax from the orbit
    down = math.degrees(math.acos(-line[0] @ [1.0, 0, 0]))  # the orbit begins at its node
    assert limb / deg == pytest.approx(down - math.degrees(math.asin(6378.137 / 6978.137)), abs=0.1)
    assert np.isnan(body_angles(case.scene, 1, [0], line)).all()


@pytest.mark.parametrize("name", ["trials.csv", "trials.parquet"])
def test_the_table_holds_where_how_and_why(case, tmp_path, name):
    if name.endswith("parquet"):
        parquet = pytest.importorskip("pyarrow.parquet")
    attitudes = Rotation.concatenate([pointing(10, 20, 30)] * 6)
    case = lit(case, "sun")
    found = endings(case, 1, six_trials(), attitudes)
    export(tmp_path / name, with_causes(case, six_trials(), attitudes, found))
    if name.endswith("csv"):
        head, first, *_ = (tmp_path / name).read_text().splitlines()
        row = dict(zip(head.split(","), first.split(","), strict=True))
    else:
        row = parquet.read_table(tmp_path / name).to_pylist()[0]
    assert [float(row[key]) for key in ("ra_deg", "dec_deg", "roll_deg")] == pytest.approx(
        [10, 20, 30]
    )
    assert float(row["rate_deg_per_s"]) == pytest.approx(0.05 * 2**0.5)
    assert 0 < float(row["sun_deg"]) < 180
    assert (row["status"], row["reason"]) == ("correct", "0 stars")
