import tomllib
from dataclasses import replace

import pytest
import tomli_w

from startrack.core.units import arcsec
from startrack.io.tables import from_table, to_table
from startrack.motion import Broadband, Motion, Tone

FILE = """
rate_x = "0.1 deg/s"

[[tones]]
frequency = "80 Hz"
rms_x = "0.5 arcsec"
rms_y = "0.5 arcsec"
lead_y = "-90 deg"

[[tones]]
frequency = "3 Hz"
phase = "0 deg"

[[broadband]]
axis = "z"
frequency = ["0.1 Hz", "1 kHz"]
density = ["2 arcsec2 / Hz", "1e-4 arcsec2 / Hz"]
"""


def test_a_file_gives_si_and_survives():
    motion = from_table(Motion, tomllib.loads(FILE))
    assert motion.tones[0].rms_x == pytest.approx(0.5 * arcsec, rel=1e-15)
    assert motion.tones[0].phase is None
    assert motion.tones[1].phase == 0
    assert motion.broadband[0].frequency == (0.1, 1000.0)
    assert motion.broadband[0].density[0] == pytest.approx(2 * arcsec**2, rel=1e-14)
    assert motion.drawn
    assert from_table(Motion, tomllib.loads(tomli_w.dumps(to_table(motion)))) == motion
    assert hash(motion)


def test_each_kind_of_jitter_is_one_and_rates_are_none():
    motion = from_table(Motion, tomllib.loads(FILE))
    rates = Motion(rate_x=motion.rate_x)
    assert motion.steady == rates
    assert not rates.jitters
    for kind in ("tones", "broadband"):
        assert replace(rates, **{kind: getattr(motion, kind)}).jitters


def test_drawn_is_what_differs_between_trials():
    assert not Motion(1.0, 2.0, 3.0).drawn
    assert not Motion(tones=(Tone(1.0), Tone(2.0, rms_x=1.0, phase=0.0))).drawn
    assert Motion(tones=(Tone(2.0, rms_z=1.0),)).drawn


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"80 Hz"', '"0 Hz"', r"tones\[0\].frequency must be positive, got 0"),
        ('"80 Hz"', '"80 s"', r"tones\[0\].frequency must have a unit that converts to Hz"),
        ('"0.5 arcsec"\nrms_y', '"-1 arcsec"\nrms_y', r"tones\[0\].rms_x must not be negative"),
        ('axis = "z"', 'axis = "roll"', r"broadband\[0\].axis must be one of x, y, z, got 'roll'"),
        ('"0.1 Hz", ', "", r"broadband\[0\].frequency and density must have the same length"),
        ('"1 kHz"', '"0.01 Hz"', r"broadband\[0\].frequency must increase, got \(0.1, 0.01\)"),
        ('"1e-4 arcsec2 / Hz"', '"0 rad2 / Hz"', r"broadband\[0\].density must be positive"),
    ],
)
def test_what_is_wrong_is_named(old, new, words):
    assert FILE.count(old) == 1
    with pytest.raises(ValueError, match=words):
        from_table(Motion, tomllib.loads(FILE.replace(old, new)))


def test_an_axis_has_one_spectrum():
    one = Broadband("x", (1.0, 2.0), (1.0, 1.0))
    with pytest.raises(ValueError, match="at most one spectrum for each axis, got x, x"):
        Motion(broadband=(one, one))
