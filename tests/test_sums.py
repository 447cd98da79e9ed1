import numpy as np

from hilbertvae.sums import sums_by


def test_sums_by_brute_force():
    rng = np.random.default_rng(0)
    group, values, weight = rng.integers(0, 5, 40), rng.normal(0, 1, (40, 3)), rng.random(40)
    group[group == 3] = 4  # a group of none
    plain, weighted = sums_by(group, values, 6), sums_by(group, values, 6, weight)
    assert plain.shape == weighted.shape == (6, 3)
    for number in range(6):
        rows = group == number
        expected = np.zeros((2, 3))
        for row, share in zip(values[rows], weight[rows], strict=True):
            expected += row, share * row
        np.testing.assert_array_equal([plain[number], weighted[number]], expected)
