"""Lens tables in a design: the camera, its temperature, and what the tracker believes of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from startrack.budget.budget import causes
from startrack.design import Design, load_design, save_design
from startrack.io import from_table, shipped, to_table
from startrack.observation import images
from startrack.optics import open_lens

CASE = load_design(shipped("designs/noise_only.toml")).case


def behind_the_petzval(case=CASE, **tracker):
    optics = dataclasses.replace(
        case.instrument.optics, psf="auto", lens_file="petzval", focal_length=0.05, f_number=2.0
    )
    table = to_table(dataclasses.replace(case.instrument, optics=optics))
    table["thermal"] = {"lens": "35 degC"}
    instrument = from_table(type(case.instrument), table)
    believed = dataclasses.replace(case.tracker, **tracker)
    return dataclasses.replace(case, instrument=instrument, tracker=believed)


def test_a_lens_file_that_is_replaced_is_another_lens(tmp_path):
    """In one process and under the same name, no cached value belongs to the previous lens."""
    file = tmp_path / "lens.fits"
    optics = dataclasses.replace(
        CASE.instrument.optics, psf="auto", focal_length=0.05, f_number=4.0, lens_file=""
    )
    cameras = []
    for lens in ("double_gauss", "triplet", "double_gauss"):
        file.write_bytes(shipped(f"lenses/{lens}.fits").read_bytes())
        behind = dataclasses.replace(optics, lens_file=str(file))
        cameras.append(dataclasses.replace(CASE.instrument, optics=behind).camera)
    assert cameras[0].k1 != cameras[1].k1
    assert cameras[0].k1 == cameras[2].k1


def test_temperature_moves_the_image_as_the_traced_chief_rays(tmp_path):
    """The focal length of the fitted camera follows the places at the nodes of the table."""
    warm = behind_the_petzval()
    assert warm.instrument.lens_temperature == pytest.approx(308.15)
    cold = dataclasses.replace(
        warm, tracker=dataclasses.replace(CASE.tracker, calibrated_at=253.15)
    )
    ratio = cold.instrument.camera.focal_length_px / cold.believed_camera.focal_length_px - 1
    table = open_lens("petzval")
    wave = np.abs(table.wavelength - 600e-9).argmin()
    # -20, 20, 60 degC; a parabola between them. The camera is fitted to centroids, which the
    # change of focus moves by some per cent of that.
    place = table.place[:, wave, 3]
    curve = np.polynomial.Polynomial.fit(table.temperature, place, 2)
    assert ratio == pytest.approx(float(curve(308.15) / curve(253.15)) - 1, rel=0.06)
    assert abs(ratio) > 1e-4
    design = tmp_path / "design.toml"
    save_design(design, Design(cold))
    assert 'lens = "308.15 K"' in design.read_text() or 'lens = "35 degC"' in design.read_text()
    assert load_design(design).case == cold


def test_a_calibration_at_another_temperature_is_a_cause_of_error():
    case = behind_the_petzval(calibrated_at=293.15)
    cause = next(one for one in causes(case) if one.name == "camera model")
    assert cause.without(case).believed_camera == case.instrument.camera
    assert case.believed_camera != case.instrument.camera


def test_what_a_lens_table_does_not_say_is_refused():
    with pytest.raises(ValueError, match=r"thermal\.lens must be left out"):
        from_table(
            type(CASE.instrument), {**to_table(CASE.instrument), "thermal": {"lens": "35 degC"}}
        )
    case = behind_the_petzval()
    hot = dataclasses.replace(
        case.instrument, thermal=dataclasses.replace(case.instrument.thermal, lens=400.0)
    )
    with pytest.raises(ValueError, match="temperature must lie in the lens table"):
        _ = hot.camera
    wide = dataclasses.replace(case.instrument.optics, focal_length=0.02)
    with pytest.raises(ValueError, match="lens_file must reach the corner"):
        _ = dataclasses.replace(case.instrument, optics=wide).camera


def test_a_difference_of_temperatures_is_not_in_celsius():
    thermal = {"temperature": "10 degC", "doubling": "8 degC"}
    with pytest.raises(ValueError, match="doubling must have a unit that converts to K"):
        from_table(
            type(CASE.instrument.detector),
            {**to_table(CASE.instrument.detector), "thermal": thermal},
        )


def test_a_family_makes_the_images_and_the_camera_of_its_table(monkeypatch):
    """If it is no faster than the traced lens, its images are those of the shipped table."""
    plain = dataclasses.replace(CASE.instrument.optics, psf="auto", focal_length=0.035)
    family = dataclasses.replace(
        CASE.instrument, optics=dataclasses.replace(plain, lens_family="double-gauss")
    )
    file = dataclasses.replace(
        CASE.instrument, optics=dataclasses.replace(plain, lens_file="double_gauss")
    )
    assert family.camera == file.camera
    asked = []
    monkeypatch.setattr(images, "field_psf", lambda lens, *rest: asked.append(lens.table))
    images.images_of(family)
    (used,), known = asked, open_lens("double_gauss")
    for each in dataclasses.fields(known):  # not the same object where it was loaded again
        np.testing.assert_array_equal(getattr(used, each.name), getattr(known, each.name))
