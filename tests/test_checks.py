import numpy as np
import pytest
import torch

from hilbertvae.checks import InputError, check_count, check_points, check_positive, check_share


def test_points_come_back_as_float64():
    found = check_points([[1, 2], [3, 4]])
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, [[1.0, 2.0], [3.0, 4.0]])


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        ([], {}, r"cloud: expected shape \(N, 2\) or \(N, 3\), got \(0,\)"),
        (np.empty((0, 2)), {}, "cloud: expected at least one point"),
        ([1.0, 2.0], {}, r"got \(2,\)"),
        (np.ones((4, 4)), {}, r"got \(4, 4\)"),
        (np.ones((4, 3)), {"dimension": 2}, r"expected shape \(N, 2\), got \(4, 3\)"),
        ([[1.0, 2.0], [3.0]], {}, "array of numbers, got list"),
        ("points", {}, "array of numbers, got str"),
        ([["a", "b"]], {}, "array of numbers"),
        (np.zeros(3, [("x", "f4"), ("y", "f4")]), {}, "expected plain numbers, got an array with the fields x, y; stack"),
        ([[0.0, np.nan], [0.0, 0.0], [np.inf, 1.0]], {}, "2 of 3 points with NaN or inf"),
    ],
)
def test_bad_points_are_named(points, options, message):
    with pytest.raises(InputError, match=message):
        check_points(points, "cloud", **options)


def test_points_with_a_gradient_are_refused_as_torch_says():
    with pytest.raises(InputError, match=r"cloud: expected an \(N, D\) array of numbers, got Tensor \(Can't call numpy"):
        check_points(torch.ones((5, 2), requires_grad=True), "cloud")


def test_no_points_where_none_are_allowed():
    assert check_points(np.empty((0, 3)), allow_empty=True).shape == (0, 3)


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, True, "1", None])
def test_not_positive(value):
    with pytest.raises(InputError, match="size_m: expected a positive number"):
        check_positive(value, "size_m")


@pytest.mark.parametrize("value", [1, 0.5, np.float32(2.0), np.int64(3)])
def test_positive(value):
    found = check_positive(value, "size_m")
    assert type(found) is float and found == value


@pytest.mark.parametrize("value", [0, -1, 4, 1.0, np.nan, True, "1", None])
def test_no_count(value):
    with pytest.raises(InputError, match="count: expected a whole number from 1 to 3, got"):
        check_count(value, "count", 3)


@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan, True, "0.5", None])
def test_no_share(value):
    with pytest.raises(InputError, match=r"part: expected a share in \[0, 1\], got"):
        check_share(value, "part")


def test_shares():
    assert [check_share(value, "part") for value in (0, np.float32(0.5), 1)] == [0.0, 0.5, 1.0]


def test_a_count_may_begin_later():
    assert check_count(4, "azimuths", least=4) == 4
    with pytest.raises(InputError, match="azimuths: expected a whole number of at least 4, got 3"):
        check_count(3, "azimuths", least=4)


def test_counts_come_back_as_python_numbers():
    found = check_count(np.int64(3), "count", 3)
    assert found == 3 and type(found) is int and check_count(10**12, "count") == 10**12
