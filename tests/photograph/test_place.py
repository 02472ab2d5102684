"""Places and times of photographs, against astropy's observed places of the same stars."""

import erfa
import numpy as np
import pytest
from astropy import units
from astropy.coordinates import AltAz, EarthLocation, SkyCoord
from astropy.time import Time
from scipy.spatial.transform import Rotation

from startrack.core import (
    Camera,
    Estimate,
    FieldPolynomial,
    Matches,
    Refused,
    Status,
    arcsec,
    deg,
    installed_tables,
)
from startrack.photograph import Photograph, PhotographView, Site, place_photograph
from startrack.space import refraction
from tests.identification.conftest import make_spots

HEIGHT = 650.0
SITE = Site(47.3 * deg, 11.4 * deg, "2026-03-01T21:30:00", HEIGHT)
# Of the U.S. Standard Atmosphere 1976 there.
CELSIUS = 15 - 6.5e-3 * HEIGHT
HECTOPASCAL = 1013.25 * (1 - 6.5e-3 * HEIGHT / 288.15) ** 5.25588
CALIBRATED = Camera(
    1280, 960, 2659.0, 25.7, -44.8, k1=-0.0465, k2=0.667, p1=1e-3,
    polynomial=FieldPolynomial((0.0, 0.0, 2e-3), (1e-3,)),
)  # fmt: skip
UNKNOWN = Camera(1280, 960, 2659.0, k1=-0.0465)
NOISE = 0.05  # pixel


def observed(direction, hectopascal=HECTOPASCAL):
    """Azimuth and elevation of catalogue directions, radian, by astropy."""
    place = EarthLocation.from_geodetic(11.4 * units.deg, 47.3 * units.deg, HEIGHT * units.m)
    frame = AltAz(
        obstime=Time(SITE.time),
        location=place,
        pressure=hectopascal * units.hPa,
        temperature=CELSIUS * units.deg_C,
        relative_humidity=0,
        obswl=0.55 * units.um,
    )
    with installed_tables():
        seen = SkyCoord(*direction.T, representation_type="cartesian", frame="icrs")
        there = seen.transform_to(frame)
    return there.az.rad, there.alt.rad


def on_horizon(azimuth, elevation):
    """Unit vectors towards east, north and up."""
    level = np.cos(elevation)
    return np.stack([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)], -1)


def random_directions(rng, count):
    direction = rng.normal(size=(count, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def test_stars_are_seen_where_astropy_has_them():
    direction = random_directions(np.random.default_rng(1), 3000)
    azimuth, elevation = observed(direction)
    high = elevation > 15 * deg
    east, north, up = (SITE.seen(direction[high]) @ SITE.axes).T
    apart = (np.arctan2(east, north) - azimuth[high] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(apart * np.cos(elevation[high])).max() < 0.02 * arcsec
    assert np.abs(np.arcsin(up) - elevation[high]).max() < 0.3 * arcsec


def test_refraction_beside_other_programs():
    """Against ERFA's dry air, and at the horizon against Allen's 34 arcmin at 10 degC."""
    for height, hectopascal, celsius in ((0.0, 1013.25, 15.0), (2600.0, 738.0, -1.9)):
        a, b = erfa.refco(hectopascal, celsius, 0, 0.55)
        for elevation in (15, 20, 30, 45, 60, 80):
            tangent = np.tan((90 - elevation) * deg)
            ours = refraction(np.array(elevation * deg), height, seen=True)
            assert ours == pytest.approx(a * tangent + b * tangent**3, abs=0.15 * arcsec)
    at_horizon = refraction(np.array(0.0), 0.0, seen=True)
    assert at_horizon / deg * 60 == pytest.approx(34, abs=2.5)
    # By the true and by the seen elevation it is the same star.
    lift = refraction(np.array([1.0, 10.0, 60.0]) * deg, 0.0, seen=True)
    true = np.array([1.0, 10.0, 60.0]) * deg - lift
    np.testing.assert_allclose(refraction(true, 0.0), lift, atol=0.01 * arcsec)


def photograph(rng, camera, azimuth, elevation, count=60):
    """A solved photograph with a given image centre, whose stars are drawn at astropy's places."""
    z = on_horizon(azimuth, elevation)
    x = np.cross([0, 0, 1.0], z)
    x /= np.linalg.norm(x)
    to_middle = Rotation.from_matrix([x, np.cross(z, x), z])
    middle = camera.unproject(np.array([[639.5, 479.5]]))
    tilt = Rotation.align_vectors(middle, [[0, 0, 1.0]])[0]
    horizon_to_camera = tilt * Rotation.from_rotvec([0, 0, 0.4]) * to_middle
    direction = random_directions(rng, 16_000)
    ahead = horizon_to_camera.apply(on_horizon(*observed(direction)))
    direction, ahead = direction[ahead[:, 2] > 0.9], ahead[ahead[:, 2] > 0.9]
    place = camera.project(ahead)
    inside = np.flatnonzero(((place > 0) & (place < [1279, 959])).all(axis=1))[:count]
    spots = make_spots(place[inside] + rng.normal(0, NOISE, (len(inside), 2)), NOISE)
    start = Rotation.align_vectors(ahead[inside], direction[inside])[0]
    index = np.arange(len(inside))
    matches = Matches(Status.SOLVED, "", index, index, direction[inside], camera, start, 0.0)
    estimate = Estimate(Status.SOLVED, "", start, np.eye(3), 0.0, len(index), 0.0)
    return Photograph(spots, matches, estimate, start, PhotographView())


@pytest.mark.parametrize("camera", [CALIBRATED, UNKNOWN])
@pytest.mark.parametrize("elevation", [30, 60])
def test_the_camera_points_where_it_was_drawn(camera, elevation):
    rng = np.random.default_rng(elevation)
    photo = photograph(rng, camera, 130 * deg, elevation * deg)
    placed = place_photograph(photo, SITE, camera if camera is CALIBRATED else None)
    lift = refraction(np.array(elevation * deg), HEIGHT, seen=True)
    assert placed.refraction == pytest.approx(lift, rel=0.01)
    up, across = np.sqrt(placed.fit.covariance.diagonal()[:2])
    assert np.hypot(up, across) > 0.05 * lift, "what is not known of the air counts"
    pixel = 1 / camera.focal_length_px
    assert placed.elevation == pytest.approx(elevation * deg, abs=0.15 * pixel)
    turned = (placed.azimuth - 130 * deg) * np.cos(elevation * deg)
    assert turned == pytest.approx(0, abs=0.15 * pixel)
    assert 5 * arcsec < placed.aberration < 21 * arcsec
    # Where the catalogue has the middle is another place: by refraction and aberration.
    before = photo.estimate.icrs_to_camera
    assert (placed.fit.matches.icrs_to_camera * before.inv()).magnitude() > 0.5 * lift


def test_a_place_from_which_the_stars_are_not_seen_is_refused():
    photo = photograph(np.random.default_rng(3), UNKNOWN, 130 * deg, 60 * deg)
    far = Site(-47.3 * deg, -168.6 * deg, SITE.time)
    with pytest.raises(Refused, match=r"stars above the horizon, got .* deg below it"):
        place_photograph(photo, far)
