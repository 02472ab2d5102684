"""Lens tables: files, refusals, interpolation, and the shipped lenses against their ray tracer."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits

from startrack.optics import load_lens, open_lens, save_lens
from tests.optics.lenses import ideal

ORACLE = json.loads((Path(__file__).parents[1] / "oracle/lens.json").read_text())
PIXEL = 5.5e-6  # metre


def test_file_gives_back_the_table(tmp_path):
    table = ideal(0.3)
    save_lens(tmp_path / "lens.fits", table)
    found = load_lens(tmp_path / "lens.fits")
    for each in fields(table):
        assert np.array_equal(getattr(table, each.name), getattr(found, each.name)), each.name


def test_older_files_have_an_even_pupil_at_infinity(tmp_path):
    save_lens(tmp_path / "new.fits", ideal())
    with fits.open(tmp_path / "new.fits") as parts:
        kept = [part for part in parts if part.name not in ("CURVATURE", "AMPLITUDE", "OUTLINE")]
        fits.HDUList(kept).writeto(tmp_path / "old.fits", checksum=True)
    found = load_lens(tmp_path / "old.fits")
    assert found.amplitude.shape == found.outline.shape == (*found.area.shape, 0)
    assert np.array_equal(found.curvature, np.zeros(found.area.shape))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"focal_length": -1.0}, "focal_length must be positive"),
        ({"field": np.array([0.1, 0.2, 0.3, 0.4, 0.5])}, "field must hold zero first"),
        (
            {"field": np.array([0.0, 0.2, 0.1, 0.4, 0.5])},
            "field must hold finite numbers that rise",
        ),
        ({"wavelength": np.array([400.0, 500, 600, 700, 800])}, "wavelength must lie in"),
        ({"noll": np.array([4, 4, 11])}, "noll must hold each index once"),
        ({"noll": np.array([4, 7, 11])}, "even in y, got 7"),
        ({"noll": np.array([4, 9999, 11])}, "got 9999"),
        ({"place": np.zeros((1, 5, 4))}, "place must have the shape"),
        ({"area": np.full((1, 5, 5), np.nan)}, "area must hold finite numbers"),
        ({"area": np.full((1, 5, 5), 1e308)}, "area must hold finite numbers of at most"),
        ({"area": np.zeros((1, 5, 5))}, "area must be positive"),
        ({"pupil": np.full((1, 5, 5, 6), 1.5)}, "pupil must hold positive half axes"),
        ({"outline": np.zeros((1, 5, 4, 2))}, "outline must have the shape"),
        ({"amplitude": np.zeros((1, 5, 5, 4))}, "amplitude must hold at most the 3 terms of noll"),
        ({"curvature": np.zeros((1, 5))}, "curvature must have the shape"),
        ({"outline": np.full((1, 5, 5, 2), 0.6)}, "outline must hold harmonics"),
    ],
)
def test_impossible_tables_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        ideal(**changes)


def test_hostile_files_are_refused(tmp_path):
    path = tmp_path / "lens.fits"
    save_lens(path, ideal())
    whole = path.read_bytes()
    for content in (b"", b"SIMPLE", whole[: len(whole) // 2], whole[:-2880], whole[::-1]):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"lens\.fits"):
            load_lens(path)
    damaged = bytearray(whole)
    damaged[-3000] ^= 0xFF
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match="a lens table"):
        load_lens(path)
    with pytest.raises(ValueError, match="one of catadioptric, double_gauss, petzval, triplet"):
        open_lens("no_such_lens")
    with pytest.raises(ValueError, match="there is no file"):
        open_lens(str(tmp_path / "none.fits"))


@pytest.mark.parametrize(
    ("temperature", "wavelength", "field", "words"),
    [
        (300.0, 500e-9, 0.1, "temperature must lie in the lens table of ideal"),
        (293.15, 1100e-9, 0.1, "wavelength must lie"),
        (293.15, 500e-9, 0.21, "field must lie"),
    ],
)
def test_outside_of_the_table_is_refused(temperature, wavelength, field, words):
    with pytest.raises(ValueError, match=words):
        ideal().at(temperature, np.array([wavelength]), np.array([field]))


def test_interpolation_has_the_symmetry_of_a_lens_of_revolution():
    """Terms that are even or odd in the field stay so between the axis and the first node."""
    table = ideal()
    at = table.field
    wavefront = np.zeros(table.wavefront.shape)
    wavefront[..., 0], wavefront[..., 1] = at**2, at + 3 * at**3
    made = replace(table, wavefront=wavefront)
    near = np.array([0.0, 0.013, 0.04, 0.11, 0.2])
    found = made.at(293.15, np.array([555e-9]), near)
    assert np.abs(found.wavefront[0, :, 0] - near**2).max() < 1e-12
    assert np.abs(found.wavefront[0, :, 1] - near - 3 * near**3).max() < 1e-12
    # tan has all odd powers; a spline of the fifth degree leaves the seventh.
    assert np.abs(found.place[0] - 0.05 * np.tan(near)).max() < 1e-9


@pytest.mark.parametrize("name", ["double_gauss", "petzval"])
def test_shipped_lenses_have_the_places_of_their_ray_tracer(name):
    """Chief rays between the nodes of field and wavelength, which the tracer aims itself."""
    table = open_lens(name)
    for row in ORACLE[name]:
        found = table.at(
            293.15, np.array([row["wavelength_um"] * 1e-6]), np.radians([row["angle_deg"]])
        )
        assert abs(found.place[0, 0] - row["chief_mm"] * 1e-3) < 0.002 * PIXEL


@pytest.mark.parametrize("name", ["double_gauss", "petzval"])
def test_places_at_nine_fields_and_four_wavelengths(name):
    """Distortion and lateral colour at places between the nodes of the tables."""
    with fits.open(Path(__file__).parents[1] / "oracle/lens_grid.fits") as parts:
        wave, angle, chief = (
            np.array(parts[one].data, float)
            for one in ("wavelength", f"{name}_field", f"{name}_chief")
        )
    found = open_lens(name).at(293.15, wave, angle).place.T
    assert np.abs(found - chief).max() < 0.002 * PIXEL
