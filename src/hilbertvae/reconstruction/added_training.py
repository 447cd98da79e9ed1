"""What a training made of one network's weights, added to another's (task arithmetic, Ilharco et al., ICLR 2023). Only for trainings at a
low rate, of networks that stem from the same one (docs/decisions.md)."""

from __future__ import annotations

import copy
from dataclasses import replace

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.mean_weights import check_same_kind
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.training_card import LEARNED_AS, calibrated_on, stages

OF_A_STAGE = (
    "trained_on", "trained_on_sha256", "validated_on", "epoch", "steps", "seed", "command", "git", "mean_with_step_before", "added",
)  # fmt: skip
"""What a card says of a training, and not of the map's weights that were learned after it."""


def with_training_of(base: Reconstructor, before: Reconstructor, after: Reconstructor) -> Reconstructor:
    """`base` with its weights + those of `after` - those of `before`, and without map's weights, which were learned for others.

    Its card tells the trainings between the two as its own last ones, so that what they saw counts as seen. Raises `InputError` for
    networks that differ in kind, and where `after` does not go on from `before`."""
    check_same_kind(base, before, "--plus")
    check_same_kind(base, after, "--plus")
    old, later = stages(before.card), stages(after.card)
    if len(later) <= len(old) or [_told(stage) for stage in later[: len(old)]] != [_told(stage) for stage in old]:
        raise InputError("--plus: expected a network that goes on from the one that is given before it, by their cards")
    network, first, last = copy.deepcopy(base.network), before.network.state_dict(), after.network.state_dict()
    network.load_state_dict({key: value + last[key] - first[key] for key, value in network.state_dict().items()})
    card = base.card
    for stage in later[len(old) :]:
        card = _told(stage) | {"started_from": card, "added": True}
    learned = {"calibrated_on": calibrated_on(base.card)} | {key: base.card[key] for key in base.card.keys() & {LEARNED_AS}}
    return replace(base, network=network, map_weights={}, card=card | learned)


def _told(stage: dict) -> dict:
    return {key: stage[key] for key in OF_A_STAGE if key in stage}
