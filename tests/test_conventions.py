"""Each convention that is easily inverted, tested where light, pixels and files meet.

References are facts of the sky (Orion's belt on a map with north up and east left), FITS as astropy
reads it, and Hamilton's product written out.
"""

from dataclasses import replace

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import SkyCoord
from astropy.io import fits
from astropy.wcs import WCS
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.catalog import open_sky
from startrack.core.streams import Streams
from startrack.core.units import deg
from startrack.core.values import Estimate, Frame, Status
from startrack.design.case import Case
from startrack.design.files import load_design
from startrack.detection import Detection, detect
from startrack.io import shipped
from startrack.io.images import write_fits
from startrack.io.wcs import pointing
from startrack.metrics import judge
from startrack.motion import Motion
from startrack.observation.exposure import expected_electrons
from startrack.observation.pointing import line_of_sight
from startrack.observation.stars import stars_in_field

# Right ascension and declination, degree: the belt of Orion from east to west.
ALNITAK, ALNILAM, MINTAKA = (85.1897, -1.9426), (84.0534, -1.2019), (83.0017, -0.2991)
MINUTE = deg / 60


@pytest.fixture(scope="module")
def case() -> Case:
    """A camera at rest with more columns than rows."""
    case = load_design(shipped("designs/noise_only.toml")).case
    detector = replace(case.instrument.detector, columns=512, rows=384)
    return replace(case, instrument=replace(case.instrument, detector=detector, motion=Motion()))


def seen(case: Case, attitude: Rotation) -> NDArray[np.float64]:
    """The expected electrons (rows, columns) of a frame."""
    streams = Streams(1, 0)
    stars = stars_in_field(open_sky(case.catalog), attitude, case.instrument.camera)
    return expected_electrons(
        case, stars, line_of_sight(case.instrument, streams), attitude, streams
    )


def on(place: tuple[float, float], case: Case, roll: float = 0.0) -> Rotation:
    """The camera whose boresight is on the catalogue star nearest to a place."""
    stars = open_sky(case.catalog).stars
    near = SkyCoord(*place, unit="deg").cartesian.xyz.value
    x, y, z = stars.direction[np.argmax(stars.direction @ near)]
    return pointing(np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z)), roll)


def brightest_near(image: NDArray[np.float64], place: tuple[float, float]) -> tuple[int, int]:
    """Row and column of the brightest pixel within 30 of a (row, column)."""
    top, left = (max(round(k) - 30, 0) for k in place)
    part = image[top : top + 61, left : left + 61]
    row, column = np.unravel_index(np.argmax(part), part.shape)
    return top + int(row), left + int(column)


def test_half_pixel_origin(case):
    """512 columns and 384 rows counted from 0 have their centre at (255.5, 191.5).

    A star on the boresight lights the four pixels around it equally, and is found there.
    """
    image = seen(case, on(ALNILAM, case))
    four = image[191:193, 255:257]
    np.testing.assert_allclose(four, four.mean(), rtol=0.01)
    assert four.min() > 0.98 * image[150:230, 200:300].max()
    background = np.random.default_rng(1).normal(40, 4, image.shape)  # for the search to compare
    spots = detect(Frame((0.1 * image + background).astype(np.float32)), Detection())
    assert np.hypot(spots.x - 255.5, spots.y - 191.5).min() < 0.05


def test_handedness(case):
    """North up and east left: Alnitak is lower left of Alnilam, Mintaka upper right.

    The sky seen from inside; in a mirrored camera the belt would slope the other way.
    """
    image = seen(case, on(ALNILAM, case))
    pixel = 1 / case.instrument.camera.focal_length_px / deg
    for star, side in ((ALNITAK, -1), (MINTAKA, 1)):
        east, north = np.subtract(star, ALNILAM) / pixel
        row, column = brightest_near(image, (191.5 - north, 255.5 - east))
        assert column - 255.5 == pytest.approx(-east, abs=2)
        assert row - 191.5 == pytest.approx(-north, abs=2)
        assert np.sign(column - 255.5) == side
        assert np.sign(row - 191.5) == -side


def test_rows_and_columns(case):
    """Arrays are [row, column] and spots (x, y) = (column, row), on frames that are not square."""
    assert seen(case, on(ALNILAM, case)).shape == (384, 512)
    image = np.random.default_rng(2).normal(100, 2, (64, 96))
    image[11:14, 69:72] += np.outer([0.3, 1, 0.3], [0.5, 1, 0.5]) * 500
    spots = detect(Frame(image), Detection())
    assert (round(spots.x[0]), round(spots.y[0])) == (70, 12)
    # Longer along the columns: the variance along x is the larger one of a star so drawn.
    assert spots.covariance[0, 0, 0] > spots.covariance[0, 1, 1]


def test_roll_sign(case):
    """Roll grows as north turns from up to the left: about +z, from +x (right) to +y (down).

    The sky then rotates by the same angle the other way, as does the error of a roll assumed too
    large.
    """
    camera = case.instrument.camera
    boresight = SkyCoord(*ALNILAM, unit="deg")
    north = boresight.directional_offset_by(0 * units.deg, 2 * units.deg).cartesian.xyz.value
    x, y = camera.project(pointing(*ALNILAM, 30.0).apply(north))[0] - camera.centre
    size = np.tan(2 * deg) * camera.focal_length_px
    np.testing.assert_allclose([x, y], [-size * 0.5, -size * np.sqrt(0.75)], atol=1e-6)
    larger = Estimate(Status.SOLVED, "", pointing(*ALNILAM, 30 + 1 / 60), np.eye(3), 0.0, 9, 1e-9)
    outcome = judge(larger, pointing(*ALNILAM, 30.0), 9)
    assert outcome.error_z == pytest.approx(-MINUTE)
    assert abs(outcome.error_x) + abs(outcome.error_y) < 1e-9


def test_fits_counts_from_one(case, tmp_path):
    """A star in the pixel at row 191, column 255 of the array is at FITS pixel (256, 192)."""
    attitude, file = on(MINTAKA, case, 40.0), tmp_path / "frame.fits"
    image = seen(case, on(ALNILAM, case, 40.0))
    write_fits(file, Frame(image), case.instrument.camera, on(ALNILAM, case, 40.0))
    wcs = WCS(fits.getheader(file))
    sky = SkyCoord(*attitude.inv().apply([0, 0, 1]), representation_type="cartesian")
    column, row = wcs.all_world2pix(sky.spherical.lon.deg, sky.spherical.lat.deg, 1)
    top, left = brightest_near(image, (float(row) - 1, float(column) - 1))
    part = image[top - 2 : top + 3, left - 2 : left + 3]
    fraction = part / part.sum()
    centre = (
        fraction.sum(axis=0) @ np.arange(5) + left - 2,
        fraction.sum(axis=1) @ np.arange(5) + top - 2,
    )
    np.testing.assert_allclose((float(column), float(row)), np.add(centre, 1), atol=0.1)


def test_quaternion_order(case, tmp_path):
    """Scalar last, by name: v' = v + 2 u x (u x v + w v) rotates the sky into the camera."""
    attitude, file = on(ALNITAK, case, 70.0), tmp_path / "frame.fits"
    write_fits(file, Frame(np.zeros((384, 512))), case.instrument.camera, attitude)
    header = fits.getheader(file)
    u, w = np.array([header[f"QUAT_{axis}"] for axis in "XYZ"]), header["QUAT_W"]
    star = SkyCoord(*ALNITAK, unit="deg").cartesian.xyz.value
    turned = star + 2 * np.cross(u, np.cross(u, star) + w * star)
    np.testing.assert_allclose(turned, [0, 0, 1], atol=1e-3)
    quarter = Rotation.from_matrix([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    write_fits(file.with_name("quarter.fits"), Frame(np.zeros((2, 2))), None, quarter)
    header = fits.getheader(file.with_name("quarter.fits"))
    half = np.sqrt(0.5)
    values = [header[f"QUAT_{axis}"] for axis in "XYZW"]
    np.testing.assert_allclose(values, [0, 0, half, half], atol=1e-12)


def test_quaternions_are_scipys_and_the_conjugates_of_those_of_simulators():
    """The formula that conventions.md and the exports state; EP2C of Basilisk, written out.

    Source: Schaub and Junkins (2018), Analytical Mechanics of Space Systems, 4th ed., eq. (3.93),
    which Basilisk's RigidBodyKinematics has; 42's Q2C and CCSDS 504.0 are the same, scalar last.
    """
    numbers = np.array([0.1, -0.5, 0.3, 0.8]) / np.linalg.norm([0.1, -0.5, 0.3, 0.8])
    matrix = Rotation.from_quat(numbers).as_matrix()
    q, w = numbers[:3], numbers[3]
    for u in np.eye(3):
        turned = u + 2 * w * np.cross(q, u) + 2 * np.cross(q, np.cross(q, u))
        assert matrix @ u == pytest.approx(turned, abs=1e-15)
    b0, b1, b2, b3 = w, *-q
    ep2c = [
        [b0**2 + b1**2 - b2**2 - b3**2, 2 * (b1 * b2 + b0 * b3), 2 * (b1 * b3 - b0 * b2)],
        [2 * (b1 * b2 - b0 * b3), b0**2 - b1**2 + b2**2 - b3**2, 2 * (b2 * b3 + b0 * b1)],
        [2 * (b1 * b3 + b0 * b2), 2 * (b2 * b3 - b0 * b1), b0**2 - b1**2 - b2**2 + b3**2],
    ]
    assert matrix == pytest.approx(np.array(ep2c), abs=1e-15)
