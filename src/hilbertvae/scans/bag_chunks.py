"""Packed parts of ROS bags, unpacked no further than what sensors say ever grows: rosbags unpacks whatever a file holds."""

from __future__ import annotations

import bz2
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import BinaryIO, Self

from hilbertvae.checks import InputError, extra_module, named
from hilbertvae.scans.file_points import MAX_EXPANSION, SMALL_BYTES


@contextmanager
def bounded_unpacking(path: Path) -> Iterator[None]:
    """While the block runs, rosbags unpacks chunks, messages and files through this module: an `InputError` that names the bag at `path`
    for one that grows beyond `MAX_EXPANSION` times its size, and `SMALL_BYTES`, before more memory or disk is taken for it."""
    ros1, ros2, mcap = (extra_module("bags", f"rosbags.{name}") for name in ("rosbag1.reader", "rosbag2.reader", "rosbag2.storage_mcap"))
    lz4, zstd = extra_module("bags", "lz4.frame"), ros2.zstd

    def of(make: Callable) -> Callable:
        def unpack(data: bytes, *_: object) -> bytes:
            with named(path):
                return unpacked(make, data)

        return unpack

    def zstd_file(file: BinaryIO, mode: str) -> BinaryIO:
        packed = file.seek(0, 2)
        file.seek(0)
        return _BoundedFile(zstd.open(file, mode), path, packed)

    bounded = {"bz2": of(bz2.BZ2Decompressor), "lz4": of(lz4.LZ4FrameDecompressor), "zstd": of(zstd.ZstdDecompressor)}
    with ExitStack() as stack:
        for table in (ros1.decompressors, mcap.DECOMPRESSORS):
            for name in bounded.keys() & table.keys():
                stack.callback(table.__setitem__, name, table[name])
                table[name] = bounded[name]
        stack.callback(setattr, ros2, "zstd", zstd)
        ros2.zstd = SimpleNamespace(decompress=bounded["zstd"], open=zstd_file)
        yield


def unpacked(make: Callable, data: bytes) -> bytes:
    """What `data` holds, one packed stream after the other; `make` makes a decompressor as `bz2.BZ2Decompressor` is one."""
    room, found, left = _most(len(data)) + 1, bytearray(), data
    while left or not found:
        stream = make()
        found += stream.decompress(left, max_length=room - len(found))
        _check(len(found), len(data))
        if not stream.eof:
            raise InputError(f"truncated: {len(data)} packed bytes end too early")
        if not stream.unused_data:
            break
        left = stream.unused_data
    return bytes(found)


class _BoundedFile:
    """A packed file of `packed` bytes, read from its start to its end."""

    def __init__(self, file: BinaryIO, path: Path, packed: int):
        self.file, self.path, self.packed, self.found = file, path, packed, 0

    def __enter__(self) -> Self:
        self.file.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.file.__exit__(*error)

    def read(self, size: int) -> bytes:
        piece = self.file.read(size)
        self.found += len(piece)
        with named(self.path):
            _check(self.found, self.packed)
        return piece


def _check(found: int, packed: int) -> None:
    if found > _most(packed):
        raise InputError(f"forged: {packed} packed bytes grow beyond {_most(packed)}")


def _most(packed: int) -> int:
    return max(SMALL_BYTES, MAX_EXPANSION * packed)
