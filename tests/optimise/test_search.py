import math
import threading

import nlopt
import numpy as np
import pytest

from startrack.optimise import search as module
from startrack.optimise.search import Algorithm, Search, minimise, minimise_globally

LOCAL = (Algorithm.SBPLX, Algorithm.BOBYQA, Algorithm.COBYLA)
WHOLE = (Algorithm.DIRECT, Algorithm.CRS, Algorithm.MLSL)


def valley(coordinates):
    """Rosenbrock's (1960) on [-2, 2]^2: least at (1, 1), a quarter short of the upper corner."""
    x, y = 4 * coordinates - 2
    return 100 * (y - x * x) ** 2 + (1 - x) ** 2


def bowl(centre):
    return lambda coordinates: float(((coordinates - centre) ** 2).sum())


@pytest.mark.parametrize("algorithm", Algorithm)
def test_a_smooth_bowl_is_found(algorithm):
    found = minimise(bowl(0.3), np.array([0.5, 0.6]), Search(algorithm, 400, last_step=1e-4))
    np.testing.assert_allclose(found.coordinates, 0.3, atol=0.01)
    assert found.evaluations <= 400


def test_sbplx_follows_a_bent_valley():
    found = minimise(valley, np.array([0.2, 0.75]), Search(evaluations=3000, last_step=1e-6))
    np.testing.assert_allclose(found.coordinates, 0.75, atol=0.02)


@pytest.mark.parametrize("algorithm", WHOLE)
def test_the_deeper_of_two_valleys_is_found_from_the_other(algorithm):
    def two(coordinates):
        shallow = 0.3 + ((coordinates - 0.85) ** 2).sum()
        return float(min(shallow, 4 * ((coordinates - 0.2) ** 2).sum()))

    found = minimise(two, np.array([0.85, 0.85]), Search(algorithm, 1500))
    np.testing.assert_allclose(found.coordinates, 0.2, atol=0.02)


@pytest.mark.parametrize("algorithm", LOCAL)
def test_a_corner_is_reached(algorithm):
    found = minimise(lambda p: float(-p.sum()), np.full(3, 0.4), Search(algorithm, 500))
    np.testing.assert_allclose(found.coordinates, 1, atol=2e-3)


def test_one_variable():
    found = minimise(bowl(0.77), np.array([0.1]), Search(last_step=1e-4))
    assert found.coordinates[0] == pytest.approx(0.77, abs=1e-3)


def test_twenty_variables():
    centre = np.linspace(0.1, 0.9, 20)
    weight = np.geomspace(1, 10, 20)
    found = minimise(
        lambda p: float((weight * (p - centre) ** 2).sum()),
        np.full(20, 0.5),
        Search(evaluations=4000, last_step=1e-4),
    )
    np.testing.assert_allclose(found.coordinates, centre, atol=0.02)


@pytest.mark.parametrize("algorithm", Algorithm)
def test_a_flat_score_ends(algorithm):
    found = minimise(lambda _: 1.0, np.array([0.5, 0.6]), Search(algorithm, 100))
    assert found.score == 1.0
    assert found.evaluations <= 100


@pytest.mark.parametrize("algorithm", Algorithm)
def test_places_without_a_score_are_avoided(algorithm):
    """NaN where x < 0.4: by itself, nlopt returns NaN with one algorithm and raises with
    another."""

    def half(coordinates):
        return math.nan if coordinates[0] < 0.4 else bowl(0.3)(coordinates)

    found = minimise(half, np.array([0.8, 0.8]), Search(algorithm, 1000))
    assert found.coordinates[0] >= 0.4
    assert math.isfinite(found.score)
    if algorithm not in (Algorithm.BOBYQA, Algorithm.COBYLA):  # which model the cliff
        assert found.score < 0.03  # 0.01 on the cliff, 0.5 at the start


def test_no_score_anywhere_leaves_the_start():
    found = minimise(lambda _: math.nan, np.array([0.2]), Search(evaluations=20))
    assert found.score == math.inf
    assert found.coordinates == [0.2]


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.asarray, int])
@pytest.mark.parametrize("algorithm", Algorithm)
def test_any_kind_of_number_is_a_score(algorithm, kind):
    """nlopt itself raises an error without a message for the first and the third of these
    numbers."""
    minimise(lambda coordinates: kind(coordinates[0]), np.array([0.5]), Search(algorithm, 20))


@pytest.mark.parametrize("algorithm", Algorithm)
def test_a_place_is_not_overwritten_and_not_tried_twice(algorithm):
    kept = []

    def score(coordinates):
        kept.append(coordinates)
        return bowl(0.5)(coordinates)

    minimise(score, np.array([0.5, 0.6]), Search(algorithm, 150))
    assert len({coordinates.tobytes() for coordinates in kept}) == len(kept) <= 150


@pytest.mark.parametrize("algorithm", Algorithm)
def test_the_number_of_evaluations_holds(algorithm):
    """nlopt's CRS makes one evaluation more than it is allowed."""
    found = minimise(bowl(0.31), np.array([0.5, 0.6]), Search(algorithm, 17, last_step=1e-9))
    assert found.evaluations <= 17


def test_an_error_of_the_score_comes_out():
    def broken(_):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        minimise(broken, np.array([0.5]), Search())


@pytest.mark.parametrize("error", [nlopt.RoundoffLimited, nlopt.ForcedStop])
def test_what_stops_nlopt_leaves_the_best(monkeypatch, error):
    class Limited:
        def set_min_objective(self, objective):
            self._objective = objective

        def optimize(self, start):
            for step in (0.0, 0.1, 0.2):
                self._objective(start + step, np.empty(0))
            raise error("stopped")

    monkeypatch.setattr(module, "_engine", lambda *_: Limited())
    found = minimise(bowl(0.4), np.array([0.3]), Search())
    assert found.coordinates[0] == pytest.approx(0.4)
    assert found.evaluations == 3


def test_enough_ends_it():
    count = []
    found = minimise(
        lambda coordinates: count.append(1) or bowl(0.3)(coordinates),
        np.array([0.5, 0.6]),
        Search(last_step=1e-9),
        lambda: "seen enough" if len(count) == 7 else "",
    )
    assert (found.evaluations, found.ending) == (7, "seen enough")


@pytest.mark.parametrize("algorithm", WHOLE)
def test_the_same_seed_goes_the_same_way(algorithm):
    def path():
        points = []
        minimise(
            lambda p: points.append(p) or valley(p), np.array([0.5, 0.5]), Search(algorithm, 60)
        )
        return np.array(points)

    np.testing.assert_array_equal(path(), path())


def test_a_start_outside_is_refused():
    with pytest.raises(ValueError, match="unit cube"):
        minimise(bowl(0.3), np.array([1.5]), Search())


def test_a_search_of_all_ends_no_worse_than_the_start():
    """The start lies in a hole that the search of the whole cube does not reach."""

    def hole(coordinates):
        return (
            min(0.01, float(np.abs(coordinates - 0.61).max()))
            if near(coordinates)
            else 1 + bowl(0.1)(coordinates)
        )

    def near(coordinates):
        return np.abs(coordinates - 0.61).max() < 2e-3

    found = minimise_globally(hole, np.full(2, 0.611), 40, 40)
    assert found.score <= hole(np.full(2, 0.611))


def test_a_search_of_all_ends_where_it_is_enough():
    tried = []
    found = minimise_globally(
        lambda coordinates: tried.append(1) or bowl(0.5)(coordinates),
        np.full(2, 0.5),
        40,
        40,
        lambda: "at the bottom",
    )
    assert (found.score, len(tried)) == (0, 1)


def test_a_search_in_another_thread_changes_no_random_number():
    """Searches with other seeds begin and end in other threads in the meantime."""

    def searched(seed, disturbed):
        points = []

        def value(point):
            points.append(tuple(point))
            if disturbed and len(points) % 20 == 0:
                other = threading.Thread(target=searched, args=(seed + 1, False))
                other.start()
                other.join()
            return float(((point - 0.3) ** 2).sum())

        minimise(value, np.full(2, 0.5), Search(Algorithm.CRS, evaluations=60, seed=seed))
        return points

    assert searched(1, True) == searched(1, False)
