import numpy as np
import pytest

from hilbertvae.drawing.canvas import pixels
from hilbertvae.gaps import random_gaps
from hilbertvae.grids.kernel import NONE, kernel
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reports import uncertainty_pictures
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


def test_where_fewer_grids_hold_a_gap_no_sheet_stands_for_another_one(fitted, monkeypatch):
    """An empty frame would be white, as free space is."""
    mapper, gaps, place = fitted
    drawn = uncertainty_picture(mapper, place, gaps, [0]).axes[:6]
    monkeypatch.setattr(uncertainty_pictures, "completions", lambda *asked: completions(*asked)[:1])
    figure = uncertainty_picture(mapper, place, gaps, [0])
    assert [bool(axes.images) for axes in figure.axes[:6]] == [True] * 4 + [False] * 2
    for axes in figure.axes[:6]:
        assert axes.axison == bool(axes.patches) == bool(axes.images)
    assert [axes.get_title() for axes in figure.axes[:6]] == [axes.get_title() for axes in drawn]


def test_where_grids_differ_the_spread_is_drawn(fitted):
    """The panel has `predict_std` at its cells."""
    mapper, gaps, place = fitted
    image = uncertainty_picture(mapper, place, gaps, [0]).axes[2].images[0]
    drawn, (left, _, bottom, _), voxel_m = image.get_array(), image.get_extent(), place.resolution_m
    rows, columns = drawn.shape
    x, y = (np.round(low / voxel_m) + np.arange(count) + 0.5 for low, count in ((left, columns), (bottom, rows)))
    height = np.full(rows * columns, np.floor(gaps.centres[0, -1] / voxel_m) + 0.5)
    middles = voxel_m * np.stack([*(axis.ravel() for axis in np.meshgrid(x, y)), height], axis=1)
    asked = mapper.predict_std(middles[:, : place.dimension]).reshape(rows, columns)
    np.testing.assert_allclose(drawn, asked, atol=1e-6)
    assert asked.std() > 0
