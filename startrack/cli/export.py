"""`startrack export`: a design as data and code for other programs."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from startrack.cli import options as shared
from startrack.cli.options import Exit, Option, Options, decimal, out, positive, wanted, whole

if wanted(__name__):
    from startrack import mission, onboard
    from startrack.cli.terminal import example, finite, print_result, progress, read_design, stage
    from startrack.core import YEAR, arcsec, deg

if TYPE_CHECKING:
    from startrack.design import Case
    from startrack.mission import HeadModel


declare = shared.Parts(
    "",
    aocs=(
        "write the error of a design as JSON and C, for simulators of attitude control",
        Options(
            "Writes startrack_head.json, and startrack_head.c, .h and _data.h, in C99 that needs "
            "libm alone. Contents: errors over time with their noise, errors over the pixel and "
            "the field, bias and thermo-elastic swing; availability over the slew rate and the "
            "angles to Sun, Moon and Earth; latency; the convention of the quaternion.",
            *shared.DESIGN,
            Option(
                "--unit RANK",
                "unit whose error is exported: the median unit; the unit whose error 95 %% of "
                "the units do not exceed; the worst unit; or the unit as designed, without "
                "differences between units (default: 95, at the end of life)",
                ("middle", "95", "worst", "designed"),
                "95",
            ),
            Option(
                "--units N", "number of drawn units for the choice of the unit", whole(1, 10000), 20
            ),
            Option(
                "--age YEARS", "age of the unit (default: the end of its life)", decimal(0, 100)
            ),
            shared.SEED,
            Option(
                "--also FORM",
                "fmu: startrack_head.fmu (FMI 2.0, co-simulation), with a library "
                "for this platform where there is a C compiler; basilisk: startrack_basilisk.py, "
                "for its starTracker module; 42: startrack_42.txt, the block of a spacecraft file",
                ("fmu", "basilisk", "42"),
                [],
                many="+",
            ),
            Option(
                "--rate DEG/S",
                "slew rate of the errors for basilisk and 42 (default: the design's)",
                decimal(0, 360),
            ),
            out("startrack-export"),
        ),
    ),
    catalogue=(
        "write the guide stars of a design and their triangles, for its flight software",
        Options(
            "Writes startrack_guide.bin (layout: docs/onboard.md), the same bytes as "
            "startrack_guide_data.h, the stars as startrack_guide.csv, and a reader in C99, "
            "startrack_guide.c and .h. The reader finds the star nearest to a direction, the "
            "stars in a cone, the triangles similar to a given triangle, and the stars of a list "
            "of directions at an unknown attitude. Directions are barycentric, in ICRS. Equal "
            "arguments give equal files.",
            *shared.DESIGN,
            Option(
                "--limit MAG",
                "magnitude of the faintest star in the band of the instrument, in which sunlike "
                "stars have their G magnitude (default: limit_g of the tracker's catalogue)",
                decimal(-2, 21),
            ),
            Option(
                "--epoch YEAR",
                "Julian year of the stars' directions, such as 2031.5 (default: epoch of the "
                "tracker's catalogue)",
                decimal(),
            ),
            Option(
                "--resolution ARCSEC",
                "stars closer than this are merged at their centre of light (default: as the "
                "design's identification, 1/512 of the field)",
                positive,
            ),
            Option(
                "--doubles",
                "double stars within the resolution: mark them with a flag, or leave them out "
                "(default: mark)",
                ("mark", "omit"),
                "mark",
            ),
            Option(
                "--variables",
                "variable stars of the list: mark them with a flag, or leave them "
                "out (default: mark)",
                ("mark", "omit"),
                "mark",
            ),
            Option(
                "--variable-list FILE",
                "CSV with ra, dec (degree, J2000) of variable stars "
                "(default: 197 of the General Catalogue of Variable Stars that vary by a magnitude "
                "or more)",
                Path,
            ),
            Option(
                "--per-field N",
                "guide stars per field: a star is left out if the circle of a field's area "
                "around it has N brighter stars",
                whole(3, 40),
                16,
            ),
            Option(
                "--pattern-stars N",
                "number of brightest stars of each circle within a field that form triangles "
                "(default: 6); more stars make a larger index, which identifies skies with more "
                "false spots",
                whole(3, 12),
                6,
            ),
            out("startrack-export"),
        ),
    ),
)


def command(options: argparse.Namespace) -> int:
    """Write the files and print their contents."""
    path = options.design or example()
    case = read_design(path, options.set).case
    part = _aocs if options.part == "aocs" else _catalogue
    result, text = part(options, case, Path(path).stem)
    print_result(options, {"design": str(path), **result}, text)
    return Exit.DONE


def _aocs(options: argparse.Namespace, case: Case, name: str) -> tuple[dict[str, Any], str]:
    age = None if options.age is None else options.age * YEAR
    choice = mission.UnitChoice(options.unit, options.units, options.seed, age)
    units = options.units if case.differs and options.unit != "designed" else 0
    with shared.as_wrong_use(), progress("units and rates", units + len(mission.SMEARS)) as step:
        model = mission.head_model(case, name, choice, step)
    files = mission.write_model(options.out, model)
    also, notes = _also(options, case, model)
    files += also
    text = [_wrote(options, files), *notes, model.unit]
    for name, error in model.at_rest.items():
        across, about = (part / arcsec for part in error)
        row = f"{name:8s}{across:10.3f} across, {about:.3f} about"
        if name in model.begin:
            across, about = (part / arcsec for part in model.begin[name])
            row += f"; on the first day {across:.3f}, {about:.3f}"
        text.append(f"{row} (arcsec rms, at rest)")
    text.append(
        f"period {model.period:.4g} s, latency {model.latency:.4g} s, rates up to "
        f"{model.rate[-1] / deg:.3g} deg/s; Sun {model.sun / deg:.1f}, "
        f"Moon {model.moon / deg:.1f}, lit limb {model.limb / deg:.1f} deg"
    )
    text += model.left_out
    return {**finite(model.table), "files": [str(file) for file in files]}, "\n".join(text)


def _also(
    options: argparse.Namespace, case: Case, model: HeadModel
) -> tuple[list[Path], list[str]]:
    """Write the formats of --also. Returns the files, and notes on them."""
    rate = case.instrument.motion.rate if options.rate is None else options.rate * deg
    files, notes = list[Path](), list[str]()
    if rate > model.rate[-1]:
        raise shared.WrongUse(
            f"--rate must be at most {model.rate[-1] / deg:.3g} deg/s, the largest rate "
            f"with an attitude, got {rate / deg:.3g}"
        )
    if "fmu" in options.also:
        files.append(options.out / "startrack_head.fmu")
        with shared.as_wrong_use(ValueError):
            if not mission.write_fmu(files[-1], model):
                notes.append("no C compiler was found: the FMU has sources alone")
    if "basilisk" in options.also:
        files.append(options.out / "startrack_basilisk.py")
        mission.write_basilisk(files[-1], model, rate)
    if "42" in options.also:
        files.append(options.out / "startrack_42.txt")
        camera = case.instrument.camera
        across, down = (
            2 * math.atan(n / 2 / camera.focal_length_px) for n in (camera.columns, camera.rows)
        )
        mission.write_42(files[-1], model, (across, down), rate)
    return files, notes


def _catalogue(options: argparse.Namespace, case: Case, name: str) -> tuple[dict[str, Any], str]:
    with shared.as_wrong_use(ValueError, FileNotFoundError):
        settings = onboard.GuideSettings(
            options.limit,
            options.epoch,
            options.resolution and options.resolution * arcsec,
            options.doubles,
            options.variables,
            options.per_field,
            options.pattern_stars,
        )
        with stage("guide stars"):
            variables = onboard.read_variables(options.variable_list)
            guide = onboard.guide_stars(case, settings, variables)
    files = onboard.write_guide(options.out, guide)
    size = files[0].stat().st_size
    values = {
        "stars": len(guide),
        "triangles": len(guide.triangle),
        "bytes": size,
        "limit_mag": guide.limit,
        "epoch": guide.epoch,
        "field_deg": guide.field_of_view / deg,
        "resolution_arcsec": guide.resolution / arcsec,
        "doubles": int((guide.flags & onboard.DOUBLE > 0).sum()),
        "variables": int((guide.flags & onboard.VARIABLE > 0).sum()),
        "files": [str(file) for file in files],
    }
    text = (
        f"{_wrote(options, files)}\n{values['stars']} guide stars to {guide.limit:g} mag in the "
        f"band of the instrument, {values['triangles']} triangles, {size / 1000:.1f} kB\n"
        f"field {values['field_deg']:.2f} deg, stars merged within "
        f"{values['resolution_arcsec']:.1f} arcsec: {values['doubles']}; variable: "
        f"{values['variables']}; epoch {guide.epoch:g}"
    )
    return values, text


def _wrote(options: argparse.Namespace, files: list[Path]) -> str:
    return f"wrote {', '.join(file.name for file in files)} to {options.out}"
