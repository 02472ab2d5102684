"""A user's table of the air: its format, its use in scenes, and output of MODTRAN."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
from astropy.io import fits

from startrack.core import Refused, deg, nm, um
from startrack.earth.atmosphere import (
    Air,
    RunGeometry,
    at_sensor,
    import_tape7,
    load_radiance_table,
    radiance_bands,
)
from startrack.earth.imager import band_of
from startrack.earth.retrieval import EarthProblem, ground_spectrum, load_earth_design
from startrack.earth.retrieval.patch import level_ground
from startrack.io import shipped

WHITE = {"path": 20.0, "direct": 300.0, "sky": 60.0, "around": 40.0}  # W / m2 / sr / um
MIRRORED, THROUGH = 0.1, 0.7
WAVES = [0.40 + 0.01 * n for n in range(61)]  # um
SUNS = [20.0, 40.0, 60.0]
RADIANCE = "W m-2 sr-1 um-1"
HEADS = [
    "wavelength [um]",
    "sun_zenith [deg]",
    *(f"{name} [{RADIANCE}]" for name in WHITE),
    "backscatter",
    "through",
]


def rows():
    """Light that decreases with wavelength and with the cosine of the Sun's zenith angle."""
    for sun in SUNS:
        high = math.cos(math.radians(sun))
        for wave in WAVES:
            yield wave, sun, *(value * high / wave for value in WHITE.values()), MIRRORED, THROUGH


def written(path, heads=HEADS, lines=None):
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([heads, *(rows() if lines is None else lines)])
    return path


def white_light(name, sun, low, high):
    """Mean of a column over a flat response between two wavelengths, by hand: c ln(b/a) / (b-a)."""
    mean = math.log(high / low) / (high - low)
    return 1e6 * WHITE[name] * math.cos(sun) * mean


def box(table, low, high):
    inside = (table.spectrum > (low - 1e-4) * um) & (table.spectrum < (high + 1e-4) * um)
    return (inside / (inside * np.gradient(table.spectrum)).sum())[None]


def test_bands_and_radiance_are_those_of_a_calculation_by_hand(tmp_path):
    table = load_radiance_table(written(tmp_path / "air.csv"))
    bands = radiance_bands(table, box(table, 0.5, 0.6), 500e3)
    assert bands.direct[0, 0, 1, 0] == pytest.approx(
        white_light("direct", 40 * deg, 0.495, 0.605), rel=1e-3
    )
    assert bands.through[0, 0, 0] == pytest.approx(THROUGH)
    level, rho = level_ground(1, 0.0, 40 * deg), 0.3
    terms = at_sensor(level, bands, np.array([[rho]]), np.array([rho]))
    light = {name: white_light(name, 40 * deg, 0.495, 0.605) for name in WHITE}
    bounce = 1 / (1 - rho * MIRRORED)
    wanted = light["path"] + rho * bounce * (light["direct"] + light["sky"] + light["around"])
    assert terms.total[0, 0] == pytest.approx(wanted, rel=1e-3)


def test_fits_ecsv_and_other_units_are_the_same_table(tmp_path):
    first = load_radiance_table(written(tmp_path / "air.csv"))
    values = np.array(list(rows()))
    units = ["nm", "rad", *["uW cm-2 sr-1 nm-1"] * 4, "", ""]
    scales = [1e3, deg, *[0.1] * 4, 1, 1]
    names = [head.split()[0] for head in HEADS]
    parts = [
        fits.Column(name.upper(), "D", unit=unit, array=values[:, n] * scales[n])
        for n, (name, unit) in enumerate(zip(names, units, strict=True))
    ]
    fits.BinTableHDU.from_columns(parts).writeto(tmp_path / "air.fits")
    lines = ["# %ECSV 1.0", "# ---", "# datatype:"]
    lines += [
        f"# - {{name: {name}, {f'unit: {unit}, ' if unit else ''}datatype: float64}}"
        for name, unit in zip(names, units, strict=True)
    ]
    lines += [" ".join(names), *(" ".join(map(repr, row)) for row in (values * scales).tolist())]
    (tmp_path / "air.ecsv").write_text("\n".join(lines) + "\n")
    for name in ("air.fits", "air.ecsv"):
        other = load_radiance_table(tmp_path / name)
        np.testing.assert_allclose(other.spectrum, first.spectrum)
        np.testing.assert_allclose(other.sun, first.sun)
        np.testing.assert_allclose(other.direct, first.direct)


def broken(tmp_path, change):
    heads, lines = list(HEADS), [list(row) for row in rows()]
    change(heads, lines)
    return written(tmp_path / "air.csv", heads, lines)


def set_head(n, text):
    def change(heads, lines):
        heads[n] = text

    return change


def set_value(row, n, value):
    def change(heads, lines):
        lines[row][n] = value

    return change


def drop(row):
    def change(heads, lines):
        del lines[row]

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_head(2, "path [W]"), "column path: must have a unit that converts to W / .m2 sr m., "),
        (set_head(2, "path"), "column path: must have a unit"),
        (set_head(0, "wavelength [s]"), "column wavelength: must have a unit that converts to m"),
        (set_head(6, "backscatter [m]"), "column backscatter: must have no unit, got 'm'"),
        (set_head(3, "mirror [m]"), "a column must be one of wavelength, .*, got 'mirror'"),
        (set_head(1, "sun_zenith [km]"), "column sun_zenith: must have a unit that converts to r"),
        (set_value(3, 2, -1.0), "column path: values must lie in .0, inf.* row 4 is -1e"),
        (set_value(3, 7, 1.5), r"column through: values must lie in \[0, 1\]"),
        (set_value(3, 4, "cloudy"), "column sky"),
        (set_value(3, 0, 0.1), r"column wavelength: values must lie in \[2e-07, 5e-05\] m"),
        (drop(70), "has wavelength 0.49 um, sun_zenith 40 deg 0 times"),
        (lambda heads, lines: lines.append(lines[5]), "wavelength 0.45 um, sun_zenith 20 deg 2 t"),
        (lambda heads, lines: [row.pop() for row in (heads, *lines)], "has no through"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, change, message):
    with pytest.raises(Refused, match=message) as refused:
        load_radiance_table(broken(tmp_path, change))
    assert "air.csv" in str(refused.value)


def test_what_is_no_table_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError):
        load_radiance_table(tmp_path / "none.csv")
    (tmp_path / "none.fits").write_bytes(b"SIMPLE  =                    T")
    with pytest.raises(Refused, match=r"none\.fits"):
        load_radiance_table(tmp_path / "none.fits")


def scene(tmp_path, extra="", table='table = "air.csv"'):
    """The shipped scene `fields` with a camera of one channel and a user's table of the air."""
    text = f"""
lines = 8
columns = 8
[camera]
[[camera.channels]]
name = "green"
[camera.channels.band]
wavelength = ["0.50 um", "0.51 um", "0.59 um", "0.60 um"]
value = [0.0, 1.0, 1.0, 0.0]
[camera.channels.optics]
focal_length = "100 mm"
f_number = 4
[camera.channels.detector]
columns = 64
rows = 64
pixel_pitch = "10 um"
exposure = "1 ms"
quantum_efficiency = {{ value = [0.6] }}
[orbit]
epoch = "2026-06-21T10:00:00"
altitude = "500 km"
inclination = "97.4 deg"
[air]
{table}
[terrain]
highest = "10 m"
[terrain.fractal]
longitude = "10 deg"
latitude = "47 deg"
cell = "90 m"
cells = 64
relief = "5 m"
[[land.covers]]
reflectance = {{ value = [0.3] }}
{extra}
"""
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return load_earth_design(path)


def test_a_scene_uses_it_and_names_what_it_lacks(tmp_path):
    written(tmp_path / "air.csv")
    design = scene(tmp_path)
    (channel,) = design.camera.channels
    band = band_of(channel, design.air, 500e3, 1.0)
    mean = band.weight @ band.wavelength / um
    sun = 40 * deg
    assert band.table.direct[0, 0, 1, 0] == pytest.approx(
        1e6 * WHITE["direct"] * math.cos(sun) / mean, rel=5e-3
    )
    spectrum = ground_spectrum(design, 0.5 * um, 0.6 * um, 0.0, sun)
    assert len(spectrum.wavelength) == pytest.approx(11, abs=1)
    wanted = 1e6 * sum(WHITE[name] * math.cos(sun) / 0.55 for name in ("direct", "sky", "around"))
    middle = np.argmin(abs(spectrum.wavelength - 0.55 * um))
    light = spectrum.radiance[middle] - 1e6 * WHITE["path"] * math.cos(sun) / 0.55
    assert light == pytest.approx(0.3 * wanted / (1 - 0.3 * MIRRORED), rel=1e-3)
    for angle in (10 * deg, 65 * deg):
        with pytest.raises(Refused, match="sun must lie in the table's"):
            ground_spectrum(design, 0.5 * um, 0.6 * um, 0.0, angle)
    assert ground_spectrum(design, 0.5 * um, 0.6 * um, 0.0, 30 * deg).radiance[0] > 0
    with pytest.raises(ValueError, match="channel green: the band must lie in the air's table"):
        band_of(channel.shifted(450 * nm), design.air, 500e3, 1.0)
    infrared = replace(
        channel, band=replace(channel.band, wavelength=(3.5e-6, 3.6e-6, 4e-6, 4.1e-6))
    )
    with pytest.raises(
        ValueError, match=r"the band must lie in the air's table, 0\.40 to 1\.00 um"
    ):
        band_of(infrared, design.air, 500e3, 1.0)


def test_few_wavelengths_and_a_wrong_altitude_are_refused(tmp_path):
    coarse = [row for row in rows() if round(row[0] * 100) % 15 == 10]
    written(tmp_path / "air.csv", lines=coarse)
    design = scene(tmp_path)
    (channel,) = design.camera.channels
    with pytest.raises(Refused, match="green: the air's table must have 3 wavelengths or more"):
        band_of(channel, design.air, 500e3, 1.0)
    low = tmp_path / "low.csv"
    written(low, [*HEADS, "altitude [km]"], [[*row, 3.0] for row in rows()])
    with pytest.raises(Refused, match=r"channel green: altitude of the sensor .* 2900 to 3100 m"):
        band_of(channel, Air(table=str(low)), 500e3, 1.0)
    with pytest.raises(Refused, match="the other keys must be left out if table is given"):
        Air(table=str(low), visibility=10e3)


def test_beyond_three_micrometre_heat_is_needed(tmp_path):
    def lines(heat):
        for n in range(40):
            yield (3.0 + 0.05 * n, 0, 0, 0, 0, 0, 0.8, *heat)

    heads = [head for head in HEADS if "sun" not in head]
    written(tmp_path / "cold.csv", heads, lines(()))
    warm_heads = [*heads, f"rise [{RADIANCE}]", f"fall [{RADIANCE}]"]
    written(tmp_path / "warm.csv", warm_heads, lines((0.05, 0.2)))
    mir = load_earth_design("hsrs").camera.channels[0]
    with pytest.raises(Refused, match="must have the columns rise and fall beyond 3 um"):
        band_of(mir, Air(table=str(tmp_path / "cold.csv")), 572e3, 1.0)
    band = band_of(mir, Air(table=str(tmp_path / "warm.csv")), 572e3, 1.0)
    ground = level_ground(1, 0.0, 120 * deg)
    warm = band.heat(np.array([300.0]))[0, 0]
    terms = at_sensor(
        ground, band.table, np.array([[0.1]]), np.array([0.1]), band.heat, np.array([300.0])
    )
    assert terms.total[0, 0] == pytest.approx(0.05e6 + 0.1 * 0.2e6 + 0.9 * 0.8 * warm, rel=1e-4)


def test_a_design_with_it_is_forecast(tmp_path):
    """Fires at night with thermal radiance as from MODTRAN: a table without air detects smaller
    ones."""
    heads = [head for head in HEADS if "sun" not in head]
    heads += [f"rise [{RADIANCE}]", f"fall [{RADIANCE}]"]
    lines = [(3.0 + 0.05 * n, 0, 0, 0, 0, 0, 0.8, 0.05, 0.2) for n in range(150)]
    written(tmp_path / "warm.csv", heads, lines)
    design = load_earth_design("hsrs", [f"air.table={tmp_path / 'warm.csv'}"])
    clear = load_earth_design("hsrs", [f"air.table={tmp_path / 'warm.csv'}"])
    clear = replace(clear, air=None)
    found = [EarthProblem(own).expect(["night"]).value for own in (design, clear)]
    assert 0 < found[1] < found[0]


# Two runs as MODTRAN's manual lays out tape7: cards, titles, rows, -9999.
CARDS = """\
M   2    2    2    1    0    0    0    0    0    0    0    0    0   0.000    {albedo}
    1    1    0    0    0    0  23.00000   0.00000   0.00000   0.00000   0.00000
 100.00000   0.00000 180.00000   0.00000   0.00000   0.00000    0
   13000.0   14000.0     250.0     500.0
"""
OLD = (
    "    FREQ  TOT TRANS  PTH THRML  THRML SCT  SURF EMIS   SOL SCAT  SING SCAT  GRND RFLT  "
    "DRCT RFLT  TOTAL RAD  REF SOL  SOL@OBS   DEPTH"
)
NEW = OLD.replace("TOT TRANS", "TOT_TRANS").replace("PTH THRML", "PTH_THRML")
NEW = NEW.replace("THRML SCT", "THRML_SCT").replace("SURF EMIS", "SURF_EMIS")
NEW = NEW.replace("SOL SCAT", "SOL_SCAT").replace("SING SCAT", "SING_SCAT")
NEW = NEW.replace("GRND RFLT", "GRND_RFLT").replace("DRCT RFLT", "DRCT_RFLT")
NEW = NEW.replace("TOTAL RAD", "TOTAL_RAD").replace("REF SOL", "REF_SOL")


def run(path, albedo, titles=OLD):
    """White ground sends 4 W / m2 / sr / um, 3 of it direct; path 1, around 0.5, albedo 0.2."""
    lines = [titles]
    for wavenumber in range(13000, 14001, 250):
        scale = 1 / wavenumber**2  # to W / cm2 / sr / cm-1
        bounce = albedo / (1 - albedo * 0.2)
        ground, scattered = 4 * bounce, 1 + 0.5 * bounce
        row = (0.8, 0.0, 0.0, 0.0, scattered, 0.3, ground, 3 * albedo, scattered + ground)
        first = f"{wavenumber:8.2f}{row[0]:11.8f}"
        rest = "".join(f"{value * scale:11.5E}"[:11].rjust(12) for value in row[1:])
        lines.append(first + rest + f"{0.0:9.2E}{0.0:9.2E}{0.223:8.3f}")
    lines.append(" -9999.")
    path.write_text(CARDS.format(albedo=albedo) + "\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("titles", [OLD, NEW])
def test_two_runs_of_modtran_give_back_the_terms(tmp_path, titles):
    runs = run(tmp_path / "a.tp7", 0.1, titles), run(tmp_path / "b.tp7", 0.6, titles)
    out = tmp_path / "air.csv"
    for n, sun in enumerate((20.0, 40.0)):
        found = import_tape7(runs, (0.1, 0.6), out, RunGeometry(sun_zenith=sun), add=n > 0)
        assert len(found) == 5
    table = load_radiance_table(out)
    assert table.spectrum / um == pytest.approx([10000 / (14000 - 250 * n) for n in range(5)])
    assert table.sun / deg == pytest.approx([20, 40])
    for name, value in {"path": 1.0, "direct": 3.0, "sky": 1.0, "around": 0.5}.items():
        np.testing.assert_allclose(getattr(table, name), 1e6 * value, rtol=1e-3)
    np.testing.assert_allclose(table.backscatter, 0.2, rtol=2e-3)
    np.testing.assert_allclose(table.through, 0.8)


def test_blank_columns_and_heat_of_a_run_without_the_sun(tmp_path):
    """With IEMSCT = 1 the columns of sunlight are blank; 100 W / m2 / sr / um at 10 um."""
    for albedo, name in ((0.1, "a.tp7"), (0.4, "b.tp7")):
        lines = [OLD]
        for wavenumber in (990.0, 1000.0, 1010.0):
            heat, sky = 2.0 / wavenumber**2, 5.0 * albedo / wavenumber**2
            line = f"{wavenumber:8.2f}{0.6:11.8f}{heat:11.4E}{0.0:11.4E}{0.0:11.4E}"
            line += 22 * " " + f"{sky:11.4E}" + 11 * " " + f"{heat + sky:11.4E}" + 18 * " "
            lines.append(line + f"{0.5:8.3f}")
        (tmp_path / name).write_text("\n".join([*lines, " -9999."]) + "\n")
    out = tmp_path / "air.csv"
    import_tape7((tmp_path / "a.tp7", tmp_path / "b.tp7"), (0.1, 0.4), out)
    table = load_radiance_table(out)
    np.testing.assert_allclose(table.rise, 2e6, rtol=1e-3)
    np.testing.assert_allclose(table.fall, 5e6, rtol=1e-3)
    assert not table.sky.any()
    assert not table.path.any()


def test_output_in_nanometre_and_as_csv_is_read(tmp_path):
    """MODTRAN 6: comma-separated, sunlight in two columns; uW / cm2 / sr / nm."""
    for albedo, name in ((0.1, "a.csv"), (0.5, "b.csv")):
        lines = ["FREQ,TOT_TRANS,THRML_EM,MULT_SCAT,SING_SCAT,GRND_RFLT,DRCT_RFLT,TOTAL_RAD"]
        for place in (500, 510, 520):
            lines.append(f"{place},0.9,0,0.06,0.04,{0.4 * albedo},{0.3 * albedo},{0.1 + albedo}")
        (tmp_path / name).write_text("\n".join(lines) + "\n")
    out = tmp_path / "air.csv"
    import_tape7((tmp_path / "a.csv", tmp_path / "b.csv"), (0.1, 0.5), out, unit="nm")
    table = load_radiance_table(out)
    np.testing.assert_allclose(table.path, 1e6, rtol=1e-4)
    np.testing.assert_allclose(table.direct, 3e6, rtol=1e-4)
    np.testing.assert_allclose(table.spectrum, [500e-9, 510e-9, 520e-9])


def test_the_title_of_the_first_column_states_its_unit(tmp_path):
    """tape7.scn in micrometre; a title of two words is one column. W / cm2 / sr / um."""
    for albedo, name in ((0.1, "a.scn"), (0.5, "b.scn")):
        lines = [OLD.replace("    FREQ", " WAVLEN MCRN")]
        for place in (0.5125, 0.5225, 0.5325):
            row = [0.9, 0, 0, 0, 1e-4, 0, 4e-4 * albedo, 3e-4 * albedo, 1e-4 + 4e-4 * albedo, 0, 0]
            lines.append(f"{place:12.6f}" + "".join(f"{value:11.4E}" for value in (*row, 0.2)))
        (tmp_path / name).write_text("\n".join([*lines, " -9999."]) + "\n")
    runs, out = (tmp_path / "a.scn", tmp_path / "b.scn"), tmp_path / "air.csv"
    with pytest.raises(Refused, match=r"unit must be um, that of .* WAVLEN_MCRN, got 'cm-1'"):
        import_tape7(runs, (0.1, 0.5), out)
    import_tape7(runs, (0.1, 0.5), out, unit="um")
    table = load_radiance_table(out)
    np.testing.assert_allclose(table.spectrum, [512.5e-9, 522.5e-9, 532.5e-9])
    np.testing.assert_allclose(table.path, 1e6, rtol=1e-4)
    np.testing.assert_allclose(table.direct, 3e6, rtol=1e-4)


def test_wrong_runs_are_refused(tmp_path):
    first, second = run(tmp_path / "a.tp7", 0.1), run(tmp_path / "b.tp7", 0.6)
    out = tmp_path / "air.csv"
    with pytest.raises(Refused, match="albedos must be two different numbers"):
        import_tape7((first, second), (0.5, 0.5), out)
    with pytest.raises(
        Refused, match=r"wavelengths must lie in \[0\.2, 50\] um, got 1\.3e\+04 to 1\.4e\+04"
    ):
        import_tape7((first, second), (0.1, 0.6), out, unit="um")
    for swapped in ((second, first), (first, first)):
        with pytest.raises(Refused, match="GRND_RFLT / albedo must not fall with the albedo"):
            import_tape7(swapped, (0.1, 0.6), out)
    assert not out.exists()
    import_tape7((first, second), (0.1, 0.6), out, RunGeometry(sun_zenith=20.0))
    with pytest.raises(Refused, match=r"air\.csv must have each geometry once, has .*, 20 already"):
        import_tape7((first, second), (0.1, 0.6), out, RunGeometry(sun_zenith=20.0), add=True)
    out.unlink()
    (tmp_path / "c.tp7").write_text("nothing\n")
    with pytest.raises(Refused, match=r"c\.tp7 must be output of MODTRAN"):
        import_tape7((first, tmp_path / "c.tp7"), (0.1, 0.6), out)
    half = second.read_text().splitlines()
    second.write_text("\n".join(half[:-2]) + "\n")
    with pytest.raises(Refused, match="must have the same wavelengths"):
        import_tape7((first, second), (0.1, 0.6), out)


def test_a_table_as_the_shipped_ones_is_taken_too():
    channel = load_earth_design("fields").camera.channels[1]
    found, wanted = (
        band_of(channel, air, 786e3, 1.0).table.path
        for air in (Air(table=str(shipped("atmosphere/rural-5km.fits"))), Air(visibility=5e3))
    )
    np.testing.assert_array_equal(found, wanted)


def test_heat_of_the_ground_that_the_air_sends_back_is_accepted(tmp_path):
    """At 10 um, under a sky of 2 over ground of 9.5: G = r (2 + 0.05 (1 - r) 9.5) W / m2 / sr / um
    with a backscatter of 0.05; in MODTRAN's W / cm2 / sr / um."""
    for albedo, name in ((0.1, "a.scn"), (0.4, "b.scn")):
        lines = [OLD.replace("    FREQ", " WAVLEN MCRN")]
        ground = 1e-4 * albedo * (2 + 0.05 * (1 - albedo) * 9.5)
        for place in (9.9, 10.0, 10.1):
            row = [0.9, 1e-4, 0, 8.5e-4 * (1 - albedo), 0, 0, ground, 0, 1e-3, 0, 0]
            lines.append(f"{place:12.6f}" + "".join(f"{value:11.4E}" for value in (*row, 0.2)))
        (tmp_path / name).write_text("\n".join([*lines, " -9999."]) + "\n")
    import_tape7(
        (tmp_path / "a.scn", tmp_path / "b.scn"), (0.1, 0.4), tmp_path / "c.csv", unit="um"
    )
    assert len((tmp_path / "c.csv").read_text().splitlines()) == 4
