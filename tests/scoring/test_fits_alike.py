"""Mappers that fit alike are fitted once, and score as if each had been fitted alone."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone

from hilbertvae.checks import InputError
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.mappers.weights import RankWeights
from hilbertvae.scoring.protocol import Protocol, alike, evaluate, evaluate_alike, evaluate_all
from toy_rooms import tiny_reconstructor

PROTOCOL = Protocol(gap_seeds=[0, 3], gap_ratio=0.5, cluster_size_m=3.0)


def network(dimension=2):
    made = tiny_reconstructor(dimension)
    for reading, constant in (("voxels", -0.5), ("points", 1.0)):
        unseen, beyond = np.array([0.3] * 5 + [constant]), np.array([-0.4, constant])
        made.map_weights[reading] = RankWeights(unseen, np.full(18, 0.1), np.full(6, 0.2), beyond=beyond, spread=-0.7).plain()
    return made


@pytest.mark.parametrize("interpolated", [False, "points"])
def test_one_fit_serves_two_calibrations(place, interpolated, monkeypatch):
    made, fitted = network(place.dimension), []
    made.grid = replace(made.grid, interpolated=interpolated)
    plain_fit = HilbertMap._fit
    monkeypatch.setattr(HilbertMap, "_fit", lambda self, *cloud: (fitted.append(self.calibration), plain_fit(self, *cloud)))
    mappers = {"voxels": HilbertMap(made), "near": NearestMapper(), "points": HilbertMap(made, calibration="points")}
    together = evaluate_all(mappers, place, PROTOCOL)
    assert together.failed == {} and set(fitted) == {"voxels"}
    for name, mapper in mappers.items():
        alone = evaluate(clone(mapper).set_params(reconstructor=made) if name != "near" else clone(mapper), place, PROTOCOL, name)
        assert together.scores[name] == alone.scores[name] and together.maps[name] == alone.maps[name]
    assert together.scores["voxels"] != together.scores["points"]
    assert together.seconds["voxels"]["fit"] == together.seconds["points"]["fit"]


class Worn(HilbertMap):
    """Fits as a `HilbertMap` does, and fails when it is asked: of probabilities, or of their spread."""

    def fits_like(self, other):
        return isinstance(other, HilbertMap)

    def predict_proba(self, queries):
        if self.calibration == "points":
            raise MemoryError("too many queries")
        return super().predict_proba(queries)

    def predict_std(self, queries):
        return np.full(len(queries), np.nan)


def test_one_that_fails_takes_none_with_it_that_fits_alike(room):
    made, lines = network(), []
    mappers = {"voxels": HilbertMap(made), "points": Worn(made, calibration="points"), "spread": Worn(made)}
    assert len(alike(mappers)) == 1
    found = evaluate_all(mappers, room, PROTOCOL, lines.append)
    assert found.failed["points"] == "MemoryError: too many queries" and found.failed["spread"].startswith("ValueError: Worn answered ")
    assert found.failed["spread"].endswith(" numbers NaN or infinite") and sum("failed" in line for line in lines) == 2
    assert found.scores == evaluate_all({"voxels": HilbertMap(made)}, room, PROTOCOL).scores and len(found.gaps) == 2


def test_a_reader_of_the_progress_that_is_gone_fails_no_mapper(room):
    def gone(line):
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        evaluate_all({"near": NearestMapper()}, room, PROTOCOL, gone)


@pytest.mark.parametrize(
    "change",
    [{"flips": 1}, {"neighbours": 3}, {"evidence": False}, {"inner_radius_m": 2.0}, {"weights": "cluster"}, {"calibration": "pixels"}],
    ids=lambda change: next(iter(change)),
)
def test_what_differs_in_more_is_fitted_alone(change):
    made = network()
    other = HilbertMap(made, calibration="points").set_params(**change)
    assert len(alike({"one": HilbertMap(made), "other": other})) == 2


def test_one_that_fits_otherwise_is_not_scored_in_the_others_map(room):
    made = network()
    mappers = {
        "voxels": HilbertMap(made),
        "points": HilbertMap(made, calibration="points"),
        "another": HilbertMap(replace(made, card={"other": 1})),
    }
    with pytest.raises(InputError, match="another: expected one that fits as voxels does"):
        evaluate_alike(mappers, room, PROTOCOL)


def test_who_fits_alike():
    made = network()
    cluster = [HilbertMap(made, calibration=reading, weights="cluster") for reading in ("voxels", "points")]
    assert not cluster[0].fits_like(cluster[1])  # their factors are fitted around other weights
    assert HilbertMap(made).fits_like(HilbertMap(made, calibration="points"))
    assert not HilbertMap(made).fits_like(HilbertMap(replace(made, card={"other": 1})))
    assert not NearestMapper().fits_like(NearestMapper())
    assert not HilbertMap(made).fits_like(NearestMapper())
