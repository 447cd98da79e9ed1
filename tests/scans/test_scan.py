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


def test_what_is_given_otherwise_is_kept_as_what_it_says():
    points = np.random.default_rng(0).uniform(0, 9, (300, 2))
    exact = Scans(points, points + 1, np.arange(300, dtype=np.int32) // 100, np.arange(300, dtype=np.int32))
    plain = Scans(points.tolist(), (points + 1).tolist(), exact.scan.tolist(), exact.beam.tolist())
    narrow = Scans(points.astype(np.float32), points + 1, exact.scan.astype(np.uint8), exact.beam)
    for found in (plain, narrow):
        assert (found.points.dtype, found.origins.dtype, found.scan.dtype, found.beam.dtype) == (*[np.float64] * 2, *[np.int32] * 2)
        np.testing.assert_allclose(found.points, points, rtol=1e-6)
        np.testing.assert_array_equal(found.held_out(), exact.held_out())


@pytest.mark.parametrize("numbers", [[0.5, 1.0], [np.nan, 1.0], [[0], [1]], ["a", "b"], [0, 2**31], [True, False]])
@pytest.mark.parametrize("name", ["scan", "beam"])
def test_numbers_that_are_none(name, numbers):
    given = {"scan": [0, 0], "beam": [0, 1]} | {name: numbers}
    with pytest.raises(InputError, match=f"scans.{name}: expected"):
        Scans(np.zeros((2, 2)), np.zeros((2, 2)), **given)


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
