"""Networks by the kind that their settings name."""

from __future__ import annotations

import torch
from torch import nn

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.blocks import CHANNELS_LAST
from hilbertvae.reconstruction.conditional_network import ConditionalNetwork, ConditionalNetworkSettings
from hilbertvae.reconstruction.gated_network import GatedNetwork, GatedNetworkSettings
from hilbertvae.reconstruction.paper_network import PaperNetwork, PaperNetworkSettings

NETWORKS = {
    "gated": (GatedNetworkSettings, GatedNetwork),
    "conditional": (ConditionalNetworkSettings, ConditionalNetwork),
    "paper": (PaperNetworkSettings, PaperNetwork),
}
NetworkSettings = GatedNetworkSettings | ConditionalNetworkSettings | PaperNetworkSettings


def network_settings(values: dict) -> NetworkSettings:
    """The settings dataclass of plain `values`, by their `kind`."""
    kind = values.get("kind")
    if kind not in NETWORKS:
        raise InputError(f"network.kind: expected one of {', '.join(NETWORKS)}, got {kind!r}")
    if kind == "gated":
        values = {"known": False, **values}  # checkpoints of before there was such an output
    return NETWORKS[kind][0](**values)


def build_network(settings: NetworkSettings, dimension: int, cells: int) -> nn.Module:
    """A network with fresh weights for grids of `cells`^dimension, its channels last in memory, which spares convolutions a copy."""
    kinds = {made_with: kind for kind, (made_with, _) in NETWORKS.items()}
    if settings.kind != kinds[type(settings)]:  # the settings' class decides which keys there are, and is chosen as a whole
        raise InputError(f"network.kind: expected {kinds[type(settings)]!r}, as the chosen network has, got {settings.kind!r}")
    made = NETWORKS[settings.kind][1](settings, dimension, cells)
    return made.to(torch.float32, memory_format=CHANNELS_LAST[dimension])  # whatever a caller's default is
