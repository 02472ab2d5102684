"""Results in the tables of other packages, with their units; texts of results for people."""

import builtins

import numpy as np
import pytest
from astropy import units

from startrack import Fidelity, load_design, run_trials, shipped
from startrack.budget import analytic
from startrack.core import Frame, arcsec, html_table
from startrack.io import to_pandas, to_qtable, to_xarray
from startrack.metrics import summarise

DESIGN = load_design(shipped("designs/noise_only.toml"))


@pytest.fixture(scope="module")
def trials():
    return run_trials(DESIGN.case, 1, range(8), Fidelity.COVARIANCE)


def test_trials_keep_values_and_units(trials):
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    frame, dataset, table = to_pandas(trials), to_xarray(trials, "trial"), to_qtable(trials)
    for name in trials.dtype.names:
        np.testing.assert_array_equal(frame[name], trials[name])
        np.testing.assert_array_equal(dataset[name], trials[name])
        np.testing.assert_array_equal(getattr(table[name], "value", table[name]), trials[name])
    assert frame.attrs["units"]["error_z"] == dataset.error_z.attrs["units"] == "rad"
    assert table["sigma_x"].unit == units.rad
    assert "nees" not in frame.attrs["units"]


def test_a_budget_and_a_summary_are_tables(trials):
    budget, summary = analytic(DESIGN.case), summarise(trials)
    rows = to_qtable(budget)
    assert rows["cause"].tolist() == [line.name for line in budget.lines] + [budget.whole.name]
    assert rows["across"][-1].to_value("arcsec") == pytest.approx(budget.across / arcsec)
    one = to_qtable(summary)
    assert len(one) == 1
    assert one["across_low"][0] < one["across"][0] < one["across_high"][0]
    assert one["trials"][0] == 8


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_a_missing_package_is_named(trials, package, monkeypatch):
    def absent(name, *arguments, **named):
        if name == package:
            raise ImportError(name)
        return builtins.__import__(name, *arguments, **named)

    monkeypatch.setattr("importlib.import_module", absent)
    function = {"pandas": to_pandas, "xarray": to_xarray}[package]
    with pytest.raises(ImportError, match=f"needs {package}: python -m pip install {package}"):
        function(trials)


def test_what_is_no_table_is_refused():
    with pytest.raises(TypeError, match="must be a structured array"):
        to_qtable([1, 2])


def test_texts_are_short_and_have_units(trials):
    budget = analytic(DESIGN.case)
    frame = Frame(np.zeros((40, 60), np.uint16), 0.1, 2.5)
    for value, part in (
        (DESIGN, "lens: 35 mm f/2.4"),
        (budget, f"across: {budget.across / arcsec:.3g} arcsec"),
        (summarise(trials), "trials: 8"),
        (frame, "Frame(size: 60 x 40 pixels, type: uint16, values: 0 to 0 DN, exposure: 100 ms"),
    ):
        assert part in repr(value)
        assert len(repr(value)) < 300
        assert value._repr_html_().startswith("<table>")
    assert "<b>" not in html_table("<b>", [("<b>", "1 & 2")])
