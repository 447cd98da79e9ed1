"""`hilbertvae-train`: train a network and score its map beside others. The Hydra application."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

import hilbertvae
from hilbertvae.checks import InputError, how_to_install
from hilbertvae.commands.clustering_study import has_study, run_clustering, write_clustering_failure
from hilbertvae.commands.configuration import CONF, to_settings
from hilbertvae.commands.gpus import give_gpus, remember_gpus, see_remembered_gpus
from hilbertvae.commands.overrides import named_networks, refuse_ignored
from hilbertvae.files import file_sha256
from hilbertvae.reconstruction.shipped import checkpoint_path
from hilbertvae.reports.provenance import without_folders
from hilbertvae.reports.run_lock import alone_in
from hilbertvae.reports.run_state import (
    allow,
    clear,
    forget,
    has_result,
    is_finished,
    is_trained,
    was_scored_alone,
    write_failure,
    write_refusal,
)
from hilbertvae.scans.sites import site_hashes
from hilbertvae.signals import stopped_by_signals
from hilbertvae.site import open_site, site_name
from hilbertvae.terminal import show_any_text
from hilbertvae.training.settings import Settings
from hilbertvae.training.site_roles import own_sites
from hilbertvae.training.training_hash import training_hash

JOB = "HILBERTVAE_JOB"
"""Where a job of a multirun tells the other processes of its distributed training what it is: Lightning starts them with the words of
the whole multirun, of which they would do every job."""

LAUNCHERS = {
    "submitit": ("slurm", "hydra_submitit_launcher"),
    "submitit_local": ("slurm", "hydra_submitit_launcher"),
    "ray": ("ray", "hydra_ray_launcher"),
}
"""By launcher the extra that it needs, and the plugin that Hydra would not find without saying so."""


def run(settings: Settings, again: bool = True) -> int:
    """Train if a mapper needs it, score all, write everything; the exit code. again: do so even if the results are there already."""
    data, other_scoring = settings.data, was_scored_alone(settings.output)
    if not again:
        names = [site_name(site) for site in data.test]
        with contextlib.suppress(InputError, OSError):  # what can't be read is told below, and is not finished
            scored = is_finished(settings.output, names, _identity(settings), settings.pictures)
            if scored or (not (settings.mapper and names) and is_trained(settings.output, training_hash(settings))):
                print(f"{settings.output}: finished before")
                return 0
    # Late: a sweep that has nothing to do waits for none of it, and only a training for Lightning.
    from hilbertvae.commands.build import build_mappers
    from hilbertvae.commands.scored_network import config_without_training, of_network, seeds_of
    from hilbertvae.reconstruction.reconstructor import Reconstructor
    from hilbertvae.reports.report import Report
    from hilbertvae.training.given_networks import load_named, needs_training
    from hilbertvae.training.scoring import score

    mappers = build_mappers(settings.mapper)
    learned = {**dict.fromkeys(data.train, "train"), **dict.fromkeys(data.calibrate, "calibrate"), data.validate: "validate"}
    sites = learned | dict.fromkeys(data.test, "test")
    training = settings.checkpoint is None and (not mappers or needs_training(mappers))
    for reference in sites if training else data.test:
        settings.source().check(reference)
    scored = Reconstructor.load(settings.checkpoint) if settings.checkpoint else None
    mappers = load_named(settings, mappers, scored)
    if training:
        from hilbertvae.training.train import check_folder, first_rank, train

        check_folder(settings)
    elif scored and is_trained(settings.output) and not _is_its_own(settings):
        raise InputError(f"output: {settings.output} holds the training of another network than `checkpoint`; choose another `name`")
    if not again:  # late: a job that is refused leaves what was there
        forget(settings.output)
    config, identity = asdict(settings) if training else config_without_training(settings), _identity(settings)
    named = named_networks(settings)
    if not scored and not training and len({*named.values()}) == 1:  # whose boxes those of raw grids are, too
        scored = next(mapper.reconstructor for name, mapper in mappers.items() if f"mapper.{name}.reconstructor" in named)
    if scored:
        config |= of_network(scored)

    def others():
        for site, role in sites.items():
            with contextlib.suppress(InputError):  # where nothing is trained, nobody has to have the training sites
                if role != "test":
                    yield open_site(site, settings.resolution_m, settings.source()), role

    own = {without_folders(site): found for site, found in own_sites(sites).items()}
    hashes = site_hashes([site for site, role in sites.items() if training or role != "train"]) | own | _given(settings)
    write = Report(
        settings.output,
        config,
        identity=identity,
        seeds=seeds_of(settings, scored),
        data=hashes,
        others=others,
        pictures=settings.pictures,
        card=scored.card if scored else {},
    )
    if other_scoring:
        clear(settings.output)
    if training:
        train(settings, mappers, write)
        if not first_rank():
            return 0
    else:
        score(settings, mappers, scored, write)
    return write.close()


def _identity(settings: Settings) -> dict:
    """What can change a run's numbers, by contents wherever they lie; hashed, it tells a finished run."""
    tested = [settings.source().made_of(site) for site in settings.data.test]
    # Wherever networks fill maps, `device` counts as it is by default.
    mapper = {name: one | {"device": "auto"} if isinstance(one, dict) and "device" in one else one for name, one in settings.mapper.items()}
    evaluated = {"mapper": mapper, "evaluation": asdict(settings.evaluation), "test": tested, **_given(settings)}
    return {"version": hilbertvae.__version__, "training": training_hash(settings), **evaluated}


def _given(settings: Settings) -> dict[str, str]:
    """The hashes of the networks that a run takes instead of training one: its own, and those that mappers name."""
    networks = {"checkpoint": settings.checkpoint, **named_networks(settings)}
    paths = {key: checkpoint_path(name) for key, name in networks.items() if name}
    return {key: file_sha256(path) for key, path in paths.items() if path.is_file()}  # one that is missing is named where it is loaded


def _is_its_own(settings: Settings) -> bool:
    """Whether the network to be scored is the one that was trained in the run's folder."""
    own = Path(settings.output) / "model.safetensors"
    return own.is_file() and file_sha256(own) == file_sha256(checkpoint_path(settings.checkpoint))


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
        refuse_ignored(settings, list(job.overrides.task))
        settings.output = output
        if "SlurmLauncher" in launcher and settings.trainer.devices > 1:  # of which Lightning wants SLURM to start one process each
            raise InputError(
                f"trainer.devices: expected 1 with launcher=submitit, whose jobs are one process, got {settings.trainer.devices}"
            )
        if many and settings.trainer.devices > 1:
            # By this name Lightning starts the other processes; in a launcher's worker `__main__` is the launcher.
            sys.modules["__main__"].__spec__ = find_spec("hilbertvae.train")
        with contextlib.nullcontext() if int(os.environ.get("LOCAL_RANK", 0)) else alone_in(output, waits=many):
            code = (run_clustering if settings.task == "clustering" else run)(settings, again=not many)
    except KeyboardInterrupt as error:
        if many:
            raise
        print(f"hilbertvae-train: {str(error) or 'stopped; the same command goes on from where it was'}", file=sys.stderr)
        sys.exit(130)
    except Exception as error:
        refused = isinstance(error, InputError)
        had, write = (has_study, write_clustering_failure) if config.task == "clustering" else (has_result, write_failure)
        if refused and not many:  # a wrong setting of a single run is told at once, and leaves nothing
            print(f"hilbertvae-train: {error}", file=sys.stderr)
            sys.exit(2)
        unwritable = isinstance(error, OSError) and error.filename and not many  # a full disk, or a folder that nobody may write in
        if refused and had(output):  # good scores don't go for a slip of the pen
            write_refusal(output, error)
        else:
            with contextlib.suppress(OSError) if unwritable else contextlib.nullcontext():  # where there's no room even for that
                write(output, OmegaConf.to_container(config, resolve=True, throw_on_missing=False), error)
        if unwritable:  # a checkpoint is made in the system's temporary folder and moved: it is where to that it couldn't be
            print(f"\nhilbertvae-train: {error.filename2 or error.filename}: {error.strerror}", file=sys.stderr)
            sys.exit(1)
        raise
    if code:
        raise RuntimeError("a mapper failed; see the lines above and result.json")


def main() -> None:
    """Entry point. `+sweep=...` is taken as `sweep=...`: the group has its place in the defaults, so that `debug` comes after it."""
    words = [word.removeprefix("+") if word.startswith("+sweep=") else word for word in sys.argv[1:]]
    if any(word.startswith("sweep=") for word in words) and not {"-m", "--multirun", "-c", "--cfg", "-h", "--help"} & set(words):
        print("hilbertvae-train: a sweep without -m is its first job alone; add -m for all of them", file=sys.stderr)
    if JOB in os.environ and int(os.environ.get("LOCAL_RANK", 0)):
        words = json.loads(os.environ[JOB]) + [word for word in words if word.startswith(("hydra.job.name=", "hydra.output_subdir="))]
    for word in words:
        extra, plugin = LAUNCHERS.get(word.removeprefix("launcher="), ("", ""))
        if word.startswith("launcher=") and extra and not find_spec(f"hydra_plugins.{plugin}"):
            print(f"hilbertvae-train: {word}: needs the extra '{extra}': {how_to_install(extra)}", file=sys.stderr)
            sys.exit(2)
    sys.argv[1:] = words
    show_any_text()
    remember_gpus()
    with stopped_by_signals():  # else a launcher's workers, or a scoring's, would go on without it
        _application()


if __name__ == "__main__":
    main()
