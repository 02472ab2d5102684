import warnings

import cv2
import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table
from astropy.wcs import WCS

from startrack.core.camera import Camera
from startrack.core.values import Frame, Stars
from startrack.io.images import read_image, write_fits
from startrack.io.wcs import pointing

CAMERA = Camera(60, 40, 300.0, k1=-0.1)
ATTITUDE = pointing(80.0, -30.0, 20.0)
IMAGE = np.arange(2400, dtype=np.uint16).reshape(40, 60)


@pytest.fixture
def frame_file(tmp_path):
    pixel = np.array([[10.0, 20.0], [50.25, 3.5], [500.0, 3.0]])
    direction = ATTITUDE.inv().apply(CAMERA.unproject(pixel))
    stars = Stars(np.array([5, -7, 9]), direction, np.array([1.0, 2.0, 3.0]), np.full(3, np.nan))
    path = tmp_path / "frame.fits"
    write_fits(path, Frame(IMAGE, 0.1, 2.5, 64.0, 8.0), CAMERA, ATTITUDE, stars, "seed 1")
    return path


def test_a_frame_survives_fits(frame_file):
    frame = read_image(frame_file)
    np.testing.assert_array_equal(frame.image, IMAGE)
    assert (frame.exposure, frame.electrons_per_dn, frame.offset, frame.read_noise) == (
        0.1,
        2.5,
        64.0,
        8.0,
    )


def test_the_truth_table_and_the_wcs_agree(frame_file):
    truth = Table.read(frame_file, hdu="TRUTH")
    assert truth["IDENTIFIER"].tolist() == [5, -7]
    with fits.open(frame_file) as units:
        x, y = WCS(units[0].header).all_world2pix(truth["RA"], truth["DEC"], 0)
        assert units[0].verify_checksum() == 1
    np.testing.assert_allclose(x, [10.0, 50.25], atol=1e-3)
    np.testing.assert_allclose(y, [20.0, 3.5], atol=1e-3)
    np.testing.assert_allclose(truth["X"], [10.0, 50.25], atol=1e-9)


def test_a_cut_fits_file_is_refused(frame_file):
    whole = frame_file.read_bytes()
    for length in (100, 2000, 2880, 3000, 6000):
        frame_file.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"frame\.fits must"):
            read_image(frame_file)


@pytest.mark.parametrize("name", ["a.fits", "a.png", "a.jpg", "a.tiff"])
def test_empty_missing_and_garbled_files_are_refused(tmp_path, name):
    path = tmp_path / name
    with pytest.raises(ValueError, match="there is none"):
        read_image(path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match="empty"):
        read_image(path)
    path.write_bytes(b"not an image at all" * 10)
    with pytest.raises(ValueError, match=rf"{name} must"):
        read_image(path)


def test_an_image_of_nan_is_refused(tmp_path):
    path = tmp_path / "nan.fits"
    fits.writeto(path, np.full((8, 8), np.nan, np.float32))
    with pytest.raises(ValueError, match="must hold finite pixel values"):
        read_image(path)


def test_fits_of_other_shapes(tmp_path):
    path = tmp_path / "x.fits"
    fits.writeto(path, np.zeros(9))
    with pytest.raises(ValueError, match="two axes"):
        read_image(path)
    fits.writeto(path, np.stack([IMAGE, IMAGE + 1]), overwrite=True)
    np.testing.assert_array_equal(read_image(path).image, IMAGE + 1)
    # Unsigned 16 bit as FITS stores them: big-endian, signed, with BZERO.
    fits.writeto(path, IMAGE + np.uint16(40000), overwrite=True)
    got = read_image(path).image
    assert got.dtype.isnative
    np.testing.assert_array_equal(got, IMAGE + 40000)


def test_pictures_keep_their_depth_and_colours_their_largest(tmp_path):
    cv2.imwrite(str(tmp_path / "deep.png"), IMAGE)
    np.testing.assert_array_equal(read_image(tmp_path / "deep.png").image, IMAGE)
    colour = np.zeros((4, 5, 3), np.uint8)
    colour[1, 2] = (10, 30, 20)
    cv2.imwrite(str(tmp_path / "colour.tiff"), colour)
    got = read_image(tmp_path / "colour.tiff").image
    assert got.shape == (4, 5)
    assert (got[1, 2], got.sum()) == (30, 30)


def test_equal_frames_are_equal_files_with_valid_checksums(frame_file):
    """The time of writing is not in the file; astropy verifies the sums."""
    with fits.open(frame_file) as parts:
        assert len(parts) == 2
        for part in parts:
            assert part.header.comments["CHECKSUM"] == "of this header and its data"
            assert part.header.comments["DATASUM"] == "of this header and its data"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with fits.open(frame_file, checksum=True) as parts:
            assert [part.verify_checksum() for part in parts] == [1, 1]
            assert [part.verify_datasum() for part in parts] == [1, 1]
