"""Ghosts: against rays of a non-sequential trace, and closed forms."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Light, StrayLightSource
from startrack.design import load_design
from startrack.io import open_checked, shipped
from startrack.optics import Ghosts, Optics, add_ghosts, lens_surfaces
from startrack.optics.ghosts import pairs, reflectances
from startrack.optics.surfaces import Surfaces, load_surfaces
from startrack.trial.spot_plan import require_fidelity

OPTICS = Optics(0.035, 2.8, lens_family="double-gauss")
PITCH = 11e-6
CAMERA = Camera(1200, 1200, 0.035 / PITCH)
HERE = Rotation.identity()


def direction(angle, azimuth):
    angle = np.radians(angle)
    return np.array(
        [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]
    )


def light(*directions, brightness=1.0):
    many = len(directions)
    at = np.array(directions).reshape(many, 3)
    return Light(at, np.array([600e-9]), np.full((many, 1), brightness), np.zeros(1))


@pytest.fixture(scope="module")
def rays():
    folder = str(Path(__file__).parents[2] / "experiments")
    sys.path.insert(0, folder)
    try:
        import ghost_rays
    finally:
        sys.path.remove(folder)
    return ghost_rays


@pytest.mark.parametrize(
    ("pair", "angle"), [((9, 1), 3.0), ((8, 4), 3.0), ((6, 0), 4.0), ((9, 1), 5.0)]
)
def test_place_and_irradiance_are_those_of_a_non_sequential_trace(rays, pair, angle, monkeypatch):
    """One ghost at a time, from 8100 rays: its centroid, flux, and irradiance in the middle."""
    surfaces, ghosts = lens_surfaces(OPTICS), Ghosts()
    only = np.zeros(len(surfaces) + 1)
    only[list(pair)] = reflectances(surfaces, ghosts)[list(pair)]
    monkeypatch.setattr("startrack.optics.ghosts.reflectances", lambda *rest: only)
    towards = direction(angle, 0.6)
    made = add_ghosts(light(towards), ghosts, OPTICS, HERE, CAMERA, PITCH)
    (one,) = made.diffuse
    rows, columns = one.fraction.shape
    step = (CAMERA.columns - 1) / (columns - 1)
    # Electrons of a pixel for one photon, as `diffuse_electrons` has them.
    per_node = one.fraction * OPTICS.area * CAMERA.focal_length_px**-2 * step**2 / PITCH**2
    lens = rays.lens_of(surfaces)
    at, ray, cell = rays.source(lens, towards, 90)
    x, y, weight = rays.ghosts(lens, at, ray, only)[pair]
    down, across = np.indices((rows, columns)) * step
    place = np.array([(per_node * across).sum(), (per_node * down).sum()]) / per_node.sum()
    wanted = np.array([x.mean(), y.mean()]) / PITCH + CAMERA.centre
    assert np.abs(place - wanted).max() < 1
    flux = float(weight.sum() * cell / PITCH**2)
    assert per_node.sum() == pytest.approx(flux, rel=0.02)
    # Irradiance within half of the rms radius about the middle.
    spread = float(np.hypot(x - x.mean(), y - y.mean()).std()) / PITCH * 1.5
    near = np.hypot(across - wanted[0], down - wanted[1]) < spread
    inside = np.hypot(x - x.mean(), y - y.mean()) / PITCH < spread
    assert per_node[near].sum() == pytest.approx(weight[inside].sum() * cell / PITCH**2, rel=0.1)


def test_ghost_of_a_plate_is_that_of_its_matrices():
    """A plane plate before a thin lens: its parallel faces have their ghost at the image."""
    focal = 0.1
    thin = Surfaces(
        np.array([0.0, 0.0, 1 / (0.5 * focal), 0.0]),
        np.array([0.005, 0.02, 1e-9, focal]),
        np.array([1.5, 1.0, 1.5, 1.0]),
        np.full(4, 0.01),
        np.zeros(4),
        2,
    )
    found = {(pair.first, pair.second): pair for pair in pairs(thin, Ghosts(0.04, 0.2))}
    plate = found[(1, 0)]
    assert plate.width == pytest.approx(0, abs=1e-6)
    assert plate.place == pytest.approx(focal, rel=1e-6)
    assert plate.reflectance == pytest.approx(0.0016)
    # The detector's light, back through the lens, is parallel again, and comes back as the image.
    detector = found[(4, 1)]
    assert detector.width == pytest.approx(1, abs=1e-6) or detector.width < 1e-6
    assert detector.reflectance == pytest.approx(0.008)


def test_a_ghost_turns_with_its_source():
    made = [
        add_ghosts(light(direction(3.0, azimuth)), Ghosts(), OPTICS, HERE, CAMERA, PITCH).diffuse
        for azimuth in (0.3, 0.3 + np.pi / 2)
    ]
    for one, other in zip(*made, strict=True):
        turned = np.rot90(one.fraction, -1)
        assert turned.shape == other.fraction.shape
        assert np.abs(turned - other.fraction).max() < 0.05 * other.fraction.max()


def test_bodies_make_ghosts_and_faint_sources_do_not():
    towards = direction(8.0, 0.2)
    body = StrayLightSource(towards[None], np.ones(1), np.array([1e6]))
    lit = dataclasses.replace(light(direction(2, 0)), stray_sources=(body,))
    both = add_ghosts(lit, Ghosts(), OPTICS, HERE, CAMERA, PITCH).diffuse
    star = add_ghosts(light(direction(2, 0)), Ghosts(), OPTICS, HERE, CAMERA, PITCH).diffuse
    assert {float(one.spectrum[0]) for one in both} == {1.0, 1e6}
    assert {float(one.spectrum[0]) for one in star} == {1.0}
    two = light(direction(2, 0), direction(1, 1))
    assert len(add_ghosts(two, Ghosts(sources=1), OPTICS, HERE, CAMERA, PITCH).diffuse) == len(star)
    behind = light(np.array([0.0, 0.0, -1.0]))
    assert add_ghosts(behind, Ghosts(), OPTICS, HERE, CAMERA, PITCH).diffuse == ()


def test_the_file_of_a_lens_holds_its_pairs():
    path = shipped("lenses/double_gauss.fits")
    with open_checked(path, "LENS", 1, "a lens table") as parts:
        rows = np.array(parts["GHOSTS"].data)
    found = pairs(load_surfaces(path), Ghosts(1.0, 1.0))
    assert len(rows) == len(found) == 55
    first = next(pair for pair in found if pair[:2] == (9, 1))
    stored = rows[(rows[:, 0] == 9) & (rows[:, 1] == 1)][0]
    assert stored[2:] == pytest.approx([first.width, first.place])


def test_ghosts_are_refused_where_they_cannot_be_made():
    case = load_design(shipped("designs/noise_only.toml")).case
    instrument = case.instrument
    with pytest.raises(ValueError, match="ghosts must be left out if no lens table has SURFACES"):
        dataclasses.replace(instrument, ghosts=Ghosts())
    with pytest.raises(ValueError, match="ghosts must be left out if the lens has a mirror"):
        lens_surfaces(Optics(0.4, 4.0, lens_family="catadioptric"))
    with pytest.raises(ValueError, match="coating must lie in"):
        Ghosts(coating=1.5)
    optics = dataclasses.replace(instrument.optics, psf="auto", lens_family="double-gauss")
    ghostly = dataclasses.replace(instrument, optics=optics, ghosts=Ghosts())
    for fidelity in ("window", "covariance"):
        with pytest.raises(ValueError, match="ghosts"):
            require_fidelity(dataclasses.replace(case, instrument=ghostly), fidelity)
