"""What is made of a network after its last epoch."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from training_toys import TRAINER, tiny_settings

from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports import provenance
from hilbertvae.training import hilbert_map_callback
from hilbertvae.training.hilbert_map_callback import HilbertMapCallback


@pytest.fixture
def settings(tmp_path):
    return tiny_settings(tmp_path / "run", tmp_path / "cache")


@pytest.fixture
def card_after(settings, tmp_path, monkeypatch):
    """A function: the card of the network that a callback makes of the best epoch."""
    network = build_network(settings.network, settings.dimension, settings.grid.cells)
    state = {f"network.{name}": value for name, value in network.state_dict().items()}
    torch.save({"state_dict": state, "epoch": 0, "global_step": 1}, tmp_path / "best.ckpt")
    monkeypatch.setattr(hilbert_map_callback, "learn_rank_weights", lambda *given, **how: {})
    monkeypatch.setattr(hilbert_map_callback, "opened_site", lambda *given: None)

    def card(callback):
        best = SimpleNamespace(best_model_path=tmp_path / "best.ckpt")
        trainer = SimpleNamespace(interrupted=False, is_global_zero=True, checkpoint_callback=best, callbacks=[callback])
        callback.on_fit_end(trainer, SimpleNamespace(network=network))
        return Reconstructor.load(callback.checkpoint).card

    return card


def test_the_card_names_the_commit_that_trained_and_not_one_that_was_made_meanwhile(settings, card_after, monkeypatch):
    monkeypatch.setattr(provenance, "git_state", lambda folder: {"commit": "before", "dirty": False})
    after_fit = HilbertMapCallback(settings, {}, None)
    monkeypatch.setattr(provenance, "git_state", lambda folder: {"commit": "meanwhile", "dirty": False})
    assert card_after(after_fit)["git"]["commit"] == "before"


def test_the_card_says_which_gpu_trained_also_where_another_machine_scores(settings, card_after, monkeypatch):
    on_gpu = replace(settings, device="cpu", trainer=replace(TRAINER, accelerator="gpu"))
    with monkeypatch.context() as patch:
        patch.setattr(torch.cuda, "is_available", lambda: True)
        patch.setattr(torch.cuda, "get_device_name", lambda device: f"a GPU at {device}")
        began = {"gpu": HilbertMapCallback(on_gpu, {}, None).state_dict(), "cpu": HilbertMapCallback(settings, {}, None).state_dict()}
        later = HilbertMapCallback(on_gpu, {}, None)
    later.load_state_dict(began["cpu"])
    assert "trained_by" not in card_after(later)
    later = HilbertMapCallback(settings, {}, None)
    later.load_state_dict(began["gpu"])
    assert card_after(later)["trained_by"] == "a GPU at cuda"
