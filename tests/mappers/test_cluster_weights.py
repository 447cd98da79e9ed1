"""The `cluster` rule: a Hilbert Map's own weight for each cluster, refitted on the site that it maps."""

import pytest
from hilbert_map_toys import fit, gapped, reconstructor

from hilbertvae.mappers import hilbert_map
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.weights import fit_cluster_weights


def test_cluster_weights_are_fitted_without_what_is_to_be_scored(room, monkeypatch):
    """The gaps hidden for that fit are cut from the given cloud, and the network never sees them while it answers for them."""
    shown = []
    made = reconstructor()
    original = type(made).complete
    monkeypatch.setattr(
        type(made), "complete", lambda self, grids, *rest, **named: shown.append(grids) or original(self, grids, *rest, **named)
    )
    cloud = gapped(room)
    mapper = fit(HilbertMap(made, weights="cluster"), cloud)
    hidden, whole = shown
    removed = (hidden == 0) & (whole != 0)
    assert removed.any() and (hidden[~removed] == whole[~removed]).all()
    assert mapper.factors_.shape == (len(mapper.frames_),) and (mapper.factors_ >= 0).all()
    assert (mapper.factors_ != 1).any()


@pytest.mark.parametrize(("calibration", "share"), [("voxels", 1), ("points", 2)])
def test_cluster_weights_for_points_count_occupied_points_twice(room, monkeypatch, calibration, share):
    given = []
    monkeypatch.setattr(
        hilbert_map, "fit_cluster_weights", lambda *known: given.append((known[4], known[-1])) or fit_cluster_weights(*known)
    )
    fit(HilbertMap(reconstructor(), weights="cluster", calibration=calibration), gapped(room))
    ((occupied, counts),) = given
    assert set(counts[occupied]) == {share} and set(counts[~occupied]) == {1}
