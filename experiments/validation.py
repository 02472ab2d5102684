"""Predictions for flown or published trackers, compared with published values.

Each line has the known values of the tracker, the assumptions (marked in the design files in
catalogs/trackers), the prediction, and the published value. The predictions include noise, pixels,
centroids and neighbouring stars. Calibration and thermo-elastic errors are in the published
figures, but not in the designs, so that a prediction is the error after their calibration.

    python experiments/validation.py [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import one_thread  # noqa: F401  # isort: skip
import command
import numpy as np
from markley_mortari import SCENARIOS, scenario

from startrack import Case, arcsec, deg, load_design, shipped
from startrack.budget import analytic, boresights
from startrack.catalog import Selection, Sky, earth_observer, open_sky, v_from_g
from startrack.core import LIGHT_SPEED, Floats
from startrack.metrics import attitude_bound
from startrack.response import errors

PLACES = 20_000  # number of circles over the sky
CHANDRA = np.arange(7.0, 9.6, 0.5)  # magnitudes of guide stars
ORBIT = 7610.0  # m/s, a circular orbit 500 km up


def line(
    name: str, quantity: str, predicted: float, published: float, known: str, assumed: str
) -> dict[str, Any]:
    return {
        "name": name,
        "quantity": quantity,
        "predicted": float(predicted),
        "published": float(published),
        "ratio": float(predicted / published),
        "known": known,
        "assumed": assumed,
    }


def tracker(name: str) -> Case:
    return load_design(shipped(f"trackers/{name}.toml")).case


def scenarios() -> list[dict[str, Any]]:
    """Markley and Mortari (2000): theory, compared with 5000 trials."""
    theory = {
        "1": ((39.557, 2.686, 2.686), 3.5),
        "2": ((33565.2, 1.0, 1.0), 1.5),
        "3": ((3356.5, 1216.5, 1211.9), 67.4),
    }
    rows = []
    for name in SCENARIOS:
        run = scenario(name)
        (boresight, x, y), loss = theory[name]
        told = zip("xyz", run["rms_arcsec"], (boresight, x, y), strict=True)
        rows += [
            line(
                "Markley-Mortari " + name,
                f"rms about {axis}, arcsec",
                got,
                said,
                "vectors, noise, weights",
                "none",
            )
            for axis, got, said in told
        ]
        rows.append(
            line(
                "Markley-Mortari " + name,
                "mean loss",
                run["loss"],
                loss,
                "vectors, noise, weights",
                "none",
            )
        )
    return rows


def trackers() -> list[dict[str, Any]]:
    """Published trackers, by analytic budgets."""
    rows = []
    st5000 = analytic(tracker("st5000"))
    jitter = math.hypot(st5000.across, 0.5 * arcsec), math.hypot(st5000.about, 10 * arcsec)
    given = "field of 30 square degrees, 10 Hz, jitter of the vehicle"
    guess = "lens, detector, exposure"
    rows += [
        line("ST5000", "about over across", st5000.about / st5000.across, 31.5, given, guess),
        line("ST5000", "across with jitter, arcsec", jitter[0] / arcsec, 0.54, given, guess),
        line("ST5000", "about with jitter, arcsec", jitter[1] / arcsec, 17.0, given, guess),
    ]
    for name, design, published, told, made in (
        ("SSTL Rigel-L", "rigel-l", (3.0, 28.0), "lens, exposure, field", "detector, PSF"),
        (
            "SSTL Altair HB+",
            "altair-hb",
            (10.0, 60.0),
            "lens, exposure, field",
            "detector, PSF of the consumer lens",
        ),
    ):
        budget = analytic(tracker(design))
        for kind, figure in zip(("across", "about"), published, strict=True):
            got = getattr(budget, kind) / arcsec
            rows.append(line(name, f"{kind}, arcsec (68 %)", got, figure, told, made))
        rows.append(
            line(
                name,
                "about over across",
                budget.about / budget.across,
                published[1] / published[0],
                told,
                made,
            )
        )
    rufino = tracker("rufino-2013").instrument.camera
    # Their single stars have errors of 0.33 pixel, caused by the display: only geometry remains.
    sigma = 0.33 / rufino.focal_length_px
    x, y, z = attitude_bound(rufino.fov_x, rufino.fov_y, 16, sigma)
    given = "field, 16 stars, 0.33 pixel a star"
    rows += [
        line(
            "Rufino 2013",
            "across, arcsec",
            math.hypot(x, y) / math.sqrt(2) / arcsec,
            5.0,
            given,
            "stars distributed evenly",
        ),
        line("Rufino 2013", "about, arcsec", z / arcsec, 30.0, given, "stars distributed evenly"),
    ]
    vst = analytic(tracker("vst-41m"))
    rows.append(
        line(
            "Vectronic VST-41M",
            "across, arcsec (2 sigma)",
            2 * vst.across / arcsec,
            18.0,
            "field, 4 Hz",
            "f-number, exposure, PSF",
        )
    )
    return rows


def chandra() -> dict[str, Any]:
    """The centroid of one star of Chandra's aspect camera: mean over guide stars."""
    case = tracker("chandra-aca")
    star = errors(case)
    square = sum(np.trace(each, axis1=1, axis2=2) / 2 for each in star.random.values())
    size = np.sqrt(np.interp(CHANDRA, star.magnitude, square))
    pixel = 1 / case.instrument.camera.focal_length_px / arcsec
    return line(
        "Chandra ACA",
        "centroid of a star, arcsec rms",
        size.mean() * pixel,
        0.060,
        "aperture, pixel, electrons of a star",
        "read noise, exposure, PSF, PRNU, "
        f"stars from magnitude {CHANDRA[0]:g} to {CHANDRA[-1]:g} alike",
    )


def circles(sky: Sky, radius: float, places: int) -> Floats:
    """Number of stars (m,) in circles of a radius (radian), spread uniformly over the sky."""
    direction = boresights(places).inv().apply([0.0, 0.0, 1.0])
    return np.array([len(stars) for stars in sky.cones(direction, radius)])


def sky(places: int) -> list[dict[str, Any]]:
    """Numbers of stars in some circles, and shift of stars by the observer's velocity."""
    stars = open_sky(Selection()).stars
    v = v_from_g(stars.magnitude_g, stars.colour)
    rows = []
    known = "field and limit for the whole sky; the fewest by the BSC"
    for diameter, limit, least in ((17, 5.85, 6), (22, 5.35, 5)):
        count = circles(Sky(stars[v <= limit]), diameter / 2 * deg, places)
        told = f"fewest stars of V {limit} in {diameter} deg"
        rows.append(line("APST", told, count.min(), least, known, "circles"))
    count = circles(Sky(stars[v <= 6]), 10 * deg, places)
    rows.append(line("sky", "mean stars of V 6 in 20 deg", count.mean(), 38.6, "the BSC", "none"))
    speeds = [
        float(np.linalg.norm(earth_observer(2026 + month / 12).velocity)) for month in range(12)
    ]
    speed = float(np.mean(speeds))
    rows += [
        line(
            "aberration",
            "of the Earth, arcsec",
            speed / LIGHT_SPEED / arcsec,
            20.5,
            "",
            "mean of a year",
        ),
        line(
            "aberration",
            "of a low orbit, arcsec",
            ORBIT / LIGHT_SPEED / arcsec,
            5.2,
            "",
            "500 km up",
        ),
    ]
    return rows


def validation(quick: bool = False) -> list[dict[str, Any]]:
    """All rows of the comparison."""
    return [*scenarios(), *trackers(), chandra(), *sky(200 if quick else PLACES)]


def show(rows: list[dict[str, Any]]) -> None:
    print(f"{'':20}{'':36}{'predicted':>10}{'published':>11}{'ratio':>8}   assumed")
    for row in rows:
        print(
            f"{row['name']:20}{row['quantity']:36}{row['predicted']:10.4g}{row['published']:11.4g}"
            f"{row['ratio']:8.3f}   {row['assumed']}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    options = command.read(parser)
    rows = validation(options.quick)
    show(rows)
    command.save(options, rows)


if __name__ == "__main__":
    command.run(main)
