import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import joblib
import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training_toys import TRAINER, tiny_settings

from toy_rooms import carmen_line, write_log

pytest.importorskip("embreex")
pytest.importorskip("shapely")

import hilbertvae.training.train as train_module  # noqa: E402
from hilbertvae.checks import InputError  # noqa: E402
from hilbertvae.files import file_sha256  # noqa: E402
from hilbertvae.mappers.hilbert_map import HilbertMap  # noqa: E402
from hilbertvae.mappers.nearest import NearestMapper  # noqa: E402
from hilbertvae.reconstruction.gated_network import GatedNetworkSettings  # noqa: E402
from hilbertvae.reconstruction.reconstructor import Reconstructor  # noqa: E402
from hilbertvae.scoring.calibration import learn_rank_weights  # noqa: E402
from hilbertvae.training.checkpoints import best_reconstructor  # noqa: E402
from hilbertvae.training.grids_datamodule import GridsDataModule  # noqa: E402
from hilbertvae.training.hilbert_map_callback import HilbertMapCallback  # noqa: E402
from hilbertvae.training.reconstruction_module import ReconstructionModule  # noqa: E402
from hilbertvae.training.train import _precision, train  # noqa: E402
from hilbertvae.training.training_hash import recipe_hash, training_hash  # noqa: E402


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def finished(tmp_path_factory, cache):
    """A run of two epochs, never interrupted."""
    settings = tiny_settings(tmp_path_factory.mktemp("runs") / "whole", cache)
    with joblib.parallel_config(backend="threading"):
        return settings, train(settings)


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


def test_a_run_leaves_a_checkpoint_that_maps(finished, room):
    settings, path = finished
    assert str(path) == f"{settings.output}/model.safetensors"
    found = Reconstructor.load(path)
    assert (found.grid, found.network_settings, found.resolution_m) == (settings.grid, settings.network, 0.1)
    assert set(found.map_weights) == {"points", "voxels"} and found.card["trained_on"] == ["1 simulated buildings"]
    mapper = HilbertMap(found).fit(room.fit.points, room.fit.occupied, room.fit.weight)
    assert np.isfinite(mapper.predict_proba(room.voxels.points)).all()


def test_the_card_says_which_gpu_trained(finished, monkeypatch):
    settings, path = finished
    network, best = Reconstructor.load(path).network, f"{settings.output}/checkpoints/best.ckpt"
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"a GPU at {device}")
    assert "trained_by" not in best_reconstructor(settings, network, best).card
    on_gpu = replace(settings, trainer=replace(TRAINER, accelerator="gpu"))
    assert best_reconstructor(on_gpu, network, best).card["trained_by"] == "a GPU at cuda"


def test_the_card_says_what_lay_at_the_paths_it_was_trained_on(finished, tmp_path):
    settings, path = finished
    network, best = Reconstructor.load(path).network, f"{settings.output}/checkpoints/best.ckpt"
    assert "trained_on_sha256" not in best_reconstructor(settings, network, best).card
    log = write_log(tmp_path / "attic.log", [carmen_line(np.full(180, 2.0), [0, 0, 0])])
    settings = replace(settings, data=replace(settings.data, train=["fr079", str(log)]))
    assert best_reconstructor(settings, network, best).card["trained_on_sha256"] == {str(log): file_sha256(log)}


def let_the_first_epoch_be_the_best(monkeypatch):
    """Validation is made to say so."""

    def validation_step(self, batch, number):
        self.log("val/gap_nll", float(self.current_epoch))

    monkeypatch.setattr(ReconstructionModule, "validation_step", validation_step)


def test_the_checkpoint_has_the_best_weights_not_the_last(finished, tmp_path, monkeypatch):
    let_the_first_epoch_be_the_best(monkeypatch)
    found = Reconstructor.load(train(replace(finished[0], output=str(tmp_path / "worse"))))
    assert (found.card["epoch"], found.card["steps"]) == (0, 4)
    states = [torch.load(tmp_path / "worse" / "checkpoints" / name, weights_only=True)["state_dict"] for name in ("best.ckpt", "last.ckpt")]
    network = found.network.state_dict()
    same = [all(torch.equal(value, state[f"network.{name}"]) for name, value in network.items()) for state in states]
    assert same == [True, False]


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


@pytest.mark.parametrize("change", ["", "code", "settings"])
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
    if change == "settings":
        settings = replace(settings, flips=1, trained=str(tmp_path / "kept"))
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


def test_another_seed_gives_another_network(finished, tmp_path):
    path = train(replace(finished[0], output=str(tmp_path / "other"), seed=1))
    ours, theirs = (Reconstructor.load(each).network.state_dict() for each in (path, finished[1]))
    assert any(not torch.equal(ours[name], theirs[name]) for name in ours)


def test_a_finished_run_is_not_trained_again(finished, tmp_path, monkeypatch):
    settings, path = finished
    before = shutil.copy(path, tmp_path)
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda *arguments: pytest.fail("trained again"))
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
        monkeypatch.setattr(train_module, "code_hash", lambda parts: "other code")
    train(settings)
    assert steps == list(range(TRAINER.epochs * TRAINER.steps_per_epoch))
    assert len(list((tmp_path / "trained").glob("*.safetensors"))) == 2


def test_a_nan_loss_fails_the_run(finished, tmp_path):
    settings = replace(finished[0], output=str(tmp_path / "nan"), trainer=replace(TRAINER, learning_rate=1e30, warmup_share=0.0))
    with pytest.raises(FloatingPointError, match="training loss is nan at step"):
        train(settings)
    assert not (tmp_path / "nan" / "model.safetensors").exists()


def test_bad_settings_fail_before_anything_is_written(finished, tmp_path):
    with pytest.raises(InputError, match="trainer.epochs"):
        train(replace(finished[0], output=str(tmp_path / "bad"), trainer=replace(TRAINER, epochs=0)))
    assert not (tmp_path / "bad").exists()


def test_mappers_are_scored_on_the_test_sites_and_writers_get_the_result(finished, tmp_path, monkeypatch):
    """The trained network is put where a mapper asks for it, and nowhere else."""
    settings, path = finished
    settings = replace(settings, data=replace(settings.data, test=["simulated:900002"]))
    written = []
    mappers = {"cvae-hm": HilbertMap("trained"), "raw-grid-hm": HilbertMap(grid=settings.grid), "nearest": NearestMapper()}
    monkeypatch.setattr(ReconstructionModule, "training_step", lambda *arguments: pytest.fail("trained again"))
    assert train(settings, mappers, lambda *arguments: written.append(arguments)) == path
    ((result, site, fitted),) = written
    assert (site.name, result.site) == ("simulated:900002", "simulated:900002")
    assert result.failed == {} and set(result.scores) == set(mappers)
    assert fitted["raw-grid-hm"].reconstructor is None
    assert fitted["cvae-hm"].reconstructor.map_weights == Reconstructor.load(path).map_weights
    json.dumps(result.plain(), allow_nan=False)


def test_the_training_hash_sees_what_changes_a_network_and_not_where_it_lies():
    settings = tiny_settings("run", "cache")
    elsewhere = tiny_settings("elsewhere", "other", name="x", pictures=True, mapper={"hm": {}})
    elsewhere = replace(elsewhere, data=replace(elsewhere.data, test=["intel"], folder="logs"))
    assert training_hash(elsewhere) == training_hash(settings)
    for change in ({"seed": 1}, {"trainer": replace(TRAINER, epochs=3)}, {"grid": replace(settings.grid, cells=32)}, {"resolution_m": 0.2}):
        assert training_hash(replace(settings, **change)) != training_hash(settings)


def test_the_hash_of_a_recipe_sees_all_of_that_but_the_seed_and_threads(finished):
    settings = tiny_settings("run", "cache")
    first = recipe_hash(settings, None)
    assert recipe_hash(replace(settings, seed=1, trainer=replace(TRAINER, threads=7)), None) == first
    assert recipe_hash(replace(settings, trainer=replace(TRAINER, learning_rate=1e-5)), None) != first
    start = replace(settings, trainer=replace(TRAINER, initial=str(finished[1])))
    ones = [recipe_hash(start, card) for card in ({"recipe_hash": "a"}, {"recipe_hash": "b"}, {})]
    assert len({first, *ones}) == 4  # of networks that start from one of another recipe
    assert Reconstructor.load(finished[1]).card["recipe_hash"] == recipe_hash(finished[0], None)


def test_the_hash_of_a_training_sees_what_a_path_holds(tmp_path):
    log = write_log(tmp_path / "attic.log", [carmen_line(np.full(180, 2.0), [0, 0, 0])])
    settings = tiny_settings(tmp_path / "run", tmp_path / "cache")
    settings = replace(settings, data=replace(settings.data, train=[str(log)]))
    first = training_hash(settings)
    assert training_hash(settings) == first
    write_log(log, [carmen_line(np.full(180, 3.0), [0, 0, 0])])
    assert training_hash(settings) != first


def test_the_maps_weights_are_learned_over_the_runs_flips(finished, tmp_path):
    settings, path = finished
    other = train(replace(settings, output=str(tmp_path / "one"), flips=1))
    one, four = Reconstructor.load(other), Reconstructor.load(path)
    assert all(torch.equal(a, b) for a, b in zip(one.network.state_dict().values(), four.network.state_dict().values(), strict=True))
    assert one.map_weights != four.map_weights


@pytest.mark.parametrize(("on_cpu", "on_gpu"), [(False, True), (True, False)])
def test_numbers_are_those_that_the_processor_multiplies_in(tmp_path, monkeypatch, on_cpu, on_gpu):
    has = {"cpu": on_cpu, "cuda": on_gpu}
    monkeypatch.setattr("hilbertvae.reconstruction.precision.fast_type", lambda kind: torch.bfloat16 if has[kind] else torch.float32)
    words = {True: "bf16-mixed", False: "32-true"}
    for gpu in (False, True):
        monkeypatch.setattr(torch.cuda, "is_available", lambda gpu=gpu: gpu)
        for accelerator, found in (("cpu", on_cpu), ("gpu", on_gpu), ("auto", on_gpu if gpu else on_cpu)):
            chosen = replace(TRAINER, precision="auto", accelerator=accelerator)
            assert _precision(tiny_settings(tmp_path, tmp_path, trainer=chosen)) == words[found]
    assert _precision(tiny_settings(tmp_path, tmp_path, trainer=replace(TRAINER, precision="16-mixed"))) == "16-mixed"


def test_no_network_learns_from_wrong_gradients(tmp_path, monkeypatch):
    """On CPUs torch gets those of 3D convolutions on 2 x 2 x 2 cells wrong in bfloat16."""
    monkeypatch.setattr("hilbertvae.reconstruction.precision.fast_type", lambda kind: torch.bfloat16)
    settings = tiny_settings(tmp_path, tmp_path, trainer=replace(TRAINER, precision="auto", accelerator="cpu"))
    for dimension, cells, levels, expected in ((3, 32, 3, "32-true"), (3, 32, 2, "bf16-mixed"), (2, 32, 3, "bf16-mixed")):
        network = GatedNetworkSettings(channels=[8] * levels, blocks=[1] * levels)
        other = replace(settings, dimension=dimension, grid=replace(settings.grid, cells=cells), network=network)
        assert _precision(other) == expected
