"""A small tracker, and outcomes without a tracker."""

import numpy as np
import pytest

from startrack.design.files import load_design
from startrack.io import shipped
from startrack.trial.chain import OUTCOMES


@pytest.fixture(scope="session")
def case():
    return load_design(shipped("designs/noise_only.toml")).case


@pytest.fixture
def outcomes():
    """Make solved outcomes with errors of a given sigma."""

    def make(trials, seed=0, first=0, sigma=1e-5):
        rng = np.random.default_rng(seed)
        table = np.zeros(trials, OUTCOMES)
        table["trial"] = np.arange(first, first + trials)
        for name in ("error_x", "error_y", "error_z"):
            table[name] = sigma * rng.standard_normal(trials)
        table["solved"] = True
        return table

    return make
