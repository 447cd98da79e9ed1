"""Colours that mean different things are different colours, also to eyes that lack a kind of cones."""

import re
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from skimage.color import deltaE_ciede2000, rgb2lab

from hilbertvae.drawing.colours import OTHERS, OURS, UNCERTAINTY
from hilbertvae.drawing.lit_colours import GAP_TINT, HEIGHT, LIT, LIT_TINT, PREDICTED_SHARE, UNCERTAINTY_TINT, height_colours, tinted
from hilbertvae.drawing.oblique import TINT
from hilbertvae.exports.page import TEMPLATE

EYES = {
    "usual": np.eye(3),
    "protanope": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranope": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanope": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
"""What is seen of linear red, green and blue (Machado, Oliveira and Fernandes, 2009)."""
PAGE_SHARE = float(re.search(r"mix\(colour, tint, ([.\d]+)\)", TEMPLATE.read_text(encoding="utf-8"))[1])
"""The share of a tint in the page of a 3D map."""


def seen(colours, eye):
    """(N, 3) CIELAB of `colours (N, 3)` in sRGB from 0 to 1, as an eye sees them."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4) @ np.array(EYES[eye]).T
    linear = np.clip(linear, 0, 1)
    return rgb2lab(np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)[None])[0]


def nearest(some, others, eye):
    """The smallest CIEDE2000 between a colour of one list and one of the other; 2 is hardly to be noticed."""
    return deltaE_ciede2000(seen(some, eye)[:, None], seen(others, eye)[None]).min()


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("share", [TINT, PREDICTED_SHARE, PAGE_SHARE])
def test_what_was_filled_in_is_told_from_what_stands_at_any_height(eye, share):
    heights = HEIGHT(np.linspace(0, 1, 60))[:, :3]
    assert nearest((1 - share) * heights + share * np.array(to_rgb(GAP_TINT)), heights, eye) > 17


@pytest.mark.parametrize("eye", EYES)
def test_of_a_surface_and_of_a_recording_as_they_are_written(eye):
    height, all_of = np.linspace(-0.4, 4.4, 60), np.ones(60, bool)
    assert nearest(height_colours(height, all_of) / 255, height_colours(height, ~all_of) / 255, eye) > 17
    likely = LIT(np.linspace(0.6, 1, 60))[:, :3]
    assert nearest(tinted(likely, all_of, LIT_TINT) / 255, likely, eye) > 17


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize(("colours", "tint"), [(LIT, LIT_TINT), (UNCERTAINTY, UNCERTAINTY_TINT)])
def test_on_a_page_a_mark_changes_any_colour(eye, colours, tint):
    plain = colours(np.linspace(0, 1, 60))[:, :3]
    marked = (1 - PAGE_SHARE) * plain + PAGE_SHARE * np.array(to_rgb(tint))
    assert deltaE_ciede2000(seen(plain, eye), seen(marked, eye)).min() > 17


@pytest.mark.parametrize("eye", EYES)
def test_heights_a_metre_apart_differ(eye):
    metres = HEIGHT((np.arange(5) + 0.4) / 4.8)[:, :3]
    assert all(nearest(metres[[low]], metres[[low + 1]], eye) > 10 for low in range(4))


@pytest.mark.parametrize("eye", EYES)
def test_lines_of_several_mappers_are_told_apart(eye):
    """The nearest are a grey and a pink; dashes and markers go with them."""
    drawn = [np.array([to_rgb(colour)]) for colour in (OURS, *OTHERS)]
    assert min(nearest(one, other, eye) for one, other in combinations(drawn, 2)) > 6.5
