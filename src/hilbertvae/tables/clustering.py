"""`clustering.json`, what a job of Fig. 2 leaves: seconds and potentials of one or more ways to start a clustering."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hilbertvae.checks import InputError
from hilbertvae.reports.result_json import STATUSES
from hilbertvae.reports.run_folder import refusal
from hilbertvae.tables.alike import OWN
from hilbertvae.tables.sweep import read_json, read_kind, refusals

SCHEMA_VERSION = 1
NAME = "clustering.json"


@dataclass(frozen=True)
class Start:
    """One start on one cloud: wall time in seconds, and the potential in m2 before the first of Lloyd's iterations and after each."""

    start: str
    points: int
    seed: int
    seconds: float
    clusters: int
    potentials_m2: list[float]


@dataclass(frozen=True)
class StartsFile:
    """One job's file; `failed` says what went wrong."""

    name: str
    path: Path
    starts: list[Start]
    about: dict
    failed: dict[str, str]


@dataclass
class Study:
    """All files of the sweep, and jobs without one. refused: why a job's last launch did not start, where a file of one before it lies."""

    size: str | None
    files: list[StartsFile]
    missing: list[str] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)

    @property
    def starts(self) -> list[Start]:
        return [start for file in self.files for start in file.starts]

    @property
    def measured(self) -> list[StartsFile]:
        return [file for file in self.files if file.starts]

    def troubles(self) -> list[str]:
        """A line for each job without a file, for all that failed, and for folders that were left out."""
        lines = [f"- missing: {job} has no {NAME}" for job in self.missing]
        for file in self.files:
            lines += [f"- failed: {file.name}, {what}: {' '.join(why.split())}" for what, why in file.failed.items()]
        lines += refusals(self.refused)
        return lines + [f"- left out: {name}, which is no job of this sweep" for name in self.strangers]


def read_starts(folder: Path, kind: str | None = None) -> Study:
    """Every `FOLDER/<job>/clustering.json`; an `InputError` that names file and key for one that is damaged or doesn't fit the others."""
    _, size, jobs = read_kind(folder, kind)
    paths = sorted(folder.glob(f"*/{NAME}"))
    strangers = [path.parent.name for path in paths if jobs is not None and path.parent.name not in jobs]
    files = [read_starts_file(path) for path in paths if path.parent.name not in strangers]
    if not files:
        raise InputError(f"{folder}: expected <job>/{NAME}, found none")
    refused = {file.name: why for file in files if (why := refusal(folder / file.name))}
    study = Study(size, files, sorted(set(jobs or ()) - {file.name for file in files}), strangers, refused)
    _check_together(study.measured)
    return study


def read_starts_file(path: Path) -> StartsFile:
    """One job's file; an `InputError` that names file and key for one that is damaged."""
    content = read_json(path)
    if content.get("schema_version") != SCHEMA_VERSION:
        raise InputError(f"{path}: schema_version: expected {SCHEMA_VERSION}, got {content.get('schema_version')!r:.60}")
    if content.get("status") not in STATUSES:
        raise InputError(f"{path}: status: expected ok or failed, got {content.get('status')!r:.60}")
    for key, expected in (("config", dict), ("packages", dict), ("rows", list)):
        if not isinstance(content.get(key), expected):
            words = "an object" if expected is dict else "a list"
            raise InputError(f"{path}: {key}: expected {words}, got {content.get(key)!r:.60}")
    failed = content.get("failed") or ({"run": "no message"} if content["status"] == "failed" else {})
    if not isinstance(failed, dict):
        raise InputError(f"{path}: failed: expected an object, got {failed!r:.60}")
    starts = [_start(path, f"rows[{number}]", row) for number, row in enumerate(content.pop("rows"))]
    return StartsFile(path.parent.name, path, starts, content, {what: str(why) for what, why in failed.items()})


def _start(path: Path, where: str, row: Any) -> Start:
    if not isinstance(row, dict):
        raise InputError(f"{path}: {where}: expected an object, got {row!r:.60}")
    if not isinstance(row.get("start"), str):
        raise InputError(f"{path}: {where}.start: expected text, got {row.get('start')!r:.60}")
    for key, least in (("points", 1), ("seed", 0), ("clusters", 1)):
        if not isinstance(row.get(key), int) or isinstance(row[key], bool) or row[key] < least:
            raise InputError(f"{path}: {where}.{key}: expected a whole number from {least} on, got {row.get(key)!r:.60}")
    if not _is_amount(row.get("seconds")):
        raise InputError(f"{path}: {where}.seconds: expected a number of at least 0, got {row.get('seconds')!r:.60}")
    potentials = row.get("potentials_m2")
    if not isinstance(potentials, list) or not all(map(_is_amount, potentials)):
        raise InputError(f"{path}: {where}.potentials_m2: expected a list of numbers of at least 0, got {potentials!r:.60}")
    return Start(row["start"], row["points"], row["seed"], float(row["seconds"]), row["clusters"], [float(p) for p in potentials])


def _is_amount(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value >= 0


def _check_together(files: list[StartsFile]) -> None:
    """One version, one study: the settings of all files but for the start itself, and each cell once."""
    seen: dict[tuple, Path] = {}
    for file in files:
        if OWN not in file.about["packages"]:
            raise InputError(f"{file.path}: packages.{OWN}: missing")
        for key, ours, theirs in (
            (f"packages.{OWN}", file.about["packages"][OWN], files[0].about["packages"][OWN]),
            ("config.study", file.about["config"].get("study"), files[0].about["config"].get("study")),
            ("config.data.test", _clustered(file), _clustered(files[0])),
            ("data", file.about.get("data"), files[0].about.get("data")),
        ):
            if ours != theirs:
                raise InputError(f"{file.path}: {key}: {ours!r:.60}, but {theirs!r:.60} in {files[0].path}; they can't stand in one table")
        for row in file.starts:
            cell = (row.start, row.points, row.seed)
            if cell in seen:
                raise InputError(f"{file.path}: rows: {row.start} of {row.points} points, seed {row.seed}, is also in {seen[cell]}")
            seen[cell] = file.path


def _clustered(file: StartsFile) -> Any:
    """The site whose returns were clustered, if any were."""
    config = file.about["config"]
    if (config.get("study") or {}).get("cloud") == "returns":
        return ((config.get("data") or {}).get("test") or [None])[0]
    return None
