import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.scan import Scans


def test_a_tenth_is_held_out_and_no_bearing_always(room):
    scans = room.scans
    held_out = scans.held_out()
    assert held_out.mean() == pytest.approx(0.1, abs=0.002)
    for beam in range(3):
        assert 0 < held_out[scans.beam == beam].sum() < (scans.beam == beam).sum()
    expected = [(int(beam) + int(scan)) % 10 == 0 for beam, scan in zip(scans.beam, scans.scan, strict=True)]
    np.testing.assert_array_equal(held_out, expected)


def test_select_takes_masks_and_indices(room):
    scans = room.scans
    chosen = np.flatnonzero(scans.scan == 3)
    by_mask, by_index = scans.select(scans.scan == 3), scans.select(chosen)
    for name in ("points", "origins", "scan", "beam"):
        np.testing.assert_array_equal(getattr(by_mask, name), getattr(by_index, name))
        np.testing.assert_array_equal(getattr(by_mask, name), getattr(scans, name)[chosen])


@pytest.mark.parametrize(
    ("points", "origins", "numbers", "message"),
    [
        (np.zeros((3, 2)), np.zeros((2, 2)), 3, "one length"),
        (np.zeros((3, 2)), np.zeros((3, 2)), 4, "one length"),
        (np.zeros((3, 2)), np.zeros((3, 3)), 3, "scans.origins"),
        (np.full((3, 2), np.nan), np.zeros((3, 2)), 3, "scans.points.*NaN"),
        (np.zeros((3, 2)), np.full((3, 2), np.inf), 3, "scans.origins.*inf"),
        (np.zeros(3), np.zeros(3), 3, "scans.points"),
    ],
)
def test_parts_that_do_not_fit_together(points, origins, numbers, message):
    number = np.zeros(numbers, np.int32)
    with pytest.raises(InputError, match=message):
        Scans(points, origins, number, number)
