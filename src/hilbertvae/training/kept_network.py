"""Networks kept under the hash of what trained them: runs that differ in scoring alone share one training."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from filelock import FileLock

from hilbertvae.files import copy_file, write_json
from hilbertvae.reconstruction.reconstructor import Reconstructor


class KeptNetwork:
    """The place of one network, `<folder>/<name>.safetensors`, and the right to fill it, which one run at a time has.

    A run that is killed loses that right with its process, so that the next one trains. Where files can't be locked, nobody waits: whoever
    finds no network trains one, and the last of them is kept.
    """

    def __init__(self, folder: str | Path, name: str):
        self.path = Path(folder) / f"{name}.safetensors"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._seconds = self.path.with_suffix(".json")
        self._lock = FileLock(self.path.with_suffix(".lock"))

    def take(self, copy: Path) -> Reconstructor | None:
        """The network, also copied to `copy`, or None and the right to train it; waits while another run trains it."""
        with suppress(NotImplementedError, OSError):  # some network file systems have no locks
            self._lock.acquire()
        if not self.path.exists():
            return None
        self.release()
        reconstructor = Reconstructor.load(self.path)
        if self._seconds.exists():  # one that was copied here may have come without
            reconstructor.seconds = json.loads(self._seconds.read_text(encoding="utf-8"))
        copy_file(self.path, copy)
        return reconstructor

    def keep(self, checkpoint: Path, seconds: dict[str, float]) -> None:
        """Fill the place with a copy of a file, atomically, and let whoever waits go on. seconds: by stage of the training."""
        write_json(self._seconds, seconds)
        copy_file(checkpoint, self.path)  # not saved again, since the order of a safetensors file's header is not fixed
        self.release()

    def release(self) -> None:
        """Give the right back; nothing happens without it."""
        with suppress(OSError):
            self._lock.release()
