import warnings

import numpy as np
import pytest

from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from hilbertvae.scans.rounded import warn_if_rounded


@pytest.mark.parametrize(
    ("points", "told"),
    [
        (np.float16([[500.25, 1.1]]), "half precision, which keeps them to 0.25 m"),
        (np.float16([[1e4, 2.0]]), "half precision, which keeps them to 8 m"),
        (np.float32([[5.4e6, 1.1]]), "single precision, which keeps them to 0.5 m"),
        (np.float32([[5.4e6, np.nan], [1.1, np.inf]]), "single precision, which keeps them to 0.5 m"),
        (np.array([[500.3, 1.1]]), ""),
        (np.array([[500.0, 7.0]]), ""),  # whole metres are of any precision
        (np.array([[5.4e6 + 0.3, 1.1]]), ""),
        (np.float32([[1e5, 1.1]]), ""),
        (np.full((3, 2), np.nan), ""),
        (np.append(np.tile([[500.25, 1.5]], (200, 1)), [[500.3, 1.5]], axis=0), ""),
    ],
)
def test_what_was_kept_in_few_bits_is_told(points, told):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_if_rounded(points.astype(float), "a.npz", "origins")
    assert ["a.npz: its origins, up to" in str(warning.message) and told in str(warning.message) for warning in caught] == [True] * bool(
        told
    )


def test_origins_are_looked_at_too(tmp_path):
    points = np.random.default_rng(0).uniform(size=(50, 2)) * 8 + 5.4e6
    np.savez(tmp_path / "a.npz", points=points, origins=np.full(2, 5.4e6 + 0.3, np.float32))
    with pytest.warns(UserWarning, match="a.npz: its origins, up to 5400000 m, are in single precision"):
        read_scans_path(str(tmp_path / "a.npz"), ReadingSettings())
