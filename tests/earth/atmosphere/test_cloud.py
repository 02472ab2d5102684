"""A cloud layer against random walks of photons, and in limiting cases."""

import warnings

import numpy as np
import pytest

from startrack.core import Streams
from startrack.earth.atmosphere import layer_optics

PHOTONS = 20000
VIEWS = np.array([[1.0, 0.0], [0.75, 0.3], [0.75, 2.8]])  # cosine, azimuth from the Sun's


def walk(depth, sun, albedo, g):
    """Reflected and transmitted fractions of photons, and the reflectance factors of VIEWS.

    At each scattering, the expected light is added for each sensor. The flight is towards azimuth
    0, so that the Sun's side is at pi.
    """
    rng = Streams(3, 1)("photons")
    place, weight = np.zeros(PHOTONS), np.ones(PHOTONS)
    way = np.tile([np.sqrt(1 - sun**2), 0.0, -sun], (PHOTONS, 1))
    sine = np.sqrt(1 - VIEWS[:, 0] ** 2)
    to = np.stack([-sine * np.cos(VIEWS[:, 1]), -sine * np.sin(VIEWS[:, 1]), VIEWS[:, 0]], -1)
    up = down = 0.0
    seen = np.zeros(len(VIEWS))
    while len(weight):
        place = place - way[:, 2] * rng.exponential(size=len(weight))
        up, down = up + weight[place < 0].sum(), down + weight[place > depth].sum()
        here = (place >= 0) & (place <= depth)
        place, way, weight = place[here], way[here], weight[here] * albedo
        phase = (1 - g**2) / (1 + g**2 - 2 * g * way @ to.T) ** 1.5
        seen += weight @ (phase * np.exp(-place[:, None] / VIEWS[:, 0])) / 4 / VIEWS[:, 0]
        cosine = (1 + g**2 - ((1 - g**2) / (1 - g + 2 * g * rng.random(len(weight)))) ** 2) / 2 / g
        turn = 2 * np.pi * rng.random(len(weight))
        aside = np.cross(way, [0.3, 0.9, 0.1])
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        other = np.cross(way, aside)
        side = np.cos(turn)[:, None] * aside + np.sin(turn)[:, None] * other
        way = cosine[:, None] * way + np.sqrt(1 - cosine**2)[:, None] * side
        few = weight < 0.1  # those with little light go on at random
        kept = ~few | (rng.random(len(weight)) < 0.5)
        weight = np.where(few, 2 * weight, weight)
        place, way, weight = place[kept], way[kept], weight[kept]
    return up / PHOTONS, down / PHOTONS, seen / PHOTONS


@pytest.mark.parametrize(
    ("depth", "sun", "albedo", "g"),
    [(0.5, 0.5, 1.0, 0.85), (4.0, 0.8, 1.0, 0.85), (2.0, 0.5, 0.6, 0.7)],
    ids=["cirrus", "cloud", "absorbing"],
)
def test_a_layer_is_what_random_walks_find(depth, sun, albedo, g):
    """Fluxes within five standard errors of the photons; radiance within 8 %."""
    up, down, seen = walk(depth, sun, albedo, g)
    layer = layer_optics(albedo, g)
    depths = np.full(len(VIEWS), depth)
    light = layer.light(depths[:1], np.array([sun]))
    assert light.reflected[0] == pytest.approx(up, abs=5 * np.sqrt(up / PHOTONS))
    assert light.transmitted[0] == pytest.approx(down, abs=5 * np.sqrt(down / PHOTONS))
    mine = layer.reflectance(depths, np.full(len(VIEWS), sun), *VIEWS.T)
    np.testing.assert_allclose(mine, seen, rtol=0.08)


def test_a_layer_keeps_energy_and_reciprocity():
    layer = layer_optics(1.0, 0.85)
    depth, cosine = (each.ravel() for each in np.meshgrid([0.01, 0.3, 3.0, 100.0], [0.2, 0.5, 1.0]))
    light = layer.light(depth, cosine)
    np.testing.assert_allclose(light.reflected + light.transmitted, 1, atol=4e-3)
    there = layer.reflectance(depth, cosine, np.full(12, 0.7), np.full(12, 1.0))
    back = layer.reflectance(depth, np.full(12, 0.7), cosine, np.full(12, 1.0))
    np.testing.assert_allclose(there, back, rtol=5e-3)


def test_black_particles_follow_beer():
    light = layer_optics(0.0, 0.85).light(np.array([0.7]), np.array([0.6]))
    assert light.direct[0] == pytest.approx(np.exp(-0.7 / 0.6))
    assert light.emissivity[0] == pytest.approx(1 - np.exp(-0.7 / 0.6), abs=1e-4)
    assert light.reflected[0] == 0


def test_disort_agrees():
    """PythonicDISORT (Ho and Pierrehumbert 2024) with its correction of single scattering."""
    disort = pytest.importorskip("PythonicDISORT")
    warnings.simplefilter("ignore")  # of its own precision
    sun, depth, g, streams = 0.6, 1.0, 0.85, 32
    found = disort.pydisort(
        np.array([depth]),
        np.array([1 - 1e-7]),
        streams,
        g ** np.arange(200.0)[None],
        sun,
        1.0,
        np.pi,
        NLeg=streams,
        f_arr=np.array([g**streams]),
        NT_cor=True,
    )
    cosine, azimuth = found[0][found[0] > 0.3], np.array([0.3, 1.5, 2.8])
    theirs = np.pi * found[4](0, azimuth)[found[0] > 0.3] / sun
    c, a = (each.ravel() for each in np.meshgrid(cosine, azimuth, indexing="ij"))
    mine = layer_optics(1.0, g).reflectance(np.full(c.size, depth), np.full(c.size, sun), c, a)
    np.testing.assert_allclose(mine, theirs.ravel(), rtol=0.01)
