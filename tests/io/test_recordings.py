"""Files of cameras: cubes, SER, raw, mosaics; and frames that are written for other programs."""

import csv
from datetime import UTC, datetime, timedelta

import cv2
import numpy as np
import pytest
from astropy.io import fits

from startrack.core import Frame
from startrack.io import FrameFiles, Layout, pointing, read_image
from startrack.io.frame_files import FORMATS
from startrack.io.recordings import PATTERNS

START = datetime(2026, 3, 20, 12, tzinfo=UTC)
IMAGES = [np.arange(24, dtype=np.uint16).reshape(4, 6) * 1000 + k for k in range(3)]
COLOURS = {"R": 5.0, "G": 20.0, "B": 300.0}


def mosaic(pattern):
    """A raw image (4, 6) whose pixels have the number of their colour."""
    cell = np.array([COLOURS[letter] for letter in pattern]).reshape(2, 2)
    return np.tile(cell, (2, 3)).astype(np.uint16)


@pytest.fixture
def files(tmp_path):
    """Write IMAGES in a format; return the files."""

    def write(format):
        files = FrameFiles(tmp_path, "night", format, START)
        for k, image in enumerate(IMAGES):
            files.add(Frame(image, 0.1), 10.0 + k / 4, pointing(80.0 + k, -30.0, 20.0))
        return files.close()

    return write


@pytest.mark.parametrize("format", FORMATS)
def test_frames_are_read_back_with_their_times_and_attitudes(files, format):
    *paths, table = files(format)
    with table.open() as text:
        rows = list(csv.DictReader(text))
    layout = {"raw": "6x4:uint16"} if format == "raw" else {}
    for k, row in enumerate(rows):
        path = table.with_name(row["file"])
        assert path in paths
        plane = {"plane": int(row["number"])} if format in ("ser", "raw", "mkv") else {}
        np.testing.assert_array_equal(read_image(path, Layout(**layout, **plane)).image, IMAGES[k])
        assert float(row["ra_deg"]) == pytest.approx(80.0 + k)
        assert float(row["time_s"]) == 10 + k / 4
        begun = datetime.fromisoformat(row["date_obs"]).replace(tzinfo=UTC)
        assert begun - START == timedelta(seconds=10 + k / 4 - 0.05)
    assert len(rows) == 3
    assert not list(table.parent.glob(".*"))


def test_fits_frames_have_the_start_of_their_exposure(files):
    header = fits.getheader(files("fits")[1])
    assert header["DATE-OBS"] == "2026-03-20T12:00:10.200000"
    assert header["TIMESYS"] == "UTC"


def test_a_ser_has_the_layout_of_its_description(files):
    """Bytes by the published description: header of 178, pixels, times in 0.1 us since year 1."""
    data = files("ser")[0].read_bytes()
    assert data[:14] == b"LUCAM-RECORDER"
    numbers = np.frombuffer(data, "<i4", 7, 14)
    assert numbers[1:].tolist() == [0, 0, 6, 4, 16, 3]
    pixels = np.frombuffer(data, "<u2", 72, 178).reshape(3, 4, 6)
    np.testing.assert_array_equal(pixels, IMAGES)
    times = np.frombuffer(data, "<i8", 3, 178 + 144)
    # 20 March 2026 12:00 UTC is 63,909,604,800 s after the year 1 began.
    assert (times / 1e7 - 63_909_604_800).tolist() == pytest.approx([9.95, 10.2, 10.45], abs=1e-4)


def test_big_endian_and_colour_sers_are_read(files, tmp_path):
    data = bytearray(files("ser")[0].read_bytes())
    data[22:26] = (1).to_bytes(4, "little")
    other = tmp_path / "other.ser"
    other.write_bytes(data)
    np.testing.assert_array_equal(read_image(other).image, IMAGES[0].byteswap())
    data[18:22] = (9).to_bytes(4, "little")  # GRBG
    other.write_bytes(data)
    with pytest.warns(UserWarning, match=r"mosaic of colours \(GRBG\): each two by two pixels"):
        assert read_image(other).image.shape == (2, 3)
    data[18:22] = (100).to_bytes(4, "little")  # RGB: three times the pixels
    other.write_bytes(data)
    with pytest.raises(ValueError, match="it is cut"):
        read_image(other)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_mosaic_becomes_one_colour_or_all(tmp_path, pattern):
    path = tmp_path / "raw.png"
    cv2.imwrite(str(path), mosaic(pattern))
    for colour, letter in (("red", "R"), ("green", "G"), ("blue", "B")):
        got = read_image(path, Layout(bayer=pattern, colour=colour)).image
        np.testing.assert_array_equal(got, np.full((2, 3), COLOURS[letter]))
    got = read_image(path, Layout(bayer=pattern)).image
    np.testing.assert_allclose(got, np.full((2, 3), (5 + 20 + 20 + 300) / 4))
    np.testing.assert_array_equal(read_image(path).image, mosaic(pattern))


def test_the_pattern_of_a_header_counts_unless_another_is_given(tmp_path):
    path = tmp_path / "raw.fits"
    unit = fits.PrimaryHDU(mosaic("RGGB"))
    unit.header["BAYERPAT"] = "RGGB"
    unit.writeto(path)
    red = Layout(colour="red")
    assert (read_image(path, red).image == COLOURS["R"]).all()
    assert (read_image(path, Layout(bayer="BGGR", colour="red")).image == COLOURS["B"]).all()
    np.testing.assert_array_equal(read_image(path, Layout(bayer="none")).image, mosaic("RGGB"))
    # An image that begins a column later in the same detector.
    fits.setval(path, "XBAYROFF", value=1)
    assert (read_image(path, red).image == COLOURS["G"]).all()
    assert (read_image(path, Layout(colour="blue")).image == COLOURS["G"]).all()


def test_a_plane_of_a_cube_is_chosen(tmp_path):
    path = tmp_path / "cube.fits"
    fits.PrimaryHDU(np.stack(IMAGES)).writeto(path)
    np.testing.assert_array_equal(read_image(path, Layout(plane=1)).image, IMAGES[1])
    with pytest.warns(UserWarning, match="cube of 3 planes: each pixel has the largest value"):
        np.testing.assert_array_equal(read_image(path).image, IMAGES[2])
    with pytest.raises(ValueError, match=r"plane must lie in \[0, 2\], got 3"):
        read_image(path, Layout(plane=3))


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ({"raw": "6x5:uint16"}, "whole frames of 60 bytes"),
        ({"raw": "6x4:uint16", "plane": 3}, r"plane must lie in \[0, 2\]"),
        ({}, "must be a whole FITS"),
    ],
)
def test_a_raw_file_of_another_size_is_refused(files, layout, message):
    with pytest.raises(ValueError, match=message):
        read_image(files("raw")[0], Layout(**layout))


def test_a_video_of_colours_is_read_and_what_is_none_is_refused(files, tmp_path):
    path = tmp_path / "colours.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5.0, (64, 48))
    for level in (20, 200):
        video.write(np.full((48, 64, 3), (0, level, 0), np.uint8))
    video.release()
    image = read_image(path, Layout(plane=1)).image
    assert image.shape == (48, 64)
    assert np.abs(image.astype(int) - 200).max() < 5  # JPEG
    with pytest.raises(ValueError, match="must hold a frame 2 that can be decoded"):
        read_image(path, Layout(plane=2))
    (grey,) = (one for one in files("mkv") if one.suffix == ".mkv")
    grey.write_bytes(grey.read_bytes()[:200])
    with pytest.raises(ValueError, match="must hold a frame 0 that can be decoded"):
        read_image(grey)
    grey.write_text("ffconcat version 1.0\nfile colours.avi\n")
    with pytest.raises(ValueError, match="must be a Matroska, AVI, MP4 or MOV video"):
        read_image(grey)


def test_bad_layouts_and_frames_are_refused(tmp_path):
    with pytest.raises(ValueError, match="COLUMNSxROWS:TYPE"):
        Layout(raw="6:uint16")
    with pytest.raises(ValueError, match="bayer must be"):
        Layout(bayer="RGBG")
    files = FrameFiles(tmp_path, "night", "png", START)
    with pytest.raises(ValueError, match="whole numbers from 0 to 65535"):
        files.add(Frame(np.full((4, 6), 0.5), 0.1), 0.0, pointing(0, 0, 0))


def test_no_format_that_names_addresses_is_taken_for_a_video(tmp_path):
    """FFmpeg would take this for a session description, whose streams come over the network."""
    path = tmp_path / "a.mkv"
    session = (
        b"\nc=IN IP4 127.0.0.1\r\nt=0 0\r\nm=video 5004 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"
    )
    path.write_bytes(b"\x1a\x45\xdf\xa3" + session)
    with pytest.raises(ValueError, match=r"must hold a frame 0 that can be decoded"):
        read_image(path)
