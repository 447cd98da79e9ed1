"""What the runs of one row of a table have in common: all that decides a network and its map but the training seed. So have those of a
sweep, but for what it varies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from typing import Any

from hilbertvae.checks import InputError
from hilbertvae.dotted_keys import leaves
from hilbertvae.reconstruction.training_card import ELSEWHERE, LEARNED_AS, OLDER

PARTS = (
    "network", "grid", "likelihood", "augmentation", "clustering", "trainer", "data", "flips", "validation_gap_m", "calibration_seeds",
    "calibration_given", "calibration_occupied_weight", "mapper",
)  # fmt: skip
NOT_COMPARED = ELSEWHERE | {"trainer": (*ELSEWHERE["trainer"], "threads")}
"""Where things lie and what computes; sites that are scored have a table each."""
OF_A_CARD = ("recipe_hash", "calibrated_on", LEARNED_AS)
"""What the card of a network that another run trained says of how; its settings are not in this run's configuration."""


def check_same_recipe(run: Any, first: Any) -> None:
    """An `InputError` that names the file and the key where two `Run`s of one row differ in more than their seed. A key that one lacks is
    of another version of the settings, and is not compared; so are mappers that only one has."""
    ours, theirs = (dict(_facts(each.about)) for each in (run, first))
    for key in ours.keys() & theirs.keys():
        if ours[key] != theirs[key]:
            said = f"{ours[key]!r:.60}, but {theirs[key]!r:.60} in {first.path}"
            raise InputError(f"{run.path}: {key}: {said}; runs of one row differ in their training seed alone")


def settings_but(about: dict, varies: Iterable[str]) -> Iterator[tuple[str, Any]]:
    """Settings that decide a network and its map, by their dotted keys, but those that a pattern of `varies` fits; `*` fits any name."""

    def varied(key: str) -> bool:
        return any(fnmatchcase(key, pattern) for pattern in varies)

    for key, value in _flat(about["config"]):
        if isinstance(value, dict):
            yield key, {name: inner for name, inner in value.items() if not varied(f"{key}.{name}")}
        elif not varied(key):
            yield key, value


def _facts(about: dict) -> Iterator[tuple[str, Any]]:
    yield from ((f"config.{key}", value) for key, value in _flat(about["config"]))
    card = about.get("card")
    if isinstance(card, dict):
        for key in OF_A_CARD:
            said = card.get(key)
            said = OLDER | said if key == LEARNED_AS and isinstance(said, dict) else said
            # One by one, so that what older cards lack is not compared.
            yield from ((name, value) for name, value in leaves(said, f"card.{key}") if value is not None)


def _flat(config: dict) -> Iterator[tuple[str, Any]]:
    for part in PARTS:
        value = config.get(part)
        if isinstance(value, dict):
            yield from ((f"{part}.{key}", _anywhere(setting)) for key, setting in value.items() if key not in NOT_COMPARED.get(part, ()))
        elif part in config:
            yield part, value


def _anywhere(setting: Any) -> Any:
    """A mapper's settings without its `device`."""
    return {key: value for key, value in setting.items() if key != "device"} if isinstance(setting, dict) else setting
