"""Laws of a design as priors of a sampling, against distributions of scipy."""

import math

import numpy as np
import pytest
from scipy import stats

from startrack import load_design
from startrack.design import DesignSpace, Unknown, Variable
from startrack.optimise import TrackerSource, sample
from startrack.optimise.evaluate import Evaluation, Foresight
from startrack.optimise.priors import LawPrior, priors_of
from startrack.optimise.tables import tolerance_table

NOISE, GAIN = "instrument.detector.read_noise", "instrument.optics.transmission.factor"
DESIGN = """
base = "designs/noise_only.toml"
[instrument.detector]
read_noise = { median = "8 electron", factor = 1.5 }
[instrument.optics.transmission]
factor = { median = 0.85, factor = 1.2 }
[tracker.detection]
max_spots = { among = [8, 16] }
[campaign]
span = 0.25
margin = 0.2
[[campaign.variables]]
name = "instrument.optics.f_number"
low = 1.2
high = 3.6
"""


@pytest.fixture
def design(tmp_path):
    path = tmp_path / "design.toml"
    path.write_text(DESIGN)
    return load_design(path)


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_densities_are_those_of_the_laws(scale):
    """On a logarithmic scale, the density is that of the logarithm of the value."""
    value = np.geomspace(2.0, 30.0, 200)
    jacobian = value if scale == "log" else 1.0
    variable = Variable(NOISE, 1.0, 40.0, scale)
    factor = LawPrior(variable, Unknown(NOISE, {"median": 8.0, "factor": 1.5}), 8.0, 1.5)
    expected = np.log(stats.lognorm(math.log(1.5), scale=8.0).pdf(value) * jacobian)
    assert np.ptp(factor.log_density(value) - expected) < 1e-9
    between = LawPrior(variable, Unknown(NOISE, {"low": 4.0, "high": 10.0}), 4.0, 10.0)
    with np.errstate(divide="ignore"):
        expected = np.log(stats.uniform(4.0, 6.0).pdf(value) * jacobian)
    found = between.log_density(value)
    assert (np.isfinite(found) == np.isfinite(expected)).all()
    inside = np.isfinite(expected)
    assert np.ptp(found[inside] - expected[inside]) < 1e-9


def test_numbers_that_are_not_known_are_variables(design):
    priors = {prior.variable.name: prior for prior in priors_of(design, design.campaign)}
    assert set(priors) == {NOISE, GAIN}, "a choice stays at its likeliest value"
    space = DesignSpace(design.case, tuple(prior.variable for prior in priors.values()))
    low, high = space.values([0.0, 0.0]), space.values([1.0, 1.0])
    assert low[NOISE] == pytest.approx(8 / 1.5**3)
    assert high[NOISE] == pytest.approx(8 * 1.5**3)
    assert low[GAIN] == pytest.approx(0.85 / 1.2**3)


def test_a_law_ends_where_the_design_refuses_its_values(tmp_path):
    """An f-number must be 0.3 or more: 1.5 sigma below 0.5, for a factor of 1.4."""
    path = tmp_path / "fast.toml"
    path.write_text(DESIGN + "[instrument.optics]\nf_number = { median = 0.5, factor = 1.4 }\n")
    design = load_design(path, ["campaign.variables=[]"])
    fast = next(one for one in priors_of(design, design.campaign) if "f_number" in one.unknown.name)
    assert fast.variable.low == pytest.approx(0.5 * 1.4**-1.5)
    assert fast.variable.high == pytest.approx(0.5 * 1.4**3)


class Known(TrackerSource):
    """Errors that are the root of the read noise, for any other values of the design."""

    def foresee_any(self, points, weighted=False, progress=None):
        return [Foresight(math.log(self.values(point)[NOISE]) / 2, {}) for point in points]

    def evaluate(self, point, known):
        values = dict(self.values(point))
        error = math.exp(known.expected)
        return Evaluation(tuple(point), values, error, error, 0.0, {}, None, "", tried=100)


def test_a_limit_cuts_the_law_of_what_the_error_depends_on(design):
    """A normal law of the logarithm, cut off where the error is 1.2 times that of the middle.

    Chains end with at least 400 independent samples: 0.2 of a deviation are four standard errors of
    a mean, 15 % of a deviation four of its own.
    """
    campaign = design.campaign
    priors = priors_of(design, campaign)
    variables = (*campaign.variables, *(prior.variable for prior in priors))
    space = DesignSpace(design.case, variables)
    found = sample(Known(space, campaign, own_seed=2, priors=priors))
    assert found.chains.converged, found.chains.reason_unconverged
    values = [space.values(point) for point in found.samples[::7]]
    score = np.log([value[NOISE] / 8 for value in values]) / math.log(1.5)
    cut = stats.truncnorm(-3, 2 * math.log(1.2) / math.log(1.5))
    assert score.mean() == pytest.approx(cut.mean(), abs=0.2 * cut.std())
    assert score.std() == pytest.approx(cut.std(), rel=0.15)
    assert score.max() < cut.support()[1] + 0.1
    # The error says nothing of the light, which keeps its law, cut by what a lens passes.
    low, high = (math.log(space.values([u] * 3)[GAIN] / 0.85) / math.log(1.2) for u in (0, 1))
    kept = stats.truncnorm(low, high)
    score = np.log([value[GAIN] / 0.85 for value in values]) / math.log(1.2)
    assert score.mean() == pytest.approx(kept.mean(), abs=0.2 * kept.std())
    assert score.std() == pytest.approx(kept.std(), rel=0.15)
    # The f-number of the design is varied within a quarter of its range on either side.
    f_number = np.array([value["instrument.optics.f_number"] for value in values])
    assert np.ptp(f_number) == pytest.approx(1.2, rel=0.05)
    text = tolerance_table(found)
    assert text.startswith("Of the designs that keep the objective below ")
    assert "read_noise, 8 electron, 68 % within a factor of 1.5" in text
