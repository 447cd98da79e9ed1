"""Bags that rosbags would read another file of, or a part."""

import shutil
import sqlite3

import pytest
from bag_scene import bag_file, write_scene

from hilbertvae.checks import InputError
from hilbertvae.scans.bags import read_bag


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
