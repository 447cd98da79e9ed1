"""Means and spreads against the standard library, and laws that paired differences keep."""

import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.tables.spread import Spread, differences, over_seeds, share_of, spread

numbers = st.floats(-1e3, 1e3)


def runs(least=1, gap_seeds=3):
    return st.dictionaries(st.integers(0, 5), st.lists(numbers, min_size=gap_seeds, max_size=gap_seeds), min_size=least, max_size=4)


def test_nothing_and_one_number():
    assert spread([]) is None and over_seeds([]) is None and over_seeds([[]]) is None
    assert spread([0.5]) == Spread(0.5, None, 1) == over_seeds([[0.5]])


@given(st.lists(st.lists(numbers, min_size=1, max_size=5), min_size=2, max_size=5))
def test_several_runs_spread_by_their_means(found):
    means = [statistics.fmean(run) for run in found]
    seen = over_seeds(found)
    assert seen.mean == pytest.approx(statistics.fmean(means), abs=1e-9)
    assert seen.sd == pytest.approx(statistics.stdev(means), abs=1e-7) and seen.n == len(found)


@given(st.lists(numbers, min_size=2, max_size=8))
def test_one_run_spreads_by_its_gap_seeds(found):
    seen = over_seeds([found])
    assert seen.mean == pytest.approx(statistics.fmean(found), abs=1e-9) and seen.n == len(found)
    assert seen.sd == pytest.approx(statistics.stdev(found), abs=1e-7)


@given(runs(), runs())
def test_differences_turn_their_sign_and_their_mean_is_that_of_the_means(ours, theirs):
    there, back = differences(ours, theirs), differences(theirs, ours)
    assert there.keys() == ours.keys() & theirs.keys()
    assert all(a == -b for seed in there for a, b in zip(there[seed], back[seed], strict=True))
    if there:
        means = [over_seeds([side[seed] for seed in there]).mean for side in (ours, theirs)]
        assert over_seeds(list(there.values())).mean == pytest.approx(means[0] - means[1], abs=1e-6)


def test_one_run_without_training_stands_against_all():
    ours, theirs = {0: [0.5], 1: [0.7]}, {4: [0.2]}
    assert differences(ours, theirs) == {}
    assert differences(ours, theirs, untrained=True) == {0: [pytest.approx(0.3)], 1: [pytest.approx(0.5)]}
    assert differences(theirs, ours, untrained=True) == {0: [pytest.approx(-0.3)], 1: [pytest.approx(-0.5)]}


def test_share():
    assert share_of({0: [1.0, -1.0], 1: [2.0, 0.0]}, lambda value: value > 0) == "2 of 4"
    assert share_of({}, bool) is None and share_of({0: []}, bool) is None
