"""Images of stars -> the oversampled Psf that they share."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse

from startrack.core import Floats, Psf, Refused, Spots, whole
from startrack.optics.psf_file import PsfFile

ROUNDS = 8  # most rounds that fit PSF, then places and fluxes
STILL = 1e-4  # pixel, largest change of places in the last round
OUTLIER = 5.0  # sigma beyond which pixels are left out
SMOOTH = 1e-2  # weight of the curvature of the table relative to the pixels
LEAST_SNR = 12.0  # least SNR of a star for the measurement of a PSF
NEIGHBOUR = 0.02  # flux over the star's flux below which neighbours have no effect
FLOOR = 0.01  # error of the model, as a fraction of a pixel's light
REJECT = 0.05  # error of the model for the rejection of pixels, as a fraction of their light


@dataclass(frozen=True)
class PsfStars:
    """Cut-outs of isolated stars.

    image  (n, s, s) digital number, s odd
    x, y   (n,) pixel, place of the star from the middle of the cut-out
    flux   (n,) digital number
    """

    image: Floats
    x: Floats
    y: Floats
    flux: Floats


def lone_stars(image: NDArray[np.number], spots: Spots, half: int, saturation: float) -> PsfStars:
    """Cut-outs of the stars of an image without neighbours, borders and saturation.

    half        pixel, half side of a cut-out
    saturation  1, fraction of the image's largest number; brighter stars are left out
    """
    rows, columns = image.shape
    limit = saturation * float(image.max())
    x, y = spots.x, spots.y
    column, row = np.rint(x).astype(int), np.rint(y).astype(int)
    away = np.hypot(x[:, None] - x, y[:, None] - y) + np.diag(np.full(len(x), np.inf))
    matters = spots.flux > NEIGHBOUR * spots.flux[:, None]
    alone = np.where(matters, away, np.inf).min(axis=1, initial=np.inf) > 2 * half
    inside = (np.minimum(column, columns - 1 - column) > half) & (
        np.minimum(row, rows - 1 - row) > half
    )
    cuts, chosen = [], []
    for n in np.flatnonzero(alone & inside & (spots.snr > LEAST_SNR)):
        cut = image[row[n] - half : row[n] + half + 1, column[n] - half : column[n] + half + 1]
        if cut.max() < limit:
            cuts.append(np.asarray(cut, float))
            chosen.append(n)
    made = np.array(cuts).reshape(-1, 2 * half + 1, 2 * half + 1)
    return PsfStars(made, (x - column)[chosen], (y - row)[chosen], spots.flux[chosen])


def brightest(measured: Sequence[PsfStars], count: int) -> PsfStars:
    """The brightest stars of some images."""
    columns = zip(*(vars(part).values() for part in measured), strict=True)
    image, x, y, flux = (np.concatenate(parts) for parts in columns)
    order = np.argsort(-flux, kind="stable")[:count]
    return PsfStars(image[order], x[order], y[order], flux[order])


class MeasuredPsf(NamedTuple):
    """A reconstructed PSF.

    psf       PSF integrated over pixels; its energy inside the box is one
    residual  1, rms over the pixels of the stars of image minus model, over the peak
    x, y      (n,) pixel, places of the stars in their cut-outs
    flux      (n,) digital number
    """

    psf: Psf
    residual: float
    x: Floats
    y: Floats
    flux: Floats


def reconstruct(stars: PsfStars, oversampling: int = 4) -> MeasuredPsf:
    """The common PSF, integrated over pixels, of the images of many stars.

    The table is a cubic spline. The table is fitted to all pixels by least squares, then places,
    fluxes and backgrounds are fitted with this table, and both steps are repeated. The centroid of
    the table stays at its centre.

    Source: the effective PSF of Anderson & King (2000), PASP 112, 1360, with a spline in place of
    their smoothing.

    oversampling  samples per pixel
    Raises        ValueError if fewer than two stars per sample of a pixel are given.
    Accuracy      model: one PSF for all stars; pixels of one response. numerical: the stars' noise,
                  and smoothing by the curvature with the weight SMOOTH.
    """
    whole(2, 16, oversampling=oversampling)
    count = len(stars.image)
    if count < 2 * oversampling:
        raise Refused(
            f"stars must be {2 * oversampling} at least for an oversampling of {oversampling}, got "
            f"{count}"
        )
    fit = _PsfFit(stars, oversampling)
    for number in range(ROUNDS):
        fit.shape()
        if number > 1:
            fit.reject()
        if fit.move() < STILL and number > 1:
            break
    fit.shape()
    for _ in range(2):
        fit.centre()
        fit.shape()
    return fit.result()


class _PsfFit:
    def __init__(self, stars: PsfStars, oversampling: int) -> None:
        count, side, _ = stars.image.shape
        self.image, self.step = stars.image.reshape(count, -1), oversampling
        self.x, self.y = stars.x.astype(float), stars.y.astype(float)
        half = side // 2
        down, across = np.indices((side, side)) - half
        self.across, self.down = across.ravel().astype(float), down.ravel().astype(float)
        rim = np.hypot(across, down).ravel() > half - 0.5
        self.ground = np.median(self.image[:, rim], axis=1)
        self.noise = 1.4826 * float(
            np.median(np.abs(self.image[:, rim] - self.ground[:, None]))
        ) + 1e-9 * float(np.abs(self.image).max())
        self.flux = (self.image - self.ground[:, None]).sum(axis=1)
        self.half = (half - 1) * oversampling  # samples from the centre to the edge
        self.knots = 2 * self.half + 1 + 4
        self.spline = np.zeros(self.knots**2)
        self.good = np.ones_like(self.image, bool)
        line = sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(self.knots - 2, self.knots))
        whole_line = sparse.identity(self.knots)
        self.smooth = sparse.vstack([sparse.kron(line, whole_line), sparse.kron(whole_line, line)])

    def basis(self, slope: int = 0) -> sparse.csr_matrix:
        """(pixels of all stars, knots): the table at each pixel, or its slope along x or y."""
        u = (self.across - self.x[:, None]).ravel() * self.step + self.half + 2
        v = (self.down - self.y[:, None]).ravel() * self.step + self.half + 2
        inside = (u >= 1) & (u < self.knots - 2) & (v >= 1) & (v < self.knots - 2)
        u, v = np.where(inside, u, 1.0), np.where(inside, v, 1.0)
        first, second = np.floor(u).astype(int), np.floor(v).astype(int)
        along = _cubic(u - first, slope == 1) * (self.step if slope == 1 else 1)
        down = _cubic(v - second, slope == 2) * (self.step if slope == 2 else 1)
        value = (down[:, None] * along[None]) * inside
        offset = np.arange(-1, 3)
        column = (second + offset[:, None])[:, None] * self.knots + (first + offset[:, None])[None]
        row = np.broadcast_to(np.arange(len(u)), value.shape)
        return sparse.csr_matrix(
            (value.ravel(), (row.ravel(), column.ravel())), shape=(len(u), self.knots**2)
        )

    def shape(self) -> None:
        """The table from all pixels, then its centroid and its sum."""
        basis = self.basis()
        model = self.model(basis)
        flux = np.repeat(self.flux, self.image.shape[1])
        error = np.sqrt(self.noise**2 + (FLOOR * (model - self.ground[:, None])) ** 2).ravel()
        weight = self.good.ravel() / error
        left = sparse.diags(flux * weight) @ basis
        right = (self.image - self.ground[:, None]).ravel() * weight
        normal = (left.T @ left).tocsr()
        strength = SMOOTH * float(normal.diagonal().mean())
        normal = normal + strength * (self.smooth.T @ self.smooth)
        normal = normal + 1e-9 * normal.diagonal().max() * sparse.identity(self.knots**2)
        scale = sparse.diags(1 / normal.diagonal())
        self.spline, _ = sparse.linalg.cg(
            normal, left.T @ right, x0=self.spline, rtol=1e-6, maxiter=400, M=scale
        )
        table = self.table()
        total = float(table.sum()) / self.step**2
        self.spline /= total
        self.flux *= total

    def centre(self) -> None:
        """Shift the stars, so that the centroid of the next table is at its centre."""
        table = self.table()
        axis = (np.arange(len(table)) - self.half) / self.step
        self.x = self.x + float(table.sum(axis=0) @ axis / table.sum())
        self.y = self.y + float(table.sum(axis=1) @ axis / table.sum())

    def reject(self) -> None:
        """Leave out pixels that neighbours, defects and hits changed."""
        model = self.model(self.basis())
        light = np.maximum(model - self.ground[:, None], 0)
        error = np.sqrt(self.noise**2 * (1 + light / self.noise) + (REJECT * light) ** 2)
        self.good = np.abs(self.image - model) < OUTLIER * error

    def move(self) -> float:
        """Places, fluxes and backgrounds of the stars; returns the largest step, pixel."""
        shape = self.image.shape
        table, across, down = ((self.basis(k) @ self.spline).reshape(shape) for k in (0, 1, 2))
        largest = 0.0
        for n in range(shape[0]):
            good = self.good[n]
            columns = np.column_stack(
                [table[n], -self.flux[n] * across[n], -self.flux[n] * down[n], np.ones(shape[1])]
            )[good]
            if len(columns) < 8:
                continue
            rest = self.image[n][good]
            rest = rest - self.ground[n] - self.flux[n] * table[n][good]
            step = np.linalg.lstsq(columns, rest, rcond=None)[0]
            move = np.clip(step[1:3], -0.3, 0.3)
            self.flux[n] += step[0]
            self.x[n], self.y[n] = self.x[n] + move[0], self.y[n] + move[1]
            self.ground[n] += step[3]
            largest = max(largest, float(np.abs(move).max()))
        return largest

    def model(self, basis: sparse.csr_matrix) -> Floats:
        """(n, pixels) digital number."""
        table = (basis @ self.spline).reshape(self.image.shape)
        return self.ground[:, None] + self.flux[:, None] * table

    def table(self) -> Floats:
        """The spline at its own knots, without the rim."""
        square = self.spline.reshape(self.knots, self.knots)
        third = np.array([1.0, 4.0, 1.0]) / 6
        smooth = scipy.ndimage.convolve1d(square, third, axis=0)
        return scipy.ndimage.convolve1d(smooth, third, axis=1)[2:-2, 2:-2]

    def result(self) -> MeasuredPsf:
        table = self.table()
        residual = (self.image - self.model(self.basis()))[self.good]
        peak = float(np.median(self.flux)) * float(table.max())
        rms = float(np.sqrt(np.mean(residual**2))) / peak
        return MeasuredPsf(Psf(table, self.step, 1.0), rms, self.x, self.y, self.flux)


def _cubic(at: Floats, slope: bool) -> Floats:
    """Weights (4, n) of four knots by a cubic B-spline, or the slopes of these weights.

    at  (n,) place between the two middle knots, 0 to 1
    """
    t = at
    if slope:
        return np.stack(
            [-((1 - t) ** 2) / 2, (3 * t * t - 4 * t) / 2, (-3 * t * t + 2 * t + 1) / 2, t * t / 2]
        )
    return (
        np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t * t + 4, -3 * t**3 + 3 * t * t + 3 * t + 1, t**3])
        / 6
    )


def file_of(measured: MeasuredPsf, source: str) -> PsfFile:
    """Contents of a design's `psf_file`: images in pixels of any size."""
    psf = measured.psf
    return PsfFile(
        source, psf.table[None, None], 1 / psf.oversampling, pixel=True, energy=psf.energy
    )
