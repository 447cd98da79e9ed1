import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from hilbertvae.checks import InputError
from hilbertvae.mappers.constant import ConstantMapper, GapCentreMapper

POINTS, OCCUPIED = np.random.default_rng(0).normal(size=(40, 2)) * 5, np.arange(40) % 3 == 0


def test_constant_answers_the_same_everywhere_and_needs_no_second_class():
    assert (ConstantMapper().fit(POINTS, OCCUPIED).predict_proba(POINTS)[:, 1] == 1.0).all()
    assert (ConstantMapper(0.2).fit(POINTS, np.ones(40, bool)).predict_proba(POINTS)[:, 1] == 0.2).all()
    for none in (1.5, -0.1, "a"):
        with pytest.raises(InputError, match="probability: expected"):
            ConstantMapper(none).fit(POINTS, OCCUPIED)


def test_gap_centre_ranks_by_minus_the_distance():
    centres = np.array([[0.0, 0.0], [6.0, 1.0], [-4.0, 3.0]])
    distance = np.array([min(np.linalg.norm(point - centre) for centre in centres) for point in POINTS])
    score = GapCentreMapper(centres).fit(POINTS, OCCUPIED).predict_proba(POINTS)[:, 1]
    assert roc_auc_score(OCCUPIED, score) == roc_auc_score(OCCUPIED, -distance)
    far = GapCentreMapper(centres).fit(POINTS, OCCUPIED).predict_proba([[1e3, 0.0], [1e6, 0.0], [1e9, 0.0]])[:, 1]
    assert (np.diff(far) < 0).all()


def test_gap_centre_ignores_its_cloud():
    first = GapCentreMapper(POINTS[:3]).fit(POINTS, OCCUPIED).predict_proba(POINTS)
    second = GapCentreMapper(POINTS[:3]).fit(POINTS[5:9], np.zeros(4, bool)).predict_proba(POINTS)
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("centres", [[], [[0.0, 0.0, 0.0]], [[np.nan, 0.0]], [0.0, 0.0]])
def test_bad_centres_are_refused(centres):
    with pytest.raises(InputError, match="centres: expected finite"):
        GapCentreMapper(centres).fit(POINTS, OCCUPIED)
