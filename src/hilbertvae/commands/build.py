"""Objects from configuration: the one place that calls `instantiate`, which builds mappers of this package alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from hydra.errors import InstantiationException
from hydra.utils import instantiate

from hilbertvae.checks import InputError
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.precision import check_device
from hilbertvae.training.settings import TRAINED

ALLOWED = "hilbertvae."


def build_mappers(specifications: dict[str, dict]) -> dict[str, Mapper]:
    """Unfitted mappers by name; an `InputError` that names the key for one that can't be built."""
    return {name: _build_mapper(name, specification) for name, specification in specifications.items()}


def _build_mapper(name: str, specification: dict) -> Mapper:
    target = specification.get("_target_") if isinstance(specification, dict) else None
    if not isinstance(target, str) or not target.startswith(ALLOWED):
        raise InputError(f"mapper.{name}._target_: expected a class below {ALLOWED}, got {target!r}")
    if "seed" in specification:
        raise InputError(f"mapper.{name}.seed: expected none, since each gap seed is a mapper's, too (`evaluation.gap_seeds`)")
    try:
        mapper = instantiate(specification, _convert_="all", _recursive_=False)  # one of a setting's own is no class either
    except InstantiationException as error:
        said = str(error).splitlines()[-1] if str(error) else ""
        cause = str(error.__cause__ or "")
        raise InputError(f"mapper.{name}: {said if cause in said else f'{said} ({cause})'}") from error
    if not isinstance(mapper, Mapper):
        raise InputError(f"mapper.{name}._target_: expected a Mapper, got {type(mapper).__name__}")
    with _under(f"mapper.{name}"):  # before a network is trained for it
        mapper.check_settings()
        if isinstance(mapper, HilbertMap):
            if not (mapper.reconstructor is None or (isinstance(mapper.reconstructor, str) and mapper.reconstructor)):
                wanted = f"{TRAINED}, a checkpoint's path or name, or null"
                raise InputError(f"reconstructor: expected {wanted}, got {mapper.reconstructor!r}")
            if mapper.device != "auto":
                check_device(mapper.device)
    return mapper


@contextmanager
def _under(path: str) -> Iterator[None]:
    """Puts the path of a part of the configuration before the key that an `InputError` of the block names."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}.{error}") from error
