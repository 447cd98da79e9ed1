import numpy as np
from export_toys import random_cells
from matplotlib.colors import to_rgb

from hilbertvae.drawing.lit_colours import GAP_TINT, PREDICTED_SHARE, height_colours
from hilbertvae.exports.cell_heights import heights_above_ground


def test_colours_of_heights_tell_predicted_cells():
    cells = random_cells(3)
    colours = height_colours(heights_above_ground(cells), ~cells.observed).astype(int)
    for z in np.unique(cells.index[:, 2]):
        level = cells.index[:, 2] == z
        seen, predicted = (np.unique(colours[level & part], axis=0) for part in (cells.observed, ~cells.observed))
        assert len(seen) <= 1 and len(predicted) <= 1
        if len(seen) and len(predicted):
            tint = 255 * np.array(to_rgb(GAP_TINT))
            np.testing.assert_allclose(predicted[0], (1 - PREDICTED_SHARE) * seen[0] + PREDICTED_SHARE * tint, atol=1.5)


def test_no_cells_have_no_heights():
    assert heights_above_ground(random_cells(3).select(np.zeros(0, int))).shape == (0,)
