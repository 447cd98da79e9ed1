import pickle

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.mappers.growing_array import GrowingArray


@given(counts=st.lists(st.integers(0, 9), max_size=12), width=st.sampled_from([(), (2,), (2, 3)]))
def test_rows_are_those_appended(counts, width):
    parts = [np.random.default_rng(k).normal(size=(count, *width)) for k, count in enumerate([3, *counts])]
    grown = GrowingArray(parts[0].copy())
    for part in parts[1:]:
        grown.append(part)
    np.testing.assert_array_equal(grown.rows, np.concatenate(parts))
    assert len(grown) == sum(map(len, parts))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(grown)).rows, grown.rows)


def test_what_is_written_stays():
    grown = GrowingArray(np.zeros(2))
    grown.rows[1] = 5
    grown.append(np.ones(100))
    grown.rows[50] = 7
    grown.append(np.ones(1))
    assert grown.rows[[1, 50]].tolist() == [5, 7]


def test_appending_copies_seldom():
    """A thousand single rows: the buffer is made anew a few times, not a thousand."""
    grown, buffers = GrowingArray(np.zeros(1)), set()
    for _ in range(1000):
        grown.append(np.zeros(1))
        buffers.add(grown.rows.__array_interface__["data"][0])
    assert len(buffers) < 40


def test_spare_room_is_not_pickled():
    grown = GrowingArray(np.zeros(1000))
    grown.append(np.zeros(1))
    assert len(pickle.dumps(grown)) < 1001 * 8 + 500


def test_what_can_t_be_written_to_is_copied_first():
    mapped = np.zeros(3)
    mapped.flags.writeable = False
    grown = GrowingArray(mapped)
    grown.own()
    grown.rows[1] = 5
    assert grown.rows.tolist() == [0, 5, 0] and mapped.tolist() == [0, 0, 0]
    written = np.zeros(3)
    grown = GrowingArray(written)
    grown.own()
    assert grown.rows.base is written or grown.rows is written
