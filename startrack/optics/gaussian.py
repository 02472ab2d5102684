"""The Gaussian PSF of an object point at a distance that may change with time."""

from __future__ import annotations

import numpy as np

from startrack.core import Floats, positive


def gaussian(
    x_image: Floats,
    y_image: Floats,
    x_object: float,
    y_object: float,
    focal_length: float,
    distance: float | Floats,
    sigma: float,
) -> Floats:
    """Irradiance in the image of an object point, per unit area of object.

        H = (f/g)^2 / (2 pi sigma^2) exp(-((f x'/g + x'')^2 + (f y'/g + y'')^2) / (2 sigma^2))

    Source: Krutz et al. (2011), eq. (12), with the exponent's sign and its y' mended; eq. (13) is
    the same with g(t), an array of distances.

    x_image, y_image    (...) metre, x'', y''
    x_object, y_object  metre, x', y'; the image is inverted
    distance            metre, g or g(t), broadcast against the image points
    sigma               metre, in the image
    Returns             (...) 1 / metre^2; over the image its integral is (f/g)^2
    Accuracy            model: no rings, and the far wings are missing.
    """
    positive(focal_length=focal_length, sigma=sigma, distance=float(np.min(distance)))
    scale = focal_length / np.asarray(distance, float)
    square = (scale * x_object + x_image) ** 2 + (scale * y_object + y_image) ** 2
    return scale**2 / (2 * np.pi * sigma**2) * np.exp(-square / (2 * sigma**2))
