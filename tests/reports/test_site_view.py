import numpy as np
import pytest

from hilbertvae.reports.site_view import fullest_gap, telling_gaps
from toy_places import CAR, in_street


def test_view_has_gaps_in_what_is_shown_and_not_in_the_truth(view):
    assert not view.in_gaps(view.shown).any()
    assert view.in_gaps(view.truth).sum() > 30
    assert view.in_gaps(view.map).any()
    assert (view.map.probability > 0.6).all()
    near = in_street(view.truth.centres + [0, 0, 0.1]) | in_street(view.truth.centres - [0, 0, 0.1]) | in_street(view.truth.centres)
    assert near.mean() > 0.7


def test_heights_are_above_the_ground(view):
    in_car = ((view.truth.centres >= CAR[0] - 0.1) & (view.truth.centres <= CAR[1] + 0.1)).all(axis=1)
    assert view.truth.height_m[in_car].max() == pytest.approx(1.5, abs=0.3)
    assert np.median(view.truth.height_m) == pytest.approx(0, abs=0.3)


def test_car_and_tree_are_told_by_their_size(view):
    found = telling_gaps(view)
    assert found[0].startswith("as large as a car") and found[1].startswith("as large as a tree")
    assert 2 not in found  # nothing above ground
    assert len(telling_gaps(view, 1)) == 1
    assert fullest_gap(view) in (0, 1)
