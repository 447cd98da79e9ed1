"""What a mapper of one's own answers is one probability, and one spread, of each query, or it fails."""

import re

import numpy as np
import pytest

from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.mappers.octomap_mapper import OctoMapMapper
from hilbertvae.scoring.protocol import Protocol, evaluate, evaluate_all
from hilbertvae.site import open_site

PROTOCOL = Protocol(gap_seeds=[0, 3], gap_ratio=0.5, cluster_size_m=3.0)


def answering(said, spread=None):
    class Own(NearestMapper):
        def predict_proba(self, queries):
            return said(super().predict_proba(queries))

    if spread:
        Own.predict_std = lambda self, queries: spread(len(queries))
    return Own()


@pytest.mark.parametrize(
    ("own", "message"),
    [
        (answering(lambda p: p[:, 1]), r"ValueError: Own answered probability of shape \(\d+,\), expected \(\d+, 2\)"),
        (answering(lambda p: np.vstack([p, p[:1]])), r"ValueError: Own answered probability of shape \(\d+, 2\), expected \(\d+, 2\)"),
        (answering(lambda p: p * 1.7), "ValueError: Own answered [0-9]+ of [0-9]+ queries with no probability from 0 to 1"),
        (
            answering(lambda p: np.where(p > 0.5, np.nan, p)),
            r"ValueError: Own answered probability with \d+ of \d+ numbers NaN or infinite",
        ),
        (answering(np.array, lambda n: np.ones((n, 1))), r"ValueError: Own answered spread of shape \(\d+, 1\), expected \(\d+,\)"),
        (answering(np.array, lambda n: np.ones(n + 7)), r"ValueError: Own answered spread of shape \(\d+,\), expected \(\d+,\)"),
    ],
)
def test_other_answers_fail_the_mapper_and_no_other(place, own, message):
    found = evaluate_all({"own": own, "near": NearestMapper()}, place, PROTOCOL)
    assert list(found.scores) == ["near"]
    assert re.match(message, found.failed["own"]), found.failed["own"]


def test_a_map_of_other_voxels_than_the_site_s_is_told(recwarn):
    site = open_site("simulated:900002", 0.2)
    evaluate(OctoMapMapper(), site, PROTOCOL, "octomap")
    told = [str(warning.message) for warning in recwarn if "voxels" in str(warning.message)]
    assert told == ["octomap: its voxels are of 0.1 m, those of simulated:900002 of 0.2: give it resolution_m"]
    recwarn.clear()
    evaluate_all({"octomap": OctoMapMapper(resolution_m=0.2), "near": NearestMapper()}, site, PROTOCOL)
    assert not [warning for warning in recwarn if "voxels" in str(warning.message)]


@pytest.mark.parametrize("beside", [5e-10, -5e-10])
def test_what_rounding_adds_to_a_probability_is_taken_off(place, beside):
    class Own(NearestMapper):
        def _probability(self, queries):
            return super()._probability(queries) + beside

    found = evaluate_all({"own": Own(), "near": NearestMapper()}, place, PROTOCOL)
    assert not found.failed
    assert found.scores["own"]["points"]["gaps"]["f1"] == found.scores["near"]["points"]["gaps"]["f1"]
