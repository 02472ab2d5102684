"""An Earth camera's image: equations (4) and (5) by hand, blur, noise, fires, the command."""

import json
import math
from contextlib import redirect_stdout
from dataclasses import replace
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from startrack.cli.main import main
from startrack.core import Curve
from startrack.core.units import deg, nm, um
from startrack.detector import Detector, Scan
from startrack.detector.stamp import stamp
from startrack.earth.atmosphere import Air
from startrack.earth.geometry import Aircraft, Pointing, ground_rate, observe_earth
from startrack.earth.geometry.scene import Fractal, Terrain
from startrack.earth.imager import (
    Channel,
    Imager,
    Picture,
    Survey,
    cameras,
    load_imager,
    load_survey,
    misregistration,
    prepare,
    render,
)
from startrack.earth.imager.band import band_of
from startrack.earth.imager.land import Cover, HotSpot, Land, reflectance
from startrack.earth.imager.lens import blur_strips, blur_weights
from startrack.io import shipped
from startrack.motion import Broadband, Motion, Tone
from startrack.optics import Aberration, Optics, pixel_psf

from ..terrain.scenes import CAMERA, SCENE

PLANCK_TIMES_C = 1.98644586e-25  # J m, CODATA 2018
EPOCH = "2026-06-21T10:00:00"
FLAT = Terrain(fractal=Fractal(10 * deg, 47 * deg, 20.0, 64, 1e-3), highest=100.0, lowest=-10.0)
SCAN = Detector(
    40,
    40,
    10e-6,
    1e-3,
    Curve((), (0.5,)),
    fill_factor=0.8,
    full_well=1e6,
    bits=12,
    offset=10,
    pixel_rate=1e6,
)


def flat_band(low: float, high: float) -> Curve:
    return Curve((low - 1 * nm, low, high, high + 1 * nm), (0.0, 1.0, 1.0, 0.0))


def channel(band: Curve, detector: Detector = SCAN, **optics) -> Channel:
    optics = {"blur": 3e-6, "psf": "airy"} | optics
    lens = Optics(0.1, 4.0, transmission=Curve((), (0.9,)), **optics)
    return Channel("one", lens, replace(detector, scan=Scan()), band)


def survey(one: Channel, land: Land | None = None, air: Air | None = None, **rest) -> Survey:
    plane = Aircraft(EPOCH, 10 * deg, 47 * deg, 3e3, speed=100.0)
    return Survey(
        Imager((one,)), FLAT, aircraft=plane, land=land or Land(lapse=0.0), air=air, **rest
    )


def rendered(one: Survey, folder, seed: int = 1) -> Picture:
    channel = one.channels[0]
    picture = Picture.blank(channel.detector.rows, channel.columns)
    render(one, channel, folder, seed, picture)
    return picture


def middle(picture: Picture) -> tuple[float, float]:
    return picture.longitude[20, 20] * deg, picture.latitude[20, 20] * deg


def test_electrons_and_numbers_by_hand(tmp_path):
    """A blackbody of 300 K in 10.0 to 10.2 um, without air: (4) and (5) with all units."""
    one = channel(flat_band(10.0 * um, 10.2 * um), psf="gaussian")
    land = Land((Cover(Curve((), (0.0,)), 300.0),), lapse=0.0)
    picture = rendered(survey(one, land), tmp_path)
    # Radiation constants of CODATA 2018: 1.191042972e8 W um^4 / m^2 / sr and 14387.7688 um K.
    radiance = 1.191042972e14 / 10.1**5 / (math.exp(14387.7688 / 10.1 / 300) - 1)
    np.testing.assert_allclose(picture.terms.emitted, radiance * um, rtol=1e-3)
    power = math.pi / 4 / 4**2 * (10e-6) ** 2 * radiance * 0.201e-6 * 0.9  # W, flanks included
    electrons = power / (PLANCK_TIMES_C / 10.1e-6) * 0.5 * 0.8 * 1e-3
    number = electrons * 4095 / 1e6 + 10
    assert picture.numbers.mean() == pytest.approx(number, rel=3e-3)
    spread = math.sqrt((electrons * (4095 / 1e6) ** 2) + 1 / 12)
    assert picture.numbers.std() == pytest.approx(spread, rel=0.1)


def test_terms_are_the_sum_that_becomes_numbers(tmp_path):
    one = channel(flat_band(500 * nm, 600 * nm), replace(SCAN, read_noise=0.0))
    seen = survey(one, air=Air())
    picture = rendered(seen, tmp_path)
    setting = prepare(seen, one, tmp_path)
    total = sum(each.mean() for each in picture.terms)
    number = total / um * setting.electrons * 4095 / 1e6 + 10
    assert picture.numbers.mean() == pytest.approx(number, rel=2e-3)
    assert picture.terms.scattered.min() > 0
    assert picture.terms.emitted.max() == 0
    assert setting.surroundings == pytest.approx(0.2)


def test_the_same_seed_gives_the_same_picture(tmp_path):
    one = survey(channel(flat_band(500 * nm, 600 * nm)))
    first, again, other = (rendered(one, tmp_path, seed).numbers for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.3


def test_an_edge_is_as_sharp_as_the_transfer_function_says(tmp_path):
    """Modulation of a bar pattern at a quarter cycle a pixel, against the PSF's own transform."""
    from startrack.optics import modulation

    optics = Optics(0.1, 4.0, blur=4e-6, psf="airy")
    psf = pixel_psf(optics, 10e-6, np.array([550 * nm]), np.ones(1))
    weights = blur_weights(psf, 4, 1.0, 1.0, 0.0)
    place = np.arange(64)[:, None] + (np.arange(4) + 0.5) / 4 - 0.5
    wave = 1 + np.cos(2 * np.pi * 0.25 * place)  # (columns, rays across)
    rays = np.broadcast_to(wave[None, :, None, :], (64, 64, 4, 4)).reshape(64, 64, 16)
    image = np.concatenate(list(blur_strips(iter([rays[:20], rays[20:]]), weights)))
    assert image.shape == (64, 64)
    middle = image[20:40, 16:48]
    contrast = np.abs((middle * np.exp(-2j * np.pi * 0.25 * np.arange(16, 48))).mean(1)) * 2
    expected = modulation(psf, np.array([0.25]), 0.0)[0] / psf.energy
    np.testing.assert_allclose(contrast, expected, rtol=0.02)


def test_the_tail_of_coma_lies_where_the_optics_put_it():
    """The middle ray of one pixel, against the star that the detector's stamp would place."""
    optics = Optics(0.1, 4.0, psf="fraunhofer", aberrations=(Aberration(8, 80 * nm),))
    psf = pixel_psf(optics, 2.2e-6, np.array([550 * nm]), np.ones(1))
    rays = np.zeros((41, 41, 9), np.float32)
    rays[20, 20, 4] = 9.0
    image = np.concatenate(list(blur_strips(iter([rays]), blur_weights(psf, 3, 1.0, 1.0, 0.0))))
    wanted = np.zeros((41, 41))
    stamp(wanted, psf, np.full(1, 20.0), np.full(1, 20.0), np.ones(1))
    assert np.arange(41) @ wanted.sum(0) / wanted.sum() > 20.5
    np.testing.assert_allclose(image, wanted, atol=0.02 * wanted.max())


def test_strips_do_not_show():
    psf = pixel_psf(Optics(0.1, 4.0, psf="airy"), 10e-6, np.array([550 * nm]), np.ones(1))
    weights = blur_weights(psf, 2, 1.0, 1.0, 0.5)
    rays = np.random.default_rng(1).random((50, 30, 4)).astype(np.float32)
    whole = np.concatenate(list(blur_strips(iter([rays]), weights)))
    parts = np.concatenate(list(blur_strips(iter([rays[:1], rays[1:9], rays[9:]]), weights)))
    np.testing.assert_allclose(parts, whole, rtol=1e-5)
    np.testing.assert_allclose(weights.sum(), 1.0)


def test_channels_have_noise_of_their_own(tmp_path):
    """Two equal channels over uniform ground, 1,600 pixels: a correlation of about 0.025, not 1."""
    one = channel(flat_band(500 * nm, 600 * nm), replace(SCAN, read_noise=2000.0))
    pair = replace(survey(one), camera=Imager((one, replace(one, name="two"))))
    noise = []
    for each in pair.channels:
        picture = Picture.blank(40, 40)
        render(pair, each, tmp_path, 1, picture)
        noise.append(picture.numbers.ravel())
    assert abs(np.corrcoef(noise)[0, 1]) < 0.12  # 1e-6 of false alarms


@pytest.mark.parametrize("rays", [1, 2, 3])
def test_the_place_of_a_pixel_is_its_middle(tmp_path, rays):
    """For any number of rays, within a hundredth of a pixel of 0.3 m."""
    one = channel(flat_band(500 * nm, 600 * nm))
    single, several = (rendered(survey(one, rays=n), tmp_path) for n in (1, rays))
    north = (several.latitude - single.latitude) * deg * 6.37e6
    east = (several.longitude - single.longitude) * deg * 6.37e6 * math.cos(47 * deg)
    assert np.hypot(north, east).max() < 3e-3


@pytest.mark.parametrize("kind", ["line", "staggered", "matrix"])
@pytest.mark.parametrize(
    ("columns", "lines"), [pytest.param(40, 240, marks=pytest.mark.slow), (240, 40)]
)
def test_the_surroundings_are_what_the_image_shows(tmp_path, kind, columns, lines):
    """A few rays over hills of two covers have the mean of all pixels."""
    hills = Terrain(fractal=Fractal(10 * deg, 47 * deg, 5.0, 128, 100.0), highest=150, lowest=-10)
    land = Land((Cover(), Cover(Curve((), (0.9,)), above=50.0)))
    detector = replace(
        SCAN,
        columns=columns,
        rows=lines,
        pixel_pitch=50e-6,
        scan=None if kind == "matrix" else Scan(kind),
    )
    one = replace(channel(flat_band(500 * nm, 600 * nm)), detector=detector)
    seen = replace(survey(one, land, rays=1), terrain=hills)
    setting = prepare(seen, one, tmp_path)
    band = setting.band.wavelength, setting.band.weight
    shown = [reflectance(land, s.ground, *band) for s in observe_earth(seen.scene(one), tmp_path)]
    assert setting.surroundings == pytest.approx(np.concatenate(shown).mean(), abs=0.03)


def test_the_air_of_an_aircraft_is_that_between_it_and_the_ground(tmp_path):
    """At 3 km above the sea and 1 to 2 km above hills, only the air between camera and hills
    counts."""
    hills = Terrain(fractal=Fractal(10 * deg, 47 * deg, 5.0, 128, 2500.0), highest=2500.0)
    one = channel(flat_band(500 * nm, 600 * nm))
    seen = replace(survey(one, air=Air(), rays=1), terrain=hills)
    (strip,) = observe_earth(seen.scene(one), tmp_path)
    above = 3000 - float(strip.ground.height.mean())
    wanted = band_of(one, Air(), above, 1.0).table.path
    found = prepare(seen, one, tmp_path).band.table.path
    np.testing.assert_allclose(found, wanted, rtol=0.02)
    assert (band_of(one, Air(), 3e3, 1.0).table.path[0] > 1.2 * wanted[0]).all()


def test_lines_that_look_ahead_see_the_same_ground(tmp_path):
    """A camera pitched by 15 degrees with a channel 20 degrees ahead: within 10 of 1,100 m."""
    one = channel(flat_band(500 * nm, 600 * nm))
    pair = Imager((one, replace(one, name="ahead", forwards=20 * deg)))
    seen = replace(survey(one), camera=pair, pointing=Pointing(pitch=15 * deg))
    places = []
    for each in seen.channels:
        (strip,) = observe_earth(seen.scene(each), tmp_path)
        places.append(strip.mean(strip.ground.point[:, 2])[20, 20])
    assert abs(places[0] - places[1]) < 10


def test_a_fire_on_ground_without_heat_burns(tmp_path):
    """Ground of 60 K, as on the Moon's night side, emits no light at 1.6 um: all light is the
    fire's."""
    one = channel(flat_band(1.55 * um, 1.65 * um))
    place = middle(rendered(survey(one), tmp_path))
    night = Cover(Curve((), (0.0,)), 60.0)
    land = Land((night,), lapse=0.0, hot_spots=(HotSpot(*place, 1.0, 900.0),))
    emitted = rendered(survey(one, land), tmp_path).terms.emitted.astype(float)
    heat = band_of(one, None, 3e3, 1.0).heat
    assert heat is not None
    flame = heat(np.array([900.0]))[0, 0] * um
    assert emitted.sum() * 0.3**2 / flame == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"surroundings": 1.2}, r"surroundings must lie in \[0, 1\], got 1.2"),
        ({"sky_rays": -1}, "sky_rays must be a whole number"),
        ({"aircraft": None, "tle": ("1 one",)}, "tle must be two lines, got 1"),
        ({"aircraft": None}, "one of orbit, tle and aircraft must be given"),
    ],
)
def test_surveys_that_cannot_be(change, words):
    with pytest.raises(ValueError, match=words):
        replace(survey(channel(flat_band(500 * nm, 600 * nm))), **change)


def test_what_no_picture_would_show_is_refused():
    one = channel(flat_band(500 * nm, 600 * nm))
    with pytest.raises(
        ValueError, match=r"optics.k1 must be left out: .* do not simulate it, got -0.1"
    ):
        replace(one, optics=replace(one.optics, k1=-0.1))
    with pytest.raises(ValueError, match=r"detector.crosstalk must be left out: .*, got 0.02"):
        replace(one, detector=replace(one.detector, crosstalk=0.02))


@pytest.mark.parametrize(("area", "fraction"), [(1.0, None), (400.0, 1.0)])
def test_a_fire_keeps_its_power_however_small(tmp_path, area, fraction):
    """Pixels are 0.3 m: the burning parts add up to the fire's area, or fill the pixel."""
    one = channel(flat_band(3.6 * um, 4.0 * um))
    cold = rendered(survey(one, Land(lapse=0.0)), tmp_path)
    spot = HotSpot(*middle(cold), area, 900.0)
    hot = rendered(survey(one, Land(lapse=0.0, hot_spots=(spot,))), tmp_path)
    added = (hot.terms.emitted - cold.terms.emitted).astype(float)
    heat = band_of(one, None, 3e3, 1.0).heat
    assert heat is not None
    flame = heat(np.array([900.0]))[0, 0] * um
    if fraction is None:
        assert added.sum() * 0.3**2 / flame == pytest.approx(area, rel=0.05)
    else:
        assert added.max() / flame == pytest.approx(fraction, rel=0.01)


def test_a_hot_spot_saturates_a_photodiode_at_its_well(tmp_path):
    one = channel(flat_band(3.6 * um, 4.0 * um))
    place = middle(rendered(survey(one), tmp_path))
    land = Land(lapse=0.0, hot_spots=(HotSpot(*place, 1.0, 2000.0),))
    numbers = rendered(survey(one, land), tmp_path).numbers
    assert numbers.max() == 4095
    assert 1 <= (numbers == 4095).sum() < 200
    assert np.median(numbers) < 100


def looking(roll: float) -> Survey:
    one = survey(channel(flat_band(9.8 * um, 10.2 * um), psf="gaussian"), air=Air())
    return replace(one, pointing=replace(one.pointing, roll=roll))


def test_the_sky_is_dark_and_grazing_sight_is_refused(tmp_path):
    picture = rendered(looking(100 * deg), tmp_path)
    assert not any(term.any() for term in picture.terms)
    assert np.isnan(picture.longitude).all()
    with pytest.raises(ValueError, match="sensor must lie in the table's"):
        rendered(looking(75 * deg), tmp_path)


@pytest.mark.parametrize("name", ["waoss", "hsrs", "mertis", "ads40"])
def test_published_cameras_and_their_scenes_load(name):
    assert name in cameras()
    seen = load_survey(shipped(f"scenes/{name}.toml"))
    assert seen.camera == load_imager(name)
    for each in seen.channels:
        assert each.columns <= seen.columns if seen.columns else True
        assert band_of(each, seen.air, 300e3, seen.distance_to_sun).electrons > 0


def test_what_a_file_must_not_say(tmp_path, capsys):
    text = shipped("scenes/hsrs.toml").read_text()
    wrong = {
        'camera = "hsrs"': ('camera = "hrsc"', "camera must be one of"),
        "[land]": ("[land]\nwarmth = 3", "land.warmth is unknown"),
    }
    for old, (new, sentence) in wrong.items():
        path = tmp_path / "scene.toml"
        path.write_text(text.replace(old, new, 1))
        assert main(["earth", "render", str(path), "--out", str(tmp_path / "out")]) == 2
        assert sentence in capsys.readouterr().err
    assert main(["earth", "render", str(tmp_path / "none.toml")]) == 2


def test_air_that_no_table_has_is_refused():
    one = channel(flat_band(500 * nm, 600 * nm))
    for air in (Air("urban", visibility=20e3), Air("none", visibility=50e3), Air(visibility=4e3)):
        with pytest.raises(ValueError, match="air must be none, rural from 5 to 150 km, or urban"):
            band_of(one, air, 3e3, 1.0)
    with pytest.raises(ValueError, match="must lie in the air's table"):
        band_of(channel(flat_band(10 * um, 16 * um)), Air(), 3e3, 1.0)


def test_channels_that_look_ahead_do_not_register_in_jitter(tmp_path):
    """A tone of sqrt(2) rms a seen twice, tau apart, differs by 2 a |sin(pi f tau)| rms.

    The ground of each line is displaced by the height times its angle, across the track for the
    axis along the columns.
    """
    tone, height = Tone(3.0, rms_y=2e-4, phase=0.3), 3e3
    one = channel(flat_band(500 * nm, 600 * nm), replace(SCAN, rows=300))
    ahead = replace(one, name="ahead", forwards=5 * deg, period=8e-3)
    still = survey(replace(one, period=8e-3))
    still = replace(still, camera=Imager((still.camera.channels[0], ahead)))
    moved = replace(still, motion=Motion(tones=(tone,)))
    tau = math.tan(5 * deg) / ground_rate(still.carrier)
    rms = 2 * 2e-4 * abs(math.sin(math.pi * tone.frequency * tau)) / 1e-4  # pixel of 1e-4 rad
    across, along = misregistration(moved, moved.channels[1], 1)
    assert misregistration(moved, moved.channels[0], 1) == (0, 0)
    assert across == pytest.approx(rms, rel=0.05)  # not a whole number of periods
    assert along == 0

    places = []
    for seen in (still, moved):
        picture = Picture.blank(300, 40)
        render(seen, seen.channels[0], tmp_path, 1, picture)
        places.append(np.stack([picture.longitude, picture.latitude])[:, :, 20] * deg)
    off = places[1] - places[0]
    metres = np.hypot(off[0] * math.cos(47 * deg), off[1]) * 6.38e6
    time = (np.arange(300) - 149.5) * 8e-3
    angle = math.sqrt(2) * 2e-4 * (np.cos(6 * math.pi * time + 0.3) - math.cos(0.3))
    np.testing.assert_allclose(metres, height * np.abs(angle), atol=0.01)


def test_fast_jitter_blurs(tmp_path):
    """Far above the line rate the blur is a Gaussian of the jitter's rms times the focal length."""
    one = channel(flat_band(500 * nm, 600 * nm))
    fast = tuple(Broadband(axis, (2e4, 4e4), (2e-14, 2e-14)) for axis in "xy")
    shaken = survey(one, motion=Motion(broadband=fast))  # 2e-5 rad rms about each
    setting = prepare(shaken, one, tmp_path)
    expected = replace(one, optics=replace(one.optics, blur=math.hypot(3e-6, 2e-5 * 0.1)))
    np.testing.assert_allclose(
        setting.psf.table, prepare(survey(expected), expected, tmp_path).psf.table, atol=1e-4
    )


@pytest.fixture(scope="module")
def commanded(tmp_path_factory) -> Path:
    """The files that the command writes for a small scene; with a GeoTIFF if rasterio is
    installed."""
    folder = tmp_path_factory.mktemp("rendered")
    (folder / "scene.toml").write_text(SCENE)
    (folder / "small.toml").write_text(CAMERA)
    tied = ["--geotiff"] if find_spec("rasterio") else []
    command = ["earth", "render", str(folder / "scene.toml"), "--out", str(folder), "--json", *tied]
    with redirect_stdout(StringIO()) as printed:
        assert main(command) == 0
    (folder / "told.json").write_text(printed.getvalue())
    return folder


def test_the_command_leaves_a_picture_and_its_terms(commanded):
    told = json.loads((commanded / "told.json").read_text())
    assert told["channel"] == "green"
    assert told["seen"] == 1
    with fits.open(commanded / "green.fits") as parts:
        parts.verify("exception")
        assert parts[0].data.shape == (30, 24)
        assert parts[0].data.mean() == pytest.approx(told["number_mean"])
        for name in ("direct", "indirect", "scattered", "emitted", "thermal"):
            assert parts[name].header["BUNIT"] == "W m-2 sr-1 um-1"
            assert parts[name].data.mean() == pytest.approx(told["radiance"][name], rel=1e-5)
        assert abs(parts["longitude"].data.mean() - 10) < 0.01
    assert (commanded / "green.png").stat().st_size > 20_000


def test_geotiff_is_tied_to_the_ground(commanded):
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(commanded / "green.tif") as file:
        points, system = file.gcps
        assert file.count == 6
        assert system.to_epsg() == 4326
        assert len(points) == 81
        assert all(abs(point.y - 47) < 0.01 for point in points)
