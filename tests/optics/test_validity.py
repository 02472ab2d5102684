"""Range of Fresnel's model, and the model that `choose` takes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from krutz_2011 import ThinLens, fresnel_error, fresnel_radius, on_axis, paper_radius

from startrack.optics import Aberration, Optics, Pupil, choose, pixel_psf
from startrack.optics.parameters import MODELS

GREEN = 550e-9


def test_the_papers_criterion_gives_the_papers_numbers(oracle):
    for name, entry in oracle("kirchhoff.json")["wavelengths"].items():
        for order, wanted in enumerate(entry["roots_m"], 1):
            got = paper_radius(0.02, 1.0, float(name) * 1e-9, order)
            assert got == pytest.approx(float(wanted), rel=1e-7)
    assert paper_radius(0.02, 1.0, 500e-9) == pytest.approx(0.0013, abs=5e-5)
    assert paper_radius(0.02, 1.0, 500e-9, 2) == pytest.approx(0.0018, abs=5e-5)


def test_the_papers_criterion_hangs_on_the_phase_origin():
    """A hundred-thousandth of a nanometre changes it by a sixth; the stable criterion does not
    change."""
    near, far = (paper_radius(0.02, 1.0, wavelength) for wavelength in (500e-9, 500.00001e-9))
    assert near == pytest.approx(1.2701e-3, abs=1e-7)
    assert far == pytest.approx(1.05e-3, abs=5e-6)
    near, far = (
        fresnel_radius(0.02, 1.0, wavelength, 0.5).radius for wavelength in (500e-9, 500.00001e-9)
    )
    assert far == pytest.approx(near, rel=1e-8)


def test_the_stable_criterion_bounds_the_error(oracle):
    """From 0.01 % to 20 % of error, at seven wavelengths, and within a third of it."""
    seen = 0
    for name, entry in oracle("kirchhoff.json")["wavelengths"].items():
        for row in entry["rows"]:
            true = 1 - float(row["kirchhoff"]) / float(row["fresnel"])
            bound = fresnel_error(0.02, 1.0, float(name) * 1e-9, float(row["R"]))
            assert true <= bound
            if true < 0.2:
                assert bound < true * 1.35
                seen += 1
    assert seen >= 25


@pytest.mark.parametrize("distance", [0.05, 1.0, math.inf])
@pytest.mark.parametrize("tolerance", [0.1, 0.5, 1.0])
def test_the_radius_keeps_the_tolerance(distance, tolerance):
    limit = fresnel_radius(0.02, distance, GREEN, tolerance)
    lens = ThinLens(0.02, limit.radius, distance, GREEN)
    assert abs(float(lens.phase_defect(limit.radius))) == pytest.approx(tolerance, rel=0.02)
    assert 0 < 1 - abs(on_axis(lens)) ** 2 <= limit.error


DESIGNS = {
    "slow": Optics(0.05, 8.0),
    "fast": Optics(0.035, 1.4),
    "fast, thin lens": Optics(0.035, 2.0, lens="perfect"),
    "the paper's lens": Optics(0.02, 9.0, lens="parabolic", object_distance=1.0),
    "blurred": Optics(0.035, 2.4, 5e-6),
    "blurred a lot": Optics(0.035, 2.4, 12e-6),
    "out of focus": Optics(0.05, 4.0, defocus=60e-6),
    "coma": Optics(0.05, 2.0, aberrations=(Aberration(7, 30e-9),)),
    "obscured": Optics(0.05, 2.0, pupil=Pupil(0.4, 4, 0.02)),
}


@pytest.mark.parametrize("name", DESIGNS)
def test_no_model_errs_by_more_than_it_says(name):
    """Each model's table against that of the Kirchhoff integral, at 5 micrometre pixels."""
    optics = DESIGNS[name]
    band = np.array([GREEN]), np.ones(1)
    exact = pixel_psf(replace(optics, psf="kirchhoff"), 5e-6, *band)
    peak = exact.table.max()
    if not optics.plain:  # the bounds are of the peak without aberrations
        plain = replace(optics, psf="airy", defocus=0.0, aberrations=(), pupil=Pupil())
        peak = max(peak, pixel_psf(plain, 5e-6, *band).table.max())
    for model, error in choose(optics, 5e-6, GREEN).errors.items():
        if math.isinf(error):
            assert model in ("gaussian", "airy")
            continue
        other = pixel_psf(replace(optics, psf=model), 5e-6, *band)
        assert other.oversampling == exact.oversampling
        reach = min(other.table.shape[0], exact.table.shape[0]) // 2
        tables = []
        for one in (other, exact):
            middle = slice(one.table.shape[0] // 2 - reach, one.table.shape[0] // 2 + reach + 1)
            tables.append(one.table[middle, middle])
        assert np.abs(tables[0] - tables[1]).max() <= (error + 1e-5) * peak


def test_choose_takes_the_cheapest_within_the_tolerance():
    optics = Optics(0.035, 2.4, 5e-6)
    taken = [
        choose(replace(optics, psf_tolerance=tolerance), 5e-6, GREEN).model
        for tolerance in (1.0, 0.03, 0.001)
    ]
    assert taken == ["gaussian", "airy", "kirchhoff"]
    places = [MODELS.index(model) for model in taken]
    assert places == sorted(places)


def test_choose_says_why():
    coma = choose(DESIGNS["coma"], 5e-6, GREEN)
    assert (coma.model, coma.reason) == ("kirchhoff", "fresnel may err by 0.03 of the peak")
    lenient = choose(replace(DESIGNS["coma"], psf_tolerance=0.1), 5e-6, GREEN)
    wanted = "airy needs a clear pupil in focus without aberrations"
    assert (lenient.model, lenient.reason) == ("fraunhofer", wanted)
    named = choose(Optics(0.05, 4.0, psf="fresnel"), 5e-6, GREEN)
    assert (named.model, named.reason) == ("fresnel", "the design names it")
