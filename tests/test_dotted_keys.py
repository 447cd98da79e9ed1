"""Nested settings by dotted key."""

from functools import reduce

from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.dotted_keys import leaves

NESTED = st.recursive(st.integers() | st.lists(st.integers()), lambda inner: st.dictionaries(st.sampled_from("abc"), inner, max_size=3))


def count(node):
    return sum(map(count, node.values())) if isinstance(node, dict) else 1


@given(NESTED)
def test_each_key_leads_to_its_value_and_all_are_there(node):
    found = dict(leaves(node, "top"))
    for key, value in found.items():
        assert reduce(lambda at, name: at[name], key.split(".")[1:], node) == value
    assert len(found) == count(node)


def test_as_they_are_typed():
    assert dict(leaves({"seed": 0, "grid": {"cells": 64, "frame": {"rotation": "none"}}, "empty": {}})) == {
        "seed": 0,
        "grid.cells": 64,
        "grid.frame.rotation": "none",
    }
