"""Settings of runs that take seconds, what names their grids, batches, and a mapper that takes its time."""

import time
from dataclasses import replace

import torch

from hilbertvae.grids.training_grids import ClusteringSettings
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reconstruction.settings import AugmentationSettings, GatedNetworkSettings
from hilbertvae.scoring.protocol import Protocol
from hilbertvae.training.kept_grids import grids_hash
from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.scoring import score
from hilbertvae.training.settings import DataSettings, Settings, TrainerSettings
from toy_rooms import tiny_grid

NETWORK = GatedNetworkSettings(stem=2, channels=[4, 8], blocks=[1, 1], latent=3)
TRAINER = TrainerSettings(epochs=2, steps_per_epoch=4, batch_size=8, validation_grids=24, precision="32-true", threads=1, accelerator="cpu")


def tiny_settings(output, cache, data=None, **changes) -> Settings:
    """A tiny network on grids of 16 cells, trained for two epochs of four steps on one simulated building."""
    simulated = DataSettings(simulated=1, simulated_clusterings=1, simulated_extent_m=[12, 16], simulated_scans=20, test=[])
    return replace(
        Settings(
            output=str(output),
            data=replace(data or simulated, cache=str(cache)),
            clustering=ClusteringSettings(1, [0.6, 1.2]),
            grid=tiny_grid(),
            augmentation=AugmentationSettings(ball_diameter_cells=[3.0, 8.0]),
            network=NETWORK,
            trainer=TRAINER,
            evaluation=Protocol(gap_seeds=[0], gap_ratio=0.5, cluster_size_m=2.4),
            validation_gap_m=1.2,
            calibration_seeds=[100],
            pictures=False,
        ),
        **changes,
    )


class LateMapper(NearestMapper):
    """Is asked a while after it was fitted, so that whoever fits it anew meanwhile is told apart."""

    def __init__(self, neighbours=1, seed=0):
        super().__init__(neighbours)
        self.seed = seed

    def _fit(self, points, occupied, weight):
        super()._fit(points, occupied, weight)
        time.sleep(0.3)


def scores_of_late(settings) -> dict:
    """The scores of a `LateMapper` by `settings`."""
    written = []
    score(settings, {"late": LateMapper()}, None, lambda result, *_: written.append(result))
    return written[0].scores


def name_of(site, seed, settings):
    """What names the grids of one clustering of a site."""
    return grids_hash(settings.source().made_of(site), seed, settings)


def changed(settings, key, value):
    """`settings` with the value at a dotted key."""
    head, _, rest = key.partition(".")
    return replace(settings, **{head: changed(getattr(settings, head), rest, value) if rest else value})


def module_of(step=0, **changes) -> ReconstructionModule:
    """That of `tiny_settings` with the same fresh weights each time, which believes that it is at `step`."""
    torch.manual_seed(0)
    module = ReconstructionModule(tiny_settings("run", "cache", **changes))
    module.__class__ = type("At", (ReconstructionModule,), {"global_step": step})
    return module


def pairs(batch=8) -> tuple[torch.Tensor, torch.Tensor]:
    """Noise of codes, and the same with three cells in ten hidden, which is shown."""
    generator = torch.Generator().manual_seed(1)
    target = torch.randint(-1, 2, (batch, 16, 16), generator=generator).to(torch.int8)
    return torch.where(torch.rand(target.shape, generator=generator) < 0.3, torch.zeros_like(target), target), target
