"""Power spectra of jitter from files."""

import numpy as np
import pytest

from startrack import arcsec, load_design

DESIGN = """
base = "designs/noise_only.toml"
[[instrument.motion.broadband]]
axis = "x"
file = "jitter.csv"
"""


def spectrum(folder, text):
    (folder / "jitter.csv").write_text(text)
    path = folder / "design.toml"
    path.write_text(DESIGN)
    [broadband] = load_design(path).case.instrument.motion.broadband
    return broadband


@pytest.mark.parametrize(
    ("text", "density"),
    [
        ("1, 4\n10, 0.4\n", 4 * arcsec**2),
        ("# measured\n1 4\n\n10 0.4\n", 4 * arcsec**2),
        ("frequency (Hz); PSD (urad2 / Hz)\n1; 4\n10; 0.4\n", 4e-12),
        ("kind [kHz], psd [arcsec2 / Hz]\n0.001, 4\n0.01, 0.4\n", 4 * arcsec**2),
        ("# f [Hz]  PSD [urad^2/Hz]\n1 4\n10 0.4\n", 4e-12),
        ("# frequency (Hz), density (urad2 / Hz)\n# by day\n1, 4\n10, 0.4\n", 4e-12),
        ("# jitter at the sampling rate\n# of one lab, run 3\n1 4\n10 0.4\n", 4 * arcsec**2),
        ("f, psd\r\n1e0, 4e0\r\n10, 0.4\r\n", 4 * arcsec**2),
    ],
)
def test_a_table_beside_the_design_is_a_spectrum(tmp_path, monkeypatch, text, density):
    monkeypatch.chdir("/")
    found = spectrum(tmp_path, text)
    assert found.axis == "x"
    np.testing.assert_allclose(found.frequency, [1, 10], rtol=1e-12)
    np.testing.assert_allclose(found.density, [density, density / 10], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1, 4\n", "two or more lines"),
        ("", "two or more lines"),
        ("1, 4\n2\n", "line 2: must have a frequency and a density"),
        ("1, 4\nx, 3\n", "line 2"),
        ("f (kg), psd\n1, 4\n2, 3\n", "line 1: units"),
        ("frequency_hz,psd_rad2_per_hz\n1,4\n2,3\n", "line 1: must name its units in brackets"),
        ("f,S\nHz,urad^2/Hz\n1,4\n2,3\n", "line 2: must name its units in brackets.*'urad'"),
        ("freq (Hz) psd urad^2/Hz\n1 4\n2 3\n", "line 1: must name its units in brackets"),
        ("f [Hz], rate (deg/s)2/Hz\n1,4\n2,3\n", "line 1: must name its units in brackets"),
        ("f (Hz), two-sided PSD (arcsec2 / Hz)\n1,4\n2,3\n", "line 1: .*one-sided .*'two-sided'"),
        ("# amplitude spectral density\n1 4\n2 3\n", "line 1: .*'amplitude spectral'"),
        ("f Hz, ASD arcsec/sqrtHz\n1,4\n2,3\n", "line 1: .*'ASD'"),
        ("f Hz, jitter arcsec/Hz^0.5\n1,4\n2,3\n", "line 1: .*'Hz.0.5'"),
        ("# PSD of the angular rate\n1 4\n2 3\n", "line 1: .*'PSD of the angular rate'"),
        ("f Hz, PSD g2/Hz\n1,4\n2,3\n", "line 1: .*'g2/Hz'"),
        ("10, 4\n1, 3\n", "frequency must increase"),
    ],
)
def test_what_is_no_spectrum_is_refused(tmp_path, text, words):
    with pytest.raises(ValueError, match=words):
        spectrum(tmp_path, text)


def test_a_missing_file_and_two_tables_are_refused(tmp_path):
    path = tmp_path / "design.toml"
    path.write_text(DESIGN)
    with pytest.raises(ValueError, match=r"jitter\.csv"):
        load_design(path)
    path.write_text(f'{DESIGN}\ndensity = ["1 rad2 / Hz"]\n')
    with pytest.raises(ValueError, match="must be left out if file is given"):
        load_design(path)


@pytest.mark.parametrize(
    "comment",
    [
        "one-sided PSD (not two-sided)",
        "converted from two-sided: values doubled",
        "rms = sqrt(integral) = 0.31 arcsec",
        "angular-rate sensor, integrated to angle",
        "sampled at (nominal) 2 kHz",
    ],
)
def test_a_comment_on_the_source_is_no_quantity(tmp_path, comment):
    head = f"# {comment}\nfrequency (Hz), density (arcsec2 / Hz)\n"
    assert spectrum(tmp_path, head + "1,4\n2,3\n").density[1] == pytest.approx(3 * arcsec**2)
