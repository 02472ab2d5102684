"""Prescriptions of Zemax and CODE V: units, encodings and glasses.

Focal lengths are those of a thick lens; indices at 587.6 nm those of the makers' data sheets.
"""

import numpy as np
import pytest

from startrack.core import Refused
from startrack.optics import Tracing, parse_prescription, read_prescription, trace_lens

pytest.importorskip("optiland", reason="the ray tracer is an extra")

FILLER = "0 0 1.5 40 0 0 0 0 0 0"  # what OpticStudio writes after a name; it means nothing


def zemax(glass=f"N-BK7 {FILLER}", makers="SCHOTT", unit="MM", length=1.0, more=""):
    """Radii of 60 and -80 mm, 6 mm of glass, a pupil of 25 mm."""
    return f"""VERS 140124 258 36214
MODE SEQ
UNIT {unit} X W X CM MR CPMM
ENPD {25 / length!r}
{f"GCAT {makers}" if makers else ""}
FTYP 0 0 1 1 0 0 0
XFLN 0
YFLN 0
WAVM 1 0.587562 1
PWAV 1
SURF 0
  TYPE STANDARD
  CURV 0.0
  DISZ INFINITY
SURF 1
  STOP
  TYPE STANDARD
  CURV {length / 60!r}
  DISZ {6 / length!r}
  GLAS {glass}
  {more}
SURF 2
  TYPE STANDARD
  CURV {-length / 80!r}
  DISZ {60 / length!r}
SURF 3
  TYPE STANDARD
  CURV 0.0
  DISZ 0
"""


def code_v(glass="NBK7_SCHOTT", unit="M", length=1.0, radii="RDM;LEN", more="STO"):
    first, second = 60 / length, -80 / length
    if radii == "RDM NO":
        first, second = 1 / first, 1 / second
    return f"""{radii}
TITLE 'one; two ! three'
EPD {25 / length!r} ! of the pupil
DIM {unit}
WL 587.6
XAN 0.0
YAN 0.0
SO 0.0 1.0E+10
S {first!r} {6 / length!r} &
  {glass}
  {more}
S {second!r} {60 / length!r}
SI 0.0 0.0
GO
"""


def focal_length(n):
    """Millimetre, of a thick lens (the lensmaker's formula)."""
    return 1 / ((n - 1) * (1 / 60 + 1 / 80 - (n - 1) * 6 / (n * 60 * 80)))


def lens_of(tmp_path, text, end="zmx", coding="utf-8"):
    path = tmp_path / f"lens.{end}"
    path.write_bytes(text.encode(coding))
    return read_prescription(path)


def require_lens(lens, n):
    assert float(np.squeeze(lens.paraxial.f2())) == pytest.approx(focal_length(n), rel=2e-4)
    assert float(np.squeeze(lens.paraxial.EPD())) == pytest.approx(25)
    assert float(np.squeeze(lens.surfaces[1].thickness)) == pytest.approx(6)


@pytest.mark.parametrize("unit", [("MM", 1.0), ("CM", 10.0), ("IN", 25.4), ("METER", 1000.0)])
@pytest.mark.parametrize("coding", ["utf-16", "utf-16-le", "utf-8-sig"])
def test_lengths_become_millimetres_in_any_encoding(tmp_path, unit, coding):
    require_lens(lens_of(tmp_path, zemax(unit=unit[0], length=unit[1]), coding=coding), 1.5168)


@pytest.mark.parametrize("unit", [("M", 1.0), ("C", 10.0), ("I", 25.4)])
@pytest.mark.parametrize("radii", ["RDM;LEN", "RDM NO"])
def test_code_v_has_its_units_radii_and_curvatures(tmp_path, unit, radii):
    text = code_v(unit=unit[0], length=unit[1], radii=radii)
    require_lens(lens_of(tmp_path, text, "seq"), 1.5168)


def test_decimal_commas_are_read(tmp_path):
    require_lens(lens_of(tmp_path, zemax().replace(".", ",")), 1.5168)


@pytest.mark.parametrize(
    ("glass", "makers", "n"),
    [
        ("N-BK7", "SCHOTT", 1.5168),
        ("n-bk7", "SCHOTT", 1.5168),
        ("K8", "LZOS", 1.5163),
        ("K8", "GOST", 1.5163),
        ("TF3", "LZOS", 1.7174),
        ("TF3", "CDGM", 1.61242),
        ("TF3", "CDGM LZOS", 1.61242),
        ("F_SILICA", "SCHOTT", 1.45846),
        ("SILICA", "MISC", 1.45846),
        ("CAF2", "MISC", 1.43384),
        ("600500", "SCHOTT", 1.6),
    ],
)
def test_a_glass_is_that_of_its_maker(tmp_path, glass, makers, n):
    require_lens(lens_of(tmp_path, zemax(f"{glass} {FILLER}", makers)), n)


@pytest.mark.parametrize(
    ("glass", "n"),
    [
        ("N-BK7_SCHOTT", 1.5168),
        ("SBSL7_OHARA", 1.51633),
        ("K8_LZOS", 1.5163),
        ("1.6:50", 1.6),
        ("516800.641700", 1.5168),
        ("517642", 1.517),
    ],
)
def test_a_glass_of_code_v_is_that_of_its_maker(tmp_path, glass, n):
    require_lens(lens_of(tmp_path, code_v(glass), "seq"), n)


def test_a_model_glass_has_its_own_numbers(tmp_path):
    require_lens(lens_of(tmp_path, zemax("___BLANK 1 0 1.6 50 0 0 0")), 1.6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (zemax(f"N-BK77 {FILLER}"), r"got 'N-BK77' of the catalogues SCHOTT; nearest are N-BK7"),
        (zemax(f"K8 {FILLER}"), r"got 'K8' of the catalogues SCHOTT; nearest are K8 \(lzos\)"),
        (zemax(f"MYGLASS {FILLER}"), "must have glasses that are known, got 'MYGLASS'"),
        (zemax(f"F2 {FILLER}", ""), r"must say the maker of the glass F2, which cdgm \(F2\)"),
        (zemax(makers="MINE"), "of the catalogues MINE; nearest are N-BK7"),
        (zemax("MODEL 1 0"), "index and an Abbe number"),
        (zemax(unit="FURLONG"), "unit of length of mm, cm, in, m, got 'FURLONG'"),
        (zemax(more="SQAP 5 5"), "circular apertures alone, got SQAP"),
    ],
)
def test_what_is_not_known_is_refused_with_its_name(tmp_path, text, words):
    with pytest.raises(Refused, match=words):
        lens_of(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (code_v("F2"), "must say the maker"),
        (code_v("MYGLASS_SCHOTT"), "got 'MYGLASS' of the catalogues SCHOTT"),
        (code_v(radii="LEN"), "say by RDM whether surfaces have radii"),
        (code_v(more="CYL"), "commands that are understood, got 'CYL'"),
        (code_v(more="CIR OBS 3"), "clear circular apertures"),
        (code_v(more="ADE 3.0"), "lens of revolution"),
        (code_v().replace("WL 587.6", "PRV\nWL 587.6"), "private"),
    ],
)
def test_what_the_tracer_would_leave_out_is_refused(tmp_path, text, words):
    with pytest.raises(Refused, match=words):
        lens_of(tmp_path, text, "seq")


def test_unit_and_glasses_are_there_to_be_said(tmp_path):
    path = tmp_path / "lens.zmx"
    path.write_text(zemax(f"TF3 {FILLER}", "CDGM", "IN", 25.4))
    prescription = parse_prescription(path)
    assert prescription.unit == "in"
    assert [(glass.name, glass.maker) for glass in prescription.glasses.values()] == [
        ("TF3", "cdgm")
    ]


def test_a_glass_is_not_traced_where_its_index_is_not_known(tmp_path):
    """N-BK7 is known from 300 to 2500 nm (data sheet of Schott)."""
    lens = lens_of(tmp_path, zemax())
    tracing = Tracing((293.15,), (500e-9, 3e-6), (0.0, 0.01))
    with pytest.raises(Refused, match=r"glass N-BK7, \[300, 2500\] nm, got 3000 nm"):
        trace_lens(lens, "a", "b", tracing)
