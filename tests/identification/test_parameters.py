"""Defaults and limits of the settings of the identification."""

from dataclasses import asdict

import pytest

from startrack.identification import Identification


def test_settings_are_by_default_those_of_all_published_rates():
    """A change of a default changes every published rate, which must be measured again."""
    assert asdict(Identification()) == {
        "method": "triangles",
        "focal_tolerance": 0.01,
        "match_radius": 2.0,
        "max_false_probability": 1e-5,
        "max_false_track": 1e-3,
        "min_matches": 4,
        "pattern_spots": 24,
        "verify_spots": 40,
        "code_tolerance": 0.003,
        "max_hypotheses": 4000,
    }


LIMITS: dict[str, tuple[list[object], list[object]]] = {
    "method": (["triangles", "mylab.identifications:vote"], ["vote", "mylab:", ""]),
    "focal_tolerance": ([0.0, 0.3], [-1e-9, 0.3001]),
    "match_radius": ([1e-6, 500.0], [0.0, -1.0]),
    "max_false_probability": ([1e-300, 1.0], [0.0, 1.0001]),
    "max_false_track": ([1e-300, 1.0], [0.0, 1.0001]),
    "min_matches": ([4, 2**20], [3, 2**20 + 1]),
    "pattern_spots": ([4, 40], [3, 41]),
    "verify_spots": ([4, 2**20], [3, 2**20 + 1]),
    "code_tolerance": ([0.0, 0.1], [-1e-9, 0.1001]),
    "max_hypotheses": ([1, 2**30], [0, 2**30 + 1]),
}


@pytest.mark.parametrize("name", LIMITS)
def test_each_setting_has_the_stated_limits(name):
    allowed, refused = LIMITS[name]
    for value in allowed:
        assert getattr(Identification(**{name: value}), name) == value
    for value in refused:
        with pytest.raises(ValueError, match=f"^{name} must"):
            Identification(**{name: value})


def test_every_setting_has_its_limits():
    assert set(LIMITS) == set(asdict(Identification()))
