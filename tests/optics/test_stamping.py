"""Tables and stamps against exact integrals over pixels, and their energy."""

import numpy as np
import pytest
from scipy import special

from startrack.detector.stamp import stamp
from startrack.optics import POINT, Aberration, Optics, Pupil, modulation, pixel_psf, quality
from startrack.optics.diffraction import airy, blur_transfer, pupil_transfer
from startrack.optics.quality import encircled
from tests.optics.closed import airy_encircled

GREEN = np.array([550e-9])
ONE = np.ones(1)


def exact(x, y, disk, box, nodes=48):
    """The Airy pattern of lambda f# = `disk` pixel over each pixel, by Gauss-Legendre."""
    node, weight = np.polynomial.legendre.leggauss(nodes)
    at = (np.arange(box) - box // 2)[:, None] + node / 2
    x, y = (at - x).ravel(), (at - y).ravel()
    fine = np.pi / 4 / disk**2 * airy(np.hypot(x, y[:, None]), disk, 1.0)
    fine = fine.reshape(box, nodes, box, nodes)
    return np.einsum("ajbi,j,i->ab", fine, weight / 2, weight / 2)


def centroid(image):
    at = np.arange(image.shape[0]) - image.shape[0] // 2
    return np.array([image.sum(axis=0) @ at, image.sum(axis=1) @ at]) / image.sum()


@pytest.mark.parametrize("model", ["airy", "fraunhofer"])
@pytest.mark.parametrize("disk", [0.14, 0.25, 0.5, 1.0, 2.0])
def test_stamped_airy_patterns(model, disk):
    psf = pixel_psf(Optics(0.05, 2.8, psf=model), 550e-9 * 2.8 / disk, GREEN, ONE)
    box = 2 * ((psf.table.shape[0] // 2 - 3) // psf.oversampling) + 1
    errors = []
    for x, y in np.random.default_rng(4).uniform(-0.5, 0.5, (8, 2)):
        image = np.zeros((box, box))
        stamp(image, psf, np.array([box // 2 + x]), np.array([box // 2 + y]), ONE)
        wanted = exact(x, y, disk, box)
        np.testing.assert_allclose(image, wanted, atol=8e-6 * wanted.max())
        assert image.sum() == pytest.approx(wanted.sum(), abs=1e-5)
        errors.append(centroid(image) - centroid(wanted))
    assert np.sqrt(np.mean(np.square(errors))) < 1e-5


@pytest.mark.parametrize("sigma", [0.1, 0.3, 0.7, 1.5])
def test_stamped_gaussians(sigma):
    psf = pixel_psf(Optics(0.05, 4.0, 5e-6 * sigma, "gaussian"), 5e-6, np.array([1e-12]), ONE)
    box = 2 * ((psf.table.shape[0] // 2 - 3) // psf.oversampling) + 1
    at, errors = np.arange(box) - box // 2, []
    for x, y in np.random.default_rng(4).uniform(-0.5, 0.5, (50, 2)):
        image = np.zeros((box, box))
        stamp(image, psf, np.array([box // 2 + x]), np.array([box // 2 + y]), ONE)
        lines = [
            special.ndtr((at - c + 0.5) / sigma) - special.ndtr((at - c - 0.5) / sigma)
            for c in (x, y)
        ]
        errors.append(centroid(image) - centroid(np.outer(lines[1], lines[0])))
    assert np.sqrt(np.mean(np.square(errors))) < 1e-6


def test_the_fast_way_of_products_is_the_slow_way():
    """A table that is just not separable takes the other way, with the same image."""
    from startrack.core.values import Psf

    psf = pixel_psf(Optics(0.05, 4.0, 5e-6, "gaussian"), 5e-6, GREEN, ONE)
    bent = psf.table.copy()
    bent[0, 0] += 1e-12
    images = [np.zeros((40, 30)) for _ in range(2)]
    draw = np.random.default_rng(1)
    x, y, light = draw.uniform(-3, 33, 60), draw.uniform(-3, 43, 60), draw.uniform(1, 9, 60)
    for image, table in zip(images, (psf.table, bent), strict=True):
        stamp(image, Psf(table, psf.oversampling, psf.energy), x, y, light)
    np.testing.assert_allclose(images[0], images[1], atol=1e-10)


@pytest.mark.parametrize("blur", [0.0, 1e-6, 5e-6])
@pytest.mark.parametrize("f_number", [1.4, 4.0, 11.0])
def test_two_ways_to_one_table(f_number, blur):
    """Closed-form transfer functions with wings apart, and irradiance point by point."""
    band = np.array([450e-9, 600e-9, 800e-9]), np.array([1.0, 2.0, 0.5])
    one, two = (
        pixel_psf(Optics(0.05, f_number, blur, model), 5e-6, *band)
        for model in ("airy", "fraunhofer")
    )
    assert (one.oversampling, one.table.shape) == (two.oversampling, two.table.shape)
    np.testing.assert_allclose(one.table, two.table, atol=1e-5 * one.table.max())
    assert one.energy == pytest.approx(two.energy, abs=1e-5)


def test_energy_of_a_table_is_exact():
    """The closed transform of the Airy pattern over the square box, by quadrature."""
    psf = pixel_psf(Optics(0.05, 4.0, psf="airy"), 2.2e-6, GREEN, ONE, POINT)
    half = psf.half_width  # lambda f# is one pixel
    node, weight = np.polynomial.legendre.leggauss(400)
    line = airy(np.hypot(node * half, (node * half)[:, None]), 1.0, 1.0) * np.pi / 4
    assert psf.energy == pytest.approx(weight @ line @ weight * half**2, abs=1e-6)


def test_a_small_active_square_keeps_the_light():
    """Pixels divide their light by the fill factor: the same mean, a sharper image."""
    full, part = (pixel_psf(Optics(0.05, 4.0), 3e-6, GREEN, ONE, fill) for fill in (1.0, 0.25))
    assert part.energy == pytest.approx(full.energy, abs=2e-3)
    middle = full.table.shape[0] // 2
    assert part.table[middle, middle] > 1.2 * full.table[middle, middle]


def test_diffusion_adds_to_blur_in_squares():
    one = pixel_psf(Optics(0.05, 4.0, 3e-6), 5e-6, GREEN, ONE, 1.0, 4e-6)
    two = pixel_psf(Optics(0.05, 4.0, 5e-6), 5e-6, GREEN, ONE)
    seeing = pixel_psf(Optics(0.05, 4.0, 3e-6, seeing=8e-5), 5e-6, GREEN, ONE)
    np.testing.assert_allclose(one.table, two.table, atol=1e-9)
    np.testing.assert_allclose(seeing.table, two.table, atol=1e-9)


def test_quality_of_an_airy_disk():
    """Closed forms: transfer function, encircled energy, width at half maximum 1.029 lambda f#."""
    optics = Optics(0.05, 8.0, psf="airy")
    response, image = (pixel_psf(optics, 4.4e-6, GREEN, ONE, fill) for fill in (1.0, POINT))
    judged = quality(response, image)
    nyquist = np.array([0.5 / 4.4e-6])
    wanted = pupil_transfer(nyquist, 550e-9, 8.0)[0]
    assert (judged.mtf_x, judged.mtf_y) == pytest.approx([wanted * 2 / np.pi] * 2, abs=2e-3)
    assert modulation(image, np.array([0.5]), 0.7)[0] == pytest.approx(wanted, abs=3e-3)
    assert (judged.fwhm_x, judged.fwhm_y) == pytest.approx((1.029, 1.029), abs=2e-3)
    for radius in (0.5, 1.0, 2.0, 5.0):
        assert encircled(image, radius) == pytest.approx(airy_encircled(radius, 1, 1), abs=1e-3)
    assert np.isnan(encircled(image, 1e3))


def test_modulation_of_a_blur():
    response, image = (
        pixel_psf(Optics(0.05, 1.0, 4e-6, "gaussian"), 5e-6, np.array([1e-12]), ONE, fill)
        for fill in (1.0, POINT)
    )
    wanted = blur_transfer(np.array([0.5]), 0.8)[0]
    judged = quality(response, image)
    assert judged.mtf_x == pytest.approx(wanted * 2 / np.pi, abs=1e-4)
    assert judged.fwhm_x == pytest.approx(2 * np.sqrt(2 * np.log(2)) * 0.8, abs=2e-3)
    inside = special.erf(1.5 / 0.8 / np.sqrt(2)) ** 2
    assert judged.ensquared[1] == pytest.approx(inside, abs=1e-4)


def test_spider_and_aberrations_keep_their_light():
    optics = Optics(
        0.05,
        4.0,
        pupil=Pupil(0.3, 4, 0.05),
        aberrations=(Aberration(6, 40e-9), Aberration(11, 2e-8)),
    )
    psf = pixel_psf(optics, 5e-6, GREEN, ONE)
    m, s = psf.table.shape[0] // 2, psf.oversampling
    sums = [psf.table[(m + k) % s :: s, (m + k) % s :: s].sum() for k in (0, s // 3, s // 2)]
    np.testing.assert_allclose(sums, psf.energy, atol=5e-3)
    assert 0.9 < psf.energy < 1
