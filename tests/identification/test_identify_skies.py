"""Fields that are difficult for a special reason."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from startrack.catalog import Selection, open_sky
from startrack.core.values import Spots, Status
from startrack.identification import Identification, identify

PLEIADES = [0.5444, 0.7315, 0.4108]  # RA 56.75, Dec 24.12 deg
MILKY_WAY = [0.1107, -0.8673, -0.4853]  # to Sagittarius


def joined(spots: Spots, pixel, flux) -> Spots:
    """Spots with further ones added, by decreasing flux."""
    x, y = np.concatenate([[spots.x, spots.y], np.transpose(pixel)], axis=1)
    flux = np.concatenate([spots.flux, flux])
    order = np.argsort(-flux, kind="stable")
    n = len(x)
    covariance = np.tile(spots.covariance[0], (n, 1, 1))
    return Spots(x[order], y[order], flux[order], covariance, np.full(n, 50.0), np.full(n, 9))


@pytest.mark.parametrize("direction", [PLEIADES, MILKY_WAY])
@pytest.mark.parametrize("field", [8, 20])
def test_crowded_fields(design, towards, direction, field):
    camera = design(field, {8: 6.5, 20: 5.0}[field])
    rng = np.random.default_rng(21)
    for roll in (0.0, 1.0, 3.0):
        seen = camera.look(rng, noise=0.1, false=3, attitude=towards(direction, roll))
        assert seen.error(camera.solve(seen.spots)) < 3


def test_planets_and_satellites_outshine_the_stars(design):
    camera = design(12, 6.0)
    rng = np.random.default_rng(22)
    for _ in range(10):
        seen = camera.look(rng, noise=0.1)
        bright = 1024 * rng.random((5, 2)) - 0.5
        spots = joined(seen.spots, bright, 10 * seen.spots.flux.max() * np.arange(1, 6))
        matches = camera.solve(spots)
        assert seen.error(matches) < 3
        assert not set(matches.spot.tolist()) & set(range(5))


def test_the_moon_hides_a_third_of_the_frame_and_makes_spots_along_its_limb(design):
    camera = design(12, 6.0)
    rng = np.random.default_rng(23)
    for _ in range(10):
        seen = camera.look(rng, noise=0.1)
        pixel = np.column_stack([seen.spots.x, seen.spots.y])
        glare = np.linalg.norm(pixel - [300, 500], axis=1) < 330
        angle = 2 * np.pi * rng.random(25)
        limb = np.array([300, 500]) + 330 * np.column_stack([np.cos(angle), np.sin(angle)])
        limb = limb[(limb > 0).all(axis=1)]
        left = np.flatnonzero(~glare)
        parts = {name: getattr(seen.spots, name)[left] for name in Spots.__dataclass_fields__}
        spots = joined(Spots(**parts), limb, np.full(len(limb), 2 * seen.spots.flux.max()))
        matches = camera.solve(spots)
        if len(left) > 8:
            assert matches.status is Status.SOLVED
        if matches.status is Status.SOLVED:
            assert seen.error(matches) < 3


def test_a_double_star_is_one_spot_at_the_centre_of_its_light(design, towards):
    """The spot of a pair closer than a pixel lies at neither star, and is matched within noise."""
    camera = design(12, 6.0)
    stars, focal = camera.stars, camera.camera.focal_length_px
    order = np.argsort(stars.magnitude_g)[:3000]
    near = cKDTree(stars.direction[order]).query_pairs(1.5 / focal, output_type="ndarray")
    apart = np.linalg.norm(np.diff(stars.direction[order[near]], axis=1)[:, 0], axis=1) * focal
    pairs = near[apart > 0.5]
    pairs = pairs[np.argsort(pairs.max(axis=1))]
    rng = np.random.default_rng(24)
    assert len(pairs) > 5
    for pair in order[pairs[:6]]:
        flux = 10 ** (-0.4 * stars.magnitude_g[pair])
        centre = flux @ stars.direction[pair] / flux.sum()
        seen = camera.look(rng, noise=0.02, magnitude_noise=0.0, attitude=towards(centre))
        component = np.isin(seen.star, pair)
        expected = camera.camera.project(seen.icrs_to_camera.apply(centre))
        parts = {n: getattr(seen.spots, n)[~component] for n in Spots.__dataclass_fields__}
        spots = joined(Spots(**parts), expected, [2 * seen.spots.flux.max()])
        matches = camera.solve(spots)
        (place,) = np.flatnonzero(matches.spot == 0)
        assert matches.star[place] in pair
        found = camera.camera.project(seen.icrs_to_camera.apply(matches.direction[[place]]))
        assert np.linalg.norm(found - expected) < 0.05


def test_a_catalogue_of_another_epoch(design):
    """For the epoch 1926: a century moves Arcturus by 5 pixels here, and most stars by none."""
    camera = design(12, 6.0)
    now = open_sky(Selection(limit_g=7.0, epoch=2026.0)).stars
    old = open_sky(Selection(limit_g=7.0, epoch=1926.0)).stars
    then = replace(camera, stars=old)
    rng = np.random.default_rng(25)
    index = camera.index
    assert len(now) == len(camera.stars)
    for _ in range(10):
        seen = then.look(rng, noise=0.1, false=3)
        matches = identify(seen.spots, camera.camera, camera.stars, index, Identification())
        assert seen.error(matches) < 3


def test_what_is_likely_but_not_certain_is_ambiguous(design, spots_at):
    """Four stars alone, for which a match by chance is as good; no attitude is given."""
    camera = design(12, 6.0)
    rng = np.random.default_rng(26)
    strict = Identification(max_false_probability=1e-9)
    found = set()
    for _ in range(12):
        seen = camera.look(rng, noise=0.2)
        pixel = np.column_stack([seen.spots.x, seen.spots.y])[:4]
        matches = camera.solve(spots_at(pixel, 0.2), strict)
        found.add(matches.status)
        if matches.status is Status.AMBIGUOUS:
            assert matches.icrs_to_camera is None
            assert 1e-9 <= matches.false_probability < 1e-2
            assert "chance" in matches.reason
    assert Status.AMBIGUOUS in found
