import numpy as np

from hilbertvae.simulate.pose_errors import MEMORY, wandering


def test_errors_by_their_explicit_sum():
    """Each is the first shock and the later ones, every one of them forgotten by as many scans as have passed."""
    shocks = np.random.default_rng(0).normal(size=(7, 3))
    fresh = np.where(np.arange(7) == 0, 1.0, np.sqrt(1 - MEMORY**2))
    found = wandering(shocks)
    for k in range(7):
        np.testing.assert_allclose(found[k], sum(MEMORY ** (k - j) * fresh[j] * shocks[j] for j in range(k + 1)), atol=1e-12)


def test_errors_spread_as_shocks_do_and_hang_together():
    found = wandering(np.random.default_rng(0).normal(size=(40_000, 1)))[:, 0]
    assert abs(found.std() - 1) < 0.05
    assert abs(np.corrcoef(found[1:], found[:-1])[0, 1] - MEMORY) < 0.02
