"""A trained network goes on with wider levels, or more blocks in them, saying at first what it said (Chen et al. 2016, Net2Net)."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from hilbertvae.reconstruction.blocks import channels_a_group, shows_no_less
from hilbertvae.reconstruction.gated_network import GatedNetwork


def is_wider(wide: object, narrow: object) -> bool:
    """Whether a network of settings `wide` is one of `narrow` but for more channels, in groups of as many (`group_norm`): a group of old
    and new ones together would change what the old ones say. Or for more blocks in a level: a fresh one hands on what it is given."""
    kinds = {getattr(settings, "kind", None) for settings in (wide, narrow)}
    if kinds != {"gated"} or len(wide.channels) != len(narrow.channels) or len(wide.blocks) != len(narrow.blocks):
        return False
    if (wide.channels, wide.blocks) == (narrow.channels, narrow.blocks):
        return False
    # What it is shown, and a second output, may have been added; and dropout is no part of a network's weights.
    free = {name: getattr(narrow, name) for name in ("channels", "blocks", "encoding", "known", "dropout")}
    alike = replace(wide, **free) == narrow and shows_no_less(wide.encoding, narrow.encoding) and wide.known >= narrow.known
    deeper = all(more >= blocks for more, blocks in zip(wide.blocks, narrow.blocks, strict=True))
    pairs = list(zip(wide.channels, narrow.channels, strict=True))
    return alike and deeper and narrow.bottom != "flat" and all(_can_grow(more, channels) for more, channels in pairs)


def _can_grow(more: int, channels: int) -> bool:
    return more == channels or (more > channels and channels_a_group(more) == channels_a_group(channels))


def wider_weights(narrow: dict[str, Tensor], wide: GatedNetwork) -> dict[str, Tensor]:
    """The state from which `wide`, which is fresh, goes on where a network with fewer channels or blocks, of state `narrow`, has stopped.

    Old channels come first, keep their weights and hear nothing of the new ones; these hear all, with the fresh weights of `wide`, and are
    heard as training comes to need them. A join hears two levels' channels side by side, so there old ones are the first of each half.
    Blocks that are new stay as they are.
    """
    found = {}
    for name, fresh in wide.state_dict().items():
        if name not in narrow:
            if not name.startswith("known_head."):  # which networks of before it lack
                found[name] = fresh.clone()
            continue
        found[name] = weights = fresh.clone()
        halves = 2 if name.startswith("join.") and fresh.ndim > 1 else 1
        heard = [] if fresh.ndim == 1 else [_first(fresh.shape[1], narrow[name].shape[1], halves)]
        old = len(narrow[name])
        weights[:old] = 0
        weights[(slice(old), *heard)] = narrow[name]
    return found


def _first(wide: int, narrow: int, halves: int) -> Tensor:
    """(narrow,) indices among `wide` channels of the first ones of each of so many `halves`."""
    starts = torch.arange(halves)[:, None] * (wide // halves)
    return (starts + torch.arange(narrow // halves)).flatten()
