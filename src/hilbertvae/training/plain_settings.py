"""Settings as they come out of YAML, whoever made them: Python's own numbers and texts, of the types that the schema says."""

from __future__ import annotations

import copy
import os
import pickle
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hilbertvae.checks import InputError
from hilbertvae.training.settings import Settings


def plain_settings(settings: Settings) -> Settings:
    """A copy of `settings` with paths as texts and numpy's numbers as Python's: what a checkpoint keeps of others would not load again.

    Raises an `InputError` that names the key for a value of another type than the schema's.
    """
    if not is_dataclass(settings.network):
        raise InputError(f"network: expected the settings of a network, such as GatedNetworkSettings(), got {settings.network!r:.60}")
    try:
        pickled = pickle.dumps(settings)
    except (pickle.PicklingError, AttributeError, TypeError):  # what is no setting is refused by its key
        return _plain(settings, "")
    return copy.deepcopy(_plain_of(pickled, type(settings.network)))


@lru_cache(maxsize=8)
def _plain_of(pickled: bytes, network: type) -> Settings:
    """A run asks for its hash again and again, and OmegaConf takes a tenth of a second each time. network: the class of its settings, of
    which a pickle has the name alone: a cell of a notebook that is run again makes another one."""
    return _plain(pickle.loads(pickled), "")


def _plain(value: Any, path: str) -> Any:
    if is_dataclass(value):
        parts = {part.name: _plain(getattr(value, part.name), f"{path}{part.name}.") for part in fields(value) if part.init}
        try:
            return OmegaConf.to_object(OmegaConf.structured(replace(value, **parts)))
        except OmegaConfBaseException as error:
            raise InputError(f"{path}{error.full_key}: {str(error).partition(chr(10))[0]}") from error
    if isinstance(value, dict):
        return {key: _plain(one, f"{path}{key}.") for key, one in value.items()}
    if isinstance(value, (list, tuple, range)):
        return [_plain(one, path) for one in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value
