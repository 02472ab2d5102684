"""Optics with a file of several images -> the camera that fits, and the FieldPsf of a detector."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from startrack.core import Camera, FieldPsf, Floats, Refused
from startrack.optics.field_images import (
    BAND_NODES,
    COARSE,
    FEW_NODES,
    NODES,
    Band,
    band_of,
    camera_through,
    images_over_frame,
    refuse_band,
)
from startrack.optics.lens_table import spline
from startrack.optics.parameters import Optics
from startrack.optics.psf_file import FINE, PsfFile, averaged, open_psf_file

DEGREE = 3  # of the splines between the nodes of a file


def cube_psf(
    optics: Optics, camera: Camera, pitch: float, wavelength: Floats, spectra: Floats,
    colour: Floats, fill_factor: float, diffusion: float, nodes: int = NODES,
) -> FieldPsf:  # fmt: skip
    """Images of stars over the frame and over their colour, from those of a `psf_file`.

    Between its nodes, images are interpolated by cubic splines over the field angle, through the
    mirror images of the nodes too, and over the inverse of the wavelength; those off the axis are
    turned to the azimuth of the star. Arguments as those of `field_psf`.

    Raises    ValueError where the file does not hold the frame or the band.
    Accuracy  numerical: that of the splines; the error between the nodes of the frame is measured.
    """
    found = open_psf_file(optics.psf_file)
    _refuse_colours(found, wavelength, spectra)
    count = BAND_NODES if optics.psf_tolerance < COARSE else FEW_NODES
    plan = _Plan(
        optics, found, camera, pitch, band_of(wavelength, spectra, count), fill_factor, diffusion
    )
    return images_over_frame(plan, camera, colour, optics.psf_tolerance < COARSE, nodes)


def camera_of_cube(
    optics: Optics, columns: int, rows: int, pitch: float, principal: tuple[float, float],
    wavelength: Floats, spectrum: Floats,
) -> Camera:  # fmt: skip
    """The camera that fits the places of a `psf_file`, in light of one spectrum.

    As `fit_camera`, to the centroids of the images.
    """
    found = open_psf_file(optics.psf_file)
    assert found.place is not None
    _refuse_colours(found, wavelength, spectrum[None])
    band = band_of(wavelength, spectrum[None])
    n = found.image.shape[-1]
    at = (np.arange(n) - n // 2) * found.spacing
    light = found.image.sum(axis=2)
    centroid = found.place + light @ at / light.sum(axis=-1)

    def places(angles: Floats) -> Floats:
        over_field = _over_field(found, angles, odd=True)  # (a, f)
        return np.asarray(band.weight[0] @ (_over_colour(found, band) @ centroid) @ over_field.T)

    return camera_through(
        places, float(found.angle[-1]), "psf_file", columns, rows, pitch, principal
    )


def _refuse_colours(found: PsfFile, wavelength: Floats, spectra: Floats) -> None:
    if len(found.wavelength) > 1:
        refuse_band("psf_file", found.wavelength, wavelength, spectra)


def _over_colour(found: PsfFile, band: Band) -> Floats:
    """Weights (n, w) of the images at the wavelengths of a band."""
    nodes = found.wavelength
    unit = np.eye(len(nodes))
    return spline(-1 / nodes, unit, -1 / np.clip(band.wavelength, nodes[0], nodes[-1]), 0, DEGREE)


def _over_field(found: PsfFile, angles: Floats, odd: bool = False) -> Floats:
    """Weights (a, f) of the values at field angles, which are odd or even in the angle."""
    nodes = found.angle
    if len(nodes) == 1:
        return np.ones((len(angles), 1))
    unit = np.eye(len(nodes))
    mirrored = np.concatenate([(-unit if odd else unit)[:0:-1], unit])
    both = np.concatenate([-nodes[:0:-1], nodes])
    return spline(both, mirrored, angles, 0, DEGREE)


class _Plan:
    """What the images of all places share."""

    def __init__(
        self, optics: Optics, found: PsfFile, camera: Camera, pitch: float, band: Band,
        fill_factor: float, diffusion: float,
    ) -> None:  # fmt: skip
        self.found, self.camera, self.pitch, self.band = found, camera, pitch, band
        corner = camera.half_diagonal
        last = float(found.angle[-1])
        if len(found.angle) > 1 and corner > last * (1 + 1e-6) + 1e-9:
            raise Refused(
                f"psf_file must hold the field to the corner of the detector, "
                f"{math.degrees(corner):.4g} deg, but ends at {math.degrees(last):.4g} deg"
            )
        self.blur = math.hypot(optics.total_blur, diffusion) / pitch
        self.pixel = math.sqrt(fill_factor)
        light = found.image / found.image.sum(axis=(2, 3), keepdims=True)
        # At negative angles an image is turned by half a turn: its even and odd parts.
        self.even = (light + light[..., ::-1, ::-1]) / 2
        self.odd = (light - light[..., ::-1, ::-1]) / 2
        if light.shape[-1] % 2 == 0:  # the middle sample is that of n // 2
            light = light[..., 1:, 1:]
            self.even = (light + light[..., ::-1, ::-1]) / 2
            self.odd = (light - light[..., ::-1, ::-1]) / 2
        self.over_colour = _over_colour(found, band)
        half = light.shape[-1] // 2 * found.spacing / pitch
        self.oversampling = FINE
        lateral = 0.0 if found.place is None else float(np.ptp(found.place, axis=0).max()) / pitch
        self.half = math.ceil((math.ceil(half + lateral) + 0.5) * FINE)
        more = math.ceil((self.pixel / 2 + 5 * self.blur) * FINE)
        self.room = math.ceil((self.half + more) / FINE + 0.5) * FINE + FINE // 2 + 3
        self.side = 2 * self.room + 1

    @property
    def symmetric(self) -> bool:
        """Whether the images of a frame repeat eight times, by mirrors and a turn."""
        centred = self.camera.principal_x == self.camera.principal_y == 0
        return centred and self.found.even and not self.camera.p1 and not self.camera.p2

    def image(self, away_x: float, away_y: float) -> tuple[Floats, Floats]:
        """Table (c, m, m) of each spectrum; its shift (pixel) and relative flux, (c, 3)."""
        found, band = self.found, self.band
        place = np.array([[away_x, away_y]]) + self.camera.centre
        direction = self.camera.unproject(place)[0]
        angle = math.atan2(math.hypot(direction[0], direction[1]), direction[2])
        angle = min(angle, float(found.angle[-1])) if len(found.angle) > 1 else angle
        azimuth = math.atan2(direction[1], direction[0])
        at = np.array([angle])
        even, odd = _over_field(found, at)[0], _over_field(found, at, odd=True)[0]
        light = np.tensordot(even, self.even, (0, 1))
        light += np.tensordot(odd, self.odd, (0, 1)) if len(found.angle) > 1 else self.odd[:, 0]
        spectra = band.weight
        shift = np.zeros((len(spectra), 2))
        turn = np.array([math.cos(azimuth), math.sin(azimuth)])
        if found.place is None:
            mixed = np.tensordot(spectra @ self.over_colour, light, 1)
            tables = [self._table(one, 0.0, azimuth) for one in mixed]
        else:
            radial = self.over_colour @ (found.place @ odd)  # metre, at each wavelength
            centre = spectra @ radial
            coloured = np.tensordot(self.over_colour, light, 1)
            tables = []
            for weight, middle in zip(spectra, centre, strict=True):
                parts = [
                    w * self._turned(one, (here - middle) / self.pitch, azimuth)
                    for w, one, here in zip(weight, coloured, radial, strict=True)
                ]
                tables.append(self._averaged(np.sum(parts, axis=0)))
            shift = np.outer(centre / self.pitch, turn) - [away_x, away_y]
        return np.array(tables), np.column_stack([shift, np.ones(len(spectra))])

    def _table(self, image: Floats, along: float, azimuth: float) -> Floats:
        return self._averaged(self._turned(image, along, azimuth))

    def _turned(self, image: Floats, along: float, azimuth: float) -> Floats:
        """An image on the grid of the table, moved along its x axis (pixel), then turned."""
        axis = np.arange(-self.half, self.half + 1) / self.oversampling
        x, y = axis[None], axis[:, None]
        size = self.pitch / self.found.spacing
        middle = len(image) // 2
        u = (x * math.cos(azimuth) + y * math.sin(azimuth) - along) * size + middle
        v = (y * math.cos(azimuth) - x * math.sin(azimuth)) * size + middle
        return np.asarray(ndimage.map_coordinates(image, [v, u], order=3, mode="constant"))

    def _averaged(self, image: Floats) -> Floats:
        table = averaged(image, self.oversampling, self.pixel, self.blur)
        table = np.pad(table, self.room - len(table) // 2)
        return np.asarray(table * (self.found.energy * self.oversampling**2 / table.sum()))
