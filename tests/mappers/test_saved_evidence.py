import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.mappers.evidence import Evidence
from hilbertvae.mappers.saved_evidence import evidence_arrays, evidence_of


def random_evidence(seed, dimension, count=150, offset_m=0.0, heavy=20, whole=True):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.5, 1.5, (count, dimension)) + offset_m
    weight = rng.integers(1, heavy, count).astype(float) if whole else rng.uniform(0.1, heavy, count)
    return Evidence(points, rng.random(count) < 0.3, weight, 0.1)


def voxels(evidence):
    """Votes and means of each voxel, by its index."""
    rows, index = evidence.bricks.voxels()
    columns = [evidence.hits, evidence.frees, *evidence.hit_mean, *evidence.free_mean]
    return {tuple(voxel): [column[row] for column in columns] for voxel, row in zip(index.tolist(), rows, strict=True)}


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    offset_m=st.sampled_from([0.0, -77.7, 5e6]),
    heavy=st.sampled_from([2, 200, 10**6, 10**11]),
    whole=st.booleans(),
    portions=st.integers(1, 3),
)
def test_what_was_seen_comes_back_to_the_bit(seed, dimension, offset_m, heavy, whole, portions):
    evidence = random_evidence(seed, dimension, offset_m=offset_m, heavy=heavy, whole=whole)
    for more in range(portions - 1):
        cloud = random_evidence(seed + 1 + more, dimension, offset_m=offset_m + 0.5).cloud()
        evidence.add(cloud.points, cloud.occupied, cloud.weight)
    found = evidence_of(evidence_arrays(evidence), dimension, 0.1)
    assert voxels(found) == voxels(evidence)
    queries = evidence.cloud().points
    ours, theirs = found.find(queries), evidence.find(queries)
    np.testing.assert_array_equal(found.features(queries, ours), evidence.features(queries, theirs))


def test_counts_take_few_bytes():
    arrays = evidence_arrays(random_evidence(0, 3))
    assert {arrays[name].dtype for name in ("hits", "frees", "seen")} == {np.dtype(np.uint8)}
    assert arrays["corner"].dtype == np.int32 and arrays["hit_mean"].dtype == np.float32
    assert evidence_arrays(random_evidence(0, 3, heavy=30_000))["frees"].dtype == np.uint16
    assert evidence_arrays(random_evidence(0, 3, heavy=10**6))["frees"].dtype == np.uint32
    assert evidence_arrays(random_evidence(0, 3, whole=False))["frees"].dtype == np.float64


def forged(name, change):
    arrays = evidence_arrays(random_evidence(0, 2))
    arrays[name] = change(arrays[name].copy())
    return arrays


def put(value):
    def change(array):
        array.reshape(-1)[0] = value
        return array

    return change


def test_forged_arrays_take_no_memory():
    """Each bit stands for a voxel, whose place takes a hundred times as much."""
    arrays = forged("seen", lambda array: np.full((20_000, array.shape[1]), 255, np.uint8))
    arrays["corner"] = np.stack([np.arange(20_000), np.zeros(20_000)], axis=1).astype(np.int32)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="hits: expected shape"):
            evidence_of(arrays, 2, 0.1)
        assert tracemalloc.get_traced_memory()[1] < 10 * arrays["seen"].nbytes
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("corner", lambda array: array[:, :1], r"corner: expected shape \('any', 2\)"),
        ("corner", lambda array: array.astype(float), "corner: expected shape .* of kind iu"),
        ("corner", lambda array: np.concatenate([array[:1], array[:1], array[2:]]), "corner: expected each voxel once"),
        ("corner", lambda array: put(2**60)(array.astype(np.int64)), "corner: expected bricks nearer to the origin"),
        ("corner", lambda array: put(2**40)(array.astype(np.int64)), "corner: expected voxels within"),
        ("seen", lambda array: array[:-1], "seen: expected shape"),
        ("seen", lambda array: array.astype(np.uint16), "seen: expected bytes"),
        ("seen", lambda array: np.concatenate([array[:1] * 0, array[1:]]), "seen: expected bytes with at least one voxel"),
        ("seen", lambda array: array | 1, "hits: expected shape"),
        ("hits", lambda array: array[:-1], "hits: expected shape"),
        ("hits", lambda array: array.astype("S1"), "hits: expected shape .* of kind uf"),
        ("frees", lambda array: put(np.nan)(array.astype(float)), "frees: expected counts"),
        ("frees", lambda array: put(-1)(array.astype(float)), "frees: expected counts"),
        ("frees", lambda array: array * 0 + 1, "free_mean: expected shape"),
        ("hit_mean", lambda array: array[1:], "hit_mean: expected shape"),
        ("hit_mean", put(np.nan), "hit_mean: expected places within a voxel"),
        ("hit_mean", put(1.0), "hit_mean: expected places within a voxel"),
        ("hit_mean", put(0.0), "hit_mean: expected places within a voxel"),
        ("free_mean", put(-0.1), "free_mean: expected places within a voxel"),
    ],
)
def test_forged_arrays_are_named(name, change, message):
    with pytest.raises(InputError, match=message):
        evidence_of(forged(name, change), 2, 0.1)


def test_missing_arrays_and_votes_of_nobody():
    arrays = evidence_arrays(random_evidence(0, 2))
    for name in arrays:
        with pytest.raises(InputError, match=f"{name}: expected an array of that name, got none"):
            evidence_of({other: array for other, array in arrays.items() if other != name}, 2, 0.1)
    one = evidence_arrays(Evidence(np.zeros((1, 2)), np.array([True]), np.ones(1), 0.1))
    one["hits"], one["hit_mean"] = one["hits"] * 0, one["hit_mean"][:0]
    with pytest.raises(InputError, match="hits, frees: expected votes of every voxel seen"):
        evidence_of(one, 2, 0.1)
