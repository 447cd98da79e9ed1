"""scikit-learn's own checks of estimators, of those mappers that take 2 or 3 coordinates alone."""

from scikit_learn_checks import IN_OTHER_DIMENSIONS
from sklearn.utils.estimator_checks import parametrize_with_checks

from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.octomap_mapper import OctoMapMapper

EXPECTED_FAILURES = dict.fromkeys(IN_OTHER_DIMENSIONS, "scans are of the plane or of space")


@parametrize_with_checks([HilbertMap(), OctoMapMapper()], expected_failed_checks=lambda _: EXPECTED_FAILURES)
def test_scikit_learn_contract(estimator, check):
    check(estimator)
