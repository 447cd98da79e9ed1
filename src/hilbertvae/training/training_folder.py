"""What a training leaves in its run's folder, and whether the next one there goes on from it, is refused, or begins anew."""

from __future__ import annotations

import json
import shutil
import warnings
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.files import hash_of, json_object, write_json
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports.run_folder import CHECKPOINTS, NETWORK, TRAINING, clear, has_result, is_trained
from hilbertvae.training.checkpoints import read_checkpoint
from hilbertvae.training.kept_network import code_of, kept_name
from hilbertvae.training.settings import Settings
from hilbertvae.training.training_hash import first_differences, trained_by, training_hash


def last_epoch(output: Path, settings: Settings) -> Path | None:
    """The checkpoint to go on from, if the folder holds one; an `InputError` if the best epoch's, which belongs to it, can't be read.

    A job whose network is kept is made anew instead, also after a change of the code: what it left is filed under the hash of both, and
    whoever changes a sweep's settings asks for other networks. A single run goes on over a change of the code, as a long one may have to.
    """
    last = output / CHECKPOINTS / "last.ckpt"
    if last.exists():
        if is_of(output, settings):
            read_checkpoint(last.with_name("best.ckpt"))  # now: it is asked for after the last epoch
            _warn_of_other_code(output, settings)
            return last
        print(f"{output}: was trained with other settings, or by other code; trained anew")
    begin_anew(output, settings)
    return None


def finished_network(output: Path, settings: Settings) -> Reconstructor | None:
    """The network that these settings have trained in a folder whose checkpoints were removed since, to save room."""
    if not _has_checkpoint(output) and is_trained(output, training_hash(settings)):
        _warn_of_other_code(output, settings)
        return Reconstructor.load(output / NETWORK)
    return None


def check_folder(settings: Settings) -> None:
    """An `InputError` if the folder of the run holds the training of another one, which it would go on from or write over, with its
    checkpoints or without. One that is kept may be written over by one that is to be kept, too, but for a result of other settings: it is a
    row of a table, beside which the new one would stand as if all had been trained alike."""
    output = Path(settings.output)
    finished = (output / NETWORK).exists() and (output / TRAINING).exists()
    found = json_object(output / TRAINING) if finished or _has_checkpoint(output) else None
    both_kept = found is not None and settings.trained and "kept_name" in found
    if found is None or (both_kept and not has_result(output)):
        return
    same = found.get("training_hash") == training_hash(settings)
    if settings.trained and same and not both_kept:
        ways = "leave it out to go on, choose another `name`, or remove the folder"
        raise InputError(f"trained: {output} holds a training that was begun without it; {ways}")
    if not same:
        before = found.get("settings")
        other = first_differences(_as_read(settings), before) if isinstance(before, dict) else ""
        told = f" ({other})" if other else ""
        raise InputError(f"output: {output} holds a run with other settings{told}; choose another `name`, or remove the folder")


def is_of(output: Path, settings: Settings) -> bool:
    """Whether the training that was last begun in the folder is that of the settings, and of the code where it is to be kept."""
    found = json_object(output / TRAINING)
    return all(found.get(key) == value for key, value in _made_of(settings).items())


def _made_of(settings: Settings) -> dict[str, str]:
    return {"training_hash": training_hash(settings)} | ({"kept_name": kept_name(settings)} if settings.trained else {})


def begin_anew(output: Path, settings: Settings) -> None:
    """What lies there of another network goes: its last epoch would be gone on from, and its curves be shown as this one's."""
    if settings.trained or (output / TRAINING).exists():
        shutil.rmtree(output / CHECKPOINTS, ignore_errors=True)
        clear(output)
    write_json(output / TRAINING, {**_made_of(settings), "settings": _as_read(settings), "code": _code(settings)})


def _code(settings: Settings) -> str | None:
    """The hash of the code that trains; None of what was typed into a notebook, which can't be read."""
    try:
        return hash_of(code_of(settings))
    except InputError:
        return None


def _warn_of_other_code(output: Path, settings: Settings) -> None:
    if (before := json_object(output / TRAINING).get("code")) and before != _code(settings):
        ways = "remove the folder, or choose another `name`, to train anew"
        warnings.warn(f"{output}: was begun by other code than today's, which goes on from its weights; {ways}", stacklevel=3)


def _as_read(settings: Settings) -> dict:
    """All that decides a network, as JSON has it."""
    return json.loads(json.dumps(trained_by(settings), default=str))


def _has_checkpoint(output: Path) -> bool:
    return (output / CHECKPOINTS / "last.ckpt").exists()
