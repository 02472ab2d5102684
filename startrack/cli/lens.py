"""`startrack lens`: tables of lenses from prescriptions, and images of points for designs."""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import Exit, Option, Options, WrongUse, images, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack import optics
    from startrack.cli.terminal import image_reader, print_result, progress
    from startrack.core import ZERO_CELSIUS, deg, nm, um
    from startrack.detection import Detection, detect, plan_detection
    from startrack.io import aligned

LENS = """\
A lens table has the wavefront, the place of the chief ray, the pupil and the vignetting of a lens
over field, wavelength and temperature. A design names it: lens_file = "my-lens.fits" under
[instrument.optics].

  startrack lens import my-lens.zmx --field 12   trace a prescription (extra `lens`)
  startrack lens import huygens-*.txt            PSFs that Zemax saved as text
  startrack lens measure night-*.fits            PSF from images of stars
  startrack lens show my-lens.fits               contents of a table
  startrack lens show double_gauss               a shipped table

Without a known prescription, images of a point replace the table: psf_file = "psf.fits".
"""

IMPORT = """\
A prescription is traced to a lens table (lens_file) and needs optiland: pip install
'startrack[lens]'. Wavefront maps also become a lens table, with terms to Noll 37 and a round pupil.
Huygens PSFs and FITS become a file of PSFs (psf_file); catalogs/psfs/README.md describes it.
"""


declare = shared.Parts(
    LENS,
    import_=(
        "trace a prescription, or take exported PSFs",
        Options(
            IMPORT,
            Option(
                "files FILE",
                "prescription: Zemax .zmx, CODE V .seq, or optiland .json; or "
                "Huygens PSFs or wavefront maps saved by Zemax as .txt, one for each wavelength "
                "and field; or PSFs .fits",
                Path,
                many="+",
            ),
            Option(
                "--field DEG",
                "for a prescription, required: largest angle from the axis, to the corner of the "
                "detector, degree",
                float,
            ),
            Option("--focal-length MM", "for wavefront maps, required: mm", float),
            Option("--f-number N", "for wavefront maps, required", float),
            Option(
                "--flip",
                "sign of wavefront maps: positive where the path is shorter (default: longer)",
            ),
            Option(
                "--fields N",
                "number of field angles from the axis to the largest",
                whole(2, 200),
                9,
            ),
            Option(
                "--band NM NM",
                "shortest and longest wavelength, nm (default: 400 1000)",
                float,
                (400.0, 1000.0),
            ),
            Option(
                "--wavelengths N", "wavelengths in the band, denser in the blue", whole(1, 200), 7
            ),
            Option(
                "--temperatures DEGC",
                "temperatures of the lens, degC (default: 20)",
                float,
                [20.0],
                many="+",
            ),
            Option("--terms N", "largest Noll index of the wavefront", whole(4, 231), 66),
            Option("--vacuum", "trace the lens in vacuum, not in air"),
            Option(
                "--check", "also trace between the nodes, and print the error of the interpolation"
            ),
            Option("--name TEXT", "name of the lens (default: that of the file)", dest="title"),
            Option("--source TEXT", "source of its numbers (default: name of the file)"),
            Option(
                "--out FILE",
                "lens table to write (default: name of the first file with .fits)",
                Path,
            ),
        ),
    ),
    measure=(
        "reconstruct an oversampled PSF from images of stars",
        Options(
            "Takes the brightest isolated, unsaturated stars of all images, and writes their "
            "common PSF as FITS, for psf_file of a design: fractions of a star's light in "
            "pixels, with OVERSAMP samples per pixel.",
            *images(),
            Option("--half PIXEL", "half side of the box around a star, pixel", whole(3, 50), 7),
            Option("--oversampling N", "samples per pixel", whole(2, 8), 4),
            Option("--stars N", "largest number of stars", whole(8, 5000), 300),
            Option(
                "--saturation FRACTION",
                "fraction of an image's largest number; a star with this number or more is left "
                "out",
                float,
                0.9,
            ),
            Option("--out FILE", "file to write (default: psf.fits)", Path, Path("psf.fits")),
        ),
    ),
    show=(
        "print the contents of a lens table",
        Options("", Option("table TABLE", "lens table, or name of a shipped table")),
    ),
)


def command(options: argparse.Namespace) -> int:
    """Trace a prescription, or print a table."""
    if options.part == "show":
        with shared.as_wrong_use(ValueError, OSError):
            opened = _opened(options.table)
        if isinstance(opened, optics.PsfFile):
            print_result(options, result := images_summary(opened), _images_text(result))
        else:
            print_result(options, result := summary(opened), _text(result))
        return Exit.DONE
    return _measure(options) if options.part == "measure" else _import(options)


def _opened(name: str) -> optics.LensTable | optics.PsfFile:
    """The lens table or the file of PSFs of a path or of a shipped name."""
    with suppress(ValueError):
        file = Path(name)
        return optics.load_psf_file(file) if file.suffix else optics.open_psf_file(name)
    return optics.load_lens(optics.lens_path(name))


def _measure(options: argparse.Namespace) -> int:
    if not 0 < options.saturation <= 1:
        raise WrongUse(f"--saturation must lie in (0, 1], got {options.saturation:g}")
    stars, read = [], image_reader(options)
    with (
        progress("reading", len(options.images)) as advance,
        shared.as_wrong_use(ValueError, OSError),
    ):
        for path in options.images:
            frame = read(path)
            spots = detect(frame, plan_detection(Detection()))
            stars.append(optics.lone_stars(frame.image, spots, options.half, options.saturation))
            advance(1)
    with shared.as_wrong_use(ValueError):
        measured = optics.reconstruct(optics.brightest(stars, options.stars), options.oversampling)
    optics.save_psf_file(
        options.out, optics.file_of(measured, ", ".join(path.name for path in options.images))
    )
    table, step = measured.psf.table, measured.psf.oversampling
    result = {
        "stars": len(measured.x),
        "oversampling": step,
        "peak": float(table.max()),
        "width_px": math.sqrt(float((table > table.max() / 2).sum()) * 4 / math.pi) / step,
        "residual": measured.residual,
        "psf": str(options.out),
    }
    text = (
        f"{result['stars']} stars: half of the peak over {result['width_px']:.2f} pixel, "
        f"{result['peak']:.3f} of the light in the brightest pixel, residual "
        f"{100 * measured.residual:.2g} % of the peak rms\nwrote {options.out}, which a design "
        f'takes as psf_file = "{options.out}"'
    )
    print_result(options, result, text)
    return Exit.DONE


def _import(options: argparse.Namespace) -> int:
    kinds, path = {path.suffix.lower() for path in options.files}, options.files[0]
    if kinds <= {".txt"}:
        return _import_pages(options)
    if len(options.files) > 1:
        raise WrongUse("FILE must be one prescription, one .fits, or pages .txt of Zemax")
    if not kinds <= {".fits", ".fit"}:
        return _trace(options)
    with shared.as_wrong_use(ValueError, OSError):  # errors of checks and of writing with checksums
        psfs = optics.load_psf_file(path)
    if options.source:
        psfs = replace(psfs, source=options.source)
    return _save_images(options, psfs, Path(options.out or f"{path.stem}-psf.fits"))


def _import_pages(options: argparse.Namespace) -> int:
    """Write the lens table of wavefront maps, or the PSFs of pages."""
    paths = options.files
    out = Path(options.out or paths[0].with_suffix(".fits").name)
    source = options.source or f"Zemax, {', '.join(path.name for path in paths)}"
    with shared.as_wrong_use(ValueError, OSError):
        if not optics.holds_wavefronts(paths):
            return _save_images(options, optics.psfs_of_pages(paths, source), out)
        if options.focal_length is None or options.f_number is None:
            raise WrongUse("--focal-length and --f-number must be given with wavefront maps")
        table, rest = optics.table_of_pages(
            paths,
            options.focal_length * 1e-3,
            options.f_number,
            options.title or out.stem,
            source,
            options.flip,
        )
    optics.save_lens(out, table)
    left = {"terms_leave_waves": float(rest.max())}
    result = summary(table) | {"table": str(out)} | left
    print_result(options, result, _text(result))
    return Exit.DONE


def _save_images(options: argparse.Namespace, psfs: optics.PsfFile, out: Path) -> int:
    optics.save_psf_file(out, psfs)
    result = images_summary(psfs) | {"psf": str(out)}
    text = f'{_images_text(result)}\nwrote {out}, for a design: psf_file = "{out}"'
    print_result(options, result, text)
    return Exit.DONE


def _trace(options: argparse.Namespace) -> int:
    if options.field is None:
        raise WrongUse("--field must be given with a prescription")
    path, tracing = options.files[0], _tracing(options)
    out = options.out or path.with_suffix(".fits").name
    with shared.as_wrong_use(ValueError):
        lens = optics.read_prescription(path)
    # The tracer prints on standard output that it has no extinction data for a glass.
    with warnings.catch_warnings(), redirect_stdout(sys.stderr):
        # Numba warns about variables of the tracer's functions; they compile nevertheless.
        warnings.filterwarnings("ignore", r"variable '.*' is not in scope")
        with (
            progress("tracing", _nodes(tracing)) as advance,
            shared.as_wrong_use(ValueError, path=path),
        ):
            table, rest = optics.trace_lens(
                lens, options.title or path.stem, options.source or path.name, tracing, advance
            )
        optics.save_lens(Path(out), table)
        with suppress(ValueError):  # for surfaces other than spheres
            surfaces = optics.surfaces_of(lens)
            optics.save_surfaces(Path(out), surfaces)
            if not surfaces.mirror.any():
                optics.save_ghosts(Path(out), surfaces)
        left = float((rest / table.wavelength[:, None]).max())
        result = summary(table) | {"table": str(out), "terms_leave_waves": left}
        result |= _understood(path)
        if options.check:
            between = _between(tracing)
            with progress("checking", _nodes(between)) as advance:
                dense = optics.trace_lens(lens, "between", "", between, advance)[0]
            result |= optics.interpolation_error(table, dense)
    print_result(options, result, _text(result))
    return Exit.DONE


def _understood(path: Path) -> dict[str, Any]:
    """Unit of length, glasses and ignored contents of a prescription, for the output."""
    if path.suffix.lower() == ".json":
        return {}
    prescription = optics.parse_prescription(path)
    glasses = [
        f"{glass.name} ({glass.maker})" if glass.maker else f"model {glass.name}"
        for glass in prescription.glasses.values()
    ]
    return {"unit": prescription.unit, "glasses": glasses, "notes": list(prescription.notes)}


def _tracing(options: argparse.Namespace) -> optics.Tracing:
    first, last = sorted(options.band)
    if not (first >= 100 and last <= 20_000):
        raise WrongUse(f"--band must lie in [100, 20000] nm, got {first:g} to {last:g}")
    if not 0 < options.field < 80:
        raise WrongUse(f"--field must lie between 0 and 80 degree, got {options.field:g}")
    for celsius in options.temperatures:
        if not -200 < celsius < 300:
            raise WrongUse(f"--temperatures must lie between -200 and 300 degC, got {celsius:g}")
    # The dispersion of glass is about inverse square; steps of inverse wavelength keep some nodes
    # in the red.
    wavelength = 1 / np.linspace(1 / last, 1 / first, options.wavelengths)[::-1] * nm
    if options.wavelengths == 1:
        wavelength = np.array([(first + last) / 2 * nm])
    return optics.Tracing(
        tuple(sorted({celsius + ZERO_CELSIUS for celsius in options.temperatures})),
        tuple(wavelength.tolist()),
        tuple((np.linspace(0, options.field, options.fields) * deg).tolist()),
        options.terms,
        options.vacuum,
    )


def _nodes(tracing: optics.Tracing) -> int:
    return len(tracing.temperature) * len(tracing.wavelength) * len(tracing.field)


def _between(tracing: optics.Tracing) -> optics.Tracing:
    """Midpoints between the nodes; all temperatures."""
    fields, waves = np.array(tracing.field), np.array(tracing.wavelength)
    middle = (waves[1:] + waves[:-1]) / 2 if len(waves) > 1 else waves
    angles = 0.0, *((fields[1:] + fields[:-1]) / 2).tolist()
    return replace(tracing, wavelength=tuple(middle.tolist()), field=angles)


def summary(table: optics.LensTable) -> dict[str, Any]:
    """Summary of a table over the field, at the middle wavelength and temperature."""
    t, w = len(table.temperature) // 2, len(table.wavelength) // 2
    shape = ~np.isin(table.noll, (1, 2, 3))
    wavefront = np.sqrt((table.wavefront[t, w][:, shape] ** 2).sum(axis=-1))
    ideal = table.focal_length * np.tan(table.field)
    with np.errstate(invalid="ignore"):
        distortion = np.where(ideal > 0, table.place[t, w] / np.where(ideal > 0, ideal, 1) - 1, 0)
    return {
        "name": table.name,
        "source": table.source,
        "focal_length_mm": table.focal_length * 1e3,
        "f_number": table.f_number,
        "temperature_degc": (table.temperature - ZERO_CELSIUS).tolist(),
        "wavelength_nm": (table.wavelength / nm).tolist(),
        "terms": int(table.noll.max()),
        "field_deg": (table.field / deg).tolist(),
        "place_mm": (table.place[t, w] * 1e3).tolist(),
        "distortion_percent": (100 * distortion).tolist(),
        "lateral_colour_um": (np.ptp(table.place[t], axis=0) / um).tolist(),
        "wavefront_rms_waves": (wavefront / table.wavelength[w]).tolist(),
        "illumination": (table.area[t, w] / table.area[t, w, 0]).tolist(),
    }


def images_summary(psfs: optics.PsfFile) -> dict[str, Any]:
    """Summary of a file of PSFs; widths in metre, or in pixel where their size is unknown."""
    unit = 1.0 if psfs.pixel and psfs.pitch is None else um
    size = psfs.spacing / unit
    half = psfs.image / psfs.image.max(axis=(2, 3), keepdims=True) > 0.5
    width = np.sqrt(half.sum(axis=(2, 3)) * 4 / math.pi) * size
    return {
        "source": psfs.source,
        "unit": "pixel" if unit == 1.0 else "um",
        "spacing": size,
        "samples": psfs.image.shape[-1],
        "pixel_included": psfs.pixel,
        "energy": psfs.energy,
        "wavelength_nm": (psfs.wavelength / nm).tolist() if psfs.varies else [],
        "field_deg": (psfs.angle / deg).tolist(),
        "width": width.tolist(),
    }


def _images_text(result: dict[str, Any]) -> str:
    unit, waves = result["unit"], result["wavelength_nm"]
    pixel = "the pixel included" if result["pixel_included"] else "without a pixel"
    rows = [["field deg", f"width at half the peak, {unit}"]]
    for angle, *widths in zip(result["field_deg"], *result["width"], strict=True):
        rows.append([f"{angle:.3f}", "  ".join(f"{width:.3g}" for width in widths)])
    lines = [
        f"PSFs from {result['source']}",
        f"samples       {result['samples']} a side, {result['spacing']:.4g} {unit} apart, {pixel}",
        f"energy        {100 * result['energy']:.4g} % of the light",
        f"wavelengths   {', '.join(f'{wave:.0f}' for wave in waves)} nm" if waves else "",
    ]
    return "\n".join([*filter(None, lines), *aligned(rows, (1,))])


def _text(result: dict[str, Any]) -> str:
    waves, degrees = result["wavelength_nm"], result["temperature_degc"]
    columns = {
        "field deg": ("field_deg", ".3f"),
        "place mm": ("place_mm", ".4f"),
        "distortion %": ("distortion_percent", ".3f"),
        "lateral colour um": ("lateral_colour_um", ".2f"),
        "wavefront waves rms": ("wavefront_rms_waves", ".3f"),
        "illumination": ("illumination", ".4f"),
    }
    cells = [[format(value, form) for value in result[key]] for key, form in columns.values()]
    lines = [
        f"{result['name']}: {result['focal_length_mm']:.3f} mm, f/{result['f_number']:.3g} "
        f"({result['source']})",
        f"wavelengths   {', '.join(f'{wave:.0f}' for wave in waves)} nm",
        f"temperatures  {', '.join(f'{degree:.4g}' for degree in degrees)} degC",
        f"At {waves[len(waves) // 2]:.0f} nm and {degrees[len(degrees) // 2]:.4g} degC; lateral "
        "colour over all wavelengths; wavefront without tilt:",
        *aligned([list(columns), *map(list, zip(*cells, strict=True))], ()),
    ]
    if "terms_leave_waves" in result:
        lines.append(
            f"terms to Noll {result['terms']} fit the traced wavefront to "
            f"{result['terms_leave_waves']:.2g} waves rms"
        )
    if "interpolation_rms_waves" in result:
        lines.append(
            "between the nodes the largest errors of the table are "
            f"{result['interpolation_rms_waves']:.2g} "
            f"waves rms, {result['interpolation_place_um']:.2g} um in place, "
            f"{result['interpolation_area']:.2g} in area"
        )
    if "glasses" in result:
        converted = "" if result["unit"] == "mm" else ", converted to mm"
        lines.append(f"lengths of the prescription in {result['unit']}{converted}")
        lines.append(f"glasses by maker: {', '.join(result['glasses']) or 'none'}")
        lines += [f"of {result['source']}: {note}" for note in result["notes"]]
    if "table" in result:
        lines.append(f"wrote {result['table']}")
    return "\n".join(lines)
