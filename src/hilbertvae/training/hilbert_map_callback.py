"""After the last epoch: the best weights, the Hilbert Map's weights, the checkpoint, and the scores of every chosen mapper."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import lightning as L
import torch

from hilbertvae.mappers.calibration import learn_rank_weights
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.scoring.protocol import evaluate_all
from hilbertvae.scoring.result import Result
from hilbertvae.site import Site, open_site
from hilbertvae.training.settings import Settings

Writer = Callable[[Result, Site, dict[str, Mapper]], None]


class HilbertMapCallback(L.Callback):
    """Lightning allows no `self.log` here, and the weights in memory are the last: so the best are loaded, and writers get a `Result`."""

    def __init__(self, settings: Settings, mappers: dict[str, Mapper], write: Writer | None):
        self.settings, self.mappers, self.write = settings, mappers, write
        self.checkpoint: Path | None = None

    def on_fit_end(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        if trainer.interrupted:
            return
        self.checkpoint = Path(self.settings.output) / "model.safetensors"
        if not trainer.is_global_zero:
            return
        reconstructor = self._best(trainer, module)
        site = self._site(self.settings.data.validate)
        hilbert_map = HilbertMap(reconstructor)
        diameter_m = self.settings.evaluation.gap_diameter_m
        reconstructor.weights = learn_rank_weights(hilbert_map, site, diameter_m, self.settings.calibration_seeds)
        reconstructor.save(self.checkpoint)
        score(self.settings, self.mappers, reconstructor, self.write)

    def _best(self, trainer: L.Trainer, module: L.LightningModule) -> Reconstructor:
        settings = self.settings
        saved = torch.load(trainer.checkpoint_callback.best_model_path, map_location="cpu", weights_only=True)
        weights = {key.removeprefix("network."): value for key, value in saved["state_dict"].items() if key.startswith("network.")}
        network = module.network.to("cpu")
        network.load_state_dict(weights)
        card = {
            "trained_on": [*settings.data.train, f"{settings.data.simulated} simulated buildings"],
            "validated_on": settings.data.validate,
            "epoch": saved["epoch"],
            "steps": saved["global_step"],
            "seed": settings.seed,
        }
        return Reconstructor(
            network, settings.network, settings.likelihood, settings.grid, settings.dimension, settings.resolution_m, card=card
        )

    def _site(self, reference: str) -> Site:
        return open_settings_site(reference, self.settings)


def open_settings_site(reference: str, settings: Settings) -> Site:
    """A site as the settings say to read it."""
    return open_site(reference, settings.resolution_m, **settings.data.reading())


def score(settings: Settings, mappers: dict[str, Mapper], reconstructor: Reconstructor | None, write: Writer | None) -> None:
    """Every mapper on every test site; those that take a `reconstructor` and name none get this one."""
    for mapper in mappers.values():
        parameters = mapper.get_params(deep=False)
        if reconstructor is not None and parameters.get("reconstructor", "none") == "trained":
            mapper.set_params(reconstructor=reconstructor)
    for reference in settings.data.test if mappers else []:
        site = open_settings_site(reference, settings)
        result = evaluate_all(mappers, site, settings.evaluation, progress=print)
        if write:
            write(result, site, mappers)
