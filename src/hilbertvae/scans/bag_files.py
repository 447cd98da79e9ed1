"""Which paths are ROS bags, and which of them can't be read whole."""

from __future__ import annotations

import itertools
import os
import re
import shlex
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import reading
from hilbertvae.scans.plain_yaml import check_plain_yaml
from hilbertvae.scans.pose_track import LONGEST_HOLE_S

BAG_FILES = (".bag", ".mcap", ".db3")
METADATA = "metadata.yaml"
MOST_METADATA_BYTES = 2**24
"""A recording of a thousand files has a hundredth of it."""
MCAP_ENDS = b"\x89MCAP0\r\n"
"""What an MCAP file begins and ends with."""
ROS1, ROS1_HEADER = b"#ROSBAG V2.0\n", 4096 + 13
"""What a ROS 1 bag begins with, and within how many bytes it says where its index is."""
PART = re.compile(r"(.*)_(\d+)")
"""The name of a part of a recording, and its number."""
MOST_OVERLAP_S = 1.0
"""So much earlier than the last message of a part the next one may begin, and so much later as `LONGEST_HOLE_S` says."""
INDEX_PLACE = re.compile(rb"index_pos=(.{8})", re.DOTALL)


def is_bag(path: str | os.PathLike) -> bool:
    """Whether a path is a bag by its name, or a folder by what is in it."""
    path = Path(path)
    if path.suffix.lower() in BAG_FILES and not path.is_dir():
        return True
    if not (path / METADATA).is_file():
        return path.is_dir() and bool(_numbered(path))
    # Other folders of scans have a file of that name, too.
    return b"rosbag2" in (path / METADATA).read_bytes() or any(file.suffix.lower() in BAG_FILES for file in path.iterdir())


def bag_parts(path: Path) -> list[Path]:
    """What is to be opened of a bag, in the order of recording: itself, or the files of a folder that a recorder split it into."""
    return _numbered(path) if path.is_dir() and not (path / METADATA).is_file() else [path]


def check_order(spans: list[tuple[Path, int, int]]) -> None:
    """An `InputError` unless each part, with the times of its first and last message in nanoseconds, follows the one before."""
    for (before, _, end_ns), (part, start_ns, _) in itertools.pairwise(spans):
        if not -MOST_OVERLAP_S * 1e9 <= start_ns - end_ns <= LONGEST_HOLE_S * 1e9:
            raise InputError(
                f"{part.parent}: expected the parts of one recording, and {part.name} begins {(start_ns - end_ns) / 1e9:.3g} s after the "
                f"end of {before.name}; bags of several drives are read one by one"
            )


def _numbered(folder: Path) -> list[Path]:
    """The bags of a folder if they are named as recorders name the parts of one, from `name_0` on; `rosbag record --split` puts the time
    into each name, too. Else none."""
    files = [file for file in folder.iterdir() if file.suffix.lower() in BAG_FILES and file.is_file()]
    names = [PART.fullmatch(file.stem) for file in files]
    if not all(names) or len({(re.sub(r"\d", "", name[1]), file.suffix) for name, file in zip(names, files, strict=True)}) != 1:
        return []
    found = sorted((int(name[2]), file) for name, file in zip(names, files, strict=True))
    in_order = len(found) > 1 and [number for number, _ in found] == list(range(len(found)))
    return [file for _, file in found] if in_order else []


def check_files(path: Path) -> None:
    """An `InputError` for a .db3 of which rosbags would read another file, or a part: it hands its path to SQLite as a URI, unescaped,
    and doesn't look at what a recorder that was cut off has left in the log beside it. Also for an .mcap or a .bag that was cut off."""
    if (path / METADATA).is_file():
        with reading(path / METADATA, "metadata of a bag (YAML)"):
            check_plain_yaml(path / METADATA, MOST_METADATA_BYTES)
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if file.suffix.lower() == ".mcap" and file.is_file():
            _check_end(file)
        if file.suffix.lower() == ".bag" and file.is_file():
            _check_index(file)
        if file.suffix.lower() != ".db3":
            continue
        if strange := re.search(r"[?#]|%[0-9a-fA-F]{2}", str(file)):
            raise InputError(f"{file}: expected a path without ? and # and % before two digits, found {strange[0]}; rename or move the bag")
        log = file.with_name(f"{file.name}-wal")
        if log.is_file() and log.stat().st_size:
            merge = f"sqlite3 {shlex.quote(str(file))} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            raise InputError(
                f"{file}: its last messages are in {log.name} still, as a recorder that was cut off leaves them; merge: {merge}"
            )


def _check_end(file: Path) -> None:
    with file.open("rb") as opened:
        begins = opened.read(len(MCAP_ENDS)) == MCAP_ENDS
        opened.seek(max(file.stat().st_size - len(MCAP_ENDS), 0))
        ends = opened.read() == MCAP_ENDS
    if begins and not ends:
        mended = shlex.quote(str(file.with_name(f"{file.stem}_mended.mcap")))
        raise InputError(
            f"{file}: expected an MCAP with its end, this one was cut off; what it has is saved by: mcap recover {shlex.quote(str(file))} "
            f"-o {mended}"
        )


def _check_index(file: Path) -> None:
    """Behind its messages a ROS 1 bag has an index, and ahead of them where that is: at 0 as long as it is written."""
    with file.open("rb") as opened:
        head = opened.read(ROS1_HEADER)
    place = INDEX_PLACE.search(head) if head.startswith(ROS1) else None
    if place and not 0 < int.from_bytes(place[1], "little") < file.stat().st_size:
        raise InputError(
            f"{file}: expected a bag with its index, this one was cut off or never closed; what it has is saved by: rosbag reindex "
            f"{shlex.quote(str(file))}"
        )
