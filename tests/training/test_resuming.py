"""Runs that are asked again: those that were stopped go on, those that are done stay, those of others are left alone."""

import json
import shutil
import threading
import warnings
from dataclasses import replace
from types import SimpleNamespace

import pytest
from stopping_toys import assert_same, count_steps, let_the_first_epoch_be_the_best, stop_at
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training_toys import TRAINER, tiny_settings

import hilbertvae.training.kept_network as kept_module
from hilbertvae.checks import InputError
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.scoring.calibration import learn_rank_weights
from hilbertvae.training.grids_datamodule import GridsDataModule
from hilbertvae.training.hilbert_map_callback import HilbertMapCallback
from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.train import train

pytest.importorskip("embreex")
pytest.importorskip("shapely")


@pytest.mark.parametrize("error", [RuntimeError("the machine went away"), KeyboardInterrupt()], ids=["lost", "ctrl-c"])
def test_an_interrupted_run_goes_on_to_the_same_bits(finished, tmp_path, monkeypatch, error):
    settings = replace(finished[0], output=str(tmp_path / "interrupted"))
    with monkeypatch.context() as patch:
        patch.setattr("signal.signal", lambda *arguments: None)  # Lightning switches Ctrl-C off for the rest of the process
        stop_at(patch, 6, error)  # in the second epoch of four steps
        with pytest.raises((RuntimeError, KeyboardInterrupt, SystemExit)):
            train(settings)
    assert not (tmp_path / "interrupted" / "model.safetensors").exists()
    steps = count_steps(monkeypatch)
    path = train(settings)
    assert steps == [4, 5, 6, 7]
    assert_same(path, finished[1])


@pytest.mark.parametrize(("scored", "said"), [
    (False, "training was interrupted; the same command goes on from the last epoch in"),
    (True, "scoring was interrupted; the same command goes on after the last mapper and gap seed that were done in"),
])  # fmt: skip
def test_what_was_interrupted_is_said(finished, tmp_path, monkeypatch, scored, said):
    def stopped(*arguments, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr("signal.signal", lambda *arguments: None)  # Lightning switches Ctrl-C off for the rest of the process
    monkeypatch.setattr("hilbertvae.training.hilbert_map_callback." + ("score" if scored else "learn_rank_weights"), stopped)
    with pytest.raises(KeyboardInterrupt, match=said):
        train(replace(finished[0], output=str(tmp_path / "interrupted")))


@pytest.mark.parametrize("meant", [True, False])
def test_a_wait_that_is_interrupted_in_a_wrong_moment_is_a_stop_too(finished, tmp_path, monkeypatch, meant):
    """Of a condition, which says that its lock is not held, as the one of TensorBoard's writer at an epoch's end. A lock that is not
    held for another reason is an error, also in a training that begins where an earlier one was interrupted."""
    waiting = threading.Condition()

    def wait(*arguments, **named):
        with waiting:
            waiting.release()
            if meant:
                raise KeyboardInterrupt

    monkeypatch.setattr("lightning.pytorch.loggers.TensorBoardLogger.save", wait)
    settings = replace(finished[0], output=str(tmp_path / "interrupted"))
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        with pytest.raises(KeyboardInterrupt if meant else RuntimeError, match="the last epoch in" if meant else "un-?acquired|unlocked"):
            train(settings)


@pytest.mark.parametrize("change", ["", "code"])
def test_a_run_that_was_stopped_while_it_scored_has_its_weights(finished, tmp_path, monkeypatch, change):
    settings = replace(finished[0], output=str(tmp_path / "interrupted"))
    of_map, learned = "hilbertvae.training.hilbert_map_callback.", []
    monkeypatch.setattr("signal.signal", lambda *arguments: None)  # Lightning switches Ctrl-C off for the rest of the process
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(of_map + "score", lambda *rest: (_ for _ in ()).throw(KeyboardInterrupt))
        train(settings)
    seconds = json.loads((tmp_path / "interrupted" / "checkpoints" / "map_weights.json").read_text())["seconds"]
    monkeypatch.setattr(of_map + "learn_rank_weights", lambda *rest, **named: learned.append(1) or learn_rank_weights(*rest, **named))
    scored = []
    monkeypatch.setattr(of_map + "score", lambda settings, mappers, reconstructor, write: scored.append(reconstructor))
    if change == "code":
        monkeypatch.setattr("hilbertvae.training.kept_weights.CODE", "mended since")
    path = train(settings)
    assert len(learned) == bool(change)
    if not change:
        assert_same(path, finished[1])
        assert seconds <= scored[0].seconds["weights"] <= seconds + 1


def test_what_is_taken_again_is_logged_once(finished, tmp_path, monkeypatch):
    settings = replace(finished[0], output=str(tmp_path / "interrupted"), trainer=replace(TRAINER, steps_per_epoch=12))
    with monkeypatch.context() as patch:
        stop_at(patch, 22, RuntimeError("the machine went away"))
        with pytest.raises(RuntimeError, match="went away"):
            train(settings)
    train(settings)
    events = EventAccumulator(f"{settings.output}/tensorboard").Reload()
    assert [event.step for event in events.Scalars("train/loss")] == [9, 19]
    assert len(events.Scalars("val/gap_nll")) == 2


def test_an_interrupted_run_goes_on_from_its_last_epoch_not_from_its_best(finished, tmp_path, monkeypatch):
    let_the_first_epoch_be_the_best(monkeypatch)
    settings = replace(finished[0], output=str(tmp_path / "interrupted"), trainer=replace(TRAINER, epochs=3))
    with monkeypatch.context() as patch:
        stop_at(patch, 10, RuntimeError("the machine went away"))
        with pytest.raises(RuntimeError, match="went away"):
            train(settings)
    steps = count_steps(monkeypatch)
    path = train(settings)
    assert steps == [8, 9, 10, 11]
    assert Reconstructor.load(path).card["epoch"] == 0
    assert_same(path, train(replace(settings, output=str(tmp_path / "whole"))))


def test_seconds_of_a_run_are_those_of_all_its_starts(finished, tmp_path, monkeypatch):
    settings = replace(finished[0], output=str(tmp_path / "twice"))
    clock, laps = SimpleNamespace(now=0.0), []
    monkeypatch.setattr("hilbertvae.training.hilbert_map_callback.time", SimpleNamespace(perf_counter=lambda: clock.now))

    def takes(owner, name, seconds):
        original = getattr(owner, name)

        def slow(self, *rest, **named):
            clock.now += seconds
            return original(self, *rest, **named)

        monkeypatch.setattr(owner, name, slow)

    takes(GridsDataModule, "setup", 100)
    takes(ReconstructionModule, "training_step", 10)
    after = HilbertMapCallback.on_fit_end
    monkeypatch.setattr(HilbertMapCallback, "on_fit_end", lambda self, *rest: (after(self, *rest), laps.append(dict(self.seconds)))[0])
    with monkeypatch.context() as patched:
        stop_at(patched, 4, RuntimeError("gone"))  # the second epoch's first step
        with pytest.raises(RuntimeError):
            train(settings)
    train(settings)
    train(settings)  # nothing is left to do
    assert [(lap["grids"], lap["train"]) for lap in laps] == [(200, 80), (300, 80)]


def test_a_finished_run_is_not_trained_again(finished, tmp_path, monkeypatch):
    settings, path = finished
    before = shutil.copy(path, tmp_path)
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda *arguments: pytest.fail("trained again"))
    monkeypatch.setattr("hilbertvae.training.hilbert_map_callback.made_by", lambda: {"command": ["later"], "git": {"commit": "later"}})
    assert train(settings) == path
    assert_same(path, before)  # the file's bytes may differ: safetensors writes its header in any order


def test_a_folder_with_a_run_of_other_settings_is_left_alone(finished):
    settings, path = finished
    before = path.read_bytes()
    changed = replace(settings, seed=9, trainer=replace(settings.trainer, learning_rate=0.5))
    told = rf"\(seed {settings.seed} and not 9, trainer.learning_rate {settings.trainer.learning_rate} and not 0.5\)"
    with pytest.raises(InputError, match=f"output: .* holds a run with other settings {told}; choose another `name`"):
        train(changed)
    assert path.read_bytes() == before


def test_a_folder_whose_checkpoints_are_gone_has_its_network_still(finished, tmp_path, monkeypatch):
    """Whoever removed them to save room has a finished network there: it is scored, and no other is trained over it."""
    settings = replace(finished[0], output=str(tmp_path / "bare"), data=replace(finished[0].data, test=["simulated:900002"]))
    shutil.copytree(finished[0].output, settings.output, ignore=shutil.ignore_patterns("checkpoints"))
    network = tmp_path / "bare/model.safetensors"
    before, written = network.read_bytes(), []
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda *arguments: pytest.fail("trained again"))
    with pytest.raises(InputError, match=r"output: .*bare holds a run with other settings \(seed 0 and not 9\)"):
        train(replace(settings, seed=9))
    assert train(settings, {"cvae-hm": HilbertMap("trained")}, lambda *arguments: written.append(arguments)) == network
    ((result, _, _),) = written
    assert set(result.scores) == {"cvae-hm"} and network.read_bytes() == before and not (tmp_path / "bare/checkpoints").exists()


@pytest.mark.parametrize(("name", "damage"), [("last.ckpt", "cut"), ("last.ckpt", "short"), ("last.ckpt", "empty"), ("last.ckpt", "other"),
                                              ("best.ckpt", "cut"), ("best.ckpt", "gone")])  # fmt: skip
def test_a_damaged_checkpoint_is_named_with_the_remedy(finished, tmp_path, name, damage):
    settings = replace(finished[0], output=str(tmp_path / "damaged"))
    shutil.copytree(finished[0].output, settings.output)
    path = tmp_path / "damaged/checkpoints" / name
    content = {"cut": path.read_bytes()[:-1000], "short": path.read_bytes()[:20000], "empty": b"", "other": b"nothing of the kind"}
    path.unlink() if damage == "gone" else path.write_bytes(content[damage])
    why = "No such file or directory" if damage == "gone" else "cut off, or of something else"
    with pytest.raises(InputError, match=rf"^{path}: expected a whole checkpoint.* \({why}\); remove {path.parent} to train anew"):
        train(settings)
    shutil.rmtree(path.parent)
    assert train(settings) == tmp_path / "damaged/model.safetensors"


@pytest.mark.parametrize("content", [b"{", b"[]", b"\xff"])
def test_a_folder_that_does_not_say_what_was_trained_in_it_is_left_alone(finished, tmp_path, content):
    settings = replace(finished[0], output=str(tmp_path / "damaged"))
    shutil.copytree(finished[0].output, settings.output)
    (tmp_path / "damaged" / "training.json").write_bytes(content)
    with pytest.raises(InputError, match="output: .* holds a run with other settings"):
        train(settings)


@pytest.mark.parametrize("change", ["settings", "code"])
def test_a_job_whose_network_is_kept_trains_anew_what_another_left(change, tmp_path, monkeypatch):
    settings = tiny_settings(tmp_path / "job", tmp_path / "cache", trainer=TRAINER, trained=str(tmp_path / "trained"))
    train(settings)
    steps = count_steps(monkeypatch)
    if change == "settings":
        settings = replace(settings, seed=9)
    else:
        monkeypatch.setattr(kept_module, "code_hash", lambda parts: "other code")
    train(settings)
    assert steps == list(range(TRAINER.epochs * TRAINER.steps_per_epoch))
    assert len(list((tmp_path / "trained").glob("*.safetensors"))) == 2


def test_a_training_that_goes_on_by_other_code_says_so(finished, tmp_path, monkeypatch, capsys):
    """A long one may have to; whoever has changed the network wants to know that its weights are of before."""
    settings = replace(finished[0], output=str(tmp_path / "again"))
    shutil.copytree(finished[0].output, settings.output)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*other code.*")
        train(settings)
    assert "again: its network was trained before" in capsys.readouterr().out
    monkeypatch.setattr("hilbertvae.training.kept_network.code_hash", lambda parts: "another")
    with pytest.warns(UserWarning, match="again: was begun by other code than today's, which goes on from its weights; remove the folder"):
        train(settings)
