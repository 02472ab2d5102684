"""Real images: identification when little but the field of view is known.

The attitudes come from solvers that are not startrack (truth.json beside the images). They are for
catalogue positions; the Earth's velocity displaces all stars of an image by up to 21 arcsec.
"""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, open_sky
from startrack.core.camera import Camera
from startrack.core.units import arcsec, deg
from startrack.detection import Detection, detect, subtract_dark
from startrack.identification import Identification, PatternIndexes, identify
from startrack.io.images import read_image

NAMES = (
    *(f"esa_Alt40_Azi{azimuth}.tiff" for azimuth in (-135, -45, 45, 135)),
    *("cedar_crappy.jpg", "cedar_hale_bopp.jpg", "cedar_jan1_g90_e100ms.jpg"),
    *("cedar_orion_belt.jpg", "cedar_orion_trees.jpg", "cedar_virgo.jpg"),
    *(f"ost_img{number}.png" for number in (2, 3, 5, 9)),
)
# Of each kind; tests/test_real_images.py solves the others by the command.
USUAL = ("Azi45", "virgo", "img2")
EACH = [
    pytest.param(name, marks=() if any(one in name for one in USUAL) else pytest.mark.slow)
    for name in NAMES
]


@pytest.fixture(scope="module")
def indexes(tmp_path_factory):
    return PatternIndexes(open_sky(Selection()).stars, tmp_path_factory.mktemp("indexes"))


@pytest.mark.parametrize("name", EACH)
def test_solved_as_others_solve_it(outside, indexes, name):
    folder = outside / "images"
    truth = json.loads((folder / "truth.json").read_text())["images"][name]
    frame = read_image(folder / name)
    if name.startswith("ost"):
        frame = subtract_dark(frame, read_image(folder / "ost_dark.png"))
    true = Rotation.from_matrix(np.array(truth["R_icrs_to_cam"]))
    columns, rows = truth["width"], truth["height"]
    settings = Identification(focal_tolerance=0.1)
    for factor in (0.93, 1.07):
        camera = Camera.from_field_of_view(columns, rows, truth["fov_x_deg"] * factor * deg)
        index = indexes(camera)
        for threshold in (5.0, 4.0):  # a second look, as the command takes
            spots = detect(frame, Detection(threshold=threshold))
            matches = identify(spots, camera, indexes.stars, index, settings)
            if matches.icrs_to_camera is not None:
                break
        assert matches.icrs_to_camera is not None, matches.reason
        x, y, z = matches.icrs_to_camera.apply(true.inv().apply([0.0, 0.0, 1.0]))
        assert np.arctan2(np.hypot(x, y), z) < 30 * arcsec
        # The others fit a radial distortion, which takes up some of the focal length.
        assert matches.camera.fov_x / deg == pytest.approx(truth["fov_x_deg"], rel=0.006)
