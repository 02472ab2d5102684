"""Section 2.1 both ways: published figures of cameras, and goals that a first design meets."""

import json
import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from startrack.cli import requirements
from startrack.cli.main import main
from startrack.core import Curve, Refused
from startrack.core.units import deg, nm, um
from startrack.design.files import load_design
from startrack.detector import Detector, Scan
from startrack.earth.atmosphere import planck
from startrack.earth.atmosphere.spectra import sun_spectrum
from startrack.earth.geometry import ground_rate
from startrack.earth.imager import (
    Channel,
    Goals,
    Performance,
    Reference,
    first_parameters,
    load_imager,
    load_survey,
    margins_of,
    require_pace,
)
from startrack.earth.imager.band import band_of
from startrack.earth.imager.figures import figures
from startrack.io import shipped
from startrack.optics import Optics

# Height, pixel, sampling and swath in metre, field in degree; None where nothing is published.
# hsrs: DLR's table of BIRD's payload (see catalogs/cameras/hsrs.toml); waoss: DLR, 96 m and 496 km
# from 300 km, 80 degrees; ads40: 64 degrees, pixels of 6.5 um at 62.5 mm
PUBLISHED = {
    "hsrs": (572e3, 370.0, 185.0, 190e3, 19.0),
    "waoss": (300e3, 96.0, 96.0, 496e3, 80.0),
    "ads40": (3e3, 0.312, 0.156, None, 64.0),
}


# Instruments in orbit: see the sources in the file. Light, SNR and NEdT required and measured, and
# the Sun in the bands of Sentinel-2 that its products have.
ORBIT = json.loads((Path(__file__).parents[2] / "oracle/earth_cameras.json").read_text("utf-8"))


@pytest.mark.parametrize("name", PUBLISHED)
def test_figures_are_those_that_are_published(name):
    height, pixel, sampling, swath, field = PUBLISHED[name]
    channel = load_imager(name).channels[0]
    air = None  # geometry knows nothing of it
    found = figures(channel, band_of(channel, air, height, 1.0), height, 0.012, light=1e6)
    assert found.gsd == pytest.approx(pixel, rel=0.01)
    assert found.sampling_across == pytest.approx(sampling, rel=0.01)
    assert found.sampling_along == pytest.approx(sampling, rel=0.01)
    assert found.field / deg == pytest.approx(field, rel=0.015)
    if swath:
        assert found.swath == pytest.approx(swath, rel=0.015)


def goals(**changed) -> Goals:
    asked = {
        "gsd": 10.0,
        "swath": 20e3,
        "height": 600e3,
        "wavelength": 550 * nm,
        "bandwidth": 50 * nm,
        "radiance": 100 / um,
        "snr": 150.0,
        "mtf": 0.2,
        "read_noise": 40.0,
        "efficiency": 0.4,
        "smear": 0.5,
    }
    return Goals(**(asked | changed))


@pytest.mark.parametrize(
    "changed",
    [{}, {"snr": 20.0, "mtf": 0.1}, {"mtf": 0.5, "snr": 20.0}, {"stages": 16, "gsd": 3.0}],
    ids=["snr", "rayleigh", "mtf", "tdi"],
)
def test_the_first_design_meets_its_goals(changed):
    """The forward figures of the design meet the goals: one exactly, the others at least."""
    asked = goals(**changed)
    first = first_parameters(asked)
    kind = Scan("tdi", stages=asked.stages) if asked.stages > 1 else Scan()
    low, high = asked.wavelength - asked.bandwidth / 2, asked.wavelength + asked.bandwidth / 2
    band = Curve((low - 1e-12, low, high, high + 1e-12), (0.0, 1.0, 1.0, 0.0))
    channel = Channel(
        "one",
        Optics(first.focal_length, first.f_number, psf="airy"),
        Detector(
            first.columns,
            100,
            asked.pixel_pitch,
            first.exposure,
            Curve((), (asked.efficiency,)),
            read_noise=asked.read_noise * asked.stages**0.5,
            bits=20,
            full_well=1e7,
            scan=kind,
            pixel_rate=1e9,
        ),
        band,
    )
    rate = asked.speed / asked.height
    found = figures(channel, band_of(channel, None, 1e3, 1.0), asked.height, rate, asked.radiance)
    assert found.gsd == pytest.approx(asked.gsd)
    assert found.swath == pytest.approx(asked.swath, rel=2e-3)
    assert found.clock == pytest.approx(first.clock)
    margins = (
        asked.gsd / found.rayleigh - 1,
        found.snr / asked.snr - 1,
        found.mtf_along / asked.mtf - 1,
    )
    assert min(margins) == pytest.approx(0, abs=0.01)


def test_goals_that_no_lens_meets():
    with pytest.raises(ValueError, match=r"mtf must be at most 0\.573, which pixel and smear"):
        first_parameters(goals(mtf=0.6))
    with pytest.raises(ValueError, match=r"must leave a lens of f/0\.5 or slower"):
        first_parameters(goals(snr=3000.0))


def test_a_rounded_satellite_is_as_fast_as_the_textbook_says():
    """7.56 km/s in a circle at 600 km, 6.91 km/s over ground."""
    assert goals().speed == pytest.approx(6910, rel=2e-3)


def test_snr_by_hand():
    """10,000 electrons, read noise 30, response 1 %: sqrt(10000 + 900 + 10000) = 144.6."""
    channel = Channel(
        "one",
        Optics(0.1, 4.0, psf="airy"),
        Detector(
            100,
            100,
            10e-6,
            1e-3,
            read_noise=30.0,
            prnu=0.01,
            bits=24,
            full_well=1e6,
            scan=Scan(),
            pixel_rate=1e6,
        ),
        Curve((500 * nm, 501 * nm, 599 * nm, 600 * nm), (0.0, 1.0, 1.0, 0.0)),
    )
    band = band_of(channel, None, 1e3, 1.0)
    per_radiance = channel.etendue() * 1e-3 * band.electrons
    found = figures(channel, band, 600e3, 0.01, light=1e4 / per_radiance)
    assert found.electrons == pytest.approx(1e4)
    assert found.noise == pytest.approx(144.57, rel=1e-3)
    assert found.noise_radiance * per_radiance == pytest.approx(found.noise)
    assert found.dynamics == pytest.approx(1e6 / 30, rel=1e-3)


def test_the_command_goes_both_ways(capsys):
    assert main(["requirements", "hsrs", "--json"]) == 0
    study, *told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert study["met"]
    assert study["objective"] == "smallest fire"
    assert study["margins"]["swath"] == pytest.approx(1 - 185 / 191.8, abs=1e-3)
    assert [one["channel"] for one in told] == ["mir", "tir"]
    assert told[0]["gsd"] == pytest.approx(370, rel=0.02)
    assert main(["requirements", str(shipped("scenes/goals.toml")), "--json"]) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["focal_length"] == pytest.approx(21.65e-3, rel=2e-3)  # as the scanner's own
    assert first["columns"] == pytest.approx(2880, rel=2e-3)
    assert math.isfinite(first["data_rate"])
    assert first["aperture"] == max(first[f"for_{each}"] for each in ("rayleigh", "mtf", "snr"))


def test_wrong_goals_are_wrong_use(tmp_path, capsys):
    path = tmp_path / "goals.toml"
    path.write_text(shipped("scenes/goals.toml").read_text().replace("mtf = 0.3", "mtf = 1.3"))
    assert main(["requirements", str(path)]) == 2
    assert "mtf must lie in [0.001, 0.99], got 1.3" in capsys.readouterr().err


def test_asteroidfinder_is_what_is_published():
    """F/3.4, 2 x 2 degrees on four detectors, about 400 cm2 (Hartl et al. 2010)."""
    instrument = load_design(shipped("cameras/asteroidfinder.toml")).case.instrument
    assert 2 * instrument.camera.fov_x / deg == pytest.approx(2.0, rel=0.01)
    assert instrument.optics.area * 1e4 == pytest.approx(400, rel=0.02)
    assert instrument.detector.em_gain > 1


@lru_cache
def predicted(name):
    """Figures of each channel of a camera of the catalogue, by its name."""
    seen = load_survey(shipped(f"scenes/{name}.toml"))
    rate = ground_rate(seen.carrier)
    height = seen.carrier.altitude
    bands = {each: band_of(each, None, height, 1.0) for each in seen.camera.channels}
    return {each: figures(each, band, height, rate) for each, band in bands.items()}


@pytest.mark.parametrize("name", ORBIT)
def test_instruments_in_orbit_lie_between_required_and_measured(name):
    """Not a fit of each band: docs/figures/earth-cameras.md lists the adjusted parameters."""
    bands = ORBIT[name]["bands"]
    assert [channel.name for channel in predicted(name)] == list(bands)
    for channel, found in predicted(name).items():
        told = bands[channel.name]
        assert min(margins_of(channel, found).values()) >= 0, channel.name
        if "snr_required" in told:
            assert told["snr_required"] <= found.snr <= told["snr_measured"], channel.name
        else:
            assert told["nedt_required"] >= found.nedt >= told["nedt_measured"], channel.name


@pytest.mark.parametrize("name", ORBIT)
def test_the_catalogue_has_what_is_published(name):
    for channel in load_imager(name).channels:
        told = ORBIT[name]["bands"][channel.name]
        for key, value in told.items():
            quantity, _, kind = key.partition("_")
            if kind in ("required", "measured"):
                mine = getattr(getattr(channel, kind), quantity)
                scale = um if quantity == "saturation" else 1.0
                assert mine == value or mine * scale == pytest.approx(value), (channel.name, key)
        if "radiance" in told:
            assert channel.reference.radiance * um == pytest.approx(told["radiance"])
        if "saturation_kelvin" in told:
            nodes = np.linspace(9, 14, 5001) * um
            weight = channel.response(nodes) / channel.response(nodes).sum()
            black = planck(nodes, told["saturation_kelvin"]) @ weight
            assert channel.measured.saturation == pytest.approx(black, rel=2e-3)


def test_the_sun_in_the_bands_of_sentinel_2_is_the_published_one():
    """Shipped responses and Sun; the products' values are based on the same measurement of the
    Sun."""
    for channel in load_imager("sentinel2-msi").channels:
        nodes = np.array(channel.response.wavelength)
        fine = np.linspace(nodes[0], nodes[-1], 1001)
        weight = channel.response(fine)
        mine = weight @ sun_spectrum(fine) / weight.sum() * um
        published = ORBIT["sentinel2-msi"]["bands"][channel.name]["irradiance"]
        assert mine == pytest.approx(published, rel=0.01), channel.name


def flat(**changed) -> Channel:
    """One channel, 500 to 600 nm."""
    edges = 500 * nm, 500.01 * nm, 599.99 * nm, 600 * nm
    detector = Detector(
        100,
        100,
        10e-6,
        1e-3,
        Curve((), (0.5,)),
        read_noise=30.0,
        bits=24,
        full_well=1e6,
        scan=Scan(),
        pixel_rate=1e6,
    )
    both = {"response": Curve(edges, (0.0, 1.0, 1.0, 0.0))} | changed
    return Channel("one", Optics(0.1, 4.0, psf="airy"), detector, **both)


def test_a_measured_response_counts_electrons_of_energy():
    """A response to energy has equal electrons per joule at all wavelengths, that of 550 nm."""
    energy = 6.62607015e-34 * 299792458.0 / (550 * nm)
    found = flat().photoelectrons(np.array([510.0, 550.0, 590.0]) * nm)
    assert found == pytest.approx(np.full(3, 0.5 / energy), rel=1e-6)


def test_the_mean_of_columns():
    """The mean of four columns: half of the noise, four times the step, and its modulation.

    At half a cycle per four pixels, the mean of four pixels is a pixel of four times the side.
    """
    light = Reference(100 / um)
    one, four = flat(reference=light), flat(reference=light, average=4)
    band = band_of(one, None, 1e3, 1.0)
    single, mean = (figures(each, band, 600e3, 0.01) for each in (one, four))
    large = replace(one, detector=replace(one.detector, pixel_pitch=40e-6))
    assert mean.snr == pytest.approx(2 * single.snr)
    assert mean.sampling_across == pytest.approx(4 * single.sampling_across)
    assert mean.mtf_across == pytest.approx(figures(large, band, 600e3, 0.01).mtf_across)


def test_lines_of_a_tdi_detector_that_do_not_keep_pace_are_blurred():
    """A lag of half a pixel a stage shifts half a cycle per pixel by 90 degrees: four stages
    cancel."""
    channel = flat()
    square = 10e-6 / channel.optics.focal_length / 0.01
    found = []
    for pace in (None, square, 1.5 * square):
        scan = replace(channel.detector, scan=Scan("tdi", stages=4), exposure=square / 10)
        own = replace(channel, detector=scan, period=pace)
        found.append(figures(own, band_of(own, None, 1e3, 1.0), 600e3, 0.01))
        if pace == 1.5 * square:
            with pytest.raises(Refused, match="period must keep 4 stages within"):
                require_pace(own, pace, 0.01)
    assert found[0].mtf_along == pytest.approx(found[1].mtf_along)
    assert found[2].mtf_along == pytest.approx(0, abs=1e-9)
    assert [one.ahead for one in found] == pytest.approx([0, 0, 3 * 0.5], abs=1e-9)
    words = "\n".join(requirements._figures_text(own, found[2], 600e3, {}))
    assert "SMEARED ALONG        the ground runs +1.5 pixel ahead of the charge" in words
    assert f"lines every {1e3 * square:.4g} ms would match (period)" in words
    assert "SMEARED" not in "".join(requirements._figures_text(own, found[1], 600e3, {}))


def test_an_exposure_longer_than_a_line_says_what_a_line_is_exposed_for():
    channel = flat()
    square = 10e-6 / channel.optics.focal_length / 0.01
    for given, words in ((2 * square, True), (square / 2, False)):
        line = replace(channel.detector, scan=Scan("line"), exposure=given)
        own = replace(channel, detector=line)
        found = figures(own, band_of(own, None, 1e3, 1.0), 600e3, 0.01)
        said = "\n".join(requirements._figures_text(own, found, 600e3, {}))
        assert (f"exposed for {1e3 * square:.4g} ms, not {1e3 * given:.4g} ms" in said) == words


def test_light_that_saturates_has_no_snr():
    channel = flat(reference=Reference(1e9 / um), required=Performance(snr=1.0))
    found = figures(channel, band_of(channel, None, 1e3, 1.0), 600e3, 0.01)
    assert found.snr > 1
    assert margins_of(channel, found) == {"snr": -1.0}


def test_requirements_of_a_channel(tmp_path, capsys):
    channel = flat(
        reference=Reference(100 / um),
        required=Performance(snr=1e6, gsd=60.0),
        measured=Performance(snr=50.0),
    )
    found = figures(channel, band_of(channel, None, 1e3, 1.0), 600e3, 0.01)
    assert margins_of(channel, found) == {
        "snr": pytest.approx(found.snr / 1e6 - 1),
        "gsd": pytest.approx(0.0, abs=1e-12),
    }
    text = shipped("scenes/landsat8-tirs.toml").read_text()
    camera = shipped("cameras/landsat8-tirs.toml").read_text()
    (tmp_path / "strict.toml").write_text(camera.replace('nedt = "0.4 K"', 'nedt = "10 mK"', 1))
    (tmp_path / "scene.toml").write_text(text.replace('"landsat8-tirs"', '"strict.toml"'))
    assert main(["requirements", str(tmp_path / "scene.toml")]) == 3
    told = capsys.readouterr().out
    assert "(required 10 mK, measured 49 mK)" in told
    assert told.count("NOT MET") == 1


def test_what_a_channel_must_not_say(tmp_path):
    with pytest.raises(ValueError, match="band must be left out if response is given"):
        flat(band=Curve((), (0.5,)))
    with pytest.raises(ValueError, match="response must have wavelengths"):
        flat(response=Curve())
    with pytest.raises(ValueError, match="either radiance or temperature must be given, got 2"):
        Reference(1.0, 300.0)
    cold = flat(reference=Reference(temperature=300.0))
    with pytest.raises(ValueError, match=r"reference\.temperature must be left out below"):
        figures(cold, band_of(cold, None, 1e3, 1.0), 600e3, 0.01)
    (tmp_path / "camera.toml").write_text("shared = 3\n[[channels]]\nname = 'a'")
    with pytest.raises(ValueError, match="shared must be a table, got 3"):
        load_imager("camera.toml", tmp_path)


@pytest.mark.parametrize("ends", [(655.05, 655.15), (650.2, 651.0), (600.0, 607.3)])
def test_a_filter_narrower_than_the_table_passes_its_integral(ends):
    """A rectangle of 0.8 between two wavelengths, by hand: 0.8 QE (b^2 - a^2) / (2 h c)."""
    a, b = (end * nm for end in ends)
    band = band_of(flat(response=None, band=Curve((a, b), (0.8, 0.8))), None, 700e3, 1.0)
    hc = 6.62607015e-34 * 299792458.0
    assert band.electrons == pytest.approx(0.8 * 0.5 * (b**2 - a**2) / 2 / hc, rel=1e-9)
    middle = 2 / 3 * (b**3 - a**3) / (b**2 - a**2)
    assert band.weight @ band.wavelength == pytest.approx(middle, rel=1e-9)


def test_the_read_out_channel_lowers_the_mtf_across():
    """If half of the charge is a pixel late: |1 + exp(-i pi)| / 2 = 0 at Nyquist; a quarter late
    0.5."""
    channel = load_survey(shipped("scenes/waoss.toml")).camera.channels[1]
    band = band_of(channel, None, 300e3, 1.0)
    found = [
        figures(
            replace(channel, detector=replace(channel.detector, impulse_response=given)),
            band,
            300e3,
            1e-3,
        )
        for given in ((), (3.0, 1.0), (1.0, 1.0))
    ]
    assert found[1].mtf_across == pytest.approx(found[0].mtf_across / 2)
    assert found[2].mtf_across == pytest.approx(0, abs=1e-12)
    assert found[1].mtf_along == found[0].mtf_along
