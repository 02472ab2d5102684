"""PsfFile: images of a point, measured or exported, over field and wavelength; their file."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
import scipy

from startrack.core import Floats, Psf, Refused, Unit, non_negative, positive, printed, within
from startrack.io import open_checked, whole
from startrack.optics.diffraction import pixel_average
from startrack.optics.lens_table import WIDEST, catalogued, kept_files

FORMAT = 1
SMALLEST, LARGEST = 5, 2048  # samples along a side of an image
MOST_NUMBERS = 20_000_000  # most numbers in all images together
FINE = 12  # samples per pixel at least: six-point interpolation errs by less than a cubic spline
PARTS = {"wavelength": "WAVELENGTH", "angle": "FIELD", "place": "PLACE"}
EVEN = 1e-3  # allowed difference of an image from its mirror image, over the peak
SAME = 1e-3  # allowed relative difference of the pixel sides of a file and a design


@printed
@dataclass(frozen=True, eq=False)
class PsfFile:
    """Images of a point at nodes of wavelength and field angle, and the meaning of a sample.

    For an image off the optical axis, its x axis runs along the field: the image of a star is
    rotated to the star's azimuth. The middle sample, number n // 2, is at `place`.

    source      source of the images
    image       (w, f, n, n) on any scale
    spacing     metre between two samples; pixel where `pitch` is unknown
    pixel       whether a sample is the light in a pixel around it, or the irradiance at its place
    pitch       metre, side of this pixel; None: a pixel of any size
    energy      1, fraction of the light within an image
    wavelength  (w,) metre, rising; a single one represents all
    angle       (f,) radian from the axis, rising from zero; a single one represents all
    place       (w, f) metre from the axis, of the middle samples; None: the projection by the
                design's own camera
    Raises      ValueError with the name, the rule and the value.
    """

    source: str
    image: Floats
    spacing: float
    pixel: bool
    pitch: Annotated[float | None, Unit("m", "um")] = None
    energy: float = 1.0
    wavelength: Annotated[Floats, Unit("m", "nm")] = field(
        default_factory=lambda: np.array([600e-9])
    )
    angle: Annotated[Floats, Unit("rad", "deg")] = field(default_factory=lambda: np.zeros(1))
    place: Annotated[Floats | None, Unit("m", "mm")] = None

    def __post_init__(self) -> None:
        positive(spacing=self.spacing)
        within(1e-3, 1, energy=self.energy)
        if self.pitch is not None:
            positive(pitch=self.pitch)
        if self.pixel and self.pitch is None and not self.spacing <= 1:
            raise Refused(f"spacing must be at most a pixel, got {self.spacing:g}")
        if self.pixel and self.pitch is not None and not self.spacing <= self.pitch * (1 + SAME):
            raise Refused(f"spacing must be at most a pixel, got {self.spacing:g} m")
        _check_nodes("wavelength", self.wavelength, 1e-8, 1e-4)
        _check_nodes("angle", self.angle, 0, WIDEST)
        if self.angle[0] != 0:
            raise Refused(f"angle must begin with zero, got {self.angle[0]:g} radian")
        if self.pixel and self.varies:
            raise Refused("images over field or wavelength must be irradiances, without pixels")
        shape, size = np.shape(self.image), len(self.image[0, 0]) if self.image.ndim == 4 else 0
        if shape != (len(self.wavelength), len(self.angle), size, size):
            raise Refused(
                f"image must hold {len(self.wavelength)} x {len(self.angle)} square images, got "
                f"the shape {shape}"
            )
        if not SMALLEST <= size <= LARGEST or self.image.size > MOST_NUMBERS:
            raise Refused(
                f"image must have {SMALLEST} to {LARGEST} samples a side and {MOST_NUMBERS:g} in "
                f"all, got {size} and {self.image.size}"
            )
        if not np.isfinite(self.image).all() or not (self.image.sum(axis=(2, 3)) > 0).all():
            raise Refused("image must hold finite numbers, and light in each image")
        if self.place is not None and (
            np.shape(self.place) != shape[:2] or not np.isfinite(self.place).all()
        ):
            raise Refused(f"place must hold {shape[:2]} finite numbers")

    @property
    def varies(self) -> bool:
        """Whether there is more than one image."""
        return len(self.wavelength) > 1 or len(self.angle) > 1

    @cached_property
    def even(self) -> bool:
        """Whether all images are their own mirror images across the x axis."""
        image = self.image[..., len(self.image[0, 0]) % 2 == 0 :, :]
        return bool(np.abs(image - image[..., ::-1, :]).max() <= EVEN * self.image.max())


def _check_nodes(name: str, nodes: Floats, low: float, high: float) -> None:
    if np.ndim(nodes) != 1 or not 1 <= len(nodes) <= 1000 or not np.isfinite(nodes).all():
        raise Refused(f"{name} must be a list of 1 to 1000 finite numbers")
    if not (np.diff(nodes) > 0).all() or nodes[0] < low or nodes[-1] > high:
        raise Refused(
            f"{name} must rise within [{low:g}, {high:g}], got {nodes[0]:g} to {nodes[-1]:g}"
        )


def psf_of_file(
    file: PsfFile, pitch: float, blur: float, fill_factor: float, diffusion: float
) -> Psf:
    """The Psf of the one image of a file.

    An image that contains the pixel is refined by a cubic spline through its samples, to at least
    twelve per pixel. An irradiance is also averaged over the active square of a pixel.

    pitch        metre, of the design
    blur         metre, sigma of a Gaussian that is added
    fill_factor, diffusion  as in `pixel_psf`; an image that contains the pixel already has them
    Raises       ValueError if the pixels of the design and of the image differ.
    Accuracy     numerical: a cubic spline through the samples; light beyond the image is left out.
    """
    non_negative(blur=blur)
    image = file.image[0, 0]
    if file.pixel:
        if file.pitch is not None and abs(pitch / file.pitch - 1) > SAME:
            raise Refused(
                f"pixel_pitch times binning must be {file.pitch * 1e6:.4g} um, that of the pixels "
                f"in psf_file, got {pitch * 1e6:.4g} um"
            )
        spacing = file.spacing if file.pitch is None else file.spacing / file.pitch
        kernel = blur / pitch
    else:
        spacing, kernel = file.spacing / pitch, math.hypot(blur, diffusion) / pitch
    step = max(FINE, math.ceil(1 / spacing - SAME))
    table = _resampled(image, spacing * step)
    if file.pixel:
        table = (
            scipy.ndimage.gaussian_filter(table, kernel * step, mode="constant")
            if kernel
            else table
        )
    else:
        table = averaged(table, step, math.sqrt(fill_factor), kernel)
    table = table * (file.energy * step**2 / table.sum())
    return Psf(_padded(table, step), step, file.energy)


def _resampled(image: Floats, size: float) -> Floats:
    """An image on another grid, with an odd number of samples, 1 / `size` of the old spacing
    apart."""
    middle = len(image) // 2
    if size == 1 and len(image) % 2:
        return image
    half = math.floor(min(middle, len(image) - 1 - middle) * size + 1e-9)
    at = np.arange(-half, half + 1) / size + middle
    return np.asarray(
        scipy.ndimage.map_coordinates(
            image, np.meshgrid(at, at, indexing="ij"), order=3, mode="nearest"
        )
    )


def averaged(image: Floats, step: int, side: float, blur: float) -> Floats:
    """The mean over squares of `side` pixel, after a Gaussian blur, with room for both."""
    more = math.ceil((side / 2 + 5 * blur) * step)
    return pixel_average(np.pad(image, more), 1 / step, side, blur, 2 * more)


def _padded(table: Floats, step: int) -> Floats:
    """A table with room for whole pixels on both sides and for its interpolation."""
    half = len(table) // 2
    wanted = math.ceil((math.ceil(half / step) + 0.5) * step) + 3
    return np.ascontiguousarray(np.pad(table, wanted - half))


def save_psf_file(path: Path, psf: PsfFile) -> None:
    """Write a file of images as FITS with checksums.

    The first FITS image is (n, n) for one PSF, and (w, f, n, n) for several. Its header has PSF
    (the format), SOURCE, PIXEL (T or F) and ENERGY. It has OVERSAMP (samples per pixel) if PIXEL is
    T, otherwise SPACING (metre), and PITCH (metre) if it is known. If there are several PSFs,
    further images are WAVELENGTH (metre), FIELD (radian) and PLACE (metre).
    """
    from astropy.io import fits

    first = fits.PrimaryHDU(psf.image if psf.varies else psf.image[0, 0])
    head = first.header
    head["PSF"] = (FORMAT, "format of these images of a point")
    head["SOURCE"] = psf.source[:60]
    head["PIXEL"] = (psf.pixel, "whether a sample is the light in a pixel")
    head["ENERGY"] = (psf.energy, "fraction of the light within the image")
    if psf.pixel:
        size = psf.spacing if psf.pitch is None else psf.spacing / psf.pitch
        head["OVERSAMP"] = (1 / size, "samples per pixel")
    else:
        head["SPACING"] = (psf.spacing, "[m] between samples")
    if psf.pitch is not None:
        head["PITCH"] = (psf.pitch, "[m] side of a pixel")
    parts = [first]
    if psf.varies:
        parts.append(fits.ImageHDU(psf.wavelength, name="WAVELENGTH"))
        parts.append(fits.ImageHDU(psf.angle, name="FIELD"))
    if psf.place is not None:
        parts.append(fits.ImageHDU(psf.place, name="PLACE"))
    with whole(Path(path)) as draft:
        fits.HDUList(parts).writeto(draft, checksum=True)


def load_psf_file(path: Path) -> PsfFile:
    """Read a file that `save_psf_file`, or another program, wrote.

    Raises  FileNotFoundError; ValueError if the file is another kind, is damaged, or has values
            that a PsfFile refuses.
    """
    with open_checked(path, "PSF", FORMAT, "a file of PSFs") as parts:
        head = parts[0].header
        image = np.array(parts[0].data, float)
        names = [part.name for part in parts]
        arrays = {
            key: np.array(parts[name].data, float) for key, name in PARTS.items() if name in names
        }
        pixel = head["PIXEL"]
        size = head["OVERSAMP" if pixel else "SPACING"]
        numbers = {"spacing": size, "energy": head.get("ENERGY", 1.0), "pitch": head.get("PITCH")}
        source = str(head.get("SOURCE", ""))
    for key, value in numbers.items():
        bad = isinstance(value, bool) or not isinstance(value, int | float) or not value > 0
        if bad and not (key == "pitch" and value is None):
            raise Refused(f"{path}: {key} must be a number above zero, got {value!r}")
    if not isinstance(pixel, bool):
        raise Refused(f"{path}: PIXEL must be T or F, got {pixel!r}")
    pitch = None if numbers["pitch"] is None else float(numbers["pitch"])
    spacing = float(size)
    if pixel:
        spacing = (pitch or 1.0) / spacing
    if image.ndim < 2:
        raise Refused(f"{path} must hold images, got {image.ndim} axes")
    while image.ndim < 4:
        image = image[None]
    try:
        return PsfFile(source, image, spacing, pixel, pitch, float(numbers["energy"]), **arrays)
    except (ValueError, TypeError) as error:
        raise Refused(f"{path}: {error}") from None


_open = kept_files(load_psf_file)


def open_psf_file(name: str) -> PsfFile:
    """The images of a `psf_file`; cached for the last 8 files with their times."""
    return _open(catalogued(name, "psf_file", "psfs", "a file of PSFs"))
