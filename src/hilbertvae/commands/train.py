"""`hilbertvae-train`: train a network and score its map beside others. The Hydra application."""

from __future__ import annotations

import contextlib
import os
import sys
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import MISSING, DictConfig, OmegaConf

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.commands.build import build_mappers
from hilbertvae.files import file_sha256
from hilbertvae.reconstruction.gated_network import GatedNetworkSettings
from hilbertvae.reconstruction.paper_network import PaperNetworkSettings
from hilbertvae.scans.sites import site_hashes
from hilbertvae.site import open_site
from hilbertvae.training.settings import Settings

PACKAGE = Path(hilbertvae.__file__).parent
# The wheel carries the folder inside the package; a checkout has it at the top.
CONF = PACKAGE / "conf" if (PACKAGE / "conf").is_dir() else PACKAGE.parents[1] / "conf"

store = ConfigStore.instance()
# The network is missing there, so that a choice of another kind meets no default of this one.
store.store(name="settings_schema", node=Settings(network=MISSING))
store.store(group="network", name="gated_schema", node=GatedNetworkSettings)
store.store(group="network", name="paper_schema", node=PaperNetworkSettings)


def to_settings(config: DictConfig) -> Settings:
    """The configuration as plain dataclasses, checked."""
    settings = OmegaConf.to_object(config)
    _refuse_unknown(settings, "")
    settings.check()
    return settings


def _refuse_unknown(node: object, path: str) -> None:
    """Hydra's `+key=value` adds a key to a typed node without complaint; no setting that nothing reads is let through."""
    known = {part.name for part in fields(node)}
    for name, value in vars(node).items():
        if name not in known:
            raise InputError(f"{path}{name}: unknown key; expected one of {', '.join(sorted(known))}")
        if is_dataclass(value):
            _refuse_unknown(value, f"{path}{name}.")


def run(settings: Settings) -> int:
    """Train if a mapper needs it, score all, write everything; the exit code."""
    from hilbertvae.reconstruction.reconstructor import Reconstructor
    from hilbertvae.reports.report import Report
    from hilbertvae.training.scoring import needs_training, score
    from hilbertvae.training.train import train, training_hash

    mappers = build_mappers(settings.mapper)
    data = settings.data
    sites = {**dict.fromkeys(data.train, "train"), data.validate: "validate", **dict.fromkeys(data.test, "test")}
    training = settings.checkpoint is None and (not mappers or needs_training(mappers))
    for reference in sites if training else data.test:
        settings.source().check(reference)
    reconstructor = Reconstructor.load(settings.checkpoint) if settings.checkpoint else None
    given = {"checkpoint": file_sha256(settings.checkpoint)} if settings.checkpoint else {}  # by what is in it, wherever it lies
    config = asdict(settings)
    tested = [settings.source().made_of(site) for site in data.test]
    evaluated = {"mapper": settings.mapper, "evaluation": config["evaluation"], "test": tested, **given}
    identity = {"training": training_hash(settings), **evaluated}
    seeds = {"training": settings.seed, "gaps": settings.evaluation.gap_seeds, "calibration": settings.calibration_seeds}

    def others():
        for site, role in sites.items():
            with contextlib.suppress(InputError):  # where nothing is trained, nobody has to have the training sites
                if role != "test":
                    yield open_site(site, settings.resolution_m, settings.source()), role

    write = Report(settings.output, config, identity, seeds, site_hashes(list(sites)) | given, others, settings.pictures)
    if training:
        train(settings, mappers, write)
    else:
        score(settings, mappers, reconstructor, write)
    return write.close()


@hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")
def _application(config: DictConfig) -> None:
    try:
        settings = to_settings(config)
        if HydraConfig.get().mode == RunMode.MULTIRUN:
            settings.output = os.path.relpath(HydraConfig.get().runtime.output_dir)  # a folder for each job
        code = run(settings)
    except (InputError, KeyboardInterrupt) as error:
        if HydraConfig.get().mode == RunMode.MULTIRUN:
            raise
        print(f"hilbertvae-train: {error}", file=sys.stderr)
        sys.exit(2 if isinstance(error, InputError) else 130)
    if code:
        raise RuntimeError("a mapper failed; see the lines above and result.json")


def main() -> None:
    """Entry point."""
    _application()


if __name__ == "__main__":
    main()
