"""The folder that a map is written to: what may be replaced there, and files that appear all together or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock

from hilbertvae.checks import InputError
from hilbertvae.exports.formats import EXPORTS
from hilbertvae.files import folder_made, hash_of, json_object, write_json
from hilbertvae.mappers.saved_map import ADAPTED, MAP
from hilbertvae.signals import to_its_end

PICTURE, PAGE, SUMMARY = "map.png", "summary.html", "summary.json"
OURS = {MAP, ADAPTED, PICTURE, PAGE, *(name for kind in EXPORTS.values() for name in kind.files)}
"""What may be in such a folder, but for the summary."""
WRITING, HELD = ".writing-", ".held"
"""How temporary folders begin, and the lock beside the files in each, which ends with its process."""


def scans_hash(scans: Path) -> str:
    """What tells the scans of a map from others of the same name: where they lie, of which nothing is to be read from it elsewhere."""
    return hash_of(os.path.realpath(scans))


def listed_files(output: Path) -> set[str]:
    """The files of the map that is in a folder, by its summary, which may be another tool's. A folder of such a name is none."""
    try:
        named = OURS & set(json_object(output / SUMMARY)["files"])
    except (KeyError, TypeError):
        return set()
    return {name for name in named if not (output / name).is_dir()}


def is_of_a_map(path: Path) -> bool:
    """Whether a file is one of the map in its folder, which may have lost its summary."""
    return path.name in (OURS if (path.parent / MAP).exists() else listed_files(path.parent))


def written_files(exports: Sequence[str]) -> set[str]:
    """The names of all files that the formats `exports` write, and that of the summary."""
    return {SUMMARY, *(name for kind in exports for name in EXPORTS[kind].files)}


def check_replaced(output: Path, written: set[str], key: str) -> None:
    """An `InputError`, which names `key`, where one of the files `written` would replace what no earlier map left in the folder."""
    earlier = listed_files(output)
    ours = earlier | ({SUMMARY} if earlier and not (output / SUMMARY).is_dir() else set())
    for name in sorted(written - ours):
        if os.path.lexists(output / name):
            raise InputError(f"{key}: {output / name} was not left by an earlier map, and would be replaced; choose another folder")


def check_output(output: Path, scans: Path, exports: list[str], by_name: bool, beside: Sequence[Path] = ()) -> None:
    """An `InputError` where writing would replace what is no earlier map of this command, or the very scans and what is read `beside` them;
    in a folder that was not chosen but named after the scans, `by_name`, also where the earlier map is of others."""
    written = {MAP, ADAPTED, PICTURE, PAGE, *written_files(exports)}
    there = {name for name in written if (output / name).exists()}
    earlier = listed_files(output)
    for read in (scans, *beside):
        places = (read, Path(os.path.realpath(read)))  # a link, and what it leads to
        named = {(os.path.realpath(place.parent), place.name) for place in places}
        if any(folder == os.path.realpath(output) and name in there | earlier for folder, name in named):
            raise InputError(f"output: {read} is what is read, and would be replaced or removed; choose another folder")
    check_replaced(output, written, "output")
    if by_name and earlier and json_object(output / SUMMARY).get("scans_hash") not in (None, scans_hash(scans)):
        raise InputError(
            f"output: {output} has the map of scans of that name from another place, and would be replaced; choose a folder with output="
        )


def replace_map(folder: Path, output: Path, files: list[str]) -> None:
    """Move `files` and the summary from a folder to `output`, and take away what else an earlier map had left there.

    Two maps in one folder would pass for one: what asks the process to stop meanwhile has to wait, and whoever ends it by force leaves a
    summary that says `"unfinished": true`.
    """
    earlier = listed_files(output)

    def replace() -> None:
        if (output / SUMMARY).is_symlink():  # what it leads to is nobody's here, as what other links lead to
            (output / SUMMARY).unlink()
        write_json(output / SUMMARY, {"files": sorted({*earlier, *files}), "unfinished": True})
        for file in (*files, SUMMARY):
            os.replace(folder / file, output / file)
        for file in earlier - {*files, SUMMARY}:
            (output / file).unlink(missing_ok=True)

    to_its_end(replace)


@contextmanager
def writing_beside(output: Path) -> Iterator[Path]:
    """A temporary folder in `output`; that and its parents are made if need be, and then taken away again after a failure. Those of runs
    that were ended by force are taken away, too."""
    with folder_made(output):
        _clear_left(output)
        try:
            with tempfile.TemporaryDirectory(prefix=WRITING, dir=output) as folder, _held(Path(folder)):
                files = Path(folder) / "files"
                files.mkdir()
                yield files
        except OSError as error:
            # A full disk says nothing but that, or names a file in the temporary folder, which nobody asked for.
            if error.errno and (error.filename is None or f"{os.sep}{WRITING}" in str(error.filename)):
                raise OSError(error.errno, error.strerror, str(output)) from error
            raise


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    lock = FileLock(folder / HELD)
    with suppress(NotImplementedError, OSError):  # some network file systems have no locks
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def _clear_left(output: Path) -> None:
    for left in output.glob(f"{WRITING}*"):
        with suppress(NotImplementedError, OSError):  # a lock that is held is an OSError, too
            with FileLock(left / HELD, timeout=0):
                pass
            shutil.rmtree(left)
