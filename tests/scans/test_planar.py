import numpy as np
import pytest
from point_writers import write_drive, write_npz
from scipy.spatial.transform import Rotation

from hilbertvae.scans.planar import as_plan
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.scan_folder import read_scan_folder
from toy_rooms import box_room, square_room


def posed(heights, leanings_deg, seed=0):
    """A planar laser's sweeps of a room, of 180 beams each, each in the laser's frame; and poses with heights and leanings."""
    room, rng = square_room(len(heights), seed=seed), np.random.default_rng(seed)
    sweeps, poses = [], []
    for number, (height, leaning) in enumerate(zip(heights, leanings_deg, strict=True)):
        chosen, about = room.scan == number, rng.uniform(0, 2 * np.pi)
        sweeps.append(np.column_stack([room.points[chosen] - room.origins[chosen], np.zeros(180)]))
        turn = Rotation.from_rotvec(np.deg2rad(leaning) * np.array([np.cos(about), np.sin(about), 0])).as_matrix()
        poses.append(np.column_stack([turn, [*room.origins[chosen][0], height]]))
    return sweeps, poses


def placed(sweeps, poses):
    points = [sweep @ pose[:, :3].T + pose[:, 3] for sweep, pose in zip(sweeps, poses, strict=True)]
    origins = [np.tile(pose[:, 3], (len(sweep), 1)) for sweep, pose in zip(sweeps, poses, strict=True)]
    counts = [len(sweep) for sweep in sweeps]
    beam = np.concatenate([np.arange(count, dtype=np.int32) for count in counts])
    return Scans(np.concatenate(points), np.concatenate(origins), np.repeat(np.arange(len(sweeps), dtype=np.int32), counts), beam)


RNG = np.random.default_rng(3)
NEAR_LEVEL = {
    "level": (np.full(10, 0.3), np.zeros(10)),
    "a floor that rises by 2 mm from scan to scan": (0.002 * np.arange(10), np.zeros(10)),
    "a pitch of 2 mrad": (np.zeros(10), np.full(10, np.rad2deg(0.002))),
    "poses with errors": (RNG.uniform(0, 0.2, 10), RNG.uniform(0, 1.9, 10)),
}


@pytest.mark.parametrize(("heights", "leanings_deg"), NEAR_LEVEL.values(), ids=NEAR_LEVEL)
def test_sweeps_of_a_level_laser_are_a_plan(heights, leanings_deg):
    scans = placed(*posed(heights, leanings_deg))
    with pytest.warns(
        UserWarning, match=f"drive: .* differ by {np.ptp(heights):.2g} m, and leans by .* so that the map is of two dimensions"
    ):
        plan = as_plan(scans, "drive")
    np.testing.assert_array_equal(plan.points, scans.points[:, :2])
    np.testing.assert_array_equal(plan.origins, scans.origins[:, :2])
    np.testing.assert_array_equal(plan.beam, scans.beam)


def test_a_sweep_that_saw_little_fits_many_planes():
    """One return, and some along one line, tell nothing: they hinder no plan, nor do they make one."""
    sweeps, poses = posed(np.zeros(4), [0.5, 0.5, 0.5, 1.0])
    sweeps[1], sweeps[2] = sweeps[1][:1], np.linspace(1, 8, 9)[:, None] * [np.cos(0.3), np.sin(0.3), 0]
    with pytest.warns(UserWarning, match="leans by up to 1 degrees, so that the map is of two dimensions"):
        assert as_plan(placed(sweeps, poses), "drive").dimension == 2
    single = placed([np.random.default_rng(number).uniform(-9, 9, (1, 3)) * [1, 1, 0.01] for number in range(50)], [np.eye(3, 4)] * 50)
    assert as_plan(single, "drive").dimension == 3


@pytest.mark.parametrize(("heights", "leanings_deg"), [(np.linspace(0, 2, 10), np.zeros(10)), (np.zeros(10), np.linspace(-10, 10, 10))])
def test_a_laser_that_is_lifted_or_nodded_sees_in_three_dimensions(heights, leanings_deg):
    scans = placed(*posed(heights, leanings_deg))
    with pytest.warns(UserWarning, match="beyond 0.5 m or 2 degrees the map is of three dimensions. Poses of x, y and heading make it"):
        assert as_plan(scans, "drive") is scans


def lidar_rings(degrees, height, beams=360):
    """Where beams of these elevations meet a bare floor, or a wall 20 m around above it, in the lidar's frame."""
    angle, rise = (part.ravel() for part in np.meshgrid(2 * np.pi * np.arange(beams) / beams, np.deg2rad(degrees)))
    away = np.where(rise < 0, np.minimum(height / np.tan(np.maximum(-rise, 1e-9)), 20), 20)
    return np.column_stack([away * np.cos(angle), away * np.sin(angle), away * np.tan(rise)])


@pytest.mark.parametrize("degrees", [np.arange(-15, 16, 2), [-15, -13], [-1], [-1, 1]])
def test_a_lidar_is_none_even_if_only_the_floor_answers(degrees, recwarn):
    scans = placed([lidar_rings(degrees, 1.5)] * 5, [np.column_stack([np.eye(3), [k, 0, 0]]) for k in range(5)])
    assert as_plan(scans, "drive") is scans and not recwarn.list


def test_other_scans_are_left_as_they_are(recwarn):
    for scans in (box_room(), square_room()):
        assert as_plan(scans, "drive") is scans
    assert not recwarn.list


def test_a_folder_of_planar_clouds(tmp_path):
    """Written and read, to the digits of files; and what the warning says of poses."""
    sweeps, poses = posed([0.0, 0.3, 0.7], [0.0, 0.5, 2.5])
    write_drive(tmp_path, sweeps, poses, "{}.npz", lambda path, points: write_npz(path, points.astype(np.float32)))
    with pytest.warns(UserWarning, match="the map is of three dimensions"):
        assert as_plan(read_scan_folder(tmp_path), tmp_path).dimension == 3
    np.savetxt(tmp_path / "poses.txt", [[*pose[:2, 3], 0.0] for pose in poses])
    with pytest.warns(UserWarning, match="the map is of two dimensions"):
        assert as_plan(read_scan_folder(tmp_path), tmp_path).dimension == 2
