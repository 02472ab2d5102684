"""Products against the truth of their scenes: radiance, reflectance, place, quality, command."""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from startrack.cli.main import main
from startrack.core import Curve
from startrack.core.units import deg, nm, um
from startrack.detector import Detector, Scan
from startrack.earth.atmosphere import Air
from startrack.earth.geometry import (
    Aircraft,
    EarthScene,
    Fractal,
    Pointing,
    Sensor,
    Terrain,
    observe_earth,
)
from startrack.earth.imager import (
    Channel,
    CloudLayer,
    Cover,
    Imager,
    Knowledge,
    Land,
    Picture,
    Survey,
    open_sheets,
    prepare,
    render,
)
from startrack.earth.imager.band import band_of
from startrack.earth.product import ProductSettings, calibrate, make_product, uncertainty
from startrack.earth.product.ortho import (
    CLOUD,
    CLOUD_SHADOW,
    HIDDEN,
    NO_DATA,
    SATURATED,
    Locator,
    grid_of,
    place_cells,
    resample,
)
from startrack.earth.product.retrieval import (
    RadiometricCalibration,
    apparent_reflectance,
    brightness_temperature,
    to_radiance,
)
from startrack.earth.product.uncertainty import CAUSES
from startrack.earth.terrain import Rays, cartesian, survey, up
from startrack.optics import Optics

from ..terrain.scenes import CAMERA, SCENE

sys.path.append(str(Path(__file__).parents[3] / "experiments"))
HILLS = Terrain(fractal=Fractal(10 * deg, 47 * deg, 10.0, 256, 600.0), highest=700, lowest=-10)
PLANE = Aircraft("2026-06-21T10:00:00", 10 * deg, 47 * deg, 3e3, speed=100.0)
SCAN = Detector(
    40,
    40,
    40e-6,
    1e-3,
    Curve((), (0.5,)),
    full_well=1e6,
    bits=14,
    offset=20,
    prnu=0.02,
    dark_current=1e6,
    read_noise=50.0,
    nonlinearity=0.02,
    pixel_rate=1e6,
    scan=Scan(),
)
GREY = Land()
GREEN = Curve((519 * nm, 520 * nm, 560 * nm, 561 * nm), (0.0, 1.0, 1.0, 0.0))


def flown(detector: Detector = SCAN, band: Curve = GREEN, land: Land = GREY, **rest) -> Survey:
    channel = Channel("one", Optics(0.05, 4.0, blur=3e-6, psf="airy"), detector, band)
    return Survey(Imager((channel,)), HILLS, aircraft=PLANE, land=land, air=Air(), rays=1, **rest)


def made(one: Survey):
    channel = one.channels[0]
    picture = Picture.blank(channel.detector.rows, channel.columns)
    setting = render(one, channel, Path(), 1, picture)
    frames = calibrate(one, channel, setting, 1)
    return make_product(one, channel, Path(), picture.numbers, frames), picture, setting


def test_the_mean_radiance_and_the_place_of_fires_come_back():
    """The experiment's figures on a smaller image; the experiment has 0.003 % and 0.06 pixel."""
    from earth_loop import loop_place_px, loop_radiance_error

    error, noise = loop_radiance_error(48)
    assert error < 0.001
    assert noise == pytest.approx(1, abs=0.05)  # 2,304 pixels: 3.4 sigma of their scatter
    assert loop_place_px(48, 2) < 0.1


def test_ground_has_the_reflectance_that_it_was_given():
    """Hills in sun and shade, through air, with a nonlinear detector: within the noise of 1,600
    pixels.

    The ground outside of the image is brighter than its hills, and not known: 0.7 %.
    """
    product, _, setting = made(flown(land=Land((Cover(Curve((), (0.3,))),))))
    surface = product.image["surface reflectance"]
    assert np.nanmean(surface) == pytest.approx(0.3, abs=0.0025)
    assert product.surroundings == pytest.approx(setting.surroundings, abs=0.003)
    assert np.nanmean(product.layers["surface reflectance"]) == pytest.approx(0.3, abs=0.003)


def test_apparent_reflectance_of_a_white_plain_without_air_is_one():
    """Irradiance of the Sun at 540 nm by Thuillier et al. (2003): 1.86 W / m^2 / nm to 2 %."""
    band = band_of(flown().camera.channels[0], None, 3e3, 1.0)
    assert band.irradiance * nm == pytest.approx(1.86, rel=0.02)
    radiance = np.array([band.irradiance * math.cos(1.0) / math.pi * um])
    assert apparent_reflectance(radiance, np.array([1.0]), band) == pytest.approx(1)


def test_a_blackbody_has_its_own_brightness_temperature():
    warm = Curve((9.99 * um, 10 * um, 10.2 * um, 10.21 * um), (0.0, 1.0, 1.0, 0.0))
    band = band_of(flown(band=warm).camera.channels[0], None, 3e3, 1.0)
    # Radiation constants of CODATA 2018: 1.191042972e8 W um^4 / m^2 / sr and 14387.7688 um K.
    radiance = 1.191042972e8 / 10.1**5 / (math.exp(14387.7688 / 10.1 / 300) - 1)
    assert brightness_temperature(np.array([radiance]), band)[0] == pytest.approx(300, abs=0.05)
    assert np.isnan(brightness_temperature(np.array([-1.0, 0.0]), band)).all()


@pytest.mark.parametrize("kind", ["line", "tdi", "matrix"])
def test_a_point_is_found_in_the_pixel_that_sees_it(kind):
    """Two ways through the same optics: rays to the terrain, and terrain to pixels."""
    sensor = Sensor(kind, 30, 30, 0.05, 40e-6, stages=5)
    scene = EarthScene(HILLS, sensor, aircraft=PLANE, pointing=Pointing(0.2, 0.1, 0.3))
    (strip,) = observe_earth(scene, Path())
    which = np.arange(len(strip.ground)).reshape(strip.shape)[..., strip.shape[2] // 2].ravel()
    found = Locator(scene).locate(strip.ground.point[which])
    line, column = np.divmod(np.arange(900), 30)
    np.testing.assert_allclose(found, np.stack([column, line], 1), atol=1e-5)


def test_what_hills_hide_is_marked():
    """Against rays from the camera to each cell, which end before hidden ones."""
    sensor = Sensor("matrix", 60, 60, 0.05, 160e-6)
    low = replace(PLANE, altitude=900.0)
    scene = EarthScene(HILLS, sensor, aircraft=low, pointing=Pointing(pitch=1.0))
    (strip,) = observe_earth(scene, Path())
    ground, size = strip.ground, 20.0
    grid = grid_of(ground.longitude, ground.latitude, "utm", size)
    distance = ground.distance.reshape(60, 60)
    parts = list(place_cells(scene, Path(), grid, distance, size))
    quality = np.concatenate([one.quality for one in parts]).ravel()
    inside = np.flatnonzero(quality & NO_DATA == 0)
    lon, lat = grid.places(slice(0, grid.rows))
    terrain = scene.terrain.open(Path())
    height = survey(terrain, _down(lon[inside], lat[inside]), ground.sun).height
    point = cartesian(lon[inside], lat[inside], height)
    eye = Locator(scene).camera(np.zeros(1))
    away = np.linalg.norm(point - eye, axis=1)
    rays = Rays(
        np.broadcast_to(eye, point.shape).copy(),
        (point - eye) / away[:, None],
        np.zeros(len(point)),
    )
    first = terrain.meet(rays)[0].distance
    hidden, marked = first < away - size, quality[inside] & HIDDEN > 0
    assert 0.05 < hidden.mean() < 0.6
    assert (hidden == marked).mean() > 0.9
    # A layer lower than the camera is before the ground and the Sun, one above it before the Sun,
    # but not where the terrain is higher.
    for layer, bits in ((500.0, CLOUD | CLOUD_SHADOW), (950.0, CLOUD_SHADOW)):
        clouds = open_sheets((CloudLayer(layer),), Path())
        parts = place_cells(scene, Path(), grid, distance, size, clouds=clouds)
        quality = np.concatenate([one.quality for one in parts]).ravel()[inside]
        np.testing.assert_array_equal(
            quality & (CLOUD | CLOUD_SHADOW), np.where(height < layer, bits, 0)
        )


def _down(longitude, latitude) -> Rays:
    rise = up(longitude, latitude)
    high = cartesian(longitude, latitude, np.full(len(longitude), 2e4))
    return Rays(high, -rise, np.zeros(len(high)))


def test_radiance_follows_the_flats_of_each_pixel():
    dark = np.array([[10.0, 20.0, 5.0]])
    flat = np.stack([dark + np.array([[100, 200, 0]]), dark + np.array([[190, 400, 0]])])
    frames = RadiometricCalibration(dark, flat, np.array([1.0, 2.0]), flat[0], 1.0, 0 * dark, 2)
    numbers = np.array([[110, 120, 7], [200, 620, 7]])
    found = to_radiance(numbers, frames)
    np.testing.assert_allclose(found[:, :2], [[1.0, 0.5], [2.0, 3.0]])
    assert np.isnan(found[:, 2]).all()  # a dead pixel
    with pytest.raises(ValueError, match=r"must have the 2 columns of the image .*, got 3 x 1"):
        to_radiance(numbers[:, :2], frames)


@pytest.mark.parametrize("projection", ["utm", "geographic"])
def test_a_map_holds_the_image_across_the_date_line(projection):
    longitude, latitude = np.array([179.99, -179.99, 179.98]) * deg, np.array([10, 10.01, 10]) * deg
    grid = grid_of(longitude, latitude, projection, 30.0)
    assert grid.columns == pytest.approx(0.03 * 111.3e3 * math.cos(10 * deg) / 30, abs=4)
    lon, lat = grid.places(slice(0, grid.rows))
    for x, y in zip(longitude, latitude, strict=True):
        apart = np.hypot((lon - x + math.pi) % (2 * math.pi) - math.pi, lat - y) * 6.37e6
        assert apart.min() < 30


def test_resampling_between_pixels():
    line, column = np.indices((8, 9)).astype(float)
    values = 3 * line - column
    place = np.array([[2.3, 4.6], [-0.4, 3.0], [-0.6, 3.0], [math.nan, 1.0]])
    for method in ("bilinear", "cubic"):
        found = resample(values, place, method)
        assert found[0] == pytest.approx(2.3, abs=0.05)
        assert found[1] == pytest.approx(-3)
        assert np.isnan(found[2:]).all()
    assert resample(values, place, "nearest")[0] == 3 * 2 - 5
    values[2, 5] = math.nan
    assert np.isnan(resample(values, place, "bilinear")[0])


def test_the_command_maps_what_was_rendered_and_refuses_the_rest(tmp_path, capsys):
    rasterio = pytest.importorskip("rasterio")
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "small.toml").write_text(CAMERA)
    scene, raw = str(tmp_path / "scene.toml"), tmp_path / "raw"
    process = ["earth", "process", scene, "--raw", str(raw), "--out", str(tmp_path / "out")]

    def refused(sentence: str) -> None:
        assert main(process) == 2
        assert sentence in capsys.readouterr().err

    refused("green.fits must be a raw image of startrack earth render, but there is none")
    assert main(["earth", "render", scene, "--out", str(raw), "--calibration", "64"]) == 0
    capsys.readouterr()
    frames = (raw / "green-calibration.fits").rename(tmp_path / "frames.fits")
    refused("green-calibration.fits must be calibration frames, but there is none")
    frames.rename(raw / "green-calibration.fits")
    assert main([*process, "--json"]) == 0
    told, page = map(json.loads, capsys.readouterr().out.splitlines())
    text = Path(page["report"]).read_text(encoding="utf-8")
    assert text.count("data:image/png") == 2
    assert "brightness temperature" not in text
    assert abs(told["radiance_error"]) < 0.005
    assert told["projection"] == "EPSG:32632"
    with rasterio.open(told["map"]) as file, rasterio.open(told["quality"]) as bits:
        assert file.descriptions == ("radiance", "reflectance", "surface reflectance")
        assert file.shape == bits.shape == (told["rows"], told["columns"])
        lost = bits.read(1) & NO_DATA > 0
        assert (np.isnan(file.read(1)) == lost).all()
        assert lost.mean() == pytest.approx(told["flagged"]["no data"])
        middle = file.lnglat()
        assert middle == pytest.approx((10, 47), abs=0.01)
    assert Path(told["png"]).stat().st_size > 20_000
    with fits.open(raw / "green-calibration.fits") as parts:
        assert parts["FLAT"].data.shape == (4, 1, 24)
        assert parts[0].header["FRAMES"] == 64
    (tmp_path / "small.toml").write_text(CAMERA.replace("50 mm", "51 mm"))
    refused("green.fits must be of channel green with the parameters in the scene")
    (tmp_path / "small.toml").write_text(CAMERA)
    (tmp_path / "scene.toml").write_text(SCENE.replace("lines = 30", "lines = 31"))
    refused("green.fits must have 24 x 31 pixel, as the scene says, got 24 x 30")
    (tmp_path / "scene.toml").write_text(SCENE)
    assert told["differs"] == []
    assert main([*process, "--set", "air.visibility=10km", "--set", "pointing.roll=1deg"]) == 0
    text = capsys.readouterr().out
    assert "OTHER FLIGHT" in text
    assert "OTHER AIR" in text
    assert "OTHER TERRAIN" not in text
    assert main([*process, "--cell", "1e6"]) == 0
    assert "mean      none: no cell has a value" in capsys.readouterr().out
    (raw / "green.fits").write_bytes(b"SIMPLE  = nonsense")
    refused("green.fits must be a raw image of startrack earth render, whole, got")


def test_saturated_pixels_are_marked_on_the_map():
    dim = replace(SCAN, full_well=2e4)
    product, picture, _ = made(flown(dim, land=Land((Cover(Curve((), (0.3,))),))))
    assert product.saturated.any()
    assert (product.quality & SATURATED > 0).sum() >= product.saturated.sum() / 2
    assert (picture.numbers[product.saturated] > 0.97 * 2**14).all()  # 2 % are non-linear
    assert (picture.numbers[~product.saturated] < 0.98 * 2**14).all()


def test_an_image_of_the_sky_has_no_map():
    with pytest.raises(ValueError, match="must show ground for a map"):
        made(flown(pointing=Pointing(roll=100 * deg)))


def test_a_matrix_has_frames_of_its_own_size():
    one = flown(replace(SCAN, scan=None, rows=12))
    channel = one.channels[0]
    setting = prepare(one, channel, Path())
    frames = calibrate(one, channel, setting, 1, 40)
    assert frames.dark.shape == (12, 40)
    # Photon transfer: 480 pixels of 40 frames each know a variance to 0.7 %.
    linear = 1e6 / (2**14 - 1)
    assert frames.electrons == pytest.approx(linear, rel=0.08)
    again = calibrate(one, channel, setting, 1, 40)
    np.testing.assert_array_equal(frames.flat, again.flat)


def test_each_pixel_has_an_uncertainty_by_contributors():
    """Noise against the scatter of uniform ground; causes add up; the lamp has an error of 2 %."""
    one = flown(replace(SCAN, prnu=0.0), land=Land((Cover(Curve((), (0.3,))),)))
    one = replace(one, terrain=replace(HILLS, fractal=replace(HILLS.fractal, relief=1e-3)))
    channel = one.channels[0]
    picture = Picture.blank(channel.detector.rows, channel.columns)
    setting = render(one, channel, Path(), 1, picture)
    frames = calibrate(one, channel, setting, 1, count=4096)
    product = make_product(
        one, channel, Path(), picture.numbers, frames, ProductSettings(uncertainty=True)
    )
    truth = picture.terms.total.astype(float)
    scatter = (product.image["radiance"] - truth) / product.uncertainty["radiance"]["noise"]
    assert scatter.std() == pytest.approx(1, abs=0.07)  # 1,600 pixels: 4 sigma
    for name, causes in product.uncertainty.items():
        if name != "place":
            parts = [values for cause, values in causes.items() if cause != "total"]
            np.testing.assert_allclose(causes["total"], np.sqrt(np.sum(np.square(parts), 0)))
    surface = product.uncertainty["surface reflectance"]
    assert set(surface) == {*CAUSES, "total"}
    lamp = product.uncertainty["radiance"]["calibration"] / product.image["radiance"]
    assert np.median(lamp) == pytest.approx(one.knowledge.lamp, rel=0.01)
    # A slope of 0.01 rad towards the Sun changes its light by 0.01 tan(zenith) at most.
    share = surface["terrain"] / product.image["surface reflectance"]
    assert 0 < np.nanmedian(share) < 0.01 * math.tan(30 * deg)
    assert {"place: total", "surface reflectance: atmosphere"} <= set(product.doubt)


@pytest.mark.parametrize("measured", [0.0, 3.0, 30.0])
def test_read_noise_far_above_that_of_photons_is_as_designed(measured):
    """Photon transfer cannot measure the gain: 400 electrons of read noise are 4.0 numbers of
    100."""
    curve = Curve((), (0.6,))
    detector = Detector(
        8, 8, 40 * um, 1e-3, curve, full_well=100 * 4095.0, bits=12, offset=20, read_noise=400.0
    )
    channel = Channel("thermal", Optics(0.1, 2.0), detector, curve)
    one = np.ones((1, 8))
    frames = RadiometricCalibration(20 * one, one[None], np.ones(1), 2.0 * one, measured, one, 256)
    numbers = np.full((2, 8), 23)
    found = uncertainty._of_radiance(numbers / 2.0, numbers, frames, Knowledge(), channel)
    shot = 3 / measured if measured else 0.0
    assert found["noise"] == pytest.approx(np.sqrt(16 + shot + 1 / 12) / 2, rel=1e-3)
