"""What tells one training from another: the hash that a run goes on, and is found again, by."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from hilbertvae.dotted_keys import leaves
from hilbertvae.files import hash_of, path_sha256
from hilbertvae.reconstruction.shipped import checkpoint_path
from hilbertvae.reconstruction.training_card import ELSEWHERE
from hilbertvae.scans.formats import is_scan_path
from hilbertvae.site import site_name
from hilbertvae.training.plain_settings import plain_settings
from hilbertvae.training.settings import Settings

AFTERWARDS = (
    "name", "task", "case", "size", "output", "study", "mapper", "evaluation", "pictures", "checkpoint", "trained", "scoring_processes",
    "device",
)  # fmt: skip
"""Keys of what is done with a trained network, or where."""
MOST_NAMED = 3
"""Keys that a message names."""


def training_hash(settings: Settings) -> str:
    """The hash of what can change a trained network: not of paths, devices, or what is scored afterwards."""
    return hash_of(trained_by(settings))


def trained_by(settings: Settings) -> dict:
    """The settings that `training_hash` hashes."""
    return _made_of(settings, _initial_sha256(settings))


def first_differences(ours: dict, theirs: dict) -> str:
    """What the first keys of nested dictionaries that differ are in each of the two, in a sentence; empty where nothing does."""
    ours, theirs = dict(leaves(ours)), dict(leaves(theirs))
    other = [key for key in {**ours, **theirs} if ours.get(key) != theirs.get(key)]
    more = f", and {len(other) - MOST_NAMED} more" if len(other) > MOST_NAMED else ""
    return ", ".join(f"{key} {theirs.get(key)!r:.60} and not {ours.get(key)!r:.60}" for key in other[:MOST_NAMED]) + more


def recipe_hash(settings: Settings, started_from: dict | None) -> str:
    """The hash that trainings share which differ in their seeds alone, as do the networks that they start from, whose card
    `started_from` is; one of an older version counts by its weights."""
    recipe = (started_from or {}).get("recipe_hash") or _initial_sha256(settings)
    made_of = _made_of(settings, recipe) | {"seed": None}
    made_of["trainer"].pop("threads")  # bits depend on it, as on a seed
    return hash_of(made_of)


def _initial_sha256(settings: Settings) -> str | None:
    """Of the file that a training starts from, however that is called."""
    initial = settings.trainer.initial
    return path_sha256(checkpoint_path(initial)) if initial else None


def _made_of(settings: Settings, initial: str | None) -> dict:
    """All settings that can change a trained network, and what lies where they say. initial: what is hashed of where it starts."""
    made_of = asdict(plain_settings(settings))
    source, data = settings.source(), made_of["data"]
    paths = [site for site in (*data["train"], data["validate"], *data["calibrate"]) if is_scan_path(site) and Path(site).exists()]
    made_of["trainer"]["initial"] = initial
    made_of["contents"] = [source.made_of(site) for site in paths]  # the same path may hold other scans when a run goes on
    named = {site: site_name(site) for site in paths}  # and the same scans may lie elsewhere
    for key in ("train", "calibrate"):
        data[key] = [named.get(site, site) for site in data[key]]
    data["validate"] = named.get(data["validate"], data["validate"])
    for key in AFTERWARDS:
        made_of.pop(key)
    for part, keys in ELSEWHERE.items():
        for key in keys:
            made_of[part].pop(key)
    return made_of
