import tracemalloc
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from hilbertvae.checks import InputError
from hilbertvae.mappers.packed_array import pack, unpack

KINDS = (np.float16, np.uint8, np.int8, np.float64)


@settings(max_examples=100)
@given(data=st.data(), kind=st.sampled_from(KINDS), shape=arrays.array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=6))
def test_arrays_come_back_to_the_bit(data, kind, shape):
    array = data.draw(arrays.arrays(kind, shape))
    found = unpack(pack(array), kind, shape, "grids")
    assert (found.dtype, found.shape) == (array.dtype, array.shape)
    assert found.tobytes() == array.tobytes()
    found[...] = 0  # can be written


def test_an_array_whose_bytes_lie_otherwise():
    array = np.arange(24, dtype=np.float16).reshape(2, 3, 4).transpose(2, 0, 1)
    np.testing.assert_array_equal(unpack(pack(array), np.float16, (4, 2, 3), "grids"), array)


def test_smooth_logits_take_less_than_half():
    x = np.linspace(-3, 3, 32)
    smooth = np.add.outer(np.add.outer(x, x), x) ** 2 - 8
    assert len(pack(np.float16(np.clip(smooth, -6, 6)))) < smooth.size


GRID = np.arange(100, dtype=np.float16).reshape(10, 10)


@pytest.mark.parametrize(
    ("packed", "message"),
    [
        (pack(GRID)[:-3], "another length"),
        (pack(GRID)[:5], "another length"),
        (np.append(pack(GRID), np.uint8(1)), "another length"),
        (pack(GRID[:9]), "another length"),
        (pack(np.float16(np.zeros(101))), "another length"),
        (np.zeros(0, np.uint8), "another length"),
        (np.full(50, 7, np.uint8), "damaged"),
        (pack(GRID).astype(np.int16), "got int16"),
        (pack(GRID)[None], r"got uint8 \(1, "),
    ],
)
def test_bytes_of_anything_else_are_refused(packed, message):
    with pytest.raises(InputError, match=rf"grids: expected float16 \(10, 10\), packed, .*{message}"):
        unpack(packed, np.float16, (10, 10), "grids")


def test_a_bomb_takes_no_memory():
    bomb = np.frombuffer(zlib.compress(bytes(200_000_000), 9), dtype=np.uint8)
    tracemalloc.start()
    with pytest.raises(InputError, match="another length"):
        unpack(bomb, np.float16, (10, 10), "grids")
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()
