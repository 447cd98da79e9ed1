import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from hilbertvae.cloud import OCCUPIED_SHARE
from hilbertvae.mappers.vote_share import SHARES, share_features

VOTES = st.integers(0, 10_000)


def test_a_voxel_of_just_that_share_lies_at_zero():
    hits = np.array([0.0, 15.0, 150.0])
    features = share_features(hits, hits / OCCUPIED_SHARE - hits)
    assert features.shape == (3, SHARES)
    np.testing.assert_allclose(features[:, :2], 0, atol=1e-12)
    np.testing.assert_array_equal(features[:, 2], [1, 0, 0])


def test_distances_are_those_of_a_binomial():
    """Of 99 votes and one more, 21 returns are 1.7 deviations above 15: few voxels of just that share have so many."""
    above = share_features(np.array([21.0]), np.array([78.0]))[0, 0]
    assert above == pytest.approx((21 + 0.15 - 15) / binom.std(100, 0.15))


@given(hits=VOTES, frees=VOTES, more=st.integers(1, 100))
def test_a_return_speaks_for_occupied_and_a_beam_that_went_on_against_it(hits, frees, more):
    votes = np.array([[hits, frees], [hits + more, frees], [hits, frees + more]], float)
    plain, returned, passed = share_features(*votes.T)[:, :2]
    assert (returned >= plain - 1e-9).all() and (passed <= plain + 1e-9).all()
