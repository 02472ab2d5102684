"""The sky by day, against the solver driven by hand, published figures and hand calculations."""

import math
import sys

import numpy as np
import pytest

from startrack.catalog import open_sky
from startrack.core import LIGHT_SPEED, PLANCK, Streams, arcsec, deg, nm, um
from startrack.design import replaced_all
from startrack.design.files import load_design
from startrack.earth.atmosphere import Air
from startrack.io import shipped
from startrack.observation import random_attitude, sky_electrons
from startrack.scene import WAVELENGTH, DaySky, Scene, illuminate, sky_light
from startrack.scene.air_above import _table, scattered_light, scattered_once
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
    above, table = DaySky(height, up, down, apart, aerosol=aerosol, albedo=albedo), _table()
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
    above, table = sky(35e3, aerosol=0.0), _table()
    once = np.interp(700 * nm, table.wavelength, scattered_once(table, above, above.sun()))
    assert once == pytest.approx(by_hand, rel=0.04)


def test_beside_the_published_sky_of_balloons():
    """Alexander et al. (1999), fig. 4, MODTRAN: the Sun 30 degrees from the zenith, 35 km.

    They do not say at which elevation, nor over which ground.
    """
    published = np.array([0.22, 0.10, 0.05, 0.02, 0.01])
    wavelengths = 600, 700, 800, 900, 1000
    above = sky(35e3, 20.0, 60.0, 90.0, aerosol=0.0, albedo=0.3)
    ratio = radiance(above, *wavelengths) / published
    assert ratio.min() > 0.75
    assert ratio.max() < 1.2


def test_stars_are_fainter_through_air():
    """Clear air takes 0.10 mag of green light by molecules, 0.03 by ozone (Hayes 1975)."""
    ground, high = (sky_light(sky(height, 90.0, 40.0, 50.0, aerosol=0.0)) for height in (0, 37.8e3))
    green = int(np.argmin(np.abs(WAVELENGTH - 555 * nm)))
    assert -2.5 * math.log10(ground.through[green]) == pytest.approx(0.13, abs=0.02)
    assert -2.5 * math.log10(high.through[green]) < 1e-3


def test_the_sky_darkens_as_the_sun_sets():
    low, level, below = (radiance(sky(sun=sun, apart=90.0), 700)[0] for sun in (5.0, 0.0, -5.0))
    assert low > level > below > 0.01 * low


def test_the_sun_follows_from_date_and_place():
    """The Sun, and its distance from a line of sight, by a low-precision formula at four dates."""
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


def test_refraction():
    """Saemundsson's formula gives 1.0 arcmin at 45 degrees at the ground."""
    assert sky(0.0).refraction() / arcsec == pytest.approx(60, abs=2)
    assert sky(36e3).refraction() / arcsec < 0.5
    assert sky(0.0, 90.0, 40.0, 50.0).refraction() == pytest.approx(0.0, abs=0.2 * arcsec)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"sun": -7.0}, "twilight and night are not modelled, got -7 deg"),
        ({"height": 0.0, "sun": -1.0}, "at least -0.00 deg"),
        ({"height": 41e3}, "height must lie in"),
        ({"elevation": 5.0}, "elevation must lie in"),
        ({"apart": 3.0}, r"sun_distance must lie in \[5, 95\] deg"),
        ({"latitude": 0.1}, "not some of both"),
        ({"aerosol": 3.0}, "aerosol must lie in"),
    ],
)
def test_what_is_not_modelled_is_refused(values, says):
    with pytest.raises(ValueError, match=says):
        sky(**values)


@pytest.mark.parametrize(
    ("beside", "says"),
    [
        ({"background_g": 20.0}, "background_g must be left out beside sky"),
        ({"lights": ("starlight",)}, "lights must be left out beside sky"),
        ({"days": 1.0, "date": "2025-10-01"}, "days must be left out beside sky"),
    ],
)
def test_a_sky_stands_alone(beside, says):
    with pytest.raises(ValueError, match=says):
        Scene(sky=sky(), **beside)


def test_a_place_needs_its_date():
    above = DaySky(37.8e3, 45 * deg, latitude=0.6, longitude=-1.8, azimuth=1.0)
    with pytest.raises(ValueError, match="date must be given"):
        Scene(sky=above)
    with pytest.raises(ValueError, match="twilight and night"):
        Scene(sky=above, date="2025-10-01T07:00:00")


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
