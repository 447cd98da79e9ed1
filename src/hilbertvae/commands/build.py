"""Objects from configuration: the one place that calls `instantiate`, which builds mappers alone, of this package or of one's own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from hydra.errors import InstantiationException
from hydra.utils import get_class, instantiate

from hilbertvae.checks import InputError
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.precision import check_device
from hilbertvae.training.settings import TRAINED


def build_mappers(specifications: dict[str, dict]) -> dict[str, Mapper]:
    """Unfitted mappers by name; an `InputError` that names the key for one that can't be built."""
    return {name: _build_mapper(name, specification) for name, specification in specifications.items()}


def _build_mapper(name: str, specification: dict) -> Mapper:
    target = specification.get("_target_") if isinstance(specification, dict) else None
    _check_target(name, target)
    if "seed" in specification:
        raise InputError(f"mapper.{name}.seed: expected none, since each gap seed is a mapper's, too (`evaluation.gap_seeds`)")
    try:
        mapper = instantiate(specification, _convert_="all", _recursive_=False)  # one of a setting's own is no class either
    except InstantiationException as error:
        said = str(error).splitlines()[-1] if str(error) else ""
        cause = str(error.__cause__ or "")
        raise InputError(f"mapper.{name}: {said if cause in said else f'{said} ({cause})'}") from error
    with _under(f"mapper.{name}"):  # before a network is trained for it
        mapper.check_settings()
        if isinstance(mapper, HilbertMap):
            if not (mapper.reconstructor is None or (isinstance(mapper.reconstructor, str) and mapper.reconstructor)):
                wanted = f"{TRAINED}, a checkpoint's path or name, or null"
                raise InputError(f"reconstructor: expected {wanted}, got {mapper.reconstructor!r}")
            if mapper.device != "auto":
                check_device(mapper.device)
    return mapper


def _check_target(name: str, target: object) -> None:
    """An `InputError` for anything but the path of a `Mapper`'s class, before it is called."""
    try:
        kind = get_class(target) if isinstance(target, str) else None
    except Exception as error:  # whatever the import of a module raises
        raise InputError(f"mapper.{name}._target_: {str(error).splitlines()[0] if str(error) else type(error).__name__}") from error
    if not (isinstance(kind, type) and issubclass(kind, Mapper)):
        raise InputError(f"mapper.{name}._target_: expected the path of a Mapper's class, as package.module.Class, got {target!r}")


@contextmanager
def _under(path: str) -> Iterator[None]:
    """Puts the path of a part of the configuration before the key that an `InputError` of the block names."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}.{error}") from error
