import numpy as np
import pytest
from matplotlib.colors import to_rgba
from PIL import Image

from hilbertvae.drawing.canvas import DPI, new_figure, outline_gaps, pixels, round_length, save_picture, title_of
from hilbertvae.drawing.colours import GAP_COLOUR, PROBABILITY
from hilbertvae.gaps import Gaps


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


def test_matplotlib_writes_the_same_of_parts_that_have_made_room(tmp_path):
    figure = drawn()
    figure.draw_without_rendering()
    figure.savefig(tmp_path / "line.png")
    with Image.open(tmp_path / "line.png") as written:
        np.testing.assert_array_equal(np.asarray(written)[:, :, :3], save_picture(drawn(), tmp_path / "same.png"))


def test_a_title_is_written_as_it_is():
    axes = new_figure(2, 1).subplots()
    title_of(axes, "drive_$1_$2", fontsize=9)
    title = next(text for text in axes.figure.findobj(lambda part: getattr(part, "get_text", str)() == "drive_$1_$2"))
    assert not title.get_parse_math() and title.get_fontsize() == 9
    pixels(axes.figure)


def test_pixels_show_a_gap_s_outline_where_it_is():
    figure = new_figure(2, 2)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 10), ylim=(0, 10))
    axes.axis("off")
    figure.set_layout_engine("none")
    outline_gaps(axes, Gaps(np.array([[8.0, 7.0]]), np.array([1.0]), 0.1), linewidth=3)
    image = pixels(figure)
    assert image.dtype == np.uint8 and image.shape == (300, 300, 3)
    green = np.abs(image.astype(int) - np.array(to_rgba(GAP_COLOUR)[:3]) * 255).sum(axis=2) < 30
    row, column = np.nonzero(green)
    assert (column.min() + column.max()) / 2 == pytest.approx(240, abs=2)
    assert (row.min() + row.max()) / 2 == pytest.approx(90, abs=2)  # rows of pixels run from the top


def test_a_sheet_shows_the_balls_that_it_cuts():
    axes = new_figure(2, 2).subplots()
    gaps = Gaps(np.array([[2.0, 0.5, 1.0], [9.5, 4.0, 2.9]]), np.array([0.8, 0.6]), 0.2)
    outline_gaps(axes, gaps, height_m=1.5)
    (circle,) = axes.patches  # the second ball does not reach it
    assert tuple(circle.center) == (2.0, 0.5) and circle.radius == pytest.approx(np.sqrt(0.8**2 - 0.5**2))


def test_colours_darken_from_free_to_occupied_and_unknown_has_no_hue():
    colours = PROBABILITY(np.linspace(0, 1, 101))[:, :3]
    luminance = colours**2.2 @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) < 0).all()
    assert np.ptp(PROBABILITY(0.5)[:3]) < 0.01


def test_round_length():
    assert [round_length(metres) for metres in (0.7, 1, 1.9, 2.0, 7.3, 49.9, 200)] == [0.5, 1, 1, 2, 5, 20, 200]
