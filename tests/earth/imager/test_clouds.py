"""Clouds over an image: closed forms of reflected and thermal light, places, the command."""

import math
from dataclasses import replace

import numpy as np
import pytest

from startrack.core import Curve, Streams, deg, nm, um
from startrack.earth.atmosphere import Air, layer_optics, planck
from startrack.earth.geometry import Aircraft
from startrack.earth.imager import CloudLayer, Cover, Imager, Land, Survey, load_survey, open_sheets
from startrack.earth.terrain import cartesian, geodetic, up
from startrack.io import shipped
from startrack.space import sun_direction
from tests.earth.imager.test_render import EPOCH, FLAT, SCAN, channel, flat_band, rendered, survey

GREEN = flat_band(500 * nm, 600 * nm)
WHITE = Curve((), (1.0,))


def total(picture):
    return sum(picture.terms)


def above_flat_land(one, height=20e3, **rest):
    plane = Aircraft(EPOCH, 10 * deg, 47 * deg, height, speed=100.0)
    return Survey(Imager((one,)), FLAT, aircraft=plane, **rest)


def test_an_even_layer_without_air_adds_to_the_ground(tmp_path):
    """Ground of albedo r under a layer: R + T r T' / (1 - r S), the adding of two layers."""
    seen = survey(channel(GREEN), Land((Cover(Curve((), (0.4,))),), lapse=0.0))
    clear = rendered(seen, tmp_path)
    cloudy = rendered(replace(seen, clouds=(CloudLayer(1500.0, 2.0, albedo=WHITE),)), tmp_path)
    sun = total(clear).mean() / 0.4  # white ground
    layer, depth = layer_optics(1.0, 0.85), np.array([2.0])
    zenith = up(np.array([10 * deg]), np.array([47 * deg]))
    cosine = zenith @ sun_direction(seen.carrier.epoch, 0.0)
    down, below = (layer.light(depth, each).transmitted[0] for each in (cosine, np.ones(1)))
    spherical = layer.spherical(depth)[0]
    factor = layer.reflectance(depth, cosine, np.ones(1), np.zeros(1))[0]
    expected = sun * (factor + down * 0.4 * below / (1 - 0.4 * spherical))
    assert total(cloudy).mean() == pytest.approx(expected, rel=2e-3)


def test_no_cloud_changes_nothing_and_a_thin_one_little(tmp_path):
    seen = survey(channel(GREEN), air=Air())
    clear = rendered(seen, tmp_path)
    none = rendered(replace(seen, clouds=(CloudLayer(1500.0, 0.0),)), tmp_path)
    thin = rendered(replace(seen, clouds=(CloudLayer(1500.0, 1e-4),)), tmp_path)
    np.testing.assert_array_equal(none.numbers, clear.numbers)
    np.testing.assert_allclose(total(thin), total(clear), rtol=1e-3)


def test_the_heat_of_a_cloud_that_absorbs(tmp_path):
    """Black particles between the camera and a blackbody: Beer's and Planck's laws."""
    land = Land((Cover(Curve((), (0.0,)), 300.0),), lapse=0.0)
    seen = survey(channel(flat_band(10.9 * um, 11.1 * um), psf="gaussian"), land)
    cloud = CloudLayer(1500.0, 0.8, albedo=Curve((), (0.0,)), temperature=240.0)
    picture = rendered(replace(seen, clouds=(cloud,)), tmp_path)
    warm, cold = (planck(np.array(11 * um), kelvin) * um for kelvin in (300.0, 240.0))
    expected = warm * math.exp(-0.8) + cold * (1 - math.exp(-0.8))
    assert total(picture).mean() == pytest.approx(expected, rel=3e-3)
    above = replace(seen, clouds=(replace(cloud, height=5e3),))  # over the aircraft
    assert total(rendered(above, tmp_path)).mean() == pytest.approx(warm, rel=3e-3)


def test_a_path_crosses_a_layer_at_its_height():
    """The crossing lies on the path at the height of the layer; for a far camera, h tan(zenith)
    aside."""
    sheet = open_sheets((CloudLayer(8e3, 1.0),), None)[0]
    place = np.full(3, 0.3), np.full(3, 0.8)
    point, zenith = cartesian(*place, np.zeros(3)), up(*place)
    level = np.cross([0.0, 0.0, 1.0], zenith)
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    angle = np.array([0.0, 40.0, 70.0])[:, None] * deg
    towards = np.cos(angle) * zenith + np.sin(angle) * level
    crossing = sheet.cross(point, towards)
    np.testing.assert_allclose(geodetic(crossing.point)[2], 8e3, atol=1e-3)
    aside = ((crossing.point - point) * level).sum(1)
    np.testing.assert_allclose(
        aside, 8e3 * np.tan(angle[:, 0]), rtol=0.006, atol=1e-6
    )  # the Earth is round
    assert sheet.cross(crossing.point * 1.001, towards).depth.max() == 0  # from above


def test_cloud_and_shadow_lie_where_they_must(tmp_path):
    """One small thick cloud of a GeoTIFF: displaced by its parallax, with a shadow away from the
    Sun."""
    rasterio = pytest.importorskip("rasterio")
    detector = replace(SCAN, columns=160, rows=160, pixel_pitch=120e-6)
    seen = above_flat_land(channel(GREEN, detector), height=2e3)
    clear = rendered(seen, tmp_path)
    below, behind = (
        np.array([clear.longitude[80, column], clear.latitude[80, column]]) for column in (80, 110)
    )
    height = 200.0
    middle = below + (behind - below) * (1 - height / 2e3)  # on the line of sight to `behind`
    cell = np.array([3 / 6.378e6 / math.cos(47 * deg), 3 / 6.367e6]) / deg  # three metres
    values = np.zeros((200, 200), np.float32)
    values[97:103, 97:103] = 50.0
    west, north = middle + np.array([-100, 100]) * cell
    with rasterio.open(
        tmp_path / "cloud.tif",
        "w",
        driver="GTiff",
        height=200,
        width=200,
        count=1,
        dtype="float32",
        crs="EPSG:4326",
        transform=rasterio.Affine(cell[0], 0, west, 0, -cell[1], north),
    ) as file:
        file.write(values, 1)
    cloudy = rendered(replace(seen, clouds=(CloudLayer(height, file="cloud.tif"),)), tmp_path)
    change = total(cloudy) / total(clear)

    def place(mask):
        return np.array([each[mask].mean() for each in (cloudy.longitude, cloudy.latitude)])

    zenith = up(*(middle * deg))
    sun = sun_direction(seen.carrier.epoch, 0.0)
    shadow = cartesian(*(middle * deg), np.array(height)) - sun * height / float(zenith @ sun)
    told = np.array([float(each) for each in geodetic(shadow)[:2]]) / deg
    np.testing.assert_allclose(place(change < 0.7), told, rtol=0, atol=0.5 * cell.min())
    np.testing.assert_allclose(place(change > 1.5), behind, rtol=0, atol=0.5 * cell.min())
    assert np.abs(told - behind).max() > 20 * cell.min()


def test_generated_clouds_cover_what_they_should():
    layer = CloudLayer(2e3, 5.0, cover=0.3, cell=50.0, seed=4)
    rng = Streams(1, 1)("places")
    longitude, latitude = 0.2 + 0.05 * rng.random(20000), 0.8 + 0.05 * rng.random(20000)
    depth = open_sheets((layer,), None)[0].field(longitude, latitude)
    again = open_sheets((layer,), None)[0].field(longitude, latitude)
    np.testing.assert_array_equal(depth, again)
    assert (depth > 0).mean() == pytest.approx(0.3, abs=0.05)
    assert depth.mean() == pytest.approx(0.3 * 5.0, rel=0.1)


def test_what_a_layer_must_be():
    with pytest.raises(ValueError, match="cover must be left out if file is given"):
        CloudLayer(1e3, file="a.tif", cover=0.5)
    with pytest.raises(ValueError, match="particles must be one of ice, water"):
        CloudLayer(1e3, particles="dust")
    heights = [one.height for one in load_survey(shipped("scenes/clouds.toml")).clouds]
    assert heights == [3e3, 10e3]
    assert CloudLayer(10e3).kelvin == pytest.approx(223.15)
