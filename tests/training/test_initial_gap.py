from dataclasses import replace

import lightning as L
import pytest
from stopping_toys import assert_same, stop_at
from training_toys import TRAINER

from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.train import train

pytest.importorskip("embreex")
pytest.importorskip("shapely")


def going_on(finished, output, **trainer):
    """Settings of a run that goes on from the weights of another one."""
    return replace(finished[0], output=str(output), seed=1, trainer=replace(TRAINER, initial=str(finished[1]), **trainer))


@pytest.fixture(scope="module")
def gone_on(finished, tmp_path_factory):
    settings = going_on(finished, tmp_path_factory.mktemp("on") / "run")
    return settings, train(settings)


def test_the_loss_before_the_first_step_is_told_beside_the_best_epoch_s(finished, tmp_path, capsys, recwarn):
    card = Reconstructor.load(train(going_on(finished, tmp_path / "on"))).card
    before, best = card["initial_gap_nll"], card["gap_nll"]
    assert f"val/gap_nll is {before:.4f} with the weights of trainer.initial" in (said := capsys.readouterr().out)
    assert f"val/gap_nll is {best:.4f} after the best epoch, and was {before:.4f} before the first step" in said
    assert best < before and not [warned for warned in recwarn if "trainer.initial" in str(warned.message)]


def test_a_training_that_ends_with_worse_weights_than_it_began_with_says_so(finished, tmp_path, monkeypatch):
    """Here the loss is what the module logs, one more each time."""
    validated, logged, count = ReconstructionModule.validation_step, ReconstructionModule.log, []

    def log(self, name, value, **about):
        logged(self, name, value + len(count) if name == "val/gap_nll" else value, **about)

    monkeypatch.setattr(ReconstructionModule, "log", log)
    monkeypatch.setattr(ReconstructionModule, "validation_step", lambda self, *given: (count.append(1), validated(self, *given))[1])
    with pytest.warns(UserWarning, match="trainer.initial: no epoch has a better val/gap_nll than the .* that it began with; the best has"):
        train(going_on(finished, tmp_path / "worse"))


def test_the_check_draws_nothing_of_the_training(gone_on, tmp_path, monkeypatch):
    """The same bits come of a training without it."""
    made = L.Trainer
    monkeypatch.setattr("hilbertvae.training.train.L.Trainer", lambda **how: made(**{**how, "num_sanity_val_steps": 0}))
    path = train(replace(gone_on[0], output=str(tmp_path / "unchecked")))
    assert "initial_gap_nll" not in Reconstructor.load(path).card
    ours, theirs = (Reconstructor.load(each).fingerprint() for each in (path, gone_on[1]))
    assert ours == theirs


def test_a_run_that_goes_on_from_its_last_epoch_knows_what_it_began_with(gone_on, tmp_path, monkeypatch):
    settings = replace(gone_on[0], output=str(tmp_path / "interrupted"))
    with monkeypatch.context() as patch:
        stop_at(patch, 6, RuntimeError("the machine went away"))  # in the second epoch of four steps
        with pytest.raises(RuntimeError):
            train(settings)
    assert_same(train(settings), gone_on[1])
    cards = [Reconstructor.load(path).card for path in (tmp_path / "interrupted" / "model.safetensors", gone_on[1])]
    assert cards[0]["initial_gap_nll"] == cards[1]["initial_gap_nll"]


def test_a_training_with_fresh_weights_has_nothing_to_compare(finished):
    assert not {"initial_gap_nll", "gap_nll"} & {*Reconstructor.load(finished[1]).card}
