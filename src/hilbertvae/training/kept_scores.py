"""Scores of the seeds that are done, kept until a run has all of them: a scoring that was stopped goes on, as a training does."""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import warnings
from dataclasses import asdict, is_dataclass
from pathlib import Path

import numpy as np
import torch

from hilbertvae.checks import InputError
from hilbertvae.files import hash_of, path_sha256
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.likelihood import LIKELIHOODS
from hilbertvae.reconstruction.precision import device_name
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports.provenance import cpu_name, package_versions
from hilbertvae.reports.result_json import read_result, write_result
from hilbertvae.reports.run_folder import UNFINISHED
from hilbertvae.scoring.result import Result
from hilbertvae.site import site_name
from hilbertvae.training.code_hash import PACKAGE, code_hash
from hilbertvae.training.foreign_code import foreign_source, is_library
from hilbertvae.training.settings import Settings

LATER = ("drawing", "reports", "tables", "exports", "commands")
"""Parts of the package that no score depends on: whoever mends a picture between two runs loses nothing."""


class KeptScores:
    """The place, in a run's folder, of what `evaluate_alike` found on one site with one gap seed.

    Files are named after all that they depend on: the site with its contents, the protocol, the mappers with their networks, the code, and
    what computes beside what on which processor or GPU, since their seconds stand in one table.
    """

    def __init__(self, settings: Settings, reference: str):
        self.folder = Path(settings.output) / UNFINISHED
        protocol = asdict(settings.evaluation)
        del protocol["gap_seeds"]
        self.made_of = {
            "protocol": protocol,
            "name": site_name(reference),
            "site": settings.source().made_of(reference),
            "resolution_m": settings.resolution_m,
            "code": CODE,
            "packages": package_versions(),
            "machine": [cpu_name(), torch.get_num_threads(), settings.scoring_processes],
        }

    def path(self, mappers: dict[str, Mapper], seed: int) -> Path | None:
        """Where the scores of these mappers with a gap seed are kept; None where the code of one can't be read, which may change."""
        if not all(map(is_known, mappers.values())):
            return None
        made_of = {**self.made_of, "mappers": {name: described(mapper) for name, mapper in mappers.items()}, "seed": seed}
        return self.folder / f"{hash_of(made_of)}.json"

    def take(self, mappers: dict[str, Mapper], seed: int) -> Result | None:
        """What was kept of these mappers, or None where nothing was, or only a damaged file."""
        path = self.path(mappers, seed)
        with contextlib.suppress(InputError):
            found = read_result(path)[0] if path else None
            if found and found.gap_seeds == [seed] and found.scores.keys() == mappers.keys():
                return found
        return None

    def keep(self, mappers: dict[str, Mapper], seed: int, result: Result) -> None:
        """A run whose scores can't be kept, on a full disk, still has them; that it could not go on is said."""
        path = self.path(mappers, seed)
        try:
            if path:
                write_result(path, result)
        except OSError as error:
            warnings.warn(f"{self.folder}: scores can't be kept, so that a run which is stopped starts anew ({error})", stacklevel=3)


def forget_scores(output: str | Path) -> None:
    """Remove what was kept of a run: it has its results."""
    shutil.rmtree(Path(output) / UNFINISHED, ignore_errors=True)


CODE = code_hash(tuple(path.name for path in PACKAGE.iterdir() if path.name not in LATER))
"""As it was when it was loaded: it may be edited while a network trains."""


def is_known(mapper: Mapper) -> bool:
    """Whether all code that answers for a mapper can be read: else it may be another one the next time."""
    return None not in [foreign_source(kind) for kind in _code_of(mapper)]


def described(mapper: Mapper) -> list:
    """A mapper's class, what source of it and of its network is not ours, and its settings: networks and files by contents, a GPU by its
    model."""
    kind = type(mapper)
    again = ("seed", "centres") if mapper.told_gaps else ("seed",)  # set for each gap seed
    parameters = {key: _plain(value) for key, value in mapper.get_params(deep=False).items() if key not in again}
    if isinstance(mapper, HilbertMap):
        parameters["device"] = device_name(mapper.device)
    return [f"{kind.__module__}.{kind.__qualname__}", [foreign_source(part) for part in _code_of(mapper)], parameters]


def _code_of(mapper: Mapper) -> list[type]:
    """The classes whose code answers for a mapper: its own and what that is derived from, and of its network that and the likelihood's."""
    networks = [value for value in mapper.get_params(deep=False).values() if isinstance(value, Reconstructor)]
    return [
        type(mapper),
        *itertools.filterfalse(is_library, type(mapper).__mro__[1:]),
        *(part for made in networks for part in (type(made.network), LIKELIHOODS[made.likelihood.kind])),
    ]


def _plain(value: object) -> object:
    if isinstance(value, Reconstructor):
        return [value.fingerprint(), value.resolution_m, asdict(value.grid), value.map_weights]
    if isinstance(value, Path) or (isinstance(value, str) and (os.path.isfile(value) or os.sep in value)):  # which no text is too long for
        return path_sha256(value) if os.path.exists(value) else str(value)
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, dict):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray):
        return [str(value.dtype), value.tolist()]  # as text a large one lacks its middle
    return asdict(value) if is_dataclass(value) else value
