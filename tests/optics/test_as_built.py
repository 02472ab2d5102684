"""Displacements of stars by misaligned lens elements, against rays of another program."""

import json
from pathlib import Path

import numpy as np
import pytest

from startrack.core import Camera, arcsec, um
from startrack.io import shipped
from startrack.optics import Optics
from startrack.optics.as_built import (
    KINDS,
    SHIFT,
    TURN,
    _elements,
    _traced,
    built_lens,
    element_slopes,
)
from startrack.optics.surfaces import open_surfaces

ORACLE = json.loads((Path(__file__).parents[1] / "oracle/as_built.json").read_text("utf-8"))


def test_chief_rays_move_as_those_of_another_program():
    checked = 0
    for case in ORACLE["cases"]:
        surfaces = open_surfaces(shipped(f"lenses/{case['lens']}.fits"))
        kinds, ways = _elements(surfaces)
        first, last = case["surfaces"]
        span = slice(last if case["kind"] == "wedge" else first, last + 1)
        size = ORACLE["shift_mm"] * 1e-3 / SHIFT
        if case["kind"] != "decentre":
            size = ORACLE["turn_rad"] / TURN
        # The way, towards y, in which these surfaces and no others are off.
        [way] = [
            way * size
            for kind, way in zip(kinds, ways[1:], strict=True)
            if KINDS[kind] == case["kind"]
            and way[span, 1::2].any()
            and np.flatnonzero(way.any(axis=1)).tolist() == list(range(len(surfaces)))[span]
        ]
        off = np.stack([np.zeros_like(way), way])
        placed = _traced(surfaces, np.array(case["tangent"]), np.zeros((1, 2)), off)
        moved = (placed[1] - placed[0]) * 1e3
        size = np.abs(case["moved_mm"]).max()
        # Rays are aimed at the paraxial entrance pupil here, at the true stop there: 0.05 um.
        assert np.abs(moved - case["moved_mm"]).max() < 0.02 * size + 5e-5, case
        checked += 1
    assert checked == 21


def test_each_element_is_off_in_each_way_and_direction():
    surfaces = open_surfaces(shipped("lenses/double_gauss.fits"))
    kinds, off = _elements(surfaces)
    assert [int((kinds == kind).sum()) for kind in range(3)] == [8, 8, 12]  # 4 groups, 6 glasses
    assert off.shape == (29, len(surfaces), 4)


def test_a_decentre_that_is_the_same_for_all_elements_is_that_of_the_lens():
    # The whole lens shifted against stop and detector shifts all images; not the boresight's scale.
    optics, camera = Optics(focal_length=0.05, f_number=2.0), Camera(1024, 1024, 0.05 / 18e-6)
    slopes = element_slopes(built_lens(optics, "double-gauss", camera))
    shifted = slopes.slope[:, slopes.kind == KINDS.index("decentre")]
    x_alike, y_alike = shifted[:, :4].sum(axis=1), shifted[:, 4:].sum(axis=1)
    half = len(x_alike) // 2
    per_um = um / 18e-6
    assert x_alike[:half] * um == pytest.approx(np.full(half, per_um), rel=0.03)
    assert y_alike[half:] * um == pytest.approx(np.full(half, per_um), rel=0.03)
    assert np.abs(x_alike[half:] * um).max() < 0.03 * per_um


def test_a_lens_without_surfaces_is_refused():
    camera = Camera(64, 64, 1000.0)
    with pytest.raises(ValueError, match=r"residual\.family must name a family"):
        element_slopes(built_lens(Optics(focal_length=0.05, f_number=2.0), "", camera))


def test_a_tilt_of_an_arcminute_leaves_arcseconds():
    optics, camera = Optics(focal_length=0.05, f_number=2.0), Camera(1024, 1024, 0.05 / 18e-6)
    slopes = element_slopes(built_lens(optics, "double-gauss", camera))
    tilted = slopes.slope[:, slopes.kind == KINDS.index("tilt")] * 60 * arcsec
    assert 0.01 < np.abs(tilted).max() < 10
