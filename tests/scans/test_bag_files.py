"""Bags that rosbags would read another file of, or a part."""

import shutil
import sqlite3

import numpy as np
import pytest
from bag_scene import CLOUDS, LIDAR_ON_BASE, bag_file, base_in_odom, write_scene
from bag_writers import bag, moved

from hilbertvae.checks import InputError
from hilbertvae.scans.bag_files import check_files
from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.formats import ReadingSettings, read_scans_path


@pytest.fixture
def recorded(tmp_path):
    return write_scene(tmp_path / "run", "sqlite", lasers=0)


@pytest.mark.parametrize("name", ["run%20A", "run#1", "run?1"])
def test_a_path_that_sqlite_would_take_for_another_is_refused(tmp_path, recorded, name):
    (tmp_path / "run A").mkdir()
    shutil.copytree(recorded, tmp_path / "run A/run")  # which would be read in place of the first
    shutil.copytree(recorded, tmp_path / name / "run")
    with pytest.raises(InputError, match="expected a path without . and # and % before two digits, found .*; rename or move the bag"):
        read_bag(tmp_path / name / "run")
    with pytest.raises(InputError, match="rename or move the bag"):
        read_bag(bag_file(tmp_path / name / "run"))


def test_other_names_are_read(tmp_path, recorded):
    for name in ("100% sure", "a & b+c", "søk"):
        assert len(read_bag(shutil.copytree(recorded, tmp_path / name / "run"))) == len(read_bag(recorded))


def test_messages_that_a_recorder_left_in_the_log_are_not_missed(tmp_path, recorded):
    file = bag_file(recorded)
    whole = len(read_bag(recorded))
    with sqlite3.connect(file) as database:
        database.execute("PRAGMA journal_mode=WAL")
        rows = database.execute("SELECT * FROM messages").fetchall()
        database.execute("DELETE FROM messages")
        database.commit()
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        database.execute("PRAGMA wal_autocheckpoint=0")
        database.executemany(f"INSERT INTO messages VALUES ({','.join('?' * len(rows[0]))})", rows)
        database.commit()
        cut_off = shutil.copytree(recorded, tmp_path / "cut_off")
    log = f"{bag_file(cut_off).name}-wal"
    for path in (cut_off, bag_file(cut_off)):
        with pytest.raises(InputError, match=f"its last messages are in {log} still, .* merge: sqlite3 .* 'PRAGMA wal_checkpoint"):
            read_bag(path)
    with sqlite3.connect(bag_file(cut_off)) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    assert len(read_bag(cut_off)) == whole


@pytest.mark.parametrize("cut", [9, 1000])
def test_what_mends_an_mcap_that_was_cut_off_is_told(tmp_path, cut):
    folder = write_scene(tmp_path / "my run", "mcap", lasers=0)
    file = bag_file(folder)
    file.write_bytes(file.read_bytes()[:-cut])
    for path in (folder, file):
        with pytest.raises(
            InputError, match=r"mcap: expected an MCAP with its end, .* by: mcap recover '.*/my run/.*\.mcap' -o '.*_mended"
        ):
            read_bag(path)


def test_what_mends_a_ros_1_bag_that_was_cut_off_is_told(tmp_path):
    """Also of one that was never closed, whose index is at 0."""
    path = write_scene(tmp_path / "my run.bag", "ros1", lasers=0)
    whole = path.read_bytes()
    place = whole.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(whole[place : place + 8], "little")
    for content in (whole[:index], whole[: len(whole) // 2], whole[:place] + bytes(8) + whole[place + 8 :]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"run.bag: expected a bag with its index, .* by: rosbag reindex '.*/my run.bag'$"):
            read_bag(path)


def write_parts(folder, kind, names, starts=(0, 2, 4)):
    """A recording that was split every two seconds; where the sensors are is in the first part alone. Returns its scans."""
    folder.mkdir()
    expected = []
    for name, start in zip(names, starts, strict=True):
        made_at = folder / name if kind == "ros1" else folder / f"{name}-made"
        with bag(made_at, kind) as made:
            if not start:
                made.transform("/tf_static", 0, "base", "lidar", LIDAR_ON_BASE)
            for step in range(9):
                second = start + step / 4
                made.transform("/tf", second, "odom", "base", base_in_odom(second))
            cloud = CLOUDS[len(expected)]
            made.cloud("/points", start + 1.1, "lidar", cloud)
            expected.append(moved(cloud, LIDAR_ON_BASE, base_in_odom(start + 1.1)))
        if kind != "ros1":
            bag_file(made_at).rename(folder / f"{name}.{'mcap' if kind == 'mcap' else 'db3'}")
            shutil.rmtree(made_at)
    return expected


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("ros1", ["2024-05-01-09-59-58_0.bag", "2024-05-01-10-00-00_1.bag", "2024-05-01-10-00-02_2.bag"]),
        ("mcap", ["run_0", "run_1", "run_2"]),
        ("sqlite", ["run_0", "run_1", "run_2"]),
    ],
)
def test_the_parts_of_one_recording_are_read_as_one(tmp_path, kind, names):
    expected = write_parts(tmp_path / "run", kind, names)
    found = read_scans_path(tmp_path / "run")
    for number, points in enumerate(expected):
        np.testing.assert_allclose(found.points[found.scan == number], points, rtol=0, atol=1e-6)
    every = read_scans_path(tmp_path / "run", ReadingSettings(every=2))
    np.testing.assert_array_equal(every.points, found.points[found.scan != 1])


@pytest.mark.parametrize(
    "names", [["a_0.bag", "b_1.bag"], ["a_1.bag", "a_2.bag"], ["a_0.bag", "a_2.bag"], ["a0.bag", "a1.bag"], ["a_0.bag"]]
)
def test_bags_that_are_not_named_as_parts_are_read_one_by_one(tmp_path, names):
    write_parts(tmp_path / "run", "ros1", names, starts=(0, 2)[: len(names)])
    with pytest.raises(InputError, match=f"run: expected .* found bags to be read one by one: {', '.join(names)}"):
        read_scans_path(tmp_path / "run")


@pytest.mark.parametrize(("starts", "said"), [((0, 60), "58"), ((2, 0), "-4"), ((0, 0), "-2")])
def test_drives_at_other_times_are_no_parts(tmp_path, starts, said):
    write_parts(tmp_path / "run", "ros1", ["a_0.bag", "a_1.bag"], starts)
    with pytest.raises(InputError, match=f"run: expected the parts of one recording, and a_1.bag begins {said} s after the end of a_0.bag"):
        read_scans_path(tmp_path / "run")


@pytest.mark.parametrize("cut", [100, 5000, None])
@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite"])
def test_a_part_that_was_cut_off_is_named(tmp_path, kind, cut):
    write_parts(tmp_path / "run", kind, ["a_0.bag", "a_1.bag"] if kind == "ros1" else ["a_0", "a_1"], starts=(0, 2))
    file = max((tmp_path / "run").iterdir())
    file.write_bytes(file.read_bytes()[:-cut] if cut else b"")
    with pytest.raises(InputError, match=file.name):
        read_scans_path(tmp_path / "run")


def test_metadata_that_would_grow_beyond_all_memory_is_refused(tmp_path):
    lines = ["rosbag2_bagfile_information: &a0 {x: 1}", *(f"a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}" for k in range(1, 40))]
    (tmp_path / "metadata.yaml").write_text("\n".join(lines))
    (tmp_path / "x.db3").write_bytes(b"SQLite format 3")
    with pytest.raises(InputError, match="metadata.yaml: expected YAML without aliases"):
        check_files(tmp_path)
