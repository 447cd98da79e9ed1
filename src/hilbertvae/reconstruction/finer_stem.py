"""A trained network goes on with a finer stem: one level more, at twice the resolution, outside of those that it has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from torch import Tensor

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.blocks import shows_no_less
from hilbertvae.reconstruction.gated_network import GatedNetwork

LEVELLED = ("down", "shrink", "grow", "join", "up")
"""Parts of which there is one per level, or one between two levels."""
OUTERMOST = ("stem", "head", "known_head")


def is_finer(fine: object, coarse: object) -> bool:
    """Whether a network of settings `fine` is that of `coarse` with one level more outside of its own, and half its stem."""
    kinds = {getattr(settings, "kind", None) for settings in (fine, coarse)}
    if kinds != {"gated"} or not shows_no_less(fine.encoding, coarse.encoding):
        return False
    # What inner levels are made of may not differ: what they would lack stayed fresh, and they would say something else.
    free = {name: getattr(coarse, name) for name in ("stem", "channels", "blocks", "encoding", "known", "dropout")}
    levels = fine.channels[1:] == coarse.channels and fine.blocks[1:] == coarse.blocks
    return fine.stem * 2 == coarse.stem and levels and replace(fine, **free) == coarse


def finer_weights(coarse: dict[str, Tensor], fine: GatedNetwork) -> dict[str, Tensor]:
    """The state from which `fine` goes on where a network with twice its stem, of state `coarse`, has stopped.

    Inner levels keep their weights. The coarse stem is taken apart: channels of the fine one hand on one cell each, and the way to the
    next level makes of these what the coarse stem did, so that all inner levels hear what they heard before. Channels that are left, and
    all between the inner levels and the outputs, keep the fresh weights of `fine`. Its inputs may be more than those of `coarse`, whose
    are the first. An `InputError` if it has fewer channels than there are cells to hand on.
    """
    own, given = fine.state_dict(), coarse["stem.weight"]
    size, dimension, inputs = fine.settings.stem, fine.dimension, given.shape[1]
    handed_on = inputs * size**dimension
    if len(own["stem.weight"]) < handed_on:
        raise InputError(f"network.channels: expected at least {handed_on} in the first level, one per cell of the stem and input")
    stem, bias, shrink = own["stem.weight"].clone(), own["stem.bias"].clone(), own["shrink.0.weight"].clone()
    stem[:handed_on], bias[:handed_on], shrink[:] = 0, 0, 0
    for channel, (of_input, *cell) in enumerate(np.ndindex(inputs, *(size,) * dimension)):
        stem[channel, of_input, *cell] = 1
        shrink[:, channel] = given[:, of_input, *(slice(place, None, size) for place in cell)]
    found = {**own, "stem.weight": stem, "stem.bias": bias, "shrink.0.weight": shrink, "shrink.0.bias": coarse["stem.bias"]}
    for name, weights in coarse.items():
        part, _, rest = name.partition(".")
        if part in LEVELLED:
            level, _, rest = rest.partition(".")
            found[f"{part}.{int(level) + 1}.{rest}"] = weights
        elif part not in OUTERMOST:
            found[name] = weights
    return found
