"""A Hydra callback that says how a multirun goes: which jobs there are, a line for each as it ends, and at the end those that failed
or were not done."""

from __future__ import annotations

import atexit
import os
import re
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from hilbertvae.checks import InputError
from hilbertvae.commands.writable_folder import refuse_unwritable
from hilbertvae.files import json_object, write_json
from hilbertvae.reports.result_json import read_result
from hilbertvae.reports.run_folder import NETWORK, REFUSED, RESULT, is_trained, refusal
from hilbertvae.reports.run_lock import alone_in
from hilbertvae.tables.clustering import NAME as CLUSTERING
from hilbertvae.tables.clustering import read_starts_file
from hilbertvae.tables.sweep import SWEEP

ENDS = (REFUSED, CLUSTERING, RESULT)
"""Files in a job's folder that say how it ended, the first that is there; one that only trains leaves its network."""
NAME_OF_VALUE = re.compile(r"[\w.+-]{1,40}")


class Job(NamedTuple):
    """One job of a multirun: its sweep's folder and size, the name of its own folder in there, and whether it scores anything or only
    trains. Jobs that differ in their sweep's `name` lie in several such folders."""

    sweep: Path
    size: str
    name: str
    scored: bool

    @property
    def folder(self) -> Path:
        """Where its results go."""
        return self.sweep / self.name


Stamp = tuple[int, int]
"""What tells whether a file was written since."""


class SweepProgress(Callback):
    """Writes `sweep.json` beside the jobs' folders: the sweep, its size, and all jobs, so that a table can name those that are missing.

    Jobs of an earlier launch of the same sweep stay listed: who adds a seed, or runs one case again, has the others' results still."""

    def __init__(self):
        self.since = time.perf_counter()

    def on_multirun_start(self, config: DictConfig, **_: Any) -> None:
        # Hydra goes on after any other exception of a callback than an exit.
        if any(word.partition("=")[0] == "output" for word in config.hydra.overrides.task):
            print("output: expected none with -m, where each job has a folder below hydra.sweep.dir; set that one", file=sys.stderr)
            sys.exit(2)
        jobs = all_jobs(config)
        # They would overwrite each other's results.
        if shared := [job for job, times in Counter(job.folder for job in jobs).items() if times > 1]:
            several = f"expected a folder for each job, got several in {', '.join(path.name for path in shared)}"
            print(f"hydra.sweep.subdir: {several}; {telling_words(config)}", file=sys.stderr)
            sys.exit(2)
        refuse_unwritable(dict.fromkeys(job.folder for job in jobs))
        sweep = OmegaConf.select(config, "hydra.runtime.choices.sweep")
        if sweep:  # any other multirun may be of anything; hilbertvae-table is told what with --sweep
            for folder, size in dict.fromkeys((job.sweep, job.size) for job in jobs):
                list_jobs(folder, sweep, size, [job.name for job in jobs if (job.sweep, job.size) == (folder, size)])
        print(f"{len(jobs)} jobs in {folders_of(jobs)}", flush=True)
        # Not on_multirun_end, which Hydra leaves out when a job failed.
        atexit.register(say_how_it_ended, jobs, stamps(jobs))

    def on_job_start(self, config: DictConfig, **_: Any) -> None:
        self.since = time.perf_counter()

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        if OmegaConf.is_missing(config.hydra.job, "num"):
            return  # a single run
        folder, completed = Path(config.hydra.runtime.output_dir), job_return.status == JobStatus.COMPLETED
        if completed and (found := evidence(folder, scored=False)):
            os.utime(found)  # also one that was finished before is a result of this launch, as its settings are
        print(f"\n{'finished' if completed else 'FAILED'} {folder.name} in {time.perf_counter() - self.since:.0f} s", flush=True)


def list_jobs(folder: Path, sweep: str, size: str, names: list[str]) -> None:
    """`names` beside the jobs of the same sweep that `sweep.json` has; of launches at the same time, none forgets the other's."""
    with alone_in(folder, waits=True):
        known = earlier_jobs(folder / SWEEP, sweep, size)
        write_json(folder / SWEEP, {"sweep": sweep, "size": size, "jobs": list(dict.fromkeys(known + names))})


def earlier_jobs(path: Path, sweep: str, size: str) -> list[str]:
    """The jobs that `sweep.json` has of the same sweep in the same size; none where it is of another, damaged, or not there."""
    content = json_object(path)
    jobs = content.get("jobs") if (content.get("sweep"), content.get("size")) == (sweep, size) else None
    return [str(job) for job in jobs] if isinstance(jobs, list) else []


def folders_of(jobs: list[Job]) -> str:
    """The folders of the jobs' sweeps, in words."""
    return ", ".join(map(str, dict.fromkeys(job.sweep for job in jobs)))


def evidence(folder: Path, scored: bool) -> Path | None:
    """The file in a job's folder that says how it ended; None where it was not done. scored: whether a network alone is no end."""
    return next((folder / name for name in (ENDS if scored else (*ENDS, NETWORK)) if (folder / name).exists()), None)


def stamps(jobs: list[Job]) -> dict[Path, Stamp]:
    """The files of an earlier launch that could be taken for results of this one."""
    return {path: _stamp(path) for job in jobs for name in (*ENDS, NETWORK) if (path := job.folder / name).exists()}


def _stamp(path: Path) -> Stamp:
    stat = path.stat()  # compared with one of its own, not with a time: a worker's machine may have another clock
    return stat.st_ino, stat.st_mtime_ns


def say_how_it_ended(jobs: list[Job], before: dict[Path, Stamp]) -> None:
    """How many jobs have results of this launch and where they lie, and a line for each that failed or was not done. before: `stamps` of
    when it began."""
    done, lines = 0, []
    for job in jobs:
        name = job.name if len({each.sweep for each in jobs}) == 1 else job.folder
        found = evidence(job.folder, job.scored)
        if found is None:
            lines.append(f"not done {name}")
        elif before.get(found) == _stamp(found):
            lines.append(f"not done {name}: what lies there is of an earlier launch")
        elif why := what_failed(job.folder, job.scored):
            lines.append(f"FAILED {name}: {why}")
        else:
            done += 1
            lines += [] if job.scored else [f"{name}: trained, nothing scored"]
    print(f"\n{done} of {len(jobs)} jobs have results in {folders_of(jobs)}", *lines, sep="\n", flush=True)


def all_jobs(config: DictConfig) -> list[Job]:
    """A multirun's jobs in their order, in folders as Hydra's own sweeper makes them."""
    jobs = []
    for number, words in enumerate(job_overrides(config)):
        job = GlobalHydra.instance().config_loader().load_sweep_config(config, words)
        OmegaConf.set_readonly(job, False)
        job.hydra.job.num = number
        job.hydra.job.id = str(number)
        HydraConfig.instance().set_config(job)  # `${hydra:...}` in the name of a folder asks there; each job sets its own later
        jobs.append(Job(Path(job.hydra.sweep.dir), job.size, job.hydra.sweep.subdir, scored=bool(job.mapper and job.data.test)))
    return jobs


def job_overrides(config: DictConfig) -> list[list[str]]:
    """The overrides of each job of a multirun, in their order."""
    given = OmegaConf.to_container(config.hydra.overrides.task, resolve=False)  # `name=${...}` is each job's own
    keys = {word.split("=", 1)[0] for word in given}
    words = [f"{key}={value}" for key, value in (config.hydra.sweeper.params or {}).items() if key not in keys] + given
    overrides = OverridesParser.create(config_loader=GlobalHydra.instance().config_loader()).parse_overrides(words)
    return [list(words) for batch in BasicSweeper.split_arguments(overrides, max_batch_size=None) for words in batch]


def telling_words(config: DictConfig) -> str:
    """What gives each job a folder of its own: an override that names it after what varies from job to job, and by its number where that
    makes no name of a folder: a list of mappers, or a path. The name ends in the seed, as `hilbertvae-table` reads it. A sweep has one job
    for each value of its own axes and each seed; what else varies makes several sweeps."""
    values: dict[str, set[str]] = {}
    for words in job_overrides(config):
        for key, _, value in (word.lstrip("+").partition("=") for word in words):
            values.setdefault(key, set()).add(value)
    varied = {key: found for key, found in values.items() if len(found) > 1 and key != "seed"}
    if config.hydra.runtime.choices.get("sweep"):
        further = ", ".join(key for key in varied if key not in (config.hydra.sweeper.params or {}))
        return f"start one sweep for each value of {further}, each with a `name` of its own" if further else "leave hydra.sweep.subdir out"
    if not varied:
        return "expected different seeds, or settings, in each"
    parts = []
    for key in (key for key, found in varied.items() if all(map(NAME_OF_VALUE.fullmatch, found))):
        value = f"hydra:runtime.choices.{key}" if key in config.hydra.runtime.choices else key
        parts.append(f"{key.replace('/', '.').rpartition('.')[2]}-${{{value}}}")
    numbered = [] if len(parts) == len(varied) else ["job-${hydra:job.num}"]
    return f"add 'hydra.sweep.subdir={'_'.join(parts + numbered)}-seed${{seed}}'"


def what_failed(folder: Path, scored: bool) -> str | None:
    """What the result in a job's folder says of a failure; None for one that is well, as is the network of one that only trains."""
    if why := refusal(folder):
        return f"{why} (what lies there is of an earlier run)"
    try:
        if (folder / CLUSTERING).exists():
            return "; ".join(read_starts_file(folder / CLUSTERING).failed.values()) or None
        if not scored and is_trained(folder) and not (folder / RESULT).exists():
            return None
        result, _ = read_result(folder / RESULT)
    except InputError as error:
        return str(error)
    return "; ".join(f"{name}: {why}" for name, why in result.failed.items()) or None
