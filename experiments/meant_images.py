"""Images, star tables, lenses and PSFs written by other programs, compared with the written values.

TIFF by tifffile and Pillow, PNG and JPEG by Pillow, imagecodecs and OpenCV, FITS by astropy and
fitsio, tables by pandas, astropy and csv, lenses by optiland. The expected value is the value given
to the writer; for JPEG the value that Pillow reads.
"""

from __future__ import annotations

import csv
import importlib
import io
import itertools
import math
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import command
import numpy as np
from meant_check import Check, checked
from numpy.typing import NDArray

from startrack import read_image
from startrack.calibration import read_star_table
from startrack.catalog import read as read_catalog
from startrack.io import Layout
from startrack.optics import psfs_of_pages, read_prescription

Compare = Callable[[], str | None]
Case = tuple[str, str, Compare]
ROWS, COLUMNS = 48, 64
EVERY = 15  # a quick run has every fifteenth check
GAIN = 4.88  # electron / digital number, for images with noise


def checks(folder: Path, quick: bool) -> Iterator[Check]:
    """Write each variant into a folder and compare the values that startrack reads.

    quick  only every fifteenth check
    """
    made = itertools.chain(
        tiffs(folder),
        pictures(folder),
        fits_images(folder),
        gains(folder),
        tables(folder),
        () if command.missing("lenses", "optiland") else lenses(folder),
        pages(folder),
    )
    for number, (kind, name, compare) in enumerate(made):
        if not quick or number % EVERY == 0:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # warnings of writers are not wrong values
                yield checked(kind, name, compare)


def stars(kind: str, channels: int = 1) -> NDArray[Any]:
    """An image of a type, with different rows, columns and channels."""
    form = np.dtype(kind)
    rows, columns, band = np.indices((ROWS, COLUMNS, channels))
    image = (rows * 7 + columns * 3 + band * 11) % 200
    image[30, 40] = 251 - 10 * np.arange(channels)
    if form.kind == "f":
        return (image / 7 - 3).astype(form)
    if form.itemsize > 1:
        image = image * 211 + 5
        if form.kind == "i":
            image = image // 2 - 3000
    elif form.kind == "i":
        image = image // 2 - 60
    return image.astype(form)


def light(image: NDArray[Any]) -> NDArray[Any]:
    """One number per pixel: the largest of three colours."""
    return image.max(axis=2) if image.shape[2] >= 3 else image[..., 0]


def image_of(
    path: Path,
    write: Callable[[Path], Any],
    wanted: NDArray[Any],
    layout: Layout | None = None,
    tolerance: float = 0.0,
) -> Compare:
    """Difference between the read and the written image, in value and in type."""

    def compare() -> str | None:
        write(path)
        got = read_image(path, layout).image
        if got.shape != wanted.shape:
            return f"shape {got.shape}, not {wanted.shape}"
        one, other = got.astype(float), wanted.astype(float)
        if not np.array_equal(np.isfinite(one), np.isfinite(other)):
            return f"{np.isfinite(one).sum()} finite pixels, not {np.isfinite(other).sum()}"
        worst = float(np.nanmax(np.abs(one - other)))
        return None if worst <= tolerance else f"differs by {worst:g} in some pixel"

    return compare


def tiffs(folder: Path) -> Iterator[Case]:
    """Types, layouts, compressions, predictors, byte orders, BigTIFF, alpha, palettes, pages."""
    import tifffile

    number = itertools.count()

    def case(name: str, image: NDArray[Any], wanted: NDArray[Any], **options: Any) -> Case:
        path = folder / f"t{next(number)}.tif"
        layout = options.pop("layout", None)

        def write(path: Path) -> None:
            tifffile.imwrite(path, image, **options)

        return "TIFF", name, image_of(path, write, wanted, layout)

    for kind in ("u1", "u2", "u4", "i1", "i2", "i4", "f2", "f4", "f8"):
        for order in "<>":
            image = stars(kind)
            yield case(f"{kind} grey, order {order}", image[..., 0], image[..., 0], byteorder=order)
    for kind, planar in itertools.product(("u1", "u2", "f4"), ("contig", "separate")):
        image = stars(kind, 3)
        data = np.moveaxis(image, 2, 0) if planar == "separate" else image
        for tile, big in itertools.product((None, (16, 32)), (False, True)):
            yield case(
                f"{kind} RGB {planar}, tile {tile}, big {big}",
                data,
                light(image),
                photometric="rgb",
                planarconfig=planar,
                tile=tile,
                bigtiff=big,
            )
    for squeeze, kind in itertools.product(
        ("lzw", "zlib", "packbits", "lzma", "zstd"), ("u1", "u2", "f4")
    ):
        for predictor in (False, True):
            if squeeze == "packbits" and predictor:
                continue
            for channels in (1, 3):
                image = stars(kind, channels)
                yield case(
                    f"{kind} {squeeze}, predictor {predictor}, {channels} channels",
                    image if channels == 3 else image[..., 0],
                    light(image),
                    compression=squeeze,
                    predictor=predictor,
                    rowsperstrip=7,
                    photometric="rgb" if channels == 3 else "minisblack",
                )
    for kind, planar in itertools.product(("u1", "u2"), ("contig", "separate")):
        image = stars(kind, 4)
        data = np.moveaxis(image, 2, 0) if planar == "separate" else image
        yield case(
            f"{kind} RGB with alpha {planar}",
            data,
            light(image[..., :3]),
            photometric="rgb",
            planarconfig=planar,
            extrasamples=["unassalpha"],
        )
    for kind, extra in itertools.product(("u1", "u2"), ("unassalpha", "assocalpha")):
        image = stars(kind, 2)
        yield case(
            f"{kind} grey with {extra}",
            image,
            image[..., 0],
            photometric="minisblack",
            planarconfig="contig",
            extrasamples=[extra],
        )
    for kind in ("u1", "u2"):
        image = stars(kind)[..., 0]
        yield case(
            f"{kind} white is zero", np.iinfo(kind).max - image, image, photometric="miniswhite"
        )
    for planes in (2, 3, 5):
        image = np.moveaxis(stars("u2", planes), 2, 0)
        yield case(
            f"u2 {planes} bands without a name",
            image,
            light(np.moveaxis(image, 0, 2)),
            photometric="minisblack",
            planarconfig="separate",
        )
    image = stars("u1")[..., 0]
    colours = (np.arange(256)[None] * np.array([[257], [100], [20]])).astype("u2")
    yield case("palette", image, image, photometric="palette", colormap=colours)
    bits = image % 2
    yield case("one bit", bits.astype(bool), bits, photometric="minisblack")
    yield case("CMYK", stars("u1", 4), light(stars("u1", 4)), photometric="separated")
    for n in range(1, 9):
        wanted = _seen(image, n)
        yield case(f"orientation {n}", image, wanted, extratags=[(274, "H", 1, n, True)])
    stack = np.stack([stars("u2")[..., 0] + n for n in range(3)])
    yield case("three pages, the first", stack, stack[0], photometric="minisblack")
    for n in range(3):
        yield case(
            f"three pages, plane {n}",
            stack,
            stack[n],
            photometric="minisblack",
            layout=Layout(plane=n),
        )
    yield case("ImageJ", stack[0], stack[0], imagej=True)
    yield case("OME", stack[0], stack[0], ome=True)
    yield (
        "TIFF",
        "a small copy before the image",
        image_of(folder / "thumb.tif", _with_thumbnail, stars("u2")[..., 0]),
    )
    yield "TIFF", "cut in its pixels", _must_refuse(folder / "cut.tif", stars("u2")[..., 0])
    for name, mode, options in (
        ("Pillow LZW", "L", {"compression": "tiff_lzw"}),
        ("Pillow deflate", "L", {"compression": "tiff_adobe_deflate"}),
        ("Pillow group 4", "1", {"compression": "group4"}),
        ("Pillow RGB", "RGB", {}),
        ("Pillow RGBA", "RGBA", {}),
        ("Pillow 16 bits", "I;16", {}),
        ("Pillow float", "F", {}),
        ("Pillow JPEG", "L", {"compression": "jpeg", "quality": 100}),
    ):
        yield _pillow_tiff(folder / f"p{next(number)}.tif", name, mode, options)


def _seen(image: NDArray[Any], orientation: int) -> NDArray[Any]:
    """The image in the orientation of Pillow."""
    from PIL import Image, ImageOps

    picture = Image.fromarray(image)
    picture.getexif()[274] = orientation
    return np.asarray(ImageOps.exif_transpose(picture))


def _with_thumbnail(path: Path) -> None:
    import tifffile

    image = stars("u2")[..., 0]
    with tifffile.TiffWriter(path) as file:
        file.write(image[::4, ::4], subfiletype=1)
        file.write(image)


def _must_refuse(path: Path, image: NDArray[Any]) -> Compare:
    import tifffile

    def compare() -> str | None:
        tifffile.imwrite(path, image, compression="zlib", rowsperstrip=8)
        path.write_bytes(path.read_bytes()[:-200])
        read_image(path)
        return "read as if it were whole"

    return compare


def _pillow_tiff(path: Path, name: str, mode: str, options: dict[str, Any]) -> Case:
    from PIL import Image

    kinds = {"I;16": "u2", "F": "f4"}
    channels = {"RGB": 3, "RGBA": 4}.get(mode, 1)
    image = stars(kinds.get(mode, "u1"), channels)
    picture = Image.fromarray(image if channels > 1 else image[..., 0])
    picture = picture.convert("1") if mode == "1" else picture
    wanted = np.asarray(picture).astype("u1") if mode == "1" else light(image[..., :3])
    tolerance = 3.0 if "JPEG" in name else 0.0

    def write(path: Path) -> None:
        picture.save(path, **options)

    return "TIFF", name, image_of(path, write, wanted, None, tolerance)


def pictures(folder: Path) -> Iterator[Case]:
    """PNG of 1 to 16 bits with and without alpha, JPEG of all kinds, and invalid formats."""
    import cv2
    import imagecodecs
    from PIL import Image

    number = itertools.count()
    for kind, channels in itertools.product(("u1", "u2"), (1, 2, 3, 4)):
        image = stars(kind, channels)
        wanted = image[..., 0] if channels < 3 else light(image[..., :3])
        data = image if channels > 1 else image[..., 0]
        for level in (1, 9):

            def write(path: Path, data: NDArray[Any] = data, level: int = level) -> None:
                path.write_bytes(imagecodecs.png_encode(data, level=level))

            yield (
                "PNG",
                f"{kind} {channels} channels, level {level}",
                image_of(folder / f"n{next(number)}.png", write, wanted),
            )
    grey = stars("u1")[..., 0]
    for mode in ("1", "L", "LA", "P", "RGB", "RGBA"):
        picture = Image.fromarray(grey).convert(mode)
        colour = np.asarray(picture.convert("RGB")).max(axis=2)

        def save(path: Path, picture: Any = picture) -> None:
            picture.save(path)

        yield "PNG", f"Pillow {mode}", image_of(folder / f"n{next(number)}.png", save, colour)
    deep = stars("u2", 3)

    def by_opencv(path: Path) -> None:
        cv2.imwrite(str(path), deep[..., ::-1])

    yield "PNG", "OpenCV 16 bits RGB", image_of(folder / "cv.png", by_opencv, light(deep))
    for suffix, n in itertools.product(("png", "jpg"), range(1, 9)):
        tags = Image.Exif()
        tags[274] = n

        def turned(path: Path, tags: Any = tags) -> None:
            Image.fromarray(grey).save(path, exif=tags, quality=100)

        yield (
            suffix.upper(),
            f"orientation {n}",
            image_of(folder / f"o{n}.{suffix}", turned, _seen(grey, n), None, 3.0),
        )
    smooth = np.clip(np.add.outer(np.arange(ROWS), np.arange(COLUMNS)), 0, 255).astype("u1")
    for mode, options in itertools.product(
        ("L", "RGB", "CMYK"),
        ({"quality": 95}, {"quality": 95, "progressive": True}, {"quality": 95, "subsampling": 0}),
    ):
        picture = Image.fromarray(smooth).convert(mode)
        wanted = np.asarray(picture.convert("RGB")).max(axis=2)

        def save_jpeg(path: Path, picture: Any = picture, options: Any = options) -> None:
            picture.save(path, **options)

        yield (
            "JPEG",
            f"{mode} {options}",
            image_of(folder / f"j{next(number)}.jpg", save_jpeg, wanted, None, 4.0),
        )
    for suffix in ("png", "jpg"):
        path = folder / f"half.{suffix}"

        def cut(path: Path = path) -> str | None:
            Image.fromarray(stars("u1", 3)).save(path)
            data = path.read_bytes()
            path.write_bytes(data[: len(data) // 2])
            read_image(path)
            return "read as if it were whole"

        yield suffix.upper(), "cut in half", cut
    for suffix in ("pgm", "bmp", "gif", "webp", "tga", "jp2", "ppm"):

        def other(path: Path) -> None:
            Image.fromarray(grey).save(path)

        yield "other", suffix, image_of(folder / f"x.{suffix}", other, grey)


def fits_images(folder: Path) -> Iterator[Case]:
    """All types by astropy and fitsio, scaling, BLANK, compression, extensions, cubes, headers."""
    from astropy.io import fits

    fitsio: Any = None
    if not command.missing("FITS by fitsio", "fitsio"):
        fitsio = importlib.import_module("fitsio")

    number = itertools.count()

    def case(name: str, write: Callable[[Path], Any], wanted: NDArray[Any], **more: Any) -> Case:
        path = folder / f"f{next(number)}.fits{more.pop('end', '')}"
        return "FITS", name, image_of(path, write, wanted, **more)

    for kind in ("u1", "i2", "u2", "i4", "u4", "i8", "f4", "f8"):
        image = stars(kind)[..., 0]
        yield case(f"{kind} astropy", lambda path, image=image: fits.writeto(path, image), image)
        if fitsio:
            yield case(
                f"{kind} fitsio", lambda path, image=image: fitsio.write(str(path), image), image
            )
        yield case(
            f"{kind} in an extension",
            lambda path, image=image: fits.HDUList(
                [fits.PrimaryHDU(), fits.ImageHDU(image)]
            ).writeto(path),
            image,
        )
    for kind, squeeze in itertools.product(
        ("u1", "i2", "u2", "i4"), ("RICE_1", "GZIP_1", "GZIP_2", "PLIO_1", "HCOMPRESS_1")
    ):
        if (kind, squeeze) == ("u2", "PLIO_1"):
            continue  # not in the standard
        image = stars(kind)[..., 0]
        if squeeze == "PLIO_1":
            image = np.abs(image) % 128
        yield case(
            f"{kind} {squeeze} astropy",
            lambda path, image=image, squeeze=squeeze: fits.HDUList(
                [fits.PrimaryHDU(), fits.CompImageHDU(image, compression_type=squeeze)]
            ).writeto(path),
            image,
        )
    for squeeze in ("rice", "gzip", "gzip_2") if fitsio else ():
        image = stars("i2")[..., 0]
        yield case(
            f"i2 {squeeze} fitsio",
            lambda path, image=image, squeeze=squeeze: fitsio.write(
                str(path), image, compress=squeeze
            ),
            image,
        )
    image = stars("f4")[..., 0]
    yield case(
        "f4 gzip without loss",
        lambda path: fits.HDUList(
            [
                fits.PrimaryHDU(),
                fits.CompImageHDU(image, compression_type="GZIP_2", quantize_level=0),
            ]
        ).writeto(path),
        image,
    )
    yield case("gzipped file", lambda path: fits.writeto(path, image), image, end=".gz")
    numbers = stars("i2")[..., 0]
    for scale, zero in ((0.5, 100.0), (-1.0, 20.0), (1.0, 32768.0), (3.0, 0.0)):

        def scaled(path: Path, scale: float = scale, zero: float = zero) -> None:
            unit = fits.PrimaryHDU(numbers)
            unit.header["BSCALE"], unit.header["BZERO"] = scale, zero
            with path.open("wb") as file:
                file.write(unit.header.tostring().encode("ascii"))
                raw = numbers.astype(">i2").tobytes()
                file.write(raw + b"\0" * (-len(raw) % 2880))

        yield case(f"BSCALE {scale}, BZERO {zero}", scaled, numbers * scale + zero)
    for kind, blank in itertools.product(("i2", "u2", "i4", "u4"), (True, False)):
        image = stars(kind)[..., 0]
        zero = {"u2": 2**15, "u4": 2**31}.get(kind, 0)
        value = int(image[5, 6])
        wanted = np.where(image == value, np.nan, image.astype(float)) if blank else image

        def blanked(
            path: Path,
            image: Any = image,
            card: Any = value - zero if blank else None,
            kind: str = kind,
            zero: float = zero,
        ) -> None:
            header = fits.PrimaryHDU(image).header
            if zero:
                header["BSCALE"], header["BZERO"] = 1, zero
            if card is not None:
                header["BLANK"] = card
            raw = (image.astype("i8") - zero).astype(">" + kind.replace("u", "i")).tobytes()
            text = header.tostring().encode("ascii")
            path.write_bytes(text + raw + b"\0" * (-len(raw) % 2880))

        yield case(f"{kind}, BLANK {blank}", blanked, wanted)
    cube = np.stack([stars("u2")[..., 0] + n for n in range(3)])
    yield case("cube, its largest", lambda path: fits.writeto(path, cube), cube.max(axis=0))
    for n in range(3):
        yield case(
            f"cube, plane {n}",
            lambda path: fits.writeto(path, cube),
            cube[n],
            layout=Layout(plane=n),
        )
    yield case("cube of one plane", lambda path: fits.writeto(path, cube[:1]), cube[0])
    yield case("four axes", lambda path: fits.writeto(path, cube[None]), cube.max(axis=0))
    yield case(
        "three images",
        lambda path: fits.HDUList(
            [
                fits.PrimaryHDU(),
                fits.ImageHDU(cube[0], name="SCI"),
                fits.ImageHDU(cube[1], name="ERR"),
                fits.ImageHDU(cube[2], name="DQ"),
            ]
        ).writeto(path),
        cube[0],
    )
    image = stars("u2")[..., 0]
    plain = io.BytesIO()
    unit = fits.PrimaryHDU(image)
    unit.header["OBJECT"] = "xxxxxxxx"
    unit.writeto(plain)
    data = plain.getvalue()
    end = data.index(b"END" + b" " * 77) + 80
    padded = data[:end] + b"\0" * (2880 - end % 2880) + data[2880 * math.ceil(end / 2880) :]
    pixels = 2880 * math.ceil(end / 2880) + image.nbytes
    for name, changed in {
        "letters beyond ASCII": data.replace(b"xxxxxxxx", b"caf\xe9xxxx"),
        "letters of UTF-8": data.replace(b"xxxxxxxx", "Mü\u03b3xxx".encode()),
        "zeros after the header": padded,
        "no space before a value": data.replace(b"= 'xxxxxxxx'", b"='xxxxxxxx' "),
        "no filling at the end": data[:pixels],
        "more after the end": data + b"\0" * 2880,
        "text after the end": data + b"some text",
    }.items():
        yield case(name, lambda path, changed=changed: path.write_bytes(changed), image)
    for name, changed in {
        "a row less": data[: pixels - 128],
        "a header alone": data[:2880],
    }.items():
        yield "FITS", name, _fits_refused(folder / f"f{next(number)}.fits", changed)


def _fits_refused(path: Path, data: bytes) -> Compare:
    def compare() -> str | None:
        path.write_bytes(data)
        read_image(path)
        return "read as if it were whole"

    return compare


def gains(folder: Path) -> Iterator[Case]:
    """Gain, exposure and offset by the cards of several programs, in images with photon noise."""
    from astropy.io import fits

    random = np.random.default_rng(63)
    electrons = random.poisson(1000 * GAIN, (200, 200)) + random.normal(0, 6, (200, 200))
    image = np.clip(np.round(electrons / GAIN), 0, 65535).astype("u2")
    zwo, sharp = {"INSTRUME": "ZWO ASI178MM"}, {"SWCREATE": "SharpCap"}
    unknown = math.nan
    said = "[electron/DN]"
    for name, cards, wanted in (
        ("GAIN with its unit", {"GAIN": (GAIN, said)}, GAIN),
        ("GAIN in e-/ADU", {"GAIN": (GAIN, "gain in e-/ADU")}, GAIN),
        ("EGAIN of MaxIm", {"EGAIN": (GAIN, "electronic gain in photoelectrons per ADU")}, GAIN),
        ("GAIN alone, as measured", {"GAIN": GAIN}, GAIN),
        ("ZWO at 0 with EGAIN", {**zwo, "GAIN": 0, "EGAIN": GAIN}, GAIN),
        ("ZWO at 300 with EGAIN", {**zwo, "GAIN": 300, "EGAIN": GAIN}, GAIN),
        ("ZWO at 0", {**zwo, "GAIN": 0}, unknown),
        ("ZWO at 300", {**zwo, "GAIN": 300}, unknown),
        ("ZWO at 5", {**zwo, "GAIN": 5}, unknown),
        ("SharpCap at 300", {**sharp, "GAIN": 300}, unknown),
        ("a setting of 0", {"GAIN": 0}, unknown),
        ("a setting of 300", {"GAIN": 300}, unknown),
        ("a setting of 120", {"GAIN": (120, "Sensor gain")}, unknown),
        ("EGAIN of another mode", {"EGAIN": 0.1}, unknown),
        ("EGAIN of zero", {"EGAIN": 0.0, "GAIN": 139}, unknown),
        ("a negative gain", {"GAIN": -1.0}, unknown),
        ("a gain in words", {"GAIN": "high"}, unknown),
    ):

        def compare(
            cards: dict[str, Any] = cards, wanted: float = wanted, name: str = name
        ) -> str | None:
            unit = fits.PrimaryHDU(image)
            for key, value in cards.items():
                unit.header[key] = value
            path = folder / f"gain {name.replace('/', ' ')}.fits"
            unit.writeto(path)
            got = read_image(path).electrons_per_dn
            same = math.isnan(got) if math.isnan(wanted) else math.isclose(got, wanted)
            return None if same else f"{got:g} e-/DN, not {wanted:g}"

        yield "FITS gain", name, compare
    for name, cards, wanted in (
        ("EXPTIME", {"EXPTIME": 0.25}, 0.25),
        ("EXPOSURE", {"EXPOSURE": 0.25}, 0.25),
        ("EXPTIME in ms", {"EXPTIME": (250.0, "[ms] exposure")}, 0.25),
        ("EXPOSURE in ms", {"EXPOSURE": (250, "exposure in milliseconds")}, 0.25),
        ("both, equal", {"EXPTIME": 0.25, "EXPOSURE": 0.25}, 0.25),
        ("both, different", {"EXPTIME": 0.25, "EXPOSURE": 2.0}, unknown),
        ("neither", {}, unknown),
    ):

        def exposed(
            cards: dict[str, Any] = cards, wanted: float = wanted, name: str = name
        ) -> str | None:
            unit = fits.PrimaryHDU(image)
            for key, value in cards.items():
                unit.header[key] = value
            path = folder / f"exposure {name}.fits"
            unit.writeto(path)
            got = read_image(path).exposure
            same = math.isnan(got) if math.isnan(wanted) else math.isclose(got, wanted)
            return None if same else f"{got:g} s, not {wanted:g} s"

        yield "FITS exposure", name, exposed


def tables(folder: Path) -> Iterator[Case]:
    """Star tables of any locale, with right ascensions in degree, hours, or minutes and seconds."""
    import pandas
    from astropy import units
    from astropy.coordinates import Angle
    from astropy.table import Table

    random = np.random.default_rng(12)
    ra, dec = random.uniform(2, 12, 40), random.uniform(-7, 7, 40)
    x, y = 600 + 3000 * np.tan(np.radians(ra - 7)), 500 + 3000 * np.tan(np.radians(dec))
    frame = pandas.DataFrame({"ra": ra, "dec": dec, "x": x, "y": y})
    vector = np.column_stack(
        [
            np.cos(np.radians(dec)) * np.cos(np.radians(ra)),
            np.cos(np.radians(dec)) * np.sin(np.radians(ra)),
            np.sin(np.radians(dec)),
        ]
    )

    def case(name: str, write: Callable[[Path], Any], end: str = "csv") -> Case:
        path = folder / f"stars {name.replace('/', ' ')}.{end}"

        def compare() -> str | None:
            write(path)
            table = read_star_table(path)
            if len(table) != len(ra):
                return f"{len(table)} stars, not {len(ra)}"
            worst = float(np.abs(table.direction - vector).max())
            off = float(np.abs(table.pixel - np.column_stack([x, y])).max())
            return None if worst < 1e-7 and off < 1e-3 else f"{worst:g} radian, {off:g} pixel off"

        return "star table", name, compare

    def as_csv(**options: Any) -> Callable[[Path], Any]:
        data = options.pop("data", frame)
        return lambda path: data.to_csv(path, index=False, **options)

    for sep, decimal, encoding in itertools.product(
        (",", ";", "\t"), (".", ","), ("utf-8", "utf-8-sig", "utf-16", "utf-16-le")
    ):
        name = f"{sep!r} {decimal} {encoding}".replace("\t", "tab").replace("\\t", "tab")
        yield case(f"pandas {name}", as_csv(sep=sep, decimal=decimal, encoding=encoding))
    for end in ("\r\n", "\r"):
        yield case(f"lines end with {end!r}", as_csv(lineterminator=end))
    yield case("quoted numbers", as_csv(quoting=csv.QUOTE_ALL))
    yield case(
        "sep= of a spreadsheet",
        lambda path: path.write_text("sep=;\r\n" + frame.to_csv(index=False, sep=";", decimal=",")),
    )
    yield case("gzipped", as_csv(compression="gzip"), "csv.gz")
    named = frame.assign(name="a star, of two words")
    yield case("names with commas", as_csv(data=named))
    yield case("names with commas, semicolons", as_csv(data=named, sep=";", decimal=","))
    hours = frame.assign(ra=ra / 15)
    yield case("hours without a unit", as_csv(data=hours))
    yield case("hours by name", as_csv(data=hours.rename(columns={"ra": "ra_hours"})))
    yield case("hours by short name", as_csv(data=hours.rename(columns={"ra": "ra_h"})))
    yield case("degrees by name", as_csv(data=frame.rename(columns={"ra": "ra_deg"})))
    radian = frame.assign(ra=np.radians(ra), dec=np.radians(dec))
    yield case(
        "radian by name", as_csv(data=radian.rename(columns={"ra": "ra_rad", "dec": "dec_rad"}))
    )
    for separator in (":", " ", "fromunit"):
        angles = {
            "ra": Angle(ra, "deg").to_string(unit="hourangle", sep=separator, precision=5),
            "dec": Angle(dec, "deg").to_string(sep=separator, precision=5, alwayssign=True),
        }
        yield case(f"sexagesimal {separator!r}", as_csv(data=frame.assign(**angles)))
    degree = {
        "ra_deg": Angle(ra, "deg").to_string(sep=":", precision=5),
        "dec_deg": Angle(dec, "deg").to_string(sep=":", precision=5),
    }
    yield case(
        "sexagesimal in degree", as_csv(data=frame.drop(columns=["ra", "dec"]).assign(**degree))
    )
    for unit, end in itertools.product(("deg", "rad", "hourangle"), ("ecsv", "fits", "vot")):
        if (unit, end) == ("hourangle", "fits"):
            continue  # not a FITS unit

        def write(path: Path, unit: str = unit) -> None:
            table = Table({"x": x, "y": y, "dec": dec * units.deg, "ra": ra * units.deg})
            table["ra"] = (ra * units.deg).to(unit)
            if path.suffix == ".vot":
                table.write(path, format="votable")
            else:
                table.write(path)

        yield case(f"{end} in {unit}", write, end)
    many = np.random.default_rng(5)
    place = pandas.DataFrame(
        {
            "RAJ": many.uniform(0, 360, 200),
            "DEJ": many.uniform(-80, 80, 200),
            "G": many.uniform(3, 8, 200),
        }
    )

    def catalogue(name: str, write: Callable[[Path], Any], end: str = "csv") -> Case:
        path = folder / f"catalogue {name}.{end}"

        def compare() -> str | None:
            write(path)
            columns = "ra=RAJ", "dec=DEJ", "magnitude_g=G", "epoch=2016.0"
            stars = read_catalog(path, columns=columns)
            turn = np.abs(np.angle(np.exp(1j * (stars.right_ascension - np.radians(place["RAJ"])))))
            worst = float(np.max(turn))
            return None if worst < 1e-7 else f"right ascension {worst:g} radian off"

        return "catalogue", name, compare

    yield catalogue("degrees", lambda path: place.to_csv(path, index=False))
    yield catalogue("mark", lambda path: place.to_csv(path, index=False, encoding="utf-8-sig"))
    yield catalogue(
        "semicolons and commas", lambda path: place.to_csv(path, index=False, sep=";", decimal=",")
    )
    in_hours = place.assign(RAJ=place["RAJ"] / 15)
    yield catalogue("hours without a unit", lambda path: in_hours.to_csv(path, index=False))
    for unit, end in (("rad", "fits"), ("deg", "fits"), ("hourangle", "ecsv"), ("rad", "ecsv")):

        def write_units(path: Path, unit: str = unit) -> None:
            table = Table.from_pandas(place)
            table["RAJ"] = (place["RAJ"].to_numpy() * units.deg).to(unit)
            table.write(path)

        yield catalogue(f"{unit} in {end}", write_units, end)


NODES = (
    ("N-BK7", "schott", 1.5168),
    ("S-BSL7", "ohara", 1.51633),
    ("H-K9L", "cdgm", 1.5168),
    ("K8", "lzos", 1.5163),
    ("F2", "schott", 1.62004),
    ("TF3", "lzos", 1.7174),
    ("TF3", "cdgm", 1.61242),
    ("F_SILICA", "misc", 1.45846),
    ("CAF2", "misc", 1.43384),
    ("E-FD2", "hoya", 1.64769),
)
LENGTHS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}
ENCODINGS = ("utf-16", "utf-16-le", "utf-8", "utf-8-sig", "latin-1")


def lenses(folder: Path) -> Iterator[Case]:
    """One lens in all units, encodings and locales; glasses by maker; files that must be refused.

    The focal length of two spheres follows from the formula of a thick lens; indices at 587.6 nm
    are published by the makers.
    """
    number = itertools.count()

    def zemax(glass: str, maker: str, unit: float = 1.0, name: str = "MM", more: str = "") -> str:
        lines = [
            "VERS 140124 258 36214",
            "MODE SEQ",
            "NAME single",
            f"UNIT {name} X W X CM MR CPMM",
            f"ENPD {25 / unit!r}",
            *([f"GCAT {maker.upper()}"] if maker else []),
            "FTYP 0 0 1 1 0 0 0",
            "XFLN 0",
            "YFLN 0",
            "WAVM 1 0.587562 1",
            "PWAV 1",
            "SURF 0",
            "  TYPE STANDARD",
            "  CURV 0.0",
            "  DISZ INFINITY",
            "SURF 1",
            "  STOP",
            "  TYPE STANDARD",
            f"  CURV {unit / 60!r}",
            f"  DISZ {6 / unit!r}",
            f"  GLAS {glass}",
            *([more] if more else []),
            "SURF 2",
            "  TYPE STANDARD",
            f"  CURV {-unit / 80!r}",
            f"  DISZ {60 / unit!r}",
            "SURF 3",
            "  TYPE STANDARD",
            "  CURV 0.0",
            "  DISZ 0",
        ]
        return "\n".join(lines) + "\n"

    def code_v(glass: str, unit: float = 1.0, letter: str = "M", rdm: str = "RDM;LEN") -> str:
        first, second = 60 / unit, -80 / unit
        if rdm == "RDM NO":
            first, second = 1 / first, 1 / second
        return (
            f"{rdm}\nTITLE 'a; single ! lens'\nEPD {25 / unit!r}\nDIM {letter}\nWL 587.6\nXAN 0.0\n"
            f"YAN 0.0\nSO 0.0 1.0E+10\nS {first!r} {6 / unit!r} {glass}\n  STO\n"
            f"S {second!r} {60 / unit!r}\nSI 0.0 0.0\nGO\n"
        )

    def case(name: str, text: str, index: float, end: str = "zmx", coding: str = "utf-8") -> Case:
        path = folder / f"l{next(number)}.{end}"
        power = (index - 1) * (1 / 60 + 1 / 80 - (index - 1) * 6 / (index * 60 * 80))

        def compare() -> str | None:
            path.write_bytes(text.encode(coding))
            lens = read_prescription(path)
            focal = float(np.squeeze(lens.paraxial.f2()))
            pupil = float(np.squeeze(lens.paraxial.EPD()))
            if abs(focal * power - 1) < 2e-4 and abs(pupil / 25 - 1) < 1e-5:
                return None
            return f"{focal:.4f} mm and a pupil of {pupil:.4f} mm, not {1 / power:.4f} and 25"

        return ("Zemax" if end == "zmx" else "CODE V"), name, compare

    filler = " 0 0 1.5 40 0 0 0 0 0 0"
    for (unit, length), coding in itertools.product(LENGTHS.items(), ENCODINGS):
        text = zemax("N-BK7" + filler, "schott", length, unit)
        yield case(f"{unit} in {coding}", text, 1.5168, coding=coding)
    comma = zemax("N-BK7" + filler, "schott").replace(".", ",")
    yield case("decimal commas", comma, 1.5168)
    for glass, maker, index in NODES:
        yield case(f"{glass} of {maker}", zemax(glass + filler, maker), index)
    yield case("two makers", zemax("TF3" + filler, "lzos cdgm"), 1.7174)
    yield case("model glass", zemax("___BLANK 1 0 1.6 50 0 0 0 0 0 0", "schott"), 1.6)
    yield case("model by another name", zemax("MODEL 1 0 1.6 50", "schott"), 1.6)
    yield case("six digits", zemax("600500" + filler, "schott"), 1.6)
    nothing = math.nan  # must be refused: no focal length is right
    for glass, maker in (
        ("MYGLASS", "schott"),
        ("N-BK77", "schott"),
        ("K8", "schott"),
        ("BK", "schott"),
        ("F2", ""),
        ("N-BK7", "madeup"),
        ("S-BSL7", "schott"),
        ("1234567", "schott"),
    ):
        yield case(f"no {glass} of {maker or 'anybody'}", zemax(glass + filler, maker), nothing)
    yield case("unit that is none", zemax("N-BK7" + filler, "schott", 1.0, "FURLONG"), nothing)
    square = zemax("N-BK7" + filler, "schott", more="  SQAP 5 5")
    yield case("a square aperture", square, nothing)
    for (letter, length), glass in itertools.product(
        {"M": 1.0, "C": 10.0, "I": 25.4}.items(), ("NBK7_SCHOTT", "N-BK7_SCHOTT")
    ):
        yield case(f"{letter} {glass}", code_v(glass, length, letter), 1.5168, "seq")
    for glass, index in (
        ("1.6:50", 1.6),
        ("516800.641700", 1.5168),
        ("517642", 1.517),
        ("NLAK12_SCHOTT", 1.6779),
        ("SBSL7_OHARA", 1.51633),
        ("HK9L_CDGM", 1.5168),
        ("K8_LZOS", 1.5163),
    ):
        yield case(f"glass {glass}", code_v(glass), index, "seq")
    yield case("curvatures", code_v("NBK7_SCHOTT", rdm="RDM NO"), 1.5168, "seq")
    private = "PRV\nPWL 587.6\n'MINE' 1.6\nEND\nWL 587.6"
    for name, text in {
        "no maker's": code_v("MYGLASS"),
        "two makers'": code_v("F2"),
        "private": code_v("MINE").replace("WL 587.6", private),
        "no word on radii": code_v("NBK7_SCHOTT", rdm="LEN"),
        "a cylinder": code_v("NBK7_SCHOTT").replace("  STO\n", "  STO\n  CYL\n"),
        "an obstruction": code_v("NBK7_SCHOTT").replace("  STO\n", "  STO\n  CIR OBS 3\n"),
        "a tilt": code_v("NBK7_SCHOTT").replace("  STO\n", "  STO\n  ADE 3.0\n"),
    }.items():
        yield case(name, text, nothing, "seq")
    yield from _saved_lenses(folder)


def _saved_lenses(folder: Path) -> Iterator[Case]:
    """A lens of optiland, saved by optiland."""
    from optiland.fileio import save_codev_file, save_optiland_file, save_zemax_file
    from optiland.materials import Material
    from optiland.optic import Optic

    for suffix, save in (
        ("zmx", save_zemax_file),
        ("seq", save_codev_file),
        ("json", save_optiland_file),
    ):

        def compare(suffix: str = suffix, save: Any = save) -> str | None:
            lens = Optic()
            lens.surfaces.add(index=0, thickness=math.inf)
            lens.surfaces.add(
                index=1,
                radius=60.0,
                thickness=6.0,
                is_stop=True,
                material=Material("N-LAK12", catalog="schott"),
            )
            lens.surfaces.add(index=2, radius=-80.0, thickness=50.0)
            lens.surfaces.add(index=3)
            lens.set_aperture(aperture_type="EPD", value=20.0)
            lens.fields.set_type(field_type="angle")
            lens.fields.add(y=0.0)
            lens.wavelengths.add(value=0.6, is_primary=True)
            path = folder / f"saved.{suffix}"
            save(lens, str(path))
            got, wanted = (
                float(np.squeeze(one.paraxial.f2())) for one in (read_prescription(path), lens)
            )
            return None if abs(got / wanted - 1) < 1e-6 else f"{got:.5f} mm, not {wanted:.5f} mm"

        yield "lens", f"saved as {suffix}", compare


def pages(folder: Path) -> Iterator[Case]:
    """Huygens PSFs of OpticStudio's text: encodings, locales, fields and ranges of wavelengths."""
    side = 16
    axis = np.arange(side) - side // 2
    spot = np.exp(-(axis[None] ** 2 + 2 * (axis[:, None] - 1) ** 2) / 20)
    number = itertools.count()

    def text(wave: str, field: str, micro: str = "\u00b5m", spacing: str = "0.500") -> str:
        rows = "\n".join("\t".join(f"{value:.6E}" for value in row) for row in spot[::-1])
        return (
            "Listing of Huygens PSF Data\n\nFile : C:\\lens.zmx\nTitle: \nDate : 1/1/2026\n\n\n"
            f"Polychromatic Huygens PSF\n{wave} {micro} at {field} (deg).\nData spacing is "
            f"{spacing} {micro}.\nData area is 8.000 by 8.000 {micro}.\nStrehl ratio: 0.9\n"
            f"Pupil grid size: 32 by 32\nImage grid size: {side} by {side}\nCenter point is: "
            f"{side - side // 2}, {side // 2 + 1}\nCenter coordinates: 0.00000000E+00, "
            f"0.00000000E+00 Millimeters\n\nValues are relative intensity.\n\n{rows}\n"
        )

    def case(name: str, content: str, coding: str, wave: float) -> Case:
        path = folder / f"h{next(number)}.txt"

        def compare() -> str | None:
            path.write_bytes(content.encode(coding))
            file = psfs_of_pages([path], "a page")
            if abs(file.spacing / 0.5e-6 - 1) > 1e-9 or abs(file.wavelength[0] / wave - 1) > 1e-9:
                return f"spacing {file.spacing:g} m, wavelength {file.wavelength[0]:g} m"
            got = file.image[0, 0]
            half = len(got) // 2
            middle = side // 2
            cut = slice(middle - half, middle + half + 1)
            # x of the file's images is along the field, which is y of the page.
            wanted = spot[cut, cut].T
            worst = float(np.abs(got - wanted).max())
            return None if worst < 1e-6 else f"differs by {worst:g} of the peak"

        return "Huygens PSF", name, compare

    for coding, european in itertools.product(
        ("utf-16", "utf-16-le", "utf-16-be", "utf-8", "utf-8-sig", "latin-1"), (False, True)
    ):
        for wave, field, middle in (
            ("0.5500", "0.0000, 0.0000", 0.55e-6),
            ("0.5500", "0.0000", 0.55e-6),
            ("0.4500 to 0.6500", "0.0000, 0.0000", 0.55e-6),
        ):
            content = text(wave, field)
            if european:
                content = content.replace(".", ",")
            yield case(f"{wave} at {field}, {coding}, european {european}", content, coding, middle)
    for name, content in {
        "a field of millimetres": text("0.55", "0.0, 0.0").replace("(deg)", "(mm)"),
        "spacing in millimetre": text("0.55", "0.0, 0.0").replace("0.500 \u00b5m", "0.500 mm"),
        "a wavelength in nanometre": text("550.0", "0.0, 0.0", "nm"),
        "rows that are cut": text("0.55", "0.0, 0.0")[:-900],
    }.items():
        yield case(name, content, "utf-8", math.nan)
