"""Families of lenses: their tables against the ray tracer, and the costs of a faster or wider
lens."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from startrack.optics import Optics, element_count, open_lens, open_optics
from startrack.optics.lens_family import FAMILIES, family_surfaces, family_table, scaled_table
from startrack.optics.lens_psf import Lens
from startrack.optics.pupil import zernike

ORACLE = json.loads((Path(__file__).parents[1] / "oracle/lens_family.json").read_text())
WAVELENGTH = np.array([ORACLE["wavelength_um"] * 1e-6])
TRACED = [(family, row) for family in FAMILIES for row in ORACLE[FAMILIES[family].lens]]


def waves(table, f_number, angle_deg):
    """Rms over the open pupil after subtraction of the best piston, tilt and defocus."""
    lens = Lens(Optics(table.focal_length, f_number), table, 293.15)
    found = lens.at(WAVELENGTH, np.radians([angle_deg]))
    stop, half_p, half_q, centre, open_p, open_q = found.pupil[0, 0]
    radius, turn = np.meshgrid(np.sqrt((np.arange(24) + 0.5) / 24), np.arange(48) * np.pi / 24)
    p = centre + open_p * (radius * np.cos(turn)).ravel()
    q = open_q * (radius * np.sin(turn)).ravel()
    u, v = (stop - p) / half_p, -q / half_q
    path = sum(
        size * zernike(j, u, v)
        for j, size in zip(table.noll.tolist(), found.wavefront[0, 0], strict=True)
    )
    terms = np.column_stack([np.ones_like(u), u, v, u * u + v * v])
    rest = path - terms @ np.linalg.lstsq(terms, path, rcond=None)[0]
    return float(rest.std() / WAVELENGTH[0])


def stopped(table, slower):
    """The same lens as a table of a smaller stop, with terms over this stop."""
    turn = np.arange(96) * np.pi / 48
    radius, turn = np.meshgrid(np.sqrt((np.arange(48) + 0.5) / 48), turn)
    u, v = (radius * np.cos(turn)).ravel(), (radius * np.sin(turn)).ravel()
    names = table.noll.tolist()
    small = np.column_stack([np.ones_like(u), *(zernike(j, u, v) for j in names)])
    large = np.column_stack([zernike(j, u / slower, v / slower) for j in names])
    change = np.linalg.lstsq(small, large, rcond=None)[0][1:]
    pupil = table.pupil.copy()
    pupil[..., 1:3] /= slower
    pupil[..., 3:] = pupil[..., :3]
    return replace(
        table, f_number=table.f_number * slower, wavefront=table.wavefront @ change.T, pupil=pupil
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_a_slower_lens_has_the_wavefront_of_the_stopped_down_prescription(family):
    """By optiland; the f-number is the paraxial one, the stop's edge lies at real heights."""
    lens = FAMILIES[family].lens
    for row in ORACLE[lens]:
        f_number = open_lens(lens).f_number * row["slower"]
        found = waves(family_table(family, f_number), f_number, row["angle_deg"])
        assert found == pytest.approx(row["rms_waves"], rel=0.1, abs=0.001), row


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("slower", "low", "high"), [(1.2, 0.4, 2.1), (1.4, 0.35, 2.9)])
def test_error_of_the_law_for_a_faster_lens(family, slower, low, high):
    """From the prescription stopped down to its full aperture, by optiland.

    Aberrations of a real lens balance each other at its design speed.
    """
    table = open_lens(FAMILIES[family].lens)
    made = scaled_table(stopped(table, slower), slower, 1.0)
    rows = [row for row in ORACLE[FAMILIES[family].lens] if row["slower"] == 1.0]
    for row in rows:
        ratio = waves(made, table.f_number, row["angle_deg"]) / row["rms_waves"]
        assert low < ratio < high, (row, ratio)


def within_field(table, part):
    """The table, cut off at a fraction of its field."""
    count = int((table.field < (part + 0.01) * table.field[-1]).sum())
    names = ("wavefront", "place", "pupil", "outline", "area", "amplitude", "curvature")
    cut = {name: getattr(table, name)[:, :, :count] for name in names}
    return replace(table, field=table.field[:count], **cut)


@pytest.mark.parametrize(
    ("family", "low", "high"),
    [
        ("double-gauss", 1.0, 1.2),
        ("petzval", 0.8, 1.0),
        ("cooke-triplet", 1.0, 1.3),
        ("catadioptric", 0.9, 1.1),
    ],
)
def test_error_of_the_law_for_a_wider_field(family, low, high):
    """From three quarters of the field to the traced values at the last angle of the oracle."""
    table = open_lens(FAMILIES[family].lens)
    inner = within_field(table, 0.75)
    made = scaled_table(inner, 1.0, float(np.tan(table.field[-1]) / np.tan(inner.field[-1])))
    row = [each for each in ORACLE[FAMILIES[family].lens] if each["slower"] == 1.4][-1]
    f_number = table.f_number * 1.4
    ratio = waves(made, f_number, row["angle_deg"]) / row["rms_waves"]
    assert low < ratio < high
    place = made.at(293.15, WAVELENGTH, np.radians([row["angle_deg"]])).place[0, 0]
    traced = table.at(293.15, WAVELENGTH, np.radians([row["angle_deg"]])).place[0, 0]
    assert place == pytest.approx(traced, rel=1e-4)


def test_the_law_is_that_of_seidel():
    """Closed forms: spherical aberration s^4, coma s^3 q, astigmatism s^2 q^2; chief ray fixed."""
    table = open_lens("double_gauss")
    made = scaled_table(table, 1.5, 1.2)
    at = {j: table.noll.tolist().index(j) for j in (4, 6, 8, 11)}
    edge = (0, 2, -1)
    for noll, factor in ((8, 1.5**3 * 1.2), (6, 1.5**2 * 1.2**2)):
        old, new = table.wavefront[edge][at[noll]], made.wavefront[edge][at[noll]]
        assert new == pytest.approx(factor * old, rel=1e-4)
    axis = (0, 2, 0)
    assert made.wavefront[axis][at[11]] == pytest.approx(1.5**4 * table.wavefront[axis][at[11]])
    assert made.area == pytest.approx(1.5**2 * table.area)
    assert made.f_number == pytest.approx(table.f_number / 1.5)

    def slope(one, where):
        step = 1e-5
        return sum(
            size
            * float(
                zernike(j, np.array([step]), np.zeros(1))[0]
                - zernike(j, np.array([-step]), np.zeros(1))[0]
            )
            / (2 * step)
            for j, size in zip(one.noll.tolist(), one.wavefront[where], strict=True)
        )

    assert slope(made, edge) == pytest.approx(1.5 * slope(table, edge), abs=1e-10)


def test_a_faster_or_wider_lens_pays():
    """In wavefront, elements and mass; the law continues for all f-numbers."""
    fast = [1.2, 1.4, 2.0, 2.8]
    error = [waves(family_table("double-gauss", n), n, 4.0) for n in fast]
    mass = [family_surfaces("double-gauss", 0.035, n).glass_mass() for n in fast]
    count = [element_count("double-gauss", n) for n in fast]
    assert error == sorted(error, reverse=True)
    assert mass == sorted(mass, reverse=True)
    assert count[:3] == sorted(count[:3], reverse=True)
    wide = family_surfaces("double-gauss", 0.035, 2.0, np.radians(16)).glass_mass()
    assert wide > 1.05 * mass[2]
    assert element_count("double-gauss", 2.0) == 6


def test_what_a_family_does_not_hold_is_refused():
    with pytest.raises(ValueError, match="lens_family must be one of double-gauss, petzval"):
        family_table("fisheye", 2.0)
    with pytest.raises(ValueError, match=r"f_number must be at least 1\.2 in the lens_family"):
        family_table("double-gauss", 1.1)
    with pytest.raises(ValueError, match="family_field must lie in"):
        family_table("double-gauss", 2.0, np.radians(30))
    with pytest.raises(ValueError, match="lens_family must be left out if lens_file"):
        Optics(0.05, 2.0, lens_file="petzval", lens_family="petzval")
    with pytest.raises(ValueError, match="psf must be left out if lens_family"):
        Optics(0.05, 2.0, psf="airy", lens_family="petzval")


def test_as_built_blurs_by_the_slope_of_its_aberrations():
    """Rays through Zernike polynomials: their rms distance from the centroid, per axis."""
    rms, f_number = 100e-9, 2.0
    grid = np.linspace(-1, 1, 801)
    x, y = np.meshgrid(grid, grid)
    inside = np.hypot(x, y) < 0.999
    x, y = x[inside], y[inside]
    part, step = rms / np.sqrt(3), 1e-5

    def path(u, v):
        return part * (zernike(6, u, v) + zernike(8, u, v) + zernike(11, u, v))

    across = (path(x + step, y) - path(x - step, y)) / (2 * step) * 2 * f_number
    down = (path(x, y + step) - path(x, y - step)) / (2 * step) * 2 * f_number
    wanted = np.sqrt((across.var() + down.var()) / 2)
    found = Optics(0.05, f_number, as_built=rms).total_blur
    assert found == pytest.approx(wanted, rel=0.02)


def test_a_family_is_an_ordinary_lens_table():
    optics = Optics(0.035, 1.6, lens_family="double-gauss")
    lens = open_optics(optics)
    assert lens.table.f_number == pytest.approx(1.6)
    same = open_optics(replace(optics, f_number=2.4)).table
    fast = open_lens("double_gauss")
    for part in fields(fast):
        np.testing.assert_array_equal(getattr(same, part.name), getattr(fast, part.name))
