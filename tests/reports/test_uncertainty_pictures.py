import numpy as np
import pytest

from hilbertvae.gaps import random_gaps
from hilbertvae.grids.kernel import NONE, kernel
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reports.canvas import pixels
from hilbertvae.reports.uncertainty_pictures import completions, uncertainty_picture
from toy_rooms import tiny_reconstructor


@pytest.fixture(scope="module")
def fitted(place):
    gaps = random_gaps(place.fit, 1.2, place.resolution_m, 0)
    shown = gaps.cut(place.fit)
    return HilbertMap(tiny_reconstructor(place.dimension)).fit(shown.points, shown.occupied, shown.weight), gaps, place


def test_completions_are_those_of_single_grids(fitted):
    """Where a query lies in a box and was not seen, a map of that box alone would say what is drawn."""
    mapper, gaps, place = fitted
    centre = gaps.centres[0]
    queries = centre + np.random.default_rng(0).uniform(-1, 1, (200, place.dimension))
    nearest = mapper.index_.holding(centre[None], mapper.neighbours)[0]
    found = completions(mapper, queries, centre)
    assert len(found) == min(3, np.count_nonzero(nearest != NONE)) > 0
    for box, probability in zip(nearest, found, strict=False):
        value = kernel(mapper.grids_, mapper.frames_, queries, np.full((len(queries), 1), box))[:, 0]
        inside = np.abs(queries - mapper.frames_.centre[box]).max(axis=1) < mapper.frames_.scale[box] / 2
        weights = mapper.rank_weights_
        expected = np.where(inside, 1 / (1 + np.exp(-(weights.unseen[:-1].sum() * value + weights.unseen[-1]))), 0.5)
        np.testing.assert_allclose(probability, expected, atol=1e-6)


def test_the_picture_has_a_row_for_each_gap(fitted):
    mapper, gaps, place = fitted
    figures = [uncertainty_picture(mapper, place, gaps, list(range(count))) for count in (1, 2)]
    assert [len(figure.axes) for figure in figures] == [6 + 2, 12 + 2]  # and two bars
    assert pixels(figures[0]).std() > 10


def test_where_grids_differ_the_spread_is_drawn(fitted):
    """The panel has `predict_std` at its cells."""
    mapper, gaps, place = fitted
    drawn = uncertainty_picture(mapper, place, gaps, [0]).axes[2].images[0].get_array()
    assert drawn.min() >= 0 and drawn.max() <= 0.5 + 1e-6 and drawn.std() > 0
