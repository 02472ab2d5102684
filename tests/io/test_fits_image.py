"""FITS of other programs: untidy headers, BLANK, several images, gain and exposure."""

import io
import math

import numpy as np
import pytest
from astropy.io import fits

from startrack.core import Refused
from startrack.io.images import read_image
from startrack.io.recordings import Layout

TRUE_GAIN, LEVEL, READ_NOISE = 4.88, 1000, 6.0


def noisy() -> np.ndarray:
    """Photon noise and read noise of a known gain; no offset."""
    random = np.random.default_rng(7)
    electrons = random.poisson(LEVEL * TRUE_GAIN, (120, 160))
    electrons = electrons + random.normal(0, READ_NOISE, (120, 160))
    return np.round(electrons / TRUE_GAIN).astype("u2")


NOISY = noisy()


def with_cards(path, cards, image=NOISY):
    unit = fits.PrimaryHDU(image)
    for key, value in cards.items():
        unit.header[key] = value
    unit.writeto(path)
    return path


@pytest.mark.parametrize(
    "cards",
    [
        {"GAIN": (TRUE_GAIN, "[electron/DN]")},
        {"GAIN": (TRUE_GAIN, "CCD gain, e-/ADU")},
        {"GAIN": TRUE_GAIN},
        {"EGAIN": TRUE_GAIN, "GAIN": 0},
        {"EGAIN": TRUE_GAIN, "GAIN": 300, "INSTRUME": "ZWO ASI294MM Pro"},
        {"GAIN": (1 / TRUE_GAIN, "[adu/electron]")},
        {"GAIN": (1 / TRUE_GAIN, "inverse gain, DN per e-")},
    ],
)
def test_a_gain_in_electrons_is_taken(tmp_path, cards):
    gain = read_image(with_cards(tmp_path / "a.fits", cards)).electrons_per_dn
    assert gain == pytest.approx(TRUE_GAIN, rel=1e-12)


@pytest.mark.parametrize(
    "cards",
    [
        {"GAIN": 0},
        {"GAIN": 5, "INSTRUME": "ZWO ASI178MM"},
        {"GAIN": 300, "SWCREATE": "SharpCap v4.0, 64 bit"},
        {"GAIN": "high"},
        {"GAIN": True},
        {"GAIN": (TRUE_GAIN, "[dB]")},
        {"EGAIN": 0.0},
    ],
)
def test_a_setting_is_no_gain(tmp_path, cards):
    assert math.isnan(read_image(with_cards(tmp_path / "a.fits", cards)).electrons_per_dn)


@pytest.mark.parametrize(
    "cards", [{"GAIN": 300}, {"GAIN": (120, "Sensor gain")}, {"EGAIN": 0.12}, {"EGAIN": 500.0}]
)
def test_a_gain_that_the_noise_contradicts_is_said_and_not_taken(tmp_path, cards):
    path = with_cards(tmp_path / "a.fits", cards)
    with pytest.warns(UserWarning, match="the gain is treated as unknown"):
        assert math.isnan(read_image(path).electrons_per_dn)


def test_pixels_in_electrons_have_no_other_gain(tmp_path):
    """A header may keep the gain by which a program has multiplied the pixels."""
    electrons = np.random.default_rng(4).poisson(2000.0, (64, 64)).astype("f4")
    cards = {"BUNIT": "electron", "GAIN": (2.0, "[electron/DN]")}
    assert read_image(with_cards(tmp_path / "a.fits", cards, electrons)).electrons_per_dn == 1


@pytest.mark.parametrize(
    ("comment", "electrons"),
    [("[ADU] rms", 2 * TRUE_GAIN), ("read noise, DN", 2 * TRUE_GAIN), ("[electron] rms", 2.0)],
)
def test_read_noise_has_the_unit_of_its_comment(tmp_path, comment, electrons):
    cards = {"RDNOISE": (2.0, comment), "EGAIN": TRUE_GAIN}
    noise = read_image(with_cards(tmp_path / "a.fits", cards)).read_noise
    assert noise == pytest.approx(electrons)


@pytest.mark.parametrize("pedestal", [400, -400])
def test_an_offset_is_what_is_to_be_taken_off(tmp_path, pedestal):
    """Most programs write PEDESTAL; MaxIm DL writes the number to be added."""
    path = with_cards(tmp_path / "a.fits", {"PEDESTAL": pedestal}, NOISY + np.uint16(400))
    assert read_image(path).offset == 400


def test_the_gain_of_a_mosaic_counts_the_pixels_that_are_averaged(tmp_path):
    """The mean of four pixels has half of their noise at the same level."""
    cards = {"EGAIN": TRUE_GAIN, "RDNOISE": READ_NOISE, "BAYERPAT": "RGGB"}
    path = with_cards(tmp_path / "a.fits", cards)
    for colour, count in (("superpixel", 4), ("green", 2), ("red", 1)):
        frame = read_image(path, Layout(bayer="RGGB", colour=colour))
        assert frame.electrons_per_dn == pytest.approx(count * TRUE_GAIN)
        variance = LEVEL / frame.electrons_per_dn
        variance += (frame.read_noise / frame.electrons_per_dn) ** 2 + 1 / 12 / count
        # 4,800 pixels: the sample variance errs by 2 % (1 sigma); 5 sigma.
        assert frame.image.var() == pytest.approx(variance, rel=0.1)


@pytest.mark.parametrize(
    ("cards", "seconds"),
    [
        ({"EXPOSURE": 0.25}, 0.25),
        ({"EXPTIME": (250, "[ms] exposure")}, 0.25),
        ({"EXPOSURE": (250000, "exposure in microseconds")}, 0.25),
        ({"EXPTIME": 0.25, "EXPOSURE": 0.25}, 0.25),
        ({"EXPOSURE": (2.0, "[min] exposure")}, 120.0),
        ({"EXPTIME": (250, "exposure time in msec")}, 0.25),
        ({"EXPTIME": (250000, "[usec]")}, 0.25),
        ({"EXPTIME": (0.5, "exposure in hours")}, 1800.0),
        ({"EXPTIME": (0.5, "readout 10 msecs; seconds")}, 0.5),
        ({"EXPTIME": (0.5, "[sec] (1 hour = 3600)")}, 0.5),
        ({"EXPTIME": (0.5, "exp. time, max 24 hours")}, 0.5),
    ],
)
def test_exposures_have_the_unit_of_their_comment(tmp_path, cards, seconds):
    path = with_cards(tmp_path / "a.fits", cards)
    assert read_image(path).exposure == pytest.approx(seconds)


def test_two_exposures_that_differ_are_none(tmp_path):
    path = with_cards(tmp_path / "a.fits", {"EXPTIME": 0.25, "EXPOSURE": 2.0})
    with pytest.warns(UserWarning, match="neither is taken"):
        assert math.isnan(read_image(path).exposure)


def untidy() -> dict[str, bytes]:
    file = io.BytesIO()
    unit = fits.PrimaryHDU(NOISY)
    unit.header["OBJECT"] = "xxxxxxxx"
    unit.writeto(file)
    data = file.getvalue()
    end = data.index(b"END" + b" " * 77) + 80
    block = 2880 * math.ceil(end / 2880)
    return {
        "not ASCII": data.replace(b"xxxxxxxx", b"caf\xe9xxxx"),
        "UTF-8": data.replace(b"xxxxxxxx", "Müxxxxx".encode()),
        "zeros": data[:end] + b"\0" * (block - end) + data[block:],
        "no space": data.replace(b"= 'xxxxxxxx'", b"='xxxxxxxx' "),
        "no filling": data[: block + NOISY.nbytes],
        "more": data + b"some text",
    }


@pytest.mark.parametrize("name", untidy())
def test_intact_pixels_of_an_untidy_file_are_read(tmp_path, name):
    path = tmp_path / "a.fits"
    path.write_bytes(untidy()[name])
    np.testing.assert_array_equal(read_image(path).image, NOISY)


def test_a_pixel_less_is_a_cut_file(tmp_path):
    path = tmp_path / "a.fits"
    path.write_bytes(untidy()["no filling"][:-2])
    with pytest.raises(Refused, match=r"38400 bytes of pixels, but it is cut after 38398"):
        read_image(path)


@pytest.mark.parametrize(("kind", "zero"), [("u2", 2**15), ("u4", 2**31), ("i2", 0)])
def test_blank_pixels_are_nan_in_unsigned_images_too(tmp_path, kind, zero):
    """FITS 4.0, section 4.4.2.5: BLANK is the number in the file, before BZERO."""
    image = np.arange(600).reshape(20, 30).astype(kind)
    header = fits.PrimaryHDU(image).header
    if zero:
        header["BSCALE"], header["BZERO"] = 1, zero
    header["BLANK"] = 77 - zero
    raw = (image.astype("i8") - zero).astype(">" + kind.replace("u", "i")).tobytes()
    path = tmp_path / "blank.fits"
    path.write_bytes(header.tostring().encode() + raw + b"\0" * (-len(raw) % 2880))
    got = read_image(path).image
    np.testing.assert_array_equal(got, np.where(image == 77, np.nan, image.astype(float)))


def test_of_several_images_the_first_is_read_and_said(tmp_path):
    path = tmp_path / "several.fits"
    parts = [fits.ImageHDU(NOISY + n, name=name) for n, name in enumerate(("SCI", "ERR", "DQ"))]
    fits.HDUList([fits.PrimaryHDU(), *parts]).writeto(path)
    with pytest.warns(UserWarning, match=r"holds 3 images, 1 SCI, 2 ERR, 3 DQ; SCI is read"):
        np.testing.assert_array_equal(read_image(path).image, NOISY)


def test_of_equal_images_the_one_named_sci_is_read(tmp_path):
    path = tmp_path / "sci_behind.fits"
    parts = [fits.ImageHDU(NOISY + 9, name="ERR"), fits.ImageHDU(NOISY + 8), fits.ImageHDU(NOISY)]
    parts[2].name = "SCI"
    fits.HDUList([fits.PrimaryHDU(), *parts]).writeto(path)
    with pytest.warns(UserWarning, match=r"holds 3 images, 1 ERR, 2, 3 SCI; SCI is read"):
        np.testing.assert_array_equal(read_image(path).image, NOISY)


@pytest.mark.parametrize(("extension", "added"), [("CHIP1", 0), ("chip2", 1), ("2", 1), ("3", 2)])
def test_a_chip_of_a_mosaic_is_read_by_name_or_number(tmp_path, extension, added):
    path = tmp_path / "mosaic.fits"
    chips = [fits.ImageHDU(NOISY + n, name=name) for n, name in enumerate(("CHIP1", "CHIP2", ""))]
    fits.HDUList([fits.PrimaryHDU(), *chips]).writeto(path)
    image = read_image(path, Layout(extension=extension)).image
    np.testing.assert_array_equal(image, NOISY + added)


@pytest.mark.parametrize("extension", ["0", "4", "CHIP", "SCI"])
def test_a_unit_without_an_image_and_a_name_of_two_are_refused(tmp_path, extension):
    path = tmp_path / "mosaic.fits"
    chips = [fits.ImageHDU(NOISY, name="SCI", ver=n) for n in (1, 2)]
    fits.HDUList([fits.PrimaryHDU(), *chips]).writeto(path)
    with pytest.raises(Refused, match=r"number or name of one of its images, 1 SCI, 2 SCI, got"):
        read_image(path, Layout(extension=extension))


def test_colours_may_be_the_columns_of_a_cube(tmp_path):
    path = tmp_path / "colours_last.fits"
    fits.PrimaryHDU(np.stack([NOISY, NOISY + 5, NOISY - 5], axis=-1)).writeto(path)
    with pytest.warns(UserWarning, match="cube of 3 planes"):
        np.testing.assert_array_equal(read_image(path).image, NOISY + 5)


def test_infinite_pixels_have_no_value(tmp_path):
    path = tmp_path / "infinite.fits"
    image = NOISY.astype(np.float32)
    image[3, 4], image[5, 6] = np.inf, -np.inf
    fits.PrimaryHDU(image).writeto(path)
    got = read_image(path).image
    assert np.argwhere(np.isnan(got)).tolist() == [[3, 4], [5, 6]]
    assert np.isfinite(got).sum() == image.size - 2
