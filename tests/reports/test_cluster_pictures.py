import numpy as np
import pytest
from reports_toys import reconstructor

from hilbertvae.gaps import Gaps
from hilbertvae.grids.cluster_grids import bin_grids, find_frames
from hilbertvae.reconstruction.reconstructor import Completion
from hilbertvae.reports.cluster_pictures import (
    completion_rows,
    gapped_clusters,
    in_grid,
    kernel_probability,
    pipeline_picture,
    prior_picture,
    reconstruction_rows,
    sheet,
)
from toy_places import room


def test_sheet_has_x_to_the_right_and_y_up():
    grid = np.zeros((4, 4), np.int8)
    grid[3, 1] = 1  # the last cell along x, the second along y
    assert np.argwhere(sheet(grid)).tolist() == [[1, 3]]
    box = np.zeros((4, 4, 4), np.int8)
    box[3, 1, 0] = 1
    assert np.argwhere(sheet(box, layer=0)).tolist() == [[1, 3]]
    assert not sheet(box).any()


def test_kernel_values_as_probabilities():
    assert kernel_probability(np.array([0.0, np.log(3)]), "bernoulli") == pytest.approx([0.5, 0.75])
    assert kernel_probability(np.array([-1.0, 0.0, 1.0]), "gaussian") == pytest.approx([0, 0.5, 1])


def test_rows_show_input_answer_truth_and_error_on_known_cells_only():
    target = np.full((2, 16, 16), -1, np.int8)
    target[:, 8] = 1
    target[:, 12:] = 0
    shown = target.copy()
    shown[:, 4:10, 3:9] = 0
    values = np.random.default_rng(0).normal(size=target.shape)
    figure = reconstruction_rows(shown, target, values, [Gaps(np.array([[6.5, 5.5]]), np.array([3.0]), 1.0)] * 2)
    panels = [axes for axes in figure.axes if axes.images][:8]
    first = [axes.images[0].get_array() for axes in panels[:4]]
    np.testing.assert_array_equal(first[0], (shown[0].T + 1) / 2)
    np.testing.assert_allclose(first[1], 1 / (1 + np.exp(-values[0].T)))
    np.testing.assert_array_equal(first[2], (target[0].T + 1) / 2)
    np.testing.assert_array_equal(first[3].mask, target[0].T == 0)
    known = ~first[3].mask
    np.testing.assert_allclose(first[3].data[known], (first[1] - (target[0].T == 1))[known])
    for axes in panels:
        (circle,) = axes.patches
        assert (tuple(circle.center), circle.radius) == ((6.5, 5.5), 3.0)
        assert axes.get_xlim() == axes.get_ylim() == (-0.5, 15.5)


def test_completions_stand_between_what_was_shown_and_the_truth():
    target = np.full((2, 16, 16), -1, np.int8)
    target[:, 8] = 1
    shown = target.copy()
    shown[:, 4:10, 3:9] = 0
    guess, *draws = np.random.default_rng(0).normal(size=(4, *target.shape))
    known = np.full(target.shape, 255, np.uint8)
    known[:, :4], known[:, 4:6] = 0, 64  # not to be seen, and half as likely as it takes to be shown in full
    gaps = [Gaps(np.array([[6.5, 5.5]]), np.array([3.0]), 1.0)] * 2
    figure = completion_rows(shown, target, Completion(guess.astype(np.float16), known), np.array(draws), gaps)
    panels = [axes for axes in figure.axes if axes.images][:12]
    assert [axes.get_title() for axes in panels[:6]] == ["input", "guess", "draw 1", "draw 2", "draw 3", "truth"]
    for row in range(2):
        images = [axes.images[0].get_array() for axes in panels[6 * row : 6 * row + 6]]
        np.testing.assert_array_equal(images[0], (shown[row].T + 1) / 2)
        np.testing.assert_array_equal(images[5], (target[row].T + 1) / 2)
        for image, values in zip(images[1:5], [guess, *draws], strict=True):
            plain, fade = 1 / (1 + np.exp(-values[row])), np.repeat([0, 64 / 127.5, 1], [4, 2, 10])[:, None]
            np.testing.assert_allclose(image, (0.5 + fade * (plain - 0.5)).T, atol=2e-3)


def test_clusters_with_gaps_are_those_that_lost_walls():
    target = np.zeros((4, 16, 16), np.int8)
    target[:, 5:8] = 1
    shown = target.copy()
    shown[[1, 3]] = 0
    shown[2, 5, :3] = 0  # too little to look at
    assert gapped_clusters(shown, target, 6).tolist() == [1, 3]
    assert len(gapped_clusters(shown, target, 1)) == 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_pipeline_selects_the_cluster_that_lost_most(dimension):
    site = room(dimension)
    centre = [2.0, 0.2, 1.0][:dimension]
    gaps = Gaps(np.array([centre]), np.array([0.7]), site.resolution_m)
    shown = gaps.cut(site.fit)
    made = reconstructor(dimension)
    frames = find_frames(shown, made.grid, 0)
    figure = pipeline_picture(shown, made, frames, *(bin_grids(cloud, frames, made.grid) for cloud in (shown, site.fit)), gaps)
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]
    assert titles == ["cloud", "cluster", "aligned grid", "reconstruction", "truth"]
    box, ball = figure.axes[0].patches
    assert ball.center == pytest.approx(box.get_xy()[:4].mean(axis=0))
    assert np.hypot(*(np.array(ball.center) - centre[:2])) < ball.radius + 0.7
    assert figure.axes[2].images[0].get_array().min() == 0
    assert all(len(axes.patches) == 1 for axes in figure.axes[2:5])
    figure.draw_without_rendering()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("rotation", ["none", "spread"])
def test_gaps_in_a_grid_hold_the_cells_that_they_cut(dimension, rotation):
    """Cell by cell: in the map's metres a cell's middle lies in the ball, if and only if it does in the grid's cells."""
    site, made = room(dimension), reconstructor(dimension)
    gaps = Gaps(np.array([[2.0, 0.2, 1.0][:dimension], [9.0, 5.0, 1.0][:dimension]]), np.array([0.7, 0.5]), site.resolution_m)
    made.grid.frame.rotation = rotation
    frames, cells = find_frames(site.fit, made.grid, 0), made.grid.cells
    place = np.stack(np.meshgrid(*[np.arange(cells)] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    for cluster in range(len(frames)):
        balls = in_grid(gaps, frames, cluster, cells)
        middles = frames.back((place + 0.5) / cells - 0.5, np.full(len(place), cluster))

        def inside(points, held):
            far = np.linalg.norm(points[:, None] - held.centres, axis=2) < held.radius_m
            return far.any(axis=1)

        np.testing.assert_array_equal(inside(place, balls), inside(middles, gaps))


@pytest.mark.parametrize("dimension", [2, 3])
def test_prior_grids_repeat_with_the_seed(dimension):
    def images(seed):
        figure = prior_picture(reconstructor(dimension), columns=2, rows=2, seed=seed)
        return np.array([axes.images[0].get_array() for axes in figure.axes if axes.images][:4])

    first = images(0)
    assert first.shape == (4, 16, 16) and (first >= 0).all() and (first <= 1).all()
    np.testing.assert_array_equal(first, images(0))
    assert (first != images(1)).any()
