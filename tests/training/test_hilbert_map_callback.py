"""What is made of a network after its last epoch."""

from types import SimpleNamespace

import torch
from training_toys import tiny_settings

from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports import provenance
from hilbertvae.training import hilbert_map_callback
from hilbertvae.training.hilbert_map_callback import HilbertMapCallback


def test_the_card_names_the_commit_that_trained_and_not_one_that_was_made_meanwhile(tmp_path, monkeypatch):
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache")
    network = build_network(settings.network, settings.dimension, settings.grid.cells)
    state = {f"network.{name}": value for name, value in network.state_dict().items()}
    torch.save({"state_dict": state, "epoch": 0, "global_step": 1}, tmp_path / "best.ckpt")
    monkeypatch.setattr(hilbert_map_callback, "learn_rank_weights", lambda *given, **how: {})
    monkeypatch.setattr(hilbert_map_callback, "opened_site", lambda *given: None)
    monkeypatch.setattr(provenance, "git_state", lambda folder: {"commit": "before", "dirty": False})
    after_fit = HilbertMapCallback(settings, {}, None)
    monkeypatch.setattr(provenance, "git_state", lambda folder: {"commit": "meanwhile", "dirty": False})
    best = SimpleNamespace(best_model_path=tmp_path / "best.ckpt")
    trainer = SimpleNamespace(interrupted=False, is_global_zero=True, checkpoint_callback=best)
    after_fit.on_fit_end(trainer, SimpleNamespace(network=network))
    assert Reconstructor.load(after_fit.checkpoint).card["git"]["commit"] == "before"
