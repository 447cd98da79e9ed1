from dataclasses import replace

import pytest
import torch

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.added_training import with_training_of
from hilbertvae.reconstruction.training_card import calibrated_on, stages
from toy_rooms import tiny_reconstructor

STEM = {"trained_on": ["7 simulated buildings"], "validated_on": "simulated:900001", "epoch": 3, "steps": 40, "seed": 0}
OF_BASE = STEM | {"trained_on": ["aces"], "validated_on": "csail", "started_from": STEM, "learned_as": {"some": "settings"}}
LATER = STEM | {"trained_on": ["9 simulated buildings from 7 on"], "command": ["train.py"], "training_hash": "f00", "flips": 2}


def networks(**cards: dict):
    return (replace(tiny_reconstructor(seed=seed), card=card) for seed, card in enumerate(cards.values()))


def test_the_difference_is_added():
    base, before, after = networks(base=OF_BASE, before=STEM, after=LATER | {"started_from": STEM})
    states = [made.network.state_dict() for made in (base, before, after)]
    kept = {name: weight.clone() for name, weight in states[0].items()}
    found = with_training_of(base, before, after)
    for name, weight in found.network.state_dict().items():
        torch.testing.assert_close(weight, states[0][name] + (states[2][name] - states[1][name]))
        assert torch.equal(states[0][name], kept[name])
    assert found.grid == base.grid and found.map_weights == {}


def test_the_card_tells_every_training_that_is_in_it():
    """Sites of the other's trainings count as seen; what the map's weights were learned on is asked of the base."""
    second = LATER | {"trained_on": ["5 simulated buildings from 16 on"], "started_from": LATER | {"started_from": STEM}}
    # That map's weights were learned anew after a training makes no other network of it.
    base, before, after = networks(base=OF_BASE, before=STEM | {"calibrated_on": ["simulated:900010"]}, after=second)
    card = with_training_of(base, before, after).card
    assert [stage["trained_on"][0] for stage in stages(card)] == [
        "7 simulated buildings", "aces", "9 simulated buildings from 7 on", "5 simulated buildings from 16 on",
    ]  # fmt: skip
    assert [stage.get("added", False) for stage in stages(card)] == [False, False, True, True]
    assert calibrated_on(card) == ["csail"] and card["learned_as"] == OF_BASE["learned_as"]
    assert card["command"] == ["train.py"] and not {"training_hash", "flips"} & card.keys()


@pytest.mark.parametrize("before", [LATER, STEM | {"seed": 1}, LATER | {"started_from": STEM}])
def test_networks_that_do_not_go_on_from_one_another_are_refused(before):
    base, first, last = networks(base=OF_BASE, before=before, after=LATER | {"started_from": STEM})
    with pytest.raises(InputError, match="--plus: expected a network that goes on from the one that is given before it"):
        with_training_of(base, first, last)


@pytest.mark.parametrize("place", [1, 2])
def test_another_kind_of_network_is_refused(place):
    made = list(networks(base=OF_BASE, before=STEM, after=LATER | {"started_from": STEM}))
    made[place] = replace(tiny_reconstructor(channels=[4, 10]), card=made[place].card)
    with pytest.raises(InputError, match="--plus: expected a network of .*, as the other is, got"):
        with_training_of(*made)
