"""A field of displacements that no camera model can represent."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import svd

from startrack import load_design, shipped
from startrack.core import NODES, Camera, Displacement, map_weights, node_places
from startrack.optics import Optics, Residual
from startrack.optics.residual import _smooth, _weight, _without, taken_up

CAMERA = Camera(1024, 768, 2000.0)
LENS = Optics(focal_length=0.036, f_number=2.0), 18e-6  # and the pitch of a pixel


def test_the_rms_over_many_units_is_that_asked_for():
    place = CAMERA.project(CAMERA.lattice(25))
    square = [
        np.mean(Residual(0.1, seed=n).field(CAMERA, *LENS)(place) ** 2) for n in range(1, 201)
    ]
    assert np.sqrt(np.mean(square)) == pytest.approx(0.1, rel=0.06)


def test_a_camera_model_takes_up_nothing_of_it():
    place = node_places(CAMERA.columns, CAMERA.rows)
    line = np.ones(NODES)
    line[[0, -1]] = 0.5
    weight = np.tile(np.outer(line, line).ravel(), 2)
    model = taken_up(Camera(1024, 768, 2000.0), place)
    field = Residual(0.1, seed=3).field(CAMERA, *LENS)(place).T.ravel()
    assert np.abs(model.T @ (weight * field)).max() < 1e-9


def test_it_moves_with_temperature():
    place = CAMERA.project(CAMERA.lattice(9))
    cold, warm, hot = (
        Residual(0.1, drift=0.01, temperature=kelvin, seed=3).field(CAMERA, *LENS)(place)
        for kelvin in (0.0, 5.0, 10.0)
    )
    assert np.allclose(hot - cold, 2 * (warm - cold))
    assert np.sqrt(np.mean((hot - cold) ** 2)) == pytest.approx(0.1, rel=0.5)


def test_a_camera_projects_to_displaced_places_and_back():
    field = Residual(0.5, seed=3).field(CAMERA, *LENS)
    camera = Camera(1024, 768, 2000.0, residual=field)
    direction = CAMERA.lattice(9)
    ideal = CAMERA.project(direction)
    assert np.allclose(camera.project(direction), ideal + field(ideal))
    assert np.allclose(camera.unproject(camera.project(direction)), direction, atol=1e-9)
    assert camera.ideal == CAMERA


def test_a_displacement_is_cubic_between_its_nodes():
    x, y = node_places(100, 80).T
    cubic = Displacement(100, 80, tuple(np.concatenate([x**3 / 1e4, x * y / 1e3]).tolist()))
    place = np.array([[12.3, 45.6], [77.0, 3.0], [np.nan, 1.0]])
    found = cubic(place)
    expected = np.column_stack([place[:, 0] ** 3 / 1e4, place.prod(axis=1) / 1e3])
    assert np.allclose(found[:2], expected[:2])
    assert np.isnan(found[2]).all()


def test_a_draw_is_the_same_on_every_processor():
    """Exchanging two axes in the numbers exchanges them in the field: rounding selects no axis.

    On a square frame half of the vectors of its law belong to two equal eigenvalues, whose
    combinations depend on the library of linear algebra.
    """
    root = _smooth(512, 512, 0.4)
    exchanged = np.arange(NODES**2).reshape(NODES, NODES).T.ravel()
    np.testing.assert_allclose(root[np.ix_(exchanged, exchanged)], root, atol=1e-10)
    np.testing.assert_allclose(np.diag(root @ root.T), 1.0, rtol=1e-9)


def test_what_a_dense_map_leaves_is_that_of_an_orthogonal_projection():
    """A case in which the singular values of the normal equations did not converge: a map
    contains the shifts and linear terms of the camera's model a second time."""
    camera = Camera(512, 512, 0.01931406990365406 / 11e-6)
    place = node_places(512, 512)
    model = np.concatenate(
        [taken_up(camera, place), np.kron(np.eye(2), map_weights(512, 512, place, 8))], axis=1
    )
    root = np.kron(np.eye(2), _smooth(512, 512, 0.3))
    left = _without(model, root)
    half = np.sqrt(_weight())[:, None]
    basis, size, _ = svd(half * model / np.linalg.norm(model, axis=0), lapack_driver="gesvd")
    basis = basis[:, : (size > 1e-9 * size[0]).sum()]
    np.testing.assert_allclose(
        half * left, half * root - basis @ (basis.T @ (half * root)), atol=1e-12 * root.max()
    )
    np.testing.assert_allclose(model.T @ (half**2 * left), 0, atol=1e-9 * abs(model).max())


def test_what_calibration_leaves_is_found_for_each_of_a_familys_lenses():
    """For one of these lenses the singular values did not converge."""
    design = load_design(shipped("designs/nanosatellite.toml")).case.instrument
    lens = replace(
        design.optics,
        focal_length=0.01931406990365406,
        f_number=2.008536029750314,
        defocus=4.2054714704428744e-05,
    )
    camera = replace(design, optics=lens, residual=None).camera
    law = design.residual.law(camera, lens, design.detector.pitch, 5, True, 8)
    assert np.isfinite(law).all()
    assert 0.001 < np.sqrt((law**2).sum(-1).mean()) < 0.1  # pixel
