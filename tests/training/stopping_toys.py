"""Runs that are stopped, and what they leave, for the tests of trainings."""

import torch

from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.training.reconstruction_module import ReconstructionModule


def stop_at(monkeypatch, step, error):
    """From now on the step of this number ends the run, as a lost machine or Ctrl-C would."""
    original = ReconstructionModule.training_step

    def training_step(self, batch, number):
        if self.global_step == step:
            raise error
        return original(self, batch, number)

    monkeypatch.setattr(ReconstructionModule, "training_step", training_step)


def count_steps(monkeypatch):
    """The numbers of the steps that are taken from now on."""
    steps = []
    original = ReconstructionModule.training_step
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda self, *rest: steps.append(self.global_step) or original(self, *rest))
    return steps


def assert_same(path, other):
    ours, theirs = Reconstructor.load(path), Reconstructor.load(other)
    for (name, a), (_, b) in zip(ours.network.state_dict().items(), theirs.network.state_dict().items(), strict=True):
        assert torch.equal(a, b), name
    assert ours.map_weights == theirs.map_weights and ours.card == theirs.card


def let_the_first_epoch_be_the_best(monkeypatch):
    """Validation is made to say so."""

    def validation_step(self, batch, number):
        self.log("val/gap_nll", float(self.current_epoch))

    monkeypatch.setattr(ReconstructionModule, "validation_step", validation_step)
