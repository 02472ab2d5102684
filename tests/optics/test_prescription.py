"""Prescriptions of Zemax and CODE V: units, encodings and glasses.

Focal lengths are those of a thick lens; indices at 587.6 nm those of the makers' data sheets.
"""

import numpy as np
import pytest

from startrack.core import Refused
from startrack.optics import Tracing, parse_prescription, read_prescription, trace_lens
from startrack.optics.ray_trace import refuse_lens

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


@pytest.mark.parametrize("unit", [("MM", 1.0), ("IN", 25.4), ("METER", 1000.0)])
def test_ideal_lenses_have_their_focal_length_in_millimetres(tmp_path, unit):
    plane = "CURV 0\n  DISZ"
    text = f"""UNIT {unit[0]}
ENPD {10 / unit[1]!r}
FTYP 0 0 1 1 0 0 0
YFLN 0
WAVM 1 0.587562 1
PWAV 1
SURF 0
  TYPE STANDARD
  {plane} INFINITY
SURF 1
  STOP
  TYPE PARAXIAL
  PARM 1 {50 / unit[1]!r}
  {plane} {50 / unit[1]!r}
SURF 2
  TYPE STANDARD
  {plane} 0
"""
    lens = lens_of(tmp_path, text)
    assert float(np.squeeze(lens.paraxial.f2())) == pytest.approx(50)


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
        (zemax(more="OBDC 3 0"), "apertures about its axis, got OBDC 3 0"),
        (zemax(more="OBSC 2 5 0"), "obstructions that are discs, got OBSC 2 5 0"),
        (zemax().partition("SURF 3")[0], "end with the surface of the image.*got surface 2 with"),
        (zemax().replace("  DISZ 60.0\n", ""), r"distance \(DISZ\) after each surface, not so 2"),
        (zemax().replace("  STOP\n", ""), r"one surface as the stop \(STOP\), got 0"),
        (
            zemax(more="TYPE EVENASPH\nPARM 1 1e-4").replace("STOP\n  TYPE STANDARD", "STOP"),
            "a term in r.2",
        ),
        (zemax().replace("WAVM 1 0.587562", "WAVM 1 587.562"), "from 0.1 to 30 um, got 587.562 um"),
        (zemax().replace("FTYP 0 0 1 1 0 0 0", "FTYP 0 0 1 1 0 0 1"), "lens that is afocal"),
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
        (code_v().replace("WL 587.6", "WL 0.5876"), "from 0.1 to 30 um, got 0.0005876 um"),
        (code_v(more="A"), "numbers after its commands, got 'A'"),
    ],
)
def test_what_the_tracer_would_leave_out_is_refused(tmp_path, text, words):
    with pytest.raises(Refused, match=words):
        lens_of(tmp_path, text, "seq")


def test_an_asphere_of_code_v_begins_with_the_fourth_power(tmp_path):
    """The equation of a conic with terms in r^4 and r^6, in inches of the file; millimetre here."""
    fourth, sixth, inch = -2e-7, 3e-10, 25.4
    terms = f"STO\n  ASP; K -0.5\n  A {fourth * inch**3!r}; B {sixth * inch**5!r}"
    lens = lens_of(tmp_path, code_v(unit="I", length=inch, more=terms), "seq")
    r, c = 10.0, 1 / 60
    sag = c * r**2 / (1 + np.sqrt(1 - 0.5 * c**2 * r**2)) + fourth * r**4 + sixth * r**6
    assert float(np.squeeze(lens.surfaces[1].geometry.sag(0.0, r))) == pytest.approx(sag, rel=1e-9)


@pytest.mark.parametrize("defocus", [0.0, 0.2])
def test_the_image_of_code_v_is_at_its_focus_and_defocus(tmp_path, defocus):
    """The back focal length of a thick lens."""
    text = code_v(length=10.0, unit="C").replace(
        f"{60 / 10.0!r}\nSI 0.0 0.0", f"0.0\nPIM\nSI 0 {defocus}"
    )
    lens = lens_of(tmp_path, text, "seq")
    n = 1.5168
    back = focal_length(n) * (1 - (n - 1) * 6 / (n * 60)) + 10 * defocus
    assert float(np.squeeze(lens.surfaces.get_thickness(2))) == pytest.approx(back, rel=2e-4)


def test_the_diameter_of_a_floating_stop_is_half_of_it(tmp_path):
    text = zemax(more="DIAM 12.5 1 0 0 1").replace("ENPD 25.0", "FLOA")
    require_lens(lens_of(tmp_path, text), 1.5168)


def test_what_is_before_the_middle_of_a_lens_takes_light(tmp_path):
    lens = lens_of(tmp_path, zemax(more="OBSC 0 5.0 0"))
    table, _ = trace_lens(lens, "a", "b", Tracing((293.15,), (550e-9, 600e-9), (0.0, 0.01)))
    assert table.area[0, :, 0] == pytest.approx(np.pi * (12.5e-3**2 - 5e-3**2), rel=2e-3)


def test_what_does_not_count_is_said(tmp_path):
    path = tmp_path / "lens.zmx"
    path.write_text(zemax().replace("WAVM", "ENVD -40 0 1\nVCYN 0 0.3\nMNUM 2 1\nWAVM"))
    words = ("those at -40 degC", "its vignetting factors", "of its 2 configurations")
    notes = parse_prescription(path).notes
    assert all(word in note for word, note in zip(words, notes, strict=True))
    path.write_text(zemax().replace("WAVM", "ENVD -40 0 0\nVCYN 0 0\nMNUM 1 1\nWAVM"))
    assert not parse_prescription(path).notes


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


def test_a_surface_that_is_curved_along_one_axis_alone_is_refused(tmp_path):
    """A toroid whose second radius is infinite is a cylinder."""
    text = zemax(more="TYPE TOROIDAL").replace("STOP\n  TYPE STANDARD", "STOP")
    with pytest.raises(Refused, match="lens of revolution, but surface 1 has sags from 0 to"):
        refuse_lens(lens_of(tmp_path, text))
    refuse_lens(lens_of(tmp_path, zemax(more="CONI -0.5")))
