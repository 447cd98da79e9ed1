import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.grids.aligned_grid import cell_index
from hilbertvae.grids.frame import Frames
from hilbertvae.grids.kernel import NONE, TIED_M, FrameIndex, kernel, kernels


def random_frames(rng, count, dimension, turned, spread=4.0, one_scale=False):
    rotation = np.tile(np.eye(dimension), (count, 1, 1))
    if turned:
        axes = int(rng.integers(2, dimension + 1))  # in space half of them about the vertical alone
        rotation[:, :axes, :axes] = np.linalg.qr(rng.normal(size=(count, axes, axes)))[0]
    scale = np.full(count, 3.0) if one_scale else rng.uniform(1.0, 5.0, count)
    return Frames(rng.uniform(-spread, spread, (count, dimension)), rotation, scale)


def inside_by_loop(frames, m, query):
    inside = (query - frames.centre[m]) @ frames.rotation[m] / frames.scale[m]
    return inside if all(-0.5 <= x < 0.5 for x in inside) else None


def holding_by_loop(frames, query, nearest):
    """Eq. 8: the `nearest` frames by centre among those whose box holds the query, of equally near ones the first."""
    holds = [m for m in range(len(frames)) if inside_by_loop(frames, m, query) is not None]
    holds.sort(key=lambda m: round(np.linalg.norm(query - frames.centre[m]) / TIED_M))
    return (holds + [NONE] * nearest)[:nearest]


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    count=st.integers(1, 50),
    nearest=st.integers(1, 7),
    turned=st.booleans(),
    spread=st.sampled_from([0.5, 4.0, 12.0]),
)
def test_equations_7_and_8_by_brute_force(seed, dimension, count, nearest, turned, spread):
    rng = np.random.default_rng(seed)
    frames = random_frames(rng, count, dimension, turned, spread)
    queries = rng.uniform(-spread - 3, spread + 3, (25, dimension))
    cells = 4
    grids = rng.normal(size=(count, *(cells,) * dimension)).astype(np.float32)
    holding = FrameIndex(frames).holding(queries, nearest)
    values = kernel(grids, frames, queries, holding)
    assert holding.shape == values.shape == (25, nearest)
    for q, query in enumerate(queries):
        expected = holding_by_loop(frames, query, nearest)
        assert holding[q].tolist() == expected
        for r, m in enumerate(expected):
            if m == NONE:
                assert values[q, r] == 0
            else:
                cell = tuple(int((x + 0.5) * cells) for x in inside_by_loop(frames, m, query))
                assert values[q, r] == grids[m][cell]


@pytest.mark.parametrize("dimension", [2, 3])
def test_sites_a_thousand_kilometres_apart_are_asked_together(dimension):
    """More patches lie between them than one number tells apart; each query has the answer that it has alone."""
    rng = np.random.default_rng(0)
    corner = rng.choice([-8e5, 8e5], (40, 1))
    frames = random_frames(rng, 40, dimension, turned=True)
    index = FrameIndex(replace(frames, centre=frames.centre + corner))
    queries = rng.uniform(-5, 5, (300, dimension)) + rng.choice([-8e5, 8e5], (300, 1))
    together = index.holding(queries, 3)
    np.testing.assert_array_equal(together, [index.holding(query[None], 3)[0] for query in queries])
    assert (together != NONE).any(axis=1).mean() > 0.5


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), dimension=st.integers(2, 3), turned=st.booleans(), kind=st.sampled_from(["f2", "f4", "i1", "u1"]))
def test_between_cells_by_brute_force(seed, dimension, turned, kind):
    """Each cell around a query counts by the part of a cell-sized box about the query that lies in it; what lies outside of the grid, its
    nearest cell has."""
    rng = np.random.default_rng(seed)
    frames, cells = random_frames(rng, 20, dimension, turned), 4
    queries = rng.uniform(-5, 5, (25, dimension))
    grids = rng.integers(-5, 6, (20, *(cells,) * dimension)).astype(kind)
    holding = FrameIndex(frames).holding(queries, 3)
    values = kernel(grids, frames, queries, holding, interpolated=True)
    assert values.dtype == np.float32
    for (q, r), m in np.ndenumerate(holding):
        expected = 0.0
        if m != NONE:
            place = [(x + 0.5) * cells for x in inside_by_loop(frames, m, queries[q])]
            for cell in itertools.product(range(-1, cells + 1), repeat=dimension):
                share = np.prod([max(0.0, min(x + 0.5, c + 1) - max(x - 0.5, c)) for x, c in zip(place, cell, strict=True)])
                expected += share * float(grids[m][tuple(min(max(c, 0), cells - 1) for c in cell)])
        assert values[q, r] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("cells", [16, 64, 192])
@pytest.mark.parametrize("origin", [(0, 0, 0), (5_000_000, 40_000_000, 3200)], ids=["near", "map grid"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_queries_on_a_box_s_lower_sides_are_its_own(dimension, origin, cells):
    """Voxel centres are asked of boxes about voxel centres: by integers it is plain which hold which, and a box that holds one has a cell
    for it, also where coordinates are those of a map grid."""
    rng, voxel_m, half = np.random.default_rng(0), 0.1, cells // 2
    seeds = np.array(origin[:dimension]) + rng.integers(-half, half, (9, dimension))
    frames = Frames((seeds + 0.5) * voxel_m, np.tile(np.eye(dimension), (9, 1, 1)), np.full(9, cells * voxel_m))
    sides = seeds[rng.integers(0, 9, 600)] + rng.choice([-half, half], (600, dimension))  # corners, moved along some axes into the box
    index = np.where(rng.random((600, dimension)) < 0.5, sides, sides + rng.integers(-half, half, (600, dimension)))
    queries = (index + 0.5) * voxel_m
    steps = index[:, None] - seeds
    holds = ((steps >= -half) & (steps < half)).all(axis=2)
    found = FrameIndex(frames).holding(queries, 9)
    assert [sorted(row[row != NONE]) for row in found] == [np.flatnonzero(row).tolist() for row in holds]
    cell, inside = cell_index(frames, queries.repeat(9, axis=0), np.tile(np.arange(9), 600), cells)
    np.testing.assert_array_equal(inside.reshape(600, 9), holds)
    expected = np.ravel_multi_index(tuple(np.clip(steps + half, 0, cells - 1).reshape(-1, dimension).T), (cells,) * dimension)
    np.testing.assert_array_equal(cell[inside], expected[inside])


@pytest.mark.parametrize("dimension", [2, 3])
def test_of_boxes_equally_near_the_first_comes_first_wherever_the_site_lies(dimension):
    """On a lattice many are, and rounding, which differs from place to place, must not say which."""
    rng, voxel_m = np.random.default_rng(0), 0.2
    middles, asked = rng.integers(-12, 12, (2, 120, dimension))
    found = []
    for corner in (0, 16, 2_496_000):
        frames = Frames((middles + corner) * voxel_m, np.tile(np.eye(dimension), (120, 1, 1)), np.full(120, 4.0))
        queries = (asked + corner + 0.5) * voxel_m
        found.append(FrameIndex(frames).holding(queries, 5))
        np.testing.assert_array_equal(found[-1], [holding_by_loop(frames, query, 5) for query in queries])
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
    held = np.linalg.norm(np.where(found[0] == NONE, np.nan, 1)[..., None] * (middles[found[0]] - asked[:, None] - 0.5), axis=2)
    assert (np.diff(held, axis=1) == 0).any(axis=1).mean() > 0.2


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_box_that_holds_a_query_has_a_cell_for_it(dimension):
    """Also just below the box's upper side, nearer to it than cells are told apart, as float32 coordinates come to lie."""
    frames = Frames(np.zeros((1, dimension)), np.eye(dimension)[None], np.full(1, 1.6))
    below = np.float32([0.8 - 1e-6, 0.8 - 6e-8, 0.8 - 2e-8]).astype(float)
    queries = np.array(list(itertools.product([-0.8, 0.3, *below], repeat=dimension)))
    inside = cell_index(frames, queries, np.zeros(len(queries), int), 16)[1]
    assert 0 < inside.sum() < len(queries)  # what is binned there lies in the next box
    holding = FrameIndex(frames).holding(queries, 1)
    assert (holding == 0).all()
    grids = np.arange(1.0, 1 + 16**dimension, dtype=np.float32).reshape(1, *(16,) * dimension)
    places = np.minimum(np.floor((queries + 0.8) / 0.1 + 1e-9).astype(int), 15)
    np.testing.assert_array_equal(kernel(grids, frames, queries, holding)[:, 0], grids[0][tuple(places.T)])


@pytest.mark.parametrize("dimension", [2, 3])
def test_between_cells_a_slope_is_a_slope_and_a_middle_its_cell(dimension):
    rng = np.random.default_rng(0)
    frames = Frames(np.zeros((1, dimension)), np.eye(dimension)[None], np.ones(1))
    cells, holding = 8, np.zeros((50, 1), np.int64)
    middles = [(np.arange(cells) + 0.5) / cells - 0.5] * dimension
    slope = sum(weight * axis for weight, axis in zip((1.0, -2.0, 0.5), np.meshgrid(*middles, indexing="ij"), strict=False))
    queries = rng.uniform(-0.5 + 0.5 / cells, 0.5 - 0.5 / cells, (50, dimension))
    expected = queries @ np.array((1.0, -2.0, 0.5))[:dimension]
    np.testing.assert_allclose(kernel(slope[None], frames, queries, holding, interpolated=True)[:, 0], expected, atol=1e-6)
    grids = rng.normal(size=(1, *(cells,) * dimension)).astype(np.float32)
    queries = np.array(list(itertools.product(*middles)))[:50]
    read = [kernel(grids, frames, queries, holding, interpolated) for interpolated in (False, True)]
    np.testing.assert_allclose(*read, atol=1e-6)


@pytest.mark.parametrize("interpolated", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_several_grids_are_read_as_each_alone(dimension, interpolated):
    rng = np.random.default_rng(0)
    frames = random_frames(rng, 30, dimension, True)
    queries = rng.uniform(-6, 6, (200, dimension))
    holding = FrameIndex(frames).holding(queries, 4)
    shape = (30, *(5,) * dimension)
    several = [rng.normal(size=shape).astype(np.float16), rng.integers(0, 256, shape).astype(np.uint8)]
    for found, grids in zip(kernels(several, frames, queries, holding, interpolated), several, strict=True):
        np.testing.assert_array_equal(found, kernel(grids, frames, queries, holding, interpolated))
        assert found.dtype == np.float32 and found.any()


def test_more_frames_than_are_tried_at_first():
    """Forty turned boxes nested around one place: the nearest candidates don't settle it, and the search has to widen."""
    rng = np.random.default_rng(0)
    centre = rng.normal(0, 0.5, (60, 2))
    angle = rng.uniform(0, 2 * np.pi, 60)
    rotation = np.stack([np.stack([np.cos(angle), np.sin(angle)], 1), np.stack([-np.sin(angle), np.cos(angle)], 1)], 1)
    scale = np.where(np.arange(60) % 4, 0.2, 6.0)  # three of four are too small to hold anything
    frames = Frames(centre, rotation, scale)
    queries = rng.uniform(-2, 2, (200, 2))
    found = FrameIndex(frames).holding(queries, 5)
    assert [row.tolist() for row in found] == [holding_by_loop(frames, query, 5) for query in queries]
    assert (found != NONE).any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_frames_closer_together_than_the_queries_that_are_asked_together(dimension):
    """Queries share candidates by place; where frames crowd, what is near to one of them is not near to all."""
    rng = np.random.default_rng(0)
    frames = random_frames(rng, 3000, dimension, False, spread=0.6, one_scale=True)
    queries = rng.uniform(-0.6, 0.6, (150, dimension))
    found = FrameIndex(frames).holding(queries, 5)
    for query, row in zip(queries, found, strict=True):
        np.testing.assert_array_equal(row, np.argsort(np.linalg.norm(frames.centre - query, axis=1))[:5])  # every box holds all


def test_more_grids_asked_for_than_there_are():
    frames = random_frames(np.random.default_rng(0), 3, 2, False, spread=0.1, one_scale=True)
    found = FrameIndex(frames).holding(np.zeros((1, 2)), 8)
    assert sorted(found[0, :3].tolist()) == [0, 1, 2] and (found[0, 3:] == NONE).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_outside_of_all_boxes(dimension):
    frames = random_frames(np.random.default_rng(0), 20, dimension, True)
    queries = np.full((3, dimension), [[50.0], [1e4], [-1e5]])
    index = FrameIndex(frames)
    assert (index.holding(queries, 5) == NONE).all()
    grids = np.ones((20, *(4,) * dimension), np.float32)
    assert not kernel(grids, frames, queries, index.holding(queries, 5)).any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_query_very_far_away_does_not_hurt_the_others(dimension):
    """Answers are given query by query, so one bad coordinate in a batch must not stop the batch."""
    frames = random_frames(np.random.default_rng(0), 20, dimension, True)
    near = np.random.default_rng(1).uniform(-3, 3, (10, dimension))
    far = np.full((1, dimension), 1e12)
    together = FrameIndex(frames).holding(np.concatenate([near, far]), 5)
    np.testing.assert_array_equal(together[:10], FrameIndex(frames).holding(near, 5))
    assert (together[10] == NONE).all()


def test_no_frames_and_no_queries():
    none = Frames(np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
    assert (FrameIndex(none).holding(np.zeros((4, 2)), 5) == NONE).all()
    some = random_frames(np.random.default_rng(0), 3, 2, False)
    assert FrameIndex(some).holding(np.empty((0, 2)), 5).shape == (0, 5)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    turned=st.booleans(),
    pieces=st.integers(1, 6),
    interpolated=st.booleans(),
)
def test_each_query_is_answered_alone(seed, dimension, turned, pieces, interpolated):
    rng = np.random.default_rng(seed)
    frames = random_frames(rng, 40, dimension, turned, one_scale=True)
    # Seeds of a lattice: many queries are equally far from several centres.
    frames = Frames(np.round(frames.centre), frames.rotation, frames.scale)
    queries = np.concatenate([rng.uniform(-5, 5, (30, dimension)), rng.integers(-8, 9, (30, dimension)) / 2])
    index, grids = FrameIndex(frames), rng.normal(size=(40, *(6,) * dimension)).astype(np.float32)

    def answer(part):
        holding = index.holding(part, 5)
        return np.concatenate([holding, kernel(grids, frames, part, holding, interpolated)], axis=1)

    whole, order = answer(queries), rng.permutation(60)
    np.testing.assert_array_equal(answer(queries[order]), whole[order])
    cuts = np.sort(rng.integers(0, 61, pieces))
    np.testing.assert_array_equal(np.concatenate([answer(part) for part in np.split(queries, cuts)]), whole)
