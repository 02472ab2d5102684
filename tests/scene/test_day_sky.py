"""The sky at any hour, against the solver run by hand, published figures and calculations."""

import math
import sys

import numpy as np
import pytest

from startrack.catalog import open_sky
from startrack.core import LIGHT_SPEED, PLANCK, Streams, arcsec, deg, installed_tables, nm, um
from startrack.design import replaced_all
from startrack.design.files import load_design
from startrack.earth.atmosphere import Air
from startrack.io import shipped
from startrack.observation import random_attitude, sky_electrons
from startrack.scene import SUN, SUN_G_MINUS_V, WAVELENGTH, DaySky, Scene, illuminate, sky_light
from startrack.scene.air_above import scattered_light, scattered_once, sky_table
from startrack.scene.dusk import dusk_light
from startrack.scene.moonlight import moonlight
from startrack.scene.night import night_light, surface_v
from startrack.scene.photometry import photon_irradiance
from startrack.trial import observe, run_random_trial

BALLOON = shipped("designs/daylight_balloon.toml")


def sky(height=36e3, elevation=45.0, sun=40.0, apart=90.0, **others):
    return DaySky(height, elevation * deg, sun * deg, apart * deg, **others)


def radiance(above: DaySky, *wavelength_nm: float):
    """W / m^2 / sr / um."""
    photons = sky_light(above).background / (10 * nm)
    power = photons * PLANCK * LIGHT_SPEED / WAVELENGTH * um
    return np.interp(np.array(wavelength_nm) * nm, WAVELENGTH, power)


# Height (m), elevation, Sun's elevation and azimuth from it (deg), aerosol, albedo: off the table's
# nodes; those of an aerosol cost six seconds of particles.
PLACES = [
    (0.0, 33.0, 38.0, 70.0, 0.0, 0.2),
    (900.0, 62.0, 17.0, 140.0, 0.0, 0.0),
    (13e3, 24.0, 55.0, 33.0, 0.0, 0.6),
    (37.8e3, 45.0, 47.0, 151.0, 0.0, 0.3),
    (37.8e3, 18.0, 6.0, 105.0, 0.0, 0.9),
    *(
        pytest.param(height, 41.0, sun, azimuth, 1.0, albedo, marks=pytest.mark.slow)
        for height, sun, azimuth, albedo in (
            (0.0, 26.0, 64.0, 0.2),
            (5e3, 52.0, 25.0, 0.4),
            (24e3, 10.0, 170.0, 0.3),
            (37.8e3, 34.0, 167.0, 0.3),
        )
    ),
]


@pytest.mark.parametrize(("height", "elevation", "sun", "azimuth", "aerosol", "albedo"), PLACES)
def test_light_is_that_of_the_solver(height, elevation, sun, azimuth, aerosol, albedo):
    """sasktran2 with twice the streams of the table, at a place between its nodes."""
    pytest.importorskip("sasktran2", reason="the solver needs the extra `earth`")
    sys.path.append(str(shipped("atmosphere")))
    from air_solver import sky_radiance

    up, down = (angle * deg for angle in (elevation, sun))
    apart = math.acos(
        math.sin(up) * math.sin(down) + math.cos(up) * math.cos(down) * math.cos(azimuth * deg)
    )
    above, table = DaySky(height, up, down, apart, aerosol=aerosol, albedo=albedo), sky_table()
    once = scattered_once(table, above, above.sun())
    air, ray = Air("rural", 23e3) if aerosol else None, (math.pi / 2 - up, azimuth * deg, height)
    solved = sky_radiance(air, table.wavelength, math.sin(down), [ray], albedo, streams=16)[:, 0]
    np.testing.assert_allclose(scattered_light(above)[1], solved, rtol=0.02)
    alone = sky_radiance(air, table.wavelength, math.sin(down), [ray], 0.0, False)[:, 0]
    np.testing.assert_allclose(once, alone, rtol=0.03)


def test_thin_air_scatters_as_by_hand():
    """L = E depth P / (4 pi sin(elevation)).

    With 5.75 hPa at 35 km (US 1976), where gravity is 1.3 % less, and a depth of 0.0364 at 700 nm
    and sea level (Bodhaine et al. 1999).
    """
    depth, phase = 0.0364 * 5.746 / 1013.25 * 1.013, 0.75  # at 90 degrees
    by_hand = depth * phase / (4 * math.pi * math.sin(45 * deg))
    above, table = sky(35e3, aerosol=0.0), sky_table()
    once = np.interp(700 * nm, table.wavelength, scattered_once(table, above, above.sun()))
    assert once == pytest.approx(by_hand, rel=0.04)


def test_beside_the_published_sky_of_balloons():
    """Alexander et al. (1999), fig. 4, MODTRAN: the Sun 30 degrees from the zenith, 35 km.

    The paper states neither the elevation nor the ground.
    """
    published = np.array([0.22, 0.10, 0.05, 0.02, 0.01])
    wavelengths = 600, 700, 800, 900, 1000
    above = sky(35e3, 20.0, 60.0, 90.0, aerosol=0.0, albedo=0.3)
    ratio = radiance(above, *wavelengths) / published
    assert ratio.min() > 0.75
    assert ratio.max() < 1.2


def test_stars_are_fainter_through_air():
    """Clear air absorbs 0.10 mag of green light by molecules, 0.03 by ozone (Hayes 1975)."""
    ground, high = (sky_light(sky(height, 90.0, 40.0, 50.0, aerosol=0.0)) for height in (0, 37.8e3))
    green = int(np.argmin(np.abs(WAVELENGTH - 555 * nm)))
    assert -2.5 * math.log10(ground.through[green]) == pytest.approx(0.13, abs=0.02)
    assert -2.5 * math.log10(high.through[green]) < 1e-3


def test_the_sky_darkens_as_the_sun_sets():
    low, level, below = (radiance(sky(sun=sun, apart=90.0), 700)[0] for sun in (5.0, 0.0, -5.0))
    assert low > level > below > 0.01 * low


def test_the_sun_follows_from_date_and_place():
    """The Sun, and its angle from a line of sight, by a low-precision formula at four dates."""
    for date, elevation, azimuth, apart, sun in (
        ("2025-10-01T18:08:00", 44.7, 125, 28, 51.0),
        ("2025-10-01T19:10:00", 44.6, 58, 75, 51.6),
        ("2025-10-01T22:10:00", 44.8, 70, 106, 28.8),
        ("2025-10-02T00:43:00", 45.5, 34, 116, -1.4),
    ):
        above = DaySky(
            37.8e3,
            elevation * deg,
            latitude=34.49 * deg,
            longitude=-104.22 * deg,
            azimuth=azimuth * deg,
        )
        place = above.sun(date)
        assert place.elevation / deg == pytest.approx(sun, abs=0.15)
        assert place.distance / deg == pytest.approx(apart, abs=1.0)
        assert Scene(sky=above, date=date).sky is above


@pytest.mark.slow
@pytest.mark.parametrize(
    ("height", "elevation", "below", "azimuth", "limit"),
    [(0.0, 90.0, 4.0, 0.0, 0.1), (0.0, 45.0, 7.5, 60.0, 0.1), (12e3, 30.0, 6.0, 120.0, 0.1)],
)
def test_twilight_is_that_of_the_solver(height, elevation, below, azimuth, limit):
    """A single line of sight with more columns of air, at places between the nodes of the table."""
    pytest.importorskip("sasktran2", reason="the solver needs the extra `earth`")
    sys.path.append(str(shipped("atmosphere")))
    from air_solver import dusk_radiance

    up, down = elevation * deg, -below * deg
    apart = math.acos(
        math.sin(up) * math.sin(down) + math.cos(up) * math.cos(down) * math.cos(azimuth * deg)
    )
    above, table = DaySky(height, up, down, apart, aerosol=0.0, albedo=0.3), sky_table()
    few = np.array([3, 5])  # 450 and 550 nm, where no gas but ozone absorbs
    ray = (math.pi / 2 - up, azimuth * deg, height)
    solved = dusk_radiance(table.wavelength[few], math.sin(down), [ray], 0.3, columns=13)
    found = np.interp(table.wavelength[few], WAVELENGTH, dusk_light(table, above, above.sun()))
    np.testing.assert_allclose(found, solved[:, 0], rtol=limit)


# Patat, Ugolnikov and Postylyakov (2006), A&A 455, 385, table 1: magnitudes per square arcsecond of
# the zenith of Paranal (2,635 m) at a Sun's zenith distance of 95 to 105 degrees, in powers of its
# excess over 95; with the middle and width (nm) of the band, and the Sun's colour, band - V.
PARANAL = {
    "B": ((11.84, 1.411, -0.041), (436, 94), 0.65),
    "V": ((11.84, 1.518, -0.057), (551, 88), 0.0),
    "R": ((11.40, 1.567, -0.064), (640, 150), -0.36),
    "I": ((10.93, 1.470, -0.062), (800, 150), -0.70),
}


def magnitude(light, band):
    """Magnitude per square arcsecond, with a Gaussian as the response of the band."""
    _, (middle, width), colour = PARANAL[band]
    bell = np.exp(-4 * math.log(2) * ((WAVELENGTH / nm - middle) / width) ** 2)
    star = photon_irradiance(np.array([SUN_G_MINUS_V]), np.array([SUN]))[0]
    return -2.5 * math.log10(light @ bell * arcsec**2 / (star @ bell)) + colour


@pytest.mark.parametrize("band", PARANAL)
def test_twilight_is_that_of_paranal(band):
    """In clean air; the fits are valid within 0.1 to 0.4 mag."""
    for below in (5.0, 6.0, 7.0, 8.0, 9.0, 10.0):
        above = sky(2635.0, 90.0, -below, 90.0 + below, aerosol=0.3)
        fit = sum(part * (below - 5) ** n for n, part in enumerate(PARANAL[band][0]))
        assert magnitude(sky_light(above).background, band) == pytest.approx(fit, abs=0.6), below


@pytest.mark.parametrize(("band", "seen"), [("B", 22.6), ("V", 21.6), ("R", 20.9), ("I", 19.7)])
def test_night_is_that_of_paranal(band, seen):
    """Patat (2003), A&A 400, 1183: means of dark time at the zenith, at the Sun's maximum."""
    above = sky(2635.0, 90.0, -40.0, 130.0)
    assert magnitude(sky_light(above).background, band) == pytest.approx(seen, abs=0.3)


def test_a_measured_night_replaces_the_natural_one():
    natural, city = (
        sky_light(sky(0.0, 90.0, -40.0, 130.0, night_v=night_v)).background
        for night_v in (None, 18.0)
    )
    assert surface_v(city) == pytest.approx(18.0, abs=0.01)
    np.testing.assert_allclose(city / natural, (city / natural)[0], rtol=1e-3)


def test_the_sky_is_continuous_where_the_sun_sets():
    for height, elevation, apart in ((0.0, 60.0, 75.0), (12e3, 30.0, 100.0), (36e3, 45.0, 120.0)):
        before, after = (
            sky_light(sky(height, elevation, sun, apart)).background for sun in (1e-6, -1e-6)
        )
        between_bands = (450 * nm < WAVELENGTH) & (650 * nm > WAVELENGTH)
        np.testing.assert_allclose(after[between_bands], before[between_bands], rtol=0.25)


def test_moonlight_is_that_of_a_published_formula():
    """Krisciunas and Schaefer (1991), eqs. 15 to 21, good to 8 to 23 %; k in mag an air mass.

    Full Moon of 24 November 2026 at 22:00 UTC, 63 degrees above the horizon.
    """
    date, place = "2026-11-24T22:00:00", {"latitude": 48.1 * deg, "longitude": 11.6 * deg}
    for height, aerosol in ((4200.0, 0.5), (500.0, 0.5)):
        for azimuth, elevation in ((60.0, 50.0), (0.0, 70.0), (300.0, 40.0)):
            above = DaySky(height, elevation * deg, azimuth=azimuth * deg, aerosol=aerosol, **place)
            moon, _ = moonlight(above, date)
            light = sky_light(above, date)
            mass, moon_mass = (
                (1 - 0.96 * math.cos(up) ** 2) ** -0.5 for up in (above.elevation, moon.elevation)
            )
            k = -2.5 * math.log10(np.interp(551 * nm, WAVELENGTH, light.through)) / mass
            angle = moon.distance / deg
            scatter = 10**5.36 * (1.06 + math.cos(moon.distance) ** 2) + 10 ** (6.15 - angle / 40)
            bright = 10 ** (-0.4 * 3.84) * scatter * 10 ** (-0.4 * k * moon_mass)
            nanolambert = bright * (1 - 10 ** (-0.4 * k * mass))
            published = (20.7233 - math.log(nanolambert / 34.08)) / 0.92104
            alone = surface_v(light.background - night_light(above))
            assert alone == pytest.approx(published, abs=0.4), (height, azimuth)


def test_the_moon_is_where_astropy_sees_it():
    from astropy import units
    from astropy.coordinates import AltAz, EarthLocation, get_body
    from astropy.time import Time

    date, latitude, longitude = "2026-11-21T20:00:00", 35 * deg, -104 * deg
    above = DaySky(0.0, 45 * deg, latitude=latitude, longitude=longitude, azimuth=1.0)
    with installed_tables():
        site = EarthLocation.from_geodetic(longitude * units.rad, latitude * units.rad, 0 * units.m)
        seen = get_body("moon", Time(date), site).transform_to(AltAz(location=site))
        elevation, azimuth = seen.alt.rad, seen.az.rad
    line = math.sin(1.0), math.cos(1.0)
    apart = math.acos(
        math.sin(45 * deg) * math.sin(elevation)
        + math.cos(45 * deg)
        * math.cos(elevation)
        * (line[0] * math.sin(azimuth) + line[1] * math.cos(azimuth))
    )
    place, _ = moonlight(above, date)
    assert place.elevation == pytest.approx(elevation, abs=0.3 * deg)
    assert place.distance == pytest.approx(apart, abs=0.3 * deg)


def test_refraction():
    """57.2 arcsec at 45 degrees of true elevation in dry air of 15 degC, by ERFA's refco."""
    assert sky(0.0).refraction() / arcsec == pytest.approx(57.2, abs=0.2)
    assert sky(36e3).refraction() / arcsec < 0.5
    assert sky(0.0, 90.0, 40.0, 50.0).refraction() == pytest.approx(0.0, abs=0.2 * arcsec)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"height": 41e3}, "height must lie in"),
        ({"elevation": 5.0}, "elevation must lie in"),
        ({"apart": 3.0}, r"sun_distance must lie in \[5, 95\] deg"),
        ({"latitude": 0.1}, "not some of both"),
        ({"aerosol": 3.0}, "aerosol must lie in"),
        ({"night_v": 10.0}, r"night_v must lie in \[12, 26\]"),
    ],
)
def test_what_is_not_modelled_is_refused(values, says):
    with pytest.raises(ValueError, match=says):
        sky(**values)


@pytest.mark.parametrize(
    ("beside", "says"),
    [
        ({"background_g": 20.0}, "background_g must be left out if sky"),
        ({"lights": ("starlight",)}, "lights must be left out if sky"),
        ({"days": 1.0, "date": "2025-10-01"}, "days must be left out if sky"),
    ],
)
def test_a_sky_stands_alone(beside, says):
    with pytest.raises(ValueError, match=says):
        Scene(sky=sky(), **beside)


def test_a_place_needs_its_date():
    above = DaySky(37.8e3, 45 * deg, latitude=0.6, longitude=-1.8, azimuth=1.0)
    with pytest.raises(ValueError, match="date must be given"):
        Scene(sky=above)
    assert Scene(sky=above, date="2025-10-01T07:00:00").sky is above


def test_stray_light_adds_to_it():
    scene, dark = Scene(sky=sky()), open_sky(load_design(BALLOON).case.catalog).stars[:0]
    none = illuminate(scene, dark).background
    more = illuminate(scene.with_stray_light(5.0), dark).background
    alone = illuminate(Scene(background_g=5.0), dark).background
    np.testing.assert_allclose(more, none + alone)


@pytest.mark.slow
def test_frames_windows_and_the_formula_have_the_same_sky():
    night = load_design(shipped("designs/noise_only.toml")).case
    case = replaced_all(night, {"scene": Scene(sky=sky()), "instrument.detector.exposure": 2e-3})
    streams, detector = Streams(1, 0), case.instrument.detector
    frame = observe(case, random_attitude(streams), streams).frame
    level = (np.median(frame.image) - detector.offset) * detector.electrons_per_dn
    dark = detector.dark_current * detector.exposure
    assert sky_electrons(case) > 1000
    assert level == pytest.approx(sky_electrons(case) + dark, rel=0.01)
    outcomes = [run_random_trial(case, 1, 0, fidelity) for fidelity in ("frame", "window")]
    assert outcomes[0].stars == outcomes[1].stars
