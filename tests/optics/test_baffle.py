import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.core.values import Light, LineOfSight, Psf, StrayLightSource
from startrack.detector import Detector, Exposure, expected
from startrack.optics import Baffle, Optics, stray_light

WAVELENGTH = np.array([500e-9, 700e-9])
REST = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
POINT = Psf(np.ones((1, 1)), 1, 1.0)
DETECTOR = Detector(60, 40, 10e-6, 0.2)
OPTICS = Optics(50e-3, 2.0)
CAMERA = Camera(60, 40, OPTICS.focal_length / DETECTOR.pixel_pitch)


def glaring(*angles: float, rate=(3e12, 5e12)) -> Light:
    """Light of point sources alone at these angles from the boresight, towards +x."""
    place = np.array([[np.sin(a), 0.0, np.cos(a)] for a in angles])
    source = StrayLightSource(place, np.full(len(place), 1 / len(place)), np.array(rate))
    none = np.zeros((0, 3)), WAVELENGTH, np.zeros((0, 2)), np.zeros(2)
    return Light(*none, stray_sources=(source,))


def image_of(light: Light, baffle: Baffle, optics=OPTICS, camera=CAMERA, detector=DETECTOR):
    there = Rotation.identity()
    veiled = stray_light(light, baffle, optics, there, camera)
    throughput = np.full(2, optics.area)
    return expected(Exposure(veiled, POINT, REST, there, camera, detector, throughput))


def test_the_curve_is_a_straight_line_of_logarithms():
    """Two points define an exponential: a decade for every ten degrees."""
    baffle = Baffle((20 * deg, 60 * deg), (1e-4, 1e-8))
    np.testing.assert_allclose(
        baffle(np.array([20, 30, 45, 60]) * deg), [1e-4, 1e-5, 10**-6.5, 1e-8], rtol=1e-12
    )
    np.testing.assert_allclose(baffle(np.array([0, 90]) * deg), [1e-4, 1e-8])


@pytest.mark.parametrize("optics", [OPTICS, Optics(20e-3, 1.2), Optics(120e-3, 5.0)])
def test_a_pixel_gets_irradiance_times_transmittance_times_its_area(optics):
    """The closed form of the definition, in which focal length and aperture do not occur."""
    camera = Camera(60, 40, optics.focal_length / DETECTOR.pixel_pitch)
    image = image_of(glaring(40 * deg), Baffle((10 * deg,), (1e-6,)), optics, camera)
    np.testing.assert_allclose(image, 8e12 * 1e-6 * (10e-6) ** 2 * 0.2, rtol=1e-9)


def test_stray_light_is_brighter_towards_its_source():
    """Over the frame the angle to the source changes, and the curve with it."""
    baffle = Baffle((20 * deg, 60 * deg), (1e-4, 1e-8))
    image = image_of(glaring(40 * deg), baffle)
    line = CAMERA.unproject(np.column_stack([np.arange(60), np.full(60, 20)]))
    angle = np.arccos(line @ [np.sin(40 * deg), 0, np.cos(40 * deg)])
    wanted = 8e12 * 1e-4 * 10 ** (-(angle / deg - 20) / 10) * (10e-6) ** 2 * 0.2
    np.testing.assert_allclose(image[20], wanted, rtol=1e-3)
    assert image[20, -1] > 1.1 * image[20, 0]


def test_the_parts_of_a_body_add_up():
    baffle = Baffle((20 * deg, 60 * deg), (1e-4, 1e-8))
    both = image_of(glaring(30 * deg, 50 * deg), baffle)
    one, other = (image_of(glaring(angle), baffle) for angle in (30 * deg, 50 * deg))
    np.testing.assert_allclose(both, (one + other) / 2, rtol=1e-12)


@pytest.mark.parametrize(
    ("angle", "value", "words"),
    [
        ((), (), "the same length of one or more, got 0 and 0"),
        ((0.1,), (1e-3, 1e-4), "the same length of one or more, got 1 and 2"),
        ((0.2, 0.1), (1e-3, 1e-4), "angle must increase"),
        ((0.1, 4.0), (1e-3, 1e-4), "angle must lie in"),
        ((0.1, 0.2), (1e-3, 0.0), "transmittance must be positive"),
    ],
)
def test_curves_that_are_none_are_refused(angle, value, words):
    with pytest.raises(ValueError, match=words):
        Baffle(angle, value)
