"""`hilbertvae-train`: train a network and score its map beside others. The Hydra application."""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
from importlib.util import find_spec

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from hilbertvae import __version__
from hilbertvae.checks import InputError, how_to_install
from hilbertvae.commands.clustering_study import has_study, run_clustering, write_clustering_failure
from hilbertvae.commands.command_line import options_last, refuse_shadowed
from hilbertvae.commands.configuration import CONF, to_settings
from hilbertvae.commands.gpus import give_gpus, remember_gpus, see_remembered_gpus
from hilbertvae.commands.hydra_files import HydraFiles
from hilbertvae.commands.overrides import refuse_idle, refuse_ignored, refuse_of_one_name
from hilbertvae.commands.run import run
from hilbertvae.reports.run_folder import allow, has_result, write_failure, write_refusal
from hilbertvae.reports.run_lock import alone_in
from hilbertvae.signals import stopped_by_signals
from hilbertvae.terminal import let_go_of_output, show_any_text

JOB = "HILBERTVAE_JOB"
"""Where a job of a multirun tells the other processes of its distributed training what it is: Lightning starts them with the words of
the whole multirun, of which they would do every job."""

LAUNCHERS = {
    "submitit": ("slurm", "hydra_submitit_launcher"),
    "submitit_local": ("slurm", "hydra_submitit_launcher"),
    "ray": ("ray", "hydra_ray_launcher"),
}
"""By launcher the extra that it needs, and the plugin that Hydra would not find without saying so."""


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")
def _application(config: DictConfig) -> None:
    job = HydraConfig.get()
    show_any_text()  # here, too: a launcher's worker has an output of its own
    many = job.mode == RunMode.MULTIRUN
    output = os.path.relpath(job.runtime.output_dir)  # in a multirun, and in the processes of a distributed training, it is the job's own
    if many:
        os.environ[JOB] = json.dumps([*job.overrides.task, f'hydra.run.dir="{output}"'])
    try:
        allow(output)
        launcher = job.launcher._target_ if many else ""
        if "LocalLauncher" in launcher:
            see_remembered_gpus()
        if "joblib" in launcher or "LocalLauncher" in launcher:
            give_gpus(config.trainer.devices)  # first of all, since to check `device` is to use a GPU
        settings = to_settings(config)
        refuse_of_one_name(list(job.overrides.task), job.job.config_name)
        refuse_ignored(settings, list(job.overrides.task))
        if not many:
            refuse_idle(settings, list(job.overrides.task))
        settings.output = output
        if "SlurmLauncher" in launcher and settings.trainer.devices > 1:  # of which Lightning wants SLURM to start one process each
            raise InputError(
                f"trainer.devices: expected 1 with launcher=submitit, whose jobs are one process, got {settings.trainer.devices}"
            )
        if many and settings.trainer.devices > 1:
            # By this name Lightning starts the other processes; in a launcher's worker `__main__` is the launcher.
            sys.modules["__main__"].__spec__ = find_spec("hilbertvae.train")
        with contextlib.nullcontext() if int(os.environ.get("LOCAL_RANK", 0)) else alone_in(output, waits=many):
            try:
                code = (run_clustering if settings.task == "clustering" else run)(settings, again=not many)
            except InputError:
                HydraFiles.take_back_training()  # now: nobody else is at work here
                raise
    except BrokenPipeError:  # nothing of the run has failed: a reader such as `head` has had enough
        if many:
            raise
        let_go_of_output()
        print("hilbertvae-train: nobody reads its output any more; the same command goes on from where it was", file=sys.stderr)
        sys.exit(1)
    except Exception as error:
        if isinstance(error, OSError) and error.filename2:  # a checkpoint is made in the system's temporary folder, and moved
            error = OSError(error.errno, error.strerror, error.filename2)
        refused = isinstance(error, InputError)
        had, write = (has_study, write_clustering_failure) if config.task == "clustering" else (has_result, write_failure)
        if refused and not many:  # a wrong setting of a single run is told at once, and leaves nothing
            HydraFiles.take_back()
            print(f"hilbertvae-train: {error}", file=sys.stderr)
            sys.exit(2)
        unwritable = isinstance(error, OSError) and error.filename and not many  # a full disk, or a folder that nobody may write in
        with contextlib.suppress(OSError) if unwritable else contextlib.nullcontext():  # where there's no room even for that
            if had(output) and (refused or not many):  # good scores don't go for a slip of the pen, nor for a full disk
                write_refusal(output, error)
            else:
                write(output, OmegaConf.to_container(config, resolve=True, throw_on_missing=False), error)
        if unwritable:
            print(f"\nhilbertvae-train: {error.filename}: {error.strerror}", file=sys.stderr)
            sys.exit(1)
        raise error
    if code:
        said = "a mapper, or its pictures, failed; see the lines above and result.json"
        if many:
            raise RuntimeError(said)  # by which Hydra knows
        print(f"hilbertvae-train: {said}", file=sys.stderr)
        sys.exit(1)


def main() -> None:
    """Entry point. `+sweep=...` is taken as `sweep=...`: the group has its place in the defaults, so that `debug` comes after it."""
    words = [word.removeprefix("+") if word.startswith("+sweep=") else word for word in sys.argv[1:]]
    if "--version" in words:  # Hydra would print its own
        print(f"hilbertvae {__version__}")
        return
    if {"-m", "--multirun"} & set(words) and any(re.match("--cfg(=|$)|-c(?!d|n|p)", word) for word in words):  # else a traceback
        print("hilbertvae-train: --cfg shows one job's settings: leave out -m, for a sweep's first job", file=sys.stderr)
        sys.exit(2)
    if any(word.startswith("sweep=") for word in words) and not {"-m", "--multirun", "-c", "--cfg", "-h", "--help"} & set(words):
        print("hilbertvae-train: a sweep without -m is its first job alone; add -m for all of them", file=sys.stderr)
    if JOB in os.environ and int(os.environ.get("LOCAL_RANK", 0)):
        words = json.loads(os.environ[JOB]) + [word for word in words if word.startswith(("hydra.job.name=", "hydra.output_subdir="))]
    for word in words:
        extra, plugin = LAUNCHERS.get(word.removeprefix("launcher="), ("", ""))
        if word.startswith("launcher=") and extra and not find_spec(f"hydra_plugins.{plugin}"):
            print(f"hilbertvae-train: {word}: needs the extra '{extra}': {how_to_install(extra)}", file=sys.stderr)
            sys.exit(2)
    show_any_text()
    try:
        refuse_shadowed(words)
    except InputError as error:
        print(f"hilbertvae-train: {error}", file=sys.stderr)
        sys.exit(2)
    sys.argv[1:] = options_last(words)
    remember_gpus()
    with stopped_by_signals():  # else a launcher's workers, or a scoring's, would go on without it
        try:
            _application()
        except KeyboardInterrupt as error:  # here: it ends all jobs of a multirun, also while Hydra waits for a launcher's workers
            print(f"hilbertvae-train: {str(error) or 'stopped; the same command goes on from where it was'}", file=sys.stderr)
            sys.exit(130)


if __name__ == "__main__":
    main()
