"""Tiny results and networks that the tests of reports share."""

import numpy as np
import torch
from matplotlib.patches import Circle

from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import GatedNetworkSettings, LikelihoodSettings
from hilbertvae.scoring.metrics import METRICS
from hilbertvae.scoring.result import Result


def reconstructor(dimension=2, cells=16):
    """A network that was never trained, for boxes of 16 cells."""
    torch.manual_seed(0)
    settings = GatedNetworkSettings(stem=2, channels=[4, 8], blocks=[1, 1], latent=3)
    resolution_m = {2: 0.1, 3: 0.2}[dimension]
    grid = GridSettings(cells=cells, cluster_diameter_m=cells * resolution_m, inner_radius_m=0.5)
    return Reconstructor(build_network(settings, dimension, cells), settings, LikelihoodSettings(), grid, dimension, resolution_m)


def circles_of(axes):
    return [patch for patch in axes.patches if isinstance(patch, Circle)]


def result(mappers=("cvae-hm", "nearest"), seeds=(0, 1, 2), dimension=2):
    """A `Result` of random scores."""
    rng = np.random.default_rng(3)

    def region():
        return {metric: rng.random(len(seeds)).tolist() for metric in METRICS}

    scores = {
        name: {reading: {part: region() for part in ("observed", "fitted", "gaps")} for reading in ("points", "voxels")} for name in mappers
    }
    curves = {
        name: {reading: np.sort(rng.random((len(seeds), 101)))[:, ::-1].tolist() for reading in ("points", "voxels")} for name in mappers
    }
    return Result(
        site="room",
        dimension=dimension,
        gap_diameter_m=2.5,
        gap_seeds=list(seeds),
        ceiling={"points": {"precision": 0.972, "recall": 0.953}, "voxels": {"precision": 1.0, "recall": 0.99}},
        scores=scores,
        seconds={name: {"fit": [1.0] * len(seeds)} for name in mappers},
        gaps=[{"seed": seed, "centres": [[1.0 + seed, 2.0]], "radius_m": [1.25]} for seed in seeds],
        curves=curves,
        protocol={"gap_ratio": 0.5, "gap_seeds": list(seeds), "rim": True, "centred": False},
    )
