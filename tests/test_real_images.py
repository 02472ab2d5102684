"""Real night skies: attitudes on which independent solvers agree, from images and a rough field."""

import contextlib
import io
import json

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table
from astropy.wcs import WCS
from scipy.spatial.transform import Rotation

from startrack.cli.main import main

ESA = [f"esa_Alt40_Azi{azimuth}.tiff" for azimuth in (-135, -45, 135, 45)]
CEDAR = [
    f"cedar_{name}.jpg"
    for name in ("crappy", "hale_bopp", "jan1_g90_e100ms", "orion_belt", "orion_trees", "virgo")
]


@pytest.fixture
def solve(outside, capsys):
    truth = json.loads((outside / "images" / "truth.json").read_text())["images"]

    def run(name, factor=1.0, *more):
        field = truth[name]["fov_x_deg"] * factor
        path = outside / "images" / name
        status = main(["solve", str(path), "--fov", str(field), "--epoch", "2016", "--json", *more])
        found = json.loads(capsys.readouterr().out)
        if found["icrs_to_camera_xyzw"] is None:
            return status, found, None
        true = Rotation.from_matrix(truth[name]["R_icrs_to_cam"])
        error = (Rotation.from_quat(found["icrs_to_camera_xyzw"]) * true.inv()).as_rotvec()
        return status, found, np.degrees(error) * 3600

    return run


FACTORS = (0.91, 1.0, 1.09)  # of the true field
# Each image with one of them; with the others it is a slow test.
ROUGH = [
    pytest.param(name, factor, marks=() if n % len(FACTORS) == k else pytest.mark.slow)
    for k, factor in enumerate(FACTORS)
    for n, name in enumerate(ESA + CEDAR)
]


@pytest.mark.parametrize(("name", "factor"), ROUGH)
def test_attitude_with_a_rough_field_of_view(solve, name, factor):
    """Within 60 arcsec across the boresight, including the aberration of the images."""
    status, found, error = solve(name, factor)
    assert (status, found["status"]) == (0, "solved")
    assert np.hypot(*error[:2]) < 60
    assert abs(error[2]) < 300
    assert found["residual_rms_px"] < 1


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(f"ost_img{n}.png", marks=pytest.mark.slow if n in (3, 5) else ())
        for n in (2, 3, 5, 9)
    ],
)
def test_hot_pixels_with_a_dark_frame(solve, outside, name):
    """Six to fifteen faint stars among hot pixels; some need a second search."""
    dark = str(outside / "images" / "ost_dark.png")
    status, _, error = solve(name, 1.0, "--dark", dark)
    assert status == 0
    assert np.hypot(*error[:2]) < 60


@pytest.mark.parametrize("colour", ["superpixel", "green"])
def test_a_mosaic_of_colours(solve, colour):
    """Raw pixels of a colour camera: those of the two greens are 1.3 % brighter than the others."""
    status, found, error = solve(CEDAR[2], 1.0, "--bayer", "RGGB", "--colour", colour)
    assert status == 0
    assert found["matches"] >= 30
    assert np.hypot(*error[:2]) < 60


@pytest.mark.slow
def test_the_posterior_of_a_camera_is_near_an_independent_fit(outside, tmp_path, capsys):
    """Within a part in 2000 of a fit of the same image, which uses another law of distortion."""
    truth = json.loads((outside / "images" / "truth.json").read_text())["images"][ESA[0]]
    path = str(outside / "images" / ESA[0])
    options = ("--fov", "11.4", "--epoch", "2016", "--posterior", str(tmp_path), "--json")
    assert main(["calibrate", path, *options]) == 0
    found = json.loads(capsys.readouterr().out)["posterior"]
    assert found["converged"]
    _, low, high = found["median_and_95"]["focal_length_px"]
    focal_length = truth["width"] / 2 / np.tan(np.radians(truth["fit"]["fov"]) / 2)
    assert focal_length == pytest.approx((low + high) / 2, rel=5e-4)
    assert (high - low) / focal_length < 1e-3
    assert (tmp_path / "corner.png").stat().st_size > 10_000


WIDE = [f"img_{number}.jpg" for number in range(1, 50, 2)]
FEW = [pytest.param(WIDE[::24], id="few"), pytest.param(WIDE, id="all", marks=pytest.mark.slow)]


@pytest.fixture(scope="module", params=FEW)
def blind_wide(request, outside):
    """Wide images, solved without a field of view, in one run."""
    names = request.param
    with contextlib.redirect_stdout(io.StringIO()) as out:
        paths = [str(outside / "images-wide" / name) for name in names]
        status = main(["solve", *paths, "--json"])
    found = [json.loads(line) for line in out.getvalue().splitlines()]
    truth = json.loads((outside / "images-wide" / "truth.json").read_text())["images"]
    return status, found, [truth[name] for name in names]


@pytest.mark.slow
def test_wide_images_of_a_distorted_lens_are_solved_without_a_field(blind_wide):
    """The reference states an error of about 5 arcmin; our results agree much better with each
    other."""
    status, found, truth = blind_wide
    assert status == 0
    apart = []
    for one, true in zip(found, truth, strict=True):
        across = (one["ra_deg"] - true["ra_deg"]) * np.cos(np.radians(true["dec_deg"]))
        apart.append(60 * np.hypot(across, one["dec_deg"] - true["dec_deg"]))
        assert apart[-1] < 5 * np.hypot(5, one["sigma_arcsec"][0] / 60)
    assert max(apart) < 8
    assert np.median(apart) < 3
    ours, theirs = (np.mean([one["matches"] for one in of]) for of in (found, truth))
    assert ours > 0.95 * theirs  # of another catalogue, within another distance


@pytest.mark.slow
def test_each_wide_image_shows_the_same_lens(blind_wide):
    """With one camera, focal length, axis and distortion agree from image to image."""
    cameras = [one["lens"]["camera"] for one in blind_wide[1]]
    focal, x, y, k1 = (
        np.array([camera[name] for camera in cameras])
        for name in ("focal_length_px", "principal_x", "principal_y", "k1")
    )
    assert np.std(focal) / np.mean(focal) < 1e-3
    assert np.std(x) < 1.5
    assert np.std(y) < 1.5
    assert np.mean(y) < -20
    assert np.std(k1) < 0.02


@pytest.mark.slow  # tests/photograph/test_solve.py has drawn ones
@pytest.mark.parametrize("change", ["mirrored", "large"])
def test_a_changed_image_is_solved_to_the_same_place(outside, tmp_path, capsys, change):
    """Mirrored, or with stars five times as wide."""
    import cv2

    image = cv2.imread(str(outside / "images" / ESA[0]), cv2.IMREAD_UNCHANGED)
    path = tmp_path / "changed.tiff"
    changed = image[:, ::-1].copy() if change == "mirrored" else cv2.resize(image, None, None, 5, 5)
    cv2.imwrite(str(path), changed)
    assert main(["solve", str(path), "--fov", "11.4", "--epoch", "2016", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["mirrored"] == (change == "mirrored")
    assert found["as_hinted"]
    truth = json.loads((outside / "images" / "truth.json").read_text())["images"][ESA[0]]
    assert found["ra_deg"] == pytest.approx(truth["ra_deg"], abs=30 / 3600)
    assert found["dec_deg"] == pytest.approx(truth["dec_deg"], abs=30 / 3600)


HARD = {
    "unh_0045.jpg": {},
    "ar_IMG_3053.jpg": {},
    "us_23.png": {},
    "lm_acc.png": {"mirrored": True},
    "sams_1.png": {"aspect": 0.4219},
    "sams_17.png": {"aspect": 0.4219},
    "picam_1.png": {},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HARD)
def test_hard_photographs_with_a_field_and_without(outside, capsys, name):
    """Saturated and large stars, a mirrored and a squeezed image, a strongly distorting lens.

    A person would solve them. The references have errors of a few arcmin.
    """
    truth = json.loads((outside / "images-hard" / "truth.json").read_text())["images"][name]
    for more in ((), ("--fov", str(truth["fov_x_deg"]))):
        assert main(["solve", str(outside / "images-hard" / name), "--json", *more]) == 0
        found = json.loads(capsys.readouterr().out)
        across = (found["ra_deg"] - truth["ra_deg"]) * np.cos(np.radians(truth["dec_deg"]))
        assert np.hypot(across, found["dec_deg"] - truth["dec_deg"]) < 0.05
        assert found["mirrored"] == HARD[name].get("mirrored", False)
        assert found["aspect"] == pytest.approx(HARD[name].get("aspect", 1.0), rel=0.02)
        assert found["reason"].startswith(f"{found['matches']} of {found['spots']} ")


@pytest.mark.slow
def test_a_camera_of_the_same_series_states_its_error(outside, capsys, tmp_path):
    """Calibrated on four images; of the two others one is 20 degrees above the horizon.

    The reference is the direction of the middle by an independent fit, with errors of 8 and 12
    arcsec.
    """
    folder, camera = outside / "images-more", tmp_path / "camera.toml"
    truth = json.loads((folder / "truth.json").read_text())["images"]
    names = [f"gr_{name}.jpg" for name in ("andromeda", "casiopea", "cisne", "sagitario")]
    paths = [str(folder / name) for name in names]
    assert main(["calibrate", *paths, "--epoch", "2016", "--camera", str(camera)]) == 0
    capsys.readouterr()
    for name in ("gr_vega_05sec.jpg", "gr_pleyades_05sec.jpg"):
        options = ["--camera", str(camera), "--epoch", "2016", "--json"]
        assert main(["solve", str(folder / name), *options]) == 0
        found, known = json.loads(capsys.readouterr().out), truth[name]
        across = (found["ra_deg"] - known["ra_deg"]) * np.cos(np.radians(known["dec_deg"]))
        error = 3600 * np.hypot(across, found["dec_deg"] - known["dec_deg"])
        assert error < 6
        sigma = np.hypot(*found["sigma_arcsec"][:2]) / np.sqrt(2)
        assert error < 2.45 * sigma
        assert sigma < 15  # 13.5 low above the horizon, where refraction is most of it
        axis = found["lens"]["ra_deg"] - found["ra_deg"]
        assert abs(axis) > 0.5  # the principal point is 52 pixels off the middle


@pytest.mark.slow
def test_an_image_that_few_hypotheses_do_not_solve_is_solved_without_a_field(outside, capsys):
    """Its pixels are oblong and sheared, so that few triangles agree; also with its field given."""
    path = str(outside / "images-more" / "tc16u_southern_maybe.png")
    found = []
    for more in ((), ("--fov", "14.3")):
        assert main(["solve", path, "--json", *more]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["matches"] >= 23
    assert found[0]["false_probability"] < 1e-20
    assert found[0]["ra_deg"] == pytest.approx(found[1]["ra_deg"], abs=0.01)
    assert found[0]["dec_deg"] == pytest.approx(found[1]["dec_deg"], abs=0.01)


def test_a_real_frame_of_streaks_says_how_fast_the_camera_turned(outside, capsys):
    """Against second moments of single stars, which contain a streak of that length and a round
    image.

    The field is that of a sharp image of the same camera.
    """
    path = outside / "images-streaked" / "pifinder_random.png"
    if not path.exists():
        pytest.skip(f"{path} is not there: test_images/random.png of brickbots/PiFinder")
    assert main(["solve", str(path), "--fov", "10.2", "--exposure", "0.75", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    x, y = found["streak_px"]
    assert np.hypot(x, y) == pytest.approx(8.19, abs=0.4)
    assert np.degrees(np.arctan2(y, -x)) == pytest.approx(59.0, abs=3)
    assert found["fov_x_deg"] == pytest.approx(10.721, abs=0.01)
    assert found["matches"] >= 30
    turned = np.hypot(x, y) * found["fov_x_deg"] / 512 / 0.75
    assert found["rate_deg_s"] == pytest.approx(turned, rel=0.02)


def test_calibration_from_a_field_that_is_a_sixth_too_wide(outside, capsys):
    path = outside / "images" / "cedar_orion_belt.jpg"
    assert main(["calibrate", str(path), "--fov", "12", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["fov_x_deg"] == pytest.approx(10.13, abs=0.02)


@pytest.mark.filterwarnings("ignore:The WCS transformation has more axes")  # as a header alone
def test_tables_and_names_of_other_programs(outside, tmp_path, capsys):
    """Spots, matches and WCS as astrometry.net has them agree with each other, read by astropy."""
    path = outside / "images" / ESA[0]
    arguments = ["--fov", "11.43", "--tables", str(tmp_path), "--keys", "tetra3", "--json"]
    assert main(["solve", str(path), *arguments]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["Matches"] == len(found["matched_stars"]) == len(found["matched_catID"])
    spots, corr = (Table.read(tmp_path / f"{path.stem}{end}", 1) for end in (".axy", ".corr"))
    assert len(corr) == found["Matches"]
    np.testing.assert_array_equal(spots["X"][corr["field_id"]], corr["field_x"])
    wcs = WCS(fits.getheader(tmp_path / f"{path.stem}.wcs"))
    x, y = wcs.all_world2pix(corr["index_ra"], corr["index_dec"], 1)
    np.testing.assert_allclose(x, corr["index_x"], atol=2e-3)
    np.testing.assert_allclose(y, corr["index_y"], atol=2e-3)
    assert np.hypot(x - corr["field_x"], y - corr["field_y"]).max() < 2
    row, column = np.array(found["matched_centroids"]).T
    np.testing.assert_allclose(np.sort(column + 0.5), np.sort(corr["field_x"]), atol=1e-9)
    np.testing.assert_allclose(np.sort(row + 0.5), np.sort(corr["field_y"]), atol=1e-9)
    truth = json.loads((outside / "images" / "truth.json").read_text())["images"][ESA[0]]
    assert found["RA"] == pytest.approx(truth["ra_deg"], abs=0.02)
    assert found["Roll"] == pytest.approx(truth["roll_north_ccw_deg"], abs=0.05)
    assert found["RMSE"] == pytest.approx(0.28 * 3600 * 11.43 / 1024, rel=0.5)  # arcsec
