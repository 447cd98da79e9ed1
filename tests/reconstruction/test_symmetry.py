import itertools

import numpy as np
import pytest
import torch

from hilbertvae.cloud import Cloud
from hilbertvae.grids.cluster_grids import bin_detailed
from hilbertvae.grids.frame import Frames
from hilbertvae.reconstruction.symmetry import apply, apply_channels, symmetries, undo
from toy_rooms import tiny_grid


def numbered(dimension, cells=4):
    return torch.arange(2 * cells**dimension).reshape(2, *(cells,) * dimension)


@pytest.mark.parametrize("dimension", [2, 3])
def test_eight_different_moves_the_identity_first(dimension):
    grids = numbered(dimension)
    moves = symmetries()
    moved = [apply(grids, move) for move in moves]
    assert len(moves) == 8 and torch.equal(moved[0], grids)
    for a, b in itertools.combinations(moved, 2):
        assert not torch.equal(a, b)


@pytest.mark.parametrize("dimension", [2, 3])
def test_undo_is_the_inverse(dimension):
    grids = numbered(dimension)
    for move in symmetries():
        assert torch.equal(undo(apply(grids, move), move), grids)
        assert torch.equal(apply(undo(grids, move), move), grids)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_moves_are_a_group(dimension):
    grids = numbered(dimension)
    every = [apply(grids, move) for move in symmetries()]
    for first, second in itertools.product(symmetries(), repeat=2):
        both = apply(apply(grids, first), second)
        assert sum(torch.equal(both, one) for one in every) == 1


def test_the_moves_by_an_explicit_loop():
    grids = numbered(2)
    for swap, axes in symmetries():
        moved = apply(grids, (swap, axes))
        for i in range(4):
            for j in range(4):
                a, b = 3 - i if 0 in axes else i, 3 - j if 1 in axes else j
                assert torch.equal(moved[:, i, j], grids[:, b, a] if swap else grids[:, a, b])


def test_up_stays_up():
    grids = torch.arange(4).expand(1, 4, 4, 4)  # a cell's value is its height
    for move in symmetries():
        assert torch.equal(apply(grids, move), grids)


@pytest.mark.parametrize("dimension", [2, 3])
def test_detailed_grids_move_as_the_cloud_does(dimension):
    """A cloud that is mirrored and swapped, and then binned, gives the moved grids: places in cells, too."""
    rng = np.random.default_rng(0)
    settings = tiny_grid(dimension, cells=4)
    cloud = Cloud(rng.uniform(-0.6, 0.6, (200, dimension)) * settings.cluster_diameter_m, rng.random(200) < 0.5, rng.integers(1, 9, 200))
    frames = Frames(np.zeros((1, dimension)), np.eye(dimension)[None], np.array([settings.cluster_diameter_m]))
    grids = torch.from_numpy(bin_detailed(cloud, frames, settings))
    for swap, axes in symmetries():
        points = cloud.points[:, [1, 0, *range(2, dimension)]] if swap else cloud.points.copy()
        points[:, list(axes)] *= -1
        expected = torch.from_numpy(bin_detailed(Cloud(points, cloud.occupied, cloud.weight), frames, settings))
        moved = apply_channels(grids, (swap, axes))
        assert torch.equal(moved[:, :3], expected[:, :3])
        assert (moved[:, 3:].int() - expected[:, 3:].int()).abs().max() <= 1  # of two nearest codes either
    assert grids[:, 3:].any()
