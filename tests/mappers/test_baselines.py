"""What every baseline mapper has to keep: scikit-learn's contract, each query answered alone, and clear messages for bad input."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scikit_learn_checks import IN_OTHER_DIMENSIONS
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks

from hilbertvae.checks import InputError
from hilbertvae.mappers.constant import ConstantMapper, GapCentreMapper
from hilbertvae.mappers.fixed_grid import FixedGridMapper
from hilbertvae.mappers.fourier_features import FourierMapper
from hilbertvae.mappers.gpom import GpomMapper
from hilbertvae.mappers.lard import LardMapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.mappers.nystroem_features import NystroemMapper

BASELINES = [
    NearestMapper(),
    NearestMapper(15),
    ConstantMapper(),
    GapCentreMapper(centres=((0.0, 0.0), (2.0, 1.0))),
    FixedGridMapper(epochs=3),
    LardMapper(epochs=3),
    GpomMapper(),
    GpomMapper("neural-network"),
    FourierMapper(components=300, epochs=3),
    NystroemMapper(components=100, epochs=3),
]
IDS = ["nearest", "nearest-15", "all-occupied", "gap-centre", "hm", "lard-hm", "gpom", "gpom-nn", "hm-fourier", "hm-nystroem"]
TELL_APART = {
    "nearest": NearestMapper(),
    "hm": FixedGridMapper(),
    "lard-hm": LardMapper(),
    "gpom": GpomMapper(),
    "gpom-nn": GpomMapper("neural-network"),
    "hm-fourier": FourierMapper(components=1000),
    "hm-nystroem": NystroemMapper(components=500),
}

QUICK_MEANS = "Quick-Means takes points of 2 or 3 axes"
CENTRES = "the centres have 2 axes, and so must the data"
GRADIENT = "a weight n counts as its root, and gradient descent meets n points one by one"
EXPECTED_FAILURES = {
    NearestMapper: {},
    ConstantMapper: {},
    GapCentreMapper: {
        name: CENTRES
        for name in [
            "check_dict_unchanged",
            "check_dont_overwrite_parameters",
            "check_dtype_object",
            "check_estimators_dtypes",
            "check_estimators_nan_inf",
            "check_estimators_pickle",
            "check_f_contiguous_array_estimator",
            "check_fit2d_1feature",
            "check_fit2d_predict1d",
            "check_fit_score_takes_y",
            "check_methods_sample_order_invariance",
            "check_methods_subset_invariance",
            "check_n_features_in_after_fitting",
            "check_pipeline_consistency",
            "check_positive_only_tag_during_fit",
            "check_sample_weight_equivalence_on_dense_data",
            "check_sample_weights_list",
            "check_supervised_y_2d",
        ]
    },
    GpomMapper: {"check_sample_weight_equivalence_on_dense_data": "a label of weight n has a noise that is not that of n labels"},
    **dict.fromkeys([FixedGridMapper, FourierMapper, NystroemMapper], {"check_sample_weight_equivalence_on_dense_data": GRADIENT}),
    LardMapper: dict.fromkeys(IN_OTHER_DIMENSIONS, QUICK_MEANS),
}


def expected_failures(mapper):
    if isinstance(mapper, NearestMapper) and mapper.neighbours > 1:
        return {"check_sample_weight_equivalence_on_dense_data": "each neighbour has one vote, whatever its weight"}
    return EXPECTED_FAILURES[type(mapper)]


@parametrize_with_checks(BASELINES, expected_failed_checks=expected_failures)
def test_scikit_learn_contract(estimator, check):
    check(estimator)


def room(dimension=2, count=600, seed=0):
    """Points in a room of 6 m, occupied within 0.2 m of its west and south walls, with counts."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 6, (count, dimension))
    return points, (points[:, :2] < 0.2).any(axis=1), rng.integers(1, 300, count).astype(float)


@pytest.fixture(scope="module", params=[2, 3], ids=["2d", "3d"])
def fitted(request):
    cloud = room(request.param)
    mappers = [clone(mapper) for mapper in BASELINES]
    mappers[3].centres = np.full((2, request.param), [[1.0], [4.0]])
    return [mapper.fit(*cloud) for mapper in mappers], request.param


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 70), pieces=st.integers(1, 5))
def test_each_query_is_answered_alone(fitted, seed, count, pieces):
    rng = np.random.default_rng(seed)
    queries = rng.uniform(-2, 8, (count, fitted[1]))
    order = rng.permutation(count)
    cuts = np.sort(rng.integers(0, count + 1, pieces))
    for mapper in fitted[0]:
        whole = mapper.predict_proba(queries)
        np.testing.assert_array_equal(mapper.predict_proba(queries[order]), whole[order])
        parts = [mapper.predict_proba(part) for part in np.split(queries, cuts)]
        np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_answers_do_not_depend_on_the_chunk(fitted):
    queries = np.random.default_rng(3).uniform(-2, 8, (500, fitted[1]))
    for mapper in fitted[0]:
        whole = mapper.predict_proba(queries)
        mapper.chunk = 64
        np.testing.assert_array_equal(mapper.predict_proba(queries), whole)
        del mapper.chunk


def test_no_queries_and_far_queries(fitted):
    for mapper in fitted[0]:
        assert mapper.predict_proba(np.empty((0, fitted[1]))).shape == (0, 2)
        far = mapper.predict_proba(np.full((1, fitted[1]), 1e12))
        assert np.isfinite(far).all() and far.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("mapper", BASELINES, ids=IDS)
def test_the_same_seed_gives_the_same_bits(mapper):
    cloud, queries = room(), room(seed=1)[0]
    first, second = (clone(mapper).fit(*cloud).predict_proba(queries) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("mapper", TELL_APART.values(), ids=TELL_APART)
@pytest.mark.parametrize("dimension", [2, 3])
def test_walls_and_room_are_told_apart(mapper, dimension):
    held_out, occupied, _ = room(dimension, 2000, seed=1)
    mapper = clone(mapper).fit(*room(dimension, 4000))
    assert mapper.score(held_out, occupied) > 0.9
    assert mapper.predict_proba(held_out[occupied])[:, 1].mean() > mapper.predict_proba(held_out[~occupied])[:, 1].mean() + 0.5


@pytest.mark.filterwarnings("ignore:The number of unique classes")
@pytest.mark.parametrize("mapper", BASELINES, ids=IDS)
def test_bad_input_is_refused_with_a_message(mapper):
    points, occupied, weight = room(count=50)
    broken = points.copy()
    broken[3, 1] = np.nan
    outlier = points.copy()
    outlier[3, 0] = 1e155
    mapper = clone(mapper)
    for arguments, message in [
        ((points[:0], occupied[:0]), "0 sample"),
        ((broken, occupied), "NaN"),
        ((outlier, occupied), "up to 1e.100 m, got 1e.155; is there an outlier"),
        ((points.ravel(), occupied), "2D array"),
        ((points, occupied[:-1]), "inconsistent"),
        ((points, np.arange(50)), "binary"),
        ((points, np.linspace(0.0, 1.0, 50)), "continuous"),
        ((points, occupied, -weight), "[Nn]egative"),
        ((points, occupied, np.zeros(50)), "positive weights|non-zero"),
        ((points, occupied, weight[:-1]), "sample_weight"),
    ]:
        with pytest.raises(InputError, match=message):
            mapper.fit(*arguments)
    mapper.fit(points, occupied, weight)
    for queries, message in [(broken, "queries: .*NaN"), (np.ones((4, 5)), "queries: .*features"), (points[0], "queries: .*2D array")]:
        with pytest.raises(InputError, match=message) as raised:
            mapper.predict_proba(queries)
        assert "natively" not in str(raised.value)  # and no word of other estimators


@pytest.mark.parametrize("mapper", TELL_APART.values(), ids=TELL_APART)
def test_one_class_only_is_refused(mapper):
    points = room(count=50)[0]
    with pytest.raises(InputError, match="one class only"):
        clone(mapper).fit(points, np.ones(50, bool))
    with pytest.raises(InputError, match="one class only"):
        clone(mapper).fit(points, np.arange(50) < 9, np.where(np.arange(50) < 9, 0.0, 2.0))


@pytest.mark.parametrize("mapper", [FourierMapper(seed=2**32), NystroemMapper(seed=2**32)], ids=["hm-fourier", "hm-nystroem"])
def test_a_seed_that_scikit_learn_has_not_is_refused(mapper):
    with pytest.raises(InputError, match="seed: expected a whole number from 0 to 4294967295, got 4294967296"):
        clone(mapper).fit(*room(count=50))


@pytest.mark.parametrize("labels", [(-1, 1), (0, 1), ("free", "occupied")])
def test_the_greater_label_means_occupied(labels):
    points, occupied, _ = room()
    mapper = NearestMapper().fit(points, np.array(labels)[occupied.astype(int)])
    np.testing.assert_array_equal(mapper.predict_proba(points)[:, 1], occupied)
    assert set(mapper.predict(points)) == set(labels)


def test_words_for_labels_are_told_which_is_taken_for_which():
    """By their letters, which is wrong as often as right."""
    points, occupied, _ = room()
    with pytest.warns(UserWarning, match="^y: takes 'miss', the later of the two by its letters, for occupied and 'hit' for free"):
        NearestMapper().fit(points, np.where(occupied, "hit", "miss"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        NearestMapper().fit(points, np.where(occupied, 1, -1))


@pytest.mark.parametrize("mapper", BASELINES, ids=IDS)
def test_the_farthest_queries_are_answered(mapper, room):
    """Squares of such lengths are no numbers."""
    far = np.array([[1e154, 0.0], [-1e300, 1e300], [1e90, 0.0]])
    fitted = clone(mapper).fit(room.fit.points[::5], room.fit.occupied[::5])
    answers = fitted.predict_proba(far)
    assert np.isfinite(answers).all()
    np.testing.assert_array_equal(fitted.predict_proba(far[1:2]), answers[1:2])
