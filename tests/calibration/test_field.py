"""Cameras fitted to tables of stars, against Chandra's published calibration and its stars."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.calibration.field import (
    Order,
    assumed_array,
    cross_validate,
    cross_validate_all,
    fit_attitude,
    fit_field,
    orders_of,
    residuals,
    supported_order,
)
from startrack.calibration.star_table import StarTable, angles_of, read_star_table
from startrack.cli.main import main
from startrack.cli.terminal import save_camera
from startrack.core import ZERO_CELSIUS, Camera, FieldPolynomial, arcsec

ARRAY = 1024, 1024, (-511.5, -511.5)


def published(oracle, row, column, celsius):
    """Angles y and z, arcsec, by the published polynomial."""
    camera = oracle("chandra_camera.json")
    values = {"r": row, "c": column, "t": celsius, "1": np.ones(len(row))}
    terms = [math.prod(values[letter] for letter in term) for term in camera["terms"]]
    return np.column_stack(terms) @ np.array(camera["coefficients"])


@pytest.fixture(scope="module")
def chandra(oracle):
    """A table without noise, of 500 places at 15 to 30 degrees Celsius."""
    rng = np.random.default_rng(5)
    row, column = rng.uniform(-480, 480, (2, 500))
    celsius = rng.uniform(15, 30, 500)
    y, z = np.tan(published(oracle, row, column, celsius).T * arcsec)
    direction = np.column_stack([np.ones(500), y, z])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    pixel = np.column_stack([column, row])
    return StarTable(direction, pixel, celsius + ZERO_CELSIUS, np.ones(500), "yz")


def test_the_published_camera_is_found_again(chandra):
    """The fit goes from pixels to angles and has more terms of temperature.

    The difference is 0.03 arcsec, a sixth of the residual of stars in flight.
    """
    fit = fit_field(chandra, Order("3", True), *ARRAY)
    angle, pixel = residuals(fit, chandra, ARRAY[2])
    assert (np.sqrt(np.mean(angle**2, axis=0)) < 0.035 * arcsec).all()
    assert np.sqrt(np.mean(pixel**2)) < 0.007
    assert (fit.camera.columns, fit.camera.focal_length_px) == (1024, pytest.approx(41508, abs=30))


def test_noise_and_outliers_move_the_fit_as_its_covariance_states(chandra):
    """The chi-square of the difference from the camera without noise; false alarm 1e-4."""
    rng = np.random.default_rng(11)
    noise = rng.normal(0, 0.04, chandra.pixel.shape)
    noise[:25] += rng.uniform(-50, 50, (25, 2))
    order = Order("3", True)
    true = fit_field(chandra, order, *ARRAY)
    noisy = StarTable(
        chandra.direction, chandra.pixel + noise, chandra.temperature, chandra.sigma, "yz"
    )
    fit = fit_field(noisy, order, *ARRAY)
    assert set(np.flatnonzero(~fit.used)) >= set(np.flatnonzero(np.abs(noise).max(axis=1) > 1))
    assert fit.used.sum() > 470
    places = chandra.direction[::5]
    shift = [one.camera.project(one.attitude.apply(places)) for one in (true, fit)]
    # 26 unknowns share the noise: 0.04 px sqrt(26 / 2 / 475) in the mean.
    assert np.sqrt(np.mean((shift[0] - shift[1]) ** 2)) < 0.04 * math.sqrt(13 / 475) * 1.5


def test_the_order_that_made_the_stars_is_borne():
    """Stars made with k1 alone, without temperature: neither fewer unknowns nor many more are
    chosen."""
    camera = Camera(512, 512, 1500.0, k1=-0.2)
    rng = np.random.default_rng(2)
    pixel = rng.uniform(0, 511, (300, 2))
    direction = camera.unproject(pixel)
    noisy = pixel + rng.normal(0, 0.05, pixel.shape)
    kelvin = rng.uniform(280, 300, 300)
    table = StarTable(direction, noisy, kelvin, np.ones(300), "vectors")
    orders = [Order("none"), Order("radial"), Order("radial", True), Order("3")]
    chosen = supported_order(cross_validate_all(table, orders, *assumed_array(table)))
    assert chosen.order == Order("radial")
    # An unseen star has the noise of a star and of the fit.
    assert math.sqrt(chosen.mean_square) == pytest.approx(0.05, rel=0.1)
    fit = fit_field(table, chosen.order, *assumed_array(table))
    sigma = dict(zip(fit.names, np.sqrt(fit.covariance.diagonal()), strict=True))
    assert fit.camera.k1 == pytest.approx(-0.2, abs=4 * sigma["k1"])
    assert fit.camera.focal_length_px == pytest.approx(1500, abs=4 * sigma["focal_length_px"])


def test_a_camera_applied_to_other_stars_leaves_their_noise(tmp_path, capsys):
    """With another table at another attitude, only three fitted unknowns absorb part of the
    noise."""
    camera = Camera(512, 512, 1500.0, k1=-0.2)
    rng = np.random.default_rng(5)
    pixel = rng.uniform(0, 511, (200, 2))
    turn = Rotation.from_rotvec([0.02, -0.01, 0.3])
    noisy = pixel + rng.normal(0, 0.05, pixel.shape)
    direction = turn.inv().apply(camera.unproject(pixel))
    table = StarTable(direction, noisy, None, np.ones(200), "vectors")
    fit = fit_attitude(table, camera, (0.0, 0.0))
    off = (fit.attitude * turn.inv()).as_rotvec()
    # Chi-square of three unknowns, false alarm 1e-4.
    assert off @ np.linalg.solve(fit.covariance, off) < 21.1
    assert np.sqrt(np.mean(fit.residual**2)) == pytest.approx(0.05, rel=0.1)
    wrong = fit_attitude(table, replace(camera, k1=-0.1), (0.0, 0.0))
    assert np.sqrt(np.mean(wrong.residual**2)) > 0.1

    path, file = tmp_path / "stars.csv", tmp_path / "camera.toml"
    rows = [",".join(map(str, [*d, *p])) for d, p in zip(direction, noisy, strict=True)]
    path.write_text("\n".join(["ux,uy,uz,column,row", *rows]))
    save_camera(file, camera)
    assert main(["calibrate", str(path), "--fitted", str(file), "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["residual_rms_px"] == pytest.approx(0.05, rel=0.1)
    assert main(["calibrate", str(path), "--fitted", str(file), "--distortion", "3"]) == 2


def test_stars_in_flight(outside):
    """The published residuals of Chandra's calibration: 0.19 and 0.20 arcsec, 0.24 and 0.28
    without temperature."""
    table = read_star_table(outside / "references" / "chandra" / "stars_2020.csv")
    assert len(table) == 564
    warm = cross_validate(table, Order("3", True), *assumed_array(table))
    cold = cross_validate(table, Order("3"), *assumed_array(table))
    assert (warm.rms <= np.array([0.19, 0.20]) * arcsec).all()
    assert (cold.rms <= np.array([0.245, 0.285]) * arcsec).all()
    assert supported_order([warm, cold]) is warm
    assert warm.inlier.sum() >= 560


def test_mirrored_tables_and_lines_are_refused(chandra):
    mirrored = StarTable(
        chandra.direction, chandra.pixel * [1, -1], chandra.temperature, chandra.sigma, "yz"
    )
    with pytest.raises(ValueError, match="mirrored"):
        fit_field(mirrored, Order("none"), *ARRAY)
    cold = StarTable(chandra.direction, chandra.pixel, None, chandra.sigma, "yz")
    with pytest.raises(ValueError, match="temperature"):
        fit_field(cold, Order("none", True), *ARRAY)
    with pytest.raises(ValueError, match="at least 20 stars"):
        fit_field(chandra.part(slice(15)), Order("3", True), *ARRAY)
    assert all(not order.warm for order in orders_of(cold))


@pytest.mark.parametrize("kind", ["csv", "fits", "vot"])
def test_a_table_of_any_format_gives_the_camera(chandra, tmp_path, capsys, kind):
    from astropy import units
    from astropy.table import Table

    rng = np.random.default_rng(3)
    pixel = chandra.pixel + rng.normal(0, 0.04, chandra.pixel.shape)
    angles = angles_of("yz", chandra.direction)
    path = tmp_path / f"stars.{kind}"
    if kind == "csv":
        columns = [*np.degrees(angles).T, *pixel.T, chandra.temperature - ZERO_CELSIUS]
        names = ["yag_deg", "zag_deg", "col", "row", "temp_c"]
        Table(columns, names=names).write(path)
    else:
        columns = [*(angles.T * units.rad).to("arcmin"), *pixel.T, chandra.temperature * units.K]
        names = ["Y_ANGLE", "Z_ANGLE", "COLUMN", "ROW", "TEMPERATURE"]
        Table(columns, names=names).write(path, format={"vot": "votable"}.get(kind, kind))
    camera = tmp_path / "camera.toml"
    options = ["--distortion", "3", "--folds", "3", "--camera", str(camera), "--json"]
    assert main(["calibrate", str(path), *options]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["chosen"]["temperature_terms"] == "linear"
    assert result["unseen_rms_px"] == pytest.approx(0.04, rel=0.1)
    assert set(result["unseen_rms_arcsec"]) == {"y_angle", "z_angle"}
    assert "polynomial" in camera.read_text()


def test_directions_as_vectors_and_on_the_sky_are_the_same(chandra, tmp_path):
    from astropy.table import Table

    radec = np.degrees(angles_of("radec", chandra.direction))
    columns = {"ra": radec[:, 0], "dec": radec[:, 1], "x": chandra.pixel[:, 0]}
    columns |= {"y": chandra.pixel[:, 1]}
    columns |= dict(zip(("ux", "uy", "uz"), 3 * chandra.direction.T, strict=True))
    Table(columns).write(tmp_path / "both.csv")
    found = read_star_table(tmp_path / "both.csv")
    assert found.kind == "vectors"
    np.testing.assert_allclose(found.direction, chandra.direction, atol=1e-12)
    del columns["ux"]
    Table(columns).write(tmp_path / "sky.csv")
    found = read_star_table(tmp_path / "sky.csv")
    assert found.kind == "radec"
    np.testing.assert_allclose(found.direction, chandra.direction, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("a,b\n1,2\n", "columns of directions"),
        ("ra,dec\n1,2\n", "columns of pixels"),
        ("y_angle,z_angle,row,column\n1,2,3,4\n", "must have a unit"),
        ("ra,dec,x,y\n1,2,3,4\n", "at least 4 stars"),
        ("ra,dec,x,y\n1,2\n", "comma-separated"),
    ],
)
def test_tables_that_cannot_be_used_are_refused(tmp_path, capsys, text, rule):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    assert main(["calibrate", str(path)]) == 2
    assert rule in capsys.readouterr().err


def test_a_polynomial_camera_inverts_and_warms():
    polynomial = FieldPolynomial(
        (1e-4, 0.01, 0, 0.2), (0, 0, -0.02), (1e-6, 1e-5), (), 300.0, 290.0
    )
    camera = Camera(1024, 768, 4000.0, k1=-0.1, polynomial=polynomial)
    pixel = np.array([[0.0, 0.0], [511.5, 383.5], [1000.0, 12.0]])
    np.testing.assert_allclose(camera.project(camera.unproject(pixel)), pixel, atol=1e-9)
    u, v = 0.05, -0.03
    at = camera.project(np.array([[u, v, 1]]))[0]
    radial = 1 - 0.1 * (u * u + v * v)
    x = u * radial + 1e-4 + 0.01 * u + 0.2 * u * u + 10 * (1e-6 + 1e-5 * u)
    y = v * radial - 0.02 * v
    np.testing.assert_allclose(at, [511.5 + 4000 * x, 383.5 + 4000 * y], atol=1e-9)


def test_a_table_without_an_end_of_line_is_read(tmp_path):
    whole, open_ended = tmp_path / "whole.csv", tmp_path / "open.csv"
    rows = "y_angle_arcsec,z_angle_arcsec,row_px,column_px\n" + "".join(
        f"{y},{z},{-y / 5},{z / 5}\n" for y in range(-400, 401, 200) for z in range(-400, 401, 200)
    )
    whole.write_text(rows)
    open_ended.write_text(rows.rstrip("\n"))
    assert len(read_star_table(open_ended).pixel) == len(read_star_table(whole).pixel) == 25
