"""Files that are whole or not there, and the hashes that name them."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

HASHED = 256
"""Paths whose hashes are remembered."""
TEMPORARY = re.compile(r"\..*-[0-9a-f]{8}(\.[^.]*)?")
"""The names of `atomic`'s temporary files."""


@contextmanager
def atomic(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary path beside `path`; it replaces `path` when the block ends well and is removed when it does not. A link stays one: what
    it leads to is replaced. An `OSError` that names no file, as of a full disk, or the temporary one, names `path`."""
    suffix = Path(path).suffix  # the given one: what a link leads to may have none, and numpy would add its own
    path = Path(os.path.realpath(path)) if os.path.islink(path) else Path(path)
    temporary = path.parent / f".{path.stem}-{secrets.token_hex(4)}{suffix}"
    with folder_made(path.parent):
        try:
            temporary.touch(exist_ok=False)
            rights = temporary.stat().st_mode  # the umask itself can't be read but by changing it, for all threads
            yield temporary
            with open(temporary, "r+b") as written:  # Windows refuses fsync of what is read alone
                os.fsync(written.fileno())
            os.chmod(temporary, rights)  # safetensors puts a file of its own in the place
            os.replace(temporary, path)
        except OSError as error:
            if error.filename in (None, str(temporary)):
                raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error
            raise
        finally:
            with suppress(OSError):  # which would hide what went wrong before, as on a disk that can't be written
                temporary.unlink(missing_ok=True)


@contextmanager
def folder_made(folder: Path) -> Iterator[None]:
    """`folder` and its parents, made if need be; those that were are taken away again after a failure, unless they have files."""
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for place in made:
                place.rmdir()
        raise


def clear_temporary(folder: str | os.PathLike) -> None:
    """Remove what `atomic` left in a folder, and not in those below, of processes that were killed: for who is alone there."""
    for path in Path(folder).glob(".*"):
        if TEMPORARY.fullmatch(path.name):
            path.unlink(missing_ok=True)


def copy_file(source: str | os.PathLike, target: str | os.PathLike) -> None:
    """The bytes of `source` at `target`, atomically."""
    with atomic(target) as temporary:
        shutil.copyfile(source, temporary)


def write_json(path: str | os.PathLike, content: dict) -> None:
    """`content` as JSON at `path`, atomically. NaN and inf are refused, since JSON has neither."""
    text = json.dumps(content, indent=1, allow_nan=False)
    with atomic(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def json_object(path: str | os.PathLike) -> dict:
    """The object in a JSON file; an empty one where the file is not there, damaged, or of something else."""
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def file_sha256(path: str | os.PathLike) -> str:
    """The sha256 of a file's bytes, in hex."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def files_at(path: str | os.PathLike) -> list[Path]:
    """The file at a path, or all below a folder, sorted, in linked folders too, each of these once; hidden files and links to nothing
    don't count. None of a path where nothing is."""
    path, found = Path(path), []
    if not path.is_dir():
        return [path] if path.is_file() else []
    seen = {os.path.realpath(path)}
    for place, folders, names in os.walk(path, followlinks=True):
        real = {name: os.path.realpath(os.path.join(place, name)) for name in sorted(folders)}
        folders[:] = [name for name in real if real[name] not in seen]
        seen.update(real.values())
        found += [Path(place) / name for name in names if not name.startswith(".") and os.path.isfile(os.path.join(place, name))]
    return sorted(found)


def folder_sha256(folder: str | os.PathLike) -> str:
    """The sha256, in hex, of the names and hashes of all files below a folder (`files_at`)."""
    lines = (f"{path.relative_to(folder).as_posix()} {file_sha256(path)}\n" for path in files_at(folder))
    return hashlib.sha256("".join(lines).encode(errors="surrogateescape")).hexdigest()


def path_sha256(path: str | os.PathLike) -> str:
    """The sha256 of a file, or of a folder's names and files; read once while they stay as they are, since a run asks for the hash of a
    site wherever it names it, and sites may have many gigabytes."""
    return _sha256_while(Path(os.path.realpath(path)), file_stamps(path))


@lru_cache(HASHED)
def _sha256_while(path: Path, stamps: tuple[tuple, ...]) -> str:
    """`path_sha256` of a path while its `file_stamps` are these."""
    return folder_sha256(path) if path.is_dir() else file_sha256(path)


def file_stamps(path: str | os.PathLike) -> tuple[tuple, ...]:
    """What tells whether the file at a path, or those below a folder, may have changed: names, sizes, and when they were written."""
    found = ((str(file), file.stat()) for file in files_at(path))
    return tuple((name, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns) for name, stat in found)


def hash_of(content: object, digits: int = 16) -> str:
    """The first hex digits of the sha256 of `content` as canonical JSON: the same content, the same name."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()[:digits]
