import numpy as np
import pytest

from hilbertvae.cloud import Cloud
from hilbertvae.drawing.raster import Raster
from hilbertvae.mappers.nearest import NearestMapper
from toy_places import HEIGHT_M, WIDTH_M, room


def cloud(points, occupied, weight=None):
    return Cloud(np.array(points, float), np.array(occupied), np.ones(len(points)) if weight is None else np.array(weight, float))


def test_x_runs_right_and_y_up():
    raster = Raster((10, -3), columns=4, rows=2, cell_m=0.5)
    assert raster.extent == (5.0, 7.0, -1.5, -0.5)
    # Lower left cell: [5, 5.5) x [-1.5, -1). The last point lies outside.
    codes = raster.codes(cloud([[5.1, -1.4], [6.9, -1.4], [5.1, -0.6], [7.1, -0.6]], [True, False, False, True]))
    assert codes.tolist() == [[1, 0, 0, -1], [-1, 0, 0, 0]]


def test_queries_and_image_agree_with_the_extent():
    raster = Raster.around(np.array([[-0.31, 0.0], [1.07, 0.42]]), 0.1, margin_m=0.2)
    x, y = (raster.image(column) for column in raster.queries().T)
    left, right, bottom, top = raster.extent
    np.testing.assert_allclose(x, np.broadcast_to(np.arange(raster.columns) * 0.1 + left + 0.05, x.shape))
    np.testing.assert_allclose(y.T, np.broadcast_to(np.arange(raster.rows) * 0.1 + bottom + 0.05, y.T.shape))
    assert left <= -0.51 and right >= 1.27 and bottom <= -0.2 and top >= 0.62


def test_codes_follow_the_rule_of_voxels():
    raster = Raster((0, 0), columns=1, rows=1, cell_m=1.0)
    both = [[0.5, 0.5], [0.5, 0.5]]
    assert raster.codes(cloud(both, [True, False], [15, 85])).item() == 1
    assert raster.codes(cloud(both, [True, False], [14, 86])).item() == -1


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_sheet_that_holds_no_point_is_unknown(dimension):
    """As a slice through a gap in which nothing was measured: where there is nothing to count, numpy counts in whole numbers."""
    raster = Raster((0, 0), columns=3, rows=2, cell_m=1.0, height_m=0.5 if dimension == 3 else None)
    assert raster.codes(cloud([[9.5] * dimension], [True])).tolist() == [[0, 0, 0]] * 2


def test_a_room_drawn_from_its_voxels():
    site = room()
    raster = Raster.around(site.voxels.points, site.resolution_m)
    codes = raster.codes(site.voxels)
    assert np.count_nonzero(codes) == len(site.voxels)
    column, row = int((WIDTH_M / 2 - raster.extent[0]) / 0.1), int((HEIGHT_M / 2 - raster.extent[2]) / 0.1)
    assert codes[row, column] == -1
    line = codes[row]
    walls = np.flatnonzero(line == 1) * 0.1 + raster.extent[0]
    assert walls.min() == pytest.approx(0, abs=0.11) and walls.max() == pytest.approx(WIDTH_M, abs=0.11)


def test_probability_is_the_mapper_s_answer_at_each_cell():
    site = room()
    mapper = NearestMapper(3).fit(site.fit.points, site.fit.occupied)
    raster = Raster((20, -2), columns=30, rows=20, cell_m=0.1)
    image = raster.probability(mapper)
    assert image.shape == (20, 30)
    assert image[7, 11] == mapper.predict_proba([[(20 + 11.5) * 0.1, (-2 + 7.5) * 0.1]])[0, 1]


def test_a_slice_of_3d():
    points = cloud([[0.1, 0.1, 0.5], [0.3, 0.1, 0.5], [0.1, 0.3, 0.7]], [True, False, True])
    raster = Raster((0, 0), columns=2, rows=2, cell_m=0.2, height_m=0.45)
    assert raster.codes(points).tolist() == [[1, -1], [0, 0]]
    np.testing.assert_allclose(raster.queries()[:, 2], 0.5)
    with pytest.raises(ValueError, match="height_m"):
        Raster.around(points.points, 0.2)


def test_coarse_keeps_walls():
    codes = np.full((7, 10), -1, np.int8)
    codes[:, 4] = 1
    codes[0:3, 0:3] = 0
    raster = Raster((0, 0), columns=10, rows=7, cell_m=0.1)
    coarse, extent = raster.coarse(codes, most_cells=4)
    assert coarse.tolist() == [[0, 1, -1, -1], [-1, 1, -1, -1], [-1, 1, -1, -1]]
    assert extent == pytest.approx((0, 1.2, 0, 0.9))
    same, extent = raster.coarse(codes, most_cells=10)
    assert (same == codes).all() and extent == pytest.approx(raster.extent)
