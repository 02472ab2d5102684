"""Fits of stars: how often their images are computed."""

import numpy as np

from startrack.detection import fit, gaussian_psf
from startrack.detection.gravity import FLUX, Sample, X, Y

SIGMA, FAR = 1.5, 31  # pixel; distance of two stars


def test_stars_share_their_first_guess(monkeypatch, sky):
    """Stars with whole windows share one image at the middle of a pixel; others have their own."""
    x, y = np.array([20, 20 + FAR, 20 + 2 * FAR]), np.full(3, 20)
    light = sky((41, 41 + 2 * FAR), x + 0.3, y - 0.2, np.full(3, 5e3), SIGMA)
    image = (light + 10).astype(np.float32)
    empty = np.zeros((0, 0), np.uint8)
    alone = Sample(image, empty, x, y, 6, 1.0, 1.0, 0.0, 3.0, np.inf)
    model = fit.Model(gaussian_psf(SIGMA).arranged, 6, 6, 6, 0.0)
    drawn = []

    def render(*given):
        drawn.append(given[1][:2].copy())
        fit_render(*given)

    fit_render = fit._render_model
    for name in ("fitted", "_first_guess", "_fit"):
        monkeypatch.setattr(fit, name, getattr(fit, name).py_func)
    monkeypatch.setattr(fit, "_render_model", render)
    seen = fit.fitted(alone, model)
    np.testing.assert_allclose(seen[:, [X, Y]], np.stack([x + 0.3, y - 0.2], 1), atol=1e-4)
    np.testing.assert_allclose(seen[:, FLUX], 5e3, rtol=1e-4)
    at_the_middle = [place for place in drawn if (place == np.rint(place)).all()]
    assert len(at_the_middle) == 1
    drawn.clear()
    fit.fitted(alone._replace(image=image[15:].copy(), y=y - 15), model)
    assert len([place for place in drawn if (place == np.rint(place)).all()]) == 1 + 3
