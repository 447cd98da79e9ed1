"""One run: from settings to a network, scores, and all that is written of them. It knows nothing of Hydra."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.commands.overrides import learns_weights, mapper_of, named_networks
from hilbertvae.files import file_sha256
from hilbertvae.reconstruction.shipped import checkpoint_path
from hilbertvae.reports.provenance import named_without_folders
from hilbertvae.reports.run_folder import NETWORK, clear, forget, forget_other_sites, is_finished, is_trained, was_scored_alone
from hilbertvae.scans.sites import site_hashes
from hilbertvae.site import Site, open_site, site_name
from hilbertvae.training.settings import Settings
from hilbertvae.training.site_roles import own_sites
from hilbertvae.training.training_hash import training_hash

if TYPE_CHECKING:
    from hilbertvae.mappers.mapper import Mapper
    from hilbertvae.reconstruction.reconstructor import Reconstructor


def run(settings: Settings, again: bool = True) -> int:
    """Train if a mapper needs it, score all, write everything; the exit code. again: do so even if the results are there already."""
    other_scoring = was_scored_alone(settings.output)
    if not again and _is_done(settings):
        print(f"{settings.output}: finished before")
        return 0
    # Late: a sweep that has nothing to do waits for none of it, and only a training for Lightning.
    from hilbertvae.commands.build import build_mappers
    from hilbertvae.commands.scored_network import config_without_training, of_named, of_network, seeds_of
    from hilbertvae.reconstruction.reconstructor import Reconstructor
    from hilbertvae.reports.report import Report
    from hilbertvae.training.given_networks import load_named, needs_training
    from hilbertvae.training.scoring import score

    mappers = build_mappers(settings.mapper)
    training = settings.checkpoint is None and (not mappers or needs_training(mappers))
    sites = _roles(settings, training)
    for reference in sites if training else settings.data.test:
        settings.source().check(reference)
    scored = Reconstructor.load(settings.checkpoint) if settings.checkpoint else None
    mappers = load_named(settings, mappers, scored)
    if training:
        from hilbertvae.training.train import first_rank, train
        from hilbertvae.training.training_folder import check_folder

        check_folder(settings)
    else:
        _check_own(settings)
    if not again:  # late: a job that is refused leaves what was there
        forget(settings.output)
    config = asdict(settings) if training else config_without_training(settings)
    if scored := scored or (None if training else _only_named(settings, mappers)):
        config |= of_network(scored)
    elif not training:
        config = of_named(config, {name: mappers[name].reconstructor for name in map(mapper_of, named_networks(settings))})
    own = named_without_folders(own_sites(sites))
    hashes = site_hashes(list(sites))
    write = Report(
        settings.output,
        config,
        identity=identity(settings),
        seeds=seeds_of(settings, scored, training),
        data=hashes | own | _given(settings),
        others=lambda: _others(settings, sites),
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
    if write.written:
        forget_other_sites(settings.output, write.identity)
    return write.close()


def _is_done(settings: Settings) -> bool:
    """Whether the results of these settings lie in the run's folder, or its network where nothing is to be scored."""
    names = [site_name(site) for site in settings.data.test]
    with contextlib.suppress(InputError, OSError):  # what can't be read is told by the run, and is not finished
        if is_finished(settings.output, names, identity(settings), settings.pictures):
            return True
        return not (settings.mapper and names) and is_trained(settings.output, training_hash(settings))
    return False


def _roles(settings: Settings, training: bool) -> dict[str, str]:
    """What each site is there for: to train, to calibrate, to validate or to test. Of a network that was trained before, the sites that it
    has seen are on its card, and the run's count for maps alone that learn weights anew."""
    data, sites = settings.data, {}
    if training:
        sites |= dict.fromkeys(data.train, "train")
    if training or any(map(learns_weights, settings.mapper.values())):
        sites |= {**dict.fromkeys(data.calibrate, "calibrate"), data.validate: "validate"}
    return sites | dict.fromkeys(data.test, "test")


def _others(settings: Settings, sites: dict[str, str]) -> Iterator[tuple[Site, str]]:
    """The sites that are not tested, for a picture of all; where nothing is trained, nobody has to have them."""
    for site, role in sites.items():
        with contextlib.suppress(InputError):
            if role != "test":
                yield open_site(site, settings.resolution_m, settings.source()), role


def _only_named(settings: Settings, mappers: dict[str, Mapper]) -> Reconstructor | None:
    """The network that mappers name, if all name one: its boxes are those of raw grids, too."""
    named = named_networks(settings)
    if len({*named.values()}) != 1:
        return None
    return mappers[mapper_of(next(iter(named)))].reconstructor


def identity(settings: Settings) -> dict:
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


def _check_own(settings: Settings) -> None:
    """An `InputError` if the run's folder holds the training of another network than is scored: it would have that one's scores. Others may
    be scored beside its own. One that is a `checkpoint`, and baselines alone, would take the training's own results from there."""
    given = _given(settings)
    if not is_trained(settings.output):
        return
    if settings.checkpoint or not given:
        raise InputError(f"output: {settings.output} holds a training, whose results would be replaced; choose another `name`")
    if file_sha256(Path(settings.output) / NETWORK) not in given.values():
        than = ", ".join(f"`{key}`" for key in given)
        raise InputError(f"output: {settings.output} holds the training of another network than {than}; choose another `name`")
