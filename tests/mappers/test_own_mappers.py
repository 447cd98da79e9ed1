"""Mappers that others write: what they get wrong is told, and harms nobody else."""

import copy

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.scoring.protocol import Protocol, evaluate, evaluate_all

POINTS = np.random.default_rng(0).uniform(size=(40, 2))
LABELS = POINTS[:, 0] > 0.5
PROTOCOL = Protocol(gap_seeds=[0], occlusion=False)


class Own(Mapper):
    """Answers with what it was told to."""

    def __init__(self, answer=None, seed=5):
        self.answer, self.seed = answer, seed

    def _fit(self, points, occupied, weight):
        self.share_ = occupied.mean()

    def _probability(self, queries):
        if not len(queries):
            raise ValueError("Found array with 0 sample(s)")
        return self.answer(queries)


@pytest.mark.parametrize("count", [7, 40_000])
@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (
            lambda q: np.tile([0.3, 0.7], (len(q), 1)),
            r"Own._probability: expected shape \(\d+,\), p\(occupied\) of each query, got \(\d+, 2\)",
        ),
        (lambda q: np.full(len(q), 2.0), "Own._probability: expected numbers from 0 to 1, got 2.0"),
        (lambda q: np.full(len(q), np.nan), "Own._probability: expected numbers from 0 to 1, got nan"),
        (lambda q: np.full(len(q), -0.1), "Own._probability: expected numbers from 0 to 1, got -0.1"),
    ],
)
def test_answers_that_are_no_probabilities_are_refused(answer, said, count):
    mapper = Own(answer).fit(POINTS, LABELS)
    with pytest.raises(ValueError, match=said):
        mapper.predict_proba(np.zeros((count, 2)))


def test_nobody_is_asked_about_nothing():
    assert Own().fit(POINTS, LABELS).predict_proba(np.empty((0, 2))).shape == (0, 2)


def test_what_a_mapper_is_given_stays_as_it_is(room):
    """An `_fit` in place would else move the site under the mappers that come next."""

    class Centred(Own):
        def _fit(self, points, occupied, weight):
            points -= points.mean(axis=0)

    given = POINTS.copy()
    with pytest.raises(ValueError, match="read-only"):
        Centred().fit(given, LABELS, np.ones(len(given)))
    np.testing.assert_array_equal(given, POINTS)
    given += 1  # the caller's is as it was
    found = evaluate_all({"own": Centred(), "nearest": NearestMapper()}, room, PROTOCOL)
    assert "read-only" in found.failed["own"]
    assert found.scores["nearest"] == evaluate(NearestMapper(), room, PROTOCOL, "nearest").scores["nearest"]


def test_an_evaluation_leaves_the_mapper_as_it_is(room):
    mapper = Own(lambda queries: np.full(len(queries), 0.3)).fit(POINTS, LABELS)
    before = copy.copy(vars(mapper))
    evaluate(mapper, room, PROTOCOL)
    assert vars(mapper) == before and mapper.seed == 5


def test_what_is_no_mapper_is_refused(room):
    from sklearn.neighbors import KNeighborsClassifier

    with pytest.raises(InputError, match="^mapper: expected a hilbertvae.mappers.mapper.Mapper, got KNeighborsClassifier"):
        evaluate(KNeighborsClassifier(), room, PROTOCOL)


def test_a_reference_is_no_site():
    """`data.test=` takes one; here it has to be opened first."""
    with pytest.raises(InputError, match=r"^site: expected a hilbertvae.site.Site, as open_site makes it, got str"):
        evaluate(Own(lambda queries: np.full(len(queries), 0.3)), "simulated:7", PROTOCOL)
