import errno
import hashlib
import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from hilbertvae.files import atomic, file_sha256, folder_sha256, hash_of, json_object, path_sha256, write_json


def test_a_block_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "deep" / "result.json"
    write_json(path, {"a": 1})
    with pytest.raises(RuntimeError, match="killed"), atomic(path) as temporary:
        temporary.write_text("half of a fi")
        raise RuntimeError("killed")
    assert json.loads(path.read_text()) == {"a": 1}
    assert [found.name for found in path.parent.iterdir()] == ["result.json"]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "[Errno 28] No space left on device: '{}'"),
        (OSError("Not enough free space to write 9 bytes"), "[Errno 5] Not enough free space to write 9 bytes: '{}'"),
        (PermissionError(errno.EACCES, "Permission denied", "elsewhere"), "[Errno 13] Permission denied: 'elsewhere'"),
    ],
)
def test_an_error_of_writing_names_the_file(error, said, tmp_path):
    path = tmp_path / "grids.npy"
    with pytest.raises(OSError) as raised, atomic(path):  # noqa: PT011 (its message is what is tested)
        raise error
    assert str(raised.value) == said.format(path) and list(tmp_path.iterdir()) == []


def test_an_error_about_the_temporary_file_names_the_file(tmp_path, monkeypatch):
    def refused(temporary, **how):
        raise PermissionError(errno.EACCES, "Permission denied", str(temporary))

    monkeypatch.setattr(Path, "touch", refused)
    monkeypatch.setattr(Path, "unlink", refused)  # as of a disk that can't be written
    with pytest.raises(PermissionError) as raised, atomic(tmp_path / "grids.npy"):
        pass
    assert raised.value.filename == str(tmp_path / "grids.npy")


def test_what_is_no_object_in_a_file_is_none(tmp_path):
    path = tmp_path / "mark.json"
    assert json_object(path) == json_object(tmp_path) == {}
    for content in (b"", b"{", b"[1]", b"3", b"\xff"):
        path.write_bytes(content)
        assert json_object(path) == {}
    write_json(path, {"a": "\u00e4"})
    assert json_object(path) == {"a": "\u00e4"}


def test_the_file_is_not_there_until_the_block_ends(tmp_path):
    path = tmp_path / "grids.npy"
    with atomic(path) as temporary:
        temporary.write_bytes(b"123")
        assert not path.exists()
        assert temporary.suffix == ".npy" and temporary.parent == tmp_path
    assert path.read_bytes() == b"123"


def test_the_file_gets_the_usual_rights_not_those_of_a_temporary_one(tmp_path):
    ordinary, path = tmp_path / "ordinary", tmp_path / "atomic"
    ordinary.touch()
    with atomic(path):
        pass
    assert os.stat(path).st_mode == os.stat(ordinary).st_mode


def test_files_written_by_threads_leave_the_umask_as_it_was(tmp_path, monkeypatch):
    set_umask = os.umask
    before = set_umask(0o027)

    def slowly(mask):
        was = set_umask(mask)
        time.sleep(0.05)
        return was

    monkeypatch.setattr(os, "umask", slowly)
    try:
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda name: write_json(tmp_path / name, {}), "abcd"))
        (tmp_path / "ordinary").touch()
        assert {os.stat(path).st_mode & 0o777 for path in tmp_path.iterdir()} == {0o640}
    finally:
        set_umask(before)


def test_links_to_nothing_to_themselves_and_odd_names(tmp_path):
    folder = tmp_path / "drive"
    folder.mkdir()
    (folder / "0.bin").write_bytes(b"x")
    first = folder_sha256(folder)
    (folder / "images").symlink_to(tmp_path / "nowhere")
    (folder / "latest").symlink_to(folder)
    assert folder_sha256(folder) == first
    with open(os.fsencode(folder) + b"/\xff.bin", "wb"):
        pass
    assert folder_sha256(folder) != first


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_json_without_numbers_that_json_lacks(tmp_path, value):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "result.json", {"auc": value})
    assert not list(tmp_path.iterdir())


def test_hash_of_a_file(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"FLASER" * 100_000)
    assert file_sha256(path) == hashlib.sha256(b"FLASER" * 100_000).hexdigest()


def test_hash_of_settings_sees_content_and_not_order():
    assert hash_of({"a": 1, "b": [2, 3]}) == hash_of({"b": [2, 3], "a": 1})
    different = [{"a": 1}, {"a": 2}, {"a": "1"}, {"b": 1}, {"a": [1]}, {"a": None}]
    assert len({hash_of(content) for content in different}) == len(different)
    assert len(hash_of({}, digits=12)) == 12


def test_the_hash_of_a_folder_sees_names_contents_and_linked_folders_and_no_hidden_files(tmp_path):
    elsewhere, folder = tmp_path / "elsewhere", tmp_path / "drive"
    elsewhere.mkdir()
    folder.mkdir()
    (elsewhere / "0.bin").write_bytes(b"scan")
    (folder / "poses.txt").write_text("1")
    (folder / "velodyne").symlink_to(elsewhere)
    first = folder_sha256(folder)
    (folder / ".DS_Store").write_bytes(b"x")
    assert folder_sha256(folder) == first
    (elsewhere / "0.bin").write_bytes(b"another")
    second = folder_sha256(folder)
    (elsewhere / "0.bin").rename(elsewhere / "1.bin")
    assert len({first, second, folder_sha256(folder)}) == 3


def test_a_site_is_hashed_once_while_it_stays_as_it_is(tmp_path, monkeypatch):
    drive, log = tmp_path / "drive", tmp_path / "one.log"
    drive.mkdir()
    (drive / "0.bin").write_bytes(b"abcd")
    log.write_bytes(b"efgh")
    assert (path_sha256(drive), path_sha256(log)) == (folder_sha256(drive), file_sha256(log))
    read = []
    monkeypatch.setattr("hilbertvae.files.file_sha256", lambda path: read.append(path) or file_sha256(path))
    before = path_sha256(drive), path_sha256(log)
    assert not read and path_sha256(str(drive)) == before[0]
    (drive / "0.bin").write_bytes(b"abce")  # as long as before
    write_json(drive / "1.json", {})
    os.utime(log, ns=(0, 0))
    assert path_sha256(drive) == folder_sha256(drive) != before[0] and path_sha256(log) == before[1] and log in read
    log.unlink()
    with pytest.raises(FileNotFoundError):
        path_sha256(log)


def test_a_link_stays_one_and_what_it_leads_to_is_replaced(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk/real.json").write_text("{}")
    (tmp_path / "latest.json").symlink_to("disk/real.json")
    (tmp_path / "next.json").symlink_to("disk/new.json")
    write_json(tmp_path / "latest.json", {"a": 1})
    write_json(tmp_path / "next.json", {"b": 2})
    assert (tmp_path / "latest.json").is_symlink() and json_object(tmp_path / "disk/real.json") == {"a": 1}
    assert (tmp_path / "next.json").is_symlink() and json_object(tmp_path / "disk/new.json") == {"b": 2}
    (tmp_path / "grids.npz").symlink_to("disk/blob")
    with atomic(tmp_path / "grids.npz") as temporary:
        np.savez(temporary, a=np.arange(3))
    assert np.load(tmp_path / "grids.npz")["a"].tolist() == [0, 1, 2]
    assert sorted(path.name for path in (tmp_path / "disk").iterdir()) == ["blob", "new.json", "real.json"]
