"""Networks kept under the hash of what trained them, and the code: runs that differ in scoring alone share one training."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from filelock import FileLock

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.files import copy_file, hash_of, json_object, write_json
from hilbertvae.reconstruction.likelihood import LIKELIHOODS
from hilbertvae.reconstruction.networks import NETWORKS, check_kind
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.training.code_hash import code_hash
from hilbertvae.training.foreign_code import foreign_source
from hilbertvae.training.kept_grids import GRID_SOURCES
from hilbertvae.training.settings import Settings
from hilbertvae.training.training_hash import training_hash


def kept_name(settings: Settings) -> str:
    """What names a kept network: its settings, and the code that trains it and learns its Hilbert Map's weights.

    An `InputError` for a network or likelihood whose code can't be read: it may be another one the next time.
    """
    return hash_of([training_hash(settings), hilbertvae.__version__, *code_of(settings)])


def code_of(settings: Settings) -> list[str]:
    """The code that trains a network and learns its map's weights; an `InputError` where its own can't be read."""
    code = code_hash((*GRID_SOURCES, "mappers", "reconstruction", "scoring/calibration.py", "scoring/cases.py", "training"))
    check_kind(settings.network)
    network = [type(settings.network), NETWORKS[settings.network.kind][1]]
    own = []
    for what, kinds in (("network", network), ("likelihood", [LIKELIHOODS[settings.likelihood.kind]])):
        own += map(foreign_source, kinds)
        if None in own:
            raise InputError(f"trained: expected none with a {what} whose code is in no file; write it into a module")
    return [code, *filter(None, own)]


class KeptNetwork:
    """The place of one network, `<folder>/<name>.safetensors`, and the right to fill it, which one run at a time has.

    A run that is killed loses that right with its process, so that the next one trains. Where files can't be locked, nobody waits: whoever
    finds no network trains one, and the last of them is kept.
    """

    def __init__(self, folder: str | Path, name: str):
        self.path = Path(folder) / f"{name}.safetensors"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._made = self.path.with_suffix(".json")
        self.trained_in = ""
        """The folder of the run that trained it, whose TensorBoard has the curves; known of a network that was taken."""
        self._lock = FileLock(self.path.with_suffix(".lock"))

    def take(self, copy: Path) -> Reconstructor | None:
        """The network, also copied to `copy`, or None and the right to train it; waits while another run trains it."""
        with suppress(NotImplementedError, OSError):  # some network file systems have no locks
            self._lock.acquire()
        if not self.path.exists():
            return None
        self.release()
        reconstructor = Reconstructor.load(self.path)
        if self._made.exists():  # one that was copied here may have come without
            made = json_object(self._made)
            reconstructor.seconds, self.trained_in = made.get("seconds", {}), made.get("trained_in", "")
        copy_file(self.path, copy)
        return reconstructor

    def keep(self, checkpoint: Path, seconds: dict[str, float]) -> None:
        """Fill the place with a copy of a run's file, atomically, and let whoever waits go on. seconds: by stage of the training."""
        write_json(self._made, {"seconds": seconds, "trained_in": str(checkpoint.parent)})
        copy_file(checkpoint, self.path)  # not saved again, since the order of a safetensors file's header is not fixed
        self.release()

    def release(self) -> None:
        """Give the right back; nothing happens without it."""
        with suppress(OSError):
            self._lock.release()
