"""Restoration of a channel's image, blurred by lens, pixel and smear, by a Wiener filter."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from startrack.core import Floats, Psf, Refused
from startrack.earth.imager.lens import smeared
from startrack.earth.imager.parameters import Channel
from startrack.optics import wiener_filter

EDGE = 2  # widths of a point's image; an image is continued this far beyond its edges
FREQUENCIES = 64  # frequencies along each axis for the average of noise


class Restoration(NamedTuple):
    """A Wiener filter for the images of a channel.

    psf              PSF of the pixels, the pixel's square and the smear included
    across, along    pixel between columns and between lines of the image
    signal_to_noise  1, rms of the signal over rms of the noise, at each frequency
    """

    psf: Psf
    across: float
    along: float
    signal_to_noise: float

    def filter(self, across: Floats, along: Floats) -> NDArray[np.complexfloating]:
        """The filter at frequencies of waves along columns and lines.

            H(u, v) = Int Int psf(x, y) exp(-2 pi i (u x + v y)) dx dy / Int Int psf dx dy

        across, along  (n,), (m,) cycle / pixel of the detector
        Returns        (m, n)
        Accuracy       model: frequencies above the Nyquist frequency of the image, which alias to
                       lower ones, are not corrected.
        """
        table = self.psf.table
        at = (np.arange(len(table)) - len(table) // 2) / self.psf.oversampling
        right = np.exp(-2j * np.pi * np.outer(at, across))
        down = np.exp(-2j * np.pi * np.outer(along, at))
        return wiener_filter(down @ table @ right / table.sum(), self.signal_to_noise)

    def gain(self, across: float, along: float) -> float:
        """Gain of the filter for the modulation of a wave, with frequencies in cycle / pixel."""
        step = self.across, self.along
        # The filter repeats above the Nyquist frequency of the image.
        here = [f - round(f * size) / size for f, size in zip((across, along), step, strict=True)]
        return float(abs(self.filter(*np.array(here)[:, None])[0, 0]))

    @property
    def noise(self) -> float:
        """Rms of white noise after the filter over its rms before the filter."""
        frequency = fft.fftfreq(FREQUENCIES)
        gains = self.filter(frequency / self.across, frequency / self.along)
        return float(np.sqrt(np.mean(np.abs(gains) ** 2)))

    def applied(self, image: Floats) -> Floats:
        """The filtered image: modulation is raised where noise allows it.

        Uniform ground keeps its radiance. The image is mirrored beyond its edges.

        image     (lines, columns)
        Accuracy  model: rings remain around dark gaps and saturated pixels.
        """
        width = len(self.psf.table) / self.psf.oversampling
        room = [
            min(int(EDGE * width / step) + 1, size - 1)
            for size, step in zip(image.shape, (self.along, self.across), strict=True)
        ]
        padded = np.pad(image, [(part, part) for part in room], "reflect")
        lines, columns = padded.shape
        gains = self.filter(fft.rfftfreq(columns) / self.across, fft.fftfreq(lines) / self.along)
        found = fft.irfft2(fft.rfft2(padded) * gains, padded.shape)
        down, right = room
        return np.asarray(found[down : lines - down, right : columns - right], np.float64)


def restoration_of(
    channel: Channel, images: object, smear: float, along: float, signal_to_noise: float
) -> Restoration:
    """The filter of a channel's images.

    images  Psf of the pixels without the smear
    smear   pixel, motion along the lines in an exposure
    along   pixel of the detector between lines of the image
    Raises  Refused for a lens whose images vary over the field.
    """
    if not isinstance(images, Psf):
        raise Refused(
            f"channel {channel.name}: lens_file, lens_family and psf_file must be left out where "
            "an image is restored"
        )
    across = channel.detector.columns / channel.columns
    return Restoration(smeared(images, smear), across, along, signal_to_noise)
