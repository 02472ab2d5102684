import math

import numpy as np
import pytest
from centre_of_gravity import centre_of_gravity_error

from startrack.core.units import arcsec, deg
from startrack.metrics import Star, attitude_bound, centroid_bound


@pytest.fixture(scope="module")
def table(oracle):
    return oracle("error_bounds.json")


def test_centroid_bound_against_a_table_from_outside(table):
    """Fluxes of 300 to 100000 electrons, sigma of 0.4 to 1.5 pixel, dark and bright sky."""
    for row in table["crlb"]:
        star = Star(row["flux_e"], row["sigma_px"], row["bkg_e"], row["read_e"])
        assert centroid_bound(star)[0] == pytest.approx(row["crlb_joint"], rel=1e-3)


def test_smeared_bound_against_a_table_from_outside(table):
    for row in table["smear"]:
        star = Star(row["flux"], row["sigma"], row["bkg"], row["read"], row["L_px"])
        want = (row["crlb_along"], row["crlb_cross"])
        assert centroid_bound(star) == pytest.approx(want, rel=1e-5)


def test_s_curve_against_a_table_from_outside(table):
    for row in table["s_curve"]:
        _, bias = centre_of_gravity_error(Star(1.0, row["sigma_px"]), row["window"])
        assert bias == pytest.approx(row["rms"], rel=5e-3)


@pytest.mark.parametrize("window", [5, 7])
def test_centre_of_gravity_against_a_monte_carlo_from_outside(oracle, window):
    """Its statistical error is 0.35 %; at 1000 electrons the first order is 1 % low."""
    for row in oracle("centroid_bounds.json")["scatter"]:
        star = Star(row["flux_e"], row["sigma_px"], row["bkg_e"], row["read_e"])
        error = math.hypot(*centre_of_gravity_error(star, window))
        assert error == pytest.approx(row[f"cog{window}"], rel=0.013)


def test_the_bound_of_a_bright_well_sampled_star_is_sigma_over_root_n():
    """The classical limit, in which pixels and background do not matter."""
    assert centroid_bound(Star(1e6, 4.0))[0] == pytest.approx(4.0 / 1000, rel=0.01)


def test_attitude_bound_against_random_fields(table):
    """Within the model error that its docstring states, plus 0.5 % for the reference's noise."""
    for row in table["attitude"]:
        field, count = row["fov_deg"] * deg, row["n"]
        got = attitude_bound(field, field, count, row["sigma_star_arcsec"])
        tolerance = {4: 0.045, 5: 0.02, 6: 0.015, 10: 0.01}[count]
        np.testing.assert_allclose(got, row["pred_rms"], rtol=tolerance)


def test_the_error_about_the_long_axis_of_the_field_is_the_larger_one():
    x, y, z = attitude_bound(20 * deg, 10 * deg, 12, 1 * arcsec)
    assert x > y  # stars far out along x have less information about x
    assert z > 5 * x


@pytest.mark.parametrize(
    ("refused", "message"),
    [
        (lambda: Star(0.0, 1.0), "flux must be positive, got 0.0"),
        (lambda: Star(1.0, 1.0, -1.0), "background must not be negative, got -1.0"),
        (lambda: centre_of_gravity_error(Star(1.0, 1.0), 4), "window must be odd"),
        (lambda: attitude_bound(4.0, 0.1, 5, 1e-5), "fov_x must lie in"),
        (lambda: attitude_bound(0.1, 0.1, 2, 1e-5), "stars must be a whole number"),
    ],
)
def test_wrong_input_is_refused(refused, message):
    with pytest.raises(ValueError, match=message):
        refused()
