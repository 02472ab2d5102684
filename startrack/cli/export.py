"""`startrack export`: a design as data and code for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from startrack.cli.imports import deferred
from startrack.cli.options import Exit, add_design, add_out, add_part, as_wrong_use

with deferred():
    from startrack.cli.terminal import example, finite, print_result, read_design
    from startrack.core import arcsec, deg
    from startrack.mission import head_model, write_model


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the parts of `startrack export`."""
    parts = parser.add_subparsers(dest="part", required=True, metavar="PART")
    aocs = add_part(
        parts,
        "aocs",
        "write the error of a design as JSON and C, for simulators of attitude control",
        "Writes startrack_head.json, and startrack_head.c, .h and _data.h, C99 that needs its libm "
        "alone: errors over time with their noise, errors over the pixel and the field, bias and "
        "thermo-elastic swing; availability over the slew rate and the angles to Sun, Moon and "
        "Earth; latency; the convention of the quaternion.",
    )
    add_design(aocs)
    add_out(aocs, "startrack-export")


def command(options: argparse.Namespace) -> int:
    """Write the files, and print what the model holds at rest."""
    path = options.design or example()
    case = read_design(path, options.set).case
    with as_wrong_use():
        model = head_model(case, Path(path).stem)
    files = write_model(options.out, model)
    result = {"design": str(path), **finite(model.table), "files": [str(one) for one in files]}
    text = [f"wrote {', '.join(one.name for one in files)} to {options.out}"]
    for name in ("noise", "pixel", "field"):
        across, about = (one[0] / arcsec for one in getattr(model, name))
        text.append(f"{name:8s}{across:10.3f} across, {about:.3f} about (arcsec rms, at rest)")
    text.append(
        f"period {model.period:.4g} s, latency {model.latency:.4g} s, rates up to "
        f"{model.rate[-1] / deg:.3g} deg/s; Sun {model.sun / deg:.1f}, "
        f"Moon {model.moon / deg:.1f}, lit limb {model.limb / deg:.1f} deg"
    )
    print_result(options, result, "\n".join(text))
    return Exit.DONE
