"""Files of PSFs: images of a point in a design."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from startrack import Fidelity, load_design, run_random_trial, shipped
from startrack.design import DesignSpace
from startrack.detector import stamp
from startrack.observation import psf_of
from startrack.optics import Aberration, Optics, PsfFile, load_psf_file, pixel_psf, save_psf_file
from startrack.optimise import TrialRunner
from startrack.optimise.evaluate import evaluate

ORACLE = Path(__file__).parents[1] / "oracle/chandra_psf.json"
PITCH = 5e-6
WAVES = np.array([600e-9]), np.ones(1)
COMATIC = Optics(0.05, 4.0, psf="fraunhofer", blur=2e-6, aberrations=(Aberration(8, 100e-9),))


def one_star(psf, x, y, side=21):
    image = np.zeros((side, side))
    stamp(image, psf, np.array([x + side // 2]), np.array([y + side // 2]), np.ones(1))
    return image


def with_file(path, **changes):
    return replace(Optics(0.05, 4.0), psf_file=str(path), **changes)


def test_fractions_measured_in_flight_are_given_back_within_half_a_percent_of_the_peak():
    """Chandra's aspect camera: 8 x 8 pixels at nine places of the star, by its own project."""
    psf = pixel_psf(with_file("chandra-aca"), 24e-6, *WAVES)
    for row in json.loads(ORACLE.read_text(encoding="utf-8")):
        wanted = np.array(row["fraction"])
        made = one_star(psf, row["x"] - 0.5, row["y"] - 0.5, 8)
        known = wanted > 0
        assert np.abs(made - wanted)[known].max() < 0.005 * wanted.max()


@pytest.mark.parametrize(("step", "limit"), [(4, 3e-3), (7, 1e-3), (12, 1e-5)])
def test_an_image_that_contains_the_pixel_makes_the_same_stars(tmp_path, step, limit):
    """An asymmetric diffraction image, with four or more samples a pixel."""
    true = pixel_psf(COMATIC, PITCH, *WAVES)
    at = (np.arange(-8 * step, 8 * step + 1) / step) + 10
    x, y = np.meshgrid(10 - at, 10 - at)
    image = np.array(
        [one_star(true, u, v)[10, 10] for u, v in zip(x.ravel(), y.ravel(), strict=True)]
    ).reshape(len(at), len(at))
    energy = float(image.sum()) / step**2
    save_psf_file(
        tmp_path / "p.fits",
        PsfFile("", image[None, None], PITCH / step, True, PITCH, min(energy, 1.0)),
    )
    psf = pixel_psf(with_file(tmp_path / "p.fits"), PITCH, *WAVES)
    for x, y in ((0.0, 0.0), (0.3, -0.45), (0.11, 0.27)):
        made, wanted = one_star(psf, x, y), one_star(true, x, y)
        inside = np.s_[4:-4, 4:-4]
        assert np.abs(made - wanted)[inside].max() < limit * wanted.max()


def test_an_irradiance_is_averaged_over_pixels_after_blur_and_diffusion(tmp_path):
    """Against the same with fill factor, blur and diffusion by transfer functions."""
    optics = replace(COMATIC, blur=1.5e-6)
    image = pixel_psf(optics, PITCH, *WAVES, 1e-4)
    save_psf_file(
        tmp_path / "p.fits",
        PsfFile("", image.table[None, None], PITCH / image.oversampling, False, None, image.energy),
    )
    for blur, diffusion, fill in ((0.0, 0.0, 1.0), (2e-6, 1e-6, 0.5)):
        wider = replace(optics, blur=float(np.hypot(optics.blur, blur)))
        true = pixel_psf(wider, PITCH, *WAVES, fill, diffusion)
        psf = pixel_psf(with_file(tmp_path / "p.fits", blur=blur), PITCH, *WAVES, fill, diffusion)
        made, wanted = one_star(psf, 0.2, -0.4), one_star(true, 0.2, -0.4)
        assert np.abs(made - wanted).max() < 1e-3 * wanted.max()
        assert psf.energy == image.energy


def of_its_own(case, path):
    """A case whose PSF is in a file."""
    optics = case.instrument.optics
    psf = psf_of(case.instrument)
    pitch = case.instrument.detector.pitch
    save_psf_file(
        path, PsfFile("", psf.table[None, None], pitch / psf.oversampling, True, pitch, psf.energy)
    )
    optics = replace(optics, psf="auto", blur=0.0, psf_file=str(path))
    return replace(case, instrument=replace(case.instrument, optics=optics))


def test_trials_of_all_fidelities_take_it(tmp_path):
    """The example with its own PSF as a file has the errors of the model, for the same noise.

    Single electrons differ if the fractions differ in their last digits.
    """
    case = load_design(shipped("designs/noise_only.toml")).case
    filed = of_its_own(case, tmp_path / "p.fits")
    for fidelity in (Fidelity.FRAME, Fidelity.SPOTS):
        wanted, made = (
            run_random_trial(one, seed=3, number=1, fidelity=fidelity) for one in (case, filed)
        )
        assert made.stars == wanted.stars
        assert made.error_x == pytest.approx(wanted.error_x, abs=5e-8)


def test_a_campaign_of_covariances_takes_it(tmp_path):
    """As with the model: the same fields, noise and statistics of stars; and its refusals."""
    design = load_design(shipped("designs/noise_only.toml"))
    filed = of_its_own(design.case, tmp_path / "p.fits")
    exposure = [one for one in design.campaign.variables if one.name.endswith("exposure")]
    campaign = replace(design.campaign, variables=tuple(exposure), fidelity=Fidelity.COVARIANCE)
    found = []
    for case in (design.case, filed):
        space = DesignSpace(case, campaign.variables)
        found.append(evaluate(space, campaign, space.start, TrialRunner(1), 200))
    wanted, made = found
    assert (wanted.note, made.note) == ("", "")
    assert made.error == pytest.approx(wanted.error, rel=0.01)
    assert made.expected == pytest.approx(wanted.expected, rel=0.01)
    with pytest.raises(ValueError, match="f_number must not be a variable if psf_file"):
        DesignSpace(filed, tuple(v for v in design.campaign.variables if "f_number" in v.name))


def test_what_it_refuses(tmp_path):
    good = PsfFile("", np.ones((1, 1, 9, 9)), 1e-6, False)
    save_psf_file(tmp_path / "p.fits", good)
    for changes in ({"defocus": 1e-5}, {"lens_file": "petzval"}, {"psf": "airy"}):
        with pytest.raises(ValueError, match="must be left out if psf_file"):
            with_file(tmp_path / "p.fits", **changes)
    with pytest.raises(ValueError, match="no file"):
        with_file(tmp_path / "none.fits")
    pixels = PsfFile("", np.ones((1, 1, 9, 9)), 1e-6, True, 4e-6)
    save_psf_file(tmp_path / "q.fits", pixels)
    with pytest.raises(ValueError, match="must be 4 um"):
        pixel_psf(with_file(tmp_path / "q.fits"), PITCH, *WAVES)
    for key, value in (("PSF", 2), ("SPACING", -1.0), ("SPACING", "wide"), ("ENERGY", 3.0)):
        with fits.open(tmp_path / "p.fits") as parts:
            parts[0].header[key] = value
            parts.writeto(tmp_path / "bad.fits", overwrite=True, checksum=True)
        with pytest.raises(ValueError, match="must"):
            load_psf_file(tmp_path / "bad.fits")
    with pytest.raises(ValueError, match="light in each image"):
        replace(good, image=np.zeros((1, 1, 9, 9)))
