"""Light of the surrounding ground: against photons in three dimensions and 6S, and removed
again."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from startrack.earth.atmosphere import SPREADS, load_table
from startrack.io import shipped

sys.path.append(str(Path(__file__).parents[3] / "experiments"))
ORACLE = json.loads((Path(__file__).parents[2] / "oracle" / "adjacency.json").read_text())


@pytest.mark.parametrize("column", ORACLE["columns"], ids=["470 nm", "865 nm", "865 nm, 12 km"])
@pytest.mark.parametrize("case", ["coast", "patch"])
@pytest.mark.parametrize(
    "spacing", [15.0, *(pytest.param(cell, marks=pytest.mark.slow) for cell in (12.0, 20.0))]
)
def test_a_coast_and_a_patch_shine_as_photons_say(column, case, spacing):
    """Radiance at the satellite within 1 % for any places of cells; with the mean alone it is
    not."""
    from earth_images import shining

    seen = shining(column, case, spacing)
    assert abs(seen.ours - 1).max() < 0.01
    if column["wavelength"] == 470:
        assert abs(seen.plain - 1).max() > 0.02


def test_molecules_spread_light_as_in_6s():
    """F of 6S, subroutine ENVIRO (Vermote et al., 2006), for molecules and a satellite."""
    table = load_table(shipped("atmosphere/molecules.fits"))
    weights = table.spread[4, 0, -1]  # 460 nm, the sea, space
    radius = np.array([0.1, 0.3, 1.0, 3.0, 10.0])
    ours = -np.expm1(-((radius[:, None] * 1e3) ** 2) / (2 * SPREADS**2)) @ weights
    theirs = 1 - 0.93 * np.exp(-0.08 * radius) - 0.07 * np.exp(-1.1 * radius)
    np.testing.assert_allclose(ours, theirs, atol=0.02)


def test_low_and_hazy_sight_is_lit_from_nearer():
    clear, haze = (load_table(shipped(f"atmosphere/rural-{km}km.fits")) for km in (23, 5))
    near = 3  # Gaussians to 200 m
    assert (clear.spread[6, 0, 0, :near].sum() > clear.spread[6, 0, -1, :near].sum() * 1.2).all()
    assert haze.spread[6, 0, -1, :5].sum() > clear.spread[6, 0, -1, :5].sum()
    for table in (clear, haze):
        for weights in (table.spread, table.returned):
            assert (weights >= 0).all()
            assert (weights.sum(-1) <= 1.005).all()
