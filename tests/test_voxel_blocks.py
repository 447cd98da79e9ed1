import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae import voxel_blocks
from hilbertvae.checks import InputError
from hilbertvae.voxel_blocks import SIDE, NearVoxels, by_block, lattice_index, padded


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]), st.integers(0, 6), st.sampled_from([7, 10**6]), st.booleans(), st.booleans())
def test_near_voxels_are_those_of_a_brute_force_search(seed, dimension, reach, at_once, far, small):
    """Small blocks are those of which a reach spans several."""
    rng = np.random.default_rng(seed)
    resolution_m = 0.25
    edge = SIDE[dimension] * resolution_m
    points = rng.uniform(-2, 2, (5, dimension)) + rng.choice([0.0, -edge, edge - 0.3], dimension)
    if far:
        points += np.array([500_000.0, 5_400_000.0, 300.0])[:dimension]
    found, done = [], []
    patch = pytest.MonkeyPatch()
    with patch.context() as context:
        context.setattr(voxel_blocks, "POINTS_AT_ONCE", 2)
        if small:
            context.setitem(SIDE, dimension, 2)
        near = NearVoxels.of(points, resolution_m, reach * resolution_m if reach else None)
        for blocks, portion in near.portions(at_once):
            found += lattice_index(portion).tolist()
            done.append(blocks)
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * dimension), axis=-1).reshape(-1, dimension)
    expected = {tuple(index) for voxel in np.floor(points / resolution_m).astype(int) for index in (voxel + steps).tolist()}
    assert len(found) == len(expected) and set(map(tuple, found)) == expected
    assert done == sorted(done) and 0 < done[-1] <= len(near.keys)


@pytest.mark.parametrize("dimension", [2, 3])
def test_every_row_is_in_the_block_of_its_key(dimension):
    index = np.random.default_rng(0).integers(-700, 700, (400, dimension))
    rows = []
    for key, part in by_block(index):
        assert (index[part] // SIDE[dimension] == key).all()
        rows += part.tolist()
    assert sorted(rows) == list(range(400))
    assert list(by_block(index[:0])) == []


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_padded_block_is_a_window_of_the_whole(dimension):
    side = SIDE[dimension]
    whole = np.random.default_rng(0).random((4 * side,) * dimension)
    blocks = {key: whole[tuple(slice(k * side, (k + 1) * side) for k in key)] for key in np.ndindex(*(4,) * dimension)}
    del blocks[(0,) * dimension]
    whole[(slice(0, side),) * dimension] = -1
    for before, after in ((3, 5), (0, side), (side, side + 7)):
        expected = whole[(slice(side - before, 2 * side + after),) * dimension]
        np.testing.assert_array_equal(padded(blocks, (1,) * dimension, before, after, -1), expected)


@pytest.mark.parametrize(
    ("points", "resolution_m", "reach_m", "named"),
    [
        (np.zeros((1, 3)), 0.2, 26.0, "reach_m: expected at most 128 voxels"),
        (np.zeros((1, 2)), 0.1, 103.0, "reach_m: expected at most 1024 voxels"),
        (np.zeros((1, 2)), 0.1, 0.0, "reach_m"),
        (np.zeros((1, 2)), np.nan, 1.0, "resolution_m"),
        (np.array([[0.0, 1e300]]), 0.1, 1.0, "outlier"),
        (np.array([[0.0, 0, 0], [1e12, 1e12, 1e12]]), 0.1, 1.0, "outlier"),
        (np.array([[0.0, np.nan]]), 0.1, 1.0, "points"),
    ],
)
def test_bad_input_is_named(points, resolution_m, reach_m, named):
    with pytest.raises(InputError, match=named):
        NearVoxels.of(points, resolution_m, reach_m)
