"""The mean of a network before and after a training: as good where the training gained, and better where it lost (model soups, Wortsman et
al. 2022). Only for trainings that stayed in one valley, as those that go on from one another at a low rate do (docs/decisions.md)."""

from __future__ import annotations

import copy
from dataclasses import replace

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.training_card import stages


def mean_of(before: Reconstructor, after: Reconstructor) -> Reconstructor:
    """`after` with the mean of its weights and those of `before`, and without map's weights, which were learned for others. The one may
    have had larger boxes than the other, of cells as large, if its weights are as many. Raises `InputError` for networks that differ in
    more, and where the card of `after` does not name all that `before` was trained on. The card of the mean says `True`, or how many
    trainings lie between the two."""
    check_same_kind(before, after, "checkpoint")
    if further := _trained_on(before) - _trained_on(after):
        raise InputError(
            f"checkpoint: expected a network that goes on from the one before it, which was trained on {sorted(further)[0]}, too"
        )
    network, old = copy.deepcopy(after.network), before.network.state_dict()
    network.load_state_dict({key: (value + old[key]) / 2 for key, value in network.state_dict().items()})
    steps = len(stages(after.card)) - len(stages(before.card))
    return replace(after, network=network, map_weights={}, card={**after.card, "mean_with_step_before": steps if steps > 1 else True})


def check_same_kind(first: Reconstructor, other: Reconstructor, key: str) -> None:
    """An `InputError` that names `key` if the weights of two networks are not as many, or don't mean the same."""
    kinds, shapes = zip(*map(_kind, (first, other)), strict=True)
    if kinds[0] != kinds[1] or shapes[0] != shapes[1]:
        wanted, got = ((*kind, f"{made.grid.cells} cells") for kind, made in zip(kinds, (first, other), strict=True))
        raise InputError(f"{key}: expected a network of {wanted}, as the other is, got {got}")


def _trained_on(made: Reconstructor) -> set[str]:
    return {site for stage in stages(made.card) for site in stage.get("trained_on", [])}


def _kind(made: Reconstructor) -> tuple[tuple, dict]:
    """What two networks must have in common for their weights to mean the same, and the shapes of these."""
    cell_m = f"{made.grid.cell_m:g} m"
    shapes = {name: weight.shape for name, weight in made.network.state_dict().items()}
    return (made.dimension, made.network_settings, made.likelihood.kind, f"cells of {cell_m}"), shapes
