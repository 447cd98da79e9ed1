"""Random maps for the tests of exports, and their comparison."""

import numpy as np
from hypothesis import strategies as st

from hilbertvae.exports.map_cells import MapCells

UTM = np.array([456_789, 5_428_345, 118])
"""Metres."""


def random_cells(dimension, seed=0, count=300, span=16, resolution_m=0.1, offset_m=0.0, std=True):
    """Up to `count` distinct cells, `span` cells around `offset_m`; 0, 0.5, 1 and the cuts are among the probabilities."""
    rng = np.random.default_rng(seed)
    index = np.unique(rng.integers(-span // 2, span // 2, (count, dimension)), axis=0)
    index = rng.permutation(index) + np.floor(np.broadcast_to(offset_m, dimension) / resolution_m).astype(np.int64)
    probability = np.where(rng.random(len(index)) < 0.3, rng.choice([0.0, 0.4, 0.5, 0.6, 1.0], len(index)), rng.random(len(index)))
    spread = rng.random(len(index)) if std else np.full(len(index), np.nan)
    return MapCells(index, resolution_m, probability, spread, rng.random(len(index)) < 0.5)


cells_2d, cells_3d = (
    st.builds(
        random_cells,
        dimension=st.just(dimension),
        seed=st.integers(0, 2**32 - 1),
        count=st.integers(1, 300),
        span=st.sampled_from([1, 9, 40]),
        resolution_m=st.sampled_from([0.05, 0.1, 0.2, 1 / 3]),
        offset_m=st.sampled_from([0.0, -37.3, UTM[:dimension]]),
        std=st.booleans(),
    )
    for dimension in (2, 3)
)
any_cells = st.one_of(cells_2d, cells_3d)


def by_index(cells):
    """{index: (probability, std, observed)}."""
    columns = (cells.probability.tolist(), cells.std.tolist(), cells.observed.tolist())
    return dict(zip(map(tuple, cells.index.tolist()), zip(*columns, strict=True), strict=True))


def assert_same(found, expected):
    """The same cells, in any order."""
    assert found.resolution_m == expected.resolution_m and found.dimension == expected.dimension
    found, expected = (cells.select(np.lexsort(cells.index.T)) for cells in (found, expected))
    for name in ("index", "probability", "std", "observed"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
