"""The places named in CONTRIBUTING suffice for an addition: each is made from here, and removed.

The files of an addition are functions and classes of this module; each further place is a line
here, with the name of its table.
"""

import dataclasses
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack import Fidelity, Refused, Streams, load_design
from startrack.budget.left_out import of_the_case
from startrack.cli.main import COMMANDS, _parser, main
from startrack.cli.options import Option, Options
from startrack.core import NON_NEGATIVE, DiffuseLight, Unit, parameter
from startrack.core.extension import code_of_command
from startrack.design.keys import keys_of
from startrack.detection.methods import CENTROIDS
from startrack.detector import PIXEL_EFFECTS, Detector
from startrack.detector.effects import PixelEffect, PixelStage
from startrack.io import shipped
from startrack.optimise.search import Search, algorithms, minimise
from startrack.scene import LIGHTS
from startrack.scene.parameters import LightKind
from startrack.trial import require_fidelity, run_trials
from startrack.trial.window import whole_frame

CASE = load_design(shipped("designs/noise_only.toml")).case


# A noise source: its key in the class of the detector, and its row in PIXEL_EFFECTS.
class NoisyDetector(Detector):
    """A detector whose amplifier has an additional noise."""

    popcorn_noise: float = parameter(
        "rms of the popcorn noise", unit=Unit("electron"), limit=NON_NEGATIVE, default=0.0
    )


def add_popcorn_noise(signal, detector, streams):
    return signal + detector.popcorn_noise * streams("popcorn").standard_normal(signal.shape)


@pytest.fixture
def noisy(monkeypatch):
    row = PixelEffect(
        "popcorn_noise",
        PixelStage.SIGNAL,
        lambda detector: getattr(detector, "popcorn_noise", 0.0),
        add_popcorn_noise,
        left_out="popcorn noise",
    )
    behind = next(k for k, effect in enumerate(PIXEL_EFFECTS) if effect.key == "pattern")
    PIXEL_EFFECTS.insert(behind, row)
    known = dataclasses.asdict(CASE.instrument.detector)
    values = {name: getattr(CASE.instrument.detector, name) for name in known}
    yield lambda rms: dataclasses.replace(
        CASE,
        instrument=dataclasses.replace(
            CASE.instrument, detector=NoisyDetector(**values, popcorn_noise=rms)
        ),
    )
    PIXEL_EFFECTS.remove(row)


def test_a_noise_source_is_two_places(noisy):
    loud = noisy(200.0)
    outcomes = [run_trials(case, 3, range(8)) for case in (CASE, noisy(0.0), loud)]
    assert outcomes[0].tobytes() == outcomes[1].tobytes()
    assert outcomes[2]["spots"].mean() < 0.8 * outcomes[0]["spots"].mean()
    for fidelity in (Fidelity.WINDOW, Fidelity.SPOTS, Fidelity.COVARIANCE):
        with pytest.raises(Refused, match="without popcorn_noise; choose the fidelity frame"):
            require_fidelity(loud, fidelity)
    assert "popcorn noise (detector.popcorn_noise)" in of_the_case(loud)
    assert "popcorn noise (detector.popcorn_noise)" not in of_the_case(noisy(0.0))
    key = {key.name: key for key in keys_of(NoisyDetector)}["popcorn_noise"]
    assert (key.unit, key.range, key.meaning) == (
        "electron",
        "at least 0",
        "rms of the popcorn noise",
    )
    with pytest.raises(Refused, match="popcorn_noise must not be negative"):
        noisy(-1.0)


def test_without_its_row_nothing_is_left_of_it():
    assert "popcorn_noise" not in {effect.key for effect in PIXEL_EFFECTS}
    require_fidelity(CASE, Fidelity.WINDOW)


# A light: its file, and its row in LIGHTS.
def shine_by_night(given):
    count = round(len(given.direction) ** 0.5)
    yield DiffuseLight(np.full(len(given.wavelength), 1e13), np.ones((count, count)))


def test_a_light_is_two_places(monkeypatch):
    lit = lambda: dataclasses.replace(  # noqa: E731
        CASE, scene=dataclasses.replace(CASE.scene, lights=("nightglow",))
    )
    with pytest.raises(Refused, match="lights must be one of zodiacal"):
        lit()
    with monkeypatch.context() as added:
        row = LightKind(varies=True, dated=False, diffuse=shine_by_night)
        added.setitem(LIGHTS, "nightglow", row)
        case = lit()
        dark, light = (
            np.median(whole_frame(one, Rotation.identity(), Streams(5, 0)).image)
            for one in (CASE, case)
        )
        assert light > 1.05 * dark
        with pytest.raises(Refused, match="without nightglow; choose the fidelity frame"):
            require_fidelity(case, Fidelity.WINDOW)
        assert "brighter and blinded sky by nightglow (scene.lights)" in of_the_case(case)
    with pytest.raises(Refused, match="lights must be one of zodiacal"):
        lit()


# A centroid method: its file, and its row in CENTROIDS.
def brightest_pixel(stars, star, sigma, compensation):
    return CENTROIDS["gravity"].measure(stars, star, sigma, "none")


def test_a_centroid_method_is_two_places(monkeypatch):
    def case():
        detection = dataclasses.replace(CASE.tracker.detection, centroid="plain")
        return dataclasses.replace(
            CASE, tracker=dataclasses.replace(CASE.tracker, detection=detection)
        )

    with pytest.raises(Refused, match="centroid must be one of gravity"):
        case()
    with monkeypatch.context() as added:
        row = CENTROIDS["gravity"]._replace(measure=brightest_pixel)
        added.setitem(CENTROIDS, "plain", row)
        uncompensated = dataclasses.replace(CASE.tracker.detection, compensation="none")
        same = dataclasses.replace(
            CASE, tracker=dataclasses.replace(CASE.tracker, detection=uncompensated)
        )
        outcomes = run_trials(case(), 3, range(3)), run_trials(same, 3, range(3))
        assert outcomes[0].tobytes() == outcomes[1].tobytes()
        assert "plain" in next(
            key.kind for key in keys_of(type(CASE.tracker.detection)) if key.name == "centroid"
        )
    with pytest.raises(Refused, match="centroid must be one of gravity"):
        case()


# An optimiser: its file alone, which a campaign names as module:function.
def halve_the_steps(given):
    """Coordinate search: steps along each axis, halved if none improves the score."""
    point, step = given.start.copy(), 0.25
    best = given.score(point)
    while step > 1e-3:
        around = [point + step * side for side in (*np.eye(len(point)), *-np.eye(len(point)))]
        scores = [given.score(np.clip(each, 0, 1)) for each in around]
        if min(scores) < best:
            best, point = min(scores), np.clip(around[int(np.argmin(scores))], 0, 1)
        else:
            step /= 2


def test_an_optimiser_is_one_place(monkeypatch):
    monkeypatch.setitem(sys.modules, "coordinate_search", sys.modules[__name__])
    name = "coordinate_search:halve_the_steps"
    assert algorithms(f"direct+{name}") == ["GN_DIRECT_L", name]

    def bowl(point):
        return float(((point - [0.3, 0.8]) ** 2).sum())

    start = np.array([0.5, 0.5])
    with pytest.raises(ValueError, match="coordinate_search is imported only with --allow-code"):
        minimise(bowl, start, Search(name))
    with code_of_command(True):
        found = minimise(bowl, start, Search(name, evaluations=300))
    np.testing.assert_allclose(found.coordinates, [0.3, 0.8], atol=1e-3)
    assert found.evaluations < 300


# A command: its file, and its row in COMMANDS.
class Greet:
    """Takes the place of the file startrack/cli/greet.py."""

    declare = Options("Greets somebody.", Option("whom WHOM", "who is greeted"))

    @staticmethod
    def command(options):
        print(f"hello {options.whom}")
        return 0


def test_a_command_is_two_places(monkeypatch, capsys):
    with monkeypatch.context() as added:
        added.setitem(COMMANDS, "greet", "greet somebody")
        added.setitem(sys.modules, "startrack.cli.greet", Greet)
        assert main(["greet", "Vega"]) == 0
        assert capsys.readouterr().out == "hello Vega\n"
    with pytest.raises(SystemExit):
        _parser(["greet", "Vega"]).parse_args(["greet", "Vega"])
