"""What tells one training from another: the hash that a run goes on, and is found again, by."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from hilbertvae.files import hash_of, path_sha256
from hilbertvae.scans.formats import is_scan_path
from hilbertvae.training.settings import Settings

AFTERWARDS = (
    "name", "task", "case", "size", "output", "study", "mapper", "evaluation", "pictures", "checkpoint", "trained", "scoring_processes",
    "device",
)  # fmt: skip
"""Keys of what is done with a trained network, or where."""
ELSEWHERE = {"data": ("folder", "download", "cache", "processes", "test"), "trainer": ("accelerator", "strategy")}
"""Keys of where things lie, or of what computes."""


def training_hash(settings: Settings) -> str:
    """The hash of what can change a trained network: not of paths, devices, or what is scored afterwards."""
    made_of = asdict(settings)
    source = settings.source()
    paths = [
        site
        for site in (*settings.data.train, settings.data.validate, *settings.data.calibrate)
        if is_scan_path(site) and Path(site).exists()
    ]
    if settings.trainer.initial:
        made_of["trainer"]["initial"] = path_sha256(settings.trainer.initial)
    made_of["contents"] = [source.made_of(site) for site in paths]  # the same path may hold other scans when a run goes on
    for key in AFTERWARDS:
        made_of.pop(key)
    for part, keys in ELSEWHERE.items():
        for key in keys:
            made_of[part].pop(key)
    return hash_of(made_of)
