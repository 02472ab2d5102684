"""Guide stars of a design, and the C code with which flight software reads them."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack import load_design, shipped
from startrack.catalog import open_sky
from startrack.cli.main import main
from startrack.core import arcsec
from startrack.onboard import (
    DOUBLE,
    VARIABLE,
    CompiledGuide,
    GuideSettings,
    guide_stars,
    read_guide,
    read_variables,
    write_guide,
)
from startrack.onboard.compiled import c_compiler
from startrack.onboard.layout import HEADER, STAR

CASE = load_design(shipped("designs/noise_only.toml")).case
SETTINGS = GuideSettings(limit=5.5, resolution=60 * arcsec)
SIGMA = 5 * arcsec
needs_c = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")


@pytest.fixture(scope="module")
def guide():
    return guide_stars(CASE, SETTINGS)


@pytest.fixture(scope="module")
def reader(guide):
    return CompiledGuide(bytes(guide))


def attitudes(count, seed):
    return Rotation.random(count, random_state=np.random.default_rng(seed))


def near(guide, name):
    """The guide star at the place of a known star of the sky (degree, J2000)."""
    ra, dec = np.radians(name)
    place = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    star = guide.nearest(place)
    return star if np.linalg.norm(guide.direction[star] - place) < 60 * arcsec else None


def same(guide, reader, attitude, generator):
    """Whether C and Python find the same nearest star, cone and patterns of a noisy triangle."""
    axis = attitude.as_matrix()[2]
    inside = guide.cone(axis, guide.field_of_view / 2)
    agree = guide.nearest(axis) == reader.nearest(axis)
    agree &= np.array_equal(inside, reader.cone(axis, guide.field_of_view / 2))
    if len(inside) >= 3:
        three = guide.direction[inside[generator.permutation(len(inside))[:3]]]
        seen = attitude.apply(three + generator.normal(0, SIGMA, (3, 3)))
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        agree &= guide.patterns(seen, 0.005) == reader.patterns(seen, 0.005)
    return bool(agree)


@needs_c
@pytest.mark.parametrize("skies", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_c_finds_what_python_finds(guide, reader, skies):
    generator = np.random.default_rng(5)
    assert all(same(guide, reader, one, generator) for one in attitudes(skies, 4))
    for star in (0, len(guide) // 2, len(guide) - 1):
        direction, magnitude, flags = reader.star(star)
        np.testing.assert_array_equal(direction, guide.direction[star])
        assert (magnitude, flags) == (pytest.approx(guide.magnitude[star]), guide.flags[star])


@needs_c
def test_c_identifies_the_stars_of_a_camera(guide, reader):
    """Noisy directions in a square field, three false ones among them, at 100 attitudes.

    Every accepted star is the right one; nine in ten skies of 5 or more stars are identified.
    """
    generator, half = np.random.default_rng(7), np.tan(guide.field_of_view / 2)
    solved, tried = 0, 0
    for attitude in attitudes(100, 6):
        seen = attitude.apply(guide.direction)
        x, y = (seen[:, :2] / seen[:, 2:]).T
        inside = np.flatnonzero((seen[:, 2] > 0) & (np.abs(x) < half) & (np.abs(y) < half))
        names = inside[np.argsort(guide.magnitude[inside])]
        if len(names) < 5:
            continue
        tried += 1
        false = np.column_stack([generator.uniform(-half, half, (3, 2)), np.ones(3)])
        names = np.insert(names, [0, 2, 4], -1)
        rows = np.insert(seen[names[names >= 0]], [0, 2, 4], false, axis=0)
        rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        rows += generator.normal(0, SIGMA, rows.shape)
        star, turn = reader.identify(rows / np.linalg.norm(rows, axis=1, keepdims=True), SIGMA)
        if (star >= 0).any():
            solved += 1
            assert (star[star >= 0] == names[star >= 0]).all()
            assert np.linalg.norm(turn[2] - attitude.as_matrix()[2]) < 3 * SIGMA
    assert solved >= 0.9 * tried
    assert tried > 60


@needs_c
def test_c_identifies_nothing_in_random_directions(reader):
    """At a bound of 1e-5 on false matches, none of 30 random lists is accepted."""
    generator = np.random.default_rng(8)
    for _ in range(30):
        rows = np.column_stack([generator.uniform(-0.07, 0.07, (12, 2)), np.ones(12)])
        star, _ = reader.identify(rows / np.linalg.norm(rows, axis=1, keepdims=True), SIGMA)
        assert (star == -1).all()


def test_a_written_guide_is_read_again(guide, tmp_path):
    files = write_guide(tmp_path, guide)
    back = read_guide(files[0])
    for name in ("direction", "flags", "triangle", "start"):
        np.testing.assert_array_equal(getattr(back, name), getattr(guide, name), err_msg=name)
    np.testing.assert_allclose(back.magnitude, guide.magnitude, atol=1e-9)
    assert (back.cells, back.per_field) == (guide.cells, guide.per_field)
    assert (back.epoch, back.limit) == (pytest.approx(guide.epoch), pytest.approx(guide.limit))
    assert (back.field_of_view, *back.base) == pytest.approx(
        (guide.field_of_view, *guide.base), abs=1e-9
    )
    assert bytes(back) == files[0].read_bytes() == bytes(guide_stars(CASE, SETTINGS))
    numbers = re.search(r"\{(.*)\}", files[1].read_text(), re.DOTALL)[1]
    assert bytes(map(int, numbers.split(","))) == files[0].read_bytes()


@pytest.mark.parametrize("damage", ["cut", "changed", "other"])
def test_a_damaged_guide_is_refused(guide, tmp_path, damage):
    data = bytes(guide)
    data = {"cut": data[:-5], "changed": data[:90] + b"\xff" + data[91:], "other": b"x" * 99}[
        damage
    ]
    path = tmp_path / "startrack_guide.bin"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"startrack_guide\.bin must"):
        read_guide(path)
    if c_compiler():
        with pytest.raises(ValueError, match="must be a file of guide stars"):
            CompiledGuide(data)


def test_doubles_and_variables_are_marked_or_left_out(guide):
    """Mizar has a companion at 14 arcsec (G 3.9); Algol is variable; Vega is neither."""
    mizar, algol, vega = (200.981, 54.925), (47.042, 40.956), (279.235, 38.784)
    assert guide.flags[near(guide, mizar)] & DOUBLE
    assert guide.flags[near(guide, algol)] & VARIABLE
    assert not guide.flags[near(guide, vega)] & (DOUBLE | VARIABLE)
    less = guide_stars(CASE, replace(SETTINGS, doubles="omit", variables="omit", per_field=6))
    assert near(less, mizar) is None
    assert near(less, algol) is None
    assert near(less, vega) is not None
    assert not (less.flags & (DOUBLE | VARIABLE)).any()
    # Thinned: no circle of a field's area around a star has as many brighter ones as are allowed.
    radius = less.field_of_view / np.sqrt(np.pi)
    for star in range(0, len(less), 41):
        around = less.cone(less.direction[star], radius * (1 - 1e-9))
        assert (less.magnitude[around] < less.magnitude[star]).sum() < 6
    assert len(less) < 0.8 * len(guide)


def test_stars_move_to_the_epoch():
    """Groombridge 1830 moves by 7.06 arcsec a year (van Leeuwen 2007); G 6.2."""
    moved = guide_stars(CASE, GuideSettings(limit=6.8, epoch=2046.0, per_field=40))
    star = np.flatnonzero(moved.identifier == 4034171629042489088)
    sky = open_sky(CASE.believed_catalog).stars  # of 2026
    at, found = sky.find(np.array([4034171629042489088]))
    assert found.all()
    apart = np.linalg.norm(moved.direction[star] - sky.direction[at]) / arcsec
    assert apart == pytest.approx(20 * 7.06, rel=0.002)


def test_magnitudes_are_those_of_the_band(guide):
    """Red and blue stars are fainter than in G, whose band is wider at both ends."""
    sky = open_sky(CASE.believed_catalog).stars
    at, found = sky.find(guide.identifier)
    assert found.all()
    single = guide.flags & DOUBLE == 0
    colour = sky.colour[at][single]
    offset = guide.magnitude[single] - sky.magnitude_g[at][single]
    sunlike = np.abs(colour - 0.82) < 0.02
    assert np.abs(offset[sunlike]).max() < 0.02
    assert np.median(offset[colour > 2]) > 0.02
    assert np.median(offset[colour < 0.2]) > 0.02


def test_the_page_has_the_layout_of_the_file():
    text = (Path(__file__).parents[2] / "docs" / "onboard.md").read_text(encoding="utf-8")
    for record, heading in ((HEADER, "## Header"), (STAR, "## Stars")):
        rows = re.findall(
            r"^\| (\d+) \| `(\w+)` \|", text.split(heading)[1].split("\n## ")[0], re.M
        )
        assert [(int(at), name) for at, name in rows] == [
            (record.fields[name][1], name) for name in record.names
        ]


def test_the_command_writes_it(tmp_path, capsys):
    out = tmp_path / "export"
    assert main(["export", "catalogue", "--limit", "4.5", "--out", str(out)]) == 0
    assert "guide stars to 4.5 mag" in capsys.readouterr().out
    assert len(read_guide(out / "startrack_guide.bin")) > 500
    assert {one.name for one in out.iterdir()} == {
        f"startrack_guide{end}" for end in (".bin", "_data.h", ".csv", ".h", ".c")
    }
    for wrong, message in (
        (["--set", "instrument.optics.focal_length=2 m"], "field of view (rad) must lie in"),
        (["--resolution", "1e9"], "resolution (rad) must lie in"),
        (["--limit", "-2"], "guide stars must number 4 to 65535, got 0"),
    ):
        assert main(["export", "catalogue", *wrong, "--out", str(out)]) == 2
        assert message in capsys.readouterr().err
    (tmp_path / "list.csv").write_text("name,dec\nX,5\n")
    arguments = ["--variable-list", str(tmp_path / "list.csv"), "--out", str(out)]
    assert main(["export", "catalogue", *arguments]) == 2
    assert "must have the column ra" in capsys.readouterr().err


def test_the_shipped_list_names_stars_of_the_catalogue():
    """Each place has a star within 5 arcsec at J2000, since it was made with its positions."""
    sky = open_sky(CASE.believed_catalog).stars
    known = read_variables()
    chord = [np.linalg.norm(sky.direction - one.direction, axis=1).min() for one in known]
    assert len(known) == 197
    assert np.median(chord) < 1 * arcsec
    assert max(chord) < 20 * arcsec
