import gzip
import io
import struct
import sys
import warnings
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table
from astropy.time import Time
from astropy.wcs import WCS
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from startrack.core import Refused
from startrack.core.camera import Camera
from startrack.core.values import Frame, Stars
from startrack.io.images import field_hint, read_image, rows_upwards, write_fits
from startrack.io.saving import save_figure
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


def test_a_figure_of_an_image_is_refused_as_an_image(tmp_path):
    figure = Figure()
    figure.add_subplot().imshow(np.eye(9))
    save_figure(tmp_path / "frame.png", figure)
    with pytest.raises(Refused, match=r"image of a camera, but it is a figure .*frame\.fits"):
        read_image(tmp_path / "frame.png")
    FigureCanvasAgg(figure).print_png(tmp_path / "other.png")  # of another program
    assert read_image(tmp_path / "other.png").image.shape == (480, 640)


def test_a_bmp_is_read(tmp_path):
    """The file has upward rows and three colours."""
    image = np.arange(60, dtype=np.uint8).reshape(6, 10)
    cv2.imwrite(str(tmp_path / "a.bmp"), np.dstack([image // 3, image // 2, image]))
    assert (read_image(tmp_path / "a.bmp").image == image).all()
    (tmp_path / "b.bmp").write_bytes((tmp_path / "a.bmp").read_bytes()[:90])
    with pytest.raises(ValueError, match="BMP"):
        read_image(tmp_path / "b.bmp")


def test_of_several_images_the_first_of_the_largest_is_read(tmp_path):
    small, large = np.zeros((8, 9), np.float32), np.ones((20, 30), np.float32)
    parts = [small, large, 2 * large]
    names = ["THUMB", "SCI", "ERR"]
    units = [fits.ImageHDU(part, name=name) for part, name in zip(parts, names, strict=True)]
    path = tmp_path / "several.fits"
    fits.HDUList([fits.PrimaryHDU(), *units]).writeto(path)
    with pytest.warns(UserWarning, match="SCI is read"):
        assert (read_image(path).image == large).all()


@pytest.mark.parametrize(
    ("order", "upwards"), [("BOTTOM-UP", True), ("TOP-DOWN", False), (None, False)]
)
def test_a_file_says_which_way_its_rows_go(tmp_path, order, upwards):
    header = fits.Header({"ROWORDER": order} if order else {})
    fits.writeto(tmp_path / "a.fits", np.ones((20, 30), np.float32), header)
    assert rows_upwards(tmp_path / "a.fits") is upwards
    assert not rows_upwards(tmp_path / "none.png")


def test_equal_frames_are_equal_files_with_valid_checksums(frame_file):
    """The file has no time of writing; astropy verifies the checksums."""
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


def fits_bytes(*parts) -> bytes:
    file = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), *parts]).writeto(file)
    return file.getvalue()


PLAIN = fits_bytes(fits.ImageHDU(IMAGE))
RICE = fits_bytes(fits.CompImageHDU(np.arange(4096, dtype=np.int16).reshape(64, 64)))


def without_card(data: bytes, name: bytes) -> bytes:
    return data.replace(name.ljust(8) + b"=", b"COMMENT =")


def with_card(data: bytes, name: bytes, value: bytes) -> bytes:
    at = data.rindex(name.ljust(8) + b"=")
    return data[:at] + (name.ljust(8) + b"= " + value.rjust(20)).ljust(80) + data[at + 80 :]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (without_card(PLAIN, b"NAXIS1"), "NAXIS1"),
        (with_card(PLAIN, b"NAXIS1", b"9999999"), "GiB|whole FITS"),
        (with_card(PLAIN, b"NAXIS1", b"-5"), "whole FITS|two axes"),
        (with_card(PLAIN, b"BITPIX", b"'x'"), "whole FITS"),
        (gzip.compress(PLAIN, mtime=0)[:-30], "gzip"),
        (gzip.compress(PLAIN, mtime=0)[:40] + b"\0" * 60, "gzip"),
        (RICE[:-2880] + b"\xff" * 2880, "whole FITS"),
        (with_card(RICE, b"ZNAXIS1", b"2000000000"), "GiB|whole FITS"),
        (with_card(RICE, b"ZTILE1", b"0"), "whole FITS"),
        (b"BZh9" + PLAIN, "begins with SIMPLE"),
        # astropy would look for each of these axes for minutes
        (with_card(PLAIN, b"NAXIS", b"99999999"), "NAXIS at most 999, got 99999999"),
    ],
)
def test_damaged_fits_is_refused_in_a_sentence(tmp_path, data, words):
    path = tmp_path / "any.fits"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=words) as caught:
        read_image(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def png_of(columns, rows) -> bytes:
    """A PNG whose header states a size."""
    header = b"IHDR" + struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0)
    chunk = struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    return b"\x89PNG\r\n\x1a\n" + chunk


def jpeg_of(columns, rows) -> bytes:
    return b"\xff\xd8\xff\xc0" + struct.pack(">HBHHB", 17, 8, rows, columns, 3) + b"\0" * 20


def tiff_of(columns, rows) -> bytes:
    tags = [(256, columns), (257, rows), (258, 16), (277, 1)]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + b"\0" * 4


@pytest.mark.parametrize("make", [png_of, jpeg_of, tiff_of])
def test_a_picture_too_large_for_the_memory_is_refused_unread(tmp_path, make, monkeypatch):
    monkeypatch.setenv("STARTRACK_MEMORY", str(2**30))
    path = tmp_path / f"large.{make.__name__[:3]}"
    path.write_bytes(make(30_000, 30_000))
    with pytest.raises(ValueError, match=r"30000 x 30000 .*need 2[0-9.]* GiB .*limit of 1 GiB"):
        read_image(path)
    path.write_bytes(make(3, 3))
    with pytest.raises(ValueError, match="must be"):
        read_image(path)


def test_a_gzip_bomb_is_refused_while_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setenv("STARTRACK_MEMORY", str(2**24))
    path = tmp_path / "bomb.fits.gz"
    path.write_bytes(gzip.compress(PLAIN + b"\0" * 2**25))
    with pytest.raises(ValueError, match=r"unpacked, would need .* the limit of"):
        read_image(path)


def test_frames_are_stamped_as_astropy_reads_their_dates(tmp_path):
    """With any of the keywords of a date; a UTC day without a leap second has 86,400 s."""
    begin = Time("2000-01-01", scale="utc")
    cards = (
        {"DATE-OBS": "2026-03-01T23:59:59.250001"},
        {"MJD-OBS": 61100.123456},
        {"JD": 2461100.5},
        {"DATE-OBS": "2026-03-01", "TIME-OBS": "12:30:01.5"},
    )
    dates = (
        "2026-03-01T23:59:59.250001",
        Time(61100.123456, format="mjd"),
        Time(2461100.5, format="jd"),
        "2026-03-01T12:30:01.5",
    )
    for card, date in zip(cards, dates, strict=True):
        fits.PrimaryHDU(np.ones((4, 4)), fits.Header(card)).writeto(
            tmp_path / "a.fits", overwrite=True
        )
        days = np.round(Time(date, scale="utc").mjd - begin.mjd, 10)
        assert read_image(tmp_path / "a.fits").time == pytest.approx(days * 86400, abs=2e-5)
    for card in {"DATE-OBS": "2026-03-01"}, {"DATE-OBS": "yesterday"}, {}:
        fits.PrimaryHDU(np.ones((4, 4)), fits.Header(card)).writeto(
            tmp_path / "a.fits", overwrite=True
        )
        assert np.isnan(read_image(tmp_path / "a.fits").time)


def test_gzipped_fits_is_read(tmp_path):
    path = tmp_path / "whole.fits.gz"
    path.write_bytes(gzip.compress(PLAIN[:100]) + gzip.compress(PLAIN[100:]))
    np.testing.assert_array_equal(read_image(path).image, IMAGE)


def written_as(path, image, focal_35mm=None):
    """The image as a camera would write it, with the focal length in EXIF."""
    from PIL import Image

    exif = Image.Exif()
    if focal_35mm is not None:
        exif.get_ifd(0x8769)[0xA405] = focal_35mm
    Image.fromarray(image).save(path, quality=95, exif=exif)


@pytest.mark.parametrize("kind", ["jpg", "heic"])
def test_a_photograph_says_its_field(tmp_path, kind):
    """A 50 mm lens on film of 36 x 24 mm spans 2 atan(18 / 50) along its longer side."""
    if kind == "heic":
        pytest.importorskip("pillow_heif").register_heif_opener()
    wide, high, plain = (tmp_path / f"{name}.{kind}" for name in ("wide", "high", "plain"))
    image = np.full((200, 300, 3), 20, np.uint8)
    written_as(wide, image, 50)
    written_as(high, image.transpose(1, 0, 2).copy(), 50)
    written_as(plain, image)
    assert field_hint(wide, (200, 300)) == pytest.approx(2 * np.arctan(18 / 50))
    assert field_hint(high, (300, 200)) == pytest.approx(2 * np.arctan(12 / 50))
    assert field_hint(plain, (200, 300)) is None


def test_a_heic_image_is_read(tmp_path):
    """Spots lie at the drawn places; a truncated file is refused with its name."""
    pytest.importorskip("pillow_heif").register_heif_opener()
    y, x = np.indices((120, 160))
    star = 200 * np.exp(-((x - 71.4) ** 2 + (y - 33.7) ** 2) / 2 / 2.0**2)
    path = tmp_path / "star.heic"
    written_as(path, np.dstack([20 + star.astype(np.uint8)] * 3))
    light = read_image(path).image.astype(float) - 20
    light[light < 20] = 0
    assert light.shape == (120, 160)
    assert (light * x).sum() / light.sum() == pytest.approx(71.4, abs=0.1)
    assert (light * y).sum() / light.sum() == pytest.approx(33.7, abs=0.1)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(ValueError, match=r"star\.heic must be a whole HEIC image"):
        read_image(path)
    assert field_hint(path, (120, 160)) is None


def test_a_heic_image_without_pillow_heif_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    path = tmp_path / "star.heic"
    path.write_bytes(b"\0\0\0\x18ftypheic" + bytes(40))
    with pytest.raises(ValueError, match="install pillow-heif"):
        read_image(path)


def test_the_excess_noise_of_a_register_is_kept(tmp_path):
    """astropy reads the card; a frame of 4000 electrons with twice the variance keeps its gain."""
    random = np.random.default_rng(3)
    image = (100 + 2000 + np.sqrt(2 * 4000) / 2 * random.standard_normal((64, 64))).astype(
        np.uint16
    )
    path = tmp_path / "frame.fits"
    frame = Frame(image, 0.1, 2.0, 100.0, 5.0, excess_noise=2.0)
    write_fits(path, frame, CAMERA, ATTITUDE)
    with fits.open(path) as units:
        assert units[0].header["EXCESSN"] == 2.0
    found = read_image(path)
    assert (found.excess_noise, found.electrons_per_dn, found.noise_gain) == (2.0, 2.0, 1.0)
    write_fits(path, replace(frame, excess_noise=1.0), CAMERA, ATTITUDE)
    with fits.open(path) as units:
        assert "EXCESSN" not in units[0].header
