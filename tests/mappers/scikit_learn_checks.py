"""What of scikit-learn's checks mappers can't pass that take points of 2 or 3 coordinates alone."""

IN_OTHER_DIMENSIONS = [
    "check_dtype_object",
    "check_estimators_dtypes",
    "check_fit2d_1feature",
    "check_n_features_in_after_fitting",
    "check_positive_only_tag_during_fit",
    "check_sample_weight_equivalence_on_dense_data",
]
