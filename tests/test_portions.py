import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.portions import portions


@given(sizes=st.lists(st.integers(0, 9)), most=st.integers(1, 5), most_parts=st.integers(1, 20))
def test_as_many_things_at_a_time_as_are_allowed(sizes, most, most_parts):
    found = list(portions(np.concatenate([[0], np.cumsum(np.array(sizes, int))]), most, most_parts))
    assert [k for some in found for k in range(some.start, some.stop)] == list(range(len(sizes)))
    for some in found:
        count, parts = some.stop - some.start, sum(sizes[some])
        assert 1 <= count <= most and (parts <= most_parts or count == 1)
        if some.stop < len(sizes):  # no room was left for one more
            assert count == most or parts + sizes[some.stop] > most_parts
