"""TIFF, PNG and JPEG of other programs, against the written numbers and against Pillow."""

import io
import struct
import zlib

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageOps

from startrack.core import Refused
from startrack.io.images import read_image
from startrack.io.recordings import Layout

ROWS, COLUMNS = 33, 50


def image_of(kind: str, channels: int) -> np.ndarray:
    """Rows, columns and channels all differ; a star in row 20, column 30."""
    rows, columns, band = np.indices((ROWS, COLUMNS, channels))
    image = (7 * rows + 3 * columns + 11 * band) % 100
    image[20, 30] = 120 - band[20, 30]
    return (image * (1 if kind == "u1" else 500)).astype(kind)


@pytest.mark.parametrize("kind", ["u1", "u2", "f4"])
@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"tile": (16, 16)},
        {"compression": "zlib", "predictor": True},
        {"compression": "lzw", "rowsperstrip": 5},
        {"byteorder": ">", "bigtiff": True},
    ],
)
def test_three_channels_of_any_layout_are_those_written(tmp_path, kind, planar, layout):
    image = image_of(kind, 3)
    data = np.moveaxis(image, 2, 0) if planar == "separate" else image
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, data, photometric="rgb", planarconfig=planar, **layout)
    got = read_image(path).image
    assert got.dtype == image.dtype
    np.testing.assert_array_equal(got, image.max(axis=2))


def test_alpha_is_no_light_and_takes_no_bits(tmp_path):
    image = image_of("u2", 2)
    image[..., 1] = 65535
    path = tmp_path / "alpha.tif"
    tifffile.imwrite(
        path, image, photometric="minisblack", planarconfig="contig", extrasamples=["unassalpha"]
    )
    np.testing.assert_array_equal(read_image(path).image, image[..., 0])
    png = tmp_path / "alpha.png"
    png.write_bytes(imagecodecs.png_encode(image))
    np.testing.assert_array_equal(read_image(png).image, image[..., 0])


def test_sixteen_bits_of_colour_stay_sixteen_bits_in_png(tmp_path):
    image = image_of("u2", 3)
    path = tmp_path / "colour.png"
    path.write_bytes(imagecodecs.png_encode(image))
    got = read_image(path).image
    assert got.dtype == np.uint16
    np.testing.assert_array_equal(got, image.max(axis=2))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(Refused, match="whole PNG"):
        read_image(path)


def test_where_zero_is_white_a_star_is_bright(tmp_path):
    image = image_of("u2", 1)[..., 0]
    path = tmp_path / "white.tif"
    tifffile.imwrite(path, 65535 - image, photometric="miniswhite")
    np.testing.assert_array_equal(read_image(path).image, image)


def test_a_palette_gives_its_colours(tmp_path):
    numbers = image_of("u1", 1)[..., 0]
    path = tmp_path / "palette.tif"
    colours = (np.arange(256)[::-1] * np.array([[257], [2], [1]])).astype("u2")
    tifffile.imwrite(path, numbers, photometric="palette", colormap=colours)
    np.testing.assert_array_equal(read_image(path).image, 255 - numbers)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("end", ["tif", "png"])
def test_an_image_is_turned_as_pillow_turns_it(tmp_path, orientation, end):
    picture = Image.fromarray(image_of("u1", 1)[..., 0])
    path = tmp_path / f"turned.{end}"
    tags = picture.getexif()
    tags[274] = orientation
    if end == "tif":
        tag = (274, "H", 1, orientation, True)
        tifffile.imwrite(path, np.asarray(picture), extratags=[tag])
    else:
        picture.save(path, exif=tags)
    wanted = np.asarray(ImageOps.exif_transpose(picture))
    np.testing.assert_array_equal(read_image(path).image, wanted)


def test_of_several_pages_one_is_read_and_said(tmp_path):
    stack = np.stack([image_of("u2", 1)[..., 0] + n for n in range(3)])
    path = tmp_path / "pages.tif"
    tifffile.imwrite(path, stack, photometric="minisblack")
    with pytest.warns(UserWarning, match="holds 3 images; the first is read"):
        np.testing.assert_array_equal(read_image(path).image, stack[0])
    np.testing.assert_array_equal(read_image(path, Layout(plane=2)).image, stack[2])
    with pytest.raises(Refused, match=r"plane must lie in \[0, 2\], got 3"):
        read_image(path, Layout(plane=3))


@pytest.mark.parametrize(
    ("options", "channels", "words"),
    [
        ({"photometric": "separated"}, 4, "grey, RGB or a palette, got SEPARATED"),
        ({"photometric": "minisblack", "planarconfig": "contig"}, 2, "say what its samples are"),
    ],
)
def test_samples_that_are_no_light_are_refused(tmp_path, options, channels, words):
    path = tmp_path / "other.tif"
    tifffile.imwrite(path, image_of("u1", channels), **options)
    with pytest.raises(Refused, match=words):
        read_image(path)


def test_a_cut_tiff_is_refused_where_tifffile_fills_with_zeros(tmp_path):
    path = tmp_path / "cut.tif"
    tifffile.imwrite(path, image_of("u2", 1)[..., 0], compression="zlib", rowsperstrip=8)
    data = path.read_bytes()
    for size in (len(data) - 100, 6):
        path.write_bytes(data[:size])
        with pytest.raises(Refused, match="must be a whole TIFF image, but it is cut"):
            read_image(path)


@pytest.mark.parametrize("channels", [1, 3])
def test_without_the_decoders_plain_layouts_are_read_and_others_name_them(
    tmp_path, channels, monkeypatch
):
    image = image_of("u2", channels)
    image = image if channels == 3 else image[..., 0]
    path = tmp_path / "lzw.tif"
    kind = "rgb" if channels == 3 else "minisblack"
    tifffile.imwrite(path, image, compression="lzw", photometric=kind)
    monkeypatch.setattr("startrack.io.tiff.find_spec", lambda name: None)
    wanted = image.max(axis=2) if channels == 3 else image
    np.testing.assert_array_equal(read_image(path).image, wanted)
    tifffile.imwrite(path, image.astype("f4"), compression="lzw", photometric=kind)
    with pytest.raises(Refused, match=r"imagecodecs must be installed.*startrack\[tiff\]"):
        read_image(path)


def test_a_jpeg_that_is_cut_is_refused(tmp_path):
    file = io.BytesIO()
    Image.fromarray(image_of("u1", 3)).save(file, "JPEG")
    path = tmp_path / "cut.jpg"
    path.write_bytes(file.getvalue()[: len(file.getvalue()) // 2])
    with pytest.raises(Refused, match="whole PNG, JPEG or BMP image"):
        read_image(path)


def of_one_strip(strip: bytes, compression: int, circle: bool = False) -> bytes:
    """A TIFF of 10 x 10 bytes; with `circle`, its only page is followed by itself."""
    tags = [(256, 10), (257, 10), (258, 8), (259, compression), (262, 1), (273, 8), (277, 1)]
    tags += [(278, 10), (279, len(strip))]
    place = 8 + len(strip)
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    start = b"II*\0" + struct.pack("<I", place) + strip + struct.pack("<H", len(tags))
    return start + entries + struct.pack("<I", place if circle else 0)


def test_pages_in_a_circle_are_refused(tmp_path):
    path = tmp_path / "circle.tif"
    path.write_bytes(of_one_strip(bytes(100), 1, circle=True))
    with pytest.raises(Refused, match="none of them twice"):
        read_image(path)


@pytest.mark.parametrize("codecs", [True, False])
def test_a_strip_that_unpacks_to_more_than_the_image_takes_no_memory(tmp_path, codecs, monkeypatch):
    """50 MB of zeros in a strip of a hundred bytes."""
    path = tmp_path / "bomb.tif"
    path.write_bytes(of_one_strip(zlib.compress(bytes(50_000_000), 9), 8))
    words = "whole TIFF image"
    if not codecs:
        monkeypatch.setattr("startrack.io.tiff.find_spec", lambda name: None)
        monkeypatch.setenv("STARTRACK_MEMORY", str(2**29))
        path.write_bytes(of_one_strip(np.random.default_rng(1).bytes(600_000), 8))
        words = "limit of 0.5 GiB"
    with pytest.raises(Refused, match=words):
        read_image(path)
