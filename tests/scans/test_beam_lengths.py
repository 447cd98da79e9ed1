import warnings

import numpy as np
import pytest
from point_writers import POINTS, random_poses, write_drive, write_npz, write_text

from hilbertvae.checks import InputError
from hilbertvae.scans.beam_lengths import ClippedCheck, UnitCheck, beam_lengths, within_range, without_zeros
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from hilbertvae.scans.velodyne import read_velodyne
from toy_rooms import carmen_line, write_log


def test_lengths_and_what_is_kept():
    points = np.array([[3.0, 4.0], [np.nan, 0], [np.inf, 0], [1e300, 1e300], [1, 1]])
    lengths = beam_lengths(points, np.array([0.0, 0.0]))
    assert lengths[0] == 5 and within_range(lengths, 1.5, 5.1).tolist() == [True, False, False, False, False]
    assert within_range(lengths, 1.4, 5.0).tolist() == [False, False, False, False, True]


def test_a_point_at_the_sensor_itself_is_no_return():
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [-0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(np.isnan(without_zeros(points)).all(axis=1), [True, False, True])
    np.testing.assert_array_equal(without_zeros(points)[1], points[1])
    np.testing.assert_array_equal(without_zeros(points, at_least=2), without_zeros(points))
    np.testing.assert_array_equal(without_zeros(points, at_least=3), points)


def test_too_long_beams_hint_at_their_unit():
    check = UnitCheck()
    check.see(np.array([2000.0, 3000.0]))
    assert "longer than 2500 m: are they in millimetres?" in check.hint(80.0) and check.hint(5000.0) == ""


def test_beams_that_may_well_be_metres_hint_at_what_cuts_them():
    check = UnitCheck()
    check.see(np.array([2.0, 4.0]))
    assert check.hint(1.0).endswith("longer than 3 m: is max_range_m too short for them?") and check.hint(5.0) == ""


def test_medians_of_most_scans_decide():
    check = UnitCheck()
    for lengths in ([2000.0, 3000, np.nan, np.inf], [5.0], [np.nan], [4000.0, 1, 9000]):
        check.see(np.array(lengths))
    with pytest.warns(UserWarning, match="a.ply: half of the beams are longer than 2500 m; are the coordinates in millimetres"):
        check.warn("a.ply")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        UnitCheck().warn("a.ply")


@pytest.mark.parametrize("kind", ["file", "folder", "log"])
def test_millimetres_give_one_warning_even_where_nothing_is_kept(tmp_path, kind):
    if kind == "file":
        path = write_text(tmp_path / "a.xyz", 1000 * POINTS)
    elif kind == "folder":
        path = write_drive(tmp_path, 1000 * POINTS.reshape(3, 20, 3), random_poses(3))
    else:
        path = write_log(tmp_path / "a.log", [carmen_line(1000 * np.full(180, 5.0), [0, 0, 0])] * 3)
    origin = [0.0, 0.0, 0.0] if kind == "file" else None
    with pytest.warns(UserWarning, match="millimetres") as found, pytest.raises(InputError, match="found none"):
        read_scans_path(path, ReadingSettings(sensor_origin_m=origin))
    assert len(found) == 1
    with pytest.warns(UserWarning, match="millimetres"):
        assert len(read_scans_path(path, ReadingSettings(sensor_origin_m=origin, max_range_m=1e6))) > 0


def test_metres_give_none(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_scans_path(write_text(tmp_path / "a.xyz"), ReadingSettings(sensor_origin_m=[0, 0, 0]))
        read_scans_path(write_drive(tmp_path / "drive", POINTS.reshape(3, 20, 3), random_poses(3)))


def told(lengths, max_range_m):
    """The warnings of a check that sees scans of these lengths."""
    check = UnitCheck(max_range_m)
    for scan in lengths:
        check.see(scan)
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        check.warn("a.ply")
    return [str(warning.message) for warning in found]


def test_where_many_beams_are_left_out_for_their_length_that_is_told():
    rng = np.random.default_rng(0)
    near, far = rng.uniform(1, 20, (4, 60)), rng.uniform(80, 500, (4, 40))
    assert told(np.hstack([near, far]), 80.0) == [
        "a.ply: 160 of 400 beams are 80 m or longer and are left out; "
        "are they in millimetres, or is reading.max_range_m too short for them?"
    ]
    assert told(np.hstack([near, far[:, :20]]), 80.0) == told(np.hstack([near, far]), 1e3) == []


def test_what_a_laser_writes_where_nothing_came_back_is_no_beam_too_long():
    near = np.random.default_rng(0).uniform(1, 20, (4, 60))
    for code in (81.83, np.inf, np.nan):
        assert told(np.hstack([near, np.full((4, 120), code)]), 30.0) == []


def clipped(*scans, of_points=False):
    check = ClippedCheck(80.0, of_points)
    for ranges in scans:
        check.see(np.array(ranges, float))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check.warn("a")
    return [str(warning.message) for warning in caught]


def test_a_code_for_no_return_is_seen_behind_a_stray_range():
    scan = [*np.linspace(1, 3.9, 60), *[4.0] * 40]
    assert "40 % of all ranges are the largest, 4.0 m" in clipped(scan, scan)[0]
    (said,) = clipped(*[scan] * 4, [*scan, 27.3])
    assert "40 % of all ranges are 4.0 m, and hardly any is longer" in said
    assert not clipped([*scan, *np.linspace(5, 20, 40)]) and not clipped([4.0] * 50) and not clipped([np.nan, np.inf])
    assert not clipped([1.0, 80.0, 80.0])  # dropped anyway


def test_the_longest_range_of_a_sensor_that_stood_still_is_no_code():
    few = np.linspace(1, 9, 12)
    assert not clipped(few, few, few)
    assert "15 % of all ranges are the largest, 9.0 m" in clipped([*few, 9.0], [*few, 9.0])[0]


def test_ranges_beyond_the_limit_are_kept_as_one():
    check = ClippedCheck(80.0)
    check.see(np.random.default_rng(0).uniform(80, 2e5, 50_000))
    assert len(check._alike) == 1


@pytest.mark.parametrize("of_points", [False, True])
def test_ranges_that_a_lidar_rounds_are_no_code(of_points):
    """A room of 8 x 6 x 2 m around a lidar of 32 rings, its ranges to 10 cm; a fifth of them have the one that most have."""
    around, up = np.meshgrid(np.linspace(-np.pi, np.pi, 360, endpoint=False), np.deg2rad(np.linspace(-25, 15, 32)))
    beams = np.abs(np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]).reshape(3, -1))
    with np.errstate(divide="ignore"):
        ranges = (np.array([[4.0], [3], [1]]) / beams).min(axis=0)
    assert not any(clipped(ranges.round(digits), of_points=of_points) for digits in (9, 2, 1))


def test_a_code_is_seen_though_a_wall_has_more_of_one_range():
    """The mode of ranges is then none of a code."""
    (said,) = clipped([*np.linspace(1, 3.9, 60), *[2.5] * 60, *[4.0] * 40])
    assert "25 % of all ranges are the largest, 4.0 m" in said


def corridor(code_m, seed, count=360):
    """(count, 2): a planar scan's ends on walls 60 m long, where beams of `code_m` and more came back with that."""
    azimuth = np.random.default_rng(seed).uniform(-np.pi, np.pi, count)
    along = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    return along * np.minimum(np.min([30, 3] / np.abs(along), axis=1), code_m)[:, None]


@pytest.mark.parametrize("digits", [2, 3, 9])
@pytest.mark.parametrize("kind", ["folder", "file", "sweeps"])
def test_codes_in_clouds_are_told_however_they_are_rounded(tmp_path, kind, digits):
    clouds = [corridor(12.0, seed).round(digits) for seed in range(20)]
    path, given = tmp_path / "a.npz", {}
    if kind == "folder":
        path = write_drive(tmp_path, clouds, np.tile(np.eye(3, 4), (20, 1, 1)), "{:06d}.txt", write_text)
    elif kind == "file":
        write_npz(path, np.concatenate(clouds))
        given = {"sensor_origin_m": [0.0, 0.0]}
    else:
        write_npz(path, np.concatenate(clouds) + [5e5, 5e6], origins=np.tile([5e5, 5e6], (20, 1)), scan=np.repeat(np.arange(20), 360))
    with pytest.warns(UserWarning, match="16 % of all ranges are the largest, 12.0 m: .*max_range_m=11.985 to drop them") as found:
        read_scans_path(path, ReadingSettings(**given))
    assert len(found) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scans = read_scans_path(path, ReadingSettings(max_range_m=11.985, **given))
    assert len(scans) > 5000 and np.linalg.norm(scans.points - scans.origins, axis=1).max() < 11.985


@pytest.mark.parametrize("fan_deg", [180, 270, 360])
@pytest.mark.parametrize("far_m", [5, 10, 20, 30])
def test_the_end_of_a_corridor_is_no_code(tmp_path, fan_deg, far_m):
    azimuth = np.deg2rad(np.arange(-fan_deg / 2, fan_deg / 2, 0.25))
    along = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    ends = (along * np.min([far_m, 1] / np.maximum(np.abs(along), 1e-9), axis=1)[:, None]).round(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_scans_path(write_text(tmp_path / "a.xyz", ends), ReadingSettings(sensor_origin_m=[0, 0]))


def test_real_clouds_have_no_code(real_scans):
    for path in real_scans:
        for digits in (2, 9):
            check = ClippedCheck(80.0, of_points=True)
            check.see(np.linalg.norm(read_velodyne(path).points.round(digits), axis=1))
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                check.warn(path)


def test_all_ranges_of_no_return_are_told_as_such():
    check = UnitCheck(30.0)
    check.see(np.full(180, 81.91))
    assert check.hint(30.0) == "; all of them are 81.91 m long, as lasers write where there is no return"
    check.see(np.linspace(100, 200, 50))
    assert "half of the beams are longer than 150 m" in check.hint(30.0)
