"""Kill -9 of drivers and workers: nothing lost, nothing doubled, the same bytes, no orphans."""

import runpy
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from startrack.design import Fidelity
from startrack.montecarlo import Sampling, Serial, Store, resume, run
from tests.montecarlo.test_faults import done

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's /proc")
EXPERIMENT = Path(__file__).parents[2] / "experiments" / "campaign.py"
sys.path.append(str(EXPERIMENT.parent))
DRIVER = """
import sys
from pathlib import Path
from startrack.montecarlo import Store, resume
from startrack.montecarlo.workers import Lasting

with Store(Path(sys.argv[1])) as store, Lasting(1) as executor:
    resume(store, executor, 1, 10**6)
"""


@pytest.fixture(scope="module")
def experiment():
    return runpy.run_path(str(EXPERIMENT))


def test_a_kill_of_the_driver(experiment, tmp_path, case):
    """In the middle of a campaign, which this process then continues."""
    path = tmp_path / "campaign.sqlite"
    Store(path, case, 2, Sampling(Fidelity.COVARIANCE)).close()
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, path], start_new_session=True)
    while not done(path):
        assert driver.poll() is None
        time.sleep(0.05)
    driver.kill()
    driver.wait()
    assert experiment["_orphans"](driver.pid) == 0
    with Store(path) as store:
        held = store.outcomes()
        trials = int(held["trial"].max()) + 100
        again = resume(store, Serial(), 1, trials)
    assert 0 < len(held) == len(np.unique(held["trial"]))
    np.testing.assert_array_equal(again["trial"], np.arange(trials))
    assert held.tobytes() == again[held["trial"]].tobytes()
    last = run(case, 300, 2, Serial(), trials - 300, fidelity=Fidelity.COVARIANCE)
    assert again[-300:].tobytes() == last.tobytes()


@pytest.mark.slow
def test_fifty_kills(experiment, tmp_path):
    """Drivers and workers are killed at random moments."""
    figures = experiment["kill_and_resume"](tmp_path, 50, seed=3)
    assert figures["kills"] == 50
    assert figures["campaigns"] >= 1
    for name in ("lost", "doubled", "different", "orphans"):
        assert figures[name] == 0, name
