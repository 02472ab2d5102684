"""How fast, complete and accurate is the detection of stars, compared with other programs and
bounds?

Frames of 1024 x 1024 pixels, background 50 e-, read noise 5 e-; stars are integrated over pixels by
scipy's normal distribution. The Cramér-Rao bounds are computed here, from that distribution alone.
If STARTRACK_DATA names a folder with images and their solutions, spots of real skies are counted
too. Times are CPU times of one thread, the shortest of several rounds; programs run alternately.

    python experiments/detection.py [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import command
import cv2
import numpy as np
from scipy.spatial import cKDTree

from startrack import Frame, Streams, read_image
from startrack.benchmark import detection as cases
from startrack.core import Floats
from startrack.detection import Detection, detect, subtract_dark

SIGMAS = (0.7, 1.2)
FAINTEST = 9.5  # magnitude G, of stars that a spot of a real image may be


def bound(flux: float, sigma: float, background: float, read_noise: float) -> float:
    """Cramér-Rao bound per axis over all places in a pixel, by differences of the images."""
    variances = []
    phase = (np.arange(8) + 0.5) / 8 - 0.5
    for a in phase:
        for b in phase:

            def mean(x: float, y: float, light: float, level: float) -> Floats:
                image = np.full((21, 21), level)
                cases.paint(image, np.array([x]), np.array([y]), light, sigma)
                return image.ravel()

            at, steps = (10 + a, 10 + b, flux, background), (1e-4, 1e-4, 1e-2, 1e-2)
            slopes = []
            for k, step in enumerate(steps):
                high, low = ([p + s * (i == k) for i, p in enumerate(at)] for s in (step, -step))
                slopes.append((mean(*high) - mean(*low)) / (2 * step))
            slope = np.array(slopes)
            information = slope / (mean(*at) + read_noise**2 + 1 / 12) @ slope.T
            variances.append(np.trace(np.linalg.inv(information)[:2, :2]) / 2)
    return float(np.sqrt(np.mean(variances)))


def scatter(
    flux: float,
    sigma: float,
    background: float,
    read_noise: float,
    seed: int,
    frames: int,
    spacing: int = 22,
    smear: float = 0.0,
    **settings: object,
) -> Floats:
    """Errors (n, 2) of the detected stars."""
    options = {"kernel_sigma": sigma, "max_spots": 9999, "smear_x": smear, **settings}
    errors = []
    for trial in range(frames):
        streams = Streams(seed, trial)
        x, y = cases.field(streams, spacing)
        light = np.full((cases.SIDE, cases.SIDE), background)
        count = 1 if smear == 0 else 33
        for k in range(count):
            cases.paint(light, x + smear * ((k + 0.5) / count - 0.5), y, flux / count, sigma)
        frame = cases.expose(light, streams, read_noise)
        spots = detect(frame, Detection(**options))  # type: ignore[arg-type]
        errors.append(cases.paired(cases.spot_positions(spots), x, y)[1])
    return np.concatenate(errors)


def rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2)))


def accuracy(sigmas: Sequence[float], quick: bool) -> dict[str, float]:
    few, many, spacing = (1, 1, 200) if quick else (4, 24, 22)  # frames, and pixels between stars
    figures: dict[str, float] = {}
    ratios = []
    print(
        "\nlikelihood, background 50, read noise 5; SNR with the star's own noise, and without"
        "\nsigma    flux   SNR            rms px  bound px  ratio"
    )
    for sigma in sigmas:
        fluxes = [cases.flux_of(snr, sigma) for snr in (6, 8, 10)] + [1200.0, 2500.0, 20000.0]
        for flux in fluxes[-1:] if quick else fluxes:
            snr, less = (cases.snr_of(flux, sigma), cases.snr_of(flux, sigma, False))
            error = scatter(
                flux,
                sigma,
                cases.BACKGROUND,
                cases.READ_NOISE,
                1,
                few,
                spacing,
                centroid="likelihood",
            )
            least = bound(flux, sigma, cases.BACKGROUND, cases.READ_NOISE)
            ratio = rms(error) / least
            print(
                f"{sigma:5} {flux:7.0f} {snr:5.1f} ({less:5.1f}) "
                f"{rms(error):9.5f} {least:9.5f} {ratio:6.3f}"
            )
            figures[f"ml_over_bound_sigma{sigma}_snr{snr:.0f}"] = ratio
            if snr > 7.9:
                ratios.append(ratio)
    figures["ml_over_bound_max"] = max(ratios)
    error = scatter(1e4, 0.7, 10.0, 5.0, 2, many, spacing, centroid="likelihood")
    figures["ml_rmse_10000_px"] = rms(error)
    figures["ml_bias_px"] = float(np.abs(error.mean(axis=0)).max())
    figures["ml_bias_one_sigma_px"] = rms(error) / len(error) ** 0.5
    for flux in (10000, 1000):
        error = scatter(flux, 0.7, 10.0, 5.0, 3, few, spacing, compensation="none")
        figures[f"cog5_rmse_{flux}_px"] = rms(error)
    worst = 0.0
    for length, known in ((0.0, 0.0152), (2.0, 0.0190), (8.0, 0.0461)):
        error = scatter(
            5000, 0.8, 20.0, 8.0, 4, few, max(spacing, 34), length, centroid="likelihood"
        )
        figures[f"smear_{length:.0f}_along_px"] = rms(error[:, 0])
        worst = max(worst, rms(error[:, 0]) / known)
    return figures | {"smear_over_bound_max": worst}


def finders(sigma: float) -> dict[str, cases.Finder]:
    """Frame -> places (n, 2) of each program, single-threaded."""
    return cases.finders(sigma) | peers(sigma)


def peers(sigma: float) -> dict[str, cases.Finder]:
    """The finders of other installed programs."""
    found: dict[str, cases.Finder] = {}
    if not command.missing("tetra3rs is", "tetra3rs"):
        import tetra3rs

        def by_tetra3rs(extract: Callable[..., Any], frame: Frame) -> Floats:
            spots = [(c.x, c.y) for c in extract(frame.image, threads=1).centroids]
            rows, columns = frame.image.shape
            # Its origin is the centre of the image.
            centre = np.array([(columns - 1) / 2, (rows - 1) / 2])
            return np.array(spots).reshape(-1, 2) + centre

        found["tetra3rs_fast"] = partial(by_tetra3rs, tetra3rs.extract_centroids_fast)
        found["tetra3rs"] = partial(by_tetra3rs, tetra3rs.extract_centroids)
    if not command.missing("sep is", "sep"):
        import sep  # type: ignore[import-not-found,import-untyped,unused-ignore]

        def by_sep(frame: Frame) -> Floats:
            image = np.ascontiguousarray(frame.image, np.float32)
            sky = sep.Background(image)
            spots = sep.extract(image - sky, 1.5, err=sky.globalrms)
            x, y, _ = sep.winpos(image - sky, spots["x"], spots["y"], np.full(len(spots), sigma))
            return np.column_stack([x, y])

        found["sep"] = by_sep
    if not command.missing("cedar-solve is", "tetra3"):
        from tetra3 import get_centroids_from_image  # type: ignore[import-not-found,import-untyped,unused-ignore]

        # It gives (y, x) from the corner of the first pixel.
        found["cedar_solve"] = lambda f: (
            np.asarray(get_centroids_from_image(f.image)).reshape(-1, 2)[:, ::-1] - 0.5
        )
    return found


def speed(sigmas: Sequence[float], repeats: int) -> dict[str, float]:
    """Milliseconds for 30 stars from 150 to 45 000 e-."""
    figures: dict[str, float] = {}
    for sigma in sigmas:
        streams = Streams(5, 0)
        x, y = streams("place").uniform(12, cases.SIDE - 13, (2, 30))
        light = np.full((cases.SIDE, cases.SIDE), cases.BACKGROUND)
        cases.paint(light, x, y, 150 * 300 ** streams("flux").uniform(0, 1, 30), sigma)
        frame = cases.expose(light, streams)
        programs = finders(sigma)
        times: dict[str, list[float]] = {name: [] for name in programs}
        for _ in range(repeats):
            for name, program in programs.items():
                start = time.process_time()
                program(frame)
                times[name].append(1e3 * (time.process_time() - start))
        for name, values in times.items():
            figures[f"{name}_sigma{sigma}_ms"] = min(values)
            print(
                f"sigma {sigma}: {name:14} {min(values):6.2f} ms, median {np.median(values):6.2f}"
            )
    for name in programs:
        figures[f"{name}_ms"] = max(figures[f"{name}_sigma{sigma}_ms"] for sigma in sigmas)
    return figures


def completeness(sigmas: Sequence[float], quick: bool) -> dict[str, float]:
    """Fraction of stars found, and false spots a frame, compared with a filter at known places."""
    figures: dict[str, float] = {}
    short = []
    print(
        "\nshare found; limit of a test that knows the place, at 0.05 false a frame; "
        "SNR with the star's own noise, and without"
    )
    for sigma in sigmas:
        programs = finders(sigma)
        false = dict.fromkeys(programs, 0)
        empty = 1 if quick else 100
        for trial in range(empty):
            frame = cases.expose(
                np.full((cases.SIDE, cases.SIDE), cases.BACKGROUND), Streams(6, trial)
            )
            for name, program in programs.items():
                if name in ("detect", "detect_ml") or trial < 10:
                    false[name] += len(program(frame))
        for name, count in false.items():
            fraction = count / (empty if name in ("detect", "detect_ml") else min(empty, 10))
            figures[f"{name}_false_per_frame_sigma{sigma}"] = fraction
            print(f"sigma {sigma}: {name:14} {fraction:7.3f} false a frame")
        for snr in (6.0, 8.0) if quick else (4.5, 5.0, 5.5, 6.0, 7.0, 8.0, 10.0):
            flux = cases.flux_of(snr, sigma)
            found, total = dict.fromkeys(programs, 0), 0
            for trial in range(1 if quick else 6):
                streams = Streams(7, trial)
                x, y = cases.field(streams, 57)
                light = np.full((cases.SIDE, cases.SIDE), cases.BACKGROUND)
                cases.paint(light, x, y, flux, sigma)
                frame = cases.expose(light, streams)
                total += len(x)
                for name, program in programs.items():
                    found[name] += int(cases.paired(program(frame), x, y)[0].sum())
            fractions = {name: count / total for name, count in found.items()}
            text = ", ".join(f"{name} {fraction:.3f}" for name, fraction in fractions.items())
            best = cases.limit(flux, sigma)
            less = cases.snr_of(flux, sigma, star_noise=False)
            print(f"sigma {sigma}, {flux:.0f} e-, SNR {snr} ({less:.1f}): limit {best:.3f}; {text}")
            short.append(best - fractions["detect"])
            figures[f"limit_completeness_snr{snr:g}_sigma{sigma}"] = best
            for name, fraction in fractions.items():
                figures[f"{name}_completeness_snr{snr:g}_sigma{sigma}"] = fraction
    figures["completeness_below_limit_max"] = max(short)
    for snr in (6, 8):
        shares_of = [figures[f"detect_completeness_snr{snr}_sigma{s}"] for s in sigmas]
        figures[f"completeness_snr{snr}"] = min(shares_of)
    figures["false_per_frame"] = max(figures[f"detect_false_per_frame_sigma{s}"] for s in sigmas)
    return figures


def real(folder: Path, images: int | None) -> dict[str, float]:
    """True and false spots of each program on each image, by the attitudes of other solvers.

    images  number of images; None: all
    """
    from startrack.catalog import Selection, open_sky

    stars = open_sky(Selection.whole("deep", 2016.0)).stars
    direction = stars.direction[stars.magnitude_g < FAINTEST]
    programs = finders(1.0)
    truth = json.loads((folder / "truth.json").read_text())["images"]
    dark = read_image(folder / "ost_dark.png")
    figures: dict[str, float] = {}
    print("\nreal images: true + false spots (at most 500)")
    for name, solved in list(truth.items())[:images]:
        frame = read_image(folder / name)
        if name.startswith("ost"):
            frame = subtract_dark(frame, dark)
            frame = Frame(frame.image, np.nan, np.nan, 0.0)
        pixel = _expected(direction, solved)
        text = [f"{name:27}"]
        for program, find in programs.items():
            dead_free = np.nan_to_num(np.asarray(frame.image, np.float32))
            spots = find(frame if program.startswith("detect") else Frame(dead_free))
            true = int((cKDTree(pixel).query(spots)[0] < 2).sum()) if len(spots) else 0
            figures[f"{program}_true_{name}"] = true
            figures[f"{program}_false_{name}"] = len(spots) - true
            text.append(f"{program} {true}+{len(spots) - true}")
        print("  ".join(text))
    return figures


def _expected(direction: Floats, solved: dict) -> Floats:
    """Places (n, 2), pixel, of catalogue stars."""
    width, height = solved["width"], solved["height"]
    seen = direction @ np.array(solved["R_icrs_to_cam"]).T
    seen = seen[seen[:, 2] > np.cos(np.radians(solved["fov_x_deg"]))]
    plane = seen[:, :2] / seen[:, 2:] * width / 2 / np.tan(np.radians(solved["fov_x_deg"]) / 2)
    radius = np.hypot(*plane.T) / (width / 2)
    pixel = plane * (1 + solved["fit"]["k1"] * radius**2)[:, None]
    pixel += [(width - 1) / 2, (height - 1) / 2]
    return np.asarray(pixel[((pixel > -1) & (pixel < [width, height])).all(axis=1)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options = command.read(parser)
    cv2.setNumThreads(1)
    sigmas, quick = (SIGMAS[:1] if options.quick else SIGMAS), options.quick
    figures = speed(sigmas, 1 if quick else 40)
    figures |= accuracy(sigmas, quick) | completeness(sigmas, quick)
    if folder := command.images("the real images are"):
        figures |= real(folder, 1 if quick else None)
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
