"""Path -> where a star's image goes, the transfer function of that, and the MTF at Nyquist."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.camera import Camera
from startrack.values import Path

Floats = NDArray[np.float64]

NYQUIST = 0.5  # cycles per pixel


def image_path(path: Path, camera: Camera, direction: Floats) -> Floats:
    """Where the image of a star is, from its place at the middle of the exposure.

    direction  (3,) in camera axes, at the middle of the exposure
    Returns    (m, 2) pixel, (x, y) at each time of the path
    Errors     ValueError where the star gets behind the camera.
    """
    direction = np.asarray(direction, float)
    seen = Rotation.from_rotvec(path.rotation).apply(direction)
    if direction[2] <= 0 or (seen[:, 2] <= 0).any():
        raise ValueError("the star must stay before the camera in the whole exposure, it does not")
    return camera.project(seen) - camera.project(direction)


def transfer(offset: Floats, weight: Floats, frequency: Floats) -> NDArray[np.complex128]:
    """The transfer function of a motion: the Fourier transform of the PSF of its time density.

        M(f) = (1 / T) Int exp(-2 pi i f . s(t)) dt

    The density of s over time takes the place of 1 / |v_x| in eq. (14) of Krutz et al. (2011),
    so that rest, turning points and motion along y are no exceptions.

    offset     (m, 2) pixel, (x, y)
    weight     (m,) 1, share of the exposure
    frequency  (..., 2) cycles / pixel, along x and y
    Returns    (...) 1; its modulus is the modulation transfer function (MTF)
    Errors     numerical: that of the path's points: 1e-6 up to the Nyquist frequency.
    """
    phase = np.asarray(frequency, float) @ np.asarray(offset, float).T
    return np.exp(-2j * np.pi * phase) @ weight


def nyquist_mtf(offset: Floats, weight: Floats) -> tuple[float, float]:
    """The MTF at half a cycle per pixel, along x and along y; arguments as in `transfer`."""
    x, y = np.abs(transfer(offset, weight, np.diag([NYQUIST, NYQUIST]))).tolist()
    return x, y
