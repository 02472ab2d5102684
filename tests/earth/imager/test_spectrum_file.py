"""Files of spectra: units that their lines name, and numbers that are no fractions."""

import pytest

from startrack.core import Refused
from startrack.earth.imager.spectrum_file import SpectrumFile


@pytest.mark.parametrize(
    ("text", "keys", "message"),
    [
        ("nm,QE\n400,35\n500,60\n", {"unit": "nm"}, "fractions from 0 to 1 .*, got 60"),
        ("nm;T [%]\n400;0,35\n500;0,6\n", {"unit": "nm"}, "per cent, .*factor must be 0.01"),
        ("Y Units: Reflectance (percent)\n\n0.4 0.1\n0.5 0.2\n", {}, "in per cent"),
        ("wavelength (nm),R\n0.4,0.35\n0.5,0.6\n", {}, "in um, the key unit, but it names nm"),
        ("lambda [Angstrom],T\n4000,0.3\n5000,0.6\n", {"unit": "nm"}, "it names angstrom"),
        ("wavenumber,R\n9000,0.3\n9500,0.6\n", {"unit": "nm"}, "it names 1 / cm"),
        ("400,0.1\n500,0.2\n", {}, "wavelengths from 0.1 to 300 um, got 400 in um"),
        ("1,400,0.1\n2,500,0.2\n", {"unit": "nm"}, "wavelengths .*, got 1 in nm"),
        ("500,0.6\n500,0.1\n600,0\n", {"unit": "nm"}, "one value .*, got 0.6 and 0.1 at 500 nm"),
    ],
)
def test_other_units_and_two_values_of_a_wavelength_are_refused(tmp_path, text, keys, message):
    (tmp_path / "curve.txt").write_text(text)
    with pytest.raises(Refused, match=message):
        SpectrumFile(file="curve.txt", **keys).read(tmp_path)


@pytest.mark.parametrize(
    ("text", "keys", "values"),
    [
        ("nm,um,R\nName: 10 % panel\n600,0.1\n500,1.02\n", {"unit": "nm"}, [1.0, 0.1]),
        ("X Units: Wavelength (micrometers)\n0.6 3.5D-1\n0.5 2D-1\n", {}, [0.2, 0.35]),
        ("Reflectance (percent)\n0.6 35\n0.5 20\n", {"factor": 0.01}, [0.2, 0.35]),
    ],
)
def test_units_that_agree_with_the_keys_are_read(tmp_path, text, keys, values):
    (tmp_path / "curve.txt").write_text(text)
    curve = SpectrumFile(file="curve.txt", **keys).read(tmp_path)
    assert curve["value"] == pytest.approx(values)


@pytest.mark.parametrize(
    "head",
    [
        "wavelength (nm),reflectance,uncertainty (%)",
        "wavelength (nm), QE [fraction], QE [%]",
        "# wavelength in nm, T as a fraction, not in per cent",
        "# Reflectance: soil with moisture (low %), field\nwavelength,R",
        "# reflectance, grain size 75 um\nwavelength,R",
        "v\u00e5gl\u00e4ngd,transmittans",
        "# Filter of 633 um, 10 um wide",
        "lambda,T_550um_filter",
    ],
)
def test_what_else_a_line_tells_is_no_unit(tmp_path, head):
    (tmp_path / "curve.txt").write_text(f"{head}\n400,0.1\n500,0.2\n", encoding="utf-8")
    curve = SpectrumFile(file="curve.txt", unit="nm").read(tmp_path)
    assert curve["value"] == [0.1, 0.2]
