"""scikit-learn's own checks of estimators, of those mappers that take 2 or 3 coordinates alone."""

from sklearn.utils.estimator_checks import parametrize_with_checks

from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.octomap_mapper import OctoMapMapper

EXPECTED_FAILURES = {
    name: "scans are of the plane or of space"
    for name in [
        "check_dtype_object",
        "check_estimators_dtypes",
        "check_fit2d_1feature",
        "check_n_features_in_after_fitting",
        "check_positive_only_tag_during_fit",
        "check_sample_weight_equivalence_on_dense_data",
    ]
}


@parametrize_with_checks([HilbertMap(), OctoMapMapper()], expected_failed_checks=lambda _: EXPECTED_FAILURES)
def test_scikit_learn_contract(estimator, check):
    check(estimator)
