"""Restoration of a channel's image: what lens, pixel and smear blurred, by a filter of Wiener."""

import numpy as np
from scipy import fft

from startrack.core import Floats, Psf, Refused, positive
from startrack.earth.imager import Channel, Setting, lines_apart, point_images, smeared

EDGE = 2  # widths of a point's image, by which an image is continued beyond its edges


def restored(
    radiance: Floats, channel: Channel, setting: Setting, signal_to_noise: float
) -> Floats:
    """An image whose modulation is raised where noise allows it.

        W = (1 + 1 / SNR^2) H* / (|H|^2 + 1 / SNR^2)

    with the transform H of the image of a point in the middle of a pixel; even ground keeps its
    radiance. Beyond its edges the image is mirrored.

    Source: Goodman, Introduction to Fourier Optics, 3rd ed., eq. (8-42).

    radiance         (lines, columns)
    signal_to_noise  1, rms of the signal over that of the noise, at each frequency
    Raises           Refused with a lens whose images differ over the field.
    Accuracy         model: of dark gaps and saturated pixels, rings remain around them.
    """
    positive(signal_to_noise=signal_to_noise)
    if not isinstance(setting.psf, Psf):
        raise Refused(
            f"channel {channel.name}: lens_file, lens_family and psf_file must be left out where "
            "an image is restored"
        )
    across = channel.detector.columns / channel.columns
    psf = smeared(setting.psf, setting.smear)
    image = point_images(psf, np.zeros((1, 2)), across, lines_apart(channel, setting))[0]
    image = image / image.sum()
    half = len(image) // 2
    room = [min(EDGE * len(image), size - 1) for size in radiance.shape]
    padded = np.pad(radiance, [(part, part) for part in room], "reflect")
    shape = padded.shape
    centred = np.zeros(shape)
    centred[: len(image), : len(image)] = image
    transfer = fft.rfft2(np.roll(centred, (-half, -half), (0, 1)))
    noise = signal_to_noise**-2
    filtered = np.conj(transfer) * (1 + noise) / (np.abs(transfer) ** 2 + noise)
    found = fft.irfft2(fft.rfft2(padded) * filtered, shape)
    down, right = room
    return np.asarray(found[down : shape[0] - down, right : shape[1] - right], np.float64)
