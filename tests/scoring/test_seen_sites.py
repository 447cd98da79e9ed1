"""Scores on what a network was trained on say nothing of other places."""

import warnings
from types import SimpleNamespace

import pytest
from protocol_toys import Spy

from hilbertvae.reconstruction.training_card import many_simulated
from hilbertvae.scoring.protocol import Protocol, evaluate
from hilbertvae.site import Site

QUICK = Protocol(gap_seeds=[0], cluster_size_m=3.0, occlusion=False)
CARD = {"trained_on": ["aces", "drives/monday.log"], "started_from": {"trained_on": ["fhw", many_simulated("buildings", 5, 100)]}}


@pytest.mark.parametrize("name", ["aces", "fhw", "fhw-corrected.log.gz", "monday.log", "simulated:100", "simulated:104"])
def test_a_site_that_a_network_was_trained_on_is_told_of(room, name):
    mapper = Spy()
    mapper.reconstructor = SimpleNamespace(card=CARD)
    with pytest.warns(UserWarning, match=f"^mine: {name} is among what its network was trained on"):
        evaluate(mapper, Site(name, room.scans), QUICK, "mine")


@pytest.mark.parametrize("name", ["csail", "simulated:99", "simulated:105", "simulated:1e2"])
def test_no_other_site_is(room, name):
    mapper = Spy()
    mapper.reconstructor = SimpleNamespace(card=CARD)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*trained on")
        evaluate(mapper, Site(name, room.scans), QUICK)
        evaluate(Spy(), Site("aces", room.scans), QUICK)  # no network
