"""Mass, volume and price of lenses: beside lenses that are sold, and in a design."""

from __future__ import annotations

import dataclasses
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from startrack.design import Requirements, lens_cost, load_design
from startrack.io import shipped
from startrack.optics import Optics, Surfaces, load_surfaces, save_lens, save_surfaces
from tests.optics.lenses import ideal

ROOT = Path(__file__).parents[2]
FAMILY = Optics(0.035, 2.0, lens_family="double-gauss")


@pytest.fixture(scope="module")
def study():
    sys.path.insert(0, str(ROOT / "experiments"))
    try:
        return runpy.run_path(str(ROOT / "experiments/lens_costs.py"))
    finally:
        sys.path.pop(0)


def test_real_lenses_are_near_the_model(study):
    """Nine that are sold; metal barrels weigh more than plastic ones."""
    rows = study["rows"]()
    assert len(rows) == 9
    for row in rows:
        assert 0.5 < row["mass_ratio"] < 1.8, row
        assert abs(row["elements"] - row["elements_predicted"]) < 2.8, row
        if row["volume_ratio"]:
            assert 0.5 < row["volume_ratio"] < 1.5, row
        if row["price_ratio"]:
            assert 0.5 < row["price_ratio"] < 3.2, row


def test_the_page_has_the_figures_of_the_model(study):
    assert (ROOT / "docs/lens-costs.md").read_text("utf-8") == study["page"](study["rows"]())


def test_glass_of_a_ball_and_of_a_plate_has_its_volume():
    """Closed forms: a plane plate, and two caps that make most of a sphere."""
    one = np.ones(2)
    plate = Surfaces(
        0 * one, np.array([0.01, 0.1]), np.array([1.5168, 1.0]), 0.02 * one, 0 * one, 0
    )
    assert plate.glass_mass() == pytest.approx(2510 * np.pi * 0.02**2 * 0.01)
    radius = 0.03
    lens = Surfaces(
        np.array([1 / radius, -1 / radius]), np.array([2 * radius, 0.1]), np.array([1.5168, 1.0]),
        0.999 * radius * one, 0 * one, 0,
    )  # fmt: skip
    assert lens.glass_mass() == pytest.approx(2510 * 4 / 3 * np.pi * radius**3, rel=3e-3)


def test_a_lens_counts_by_its_own_mass(tmp_path):
    case = load_design(shipped("designs/nanosatellite.toml")).case
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
