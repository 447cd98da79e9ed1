import numpy as np
import pytest
from PIL import Image

from hilbertvae.reports.canvas import DPI, new_figure, pixels, save_picture


def drawn():
    figure = new_figure(2, 1)
    figure.subplots().plot([0, 1], [0, 1])
    return figure


def test_a_picture_is_its_figure_s_pixels(tmp_path):
    image = save_picture(drawn(), tmp_path / "made" / "line.png")
    with Image.open(tmp_path / "made" / "line.png") as written:
        assert written.format == "PNG" and written.info["dpi"] == pytest.approx((DPI, DPI), abs=0.1)
        np.testing.assert_array_equal(np.asarray(written), image)
    np.testing.assert_array_equal(image, pixels(drawn()))
    assert image.shape == (DPI, 2 * DPI, 3) and np.ptp(image) > 128


def test_matplotlib_writes_the_same(tmp_path):
    figure = drawn()
    figure.savefig(tmp_path / "line.png")
    with Image.open(tmp_path / "line.png") as written:
        np.testing.assert_array_equal(np.asarray(written)[:, :, :3], save_picture(drawn(), tmp_path / "same.png"))
