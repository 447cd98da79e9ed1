"""A sweep's folder as it lies on disk: `sweep.json`, and `result.json` files of its jobs. Nothing else is read.

FOLDER/sweep.json                   {"sweep": "table1", "size": "quick", "jobs": ["cvae-hm-seed0", ...]}
FOLDER/<job>/result.json            what a job found on its first test site
FOLDER/<job>/<site>/result.json     and on any further one
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hilbertvae.checks import InputError
from hilbertvae.reports.mapper_names import champions
from hilbertvae.reports.result_json import read_result
from hilbertvae.reports.run_folder import RESULT, SCORES, refusal
from hilbertvae.scoring.result import Result
from hilbertvae.tables.kinds import KINDS
from hilbertvae.tables.recipe import check_same_recipe

SWEEP = "sweep.json"
SIZES = ("quick", "full")
JOB = re.compile(r"(?P<case>.+)-seed(?P<seed>\d+)")
"""A job's folder, which tells its case where no configuration does."""
UNCLEAN = "uncommitted tree"


@dataclass(frozen=True)
class Run:
    """One result file. name: its folder below the sweep's. job: the first part of that."""

    name: str
    case: str
    seed: int
    path: Path
    result: Result
    about: dict

    @property
    def job(self) -> str:
        return self.name.split("/")[0]

    def config(self, key: str, default: Any = None) -> Any:
        """A setting by its dotted key; `default` where it is not there."""
        return _below(self.about["config"], key, default)

    def setting(self, key: str) -> Any:
        """A setting that this kind of sweep can't do without; an `InputError` that names it where it is not there."""
        found = self.config(key)
        if found is None:
            raise InputError(f"{self.path}: config.{key}: missing, and the rows of this table are named after it")
        return found

    def seconds(self, mapper: str, stage: str) -> list[float]:
        """`fit` in seconds, `query_per_million` in seconds per million queries."""
        return self.result.seconds.get(mapper, {}).get(stage, [])

    def stage_seconds(self, stage: str) -> list[float]:
        """Seconds of a stage of the run: `train`, `grids`, ..."""
        found = self.about["stage_seconds"].get(stage)
        return [] if found is None else [float(found)]

    def failures(self) -> list[str]:
        """Notes on mappers that failed while others were scored."""
        return [f"{mapper} failed in {self.name}: {' '.join(message.split())}" for mapper, message in self.result.failed.items()]

    def map(self, mapper: str, what: str) -> list[float]:
        """`clusters` of a fitted map, or its size in `bytes`."""
        return [float(number) for number in self.result.maps.get(mapper, {}).get(what, [])]

    def champion(self, reading: str) -> str | None:
        """The row of the run's network that is calibrated for a reading, also where it failed; any of its network's if there was none."""
        return next(iter(champions(self.result.mappers(), reading)), None)

    @property
    def scored(self) -> bool:
        return bool(self.result.scores)


@dataclass
class Sweep:
    """All runs of a sweep. missing: jobs without a result. strangers: folders with results that are none of its jobs. older: results of
    sites that a job's last run did not score. refused: why a job's last launch did not start, where results of one before it lie."""

    kind: str
    size: str | None
    runs: list[Run]
    missing: list[str] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)
    older: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)

    @property
    def scored(self) -> list[Run]:
        return [run for run in self.runs if run.scored]

    def by_site(self) -> list[tuple[str, list[Run]]]:
        """Runs that were scored by test site; one site without a name where none was."""
        return [(site, [run for run in self.scored if run.result.site == site]) for site in self.sites()] or [("", [])]

    def sites(self) -> list[str]:
        """Names of test sites, that of the jobs' first ones before any other."""
        first = [run.result.site for run in self.scored if run.name == run.job]
        return list(dict.fromkeys([*first, *sorted(run.result.site for run in self.scored)]))

    def absent(self) -> dict[str, str]:
        """Cases of which no run was scored, with `missing` or `failed`."""
        there = {run.case for run in self.scored}
        found = {case_of(job): "missing" for job in self.missing} | {run.case: "failed" for run in self.runs if not run.scored}
        return {case: status for case, status in found.items() if case not in there}

    def gone(self, case: str) -> list[str]:
        """Notes on the jobs of a case that left no scores."""
        failed = [f"failed: {run.name}" for run in self.runs if not run.scored and run.case == case]
        return [f"missing: {job}" for job in self.missing if case_of(job) == case] + failed

    def troubles(self) -> list[str]:
        """A line for each job without a result, for all that failed, and for folders that were left out."""
        lines = [f"- missing: {job} has no result.json" for job in self.missing]
        for run in self.runs:
            lines += [f"- failed: {run.name}, {what}: {' '.join(message.split())}" for what, message in run.result.failed.items()]
        lines += refusals(self.refused)
        lines += [f"- left out: {name}, which is no job of this sweep" for name in self.strangers]
        return lines + [f"- left out: {name}, which is of another run than its job" for name in self.older]


def refusals(refused: dict[str, str]) -> list[str]:
    """A line for each job whose last launch did not start, by why."""
    return [f"- refused at its last launch, so that its row is of an earlier one: {job}, {why}" for job, why in refused.items()]


def case_of(job: str) -> str:
    """The case that a job's folder is named after."""
    match = JOB.fullmatch(job)
    return match["case"] if match else job


def read_kind(folder: Path, kind: str | None) -> tuple[str, str | None, list[str] | None]:
    """(kind, size, jobs) of a folder; size and jobs are None for one that was made by hand, which `kind` has to be given for, as for a
    sweep of somebody's own, whose table is then that of the `kind`."""
    path = folder / SWEEP
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    if not path.exists():
        if kind is None and (folder / RESULT).exists():
            raise InputError(f"{folder}: one run and no sweep of several; its table is {folder / SCORES}")
        if kind is None:
            raise InputError(f"{path}: not there; say which sweep this is with --sweep")
        return kind, None, None
    content = read_json(path)
    for key, expected in (("sweep", str), ("size", str), ("jobs", list)):
        if not isinstance(content.get(key), expected):
            raise InputError(f"{path}: {key}: expected {'text' if expected is str else 'a list of names'}, got {content.get(key)!r:.60}")
    ours = content["sweep"] in KINDS
    if content["size"] not in (SIZES if ours else (*SIZES, "")):
        raise InputError(f"{path}: size: expected {' or '.join(SIZES)}, got {content['size']!r}")
    if not all(isinstance(job, str) and job for job in content["jobs"]):
        raise InputError(f"{path}: jobs: expected names of folders, got {content['jobs']!r:.60}")
    if ours and kind not in (None, content["sweep"]):
        raise InputError(f"{path}: sweep: expected {kind}, as --sweep says, got {content['sweep']}")
    if not ours and kind is None:
        known = f"expected one of {', '.join(KINDS)}, got {content['sweep']!r}"
        raise InputError(f"{path}: sweep: {known}; say with --sweep which of these tables it is to have")
    return kind or content["sweep"], content["size"] or None, content["jobs"]


def read_json(path: Path) -> dict:
    """An object in a JSON file; an `InputError` that names the file otherwise."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: can't be read, or is damaged ({error})") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected an object, got {content!r:.60}")
    return content


def read_sweep(folder: Path, kind: str | None = None) -> Sweep:
    """Every run below a folder; an `InputError` that names the file and the key for one that can't be read, or if there is none."""
    kind, size, jobs = read_kind(folder, kind)
    paths = sorted([*folder.glob("*/result.json"), *folder.glob("*/*/result.json")])
    runs, strangers = [], []
    for path in paths:
        name = path.parent.relative_to(folder).as_posix()
        if jobs is not None and name.split("/")[0] not in jobs:
            strangers.append(name)
        else:
            runs.append(_run(path, name))
    if not runs:
        raise InputError(f"{folder}: expected <job>/result.json, found none")
    own = {run.job: run.about.get("config_hash") for run in runs if run.name == run.job and run.scored}
    older = [run for run in runs if run.job in own and run.about.get("config_hash") != own[run.job]]
    missing = sorted(set(jobs or ()) - {run.name for run in runs})
    refused = {run.job: why for run in runs if (why := refusal(folder / run.job))}
    return Sweep(kind, size, [run for run in runs if run not in older], missing, strangers, [run.name for run in older], refused)


def _run(path: Path, name: str) -> Run:
    result, about = read_result(path)
    about |= {key: about.get(key) or {} for key in ("git", "host", "data", "stage_seconds")}  # not known everywhere
    for key in ("config", "packages", "git", "host", "data", "stage_seconds"):
        if not isinstance(about.get(key), dict):
            raise InputError(f"{path}: {key}: expected an object, got {about.get(key)!r:.60}")
    for stage, seconds in about["stage_seconds"].items():
        if not isinstance(seconds, (int, float)):
            raise InputError(f"{path}: stage_seconds.{stage}: expected a number, got {seconds!r:.60}")
    match = JOB.fullmatch(name.split("/")[0])
    case = about["config"].get("case") or case_of(name.split("/")[0])
    seed = about["config"].get("seed", int(match["seed"]) if match else None)
    if is_given(about):  # the network's own: one that is scored three times was trained once
        seed = _below(about, "seeds.training", seed)
    if result.scores:  # of a job that broke, settings may never have been found
        if not isinstance(case, str):
            raise InputError(f"{path}: config.case: expected text, got {case!r:.60}")
        if not isinstance(seed, int) or isinstance(seed, bool):
            raise InputError(f"{path}: config.seed: expected a whole number, got {seed!r:.60}")
    return Run(name, str(case), seed, path, result, about)


def is_given(about: dict) -> bool:
    """Whether a run scored a network that another one trained, its `checkpoint` or the one that its mappers name, which has a card."""
    return bool(about["config"].get("checkpoint") or about.get("card"))


def _below(node: Any, key: str, default: Any) -> Any:
    for part in key.split("."):
        if not isinstance(node, dict) or part not in node:
            return default
        node = node[part]
    return node


def grouped(runs: Iterable[Run], key: Callable[[Run], Hashable]) -> dict[Any, dict[int, Run]]:
    """Runs by what their row is about, and in there by training seed; an `InputError` for two that would be the same cell, or that
    differ in more than the seed."""
    groups: dict[Any, dict[int, Run]] = {}
    for run in runs:
        group = groups.setdefault(key(run), {})
        if run.seed in group:
            seed = "seeds.training" if is_given(run.about) else "config.seed"
            raise InputError(f"{run.path}: {seed}: {run.seed} of the same row is also in {group[run.seed].path}")
        if group:
            check_same_recipe(run, next(iter(group.values())))
        group[run.seed] = run
    return groups
