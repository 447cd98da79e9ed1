"""Clouds that tests of several starts share."""

import numpy as np
from hypothesis import strategies as st

clouds = st.builds(
    lambda state, count, dimension, cells: np.random.default_rng(state).normal(0, 1, (count, dimension)).round(cells),
    st.integers(0, 2**32 - 1),
    st.integers(1, 60),
    st.integers(2, 3),
    st.sampled_from([1, 9]),  # of the coarse ones some points coincide
)
"""(N, D) arrays, D 2 or 3."""
UTM = np.array([4.5e5, 5.4e6])
"""An origin far away: squared coordinates have no digits left for distances."""


def are_among(found: np.ndarray, points: np.ndarray) -> bool:
    """Whether each row is one of the points, to the bit."""
    return {tuple(row) for row in found} <= {tuple(row) for row in points}


def shares(draw, runs: int) -> dict:
    """How often each outcome came in `runs` calls of `draw(run)`."""
    drawn = [draw(run) for run in range(runs)]
    return {outcome: drawn.count(outcome) / runs for outcome in set(drawn)}


def assert_same_law(ours: dict, theirs: dict, runs: int) -> None:
    """Shares of outcomes differ by no more than four standard deviations of the difference of two shares."""
    assert len(theirs) > 3
    for outcome in set(ours) | set(theirs):
        share = (ours.get(outcome, 0) + theirs.get(outcome, 0)) / 2
        assert abs(ours.get(outcome, 0) - theirs.get(outcome, 0)) <= 4 * np.sqrt(2 * share * (1 - share) / runs)
