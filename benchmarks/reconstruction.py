"""Grids per second that the shipped networks complete, and the paper's networks of as many cells.

    python benchmarks/reconstruction.py [--device cuda] [--quick]

A row is one network on the device, one flip, batches of 64, as a map's fit calls it: int8 grids of a simulated site in, kernel values and
what would be known out. The paper's networks have fresh weights, which costs the same. `--device` measures a GPU where there is one.
"""

from __future__ import annotations

import torch
from measuring import arguments, report, seconds_of

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import bin_shown, find_frames
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import LikelihoodSettings, PaperNetworkSettings
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.site import SiteSource, open_site

GRIDS = 512
OF_THE_PAPER = {2: PaperNetworkSettings(), 3: PaperNetworkSettings(latent=100)}


def paper_network(like: Reconstructor) -> Reconstructor:
    """The paper's 9/7/5/5 network for the same grids."""
    settings = OF_THE_PAPER[like.dimension]
    network = build_network(settings, like.dimension, like.grid.cells)
    return Reconstructor(network, settings, LikelihoodSettings(kind="gaussian"), like.grid, like.dimension, like.resolution_m)


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--device", default="cpu")
    given = parser.parse_args(words)
    if given.device.startswith("cuda") and not torch.cuda.is_available():
        raise InputError(f"--device: {given.device} is not there")
    rows = []
    for name in ("2d-sim", "3d-sim") if given.quick else ("2d", "2d-sim", "3d", "3d-sim"):
        ours = Reconstructor.load(name)
        site = open_site("simulated:1", ours.resolution_m, SiteSource(ours.dimension, street=StreetSettings(scans=4)))
        frames = find_frames(site.fit, ours.grid, seed=0)
        count = min(2 if given.quick else GRIDS, len(frames))
        kinds = [(name, ours, count)]
        if not given.quick and not name.endswith("-sim"):
            kinds.append((f"the paper's, as {name}", paper_network(ours), min(count, 4 if ours.dimension == 3 else 32)))
        for what, network, some in kinds:
            grids = bin_shown(site.fit, frames, ours.grid, network.detailed)[:some]

            def complete(network=network, grids=grids):
                return network.complete(grids, flips=1, device=given.device)

            complete()  # kernels are chosen at the first call
            seconds, _ = seconds_of(complete, 1 if given.quick else 3)
            rows.append(
                {
                    "what": what,
                    "grids": some,
                    "cells": ours.grid.cells**ours.dimension,
                    "weights": sum(p.numel() for p in network.network.parameters()),
                    "grids per second": some / seconds,
                    "million cells per second": some * ours.grid.cells**ours.dimension / seconds / 1e6,
                }
            )
    report("reconstruction", given, rows, [], {"threads": torch.get_num_threads(), "device": given.device})


if __name__ == "__main__":
    main()
