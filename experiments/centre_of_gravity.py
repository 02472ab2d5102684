"""The error of the centre of gravity of a star in a window, in closed form."""

import math

import numpy as np
from scipy.special import ndtr

from startrack import Refused
from startrack.metrics import Star

PHASES = 8  # sub-pixel positions per axis, for the mean of the noise


def centre_of_gravity_error(star: Star, window: int) -> tuple[float, float]:
    """Noise and S-curve error of the centre of gravity in a window, with a known background.

        x = sum k s_k / sum s_k,   var x = sum (k - x)^2 var s_k / (sum s_k)^2

    window    pixel, odd width of the square window, which is centred on the star's pixel
    Returns   pixel, along x, root mean square over sub-pixel positions: of noise, of bias
    Raises    ValueError where the window is not odd and positive.
    Accuracy  model: noise to first order; more than 5 % low where sum s_k is under 5 times its
              noise. Smear is ignored.
    """
    if window < 1 or window % 2 == 0:
        raise Refused(f"window must be odd and positive, got {window}")
    pixel = np.arange(window) - window // 2
    edge = np.arange(window + 1) - window // 2 - 0.5
    phases = (np.arange(4 * PHASES) + 0.5) / (4 * PHASES) - 0.5
    noise = bias = 0.0
    for x in phases:
        fraction_x = np.diff(ndtr((edge - x) / star.sigma))
        measured = float((pixel * fraction_x).sum() / fraction_x.sum())
        bias += (measured - x) ** 2
        for y in phases[::4]:
            fraction = np.outer(np.diff(ndtr((edge - y) / star.sigma)), fraction_x)
            variance = star.flux * fraction + star.background + star.read_noise**2
            moments = (pixel - measured) ** 2 * variance
            noise += float(moments.sum()) / float(star.flux * fraction.sum()) ** 2
    return math.sqrt(noise / len(phases) / len(phases[::4])), math.sqrt(bias / len(phases))
