import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.units import deg
from startrack.core.values import Stars
from startrack.scene import ObserverOrbit, Scene, Sight, illuminate
from startrack.scene.background import zodiacal
from startrack.scene.bodies import MOON_RADIUS, SUN_RADIUS
from startrack.scene.ephemeris import observer_of
from startrack.scene.planets import PLANETS
from startrack.space import AU, EARTH_RADIUS

DATE = "2026-03-25T12:00:00"
CAMERA = Camera.from_field_of_view(400, 300, 20 * deg)


def towards(direction) -> Rotation:
    """An attitude whose boresight is this direction."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    return Rotation.from_matrix(np.array([x, np.cross(z, x), z]))


def sight_of(direction, camera=CAMERA) -> Sight:
    return Sight(towards(direction), camera, 8.0, Streams(1, 0))


def stars_at(*directions) -> Stars:
    place = np.array(directions, float).reshape(-1, 3)
    count = len(place)
    return Stars(np.arange(count), place, np.full(count, 4.0), np.full(count, np.nan))


def seen(name: str, **scene):
    return observer_of(Scene(lights=("sun",), date=DATE, **scene), None).see(name)


def test_what_is_absent_adds_nothing():
    light = illuminate(Scene(), stars_at([1, 0, 0]), sight_of(np.array([1.0, 0, 0])))
    assert not light.diffuse
    assert not light.stray_sources
    assert not light.background.any()
    assert len(light.direction) == 1


def test_planets_are_points_where_the_ephemeris_has_them():
    jupiter = seen("jupiter")
    light = illuminate(
        Scene(lights=("planets",), date=DATE), stars_at([0, 0, 1]), sight_of(jupiter.direction)
    )
    assert len(light.direction) == 1 + len(PLANETS)
    at = np.argmax(light.direction @ jupiter.direction)
    np.testing.assert_allclose(light.direction[at], jupiter.direction)
    # V -2.1 is some 270 times the star of G 4.
    assert 200 < light.photon_irradiance[at].sum() / light.photon_irradiance[0].sum() < 400


def test_the_moon_hides_stars_and_fills_its_disc():
    moon = seen("moon")
    beside = moon.direction + 0.01 * np.array([0.0, 0.0, 1.0])
    light = illuminate(
        Scene(lights=("moon",), date=DATE),
        stars_at(moon.direction, beside / np.linalg.norm(beside)),
        sight_of(moon.direction),
    )
    pixel = CAMERA.project(towards(moon.direction).apply(light.direction))
    off = np.hypot(*(pixel - CAMERA.centre).T)
    assert (off > 8).sum() == 1  # the star beside it; the one behind it is gone
    radius = np.arcsin(1_737_400 / moon.distance) * CAMERA.focal_length_px
    assert np.sort(off)[-2] == pytest.approx(radius, rel=0.1)
    assert light.stray_sources[0].photon_irradiance.sum() == pytest.approx(
        light.photon_irradiance[1:].sum()
    )


def test_out_of_the_field_only_its_stray_light_is_left():
    moon = seen("moon")
    light = illuminate(Scene(lights=("moon",), date=DATE), stars_at(), sight_of(-moon.direction))
    assert len(light.direction) == 0
    np.testing.assert_allclose(light.stray_sources[0].direction[0], moon.direction)


def test_the_glow_follows_the_sky_between_its_places():
    """The map of 17 places, interpolated linearly, against the sky at every pixel: 1 %."""
    sun = seen("sun")
    line = sun.direction + 1.5 * np.cross(sun.direction, [0, 0, 1.0])
    sight = sight_of(line)
    scene = Scene(lights=("zodiacal",), date=DATE)
    (glow,) = illuminate(scene, stars_at(), sight).diffuse
    x, y = np.meshgrid(np.arange(0, 400, 7), np.arange(0, 300, 7))
    pixel = np.column_stack([x.ravel(), y.ravel()])
    direction = sight.icrs_to_camera.inv().apply(CAMERA.unproject(pixel))
    wanted = zodiacal(direction, sun.direction, sun.distance / AU)
    column, row = pixel[:, 0] / 399 * 16, pixel[:, 1] / 299 * 16
    i, j = np.minimum(row.astype(int), 15), np.minimum(column.astype(int), 15)
    v, u = row - i, column - j
    fraction = glow.fraction
    drawn = (1 - v) * ((1 - u) * fraction[i, j] + u * fraction[i, j + 1]) + v * (
        (1 - u) * fraction[i + 1, j] + u * fraction[i + 1, j + 1]
    )
    np.testing.assert_allclose(drawn, wanted, rtol=0.01)
    assert wanted.max() > 1.3 * wanted.min()


ORBIT = ObserverOrbit(600e3, 98 * deg, 20 * deg, phase=50 * deg)


def test_the_earth_hides_the_sky_and_shines_itself():
    scene = Scene(lights=("starlight", "earth"), date=DATE, orbit=ORBIT)
    nadir = observer_of(scene, None).earth
    centre, zenith = nadir / np.linalg.norm(nadir), -nadir / np.linalg.norm(nadir)
    down = illuminate(scene, stars_at(centre, zenith), sight_of(centre))
    assert len(down.direction) == 1
    starlight, earth = down.diffuse
    assert not starlight.fraction.any()
    assert (earth.fraction > 0).any()
    up = illuminate(scene, stars_at(centre, zenith), sight_of(zenith))
    assert len(up.diffuse) == 1
    assert len(up.stray_sources) == 1  # the Earth, from below


def test_in_the_earths_shadow_there_is_no_sun():
    """The fraction of a circular orbit without the Sun, by the closed form of its cylinder.

    share = acos(sqrt(h^2 + 2 R h) / (a cos(b))) / pi, b the Sun's angle above the orbit's plane
    """
    phases = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    scenes = [
        Scene(lights=("sun", "earth"), date=DATE, orbit=ObserverOrbit(600e3, 98 * deg, 4.0, phase))
        for phase in phases
    ]
    sight = sight_of(np.array([0.0, 1.0, 0.2]))
    sun = observer_of(scenes[0], None).see("sun").direction
    dark = [
        not any(
            one.direction[0] @ sun > 0.999
            for one in illuminate(scene, stars_at(), sight).stray_sources
        )
        for scene in scenes
    ]
    inclination, node = 98 * deg, 4.0
    normal = np.array(
        [
            np.sin(node) * np.sin(inclination),
            -np.cos(node) * np.sin(inclination),
            np.cos(inclination),
        ]
    )
    above = np.arcsin(normal @ sun)
    a, edge = 6978.137, np.sqrt(600**2 + 2 * 6378.137 * 600)
    wanted = np.arccos(min(edge / (a * np.cos(above)), 1.0)) / np.pi
    assert wanted > 0.1
    assert np.mean(dark) == pytest.approx(wanted, abs=2 / 72)


@pytest.mark.parametrize("nearer", [0.9, 1.0, 1.3])
def test_the_moon_hides_the_suns_stray_light(nearer):
    """No light in the core of the Moon's shadow, a ring beyond its tip: by the ratio of the
    discs."""
    observer = observer_of(Scene(lights=("sun",), date=DATE), None)
    to_sun, to_moon = (
        body.direction * body.distance for body in (observer.see("sun"), observer.see("moon"))
    )
    away = to_moon - to_sun
    core = MOON_RADIUS / (SUN_RADIUS - MOON_RADIUS) * np.linalg.norm(away)
    place = observer.position + to_moon + nearer * core * away / np.linalg.norm(away)
    covered = MOON_RADIUS / SUN_RADIUS * (np.linalg.norm(away) / (nearer * core) + 1)
    scene = Scene(lights=("sun", "moon"), date=DATE, place=tuple(place))
    sources = illuminate(scene, stars_at(), sight_of(np.array([0.0, 1.0, 0.2]))).stray_sources
    assert sources[-1].fraction.sum() == 1  # the Moon's own
    left = sum(one.fraction.sum() for one in sources[:-1])
    assert left == pytest.approx(max(1 - covered**2, 0), abs=1e-3)


def test_half_a_sun_above_the_limb_has_half_its_stray_light():
    def scene(phase: float) -> Scene:
        return Scene(
            lights=("sun", "earth"), date=DATE, orbit=ObserverOrbit(600e3, 98 * deg, 4.0, phase)
        )

    def above(phase: float) -> float:
        observer = observer_of(scene(phase), None)
        cosine = observer.see("sun").direction @ observer.earth / np.linalg.norm(observer.earth)
        return np.arccos(cosine) - np.arcsin(EARTH_RADIUS / np.linalg.norm(observer.earth))

    phases = np.linspace(0, 2 * np.pi, 13)
    dark = int(np.argmin([above(phase) for phase in phases]))
    sunrise = brentq(above, phases[dark], phases[dark] + np.pi / 2)
    sources = illuminate(
        scene(sunrise), stars_at(), sight_of(np.array([0.0, 1.0, 0.2]))
    ).stray_sources
    assert sources[0].fraction.sum() == pytest.approx(0.5, abs=0.01)


def test_nothing_is_drawn_for_what_is_fixed():
    """A scene with a fixed date draws no number from the trial's streams."""

    class NoStreams:
        def __call__(self, cause: str):
            raise AssertionError(cause)

    sight = Sight(towards(np.array([1.0, 0, 0])), CAMERA, 8.0, NoStreams())
    illuminate(
        Scene(lights=("zodiacal", "starlight", "planets"), date=DATE), stars_at([1, 0, 0]), sight
    )
