import warnings

import numpy as np
import pytest
from point_writers import POINTS, random_poses, write_drive, write_npz, write_ply

from hilbertvae.checks import InputError
from hilbertvae.scans.carmen import read_carmen
from hilbertvae.scans.formats import ReadingSettings, is_scan_path, read_scans_path
from hilbertvae.scans.kitti import read_kitti
from hilbertvae.scans.point_files import read_point_file
from hilbertvae.scans.scan_folder import read_scan_folder
from hilbertvae.scans.sites import CATALOGUE
from toy_rooms import carmen_line, write_log


def same(found, expected):
    for name in ("points", "origins", "scan", "beam"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize("name", ["a.log", "a.log.gz"])
def test_a_carmen_log(tmp_path, name):
    ranges = np.random.default_rng(0).uniform(1, 50, (4, 180))
    path = write_log(tmp_path / name, [carmen_line(row, [number, 0, 0]) for number, row in enumerate(ranges)])
    same(read_scans_path(path), read_carmen(path))
    same(read_scans_path(path, ReadingSettings(max_range_m=9.0, every=2)), read_carmen(path, 9.0, 2))
    expected = read_carmen(path)
    far = np.linalg.norm(expected.points - expected.origins, axis=1) > 5.0
    same(read_scans_path(path, ReadingSettings(min_range_m=5.0)), expected.select(far))
    for setting in ({"sensor_origin_m": [0.0, 0.0]}, {"beam_origin": "hdl64"}):
        with pytest.raises(InputError, match=f"reading.{next(iter(setting))}: .*{name} is a CARMEN log"):
            read_scans_path(path, ReadingSettings(**setting))
    with pytest.raises(InputError, match="expected ranges of 29.9999 to 30.0 m, found none"):
        read_scans_path(path, ReadingSettings(min_range_m=29.9999))


def test_folders(tmp_path):
    drive, plain = tmp_path / "drive", tmp_path / "plain.ply"
    write_drive(drive, POINTS.reshape(3, 20, 3) / 6, random_poses(3), "velodyne/{:06d}.bin")
    write_drive(plain, POINTS.reshape(3, 20, 3) / 6, random_poses(3), "{}.ply", write_ply)
    assert len(read_kitti(drive)) < len(read_scan_folder(plain)) == 60
    same(read_scans_path(drive), read_kitti(drive))
    same(read_scans_path(str(plain)), read_scan_folder(plain))
    settings = ReadingSettings(max_range_m=6.0, min_range_m=1.0, every=2, beam_origin="hdl64")
    same(read_scans_path(drive, settings), read_kitti(drive, "hdl64", 6.0, 1.0, 2))
    with pytest.raises(InputError, match="reading.sensor_origin_m: .*drive is a folder of scans"):
        read_scans_path(drive, ReadingSettings(sensor_origin_m=[0, 0, 0]))


@pytest.mark.parametrize("name", ["a.log", "a.clf.gz", "a.bag", "a.mcap", "a.yaml"])
def test_a_folder_may_be_named_as_a_file_is(tmp_path, name):
    folder = write_drive(tmp_path / name, POINTS.reshape(3, 20, 3), random_poses(3))
    same(read_scans_path(folder), read_scan_folder(folder))


def test_single_files(tmp_path):
    path = write_npz(tmp_path / "a.NPZ.npz")
    with pytest.raises(InputError, match="reading.sensor_origin_m"):
        read_scans_path(path)
    same(read_scans_path(path, ReadingSettings(9.0, 1.0, 1, [1, 2, 3])), read_point_file(path, [1, 2, 3], 9.0, 1.0))
    with pytest.raises(InputError, match="reading.beam_origin: .* is a single point file"):
        read_scans_path(path, ReadingSettings(sensor_origin_m=[0, 0, 0], beam_origin="hdl64"))


def test_unknown_and_missing_paths(tmp_path):
    (tmp_path / "a.abc").write_bytes(b"?")
    with pytest.raises(InputError, match=r"a.abc: unknown extension '.abc'; known are .log .log.gz .clf .clf.gz .bag .mcap .* and folders"):
        read_scans_path(tmp_path / "a.abc")
    for name in ("nowhere", "nowhere.abc", "nowhere.ply", "nowhere.log"):
        with pytest.raises(InputError, match=f"{name}: no such file"):
            read_scans_path(tmp_path / name)


@pytest.mark.parametrize("setting", [{"topic": "/scan"}, {"fixed_frame": "map"}, {"poses": "kiss_icp"}])
def test_settings_of_other_formats_are_refused(tmp_path, setting):
    log = write_log(tmp_path / "a.log", [carmen_line(np.full(180, 5.0), [0, 0, 0])])
    folder = write_drive(tmp_path / "drive", POINTS.reshape(3, 20, 3), random_poses(3))
    for path in (log, write_npz(tmp_path / "a.npz"), *([] if "poses" in setting else [folder])):
        with pytest.raises(InputError, match=f"reading.{next(iter(setting))}: .*{path.name} is a .*, where this has no meaning"):
            read_scans_path(path, ReadingSettings(**setting))


def test_a_folder_of_bags(tmp_path):
    for name in ("b.bag", "a.mcap"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(
        InputError, match="expected scans, a ROS 2 bag with metadata.yaml, or the parts of .*; found bags .* one by one: a.mcap, b.bag"
    ):
        read_scans_path(tmp_path)


def test_a_folder_of_scans_may_have_metadata_of_its_own(tmp_path):
    folder = write_drive(tmp_path / "drive", POINTS.reshape(3, 20, 3), random_poses(3))
    before = len(read_scans_path(folder))
    (folder / "metadata.yaml").write_text("sensor: a lidar\n")
    assert len(read_scans_path(folder)) == before


def test_what_is_a_path_and_what_a_name():
    paths = ["a.bag", "a.MCAP", "a.db3", "a.e57"]
    paths += ["a.log", "a.LOG.gz", "street.ply", "a/b", "./intel", "/data/drive", "drive/", ".", "..", "x.LAZ", "000000.bin"]
    assert all(map(is_scan_path, paths))
    assert not any(map(is_scan_path, [*CATALOGUE, "simulated:0", "kitti_drive0005", "", "log", "ply"]))


def test_what_ranges_left_out_is_counted(tmp_path):
    """Of a log, a folder and a file: the numbers of returns on either side, those without a length or a return aside."""
    ranges = np.array([[0.0, 1.0, 5.0, 29.0, 31.0, 35.0], [0.0, 0.9, 1.5, 28.0, 40.0, 81.91]])
    log = write_log(tmp_path / "a.log", [carmen_line(row, [0, 0, 0]) for row in ranges])
    assert read_scans_path(log, ReadingSettings(min_range_m=1.0, max_range_m=30.0)).left_out == (2, 4, 12)
    points = np.column_stack([[1.0, 2.0, 3.0, 70.0, 90.0, np.nan], np.zeros((6, 2))])
    limits = {"min_range_m": 1.5, "max_range_m": 80.0}
    single = read_scans_path(write_npz(tmp_path / "a.npz", points), ReadingSettings(sensor_origin_m=[0, 0, 0], **limits))
    folder = read_scans_path(write_drive(tmp_path / "drive", [points[:5]] * 2, random_poses(2)), ReadingSettings(**limits))
    assert single.left_out == (1, 1, 5) and folder.left_out == (2, 2, 10)


def test_a_near_limit_that_nobody_gave_and_takes_much_is_told(tmp_path):
    """KITTI's, of a robot indoors."""
    drive = write_drive(tmp_path / "drive", POINTS.reshape(3, 20, 3) / 9, random_poses(3), "velodyne/{:06d}.bin")
    near = np.count_nonzero(np.linalg.norm(POINTS / 9, axis=1) <= 2.5)
    told = f"drive: {near} of 60 returns are 2.5 m or nearer and are left out, .*; reading.min_range_m=0 keeps them"
    with pytest.warns(UserWarning, match=told):
        assert read_scans_path(drive).left_out.near == near > 6
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_scans_path(drive, ReadingSettings(min_range_m=2.5))) == 60 - near
        assert len(read_scans_path(drive, ReadingSettings(min_range_m=0.0))) == 60
