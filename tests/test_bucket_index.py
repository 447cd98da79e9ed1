import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.bucket_index import BucketIndex


def brute_force(points, low, high):
    pairs = []
    for box in range(len(low)):
        for point in range(len(points)):
            if all(low[box, d] <= points[point, d] <= high[box, d] for d in range(points.shape[1])):
                pairs.append((box, point))
    return pairs


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    count=st.integers(0, 40),
    boxes=st.integers(0, 8),
    size_m=st.sampled_from([0.1, 0.5, 1.0, 7.0]),
)
def test_pairs_equal_brute_force(seed, dimension, count, boxes, size_m):
    rng = np.random.default_rng(seed)
    points = np.round(rng.uniform(-3, 3, (count, dimension)), 1)  # many on the edges of buckets and boxes
    low = np.round(rng.uniform(-5, 5, (boxes, dimension)), 1)
    high = low + np.round(rng.uniform(0, 4, (boxes, dimension)), 1)
    box, point = BucketIndex(points, size_m).in_boxes(low, high)
    assert (np.diff(box) >= 0).all()
    assert sorted(zip(box.tolist(), point.tolist(), strict=True)) == brute_force(points, low, high)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    count=st.integers(0, 40),
    boxes=st.integers(0, 8),
    most=st.sampled_from([1, 10, 1000]),
)
def test_portions_of_boxes_have_the_same_pairs(seed, dimension, count, boxes, most):
    rng = np.random.default_rng(seed)
    index = BucketIndex(rng.uniform(-3, 3, (count, dimension)), 0.5)
    low = rng.uniform(-4, 3, (boxes, dimension))
    high = low + rng.uniform(0, 3, (boxes, dimension))
    found = list(index.in_portions(low, high, most))
    assert [box for some, _, _ in found for box in range(some.start, some.stop)] == list(range(boxes))
    for some, box, point in found:
        assert ((box >= some.start) & (box < some.stop)).all() and (len(point) <= most or some.stop - some.start == 1)
    assert most < 1000 or len(found) <= 1
    for whole, parts in zip(index.in_boxes(low, high), zip(*(pairs for _, *pairs in found), strict=True), strict=False):
        np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("dimension", [2, 3])
def test_boxes_far_outside_hold_nothing(dimension):
    points = np.random.default_rng(0).uniform(0, 1, (20, dimension))
    for shift in (-100.0, 100.0):
        low = np.full((1, dimension), shift)
        assert [len(part) for part in BucketIndex(points, 0.3).in_boxes(low, low + 1)] == [0, 0]


def test_large_coordinates():
    points = np.array([[500_000.0, 5_400_000.0], [500_000.5, 5_400_000.25]])
    box, point = BucketIndex(points, 0.2).in_boxes(points - 0.1, points + 0.1)
    assert list(zip(box, point, strict=True)) == [(0, 0), (1, 1)]


def test_more_buckets_than_32_bits_count():
    points = np.array([[0.0, 0.0], [80_000.0, 90_000.0], [80_000.25, 90_000.5]])
    index = BucketIndex(points, 1.0)
    assert index.keys.dtype == np.int64 and BucketIndex(points, 100.0).keys.dtype == np.int32
    box, point = index.in_boxes(points - 0.3, points + 0.3)
    assert list(zip(box, point, strict=True)) == [(0, 0), (1, 1), (2, 2)]
