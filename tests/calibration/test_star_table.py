"""Star tables of several units and programs, against angles of astropy."""

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import Angle, SkyCoord
from astropy.table import Table

from startrack.calibration.star_table import Names, read_star_table
from startrack.core import Refused

RANDOM = np.random.default_rng(9)
RA, DEC = RANDOM.uniform(2, 14, 40), RANDOM.uniform(-6, 6, 40)
DEC[0] = -0.5  # of which the degree alone has no sign
X, Y = 700 + 4000 * np.tan(np.radians(RA - 8)), 500 + 4000 * np.tan(np.radians(DEC))
PLAIN = {"ra": RA, "dec": DEC, "x": X, "y": Y}
ROWS = np.column_stack([RA, DEC, X, Y]).tolist()
VECTOR = SkyCoord(RA, DEC, unit="deg").cartesian.xyz.value.T


def directions(path, frame, names=None):
    Table(frame).write(path, format="csv")
    return read_star_table(path, names).direction


@pytest.mark.parametrize("name", ["ra_h", "ra_hours", "ra_hourangle"])
def test_right_ascensions_in_hours_have_it_in_their_name(tmp_path, name):
    frame = {name: RA / 15, "dec": DEC, "x": X, "y": Y}
    np.testing.assert_allclose(directions(tmp_path / "a.csv", frame), VECTOR, atol=1e-12)


def test_hours_without_a_unit_are_refused_and_named_by_an_option(tmp_path):
    frame = PLAIN | {"ra": RA / 15}
    with pytest.raises(Refused, match="fit the pixels as hours and not as degrees"):
        directions(tmp_path / "a.csv", frame)
    names = Names(("ra:h", "dec:deg"), "radec")
    np.testing.assert_allclose(directions(tmp_path / "c.csv", frame, names), VECTOR, atol=1e-12)
    # Degrees below 24 are degrees.
    np.testing.assert_allclose(directions(tmp_path / "b.csv", PLAIN), VECTOR, atol=1e-12)


def test_radian_without_a_unit_are_refused_and_named_by_an_option(tmp_path):
    """Forty degrees from the equator, where a step in right ascension is shorter than one in
    declination."""
    stars, middle = SkyCoord(RA, DEC + 40, unit="deg"), SkyCoord(8, 40, unit="deg")
    seen = stars.transform_to(middle.skyoffset_frame())
    x, y = np.tan(seen.lon.rad), np.tan(seen.lat.rad) / np.cos(seen.lon.rad)
    frame = {"ra": stars.ra.rad, "dec": stars.dec.rad, "x": 700 + 4000 * x, "y": 500 + 4000 * y}
    with pytest.raises(Refused, match="fit the pixels as radian and not as degrees"):
        directions(tmp_path / "a.csv", frame)
    names = Names(("ra:rad", "dec:rad"), "radec")
    wanted = stars.cartesian.xyz.value.T
    np.testing.assert_allclose(directions(tmp_path / "b.csv", frame, names), wanted, atol=1e-12)
    frame |= {"ra": stars.ra.deg, "dec": stars.dec.deg}
    np.testing.assert_allclose(directions(tmp_path / "c.csv", frame), wanted, atol=1e-12)


@pytest.mark.parametrize("separator", [":", " ", "fromunit"])
def test_minutes_and_seconds_are_those_of_astropy(tmp_path, separator):
    frame = PLAIN | {
        "ra": Angle(RA, "deg").to_string(unit="hourangle", sep=separator, precision=7),
        "dec": Angle(DEC, "deg").to_string(sep=separator, precision=6, alwayssign=True),
    }
    assert any(text.startswith("-0") for text in frame["dec"])
    np.testing.assert_allclose(directions(tmp_path / "a.csv", frame), VECTOR, atol=1e-11)


def test_a_name_in_degree_makes_degrees_of_minutes_and_seconds(tmp_path):
    texts = {
        "ra_deg": Angle(RA, "deg").to_string(sep=":", precision=6),
        "dec_deg": Angle(DEC, "deg").to_string(sep=":", precision=6),
    }
    frame = texts | {"x": X, "y": Y}
    np.testing.assert_allclose(directions(tmp_path / "a.csv", frame), VECTOR, atol=1e-11)


@pytest.mark.parametrize(
    ("text", "words"),
    [("12:61:00", "minutes and seconds below 60"), ("12d10m00s", "one unit in all rows")],
)
def test_angles_that_are_none_are_refused(tmp_path, text, words):
    texts = Angle(RA, "deg").to_string(unit="hourangle", sep="hms", precision=5)
    frame = PLAIN | {"ra": [text, *texts[1:]]}
    with pytest.raises(Refused, match=words):
        directions(tmp_path / "a.csv", frame)


def test_declinations_are_not_in_hours(tmp_path):
    frame = {"ra": RA, "dec_h": DEC, "x": X, "y": Y}
    with pytest.raises(Refused, match="only right ascensions are in hours"):
        directions(tmp_path / "a.csv", frame)


@pytest.mark.parametrize("end", ["ecsv", "vot", "fits"])
@pytest.mark.parametrize("unit", ["deg", "rad", "hourangle"])
def test_units_of_tables_count(tmp_path, end, unit):
    if (end, unit) == ("fits", "hourangle"):
        pytest.skip("the standard has no such unit")
    table = Table({"ra": (RA * units.deg).to(unit), "dec": DEC * units.deg, "x": X, "y": Y})
    path = tmp_path / f"a.{end}"
    table.write(path, **({"format": "votable"} if end == "vot" else {}))
    np.testing.assert_allclose(read_star_table(path).direction, VECTOR, atol=1e-12)


def test_a_spreadsheet_of_europe_is_read(tmp_path):
    path = tmp_path / "a.csv"
    rows = ["ra;dec;x;y", *(f"{a!r};{b!r};{c!r};{d!r}" for a, b, c, d in ROWS)]
    path.write_text("\r\n".join(rows).replace(".", ","), encoding="utf-8-sig")
    np.testing.assert_allclose(read_star_table(path).direction, VECTOR, atol=1e-12)


def test_columns_that_might_have_been_meant_are_named(tmp_path):
    frame = PLAIN | {"column": X + 5, "row": Y + 5, "sigma": 1 + 0 * X, "weight": 1 + 0 * X}
    path = tmp_path / "a.csv"
    Table(frame).write(path, format="csv")
    table = read_star_table(path)
    assert table.columns["column"] == "column"
    assert table.unused == ("x", "y", "sigma")
    assert read_star_table(path, Names(pixels=("x", "y"), weight="sigma")).unused == ()
