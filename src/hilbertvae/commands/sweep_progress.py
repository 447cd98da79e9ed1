"""A Hydra callback that says how a multirun goes: which jobs there are, a line for each as it ends, and at the end those that failed."""

from __future__ import annotations

import atexit
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
from hilbertvae.files import json_object, write_json
from hilbertvae.reports.result_json import read_result
from hilbertvae.reports.run_lock import alone_in
from hilbertvae.reports.run_state import is_trained, refusal
from hilbertvae.tables.clustering import NAME as CLUSTERING
from hilbertvae.tables.clustering import read_starts_file
from hilbertvae.tables.sweep import SWEEP

NAME_OF_VALUE = re.compile(r"[\w.+-]{1,40}")


class Job(NamedTuple):
    """One job of a multirun: the name of its folder, and whether it scores anything or only trains."""

    name: str
    scored: bool


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
        folder, jobs = Path(config.hydra.sweep.dir), all_jobs(config)
        names = [job.name for job in jobs]
        if shared := [name for name, times in Counter(names).items() if times > 1]:  # they would overwrite each other's results
            several = f"expected a folder for each job, got several in {', '.join(shared)}"
            print(f"hydra.sweep.subdir: {several}; add {telling_subdir(config)}", file=sys.stderr)
            sys.exit(2)
        sweep = OmegaConf.select(config, "hydra.runtime.choices.sweep")
        if sweep:  # any other multirun may be of anything; hilbertvae-table is told what with --sweep
            list_jobs(folder, sweep, config.size, names)
        print(f"{len(jobs)} jobs in {folder}", flush=True)
        # Not on_multirun_end, which Hydra leaves out when a job failed.
        atexit.register(say_how_it_ended, folder, jobs)

    def on_job_start(self, config: DictConfig, **_: Any) -> None:
        self.since = time.perf_counter()

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:
        if OmegaConf.is_missing(config.hydra.job, "num"):
            return  # a single run
        how = "finished" if job_return.status == JobStatus.COMPLETED else "FAILED"
        print(f"\n{how} {Path(config.hydra.runtime.output_dir).name} in {time.perf_counter() - self.since:.0f} s", flush=True)


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


def say_how_it_ended(folder: Path, jobs: list[Job]) -> None:
    """A line for each job that failed or has no result, and where the others' lie."""
    broken = {job.name: why for job in jobs if (why := what_failed(folder / job.name, job.scored))}
    print(f"\n{len(jobs) - len(broken)} of {len(jobs)} jobs have results in {folder}")
    for job in jobs:
        if not job.scored and job.name not in broken:
            print(f"{job.name}: trained, nothing scored")
    for name, why in broken.items():
        print(f"FAILED {name}: {why}")
    sys.stdout.flush()


def all_jobs(config: DictConfig) -> list[Job]:
    """A multirun's jobs in their order, in folders as Hydra's own sweeper makes them."""
    jobs = []
    for number, words in enumerate(job_overrides(config)):
        job = GlobalHydra.instance().config_loader().load_sweep_config(config, words)
        OmegaConf.set_readonly(job, False)
        job.hydra.job.num = number
        job.hydra.job.id = str(number)
        HydraConfig.instance().set_config(job)  # `${hydra:...}` in the name of a folder asks there; each job sets its own later
        jobs.append(Job(job.hydra.sweep.subdir, scored=bool(job.mapper and job.data.test)))
    return jobs


def job_overrides(config: DictConfig) -> list[list[str]]:
    """The overrides of each job of a multirun, in their order."""
    given = list(config.hydra.overrides.task)
    keys = {word.split("=", 1)[0] for word in given}
    words = [f"{key}={value}" for key, value in (config.hydra.sweeper.params or {}).items() if key not in keys] + given
    overrides = OverridesParser.create(config_loader=GlobalHydra.instance().config_loader()).parse_overrides(words)
    return [list(words) for batch in BasicSweeper.split_arguments(overrides, max_batch_size=None) for words in batch]


def telling_subdir(config: DictConfig) -> str:
    """An override that names each job's folder after what varies from job to job, and by its number where that makes no name of a folder:
    a list of mappers, or a path."""
    values: dict[str, set[str]] = {}
    for words in job_overrides(config):
        for key, _, value in (word.lstrip("+").partition("=") for word in words):
            values.setdefault(key, set()).add(value)
    varied = {key: found for key, found in values.items() if len(found) > 1}
    parts = []
    for key in (key for key, found in varied.items() if all(map(NAME_OF_VALUE.fullmatch, found))):
        value = f"hydra:runtime.choices.{key}" if key in config.hydra.runtime.choices else key
        parts.append(f"{key.replace('/', '.').rpartition('.')[2]}-${{{value}}}")
    numbered = [] if parts and len(parts) == len(varied) else ["job-${hydra:job.num}"]
    return f"'hydra.sweep.subdir={'_'.join(parts + numbered)}'"


def what_failed(folder: Path, scored: bool) -> str | None:
    """What the result in a job's folder says of a failure; None for one that is well, as is the network of one that only trains."""
    if why := refusal(folder):
        return f"{why} (what lies there is of an earlier run)"
    try:
        if (folder / CLUSTERING).exists():
            return "; ".join(read_starts_file(folder / CLUSTERING).failed.values()) or None
        if not scored and is_trained(folder) and not (folder / "result.json").exists():
            return None
        result, _ = read_result(folder / "result.json")
    except InputError as error:
        return str(error)
    return "; ".join(f"{name}: {why}" for name, why in result.failed.items()) or None
