import itertools

import numpy as np
import pytest
import torch
from torch import nn

from hilbertvae.cloud import Cloud
from hilbertvae.grids.cluster_grids import GridSettings, bin_detailed
from hilbertvae.grids.frame import Frames
from hilbertvae.reconstruction.blocks import (
    CHANNELS_LAST,
    ENCODINGS,
    ResidualBlock,
    find_encoding,
    group_norm,
    hit_free,
    signed,
    spread_channels,
)


def test_encodings_cell_by_cell():
    grids = torch.tensor([[[-1, 0], [1, 1]]], dtype=torch.int8)
    assert signed(grids).tolist() == [[[[-1.0, 0.0], [1.0, 1.0]]]]
    assert hit_free(grids).tolist() == [[[[0.0, 0.0], [1.0, 1.0]], [[1.0, 0.0], [0.0, 0.0]]]]


def test_spread_channels_is_pixel_shuffle_in_the_plane():
    x = torch.randn(2, 12, 3, 3)
    assert torch.equal(spread_channels(x, 2), nn.functional.pixel_shuffle(x, 2))


@pytest.mark.parametrize(("dimension", "stride"), [(2, 3), (3, 2)])
def test_spread_channels_by_an_explicit_loop(dimension, stride):
    size, channels = 2, 2
    x = torch.randn(1, channels * stride**dimension, *(size,) * dimension)
    found = spread_channels(x, stride)
    assert found.shape == (1, channels, *(size * stride,) * dimension)
    for c in range(channels):
        for cell in itertools.product(range(size * stride), repeat=dimension):
            part = 0
            for i in cell:
                part = part * stride + i % stride
            assert found[(0, c, *cell)] == x[(0, c * stride**dimension + part, *(i // stride for i in cell))]


@pytest.mark.parametrize("dimension", [2, 3])
def test_spread_channels_lie_last_whatever_lay_before(dimension):
    x = torch.randn(2, 2 * 2**dimension, *(3,) * dimension)
    last = CHANNELS_LAST[dimension]
    one, other = spread_channels(x, 2), spread_channels(x.to(memory_format=last), 2)
    assert torch.equal(one, other)
    assert one.is_contiguous(memory_format=last) and other.is_contiguous(memory_format=last)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_new_residual_block_changes_nothing_and_learns(dimension):
    block, x = ResidualBlock(dimension, 6), torch.randn(2, 6, *(4,) * dimension)
    assert torch.equal(block(x), x)
    block(x).square().sum().backward()
    assert block.body[-1].weight.grad.abs().sum() > 0


@pytest.mark.parametrize("channels", [3, 16, 20, 96, 160, 256])
def test_group_norm_takes_any_number_of_channels(channels):
    norm = group_norm(channels)
    x = 5 + 3 * torch.randn(2, channels, 8, 8)
    assert norm(x).mean().item() == pytest.approx(0.0, abs=1e-4)
    # A grid's output is its own, whatever else is in the batch.
    torch.testing.assert_close(norm(x)[:1], norm(x[:1]))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_detailed_encoding_cell_by_cell(dimension):
    grids = torch.zeros(2, 3 + dimension, *(2,) * dimension, dtype=torch.int8)
    first, last = (0,) * dimension, (1,) * dimension
    grids[(0, slice(None), *first)] = torch.tensor([1, 48, 24, 120, -60, 30][: 3 + dimension], dtype=torch.int8)
    grids[(1, slice(None), *last)] = torch.tensor([-1, 0, 96, 0, 0, 0][: 3 + dimension], dtype=torch.int8)
    encode, channels = find_encoding("detailed", dimension)
    found = encode(grids)
    assert found.shape == (2, channels, *(2,) * dimension) and found.dtype == torch.float32
    assert found[(0, slice(None), *first)].tolist() == [1, 0, 1, 0.5, 1, -0.5, 0.25][: 4 + dimension]
    assert found[(1, slice(None), *last)].tolist() == [0, 1, 0, 2, 0, 0, 0][: 4 + dimension]
    assert found.count_nonzero() == 2 + 3 + dimension


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", ["hit_free", "detailed"])
def test_what_is_encoded_is_made_in_the_numbers_that_layers_take(dimension, name):
    shape = (2, *(4,) * dimension) if name == "hit_free" else (2, 3 + dimension, *(4,) * dimension)
    grids = torch.randint(-127, 128, shape, dtype=torch.int8)
    encode, _ = ENCODINGS[name]
    with torch.autocast("cpu", torch.bfloat16):
        found = encode(grids)
    assert found.dtype == torch.bfloat16
    assert torch.equal(found, encode(grids).bfloat16())  # rounded once


@pytest.mark.parametrize("dimension", [2, 3])
def test_shares_are_those_of_each_cell_s_votes(dimension):
    """The paper's footnote 1, of a box of two cells a side with votes in three of them."""
    hits, frees = np.zeros((2,) * dimension), np.zeros((2,) * dimension)
    cells = [(0,) * dimension, (1,) * dimension, (0,) * (dimension - 1) + (1,)]
    for cell, (hit, free) in zip(cells, [(3, 17), (5, 0), (0, 8)], strict=True):
        hits[cell], frees[cell] = hit, free
    middles = np.array(cells) - 0.5
    points, weight = np.concatenate([middles, middles]), np.array([3, 5, 0, 17, 0, 8.0])
    asked = weight > 0
    cloud = Cloud(points[asked], np.arange(6)[asked] < 3, weight[asked])
    frames = Frames(np.zeros((1, dimension)), np.eye(dimension)[None], np.array([2.0]))
    grids = torch.from_numpy(bin_detailed(cloud, frames, GridSettings(cells=2, cluster_diameter_m=2.0, inner_radius_m=1.0)))
    encode, channels = find_encoding("shares", dimension)
    found = encode(grids)
    assert found.shape == (1, 1, *(2,) * dimension) and channels == 1
    total = hits + frees
    expected = np.divide(hits - frees, total, out=np.zeros_like(total), where=total > 0)
    np.testing.assert_allclose(found[0, 0], expected, atol=0.05)  # counts are kept to a twelfth of a power of e
    assert found[(0, 0, *cells[1])] == 1 and found[(0, 0, *cells[2])] == -1
