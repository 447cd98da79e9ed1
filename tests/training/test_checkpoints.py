"""What happens to runs between two launches: a folder that moves, and patience that ends."""

from dataclasses import replace

import pytest
import torch
from training_toys import TRAINER, tiny_settings

pytest.importorskip("embreex")
pytestmark = pytest.mark.filterwarnings("ignore")

from hilbertvae.checks import InputError  # noqa: E402
from hilbertvae.reconstruction.reconstructor import Reconstructor  # noqa: E402
from hilbertvae.training.checkpoints import read_checkpoint  # noqa: E402
from hilbertvae.training.reconstruction_module import ReconstructionModule  # noqa: E402
from hilbertvae.training.train import train  # noqa: E402


@pytest.fixture
def epochs(monkeypatch) -> list[int]:
    """Epochs as they are validated; each is made to be worse than the one before, so that the first is the best."""
    seen = []

    def validation_step(self, batch, number):
        seen.append(self.current_epoch)
        self.log("val/gap_nll", float(self.current_epoch))

    monkeypatch.setattr(ReconstructionModule, "validation_step", validation_step)
    return seen


def test_a_run_that_was_moved_goes_on_and_keeps_its_best_epoch(tmp_path, monkeypatch, epochs):
    settings = tiny_settings(tmp_path / "before", tmp_path / "cache", trainer=replace(TRAINER, epochs=3))
    original = ReconstructionModule.training_step

    def training_step(self, batch, number):
        if self.global_step == 9:
            raise RuntimeError("the machine went away")
        return original(self, batch, number)

    with monkeypatch.context() as patch:
        patch.setattr(ReconstructionModule, "training_step", training_step)
        with pytest.raises(RuntimeError, match="went away"):
            train(settings)
    (tmp_path / "before").rename(tmp_path / "after")
    path = train(replace(settings, output=str(tmp_path / "after")))
    assert sorted(set(epochs)) == [0, 1, 2] and Reconstructor.load(path).card["epoch"] == 0
    assert not (tmp_path / "before").exists()


def test_a_finished_training_that_was_moved_is_scored_from_its_new_folder(tmp_path, epochs):
    settings = tiny_settings(tmp_path / "before", tmp_path / "cache")
    first = Reconstructor.load(train(settings)).network.state_dict()
    (tmp_path / "before").rename(tmp_path / "after")
    (tmp_path / "after/model.safetensors").unlink()
    found = Reconstructor.load(train(replace(settings, output=str(tmp_path / "after")))).network.state_dict()
    assert all(torch.equal(value, found[name]) for name, value in first.items())


def test_patience_that_ended_has_ended_when_the_run_is_asked_again(tmp_path, epochs):
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache", trainer=replace(TRAINER, epochs=9, patience_epochs=2))
    train(settings)
    assert sorted(set(epochs)) == [0, 1, 2]
    epochs.clear()
    train(settings)
    assert not epochs


@pytest.mark.parametrize("saved", [{}, [1], {"state_dict": 3, "epoch": 1, "global_step": 2}])
def test_a_checkpoint_of_another_program_is_refused_by_its_name(tmp_path, saved):
    torch.save(saved, tmp_path / "last.ckpt")
    with pytest.raises(InputError, match="last.ckpt: expected a whole checkpoint for the run to go on from"):
        read_checkpoint(tmp_path / "last.ckpt")
