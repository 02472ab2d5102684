"""The file of a pattern index: read for the same catalogue and field, otherwise made again."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core import Stars
from startrack.identification import cache
from startrack.io.cache import packed


@pytest.fixture
def stars():
    rng = np.random.default_rng(1)
    direction = rng.standard_normal((60, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return Stars(np.arange(60), direction, np.linspace(1, 5, 60), np.zeros(60))


def test_an_index_is_built_once_for_each_catalogue_and_field(tmp_path, stars, monkeypatch):
    built = []
    build = cache.build_index
    monkeypatch.setattr(cache, "build_index", lambda *key: built.append(key) or build(*key))
    first, again = (cache.cached_index(stars, 0.5, tmp_path) for _ in range(2))
    assert len(built) == 1
    arrays, others = packed(first), packed(again)
    assert arrays.keys() == others.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(others[name], array)
    cache.cached_index(stars, 0.6, tmp_path)
    cache.cached_index(replace(stars, magnitude_g=stars.magnitude_g + 1e-9), 0.5, tmp_path)
    assert len(built) == 3
