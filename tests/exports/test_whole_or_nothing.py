"""A disk that is full while a map is written: what was there stays, and nothing half-written is left."""

import contextlib
import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from export_toys import random_cells
from filelock import FileLock

from hilbertvae.exports.grid_npz import write_grid
from hilbertvae.exports.map_folder import SUMMARY, replace_map, writing_beside
from hilbertvae.exports.mesh_ply import write_mesh_ply
from hilbertvae.exports.octree import write_octree_map
from hilbertvae.exports.points_ply import write_points_ply
from hilbertvae.exports.ros_map import write_ros_map
from hilbertvae.files import atomic, write_json
from hilbertvae.signals import stopped_by_signals

WRITERS = {
    "map.yaml": (write_ros_map, 2),
    "map.ot": (write_octree_map, 3),
    "map.bt": (write_octree_map, 2),
    "points.ply": (write_points_ply, 3),
    "mesh.ply": (write_mesh_ply, 3),
    "map.npz": (write_grid, 2),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("there", [False, True])
def test_a_full_disk(tmp_path, monkeypatch, name, there):
    write, dimension = WRITERS[name]
    if there:
        write(random_cells(dimension, seed=1), tmp_path / name)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write(random_cells(dimension, seed=2), tmp_path / name)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def earlier_map(output):
    """What a map of other scans left."""
    output.mkdir()
    for name in ("map.npz", "map.bt", "map_observed.bt"):
        (output / name).write_text("old")
    write_json(output / SUMMARY, {"files": ["map.npz", "map.bt", "map_observed.bt"]})
    return output


def new_map(folder):
    folder.mkdir()
    (folder / "map.npz").write_text("new")
    (folder / "map.safetensors").write_text("new")
    write_json(folder / SUMMARY, {"files": ["map.npz", "map.safetensors"]})
    return folder


def contents(output):
    return {path.name: path.read_text() for path in output.iterdir() if path.name != SUMMARY}


@pytest.mark.parametrize("nth", [1, 2, 3])
def test_a_map_that_is_stopped_while_it_replaces_another_is_whole(tmp_path, monkeypatch, nth):
    """Whenever it is stopped: no folder has files of both."""
    output, folder, moved = earlier_map(tmp_path / "out"), new_map(tmp_path / "new"), []
    replace = os.replace

    def stopping(*places):
        if Path(places[0]).parent == folder:
            moved.append(places)
            if len(moved) == nth:
                os.kill(os.getpid(), signal.SIGTERM)
        replace(*places)

    monkeypatch.setattr(os, "replace", stopping)
    with pytest.raises(KeyboardInterrupt), stopped_by_signals():
        replace_map(folder, output, ["map.npz", "map.safetensors"])
    assert contents(output) == {"map.npz": "new", "map.safetensors": "new"}
    assert json.loads((output / SUMMARY).read_text())["files"] == ["map.npz", "map.safetensors"]


def test_a_map_that_was_ended_by_force_says_so_and_can_be_made_again(tmp_path, monkeypatch):
    output, folder = earlier_map(tmp_path / "out"), new_map(tmp_path / "new")
    replace = os.replace

    def ended(source, target):
        if Path(source).name == "map.safetensors":
            raise SystemExit("killed")
        replace(source, target)

    monkeypatch.setattr(os, "replace", ended)
    with pytest.raises(SystemExit):
        replace_map(folder, output, ["map.npz", "map.safetensors"])
    assert json.loads((output / SUMMARY).read_text())["unfinished"] is True
    monkeypatch.undo()
    again = new_map(tmp_path / "again")
    replace_map(again, output, ["map.npz", "map.safetensors"])
    assert contents(output) == {"map.npz": "new", "map.safetensors": "new"}
    assert "unfinished" not in json.loads((output / SUMMARY).read_text())


@pytest.mark.parametrize("file", ["map.safetensors", None])
def test_a_file_that_can_t_be_written_is_told_as_the_folder_that_was_asked_for(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def writing(files):  # from Python 3.12 on temporary folders are named from the root
        return atomic(files.absolute() / file) if file else contextlib.nullcontext()

    with pytest.raises(OSError) as raised, writing_beside(Path("map")) as files, writing(files):  # noqa: PT011 (its message is tested)
        raise OSError(errno.ENOSPC, "No space left on device")
    assert str(raised.value) == "[Errno 28] No space left on device: 'map'"
    assert list(tmp_path.iterdir()) == []


def test_a_file_system_without_locks(tmp_path, monkeypatch):
    def none(lock, *given, **more):
        raise NotImplementedError("flock")

    monkeypatch.setattr(FileLock, "acquire", none)
    with writing_beside(tmp_path) as living:
        (living / "map.npz").touch()
        with writing_beside(tmp_path):
            assert (living / "map.npz").exists()
    assert not list(tmp_path.iterdir())


def test_what_a_killed_run_left_is_taken_away_and_what_a_living_one_writes_is_not(tmp_path):
    killed = "import os, signal, sys; from pathlib import Path; from hilbertvae.exports.map_folder import writing_beside\n"
    killed += "with writing_beside(Path(sys.argv[1])) as folder: (folder / 'map.npz').touch(); os.kill(os.getpid(), signal.SIGKILL)"
    subprocess.run([sys.executable, "-c", killed, str(tmp_path)], check=False)
    (left,) = tmp_path.iterdir()
    assert (left / "files/map.npz").exists()
    with writing_beside(tmp_path) as living:
        with writing_beside(tmp_path) as other:
            assert {*tmp_path.iterdir()} == {living.parent, other.parent} and not list(other.iterdir())
        assert {*tmp_path.iterdir()} == {living.parent}
    assert not list(tmp_path.iterdir())
