import matplotlib.pyplot as plt
import pytest

from startrack.io import save_figure


@pytest.mark.parametrize("name", ["no\udcfftext", r"$\frac{", "a $b$", "star\x07"])
def test_any_name_of_a_file_may_stand_in_a_title(tmp_path, name):
    figure, axes = plt.subplots(figsize=(2, 2))
    axes.set_title(name)
    axes.set_xscale("log")
    figure.suptitle(name)
    save_figure(tmp_path / "any.png", figure)
    plt.close(figure)
    assert (tmp_path / "any.png").stat().st_size > 1000
