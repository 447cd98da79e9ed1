"""A user's own scans as a cloud."""

import warnings

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.cloud import cloud_from_scans, fit_cloud
from hilbertvae.scans.scan import Scans
from hilbertvae.voxel_votes import voxel_votes


def test_cloud_from_scans_takes_lists_and_arrays(room):
    scans = room.scans
    sweeps = [scans.points[scans.scan == k] for k in range(4)]
    places = np.array([scans.origins[scans.scan == k][0] for k in range(4)])
    from_list = cloud_from_scans(sweeps, places)
    rows = np.repeat(places, [len(sweep) for sweep in sweeps], axis=0)
    from_array = cloud_from_scans(np.concatenate(sweeps), rows)
    expected = fit_cloud(scans.select(scans.scan < 4), 0.1)
    for name in ("points", "occupied", "weight"):
        np.testing.assert_array_equal(getattr(from_list, name), getattr(expected, name))
        np.testing.assert_array_equal(getattr(from_array, name), getattr(expected, name))
    one = cloud_from_scans(sweeps[0], places[0])
    np.testing.assert_array_equal(one.points, cloud_from_scans(sweeps[:1], places[:1]).points)


def test_scans_of_one_length_may_come_as_one_array(room):
    points, origins = room.scans.points[:60].reshape(3, 20, 2), room.scans.origins[[0, 20, 40]]
    found, expected = cloud_from_scans(points, origins), cloud_from_scans(list(points), origins)
    for name in ("points", "occupied", "weight"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    with pytest.raises(InputError, match=r"points.*: expected no masked values, got 1"):
        cloud_from_scans(np.ma.masked_equal(points, points[0, 0, 0]), origins)


def test_the_resolution_follows_the_dimension_unless_given(box):
    scans = box.scans.select(box.scans.scan == 0)
    for given_m, used_m in ((None, 0.2), (0.5, 0.5)):
        found = cloud_from_scans(scans.points, scans.origins, resolution_m=given_m)
        assert len(found) == len(fit_cloud(scans, used_m))


@pytest.mark.parametrize(
    ("points", "origins", "message"),
    [
        ([], [[0.0, 0.0]], "points: expected shape"),
        (np.empty((0, 2)), [0.0, 0.0], "points: expected at least one point"),
        (np.ones((5, 4)), np.ones(4), "points: expected shape"),
        ([[0.0, np.nan]], [0.0, 0.0], "points: expected finite .* 1 of 1 points with NaN or inf; leave out beams without a return"),
        ([np.ones((1, 2)), [[np.inf, 0.0]]], np.zeros((2, 2)), r"points\[1\]: expected finite .*; leave out beams without a return"),
        ([np.ones((5, 2))] * 3, [0.0, 0.0], r"origins: expected one per scan, shape \(3, 2\), got one of shape \(2,\)"),
        (np.ones((3, 5, 2)), [0.0, 0.0], r"origins: expected one per scan, shape \(3, 2\), got one of shape \(2,\)"),
        (np.ones((3, 5, 4)), np.zeros((3, 2)), r"points: expected shape \(N, 2\) or \(N, 3\), got \(5, 4\)"),
        (np.ones((2, 3, 5, 2)), np.zeros((3, 2)), "points: expected shape"),
        (np.ones((5, 2)), [[0.0, 0.0], [0.0]], "origins: expected an .* array of numbers"),
        ([[[0.0, 0.0], [0.0]]], [[0.0, 0.0]], "points: expected"),
        ([[0.0, 1.0]], [np.inf, 0.0], "origins: expected finite"),
        ([np.ones((5, 2)), np.ones((4, 2))], [[0.0, 0.0]], r"origins: expected one per scan \(2\), got 1"),
        ([np.ones((5, 2))], [[0.0, 0.0, 0.0]], r"origins: expected shape \(N, 2\)"),
        ([np.ones((5, 2)), np.ones((4, 3))], [[0.0, 0.0], [0.0, 0.0]], r"points\[1\]: expected"),
        ([np.ones((5, 4))], [[0.0, 0.0, 0.0]], r"points: expected shape \(N, 2\) or \(N, 3\), got \(5, 4\)"),
        ([np.ones((5, 2)), None], [[0.0, 0.0], [0.0, 0.0]], r"points\[1\]: expected"),
        ([np.ones((5, 2)), 3.0], [[0.0, 0.0], [0.0, 0.0]], r"points\[1\]: expected"),
        (np.ones((5, 2)), np.ones((4, 2)), "origins: expected"),
        (np.ones((5, 2)), [0.0, 0.0, 0.0], "origins: expected"),
        (np.ones((5, 2)), "here", "origins: expected"),
    ],
)
def test_scans_that_do_not_fit_together_are_named(points, origins, message):
    with pytest.raises(InputError, match=message):
        cloud_from_scans(points, origins)


def test_bad_resolutions_and_too_large_extents_are_named():
    for resolution_m in (-0.1, 0, np.nan):
        with pytest.raises(InputError, match="resolution_m: expected a positive number"):
            cloud_from_scans([[1.0, 0.0]], [0.0, 0.0], resolution_m)
    scans = Scans(np.array([[1.0, 0.0], [1e13, 1e13]]), np.array([[0.0, 0.0], [1e13, 1e13 + 1]]), np.zeros(2, int), np.zeros(2, int))
    with pytest.raises(InputError, match="too large for voxels"):
        voxel_votes(scans, 0.1)
    with pytest.raises(InputError, match="expected at least one return"):
        voxel_votes(scans.select(np.zeros(2, bool)), 0.1)


def warnings_of(*given, **named):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cloud_from_scans(*given, **named)
    return [str(warning.message) for warning in caught]


def test_scans_that_can_not_be_in_metres_are_told(room):
    points, origins = room.scans.points[:500], room.scans.origins[:500]
    assert warnings_of(points, origins) == []
    (told,) = warnings_of(points * 1000, origins * 1000, resolution_m=100.0)
    assert "points: half of the beams are longer than" in told and "millimetres" in told


def test_a_room_in_millimetres_is_refused_before_it_takes_hours():
    points, origin = np.random.default_rng(0).uniform(-5000, 5000, (20_000, 3)), np.zeros(3)
    with pytest.raises(
        InputError, match="points: half of the beams are longer than .* millimetres or centimetres, .* would be [45]e.08 places"
    ):
        cloud_from_scans(points, origin)
    with pytest.warns(UserWarning, match="millimetres"):  # whoever says how long beams are means it
        assert len(cloud_from_scans(points, origin, max_range_m=1000.0)) > 0
    with pytest.raises(InputError, match="got none of 20000, .* are they in millimetres?"):
        cloud_from_scans(points, origin, max_range_m=1.0)


def test_a_stray_return_is_told_and_can_be_left_out(room):
    points, origins = room.scans.points[:500], room.scans.origins[:500]
    stray = np.concatenate([points, [[5000.0, 0.0]]]), np.concatenate([origins, origins[:1]])
    (told,) = warnings_of(*stray)
    assert told.startswith("points: 1 of 501 beams are longer than 1000 m, up to 49") and "max_range_m drops them" in told
    kept = cloud_from_scans(*stray, max_range_m=80.0)
    np.testing.assert_array_equal(kept.points, cloud_from_scans(points, origins).points)
    with pytest.raises(InputError, match="max_range_m: expected a positive"):
        cloud_from_scans(points, origins, max_range_m=0.0)
    far = points * 300, origins * 300  # all as long: a large place, no stray return
    assert not any("are they returns" in told for told in warnings_of(*far, resolution_m=30.0))


@pytest.mark.parametrize("max_range_m", [None, 30.0])
def test_a_beam_that_ends_where_it_began_is_no_obstacle(room, max_range_m):
    """Drivers write (0, 0, 0) of the sensor's frame for no return, which is the sensor's own place in the map's, but for rounding."""
    points, origins = room.scans.points[:500], room.scans.origins[:500]
    ended = np.concatenate([points, origins[:50] + 1e-6]), np.concatenate([origins, origins[:50]])
    np.testing.assert_array_equal(cloud_from_scans(*ended, max_range_m=max_range_m).points, cloud_from_scans(points, origins).points)
    with pytest.raises(InputError, match="points: expected returns, got 50 points where the sensor stood"):
        cloud_from_scans(origins[:50], origins[:50])


def test_a_length_of_no_return_and_a_room_in_centimetres_are_told(room):
    points, origins = room.scans.points[:500], room.scans.origins[:500]
    angle = np.linspace(0, 1, 60)
    arc = origins[0] + 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    given = np.concatenate([points, arc]), np.concatenate([origins, np.tile(origins[0], (60, 1))])
    (told,) = warnings_of(*given)
    assert told.startswith("points: 11 % of all ranges are the largest, 100.0 m") and "Set max_range_m=99.98" in told
    assert warnings_of(*given, max_range_m=99.985) == []
    (told,) = warnings_of(points * 100, origins * 100, resolution_m=10.0)
    assert "points: half of the beams are longer than" in told and "centimetres" in told
    street = np.random.default_rng(0).uniform(50, 200, (500, 3)), np.zeros(3)
    assert warnings_of(*street) == []  # no planar laser


@pytest.mark.parametrize("listed", [False, True])
def test_single_precision_that_moves_walls_is_told(room, listed):
    """At UTM's 4000 km float32 counts in steps of a quarter of a metre."""
    points, origins = room.scans.points[:500] + [500_000.0, 4_000_000.0], room.scans.origins[:500] + [500_000.0, 4_000_000.0]
    given = ([points[:300], points[300:]], origins[[0, 300]]) if listed else (points, origins)
    assert warnings_of(*given) == []
    coarse = [part.astype(np.float32) for part in given[0]] if listed else points.astype(np.float32)
    (told,) = warnings_of(coarse, given[1])
    assert told.startswith("points: its coordinates, up to 400") and "which keeps them to 0.25 m" in told
    assert warnings_of(room.scans.points.astype(np.float32), room.scans.origins) == []
    (told,) = warnings_of(given[0], (given[1] + 0.3).astype(np.float32))
    assert told.startswith("origins: its coordinates, up to ")
    (told,) = warnings_of((room.scans.points[:500] + 900).astype(np.float16), room.scans.origins[:500] + 900)
    assert "half precision, which keeps them to 0.5 m" in told


@pytest.mark.parametrize("empty", [[], np.array([]), np.empty((0, 2))])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_some_scans_may_be_empty(room, empty, place):
    sweeps, places = [room.scans.points[:50], room.scans.points[50:90]], list(room.scans.origins[[0, 50]])
    sweeps.insert(place, empty)
    places.insert(place, np.array([3.0, 2.0]))
    found = cloud_from_scans(sweeps, places)
    np.testing.assert_array_equal(found.points, cloud_from_scans(room.scans.points[:90], room.scans.origins[[0] * 50 + [50] * 40]).points)


def test_only_empty_scans_are_refused(room):
    with pytest.raises(InputError, match="scans: expected at least one return"):
        cloud_from_scans([np.empty((0, 2)), np.empty((0, 2))], np.zeros((2, 2)))
    with pytest.raises(InputError, match="points: expected a return in at least one of 2 scans, got none"):
        cloud_from_scans([[], []], np.zeros((2, 2)))
    told = rf"max_range_m: expected beams shorter than 0.01 m, got none of {len(room.scans)}, the shortest with \d"
    with pytest.raises(InputError, match=told):
        cloud_from_scans(room.scans.points, room.scans.origins, max_range_m=0.01)


def test_masked_points_are_refused(room):
    masked = np.ma.masked_greater(room.scans.points, 5.0)
    with pytest.raises(InputError, match="points: expected no masked values, got"):
        cloud_from_scans(masked, room.scans.origins)


def test_scans_of_different_lengths_as_numpy_keeps_them():
    points = np.empty(2, object)
    points[:] = [np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([[0.0, 3.0]])]
    origins = np.zeros((2, 2))
    found, expected = cloud_from_scans(points, origins), cloud_from_scans(list(points), origins)
    np.testing.assert_array_equal(found.points, expected.points)
