"""Mass, volume and price: lenses on the market, built trackers, and designs."""

from __future__ import annotations

import dataclasses
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from startrack.design import Requirements, load_design
from startrack.design.requirements import lens_cost
from startrack.io import shipped
from startrack.optics import Optics, Surfaces, save_lens, save_surfaces
from startrack.optics.surfaces import load_surfaces
from tests.optics.lenses import ideal

ROOT = Path(__file__).parents[2]
FAMILY = Optics(0.035, 2.0, lens_family="double-gauss")


def experiment(name):
    sys.path.insert(0, str(ROOT / "experiments"))
    try:
        return runpy.run_path(str(ROOT / f"experiments/{name}.py"))
    finally:
        sys.path.pop(0)


@pytest.fixture(scope="module")
def study():
    return experiment("lens_costs")


def test_real_lenses_are_near_the_model(study):
    """Nine lenses on the market; metal barrels weigh more than plastic ones."""
    rows = study["rows"]()
    assert len(rows) == 9
    for row in rows:
        assert 0.5 < row["mass_ratio"] < 1.8, row
        assert abs(row["elements"] - row["elements_predicted"]) < 2.8, row
        if row["volume_ratio"]:
            assert 0.5 < row["volume_ratio"] < 1.5, row
        if row["price_ratio"]:
            assert 0.5 < row["price_ratio"] < 3.2, row


def source_of(page):
    """The command and the commit that a page states."""
    return re.search(r"`python experiments/[^`]*` at \*[0-9a-f]+\*", page)[0]


def test_the_page_has_the_figures_of_the_model(study):
    written = (ROOT / "docs/figures/lens-costs.md").read_text("utf-8")
    assert written == study["page"](study["rows"](), source_of(written))


def test_glass_of_a_ball_and_of_a_plate_has_its_volume():
    """Closed forms: a plane plate, and two caps that make most of a sphere."""
    one = np.ones(2)
    plate = Surfaces(
        0 * one, np.array([0.01, 0.1]), np.array([1.5168, 1.0]), 0.02 * one, 0 * one, 0
    )
    assert plate.glass_mass() == pytest.approx(2510 * np.pi * 0.02**2 * 0.01)
    radius = 0.03
    lens = Surfaces(
        np.array([1 / radius, -1 / radius]),
        np.array([2 * radius, 0.1]),
        np.array([1.5168, 1.0]),
        0.999 * radius * one,
        0 * one,
        0,
    )
    assert lens.glass_mass() == pytest.approx(2510 * 4 / 3 * np.pi * radius**3, rel=3e-3)


def test_a_lens_counts_by_its_own_mass(tmp_path):
    case = load_design(shipped("designs/noise_only.toml")).case
    needs = Requirements()
    plain = needs.mass(case)
    assert plain == needs.mass_fixed + needs.mass_per_volume * case.instrument.optics.aperture**3

    def with_lens(optics):
        instrument = dataclasses.replace(case.instrument, optics=optics)
        return dataclasses.replace(case, instrument=instrument)

    family = with_lens(FAMILY)
    found = lens_cost(FAMILY)
    assert needs.mass(family) == needs.mass_fixed + found.mass
    assert needs.volume(family) == needs.volume_fixed + found.volume
    assert needs.cost(family) == needs.cost_fixed + found.price
    # Of the same prescription in the same size.
    table = lens_cost(dataclasses.replace(FAMILY, lens_family="", lens_file="double_gauss"))
    assert table == pytest.approx(found)
    # A table without surfaces leaves the terms of the aperture.
    path = tmp_path / "lens.fits"
    save_lens(path, ideal())
    measured = Optics(0.05, 4.0, lens_file=str(path))
    assert lens_cost(measured) is None
    assert needs.mass(with_lens(measured)) > needs.mass_fixed
    save_surfaces(path, load_surfaces(shipped("lenses/triplet.fits")))
    assert lens_cost(measured).elements == 3


def test_a_lens_of_twice_the_size_weighs_eight_times_as_much():
    twice = lens_cost(dataclasses.replace(FAMILY, focal_length=0.07))
    assert twice.mass == pytest.approx(8 * lens_cost(FAMILY).mass)
    assert twice.volume == pytest.approx(8 * lens_cost(FAMILY).volume)


def test_built_trackers_have_the_spread_that_the_page_says():
    """Power of eleven, density of seven, and read noise of CCDs over three decades of rate."""
    study = experiment("tracker_costs")
    found = study["figures"]()
    written = (ROOT / "docs/figures/tracker-costs.md").read_text("utf-8")
    assert written == study["page"](found, source_of(written))
    assert found["counts"]["power_ratio"] >= 10
    assert 0.5 < found["spread"]["power_ratio"][0] < 2
    assert found["spread"]["density"][0] == pytest.approx(950, rel=0.05)
    _, low, high = found["spread"]["noise"]
    assert low > 0.5
    assert high < 2


def test_a_baffle_is_a_cone_that_keeps_the_sun_from_the_lens():
    """The lowest ray that passes the front edge reaches the far edge of the lens."""
    case = load_design(shipped("designs/noise_only.toml")).case
    bare, angle = Requirements(), np.radians(40.0)
    baffled = dataclasses.replace(bare, baffle_angle=angle)
    volume = baffled.volume(case) - bare.volume(case)
    lens, field = case.instrument.optics.aperture, case.instrument.camera.half_diagonal
    # The length at which a ray at the angle from the front's edge falls to the lens's far edge.
    length = np.linspace(1e-4, 0.5, 500001)
    front = lens + 2 * length * np.tan(field)
    found = length[np.argmax(length * np.tan(angle) >= (front + lens) / 2)]
    step = np.linspace(0, found, 20001)
    width = lens + 2 * step * np.tan(field)
    assert volume == pytest.approx(np.trapezoid(np.pi / 4 * width**2, step), rel=1e-3)
    # None keeps out a Sun in the field.
    assert dataclasses.replace(bare, baffle_angle=field).volume(case) > 100 * baffled.volume(case)


def test_a_density_weighs_the_volume_and_a_shield_its_surface():
    case = load_design(shipped("designs/noise_only.toml")).case
    needs = Requirements(density=950.0)
    assert needs.mass(case) == pytest.approx(950 * needs.volume(case))
    # A litre in a cube has 0.06 m2: 2 mm of aluminium weigh 0.324 kg.
    litre = Requirements(density=1.0, volume_fixed=1e-3, length_ratio=1e-9)
    shielded = dataclasses.replace(litre, shielding=2e-3)
    assert shielded.mass(case) - litre.mass(case) == pytest.approx(0.324, rel=1e-5)
    with pytest.raises(ValueError, match="density"):
        Requirements(density=0.0)
