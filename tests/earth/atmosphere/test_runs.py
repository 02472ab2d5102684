"""Runs of other programs at three albedos become the table that they were made from."""

import json
import math

import numpy as np
import pytest

from startrack.core.units import deg, nm, um
from startrack.earth.atmosphere import Reach, Sight, radiance, refine
from startrack.earth.atmosphere.modtran import read_modtran
from startrack.earth.atmosphere.runs import Place, from_runs, gather, read_uvspec

AT = np.array([0.50, 0.55, 0.60])  # um
P, D, K, A, S, T = (
    np.array(one)
    for one in (
        [40e6, 30e6, 22e6], [130e6, 140e6, 150e6], [40e6, 30e6, 20e6], [35e6, 28e6, 20e6],
        [0.16, 0.12, 0.09], [0.60, 0.65, 0.70],
    )
)  # fmt: skip
ALBEDOS = (0.0, 0.25, 0.75)
PLACE = Place(0.0, 0.0, 50 * deg, 90 * deg)

TAPE = (
    " WAVLEN MCRN  TRANS  PTH THRML  THRML SCT  SURF EMIS   SOL SCAT  SING SCAT  GRND RFLT"
    "  DRCT RFLT  TOTAL RAD  REF SOL  SOL@OBS   DEPTH"
)
SIX = (
    "    FREQ  TOT_TRANS  PTH_THRML  THRML_SCT  SURF_EMIS   SOL_SCAT  SING_SCAT  GRND_RFLT"
    "  DRCT_RFLT  TOTAL_RAD  REF_SOL  SOL@OBS   DEPTH"
)


def terms(albedo):
    bounce = 1 - albedo * S
    return albedo * D, albedo * (D + K) / bounce, P + albedo * A / bounce


def tape(albedo, per):
    """Columns of a .7sc file; THRML SCT stays blank, as where there is none."""
    direct, reflected, scattered = (one / per for one in terms(albedo))
    lines = ["M   2    2    2    1 card 1", "  0.500000  0.600000 card 4", TAPE]
    for i, at in enumerate(AT):
        lines.append(
            f"{at:12.6f}{T[i]:7.4f}{0:11.4E}{'':11}{0:11.4E}{scattered[i]:11.4E}{0:11.4E}"
            f"{reflected[i]:11.4E}{direct[i]:11.4E}{scattered[i] + reflected[i]:11.4E}"
            f"{0.1:9.2E}{0.1:9.2E}{0.4:8.3f}"
        )
    return "\n".join([*lines, " -9999."]) + "\n"


def wavenumbers(albedo):
    """A .tp7 file: per wavenumber, which rises as the wavelength falls."""
    direct, reflected, scattered = terms(albedo)
    frequency = 1e4 / AT
    per = 1e4 * 0.01 / (AT * um) ** 2
    lines = ["T   2    2 card 1", SIX]
    for i in (2, 1, 0):
        d, r, s = (one[i] / per[i] for one in (direct, reflected, scattered))
        lines.append(
            f"{frequency[i]:8.1f}{T[i]:11.6f}{0:11.4E}{0:11.4E}{0:11.4E}{s:11.4E}{0:11.4E}"
            f"{r:11.4E}{d:11.4E}{s + r:11.4E}{0.1:9.2E}{0.1:9.2E}{0.4:8.3f}"
        )
    return "\n".join([*lines, "  -9999."]) + "\n"


def as_json(albedo):
    direct, reflected, scattered = (one / 1e10 for one in terms(albedo))
    spectra = {
        "WAVLEN_MCRN": AT, "TOT_TRANS": T, "PTH_THRML": 0 * T, "SOL_SCAT": scattered,
        "GRND_RFLT": reflected, "DRCT_RFLT": direct, "TOTAL_RAD": scattered + reflected,
    }  # fmt: skip
    lists = {name: list(map(float, values)) for name, values in spectra.items()}
    return json.dumps({"MODTRAN": [{"MODTRANOUTPUT": {"SPECTRA": lists}}]})


def channels(albedo):
    """A .chn file: five lines of header, 25 columns and the channel's name."""
    width = 10.0  # nm
    direct, reflected, scattered = (one * width * nm / 1e4 for one in terms(albedo))
    lines = ["1ST SPECTRAL", "MOMENT", "(NM)", "", "-" * 40]
    for i, at in enumerate(AT):
        row = np.zeros(25)
        row[[0, 8, 14, 15, 16, 17, 24]] = (
            at * 1e3, width, 0.4 * scattered[i], 0.6 * scattered[i], reflected[i], direct[i], T[i],
        )  # fmt: skip
        lines.append(" ".join(f"{one:14.7E}" for one in row) + f"   BAND {i + 1} (0.4 TO 0.5)")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("suffix", "write", "digits"),
    [
        (".7sc", lambda albedo: tape(albedo, 1e10), 3e-4),
        (".tp7", wavenumbers, 3e-4),
        (".json", as_json, 1e-9),
        (".chn", channels, 1e-6),
    ],
    ids=["7sc", "tp7", "json", "chn"],
)
def test_modtrans_files_give_back_their_air(tmp_path, suffix, write, digits):
    runs = []
    for albedo in ALBEDOS:
        path = tmp_path / f"{albedo}{suffix}"
        path.write_text(write(albedo))
        runs.append(read_modtran(path, albedo))
    wavelength, table = from_runs({PLACE: runs})
    np.testing.assert_allclose(wavelength, AT * um, rtol=1e-5)
    for found, true in ((table.path[0, 0, 0, 0], P), (table.direct[0, 0, 0], D)):
        np.testing.assert_allclose(found, true, rtol=digits)
    np.testing.assert_allclose(table.sky[0, 0, 0], K, rtol=20 * digits)
    np.testing.assert_allclose(table.around[0, 0, 0], A, rtol=20 * digits)
    np.testing.assert_allclose(table.backscatter[0], S, rtol=20 * digits)
    np.testing.assert_allclose(table.through[0, 0], T, atol=1e-4)


def test_a_third_albedo_comes_out_of_the_table(tmp_path):
    """At 0.5, which none of the runs had, to 1e-6."""
    for albedo in ALBEDOS:
        (tmp_path / f"{albedo}.json").write_text(as_json(albedo))
    runs = [read_modtran(tmp_path / f"{albedo}.json", albedo) for albedo in ALBEDOS]
    wavelength, table = from_runs({PLACE: runs})
    one = gather(wavelength, table, np.eye(3) / np.gradient(wavelength))
    flat = np.ones(1)
    fine = refine(one, Reach(*((value, value) for value in PLACE)))
    sight = Sight(*(value * flat for value in (*PLACE, math.cos(50 * deg), 1.0, 1.0)))
    half = np.full(3, 0.5)
    total = radiance(fine, sight, half, half).total[0]
    np.testing.assert_allclose(total, sum(terms(0.5)[1:]), rtol=1e-6)


def test_libradtrans_files_give_back_their_air(tmp_path):
    """Irradiances and radiances that a uvspec with these terms would print."""
    sun, sensor = 50 * deg, 30 * deg
    top = np.array([1.9e9, 1.87e9, 1.8e9]) * math.cos(sun)  # edir at the top, W / m2 / m
    beam = np.array([0.5, 0.55, 0.6])
    through = beam ** (math.cos(sun) / math.cos(sensor))
    sky = np.array([2.5e8, 2e8, 1.5e8])
    runs = []
    for albedo in ALBEDOS:
        down = (top * beam + sky) / (1 - albedo * S)
        up = albedo * down * through / math.pi + P + albedo * A / (1 - albedo * S)
        rows = [
            (at * 1e3, height, edir / 1e6, edn / 1e6, uu / 1e6)
            for i, at in enumerate(AT)
            for height, edir, edn, uu in (
                (0.0, top[i] * beam[i], down[i] - top[i] * beam[i], 0.0),
                (120.0, top[i], 0.0, up[i]),
            )
        ]
        np.savetxt(tmp_path / f"{albedo}.out", rows, fmt="%.8e")
        runs.append(
            read_uvspec(tmp_path / f"{albedo}.out", albedo, tmp_path / "0.0.out", sun, sensor)
        )
    _, table = from_runs({PLACE: runs})
    np.testing.assert_allclose(table.path[0, 0, 0, 0], P, rtol=1e-6)
    np.testing.assert_allclose(table.backscatter[0], S, rtol=1e-5)
    np.testing.assert_allclose(table.direct[0, 0, 0], top * beam * through / math.pi, rtol=1e-6)
    np.testing.assert_allclose(table.sky[0, 0, 0], sky * through / math.pi, rtol=1e-5)
    np.testing.assert_allclose(table.around[0, 0, 0], A, rtol=1e-5)


# MODTRAN 5.2.1 as pybsm 0.16 ships it (24.5 km, nadir, Sun at 50 degrees, rural 23 km, ground that
# reflects 15 %), W / cm2 / sr / um: wavelength, transmittance, PTH THRML, SURF EMIS, SOL SCAT,
# GRND RFLT.
PYBSM = (
    (0.55, 0.6456, 0.0, 0.0, 0.0026837, 0.002911),
    (0.86, 0.8209, 8.9538e-22, 9.9114e-21, 0.0011092, 0.0022082),
    (1.6, 0.9046, 3.5472e-12, 7.6271e-11, 6.2817e-05, 0.00062253),
    (3.8, 0.8246, 4.4182e-06, 3.3352e-05, 3.2102e-07, 2.2882e-05),
    (10.0, 0.6478, 0.00022744, 0.00053765, 2.2213e-09, 3.7172e-05),
)


def test_modtrans_own_rows_are_read(tmp_path):
    lines = ["card", TAPE]
    for at, trans, rise, surface, scattered, ground in PYBSM:
        lines.append(
            f"{at:12.6f}{trans:7.4f}{rise:11.4E}{'':11}{surface:11.4E}{scattered:11.4E}{'':11}"
            f"{ground:11.4E}{0:11.4E}{rise + surface + scattered + ground:11.4E}"
        )
    path = tmp_path / "rows.7sc"
    path.write_text("\n".join([*lines, " -9999."]))
    run = read_modtran(path, 0.15)
    rows = np.array(PYBSM).T
    np.testing.assert_allclose(run.wavelength, rows[0] * um)
    np.testing.assert_allclose(run.through, rows[1], atol=5e-5)
    for found, column in ((run.rise, 2), (run.scattered, 4), (run.reflected, 5)):
        np.testing.assert_allclose(found, rows[column] * 1e10, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("a.7sc", "nothing here\n", "must have a line with FREQ or WAVLEN"),
        ("a.7sc", TAPE + "\n 0.5 0.5\n -9999.\n", "must have two rows or more, got 1"),
        ("a.json", "{", "must be JSON"),
        ("a.json", "{}", "must hold FREQ or WAVLEN and GRND_RFLT"),
        ("a.chn", "1 2 3\n", "must have two channels"),
    ],
)
def test_what_is_no_run_is_refused(tmp_path, name, text, sentence):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=sentence):
        read_modtran(tmp_path / name, 0.0)


def test_albedos_must_tell_the_ground(tmp_path):
    for albedo in (0.0, 0.25):
        (tmp_path / f"{albedo}.json").write_text(as_json(albedo))
    two = [read_modtran(tmp_path / f"{albedo}.json", albedo) for albedo in (0.0, 0.25)]
    with pytest.raises(ValueError, match="albedo must be 0 and two others"):
        from_runs({PLACE: two})
    with pytest.raises(ValueError, match="runs must fill their grid of 2 x 2 x 1 x 1"):
        from_runs({PLACE: two, PLACE._replace(height=1e3, sensor=0.1): two})
