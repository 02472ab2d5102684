"""Figures 6 to 9 of Krutz et al. (2011), redrawn, and comparison with the paper's numbers.

The laboratory lens: f = 20 mm, g = 1 m, a parabolic phase, 500 nm. Figures 6 and 7: difference
between Fresnel and Kirchhoff over the f-number, at the maximum and at the Nyquist frequency of 5 um
pixels. Figures 8 and 9: real and imaginary part of both integrands over the radius.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from krutz_2011 import ThinLens, fresnel_error, fresnel_radius, on_axis, paper_radius
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from startrack.core import Floats
from startrack.optics import path_defect, pupil_transfer
from startrack.plots import BLUE, GREY, RED, legend_below, picture, save_picture, styled

FOCAL, DISTANCE, WAVELENGTH, PITCH = 0.02, 1.0, 500e-9, 5e-6
F_NUMBERS = np.linspace(2.0, 14.0, 49)


def lens(f_number: float) -> ThinLens:
    return ThinLens(FOCAL, FOCAL / f_number / 2, DISTANCE, WAVELENGTH)


def maximum_error(f_number: float) -> float:
    """1 - Kirchhoff / Fresnel on the axis, in the fixed image plane."""
    return 1 - abs(on_axis(lens(f_number))) ** 2


def best_focus_error(f_number: float) -> float:
    """1 - Kirchhoff / Fresnel on the axis, each in the plane where it is brightest.

    Accuracy  numerical: the plane to 1 nm. It lies within ten depths of focus.
    """
    thin, depth = lens(f_number), WAVELENGTH * f_number**2

    def dimness(defocus: float) -> float:
        return 1 - abs(on_axis(thin, defocus)) ** 2

    planes = depth * np.linspace(-10, 10, 51)
    nearest = planes[np.argmin([dimness(plane) for plane in planes])]
    around = nearest - depth / 2, nearest + depth / 2
    return float(minimize_scalar(dimness, bounds=around, options={"xatol": 1e-9}).fun)


def nyquist_error(f_number: float) -> float:
    """|1 - Kirchhoff / Fresnel| of the modulation at Nyquist."""
    thin = lens(f_number)
    frequency = np.array([1 / (2 * PITCH)])
    fresnel = pupil_transfer(frequency, WAVELENGTH, thin.image / (2 * thin.radius))[0]
    return abs(1 - kirchhoff_modulation(thin, 1 / (2 * PITCH)) / float(fresnel))


def kirchhoff_modulation(thin: ThinLens, frequency: float) -> float:
    """The autocorrelation of the pupil over q = b sin(angle); in this variable eq. (7) is a Fourier
    transform.

    Gauss-Legendre over the overlap of two disks, in the manner of `startrack.optics.choose`.
    """
    b, g = thin.image, thin.distance
    rim = thin.radius / math.hypot(1, thin.radius / b)
    apart = WAVELENGTH * b * frequency

    def pupil(x: Floats, y: Floats) -> NDArray[np.complex128]:
        sine2 = (x * x + y * y) / b**2
        square = sine2 / (1 - sine2) * b**2
        size = (1 + square / b**2) * g**2 / (g**2 + square)
        return size * np.exp(1j * thin.wavenumber * path_defect(square, b, g))

    def over(x: Floats, y: Floats, area: Floats, shift: float) -> complex:
        return complex((area * pupil(x + shift, y) * pupil(x - shift, y).conj()).sum())

    node, weight = np.polynomial.legendre.leggauss(300)
    total = []
    for shift in (0.0, apart / 2):
        # By symmetry the half x > 0; x = (rim - shift) sin(t) removes the singularity at the end of
        # the chords.
        t = (node + 1) * math.pi / 4
        x = (rim - shift) * np.sin(t)
        chord = np.sqrt(np.maximum(rim**2 - (x + shift) ** 2, 0.0))
        along = weight * math.pi / 4 * (rim - shift) * np.cos(t) * chord
        area = 2 * along[:, None] * weight
        total.append(over(x[:, None], chord[:, None] * node, area, shift).real)
    return abs(total[1]) / total[0]


def integrands(radius: Floats) -> tuple[Floats, Floats]:
    """Kirchhoff's and Fresnel's integrand of eqs. (9) and (10), without their common factor.

    The phase origin k (b + g) is kept, as in the paper, so that the zeros depend on it.
    """
    thin = ThinLens(FOCAL, float(radius.max()), DISTANCE, WAVELENGTH)
    origin = 2 * math.pi * math.modf((thin.image + DISTANCE) / WAVELENGTH)[0]
    b2, g2, square = thin.image**2, DISTANCE**2, radius**2
    size = radius * b2 * g2 / ((b2 + square) * (g2 + square))
    kirchhoff = size * np.exp(1j * (origin + thin.phase_defect(radius)))
    return kirchhoff, radius * np.exp(1j * origin)


def report(folder: Path | None, f_numbers: Floats = F_NUMBERS) -> None:
    """Print the comparison with the paper's numbers; draw over f-numbers into a folder, if
    given."""
    r1, r2 = (paper_radius(FOCAL, DISTANCE, WAVELENGTH, order) for order in (1, 2))
    shifted = paper_radius(FOCAL, DISTANCE, WAVELENGTH + 1e-14)
    print("The paper's laboratory case, 500 nm")
    print(f"  r1 = {r1 * 1e3:.4f} mm, f/{FOCAL / 2 / r1:.2f}    paper: 1.3 mm, about f/8: met")
    print(
        f"  r2 = {r2 * 1e3:.4f} mm, f/{FOCAL / 2 / r2:.2f}    paper: 1.8 mm, about f/6: met as r2"
    )
    print(f"  r1 at 500.00001 nm = {shifted * 1e3:.4f} mm: eq. (11) depends on the phase origin")
    for f_number in (12.0, 8.0, 6.0):
        error = maximum_error(f_number)
        bound = fresnel_error(FOCAL, DISTANCE, WAVELENGTH, lens(f_number).radius)
        print(
            f"  f/{f_number:<3g} maximum: {100 * error:5.2f} % of Fresnel's, "
            f"{100 * error / (1 - error):.2f} % of Kirchhoff's, bound {100 * bound:.2f} %; "
            f"at Nyquist {100 * nyquist_error(f_number):.2f} %"
        )
    print("  paper: [0.2 %, 5 %] between f/8 and f/6: not met in the fixed image plane")
    for name, radius in (("r1", r1), ("r2", r2)):
        f_number = FOCAL / 2 / radius
        print(
            f"  at {name}, maximum in the fixed plane: {100 * maximum_error(f_number):.2f} %, in "
            f"best focus: {100 * best_focus_error(f_number):.2f} %, half of the paper's"
        )
    print("  paper: to zero above f/6: not met, 2 % at f/8; nearly 100 % at low f-numbers: met,")
    print(f"         {100 * maximum_error(2.0):.1f} % at f/2")
    for tolerance in (0.1, 0.5, 1.0):
        limit = fresnel_radius(FOCAL, DISTANCE, WAVELENGTH, tolerance)
        print(
            f"  stable criterion, {tolerance:g} rad at the rim: f/{FOCAL / 2 / limit.radius:.2f}, "
            f"error at most {100 * limit.error:.2f} %"
        )
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        _draw(folder / "figures_6_to_9.png", r1, r2, f_numbers)
        print(f"  drawn: {folder / 'figures_6_to_9.png'}")


@styled
def _draw(path: Path, r1: float, r2: float, f_numbers: Floats) -> None:
    figure = picture(13.5, "Figures 6 to 9; r1, r2: the two radii of eq. (11)")
    axes = figure.subplots(4, 1).reshape(2, 2)
    curves = (
        ("Figure 6: error of the maximum", [maximum_error(n) for n in f_numbers]),
        (
            "Figure 7: error at the Nyquist frequency (5 um pixels)",
            [nyquist_error(n) for n in f_numbers],
        ),
    )
    bound = [fresnel_error(FOCAL, DISTANCE, WAVELENGTH, FOCAL / n / 2) for n in f_numbers]
    for place, (title, error) in zip(axes[0], curves, strict=True):
        place.plot(f_numbers, 100 * np.array(error), color=BLUE, label="Fresnel - Kirchhoff")
        for r, name, line in ((r1, "r1", ":"), (r2, "r2", "-.")):
            place.axvline(FOCAL / 2 / r, color=GREY, ls=line, label=name)
        place.set(xlabel="f-number (1)", ylabel="error (%)", title=title, ylim=(0, 105))
    axes[0, 0].plot(f_numbers, 100 * np.minimum(bound, 1.05), "--", color=RED, label="stable bound")
    radius = np.linspace(0, 2.5e-3, 1000)
    both = integrands(radius)
    for place, part, title in (
        (axes[1, 0], "real", "Figure 8: real part of the integrands"),
        (axes[1, 1], "imag", "Figure 9: imaginary part of the integrands"),
    ):
        for values, name, colour, line in zip(
            both, ("Kirchhoff", "Fresnel"), (BLUE, RED), ("-", "--"), strict=True
        ):
            place.plot(radius * 1e3, getattr(values, part) * 1e3, line, color=colour, label=name)
        for r, name, line in ((r1, "r1", ":"), (r2, "r2", "-.")):
            place.axvline(r * 1e3, color=GREY, ls=line, label=name)
        place.axhline(0, color="gray", lw=0.5)
        place.set(xlabel="radius (mm)", ylabel="integrand (relative)", title=title)
    for place in axes.flat:
        legend_below(place, 4)
    save_picture(path, figure)
