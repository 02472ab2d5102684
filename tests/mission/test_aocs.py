"""The exported C, compiled, has the errors of trials and the spectrum of its own model."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack import Fidelity, load_design, run_trials, shipped
from startrack.design import turning
from startrack.mission.aocs import head_model, write_model

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
CASE = load_design(shipped("designs/nanosatellite.toml")).case
MAIN = """
#include "startrack_head.h"
#include <stdio.h>
#include <stdlib.h>
/* heads frames interval rate sun: the errors and whether there is an attitude, in binary */
int main(int count, char **word)
{
    long heads = atol(word[1]), frames = atol(word[2]), h, f;
    double out[4];
    startrack_head head;
    for (h = 0; h < heads && count > 5; h++) {
        startrack_start(&head, (uint64_t)h);
        for (f = 0; f < frames; f++) {
            double interval = atof(word[3]), rate = atof(word[4]), sun = atof(word[5]);
            out[3] = startrack_frame(&head, interval, rate, sun, 4, 4, 0, out);
            fwrite(out, sizeof out, 1, stdout);
        }
    }
    {
        double truth[4] = {0.5, -0.5, 0.1, 0.7}, error[3] = {0.01, -0.02, 0.03}, got[4];
        startrack_measure(truth, error, got);
        fwrite(got, sizeof got, 1, stdout);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def model():
    return head_model(CASE, "nanosatellite")


@pytest.fixture(scope="module")
def run(model, tmp_path_factory):
    if COMPILER is None:
        pytest.skip("needs a C compiler")
    folder = tmp_path_factory.mktemp("c")
    write_model(folder, model)
    (folder / "main.c").write_text(MAIN)
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    subprocess.run(
        [COMPILER, *strict, "main.c", "startrack_head.c", "-lm", "-o", "main"],
        cwd=folder,
        check=True,
    )

    def call(heads, frames, interval, rate, sun=4.0):
        command = [folder / "main", *map(str, (heads, frames, interval, rate, sun))]
        numbers = np.frombuffer(subprocess.run(command, capture_output=True, check=True).stdout)
        return numbers[:-4].reshape(heads, frames, 4), numbers[-4:]

    return call


@pytest.mark.parametrize("smear", [pytest.param(0.0, marks=pytest.mark.slow), 0.7, 2.0])
def test_errors_are_those_of_trials(run, smear):
    """Rms of many heads beside 1000 trials on the sky: within 10 %, five standard errors."""
    rate = smear / CASE.instrument.camera.focal_length_px / CASE.instrument.detector.exposure
    trials = run_trials(turning(CASE, rate), 1, range(1000), Fidelity.COVARIANCE)
    right = trials["solved"] & ~trials["false"]
    errors = run(3000, 2, 0.1, rate)[0][:, 1]
    for axes, columns in (("xy", [0, 1]), ("z", [2])):
        expected = np.mean([(trials[f"error_{axis}"][right] ** 2).mean() for axis in axes])
        got = np.sqrt((errors[:, columns] ** 2).mean() / expected)
        assert got == pytest.approx(1, abs=0.10), axes
    assert errors[:, 3].mean() == pytest.approx(right.mean(), abs=0.01)


def test_the_spectrum_is_that_of_the_model(run, model):
    """Power in bands of frequency: white noise and two first-order Markov processes."""
    rate, frames, heads = 0.0005, 4096, 200
    errors = run(heads, frames, model.period, rate)[0][..., :3]
    power = np.abs(np.fft.rfft(errors, axis=1)[:, 1:-1]) ** 2 / frames
    frequency = np.arange(1, frames // 2) / frames
    cosine = np.cos(2 * np.pi * frequency)
    for axis, k in ((0, 0), (2, 1)):
        expected = np.full(len(cosine), np.interp(rate, model.rate, model.noise[k]) ** 2)
        for table, length in ((model.pixel, model.pixel_length), (model.field, model.field_length)):
            keep = np.exp(-model.period * rate / length)
            size = np.interp(rate, model.rate, table[k]) ** 2
            expected += size * (1 - keep**2) / (1 - 2 * keep * cosine + keep**2)
        for low, high in ((0, 0.01), (0.01, 0.05), (0.05, 0.2), (0.2, 0.5)):
            band = (frequency > low) & (frequency < high)
            ratio = power[:, band, axis].mean() / expected[band].mean()
            assert ratio == pytest.approx(1, abs=0.05), (axis, low)


def test_the_head_is_blind_beside_the_sun_and_when_too_fast(run, model):
    assert run(5, 100, 0.1, 0.0, model.sun - 0.01)[0][..., 3].max() == 0
    assert run(5, 100, 0.1, 0.0, model.sun + 0.01)[0][..., 3].min() == 1
    assert run(5, 100, 0.1, 2 * model.rate[-1])[0][..., 3].max() == 0


def test_the_quaternion_is_that_of_scipy(run):
    truth = Rotation.from_quat([0.5, -0.5, 0.1, 0.7])
    expected = Rotation.from_rotvec([0.01, -0.02, 0.03]) * truth
    got = run(1, 1, 0.1, 0.0)[1]
    assert (Rotation.from_quat(got) * expected.inv()).magnitude() < 1e-12


def test_the_data_are_those_of_the_code(model, tmp_path):
    write_model(tmp_path, model)
    table = json.loads((tmp_path / "startrack_head.json").read_text())
    assert table["noise"][0] == list(model.noise[0])
    assert "scalar last" in table["convention"]
    assert model.latency > CASE.instrument.detector.exposure / 2
    assert repr(model.noise[1][0]) in (tmp_path / "startrack_head_data.h").read_text()
