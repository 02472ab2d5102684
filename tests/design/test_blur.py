"""Blur of the lens in pixel or as an angle, in a design file."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

from startrack.design.files import load_design, save_design
from startrack.design.keys import design_keys, design_schema
from startrack.earth.imager import load_imager
from startrack.io import shipped
from startrack.optics.pixel_psf import pixel_psf

EXAMPLE = shipped("designs/noise_only.toml")  # 35 mm, pixels of 11 um
BLUR = "instrument.optics.blur"


def blur_of(*changes, path=EXAMPLE):
    return load_design(path, changes).case.instrument.optics.blur


def test_pixel_and_angle_become_a_length():
    """By hand: 1.2 * 11 um; 20 arcsec are 20 / 206264.806 rad, of 35 mm 3.3937 um."""
    assert blur_of(f"{BLUR}=1.2 pixel") == pytest.approx(13.2e-6, rel=1e-12)
    assert blur_of(f"{BLUR}=1.2 px") == blur_of(f"{BLUR}=1.2 pixel")
    assert blur_of(f"{BLUR}=20 arcsec") == pytest.approx(3.393697e-6, rel=1e-6)
    assert blur_of(f"{BLUR}=3 um") == 3e-6


def test_a_tracker_of_the_catalogue_has_the_blur_that_its_comment_states():
    """The comment of its file has 3.08 um for "0.7 pixel", calculated by hand."""
    path = shipped("trackers/st400.toml")
    assert blur_of(f"{BLUR}=0.7 pixel", path=path) == pytest.approx(blur_of(path=path), rel=1e-12)


def test_the_image_widens_by_so_many_pixels():
    """Variances of Gaussians add: second moments of the images, pixel^2, differ by 1.2^2."""

    def variance(change):
        instrument = load_design(EXAMPLE, [change]).case.instrument
        optics = replace(instrument.optics, psf="gaussian")
        psf = pixel_psf(optics, instrument.detector.pitch, np.array([550e-9]), np.ones(1))
        x = (np.arange(len(psf.table)) - len(psf.table) // 2) / psf.oversampling
        line = psf.table.sum(axis=0)
        return line @ x**2 / line.sum()

    wider = variance(f"{BLUR}=1.5 pixel") - variance(f"{BLUR}=0.9 pixel")
    assert wider == pytest.approx(1.5**2 - 0.9**2, rel=1e-3)


def test_an_angle_is_at_the_image_of_a_near_object():
    """For an object at twice the focal length, the image distance is twice the focal length."""
    near = "instrument.optics.object_distance=70 mm"
    assert blur_of(f"{BLUR}=20 arcsec", near) == pytest.approx(2 * 3.393697e-6, rel=1e-6)


def test_the_final_values_of_all_layers_count(tmp_path):
    """The product has pixels of 5.5 um; `include` and `--set` come after the file below."""
    (tmp_path / "below.toml").write_text(
        f'base = "{EXAMPLE}"\n[instrument.optics]\nblur = "1.2 pixel"\n'
    )
    (tmp_path / "lens.toml").write_text('[instrument.optics]\nfocal_length = "70 mm"\n')
    top = tmp_path / "top.toml"
    top.write_text('base = "below.toml"\ninclude = ["lens.toml"]\n')
    assert blur_of(path=top) == pytest.approx(13.2e-6, rel=1e-12)
    assert blur_of("instrument.detector.pixel_pitch=5 um", path=top) == pytest.approx(6e-6)
    assert blur_of(f"{BLUR}=20 arcsec", path=top) == pytest.approx(2 * 3.393697e-6, rel=1e-6)
    product = tmp_path / "product.toml"
    product.write_text(
        EXAMPLE.read_text()
        .replace('blur = "5 um"', 'blur = "2 pixel"')
        .replace('pixel_pitch = "11 um"\n', "")
        .replace("[instrument.detector]\n", '[instrument.detector]\nproduct = "cmv4000"\n')
    )
    assert blur_of(path=product) == pytest.approx(11e-6, rel=1e-12)


@pytest.mark.parametrize("blur", ["1.2 pixel", "0.7 px", "20 arcsec", "3.3 urad"])
def test_a_saved_design_reads_back_the_same(blur, tmp_path):
    design = load_design(EXAMPLE, [f"{BLUR}={blur}"])
    save_design(tmp_path / "copy.toml", design)
    assert load_design(tmp_path / "copy.toml") == design


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([f"{BLUR}=-1 pixel"], r"--set: instrument\.optics\.blur.* must not be negative"),
        ([f"{BLUR}=2 kg"], r"--set: instrument\.optics\.blur .* pixels or an angle.* got '2 kg'"),
        ([f"{BLUR}=2 pixel", "instrument.optics.focal_length="], "focal_length is missing"),
        ([f"{BLUR}=2 pixel", "instrument.optics.blurr=1"], "blurr is unknown"),
    ],
)
def test_wrong_values_are_refused_with_their_key(changes, words):
    with pytest.raises(ValueError, match=words):
        load_design(EXAMPLE, changes)


def test_bounds_and_variations_are_lengths(tmp_path):
    """Bounds and variations are converted with each design, whose pitch and focal length may
    differ."""
    path = tmp_path / "varied.toml"
    path.write_text(f'base = "{EXAMPLE}"\n[[variation]]\nname = "{BLUR}"\nsigma = "0.1 pixel"\n')
    with pytest.raises(ValueError, match=r"blur: sigma must have a unit that converts to m"):
        load_design(path)
    from startrack.design.variables import DesignSpace, Variable

    case = load_design(EXAMPLE, [f"{BLUR}=1 pixel"]).case
    with pytest.raises(ValueError, match=r"blur must have a unit that converts to m"):
        DesignSpace(case, (Variable(BLUR, "0.5 pixel", "2 pixel"),))
    assert len(DesignSpace(case, (Variable(BLUR, "2 um", "20 um"),))) == 1


def test_keys_and_schema_name_the_units_that_a_file_may_have():
    blur = next(key for key in design_keys() if key.name == BLUR)
    assert blur.unit == "um, pixel, arcsec"
    examples = design_schema()["properties"]["instrument"]["properties"]["optics"]["properties"]
    for text in examples["blur"]["examples"]:
        assert blur_of(f"{BLUR}={text}") > 0


def test_the_channels_of_an_earth_camera_may_have_it_in_pixel_and_as_an_angle(tmp_path):
    """The pixels of HSRS have 30 um; 20 arcsec at its focal length of 46.39 mm are 4.49810 um."""
    camera = tomllib.loads(shipped("cameras/hsrs.toml").read_text(encoding="utf-8"))
    for channel, blur in zip(camera["channels"], ("0.2 pixel", "20 arcsec"), strict=True):
        channel["optics"]["blur"] = blur
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(camera))
    first, second = load_imager("mine.toml", tmp_path).channels
    assert first.optics.blur == pytest.approx(6e-6, rel=1e-12)
    assert second.optics.blur == pytest.approx(4.49810e-6, rel=1e-5)
    camera["channels"][1]["optics"]["blur"] = "1 kg"
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(camera))
    with pytest.raises(
        ValueError, match=r"^channels\[1\]\.optics\.blur must be a length, a number"
    ):
        load_imager("mine.toml", tmp_path)
