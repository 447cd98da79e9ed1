import math

import pytest
import torch

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.augmentation import augment, random_balls, scale_counts
from hilbertvae.reconstruction.settings import AugmentationSettings
from hilbertvae.reconstruction.symmetry import apply, symmetries


def random_pair(batch=24, dimension=2, cells=12, seed=0):
    torch.manual_seed(seed)
    target = torch.randint(-1, 2, (batch, *(cells,) * dimension), dtype=torch.int8)
    return torch.where(torch.rand(target.shape) < 0.2, torch.zeros_like(target), target), target


@pytest.mark.parametrize("dimension", [2, 3])
def test_balls_by_an_explicit_loop(dimension):
    """The draws are repeated, and each cell's distance from each of its grid's centres is computed one by one."""
    target = torch.full((5, *(9,) * dimension), -1, dtype=torch.int8)
    occupied = torch.rand(target.shape, generator=torch.Generator().manual_seed(1)) < 0.1
    target[occupied] = 1
    torch.manual_seed(3)
    inside = random_balls(target, 3, [3.0, 7.0])
    torch.manual_seed(3)  # the same draws in the same order
    which = torch.rand(5, 3)
    radius = (3.0 + 4.0 * torch.rand(5, 3)) / 2
    offset = torch.randn(5, 3, dimension)
    length = torch.rand(5, 3) ** (1 / dimension)
    there = torch.rand(5, 3) < 0.5
    assert not there[:, 1:].all() and there[:, 1:].any()
    for k in range(5):
        places = occupied[k].nonzero()
        centres = []
        for ball in range(3):
            place = places[int(which[k, ball] * len(places))]
            centres.append(place + offset[k, ball] / offset[k, ball].norm() * length[k, ball] * radius[k, ball])
        for cell in torch.cartesian_prod(*(torch.arange(9),) * dimension):
            near = [(cell - centre).norm() < radius[k, ball] for ball, centre in enumerate(centres) if ball == 0 or there[k, ball]]
            assert inside[(k, *cell)] == any(near)


def test_a_ball_is_around_any_occupied_cell_alike():
    target = torch.zeros(1, 12, 12, dtype=torch.int8)
    cells = [(0, 0), (3, 7), (11, 11)]
    for cell in cells:
        target[(0, *cell)] = 1
    torch.manual_seed(0)
    inside = random_balls(target.expand(900, 12, 12), 1, [2.0, 2.0])
    count = [int(inside[(slice(None), *cell)].sum()) for cell in cells]
    assert sum(count) == 900 and max(count) - min(count) < 120  # its radius is a cell, and so it holds the one it is around
    two = random_balls(target.expand(900, 12, 12), 2, [2.0, 2.0])
    held = sum(two[(slice(None), *cell)].int() for cell in cells)
    assert set(held.tolist()) == {1, 2} and 240 < (held == 2).sum() < 360  # a second one in half, around another cell in two of three


def test_a_grid_without_occupied_cells_takes_balls_too():
    torch.manual_seed(0)
    assert random_balls(torch.full((3, 8, 8), -1, dtype=torch.int8), 2, [3.0, 6.0]).shape == (3, 8, 8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_balls_stay_near_occupied_cells_and_within_their_sizes(dimension):
    torch.manual_seed(0)
    target = torch.full((40, *(16,) * dimension), -1, dtype=torch.int8)
    target[:, 8] = 1  # a wall
    inside = random_balls(target, 1, [4.0, 8.0])
    for grid in inside:
        cells = grid.nonzero().double()
        assert len(cells) and (cells - cells.mean(dim=0)).norm(dim=1).max() <= 4.0 + 0.5
        assert (cells[:, 0] - 8).abs().min() <= 4.0


def test_the_same_move_for_input_and_target():
    shown, target = random_pair()
    shown = target.clone()
    moved, answer = augment(shown, target, AugmentationSettings(balls=0), 2)
    assert torch.equal(moved, answer)
    # Every grid is there once, moved by one of the eight, each of which got three.
    count = dict.fromkeys(range(8), 0)
    for grid in target:
        found = [
            (k, n)
            for k, move in enumerate(symmetries())
            for n, other in enumerate(answer)
            if torch.equal(apply(grid[None], move)[0], other)
        ]
        assert len(found) == 1
        count[found[0][0]] += 1
    assert set(count.values()) == {3}


def test_few_grids_see_every_move():
    target = random_pair()[1][:1]
    seen = set()
    for _ in range(100):
        (answer,) = augment(target, target, AugmentationSettings(balls=0), 2)[1]
        (move,) = (k for k, move in enumerate(symmetries()) if torch.equal(apply(target, move)[0], answer))
        seen.add(move)
    assert seen == set(range(8))


@pytest.mark.parametrize("dimension", [2, 3])
def test_balls_hide_and_never_reveal(dimension):
    shown, target = random_pair(dimension=dimension)
    settings = AugmentationSettings(symmetric=False, balls=2, ball_diameter_cells=[3.0, 6.0])
    torch.manual_seed(1)
    hidden, answer = augment(shown, target, settings, dimension)
    assert torch.equal(answer, target)
    changed = hidden != shown
    assert (hidden[changed] == 0).all() and changed.flatten(1).any(dim=1).all()
    torch.manual_seed(1)
    assert (hidden[random_balls(target, 2, [3.0, 6.0])] == 0).all()


def test_nothing_on_request():
    shown, target = random_pair()
    found = augment(shown, target, AugmentationSettings(symmetric=False, balls=0), 2)
    assert torch.equal(found[0], shown) and torch.equal(found[1], target)


def test_the_generator_decides_alone():
    shown, target = random_pair()

    def draw(seed):
        torch.manual_seed(seed)
        return augment(shown, target, AugmentationSettings(ball_diameter_cells=[3.0, 6.0]), 2)[0]

    assert torch.equal(draw(5), draw(5)) and not torch.equal(draw(5), draw(6))


@pytest.mark.parametrize("dimension", [2, 3])
def test_grids_stay_on_their_device(dimension):
    """The device without memory refuses to meet tensors of another, as a GPU does."""
    grids = torch.zeros(20, *(8,) * dimension, dtype=torch.int8, device="meta")
    found = augment(grids, grids, AugmentationSettings(balls=3), dimension)
    assert [(part.device.type, part.dtype, part.shape) for part in found] == [("meta", torch.int8, grids.shape)] * 2


@pytest.mark.parametrize("sizes", [[5.0], [7.0, 3.0], [0.0, 3.0], [1.0, 2.0, 3.0]])
def test_sizes_that_are_no_range_are_named(sizes):
    with pytest.raises(InputError, match="augmentation.ball_diameter_cells: expected the smallest and the largest"):
        AugmentationSettings(ball_diameter_cells=sizes)


def test_batches_smaller_than_the_group():
    shown, target = random_pair(batch=3)
    found = augment(shown, target, AugmentationSettings(), 2)
    assert [part.shape for part in found] == [shown.shape] * 2


def detailed_pair(dimension=2, batch=24, cells=12):
    """Each channel of what is shown is made of the labels, so that whatever moves can be told."""
    _, target = random_pair(batch, dimension, cells)
    counts = torch.stack([20 + 30 * (target > 0), 60 * (target < 0)], dim=1).to(torch.int8) * (target != 0).unsqueeze(1)
    places = torch.full((batch, dimension, *target.shape[1:]), 7, dtype=torch.int8) * (target > 0).unsqueeze(1)
    return torch.cat([target.unsqueeze(1), counts, places], dim=1), target


@pytest.mark.parametrize("dimension", [2, 3])
def test_details_move_and_vanish_with_their_cells(dimension):
    shown, target = detailed_pair(dimension)
    settings = AugmentationSettings(balls=2, ball_diameter_cells=[3.0, 6.0], count_factor=1.0)
    torch.manual_seed(2)
    found, answer = augment(shown, target, settings, dimension)
    torch.manual_seed(2)
    labels, again = augment(target, target, settings, dimension)
    assert torch.equal(answer, again) and torch.equal(found[:, 0], labels)
    assert torch.equal(found[:, 1] == 50, labels > 0) and torch.equal(found[:, 2] == 60, labels < 0)
    assert torch.equal(found[:, 3:].abs() == 7, (labels > 0).unsqueeze(1).expand(-1, dimension, *labels.shape[1:]))
    assert {-7, 7} <= set(found[:, 3].unique().tolist())


def test_counts_of_a_grid_are_scaled_by_one_factor():
    shown, _ = detailed_pair(batch=200)
    torch.manual_seed(0)
    found = scale_counts(shown, 4.0)
    assert torch.equal(found[:, [0, 3, 4]], shown[:, [0, 3, 4]]) and torch.equal(found[:, 1:3] > 0, shown[:, 1:3] > 0)
    factors = []
    for grid, before in zip(found, shown, strict=True):
        for channel, code in ((1, 50), (2, 60)):
            (new,) = grid[channel][before[channel] == code].unique().tolist()
            factors.append(math.expm1(new / 12) / math.expm1(code / 12))
    hits, frees = torch.tensor(factors).reshape(-1, 2).T
    torch.testing.assert_close(hits, frees, rtol=0.1, atol=0)  # codes are rounded
    assert 0.23 < hits.min() < 0.3 and 3.3 < hits.max() < 4.4 and 0.8 < hits.log().exp().median() < 1.25


def test_counts_of_one_vote_stay_votes():
    shown = torch.ones(50, 5, 2, 2, dtype=torch.int8)
    assert (scale_counts(shown, 100.0)[:, 1:3] >= 1).all()


@pytest.mark.parametrize("factor", [0.5, 0.0, float("nan")])
def test_a_factor_that_is_none_is_named(factor):
    with pytest.raises(InputError, match="augmentation.count_factor: expected at least 1"):
        AugmentationSettings(count_factor=factor)


@pytest.mark.parametrize("dimension", [2, 3])
def test_votes_move_with_their_targets(dimension):
    shown, target = random_pair(dimension=dimension)
    voted = torch.stack([target, (40 + 10 * target) * (target != 0)], dim=1).to(torch.int8)
    torch.manual_seed(2)
    found, answer = augment(shown, voted, AugmentationSettings(ball_diameter_cells=[3.0, 6.0]), dimension)
    torch.manual_seed(2)
    expected, labels = augment(shown, target, AugmentationSettings(ball_diameter_cells=[3.0, 6.0]), dimension)
    assert torch.equal(found, expected) and torch.equal(answer[:, 0], labels)
    assert torch.equal(answer[:, 1], (40 + 10 * labels) * (labels != 0))
