import numpy as np
import pytest
from scipy import special

from startrack.optics import Optics, pixel_psf, pupil_transfer
from startrack.optics.pixel_psf import pixel_response

GREEN = np.array([550e-9])
ONE = np.ones(1)


def psf(f_number=4.0, blur=0.0, kind="airy", pitch=5e-6):
    return pixel_psf(Optics(0.05, f_number, blur, kind), pitch, GREEN, ONE)


def test_airy_peak_of_tiny_pixels_is_the_closed_form():
    """E(0) = pi / 4 / (wavelength f#)^2 per unit of energy; pixels of an eighth of the disk."""
    side = 0.3
    pitch = side * 550e-9 * 8
    table = psf(8.0, pitch=pitch)
    middle = table.table.shape[0] // 2
    at = (np.arange(200) + 0.5) / 200 - 0.5
    v = np.pi * side * np.hypot(at, at[:, None])
    mean = np.mean((2 * special.j1(v) / v) ** 2)
    assert table.table[middle, middle] == pytest.approx(np.pi / 4 * side**2 * mean, rel=1e-5)


@pytest.mark.parametrize("f_number", [1.4, 2.8, 8.0])
def test_airy_encircled_energy(f_number):
    """Pixels of a square box against 1 - J0(v)^2 - J1(v)^2 of circles in and around it."""
    pitch = 5e-6
    table = psf(f_number, pitch=pitch)
    k = int(table.half_width) - 1
    m, s = table.table.shape[0] // 2, table.oversampling
    inside = table.table[m - k * s : m + k * s + 1 : s, m - k * s : m + k * s + 1 : s].sum()

    def encircled(radius):
        v = np.pi * radius * pitch / (550e-9 * f_number)
        return 1 - special.j0(v) ** 2 - special.j1(v) ** 2

    assert encircled(k + 0.5) - 1e-3 < inside < encircled((k + 0.5) * 2**0.5) + 1e-3


def test_a_gaussian_transfer_function_gives_the_gaussian_table():
    """Two ways to the same PSF: a transform of the OTF, and differences of error functions."""
    sigma, pitch = 0.7, 5e-6
    table = pixel_response(
        lambda f: np.exp(-2 * (np.pi * sigma * pitch * f) ** 2), pitch, 6 * sigma, sigma
    )
    at = np.arange(table.table.shape[0]) / table.oversampling - table.half_width
    line = special.ndtr((at + 0.5) / sigma) - special.ndtr((at - 0.5) / sigma)
    np.testing.assert_allclose(table.table, np.outer(line, line), atol=2e-7)
    assert table.energy == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("kind", ["airy", "gaussian"])
@pytest.mark.parametrize("blur", [0.0, 3e-6, 10e-6])
@pytest.mark.parametrize("f_number", [1.4, 4.0, 16.0])
def test_energy_is_what_the_pixels_sum_to(kind, blur, f_number):
    table = psf(f_number, blur, kind)
    m, s = table.table.shape[0] // 2, table.oversampling
    sums = [
        table.table[(m + i) % s :: s, (m + j) % s :: s].sum() for i in (0, s // 3) for j in (0, 2)
    ]
    np.testing.assert_allclose(sums, table.energy, atol=4e-3)
    assert 0.9 < table.energy <= 1
    assert table.energy > 0.999 or kind == "airy"


def test_the_table_has_the_symmetry_of_its_pupil():
    table = psf(2.0, 2e-6).table
    np.testing.assert_allclose(table, table.T, atol=1e-12)
    np.testing.assert_allclose(table, table[::-1], atol=1e-12)


def test_the_gaussian_stands_for_the_core_of_the_airy_disk():
    """At two pixels a disk the peak of the fitted Gaussian is within 10 % of the true one."""
    airy, gauss = psf(8.0), psf(8.0, kind="gaussian")
    assert gauss.table.max() == pytest.approx(airy.table.max(), rel=0.1)


def test_pupil_transfer_ends_at_the_cutoff():
    cutoff = 1 / (550e-9 * 2.0)
    values = pupil_transfer(np.array([0, cutoff / 2, cutoff, 2 * cutoff]), 550e-9, 2.0)
    half = 2 / np.pi * (np.pi / 3 - 0.5 * np.sqrt(3) / 2)
    np.testing.assert_allclose(values, [1, half, 0, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("name", "value"),
    [("f_number", -1.4), ("f_number", 0.0), ("focal_length", 0.0), ("blur", -1e-9), ("psf", "x")],
)
def test_impossible_optics_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        Optics(**{"focal_length": 0.05, "f_number": 2.0, name: value})
