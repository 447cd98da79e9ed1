import itertools

import pytest
import torch

from hilbertvae.reconstruction.symmetry import apply, symmetries, undo


def numbered(dimension, cells=4):
    return torch.arange(2 * cells**dimension).reshape(2, *(cells,) * dimension)


@pytest.mark.parametrize("dimension", [2, 3])
def test_eight_different_moves_the_identity_first(dimension):
    grids = numbered(dimension)
    moves = symmetries(dimension)
    moved = [apply(grids, move) for move in moves]
    assert len(moves) == 8 and torch.equal(moved[0], grids)
    for a, b in itertools.combinations(moved, 2):
        assert not torch.equal(a, b)


@pytest.mark.parametrize("dimension", [2, 3])
def test_undo_is_the_inverse(dimension):
    grids = numbered(dimension)
    for move in symmetries(dimension):
        assert torch.equal(undo(apply(grids, move), move), grids)
        assert torch.equal(apply(undo(grids, move), move), grids)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_moves_are_a_group(dimension):
    grids = numbered(dimension)
    every = [apply(grids, move) for move in symmetries(dimension)]
    for first, second in itertools.product(symmetries(dimension), repeat=2):
        both = apply(apply(grids, first), second)
        assert sum(torch.equal(both, one) for one in every) == 1


def test_the_moves_by_an_explicit_loop():
    grids = numbered(2)
    for swap, axes in symmetries(2):
        moved = apply(grids, (swap, axes))
        for i in range(4):
            for j in range(4):
                a, b = 3 - i if 0 in axes else i, 3 - j if 1 in axes else j
                assert torch.equal(moved[:, i, j], grids[:, b, a] if swap else grids[:, a, b])


def test_up_stays_up():
    grids = torch.arange(4).expand(1, 4, 4, 4)  # a cell's value is its height
    for move in symmetries(3):
        assert torch.equal(apply(grids, move), grids)
