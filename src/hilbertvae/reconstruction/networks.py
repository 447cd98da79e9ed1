"""Networks by the kind that their settings name."""

from __future__ import annotations

import torch
from torch import nn

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.blocks import CHANNELS_LAST
from hilbertvae.reconstruction.conditional_network import ConditionalNetwork
from hilbertvae.reconstruction.gated_network import GatedNetwork
from hilbertvae.reconstruction.paper_network import PaperNetwork
from hilbertvae.reconstruction.settings import ConditionalNetworkSettings, GatedNetworkSettings, PaperNetworkSettings

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
    return NETWORKS[kind][0](**values)


def check_kind(settings: NetworkSettings) -> None:
    """An `InputError` for settings of no network, or whose `kind` is that of another class: the class decides which keys there are, and
    is chosen as a whole. Several kinds may share one."""
    if NETWORKS.get(getattr(settings, "kind", None), (None,))[0] is type(settings):
        return
    own = [repr(kind) for kind, (made_with, _) in NETWORKS.items() if made_with is type(settings)]
    if not own:
        raise InputError(f"network: expected settings of a class that NETWORKS has, got {type(settings).__name__}")
    raise InputError(f"network.kind: expected {' or '.join(own)}, as the chosen network has, got {settings.kind!r}")


def build_network(settings: NetworkSettings, dimension: int, cells: int) -> nn.Module:
    """A network with fresh weights for grids of `cells`^dimension, its channels last in memory, which spares convolutions a copy."""
    check_kind(settings)
    made = NETWORKS[settings.kind][1](settings, dimension, cells)
    return made.to(torch.float32, memory_format=CHANNELS_LAST[dimension])  # whatever a caller's default is
