import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.mappers.voxel_bricks import BITS, KEY_BITS, NONE, VoxelBricks


def voxels(rng, count, dimension, spread, offset=0):
    return rng.integers(-spread, spread, (count, dimension)) + offset


def grown(parts, dimension):
    """Bricks with voxels in portions, and the twin: numbers by voxel, in a dictionary."""
    bricks, twin = VoxelBricks(dimension), {}
    for part in parts:
        given, fresh = bricks.add(part)
        new = {tuple(voxel) for voxel in part.tolist()} - set(twin)
        assert len(fresh) == len(new) and bricks.count == len(twin) + len(new)
        for voxel, number in zip(part.tolist(), given.tolist(), strict=True):
            assert twin.setdefault(tuple(voxel), number) == number
    return bricks, twin


cases = given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    spread=st.sampled_from([2, 12, 40]),
    offset=st.sampled_from([0, -777, 50_000_000]),
    portions=st.integers(1, 5),
)


@settings(max_examples=40)
@cases
def test_numbers_equal_brute_force(seed, dimension, spread, offset, portions):
    rng = np.random.default_rng(seed)
    bricks, twin = grown([voxels(rng, rng.integers(1, 60), dimension, spread, offset) for _ in range(portions)], dimension)
    assert sorted(twin.values()) == list(range(1, len(twin) + 1))
    asked = voxels(rng, 300, dimension, spread + 20, offset)
    place = bricks.places(asked)
    found = np.where(place == NONE, 0, bricks.numbers[place])
    assert found.tolist() == [twin.get(tuple(voxel), 0) for voxel in asked.tolist()]
    np.testing.assert_array_equal(bricks.indices(place[place != NONE]), asked[place != NONE])


@settings(max_examples=40)
@cases
def test_neighbours_equal_brute_force(seed, dimension, spread, offset, portions):
    """Also across bricks, whichever of them came first."""
    rng = np.random.default_rng(seed)
    bricks, twin = grown([voxels(rng, 40, dimension, spread, offset) for _ in range(portions)], dimension)
    index = np.array(list(twin))
    block = bricks.numbers[bricks.places(index)[:, None] + bricks.steps]
    assert sorted(map(tuple, bricks.moves.tolist())) == sorted(itertools.product((-1, 0, 1), repeat=dimension))
    assert not bricks.moves[0].any()
    for voxel, row in zip(index, block, strict=True):
        assert row.tolist() == [twin.get(tuple(voxel + move), 0) for move in bricks.moves.tolist()]
    inner, *others = bricks.parts()
    for move, part in zip(bricks.moves[1:], others, strict=True):
        brick, *cell = np.nonzero(bricks.blocks[(slice(None), *inner)])
        own = bricks.corners[brick] * bricks.side + np.stack(cell, axis=1)
        beside = bricks.blocks[(slice(None), *part)][(brick, *cell)]
        assert beside.tolist() == [twin.get(tuple(voxel), 0) for voxel in (own + move).tolist()]


@settings(max_examples=30)
@cases
def test_bricks_of_boxes_and_of_voxels(seed, dimension, spread, offset, portions):
    rng = np.random.default_rng(seed)
    bricks, twin = grown([voxels(rng, 30, dimension, spread, offset) for _ in range(portions)], dimension)
    rows, index = bricks.voxels()
    assert {tuple(voxel): number for voxel, number in zip(index.tolist(), rows.tolist(), strict=True)} == twin
    low = voxels(rng, 3, dimension, spread, offset)
    high = low + rng.integers(0, 30, (3, dimension))
    found = bricks.meeting(low, high)
    corner, side = bricks.corners, bricks.side
    meets = [((corner[b] * side <= high) & (corner[b] * side + side - 1 >= low)).all(axis=1).any() for b in range(len(corner))]
    assert found.tolist() == np.flatnonzero(meets).tolist()
    assert len(bricks.meeting(low[:0], high[:0])) == 0
    some = rng.permutation(index)[: rng.integers(1, 10)]
    near = [((corner[b] * side - 1 <= some) & (corner[b] * side + side >= some)).all(axis=1).any() for b in range(len(corner))]
    assert bricks.with_voxels(bricks.places(some)).tolist() == np.flatnonzero(near).tolist()


@pytest.mark.parametrize("dimension", [2, 3])
def test_voxels_too_far_away_are_refused_and_nothing_is_added(dimension):
    bricks = VoxelBricks(dimension)
    bricks.add(np.zeros((1, dimension), np.int64))
    reach = 1 << KEY_BITS[dimension] - 1 + BITS[dimension]
    far = np.zeros((2, dimension), np.int64)
    far[1, -1] = reach
    with pytest.raises(InputError, match="expected voxels within"):
        bricks.add(far)
    assert bricks.count == 1 and len(bricks.corners) == 1
    assert bricks.places(far).tolist() == [bricks.places(far[:1])[0], NONE]
    far[1, -1] = reach - 1
    bricks.add(far)
    far[1, -1] = -reach
    bricks.add(far)
    assert bricks.count == 3


def test_without_a_voxel_nothing_is_found():
    assert VoxelBricks(2).places(np.zeros((3, 2), np.int64)).tolist() == [NONE] * 3
