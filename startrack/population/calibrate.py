"""Camera of a unit -> camera model and alignment by its calibration, which is run or drawn."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude import UNKNOWNS, Calibration, calibrate, camera_slopes, camera_vector
from startrack.core import Camera, Floats, Ints
from startrack.design import CameraCalibration

# Prior standard deviations, wide compared with differences between units; as in `Calibration`.
FOCAL, PRINCIPAL, DISTORTION = 0.02, 50.0, 1.0
LEAST_NOISE = 1e-4  # pixel; less noise does not improve the fit
FEW = 1e-3  # of the mean weight of a map's nodes, for nodes with few places near
Draws = Callable[[str], np.random.Generator]  # purpose -> generator, as `Streams`
LATTICE = 9  # places along each side, over which an alignment is fitted


def calibrated(
    camera: Camera, design: Camera, settings: CameraCalibration, streams: Draws
) -> Camera:
    """The camera model of a calibration that is run: `calibrate` on measured stars.

    camera   of the unit at the calibration, with its residual
    design   camera from which the fit starts; for a recursive calibration the estimated camera,
             with a fixed principal point
    streams  of the unit
    """
    spots, matches = [], []
    for pixel, attitude, random in _frames(camera, settings, streams):
        direction = attitude.inv().apply(_shown(camera, pixel, settings, random))
        seen = pixel + settings.noise * random.standard_normal(pixel.shape)
        spots.append(_as_spots(seen, settings))
        matches.append(_as_matches(direction, design, attitude))
    model = calibrate(spots, matches, design.ideal, _priors(settings)).camera
    return _mapped(camera, model, settings, streams)


def drawn(camera: Camera, design: Camera, settings: CameraCalibration, streams: Draws) -> Camera:
    """The camera model of a calibration, drawn from the distribution of `calibrated`.

        estimate - truth = G residual + C (H^T M K (truth - design) - P (truth - design)) + N(0, C)
        C = (H^T M H + P)^-1

    H and K are the derivatives at the design by the fitted and by the fixed parameters. M is the
    inverse covariance of the measurements without the part that an attitude absorbs. P is the
    inverse covariance of the priors. On the ground the positions are known, and the residual at
    them acts through the gain G. In orbit stars are anywhere, and the residual counts as noise with
    its rms over the frame. Arguments as `calibrated`.

    Accuracy  the rms displacement over the frame after it agrees with `calibrated` within 5 %.
    """
    fit = _fit(design.ideal, settings)
    random = streams("calibration of the camera")
    free = fit.free
    truth, start = camera_vector(camera), camera_vector(design)
    noise = fit.noise
    shift = np.zeros(len(free))
    if camera.residual is not None:
        if settings.place == "ground":
            shift = fit.gain @ camera.residual(_positions(camera, settings)).ravel()
        else:
            rms = np.sqrt(np.mean(camera.residual(_lattice(camera)) ** 2))
            noise = float(np.hypot(noise, rms))
    normal = fit.normal / noise**2
    fixed = np.delete(np.arange(len(truth)), free)
    covariance = np.linalg.inv(normal[np.ix_(free, free)] + fit.prior)
    shift = shift + covariance @ normal[np.ix_(free, fixed)] @ (truth - start)[fixed]
    shift = shift + np.linalg.cholesky(covariance) @ random.standard_normal(len(free))
    shift = shift - covariance @ fit.prior @ (truth - start)[free]
    vector = start.copy()
    vector[free] = truth[free] + shift
    model = replace(design.ideal, **dict(zip(UNKNOWNS, vector.tolist(), strict=True)))
    return _mapped(camera, model, settings, streams)


def _mapped(camera: Camera, model: Camera, settings: CameraCalibration, streams: Draws) -> Camera:
    """A camera model with the map that a calibration fits to the residuals of the model.

    The residuals are measured at the places of the calibration, with independent noise.
    """
    if not settings.nodes:
        return model
    random = streams("map of the camera")
    if settings.place == "ground":
        pixel = _positions(camera, settings)
    else:
        count = settings.frames * settings.stars
        pixel = random.random((count, 2)) * (camera.columns, camera.rows) - 0.5
    turn = alignment(camera, model)
    seen = pixel + settings.noise * random.standard_normal(pixel.shape)
    residual = seen - model.project(turn.apply(_shown(camera, pixel, settings, random)))
    weight = core.map_weights(camera.columns, camera.rows, pixel, settings.nodes)
    normal = weight.T @ weight
    normal += FEW * np.trace(normal) / len(normal) * np.eye(len(normal))
    node: Floats = np.linalg.solve(normal, weight.T @ residual).astype(np.float64)
    return replace(model, residual=core.map_displacement(camera.columns, camera.rows, node))


def alignment(camera: Camera, believed: Camera) -> Rotation:
    """The rotation true_to_believed with which both cameras agree best over the frame."""
    pixel = _lattice(camera)
    turn, _ = Rotation.align_vectors(believed.unproject(pixel), camera.unproject(pixel))
    return turn


def left_over(camera: Camera, believed: Camera) -> Floats:
    """Displacements (n, 2) pixel over the frame after a calibration, without a common turn."""
    pixel = _lattice(camera)
    turned = alignment(camera, believed).apply(camera.unproject(pixel))
    return pixel - believed.project(turned)


def _frames(
    camera: Camera, settings: CameraCalibration, streams: Draws
) -> Iterator[tuple[Floats, Rotation, np.random.Generator]]:
    """Places of stars, attitude and random numbers of each frame of a calibration."""
    random = streams("calibration run")
    if settings.place == "ground":
        yield _positions(camera, settings), Rotation.identity(), random
        return
    size = np.array([camera.columns, camera.rows])
    for _ in range(settings.frames):
        attitude = Rotation.from_quat(random.standard_normal(4))
        yield random.random((settings.stars, 2)) * size - 0.5, attitude, random


def _shown(
    camera: Camera, pixel: Floats, settings: CameraCalibration, random: np.random.Generator
) -> Floats:
    """Directions (n, 3) of stars at some places, as a catalogue or a collimator states them."""
    direction = camera.unproject(pixel)
    if settings.place == "ground" and settings.direction:
        turn = settings.direction * random.standard_normal(direction.shape)
        direction = Rotation.from_rotvec(turn).apply(direction)
    return direction


def _positions(camera: Camera, settings: CameraCalibration) -> Floats:
    """Places (n, 2) of a calibration on the ground, evenly over the frame."""
    across = max(round((settings.positions * camera.columns / camera.rows) ** 0.5), 2)
    down = max(round(settings.positions / across), 2)
    x = (np.arange(across) + 0.5) / across * camera.columns - 0.5
    y = (np.arange(down) + 0.5) / down * camera.rows - 0.5
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _lattice(camera: Camera) -> Floats:
    x = np.linspace(0, camera.columns - 1, LATTICE)
    y = np.linspace(0, camera.rows - 1, LATTICE)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _as_spots(pixel: Floats, settings: CameraCalibration) -> core.Spots:
    many, variance = len(pixel), max(settings.noise, LEAST_NOISE) ** 2
    ones = np.ones(many)
    covariance = np.tile(variance * np.eye(2), (many, 1, 1))
    x, y = pixel.T.copy()
    return core.Spots(x, y, ones, covariance, ones, np.ones(many, np.int64))


def _as_matches(direction: Floats, camera: Camera, attitude: Rotation) -> core.Matches:
    every = np.arange(len(direction))
    return core.Matches(
        status=core.Status.SOLVED,
        reason="",
        spot=every,
        star=every,
        direction=direction,
        camera=camera,
        icrs_to_camera=attitude,
        false_probability=0.0,
    )


def _priors(settings: CameraCalibration) -> Calibration:
    k1, k2, k3 = (DISTORTION if settings.order >= order else 0.0 for order in (3, 5, 7))
    tangential = DISTORTION if settings.tangential else 0.0
    principal = 0.0 if settings.place == "recursive" else PRINCIPAL
    return Calibration(FOCAL, principal, k1, k2, k3, tangential, floor=0.0)


class _CalibrationFit(NamedTuple):
    """A linear fit of the camera.

    free    (k,) indices of the fitted UNKNOWNS
    normal  (8, 8) of UNKNOWNS for a noise of one pixel, without the part of the attitudes
    prior   (k, k)
    noise   pixel rms per axis
    gain    (k, 2 n) derivative of the unknowns by the places on the ground, pixel
    """

    free: Ints
    normal: Floats
    prior: Floats
    noise: float
    gain: Floats


@lru_cache(maxsize=32)
def _fit(design: Camera, settings: CameraCalibration) -> _CalibrationFit:
    sigma = _priors(settings).sigma(design)
    free = np.flatnonzero(sigma > 0)
    prior = np.diag(sigma[free] ** -2.0)
    direction = settings.direction * design.focal_length_px
    noise = max(settings.noise, LEAST_NOISE)
    if settings.place == "ground":
        noise = float(np.hypot(noise, direction))
        slopes = _slopes(design, _positions(design, settings))
        normal = slopes.T @ slopes
        both = normal[np.ix_(free, free)] + noise**2 * prior
        gain = np.asarray(np.linalg.solve(both, slopes[:, free].T), float)
        return _CalibrationFit(free, normal, prior, noise, gain)
    # In orbit: the expected information of a frame of these stars, from many frames.
    random, size = core.Streams(0, 0)("places of a calibration"), (design.columns, design.rows)
    normal, frames = np.zeros((len(UNKNOWNS), len(UNKNOWNS))), 200
    for _ in range(frames):
        slopes = _slopes(design, random.random((settings.stars, 2)) * size - 0.5)
        normal += slopes.T @ slopes * (settings.frames / frames)
    return _CalibrationFit(free, normal, prior, noise, np.zeros((len(free), 0)))


def _slopes(camera: Camera, pixel: Floats) -> Floats:
    """Derivatives (2 n, 8) of places by UNKNOWNS, x and y of each star, without a common turn."""
    by_camera, by_turn = camera_slopes(camera, camera.unproject(pixel))
    rows, turn = by_camera.reshape(-1, len(UNKNOWNS)), by_turn.reshape(-1, 3)
    return np.asarray(rows - turn @ np.linalg.lstsq(turn, rows, rcond=None)[0])
